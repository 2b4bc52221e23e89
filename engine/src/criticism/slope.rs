//! The gradient of a Laplace evidence in the outer values, which are not integrated over.
//!
//! ```text
//! ln p(y | η) ≈ L(X̂; η) − ½ ln det H,    H = −∇²L = P − Σ_r A_rᵀ h_r A_r,    scalars of row r: l_r = c_r + A_r X
//!
//! d/dη = ∂L/∂η + ½ Σ_r tr(V_r ∂h_r/∂η) + Σ_r tr(h_r A_r H⁻¹ ∂A_rᵀ/∂η) − ½ tr(H⁻¹ ∂P/∂η) + s · ∂∇L/∂η
//! V_r = A_r H⁻¹ A_rᵀ,    s = H⁻¹ Σ_r A_rᵀ q_r,    q_r = ½ ∂tr(V_r h_r)/∂l_r
//! ```
//! X are the linear unknowns, the coefficients of terms and the random effects of sites. P is the
//! curvature of their prior, and `h_r` that of a row's log likelihood in its scalars. The last term
//! is how the mode moves.
//!
//! All terms but the one with P add up to an adjoint of c and one of A. The model carries these on
//! to its unknowns.

use nalgebra::{DMatrix, DVector};

use super::engine::{Engine, RowAt};
use super::fit::LaplaceFit;
use super::newton::Clipped;
use super::system::System;
use crate::model::{Curvature, RowId};

/// The gradient.
#[derive(Clone, Debug)]
pub(super) struct Slope {
    /// In the model's other unknowns.
    pub(super) other: Vec<f64>,
    /// In ln sd of the random effect of sites.
    pub(super) ln_site: f64,
    /// In ln sd of the further error of rows.
    pub(super) ln_noise: f64,
    /// In ln sd of the random effect of units.
    pub(super) ln_unit: f64,
}

/// A fit with what the gradient is made of.
struct Pieces<'a> {
    engine: &'a Engine,
    fit: &'a LaplaceFit,
    /// sd of the sites' random effect.
    tau: f64,
    /// Curvature of each row in all of its scalars and, last, in the variance of a further error.
    rows: Vec<Curvature>,
    /// The parts of H⁻¹ times the linear map of the scalars: S⁻¹ J, and S⁻¹ times the coupling of
    /// each site.
    solved: DMatrix<f64>,
    solved_sites: DMatrix<f64>,
    /// q of each row. The last number of a row belongs to the variance.
    bends: Vec<Vec<f64>>,
    /// s, of the unknowns and of the sites.
    shift: (DVector<f64>, Vec<f64>),
}

/// Adjoints of the scalars at fixed X, and of their linear map; and the gradient in two of the
/// outer values.
struct Adjoints {
    constant: Vec<f64>,
    linear: DMatrix<f64>,
    ln_site: f64,
    ln_noise: f64,
}

impl Engine {
    /// The gradient of a fit's `ln_evidence`. No row is hidden from the fit.
    pub(super) fn slope(&self, fit: &LaplaceFit) -> Slope {
        let pieces = Pieces::new(self, fit);
        let adjoints = pieces.adjoints();
        let n_linear = self.split.linear.len();
        let of_unit = fit.unit_term(self).map_or(0, |term| term.n);
        let unit = n_linear..n_linear + of_unit;
        let of_units = unit.map(|k| {
            let j = fit.linear.j.row(k);
            let constant = j.iter().zip(&adjoints.constant).map(|(j, bar)| j * bar);
            fit.x[k] * constant.sum::<f64>() + j.dot(&adjoints.linear.row(k))
        });
        Slope {
            other: pieces.of_other(&adjoints),
            ln_site: adjoints.ln_site,
            ln_noise: adjoints.ln_noise,
            ln_unit: of_units.sum(),
        }
    }
}

impl<'a> Pieces<'a> {
    fn new(engine: &'a Engine, fit: &'a LaplaceFit) -> Self {
        let whole = |(r, row): (usize, &RowAt)| {
            let own = &fit.locals[row.first..][..row.n];
            engine.model.row_whole_curvature(row.id, &engine.measured[r], own, &fit.noise[r])
        };
        let System { factor, coupling, .. } = &fit.system;
        let mut pieces = Self {
            engine,
            fit,
            tau: fit.outer.ln_site.exp(),
            rows: engine.rows.iter().enumerate().map(whole).collect(),
            solved: factor.solve(&fit.linear.j),
            solved_sites: factor.solve(&DMatrix::from_columns(coupling)),
            bends: vec![],
            shift: (DVector::zeros(0), vec![]),
        };
        pieces.bends = (0..engine.rows.len()).map(|r| pieces.bend(r)).collect();
        pieces.shift = pieces.shift();
        pieces
    }

