//! Second derivatives of a model, exactly: the Hessian times a direction.
//!
//! ```text
//! forward    v̇ = (∂v/∂u) u̇                 along the operations
//! rows       ġ = H_row ṡ                   H_row from second-order numbers, once per position
//! backward   ġ on to u: d/dε of the adjoint pass at u + ε u̇
//! ```
//! Each operation says how its values and its adjoints change along a direction. Nothing is
//! computed by differences, and only the curvature of arrival times is left out. What an operation computes from a
//! few scalars is differentiated by [`Hyper`].

use rand::Rng;

use crate::infer::{Evaluator, LogDensity};
use crate::model::density::DensityAt;
use crate::model::functions::{Columns as _, DensityFn, Terms as _};
use crate::model::laid_out::Model;
use crate::model::linear::Linear;
use crate::model::local::RowId;
use crate::model::scope::Local;
use crate::model::tape::{Curved, LocalHessian, Op, Second, Tape};
use crate::num::{Dual, Hyper, Num, derivatives, dual};

/// The Hessian of a model at one position.
pub(super) struct Hessian<'m> {
    model: &'m Model,
    t: Tape,
    d: Tape,
    curved: Vec<LocalHessian>,
}

impl<'m> Hessian<'m> {
    /// The Hessian at `u`. `with_rows` says whether the measurements count.
    pub(super) fn at(model: &'m Model, u: &[f64], with_rows: bool) -> Self {
        let (mut t, d) = (model.tape(), model.tape());
        let mut gradient = vec![0.0; u.len()];
        let mut curved = vec![];
        if with_rows {
            model.ln_density(&mut t, u, &mut gradient);
            for observe in &model.observes {
                curved.extend(observe.op.curvatures(&t));
            }
        } else {
            model.ln_prior(&mut t, u, &mut gradient);
        }
        for density in &model.densities {
            curved.extend(density.op.curvatures(&t));
        }
        Self { model, t, d, curved }
    }

    /// The Hessian times `direction`, both of the unknowns.
    pub(super) fn times(&mut self, direction: &[f64]) -> &[f64] {
        let Self { model, t, d, curved } = self;
        d.u.copy_from_slice(direction);
        for zero in [&mut d.v, &mut d.g, &mut d.gu] {
            zero.fill(0.0);
        }
        model.priors.iter().for_each(|op| op.push(t, d));
        model.fields.iter().for_each(|field| field.op.push(t, d));
        model.over.iter().for_each(|op| op.push(t, d));
        model.predictors.iter().for_each(|op| op.push(t, d));
        model.linear.iter().for_each(|op| op.push(t, d));
        for term in curved {
            term.pull(d);
        }
        self.pull()
    }

    /// Carries an adjoint of the scalars of these rows, one row after the other, to the unknowns.
    fn carried(&mut self, ids: &[RowId], adjoint: &[f64]) -> &[f64] {
        let Self { model, d, .. } = self;
        for zero in [&mut d.u, &mut d.v, &mut d.g, &mut d.gu] {
            zero.fill(0.0);
        }
        let places = ids.iter().flat_map(|id| model.observes[id.observe].op.locals(id.row));
        for ((value, offset), bar) in places.zip(adjoint) {
            d.g[value] += bar;
            if offset > 0 {
                d.g[offset] += bar;
            }
        }
        self.pull()
    }

    /// Carries the adjoints of the values to the unknowns.
    fn pull(&mut self) -> &[f64] {
        let Self { model, t, d, .. } = self;
        model.linear.iter().rev().for_each(|op| op.pull(t, d));
        model.predictors.iter().for_each(|op| op.pull(t, d));
        model.over.iter().for_each(|op| op.pull(t, d));
        model.fields.iter().rev().for_each(|field| field.op.pull(t, d));
        model.priors.iter().rev().for_each(|op| op.pull(t, d));
        &d.gu
    }

    /// Column `i`.
    pub(super) fn column(&mut self, i: usize) -> &[f64] {
        let mut direction = vec![0.0; self.t.u.len()];
        direction[i] = 1.0;
        self.times(&direction)
    }
}

struct OnTape<'m> {
    model: &'m Model,
    tape: Tape,
}

