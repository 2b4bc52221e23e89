//! The integral over what shifts the rows, at a position.

use super::layout::{Coefficient, Origin, Part, PartRow, Shifts};
use crate::infer::Factor;
use crate::model::gp::padded;
use crate::model::tape::{Op as _, Tape};
use crate::num::vector::dot;
use faer::Mat;
use rand::{Rng, RngExt as _};
use rand_distr::StandardNormal;

/// P of every part at some C and W.
pub(super) struct Known {
    /// The values on which C and W depend.
    at: [Vec<f64>; 2],
    /// C
    pub(super) c: Vec<f64>,
    grams: Vec<Gram>,
    pub(super) factors: Vec<Factor>,
}

/// `DᵀWD` of a part: W is that of its first row times these factors.
struct Gram {
    first: f64,
    factors: Vec<f64>,
    product: Mat<f64>,
}

/// Computes the integral; one per thread.
pub(super) struct Integrated<'m> {
    pub(super) of: &'m Shifts<'m>,
    pub(super) tape: Tape,
    pub(super) known: Option<Known>,
    /// b, then P⁻¹b.
    pub(super) mean: Vec<f64>,
    /// Where the last integral was, but for w.
    pub(super) last_at: Vec<f64>,
    /// Where everything on the tape was computed, but for w; empty where that is nowhere.
    pub(super) position: Vec<f64>,
}

impl<'m> Integrated<'m> {
    pub(super) fn new(of: &'m Shifts<'m>) -> Self {
        let mean = vec![0.0; of.coefficients.len()];
        let (last_at, position) = (vec![], vec![]);
        Self { of, tape: of.model.tape(), known: None, mean, last_at, position }
    }

    /// The unknowns at w = 0.
    pub(super) fn at_zero(&self, position: &[f64]) -> Vec<f64> {
        let mut u = position.to_vec();
        self.of.coefficients.iter().for_each(|c| u[c.unknown] = c.zero);
        u
    }

    /// ln of the integral at a position.
    pub(super) fn value_at(&mut self, position: &[f64]) -> f64 {
        let u = self.at_zero(position);
        if u == self.position {
            return self.value_again(position);
        }
        self.of.model.forward(&mut self.tape, &u);
        self.position = u;
        self.integral()
    }

    /// The same where nothing but what C and W depend on has changed since the last one.
    pub(super) fn value_again(&mut self, position: &[f64]) -> f64 {
        self.position = self.at_zero(position);
        self.tape.u.copy_from_slice(&self.position);
        let model = self.of.model;
        model.priors.iter().for_each(|prior| prior.forward(&mut self.tape));
        self.of.fields.iter().for_each(|f| model.fields[*f].op.forward(&mut self.tape));
        self.integral()
    }

    /// ln of the integral, with everything on the tape at w = 0; −∞ where there is none.
    fn integral(&mut self) -> f64 {
        let of = self.of;
        self.last_at.clone_from(&self.position);
        let at_zero = of.model.ln_density_of_values(&mut self.tape);
        if !at_zero.is_finite() || !self.know() {
            return f64::NEG_INFINITY;
        }
        let Some(known) = &self.known else { return f64::NEG_INFINITY };
        let t = &self.tape;
        for ((b, coefficient), c) in self.mean.iter_mut().zip(&of.coefficients).zip(&known.c) {
            *b = c * match coefficient.from {
                Origin::Value { at, .. } => t.g[at],
                Origin::Mode { field, k, .. } => {
                    let op = &of.model.fields[field].op;
                    let n = op.n_probes();
                    dot::<4>(&op.modes[k * padded(n)..][..n], &t.g[op.theta..][..n])
                }
            };
        }
        let mut sum = at_zero;
        for (part, factor) in of.parts.iter().zip(&known.factors) {
            let mut x: Vec<f64> = part.of.iter().map(|j| self.mean[*j]).collect();
            factor.solve(&mut x);
            sum += 0.5 * dot::<4>(&x, &x) - factor.ln_det();
            factor.solve_transposed(&mut x);
            part.of.iter().zip(x).for_each(|(j, x)| self.mean[*j] = x);
        }
        sum
    }

    /// Makes P what it is now; `false` where it has no factor.
    fn know(&mut self) -> bool {
        let (of, t) = (self.of, &self.tape);
        let at = of
            .depends
            .each_ref()
            .map(|values| values.iter().map(|v| t.v[*v]).collect::<Vec<f64>>());
        if self.known.as_ref().is_some_and(|known| known.at == at) {
            return true;
        }
        let is_w_known = self.known.as_ref().is_some_and(|known| known.at[1] == at[1]);
        let mut grams = self.known.take().map_or_else(Vec::new, |known| known.grams);
        if !is_w_known {
            let mut old = grams.into_iter();
            grams = of.parts.iter().map(|part| of.gram(part, t, old.next())).collect();
        }
        let c = of.multipliers(t);
        let factor = |(part, gram): (&Part, &Gram)| {
            let n = part.of.len();
            let entry = |i: usize, j: usize| {
                let prior = if i == j { of.coefficients[part.of[i]].precision } else { 0.0 };
                prior + c[part.of[i]] * c[part.of[j]] * gram.first * gram.product[(i, j)]
            };
            Factor::of(Mat::from_fn(n, n, entry).as_ref())
        };
        let factors = of.parts.iter().zip(&grams).map(factor).collect::<Option<Vec<_>>>();
        self.known = factors.map(|factors| Known { at, c, grams, factors });
        self.known.is_some()
    }

