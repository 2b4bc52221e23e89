//! Newton's iteration to the mode of a Laplace fit.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, SymmetricEigen};

use super::engine::{Engine, Outer};
use super::system::{Linear, System};
use crate::model::{Curvature, Noise, Tape};

const MAX_STEPS: usize = 60;
/// A point is the mode if gradient times step is below this. That product is twice what a step can
/// gain.
const SMALL: f64 = 1e-9;

/// The log density that is climbed.
pub(super) struct Newton<'a> {
    pub(super) engine: &'a Engine,
    pub(super) outer: &'a Outer,
    pub(super) linear: &'a Linear,
    /// The further errors of each row, beyond its likelihood.
    pub(super) noise: &'a [Noise],
    /// Rows that are not seen, ascending.
    pub(super) hidden: &'a [usize],
}

/// What is computed at a point.
pub(super) struct Point {
    pub(super) x: DVector<f64>,
    pub(super) z: Vec<f64>,
    pub(super) locals: Vec<f64>,
    pub(super) curvatures: Vec<Curvature>,
    pub(super) gradient: DVector<f64>,
    pub(super) value: f64,
}

impl Newton<'_> {
    /// The mode that is reached from a start, and the linear system there. `None` if there is no
    /// mode.
    pub(super) fn climb(
        &self,
        t: &mut Tape,
        x: DVector<f64>,
        z: Vec<f64>,
    ) -> Option<(Point, System)> {
        let mut point = self.point(t, x, z)?;
        for _ in 0..MAX_STEPS {
            let system = self.system(&point)?;
            let slope = self.slope(&point);
            let (dx, dz) = system.solve(point.gradient.clone(), &slope);
            let slopes = slope.iter().zip(&dz).map(|(slope, dz)| slope * dz).sum::<f64>();
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
        for (r, row) in engine.rows.iter().enumerate() {
            locals[row.first + row.observable] += tau * z[row.site];
            if self.hidden.binary_search(&r).is_ok() {
                let (gradient, hessian) = (vec![0.0; row.n], vec![0.0; row.n * row.n]);
                curvatures.push(Curvature { value: 0.0, gradient, hessian });
                continue;
            }
            let own = &locals[row.first..][..row.n];
            let moved = linear.moved(row);
            let mut c =
                engine.model.row_curvature(row.id, &engine.measured[r], own, &moved, &noise[r]);
            value += c.value;
            if let Some(clipped) = Clipped::of(&c.hessian, row.n, &moved) {
                clipped.write(&mut c.hessian, row.n, &moved);
            }
            for (l, g) in c.gradient.iter().enumerate() {
                for (to, j) in gradient.iter_mut().zip(linear.row(row.first + l)) {
                    *to += g * j;
                }
            }
            curvatures.push(c);
        }
        value.is_finite().then_some(Point { x, z, locals, curvatures, gradient, value })
    }

    /// Shortens the step until its end is higher. Gives that point.
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

    /// Minus the Hessian at a point.
    fn system(&self, point: &Point) -> Option<System> {
        let hessians = point.curvatures.iter().map(|c| c.hessian.as_slice());
        System::new(self.engine, self.linear, self.outer.ln_site.exp(), hessians)
    }

    /// Gradient in the sites' effects.
    fn slope(&self, point: &Point) -> Vec<f64> {
        let tau = self.outer.ln_site.exp();
        let mut slope: Vec<f64> = point.z.iter().map(|z| -z).collect();
        for (row, c) in self.engine.rows.iter().zip(&point.curvatures) {
            slope[row.site] += tau * c.gradient[row.observable];
        }
        slope
    }
}

/// A Hessian with positive eigenvalues. If these are set to 0, what is left is negative
/// semidefinite.
pub(super) struct Clipped(SymmetricEigen<f64, Dyn>);

impl Clipped {
    /// From a Hessian `(n, n)` in the scalars numbered `of`. `None` if nothing is positive.
    pub(super) fn of(hessian: &[f64], n: usize, of: &[usize]) -> Option<Self> {
        let at = |a: usize, b: usize| hessian[of[a] * n + of[b]];
        if of.len() == 1 && at(0, 0) <= 0.0 {
            return None;
        }
        let matrix = DMatrix::from_fn(of.len(), of.len(), at);
        let is_definite = Cholesky::new(-&matrix).is_some();
        (!is_definite).then(|| Self(SymmetricEigen::new(matrix)))
    }

    /// Writes what is left without its positive part into the Hessian.
    fn write(mut self, hessian: &mut [f64], n: usize, of: &[usize]) {
        self.0.eigenvalues.apply(|e| *e = e.min(0.0));
        let left = self.0.recompose();
        for (a, b) in (0..of.len()).flat_map(|a| (0..of.len()).map(move |b| (a, b))) {
            hessian[of[a] * n + of[b]] = left[(a, b)];
        }
    }

    /// The adjoint of the Hessian, if `bar` is the adjoint of what is left of it (Daleckii and
    /// Krein).
    pub(super) fn carried(&self, bar: &DMatrix<f64>) -> DMatrix<f64> {
        let (values, vectors) = (&self.0.eigenvalues, &self.0.eigenvectors);
        let mut inner = vectors.transpose() * bar * vectors;
        for (i, a) in values.iter().enumerate() {
            for (j, b) in values.iter().enumerate() {
                inner[(i, j)] *= match (*a < 0.0, *b < 0.0) {
                    (true, true) => 1.0,
                    (false, false) => 0.0,
                    _ => a.min(*b) / (a.min(*b) - a.max(*b)),
                };
            }
        }
        vectors * inner * vectors.transpose()
    }
}
