//! Newton's iteration to the mode of a Laplace fit.
//!
//! Random effects touch only their own site, so that they are eliminated one by one.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, SymmetricEigen};

use super::engine::{Engine, Outer};
use super::fit::Linear;
use crate::model::{Curvature, Noise, Tape};

const MAX_STEPS: usize = 60;
/// Gradient times step, twice what a step can gain, below which a point is the mode.
const SMALL: f64 = 1e-7;

/// What is climbed.
pub(super) struct Newton<'a> {
    pub(super) engine: &'a Engine,
    pub(super) outer: &'a Outer,
    pub(super) linear: &'a Linear,
    /// What spreads each row beyond its likelihood.
    pub(super) noise: &'a [Noise],
    /// Rows that are not seen, ascending.
    pub(super) hidden: &'a [usize],
}

/// What the iteration knows at a point.
pub(super) struct Point {
    pub(super) x: DVector<f64>,
    pub(super) z: Vec<f64>,
    pub(super) locals: Vec<f64>,
    pub(super) curvatures: Vec<Curvature>,
    pub(super) gradient: DVector<f64>,
    pub(super) value: f64,
}

/// The linear system of a step: minus the Hessian, sites eliminated.
pub(super) struct System {
    pub(super) factor: Cholesky<f64, Dyn>,
    /// Precision of each site's effect, and its coupling to x.
    pub(super) precision: Vec<f64>,
    pub(super) coupling: Vec<DVector<f64>>,
    /// Gradient in the sites' effects.
    slope: Vec<f64>,
}

