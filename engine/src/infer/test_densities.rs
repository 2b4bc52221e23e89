//! Small densities with known moments, for the tests of this folder.

use super::density::{Evaluator, LogDensity};

/// A density given by a function of (position, gradient).
pub(super) struct FnDensity<F> {
    pub(super) dim: usize,
    pub(super) f: F,
}

impl<F: Fn(&[f64], &mut [f64]) -> f64 + Sync> LogDensity for FnDensity<F> {
    fn dim(&self) -> usize {
        self.dim
    }

    fn evaluator(&self) -> Box<dyn Evaluator + '_> {
        Box::new(FnEvaluator(&self.f))
    }
}

struct FnEvaluator<'a, F>(&'a F);

impl<F: Fn(&[f64], &mut [f64]) -> f64 + Sync> Evaluator for FnEvaluator<'_, F> {
    fn ln_density(&mut self, position: &[f64], gradient: &mut [f64]) -> f64 {
        (self.0)(position, gradient)
    }
}

/// Independent normals with these standard deviations.
pub(super) fn normal(sd: Vec<f64>) -> impl LogDensity {
    let dim = sd.len();
    let f = move |q: &[f64], g: &mut [f64]| {
        let mut ln_density = 0.0;
        for ((q, g), sd) in q.iter().zip(g).zip(&sd) {
            let z = q / sd;
            *g = -z / sd;
            ln_density -= 0.5 * z * z;
        }
        ln_density
    };
    FnDensity { dim, f }
}

/// x ~ N(0, 1), y | x ~ N(x² − 1, ½): E y = 0, var y = 2 + ¼, E x²y = 2, cov(x, y) = 0.
pub(super) fn banana() -> impl LogDensity {
    let f = |q: &[f64], g: &mut [f64]| {
        let z = (q[1] - q[0] * q[0] + 1.0) / 0.5;
        g[1] = -z / 0.5;
        g[0] = -q[0] - 2.0 * q[0] * g[1];
        -0.5 * (q[0] * q[0] + z * z)
    };
    FnDensity { dim: 2, f }
}

/// Neal's funnel: v ~ N(0, 3), xᵢ | v ~ N(0, exp(v/2)).
pub(super) fn funnel(dim: usize) -> impl LogDensity {
    let f = move |q: &[f64], g: &mut [f64]| {
        let (v, precision) = (q[0], (-q[0]).exp());
        let sum: f64 = q[1..].iter().map(|x| x * x).sum();
        g[0] = -v / 9.0 - 0.5 * (q.len() - 1) as f64 + 0.5 * precision * sum;
        for (g, x) in g[1..].iter_mut().zip(&q[1..]) {
            *g = -precision * x;
        }
        -v * v / 18.0 - 0.5 * (q.len() - 1) as f64 * v - 0.5 * precision * sum
    };
    FnDensity { dim, f }
}