impl Evaluator for OnTape<'_> {
    fn interweave(
        &mut self,
        position: &mut [f64],
        _: &mut [f64],
        rng: &mut dyn Rng,
    ) -> Option<f64> {
        self.model.rescale_fields(&mut self.tape, position, rng);
        self.model.recentre_fields(&mut self.tape, position, rng);
        None
    }
    fn multipliers(&mut self, position: &[f64]) -> Vec<f64> {
        self.model.multipliers(&mut self.tape, position)
    }
    fn ln_prior(&mut self, position: &[f64]) -> f64 {
        self.model.ln_prior_alone(&mut self.tape, position)
    }
    fn ln_density(&mut self, position: &[f64], gradient: &mut [f64]) -> f64 {
        self.model.ln_density(&mut self.tape, position, gradient)
    }
    fn value(&mut self, position: &[f64]) -> f64 {
        self.model.ln_density_alone(&mut self.tape, position)
    }
    fn hessian(&mut self, position: &[f64], take: &mut dyn FnMut(usize, &[f64])) {
        let mut hessian = Hessian::at(self.model, position, true);
        (0..position.len()).for_each(|i| take(i, hessian.column(i)));
    }
}

impl LogDensity for Model {
    fn dim(&self) -> usize {
        self.layout[0]
    }
    fn evaluator(&self) -> Box<dyn Evaluator + '_> {
        Box::new(OnTape { model: self, tape: self.tape() })
    }
    /// Operators over a whole surface cost milliseconds.
    fn interwoven(&self) -> Option<Vec<usize>> {
        (!self.over.is_empty()).then(|| self.scales_of_fields())
    }
    fn draw_near(&self, draws: &[Vec<f64>]) -> bool {
        self.correct_at_draws(draws)
    }
}

impl Model {
    /// The Hessian of the log density without the measurements, times `direction`, `(dim)`.
    pub fn prior_times(&self, u: &[f64], direction: &[f64]) -> Vec<f64> {
        Hessian::at(self, u, false).times(direction).to_vec()
    }

    /// The gradient in the unknowns, `(dim)`, of Σ adjoint · scalar over the scalars of these rows.
    pub fn locals_pulled(&self, u: &[f64], ids: &[RowId], adjoint: &[f64]) -> Vec<f64> {
        Hessian::at(self, u, false).carried(ids, adjoint).to_vec()
    }

    /// Columns `of` of the Hessian of the log density without the measurements, each `(dim)`.
    pub fn prior_hessian(&self, u: &[f64], of: &[usize]) -> Vec<Vec<f64>> {
        let mut hessian = Hessian::at(self, u, false);
        of.iter().map(|i| hessian.column(*i).to_vec()).collect()
    }
}

mod fields;
mod priors;

impl<const N: usize> Local<N> {
    /// The numbers with a derivative in number `j` of them, and along the direction.
    fn hyper(&self, j: usize, t: &Tape, d: &Tape) -> [Num<Hyper>; N] {
        std::array::from_fn(|i| {
            let at = self.at[i] as usize;
            Num(Hyper::new(t.v[at], unit(i == j), d.v[at], 0.0))
        })
    }

    /// The numbers with their derivative along the direction.
    fn pushed(&self, t: &Tape, d: &Tape) -> [Num<Dual<1>>; N] {
        std::array::from_fn(|i| {
            let at = self.at[i] as usize;
            Num(dual(t.v[at], [d.v[at]]))
        })
    }

    /// Where number `j` lives.
    fn place(&self, j: usize) -> usize {
        self.at[j] as usize
    }
}

/// 1 if this is the one that is differentiated.
fn unit(is_this: bool) -> f64 {
    f64::from(u8::from(is_this))
}

/// The change of a number along the direction.
fn change(x: Num<Dual<1>>) -> f64 {
    derivatives(&x.0)[0]
}

impl Second for Linear {
    fn push(&self, _: &Tape, d: &mut Tape) {
        self.forward(d);
    }

    fn pull(&self, _: &Tape, d: &mut Tape) {
        self.backward(d);
    }
}

impl<F: DensityFn<N>, const N: usize> Second for DensityAt<F, N> {}

impl<F: DensityFn<N>, const N: usize> Curved for DensityAt<F, N> {
    fn curvatures(&self, t: &Tape) -> Vec<LocalHessian> {
        let data = F::Columns::data(&self.cells);
        let places = (0..N).map(|j| (self.local.place(j), 0)).collect();
        vec![LocalHessian::new(places, |a, b| {
            let number = |i: usize| {
                let re = t.v[self.local.place(i)];
                Num(Hyper::new(re, unit(i == a), unit(i == b), 0.0))
            };
            let terms = F::terms::<Hyper>(std::array::from_fn(number), &data);
            terms.terms().iter().fold(Num::from(0.0), |sum: Num<Hyper>, x| sum + x).0.eps1eps2
        })]
    }
}

#[cfg(test)]
mod tests;
