//! Numbers that sum to zero.

use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

use super::{Sequence, Step};
use crate::dist::Support;
use crate::num::{LN_SQRT_2PI, Real};

family! {
    /// Normal numbers of standard deviation `sd`, given that they sum to zero. Use it for the
    /// deviations of groups from a common level that is a parameter of its own.
    ///
    /// ```text
    /// x ~ Normal(0, sd² (I − 1 1ᵀ/n)),   density of the n − 1 unknowns  Π Normal(uᵢ; 0, sd)
    /// ```
    /// Every number has the standard deviation `sd √(1 − 1/n)`. The transform is an isometry, `Σ
    /// xᵢ² = Σ uᵢ²`, and treats all numbers alike.
    ///
    /// # Source
    /// The density of Stan's `sum_to_zero_vector` with a `normal(0, sd)`, there not normalised: n
    /// factors 1/sd instead of n − 1
    SumToZero(sd: "standard deviation of each number before the condition");
}

/// `xᵢ = rest/(n − i) + √((n − 1 − i)/(n − i)) uᵢ`: the mean and the spread of a normal number
/// given those before it. `rest` is minus the sum of those before it.
fn spread(i: usize, n: usize) -> f64 {
    ((n - 1 - i) as f64 / (n - i) as f64).sqrt()
}

impl<D: Real> Sequence<D> for SumToZero<D> {
    fn support(&self) -> Support {
        Support::Described("sum 0")
    }
    fn n_unknowns(&self, n: usize) -> usize {
        n - 1
    }
    fn length(&self, n: usize) -> usize {
        n.max(2)
    }
    fn step(&self, i: usize, n: usize, u: D, carry: &mut [D]) -> Step<D> {
        let x = carry[0] * ((n - i) as f64).recip() + u * spread(i, n);
        carry[0] -= x;
        let z = u / self.sd;
        Step { x, ln_kernel: z * z * -0.5 }
    }
    fn unconstrain(&self, i: usize, n: usize, x: f64, carry: &[f64]) -> f64 {
        (x - carry[0] / (n - i) as f64) / spread(i, n)
    }
    fn ln_norm(&self, n: usize) -> D {
        (self.sd.ln() + LN_SQRT_2PI) * -((n - 1) as f64)
    }
    fn sample(&self, n: usize, rng: &mut dyn Rng) -> Option<Vec<f64>> {
        let sd = self.sd.re();
        let x: Vec<f64> = (0..n).map(|_| sd * rng.sample::<f64, _>(StandardNormal)).collect();
        let mean = x.iter().sum::<f64>() / n as f64;
        Some(x.iter().map(|x| x - mean).collect())
    }
}