    /// Writes the unknowns of these coefficients.
    pub(super) fn put(&self, w: &[f64], position: &mut [f64]) {
        for (c, w) in self.of.coefficients.iter().zip(w) {
            position[c.unknown] = c.zero + c.unit * w;
        }
    }

    /// Brings the tape to where the coefficients have their mean, after [`Integrated::integral`] at this position.
    pub(super) fn set_mean(&mut self, position: &[f64]) {
        let mut u = position.to_vec();
        self.put(&self.mean, &mut u);
        let (of, t) = (self.of, &mut self.tape);
        t.u.copy_from_slice(&u);
        for (coefficient, w) in of.coefficients.iter().zip(&self.mean) {
            if let Origin::Value { at, location, scale } = coefficient.from {
                t.v[at] = location + scale * w;
            }
        }
        of.fields.iter().for_each(|field| of.model.fields[*field].op.forward(t));
    }

    /// The gradient of the integral, after [`Integrated::integral`] at this position.
    pub(super) fn gradient(&mut self, position: &[f64], gradient: &mut [f64]) {
        self.set_mean(position);
        self.of.model.backward_to_parameters(&mut self.tape);
        self.pull_ln_det();
        self.of.model.backward_of_parameters(&mut self.tape);
        gradient.copy_from_slice(&self.tape.gu);
        self.of.resting.iter().for_each(|i| gradient[*i] = 0.0);
    }

    /// Adds the adjoints of −½ ln |P| in what C depends on: with `P = T + C DᵀWD C` its slope in ln cᵢ is `Tᵢᵢ (P⁻¹)ᵢᵢ − 1`.
    fn pull_ln_det(&mut self) {
        let (of, Some(known)) = (self.of, &self.known) else { return };
        let mut slopes = vec![0.0; of.coefficients.len()];
        for (part, factor) in of.parts.iter().zip(&known.factors) {
            for (j, variance) in part.of.iter().zip(factor.variances()) {
                slopes[*j] = of.coefficients[*j].precision * variance - 1.0;
            }
        }
        let mut rest = &slopes[..];
        for field in &of.fields {
            let field = &of.model.fields[*field].op;
            for term in &field.terms {
                let (own, others) = rest.split_at(term.k);
                field.pull_ln_multipliers(&mut self.tape, term, own);
                rest = others;
            }
        }
    }

    /// A position with coefficients drawn given all else, after [`Integrated::integral`] there.
    pub(super) fn draw(&self, position: &mut [f64], rng: &mut dyn Rng) {
        let Some(known) = &self.known else { return };
        let mut w = self.mean.clone();
        for (part, factor) in self.of.parts.iter().zip(&known.factors) {
            let mut z: Vec<f64> = part.of.iter().map(|_| rng.sample(StandardNormal)).collect();
            factor.solve_transposed(&mut z);
            part.of.iter().zip(z).for_each(|(j, z)| w[*j] += z);
        }
        self.put(&w, position);
    }
}

impl Shifts<'_> {
    /// C
    fn multipliers(&self, t: &Tape) -> Vec<f64> {
        let fields = &self.model.fields;
        let mut of_term = (usize::MAX, usize::MAX, vec![]);
        let mut one = |c: &Coefficient| match c.from {
            Origin::Value { scale, .. } => scale,
            Origin::Mode { field, term, k } => {
                if (of_term.0, of_term.1) != (field, term) {
                    let op = &fields[field].op.terms[term];
                    let mut values = vec![0.0; op.k];
                    op.spectrum.values(&t.v, &fields[field].op.frequency[..op.k], &mut values);
                    let amplitude = op.amplitude.value(&t.v);
                    for x in &mut values {
                        *x *= amplitude;
                    }
                    of_term = (field, term, values);
                }
                of_term.2[k]
            }
        };
        self.coefficients.iter().map(&mut one).collect()
    }

    /// `DᵀWD`, by the product of `old` if W has changed by a factor alone.
    fn gram(&self, part: &Part, t: &Tape, old: Option<Gram>) -> Gram {
        let n = part.of.len();
        let information = |row: &PartRow| row.normal(self.model, t)[1];
        let first = part.rows.first().map_or(0.0, information);
        let factors: Vec<f64> = part.rows.iter().map(|row| information(row) / first).collect();
        if let Some(old) = old.filter(|old| old.factors == factors) {
            return Gram { first, ..old };
        }
        let weighted =
            Mat::from_fn(part.rows.len(), n, |i, j| factors[i].sqrt() * part.design[i * n + j]);
        Gram { first, factors, product: weighted.transpose() * &weighted }
    }
}
