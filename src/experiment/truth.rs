//! Ground truths: fields over their declared ranges, made physical where they are not.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use super::ExperimentError;
use crate::field::{Matern52, unit_field};
use crate::manifold::{Basis, interpolate_biharmonic};
use crate::model::{MapName, Maps, Model, Tape};
use crate::random::Stream;

/// Modes of the ground truth.
pub const TRUTH_MODES: usize = 256;

/// Fields that are physical wherever they can be made so, and what follows from them.
#[derive(Clone, Debug)]
pub struct Truth {
    /// Each n_vertices.
    pub fields: Vec<Vec<f64>>,
    /// Derived quantities, each n_vertices; NaN where unphysical even after repair.
    pub derived: Vec<Vec<f64>>,
    /// Vertices that were repaired.
    pub unphysical: Vec<bool>,
}

impl Truth {
    /// Drawn with this lengthscale, mm.
    pub(super) fn new(
        outline: &Model,
        basis: &Basis,
        lengthscale: f64,
        seed: u64,
    ) -> Result<Self, ExperimentError> {
        let fields = true_fields(&Maps::new(outline, basis), basis, lengthscale, seed)?;
        Self::of(outline, basis, fields)
    }

    /// Of these fields, in the model's order.
    pub(super) fn of(
        outline: &Model,
        basis: &Basis,
        fields: Vec<Vec<f64>>,
    ) -> Result<Self, ExperimentError> {
        let mut tape = outline.tape();
        outline.forward(&mut tape, &outline.initial());
        repaired(&Maps::new(outline, basis), &tape, fields, basis)
    }

    /// Share of vertices that were repaired.
    pub fn repaired(&self) -> f64 {
        self.unphysical.iter().filter(|bad| **bad).count() as f64 / self.unphysical.len() as f64
    }

    /// Fields, then derived quantities.
    pub fn maps(&self) -> impl Iterator<Item = &Vec<f64>> {
        self.fields.iter().chain(&self.derived)
    }
}

/// Repairs fields where what follows from them is unphysical, at the parameters of the last forward
/// pass.
///
/// # Errors
/// [`ExperimentError::NothingPhysical`].
pub fn repaired(
    maps: &Maps<'_>,
    tape: &Tape,
    mut fields: Vec<Vec<f64>>,
    basis: &Basis,
) -> Result<Truth, ExperimentError> {
    let derived = maps.derived_fields(tape, &fields);
    let unphysical: Vec<bool> =
        (0..basis.n_vertices()).map(|v| derived.iter().any(|d| d[v].is_nan())).collect();
    repair(&mut fields, &unphysical, basis)?;
    let derived = maps.derived_fields(tape, &fields);
    Ok(Truth { fields, derived, unphysical })
}

/// Independent Matérn-5/2 fields, each scaled onto its whole declared range.
fn true_fields(
    maps: &Maps<'_>,
    basis: &Basis,
    lengthscale: f64,
    seed: u64,
) -> Result<Vec<Vec<f64>>, ExperimentError> {
    let mut rng = Stream::Truth.rng(seed);
    let ranged = maps.names().into_iter().take(maps.n_fields());
    ranged
        .map(|MapName { name: field, range, .. }| {
            let range = range.ok_or(ExperimentError::NoRange { field: field.into() })?;
            Ok(ranged_field(basis, lengthscale, range, &mut rng))
        })
        .collect()
}

/// A field of `CV_max` (n_vertices) for simulations: Matérn-5/2, scaled onto `range`, independent of the
/// fields that [`experiment`](super::experiment) draws from this seed.
pub fn conduction(basis: &Basis, lengthscale: f64, range: (f64, f64), seed: u64) -> Vec<f64> {
    ranged_field(basis, lengthscale, range, &mut Stream::Conduction.rng(seed))
}

fn ranged_field(
    basis: &Basis,
    lengthscale: f64,
    (low, high): (f64, f64),
    rng: &mut ChaCha8Rng,
) -> Vec<f64> {
    let eta: Vec<f64> = (0..basis.n_modes()).map(|_| rng.sample(StandardNormal)).collect();
    let unit = unit_field(basis, &Matern52(lengthscale), &eta);
    let min = unit.iter().copied().fold(f64::INFINITY, f64::min);
    let max = unit.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    unit.iter().map(|x| low + (high - low) * (x - min) / (max - min)).collect()
}

/// Replaces the fields at `bad` vertices by their average over the others, weighted by 1/d⁴ with d
/// the biharmonic distance.
///
/// Differs from the paper's code, which weights by 1/d⁸; this is its text.
fn repair(fields: &mut [Vec<f64>], bad: &[bool], basis: &Basis) -> Result<(), ExperimentError> {
    let good: Vec<usize> = (0..bad.len()).filter(|v| !bad[*v]).collect();
    if good.is_empty() {
        return Err(ExperimentError::NothingPhysical);
    }
    let vertices: Vec<usize> = (0..bad.len()).filter(|v| bad[*v]).collect();
    let averages = interpolate_biharmonic(basis, fields, &good, &vertices);
    for (vertex, average) in vertices.iter().zip(averages) {
        for (field, value) in fields.iter_mut().zip(average) {
            field[*vertex] = value;
        }
    }
    Ok(())
}