    /// `A_r` H⁻¹: a row's scalars and the unknowns, `(n, unknowns)`; and the random effect of its site, `(n)`.
    fn covariance(&self, r: usize) -> (DMatrix<f64>, DVector<f64>) {
        let (row, fit) = (&self.engine.rows[r], self.fit);
        let (d, coupling) = (fit.system.precision[row.site], &fit.system.coupling[row.site]);
        let mut x = self.solved.columns(row.first, row.n).transpose();
        let of_site = self.solved_sites.column(row.site).transpose();
        let mut observable = x.row_mut(row.observable);
        observable -= of_site * (self.tau / d);
        let mut z = DVector::from_fn(row.n, |l, _| -x.row(l).transpose().dot(coupling) / d);
        z[row.observable] += self.tau / d;
        (x, z)
    }

    /// V of a row.
    fn spread(&self, r: usize) -> DMatrix<f64> {
        let (row, (x, z)) = (&self.engine.rows[r], self.covariance(r));
        let mut spread = &x * self.fit.linear.j.columns(row.first, row.n);
        let mut observable = spread.column_mut(row.observable);
        observable.axpy(self.tau, &z, 1.0);
        0.5 * (&spread + spread.transpose())
    }

    /// As [`Self::spread`], of the Hessian before its positive part was taken away.
    fn whole_spread(&self, r: usize) -> DMatrix<f64> {
        let (row, mut spread) = (&self.engine.rows[r], self.spread(r));
        let moved = self.fit.linear.moved(row);
        let Some(clipped) = Clipped::of(&self.hessian(r), row.n, &moved) else { return spread };
        let own = spread.select_rows(&moved).select_columns(&moved);
        let carried = clipped.carried(&own);
        for (a, to) in moved.iter().enumerate() {
            for (b, from) in moved.iter().enumerate() {
                spread[(*to, *from)] = carried[(a, b)];
            }
        }
        spread
    }

    /// The Hessian of a row in its scalars, `(n, n)`, with its positive part.
    fn hessian(&self, r: usize) -> Vec<f64> {
        let n = self.engine.rows[r].n;
        let rows = self.rows[r].hessian.chunks_exact(n + 1).take(n);
        rows.flat_map(|row| row[..n].to_vec()).collect()
    }