impl Newton<'_> {
    /// The mode from a start, and the system there; `None` where there is none.
    pub(super) fn climb(
        &self,
        t: &mut Tape,
        x: DVector<f64>,
        z: Vec<f64>,
    ) -> Option<(Point, System)> {
        let mut point = self.point(t, x, z)?;
        for _ in 0..MAX_STEPS {
            let system = self.system(&point)?;
            let (dx, dz) = system.step(&point);
            let slopes = system.slope.iter().zip(&dz).map(|(slope, dz)| slope * dz).sum::<f64>();
            if dx.dot(&point.gradient) + slopes < SMALL {
                return Some((point, system));
            }
            let Some(next) = self.search(t, &point, &dx, &dz) else {
                return Some((point, system));
            };
            point = next;
        }
        let system = self.system(&point)?;
        Some((point, system))
    }

    fn point(&self, t: &mut Tape, x: DVector<f64>, z: Vec<f64>) -> Option<Point> {
        let Self { engine, outer, linear, noise, .. } = *self;
        let tau = outer.ln_site.exp();
        let n_linear = engine.split.linear.len();
        let u = engine.unknowns(&outer.other, &x);
        let mut prior = vec![0.0; u.len()];
        let mut value = engine.model.ln_prior(t, &u, &mut prior);
        let mut gradient = DVector::zeros(linear.n());
        for (g, at) in gradient.iter_mut().zip(&engine.split.linear) {
            *g = prior[*at];
        }
        for k in n_linear..linear.n() {
            value -= 0.5 * x[k] * x[k];
            gradient[k] = -x[k];
        }
        value -= 0.5 * z.iter().map(|z| z * z).sum::<f64>();
        let mut locals = linear.constant.clone();
        for (l, local) in locals.iter_mut().enumerate() {
            *local += linear.row(l).iter().zip(x.iter()).map(|(j, x)| j * x).sum::<f64>();
        }
        let mut curvatures = Vec::with_capacity(engine.rows.len());
        let mut moved = vec![];
        for (r, row) in engine.rows.iter().enumerate() {
            locals[row.first + row.observable] += tau * z[row.site];
            if self.hidden.binary_search(&r).is_ok() {
                let (gradient, hessian) = (vec![0.0; row.n], vec![0.0; row.n * row.n]);
                curvatures.push(Curvature { value: 0.0, gradient, hessian });
                continue;
            }
            let own = &locals[row.first..][..row.n];
            // nothing that is integrated moves the others, a noise for instance
            let is_moved = |l: &usize| linear.row(row.first + l).iter().any(|j| *j != 0.0);
            moved.clear();
            moved.extend((0..row.n).filter(|l| *l == row.observable || is_moved(l)));
            let mut c =
                engine.model.row_curvature(row.id, &engine.measured[r], own, &moved, &noise[r]);
            value += c.value;
            clip(&mut c.hessian, row.n, &moved);
            for (l, g) in c.gradient.iter().enumerate() {
                for (to, j) in gradient.iter_mut().zip(linear.row(row.first + l)) {
                    *to += g * j;
                }
            }
            curvatures.push(c);
        }
        value.is_finite().then_some(Point { x, z, locals, curvatures, gradient, value })
    }

    /// The first point along a step that is higher.
    fn search(&self, t: &mut Tape, point: &Point, dx: &DVector<f64>, dz: &[f64]) -> Option<Point> {
        let mut length = 1.0;
        for _ in 0..12 {
            let x = &point.x + dx * length;
            let z = point.z.iter().zip(dz).map(|(z, d)| z + length * d).collect();
            if let Some(next) = self.point(t, x, z).filter(|n| n.value > point.value) {
                return Some(next);
            }
            length *= 0.4;
        }
        None
    }

    /// Minus the Hessian at a point, sites eliminated.
    fn system(&self, point: &Point) -> Option<System> {
        let Self { engine, linear, .. } = *self;
        let (n, tau) = (linear.n(), self.outer.ln_site.exp());
        let mut precision = vec![1.0; engine.sites.len()];
        let mut coupling = vec![DVector::zeros(n); engine.sites.len()];
        let mut slope: Vec<f64> = point.z.iter().map(|z| -z).collect();
        // K J: minus each row's Hessian times its rows of J
        let j = linear.j.select_columns(&linear.used);
        let mut kj = DMatrix::zeros(n, j.ncols());
        let mut first = 0;
        for (row, c) in engine.rows.iter().zip(&point.curvatures) {
            let is_own = |l: &&usize| **l < row.first + row.n;
            let end = first + linear.used[first..].iter().take_while(is_own).count();
            let hessian = |l: usize, b: usize| c.hessian[l * row.n + linear.used[b] - row.first];
            for a in first..end {
                let mut own = kj.column_mut(a);
                for b in first..end {
                    own.axpy(-hessian(linear.used[a] - row.first, b), &j.column(b), 1.0);
                }
            }
            let l = row.observable;
            precision[row.site] -= tau * tau * c.hessian[l * row.n + l];
            slope[row.site] += tau * c.gradient[l];
            for b in first..end {
                coupling[row.site].axpy(-tau * hessian(l, b), &j.column(b), 1.0);
            }
            first = end;
        }
        let mut s = &j * kj.transpose();
        let n_prior = linear.prior.nrows();
        let mut own = s.view_mut((0, 0), (n_prior, n_prior));
        own += &linear.prior;
        for k in n_prior..n {
            s[(k, k)] += 1.0;
        }
        for (b, d) in coupling.iter().zip(&precision) {
            s.ger(-1.0 / d, b, b, 1.0);
        }
        let factor = Cholesky::new(s)?;
        Some(System { factor, precision, coupling, slope })
    }
}

impl System {
    fn step(&self, point: &Point) -> (DVector<f64>, Vec<f64>) {
        let mut right = point.gradient.clone();
        for ((b, d), g) in self.coupling.iter().zip(&self.precision).zip(&self.slope) {
            right.axpy(-g / d, b, 1.0);
        }
        let dx = self.factor.solve(&right);
        let dz = self.coupling.iter().zip(&self.precision).zip(&self.slope);
        let dz = dz.map(|((b, d), g)| (g - b.dot(&dx)) / d).collect();
        (dx, dz)
    }
}

/// Takes the positive part of a Hessian `(n, n)` in the scalars numbered `of` away: what is left is negative
/// semidefinite.
fn clip(hessian: &mut [f64], n: usize, of: &[usize]) {
    let at = |a: usize, b: usize| of[a] * n + of[b];
    if of.len() == 1 && hessian[at(0, 0)] <= 0.0 {
        return;
    }
    let matrix = DMatrix::from_fn(of.len(), of.len(), |a, b| hessian[at(a, b)]);
    if Cholesky::new(-&matrix).is_some() {
        return;
    }
    let mut eigen = SymmetricEigen::new(matrix);
    eigen.eigenvalues.apply(|e| *e = e.min(0.0));
    let clipped = eigen.recompose();
    for (a, b) in (0..of.len()).flat_map(|a| (0..of.len()).map(move |b| (a, b))) {
        hessian[at(a, b)] = clipped[(a, b)];
    }
}
