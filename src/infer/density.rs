//! What every algorithm of this room asks of a density.

/// A log density over `R^dim`, up to a constant.
pub trait LogDensity: Sync {
    /// Number of unconstrained unknowns.
    fn dim(&self) -> usize;
    /// A function object with its own scratch memory, one per thread.
    fn evaluator(&self) -> Box<dyn Evaluator + '_>;
}

/// Evaluates a [`LogDensity`]; holds scratch memory, so that an evaluation allocates nothing.
pub trait Evaluator: Send {
    /// Log density at `position`; writes its gradient. Out of support: −∞ (never a panic).
    fn ln_density(&mut self, position: &[f64], gradient: &mut [f64]) -> f64;
}

impl<E: Evaluator + ?Sized> Evaluator for Box<E> {
    fn ln_density(&mut self, position: &[f64], gradient: &mut [f64]) -> f64 {
        (**self).ln_density(position, gradient)
    }
}