    /// q of a row and, last, half of how tr(V h) grows with the variance.
    fn bend(&self, r: usize) -> Vec<f64> {
        let (engine, row, noise) = (self.engine, &self.engine.rows[r], &self.fit.noise[r]);
        let spread = self.whole_spread(r);
        let own = &self.fit.locals[row.first..][..row.n];
        let eigen = nalgebra::SymmetricEigen::new(spread);
        let mut sum = vec![0.0; row.n + 1];
        for (value, vector) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
            if value.abs() <= 1e-14 * eigen.eigenvalues.amax() {
                continue;
            }
            let direction: Vec<f64> = vector.iter().copied().collect();
            let bend = engine.model.row_bend(row.id, &engine.measured[r], own, &direction, noise);
            sum.iter_mut().zip(bend).for_each(|(sum, bend)| *sum += 0.5 * value * bend);
        }
        sum
    }

    /// s.
    fn shift(&self) -> (DVector<f64>, Vec<f64>) {
        let (engine, fit) = (self.engine, self.fit);
        let mut of_x = DVector::zeros(fit.x.len());
        let mut of_z = vec![0.0; engine.sites.len()];
        for (row, bend) in engine.rows.iter().zip(&self.bends) {
            for (l, q) in bend[..row.n].iter().enumerate() {
                of_x.axpy(*q, &fit.linear.j.column(row.first + l), 1.0);
            }
            of_z[row.site] += self.tau * bend[row.observable];
        }
        // the mode moves as the whole Hessian says; at a mode to rounding it may be singular
        let hessians: Vec<Vec<f64>> = (0..engine.rows.len()).map(|r| self.hessian(r)).collect();
        let hessians = hessians.iter().map(Vec::as_slice);
        let whole = System::new(engine, &fit.linear, self.tau, hessians);
        whole.as_ref().unwrap_or(&fit.system).solve(of_x, &of_z)
    }

    fn adjoints(&self) -> Adjoints {
        let (engine, fit) = (self.engine, self.fit);
        let (shift_x, shift_z) = &self.shift;
        let n = fit.x.len();
        let mut all = Adjoints {
            constant: vec![0.0; engine.n_locals],
            linear: DMatrix::zeros(n, engine.n_locals),
            ln_site: 0.0,
            ln_noise: 0.0,
        };
        for (r, row) in engine.rows.iter().enumerate() {
            let (whole, bend) = (&self.rows[r], &self.bends[r]);
            let n_whole = row.n + 1;
            let mut shift =
                DVector::from_fn(row.n, |l, _| fit.linear.j.column(row.first + l).dot(shift_x));
            shift[row.observable] += self.tau * shift_z[row.site];
            // of number l, the variance being the last
            let constant = |l: usize| {
                let turned = (0..row.n).map(|m| whole.hessian[l * n_whole + m] * shift[m]);
                whole.gradient[l] + bend[l] + turned.sum::<f64>()
            };
            let (x, z) = self.covariance(r);
            let clipped = DMatrix::from_row_slice(row.n, row.n, &fit.curvatures[r].hessian);
            let gradient = DVector::from_column_slice(&whole.gradient[..row.n]);
            let mut linear = (&clipped * x).transpose();
            linear.ger(1.0, shift_x, &gradient, 1.0);
            let mut of_site = &clipped * z;
            for l in 0..row.n {
                all.constant[row.first + l] = constant(l);
            }
            of_site.axpy(shift_z[row.site], &gradient, 1.0);
            all.linear.columns_mut(row.first, row.n).copy_from(&linear);
            let l = row.observable;
            all.ln_site += self.tau * (constant(l) * fit.z[row.site] + of_site[l]);
            all.ln_noise += 2.0 * fit.noise[r].variance * constant(row.n);
        }
        all
    }

    /// The gradient in the model's other unknowns.
    fn of_other(&self, adjoints: &Adjoints) -> Vec<f64> {
        let (engine, fit) = (self.engine, self.fit);
        let (split, model) = (&engine.split, &engine.model);
        if split.other.is_empty() {
            return vec![];
        }
        let ids: Vec<RowId> = engine.rows.iter().map(|row| row.id).collect();
        let n_linear = split.linear.len();
        let other = |all: &[f64]| -> DVector<f64> {
            DVector::from_iterator(split.other.len(), split.other.iter().map(|at| all[*at]))
        };
        let u = engine.unknowns(&fit.outer.other, &fit.x);
        let mut prior = vec![0.0; u.len()];
        model.ln_prior(&mut model.tape(), &u, &mut prior);
        let mut direction = vec![0.0; u.len()];
        for (at, shift) in split.linear.iter().zip(self.shift.0.iter()) {
            direction[*at] = *shift;
        }
        let mut sum = other(&prior) + other(&model.prior_times(&u, &direction));
        sum += other(&model.locals_pulled(&u, &ids, &adjoints.constant));
        // the scalars are linear in each unknown: their slope in it is what a unit of it adds
        let mut at = engine.unknowns(&fit.outer.other, &DVector::zeros(n_linear));
        let of_all: Vec<f64> =
            adjoints.linear.rows(0, n_linear).row_sum().iter().copied().collect();
        sum -= other(&model.locals_pulled(&at, &ids, &of_all));
        for (k, place) in split.linear.iter().enumerate() {
            let own: Vec<f64> = adjoints.linear.row(k).iter().copied().collect();
            at[*place] = 1.0;
            sum += other(&model.locals_pulled(&at, &ids, &own));
            at[*place] = 0.0;
        }
        sum += self.of_prior_curvature();
        sum.iter().copied().collect()
    }

    /// −½ tr(H⁻¹ ∂P/∂other). The curvature of the prior is exact. How it changes is computed by
    /// differences, which need no fit, and only if the prior of a linear unknown depends on other
    /// unknowns.
    fn of_prior_curvature(&self) -> DVector<f64> {
        const STEP: f64 = 1e-4;
        let (engine, fit) = (self.engine, self.fit);
        let mut other = fit.outer.other.clone();
        let n_linear = engine.split.linear.len();
        if !engine.model.curvature_varies(&engine.split) {
            return DVector::zeros(other.len());
        }
        let inverse = fit.system.factor.inverse();
        let inverse = inverse.view((0, 0), (n_linear, n_linear));
        let one = |i: usize, _: usize| {
            let centre = other[i];
            let mut trace = |at: f64| {
                other[i] = at;
                inverse.dot(&engine.prior_curvature(&other, &fit.x))
            };
            let change = trace(centre + STEP) - trace(centre - STEP);
            other[i] = centre;
            -0.5 * change / (2.0 * STEP)
        };
        let n = fit.outer.other.len();
        DVector::from_fn(n, one)
    }
}

#[cfg(test)]
#[path = "slope_tests.rs"]
mod tests;
