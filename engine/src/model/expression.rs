//! Expressions of a model file as objects. The [`Builder`](super::expansion::Builder) gives them
//! places.
//!
//! The program of a model compiles what these objects hold, and nothing else. All the rest is
//! compiled once, with the library. Shipped priors and kernels are not even compiled with the
//! model: see [`shipped`](super::shipped).

use std::rc::Rc;

use super::builder::Place;
use super::compiled_rows::CompiledRows;
use super::density::{DensityAt, LogTerms};
use super::everywhere::{PlaceAt, PlaceFn};
use super::functions::{DensityFn, KernelFn, LetFn, PriorFn, RowFn, ScalarFn};
use super::gp::{Spectrum, SpectrumAt};
use super::map::{MapAt, MapFn};
use super::operator::Operator;
use super::parameter::{ParameterOp, PriorOp};
use super::predictor::{Factors, factors};
use super::row_math::{RowMath, RowsOf};
use super::scalar::{Constant, Lone, Scalar, ScalarAt};
use super::scope::Local;
use super::tape::opaque;

/// Names of parameters, as the builder knows them.
pub(super) type Names = &'static [&'static str];

/// A prior.
pub struct AnyPrior {
    pub(super) mentions: Names,
    pub(super) make: Box<dyn Fn() -> Box<dyn PriorOp>>,
}

/// Makes a scalar, given the places of what it mentions.
type MakeScalar = dyn Fn(&[u32]) -> Box<dyn Scalar>;

/// A field's mean or amplitude.
pub struct AnyScalar {
    pub(super) mentions: Names,
    pub(super) make: Box<MakeScalar>,
}

/// Makes a kernel, given the places of what it mentions.
type MakeSpectrum = dyn Fn(&[u32]) -> Box<dyn Spectrum>;

/// A kernel.
pub struct AnyKernel {
    pub(super) mentions: Names,
    pub(super) make: Box<MakeSpectrum>,
}

/// A `let`.
#[derive(Clone)]
pub struct AnyLet(pub(super) Rc<dyn Fn() -> Box<dyn MapFn>>);

/// An expression at every place of the surface, which reads these columns.
pub struct AnyOperand {
    pub(super) mentions: Place,
    pub(super) columns: &'static [&'static str],
    pub(super) make: Box<dyn Fn() -> Box<dyn PlaceFn>>,
}

/// A linear predictor.
#[derive(Clone)]
pub struct AnyPredictor(pub(super) Rc<Factors>);

/// A likelihood; of the numbers that it mentions these carry derivatives.
pub struct AnyRows(pub(super) Box<dyn RowMath>, pub(super) usize);

/// A log density.
pub struct AnyDensity {
    pub(super) mentions: Names,
    pub(super) at: fn(&[u32]) -> Box<dyn LogTerms>,
}

opaque!(AnyPrior, AnyScalar, AnyKernel, AnyLet, AnyOperand, AnyPredictor, AnyRows, AnyDensity);
opaque!(dyn Scalar, dyn PlaceFn, dyn Spectrum, dyn MapFn, dyn LogTerms, dyn RowMath);

/// The prior `f`. W is N + 1.
pub fn prior<F: PriorFn<N>, const N: usize, const W: usize>(mentions: Names, f: F) -> AnyPrior {
    AnyPrior { mentions, make: Box::new(move || Box::new(ParameterOp::<F, N, W>::new(f.clone()))) }
}

/// The mean or amplitude `f`.
pub fn scalar<F: ScalarFn<N>, const N: usize>(mentions: Names, f: F) -> AnyScalar {
    let make = move |at: &[u32]| -> Box<dyn Scalar> {
        Box::new(ScalarAt::<F, N> { local: Local::new(at), f: f.clone() })
    };
    AnyScalar { mentions, make: Box::new(make) }
}

/// The mean or amplitude that is this number.
#[inline(never)]
pub fn constant(x: f64) -> AnyScalar {
    AnyScalar { mentions: &[], make: Box::new(move |_| Box::new(Constant(x))) }
}

/// The mean or amplitude that is this one parameter.
#[inline(never)]
pub fn lone(name: Names) -> AnyScalar {
    AnyScalar { mentions: name, make: Box::new(|at| Box::new(Lone(at[0] as usize))) }
}

/// The kernel `f`.
pub fn kernel<F: KernelFn<N>, const N: usize>(mentions: Names, f: F) -> AnyKernel {
    let make = move |at: &[u32]| -> Box<dyn Spectrum> {
        Box::new(SpectrumAt::<F, N> { local: Local::new(at), f: f.clone() })
    };
    AnyKernel { mentions, make: Box::new(make) }
}

/// The `let` F.
pub fn value<F: LetFn<N>, const N: usize>() -> AnyLet {
    AnyLet(Rc::new(|| Box::new(MapAt::<F, N>::new())))
}

/// The operand F of an operator over the whole surface, which depends on N numbers, of which W carry derivatives, and
/// reads these columns.
pub fn operand<F: LetFn<N>, const N: usize, const W: usize>(
    mentions: Place,
    columns: &'static [&'static str],
) -> AnyOperand {
    AnyOperand { mentions, columns, make: Box::new(|| Box::new(PlaceAt::<F, N, W>::new())) }
}

/// An operator of the model file's own.
pub fn boxed(operator: impl Operator + 'static) -> Box<dyn Operator> {
    Box::new(operator)
}

/// The linear predictor F.
pub fn predictor<F: LetFn<N>, const N: usize>() -> AnyPredictor {
    AnyPredictor(Rc::new(factors::<F, N>))
}

/// The likelihood F, which depends on N numbers, of which W carry derivatives.
pub fn rows<F: RowFn<N>, const N: usize, const W: usize>() -> AnyRows {
    AnyRows(Box::new(RowsOf::new(CompiledRows::<F, N, W>::new())), W)
}

/// The log density F.
pub fn density<F: DensityFn<N>, const N: usize>(mentions: Names) -> AnyDensity {
    AnyDensity { mentions, at: |at| Box::new(DensityAt::<F, N>::new(Local::new(at))) }
}
