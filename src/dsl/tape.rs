//! The scratch memory of one evaluation, and the operations that a model is a list of.

use rand::Rng;

use crate::dist::Gaussian;

/// The memory of one evaluation; one per thread.
#[derive(Clone, Debug)]
pub struct Tape {
    /// Unconstrained unknowns.
    pub(super) u: Vec<f64>,
    /// Adjoint of `u`.
    pub(super) gu: Vec<f64>,
    /// Values; `v[0]` is always zero.
    pub(super) v: Vec<f64>,
    /// Adjoint of `v`.
    pub(super) g: Vec<f64>,
    /// What an operation keeps from its forward pass for its backward pass.
    pub(super) work: Vec<f64>,
    /// Log density so far.
    pub(super) lp: f64,
}

/// One step between unknowns and log density.
pub(super) trait Op: Send + Sync + std::fmt::Debug {
    /// Computes values from unknowns and earlier values.
    fn forward(&self, _: &mut Tape) {}
    /// Sets unknowns to a typical value, and computes values from them.
    fn initial(&self, t: &mut Tape) {
        self.forward(t);
    }
    /// Draws its unknowns from their prior, and computes values from them; `None` if it cannot.
    fn draw(&self, _: &mut Tape, _: &mut dyn Rng) -> Option<()> {
        None
    }
    /// The prior of its one unknown at these values, if it is normal or flat.
    fn gaussian(&self, _: &[f64]) -> Option<Gaussian> {
        None
    }
    /// Adds this operation's log density, and carries adjoints from its values to what they came from.
    fn backward(&self, t: &mut Tape);
}

/// Eight partial sums, so that the compiler may use vector registers.
#[inline]
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let (a8, a_rest) = a.as_chunks::<8>();
    let (b8, b_rest) = b.as_chunks::<8>();
    let mut s = [0.0; 8];
    for (a, b) in a8.iter().zip(b8) {
        for i in 0..8 {
            s[i] += a[i] * b[i];
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    ((s[0] + s[4]) + (s[1] + s[5])) + ((s[2] + s[6]) + (s[3] + s[7])) + rest
}

/// `y += a x`
#[inline]
pub(super) fn axpy(a: f64, x: &[f64], y: &mut [f64]) {
    for (y, x) in y.iter_mut().zip(x) {
        *y += a * x;
    }
}
