//! What every algorithm of this room asks of a density.

use rand::Rng;

/// A log density over `R^dim`, up to a constant.
pub trait LogDensity: Sync {
    /// Number of unconstrained unknowns.
    fn dim(&self) -> usize;
    /// A function object with its own scratch memory, one per thread.
    fn evaluator(&self) -> Box<dyn Evaluator + '_>;
    /// `None` for most densities. Where a gradient costs so much that a warm-up cannot learn a metric from draws,
    /// the unknowns that [`Evaluator::interweave`] moves. NUTS then moves the others alone, with the metric
    /// of the Hessian.
    fn interwoven(&self) -> Option<Vec<usize>> {
        None
    }
    /// Unknowns that stay where they are until there are draws. A climb would shrink the scale of a field that others can
    /// stand for, and a chain would stay there.
    fn unclimbed(&self) -> Vec<usize> {
        self.interwoven().unwrap_or_default()
    }
    /// Told draws of all chains, each `(dim)`, at most twice in a warm-up. A density that approximates another one may from then on be
    /// nearer to it where they are. Returns whether it has changed: evaluators that were made before are of no use then.
    fn draw_near(&self, _draws: &[Vec<f64>]) -> bool {
        false
    }
}

/// Evaluates a [`LogDensity`]; holds scratch memory, so that an evaluation allocates nothing.
pub trait Evaluator: Send {
    /// Log density at `position`; writes its gradient. Out of support: −∞ (never a panic).
    fn ln_density(&mut self, position: &[f64], gradient: &mut [f64]) -> f64;

    /// Log density at `position` alone: the same number, for less where the gradient costs more.
    fn value(&mut self, position: &[f64]) -> f64 {
        self.ln_density(position, &mut vec![0.0; position.len()])
    }

    /// Log density of all unknowns, where [`Evaluator::ln_density`], which is `ln_density` here, leaves out some: those that it
    /// integrates out.
    fn ln_whole(&mut self, _position: &[f64], ln_density: f64) -> f64 {
        ln_density
    }

    /// Moves `position` without evaluating what is costly. The moves leave the density as it is, and change the
    /// unknowns of [`LogDensity::interwoven`], with others that depend on them. Returns the log density there and writes its
    /// gradient, if it knows them.
    fn interweave(
        &mut self,
        _position: &mut [f64],
        _gradient: &mut [f64],
        _rng: &mut dyn Rng,
    ) -> Option<f64> {
        None
    }

    /// What each unknown is multiplied by, of those that [`Evaluator::interweave`] changes for the sake of others; 0
    /// for the rest, (dim). Their prior is standard normal.
    fn multipliers(&mut self, position: &[f64]) -> Vec<f64> {
        vec![0.0; position.len()]
    }

    /// The part of the log density that costs little, where [`Evaluator::multipliers`] are told of: all but what
    /// measurements say.
    fn ln_prior(&mut self, _position: &[f64]) -> f64 {
        0.0
    }

    /// Calls `take` with each column of the Hessian at `position`, `(dim)`, in order.
    ///
    /// If a density does not have second derivatives of its own, these are central differences of
    /// the gradient. They are NaN next to a point without support.
    fn hessian(&mut self, position: &[f64], take: &mut dyn FnMut(usize, &[f64])) {
        let (mut moved, zeros) = (position.to_vec(), vec![0.0; position.len()]);
        let (mut ends, mut column) = ([zeros.clone(), zeros.clone()], zeros);
        for (i, x) in position.iter().enumerate() {
            let step = 1e-5 * x.abs().max(1.0);
            let mut is_inside = true;
            for (end, side) in ends.iter_mut().zip([-1.0, 1.0]) {
                moved[i] = x + side * step;
                is_inside &= self.ln_density(&moved, end).is_finite();
            }
            moved[i] = *x;
            for (j, h) in column.iter_mut().enumerate() {
                let slope = (ends[1][j] - ends[0][j]) / (2.0 * step);
                *h = if is_inside { slope } else { f64::NAN };
            }
            take(i, &column);
        }
    }
}

impl<E: Evaluator + ?Sized> Evaluator for Box<E> {
    fn interweave(
        &mut self,
        position: &mut [f64],
        gradient: &mut [f64],
        rng: &mut dyn Rng,
    ) -> Option<f64> {
        (**self).interweave(position, gradient, rng)
    }
    fn ln_whole(&mut self, position: &[f64], ln_density: f64) -> f64 {
        (**self).ln_whole(position, ln_density)
    }
    fn multipliers(&mut self, position: &[f64]) -> Vec<f64> {
        (**self).multipliers(position)
    }
    fn ln_prior(&mut self, position: &[f64]) -> f64 {
        (**self).ln_prior(position)
    }
    fn ln_density(&mut self, position: &[f64], gradient: &mut [f64]) -> f64 {
        (**self).ln_density(position, gradient)
    }
    fn value(&mut self, position: &[f64]) -> f64 {
        (**self).value(position)
    }
    fn hessian(&mut self, position: &[f64], take: &mut dyn FnMut(usize, &[f64])) {
        (**self).hessian(position, take);
    }
}
