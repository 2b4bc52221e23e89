//! Moves of what multiplies coordinates, the scales of fields, in which the coordinates move as well.
//!
//! What the Hessians at some places say (see [`Curvature`]) is a normal likelihood of the coordinates. With it their
//! posterior given the scales s is normal, N(μ(s), P(s)⁻¹). A move takes s to s′ and leaves z, the coordinates in
//! units of that normal:
//!
//! ```text
//! η = μ(s) + L(s)⁻ᵀ z,  P = L Lᵀ        accepted with  min(1, π(s′, η′) |L(s)| / (π(s, η) |L(s′)|))
//! ```
//! So coordinates that measurements tell stay where they are, and those that they do not tell follow the scales. With the
//! density's own π in the ratio this is exact, however poor the normal is. A move costs one evaluation, without gradient.

use super::cholesky::Factor;
use super::curvature::Curvature;
use super::density::Evaluator;
use super::hamiltonian::PhasePoint;
use faer::Mat;
use rand::{Rng, RngExt as _};
use rand_distr::StandardNormal;

/// Standard deviations of the steps of each scale.
const STEPS: [f64; 2] = [0.2, 0.6];

/// Moves each scale some times, from the position of `point`, which it keeps up to date with its log density. Returns
/// how often it evaluated the density.
pub(super) fn move_scales(
    curvature: &Curvature,
    evaluator: &mut dyn Evaluator,
    point: &mut PhasePoint,
    rng: &mut impl Rng,
) -> u64 {
    moves(curvature, evaluator, point, rng, 1.0)
}

/// `volume` is 1, and something else in a test that must fail.
fn moves(
    curvature: &Curvature,
    evaluator: &mut dyn Evaluator,
    point: &mut PhasePoint,
    rng: &mut impl Rng,
    volume: f64,
) -> u64 {
    let scales = curvature.still();
    let Some(mut here) = Normal::at(curvature, evaluator, &point.position) else { return 0 };
    if scales.is_empty() || here.free.is_empty() {
        return 0;
    }
    let z = here.whitened(&point.position);
    let mut position = point.position.clone();
    let mut n = 0;
    for (scale, step) in scales.iter().flat_map(|scale| STEPS.map(|step| (*scale, step))) {
        position.copy_from_slice(&point.position);
        position[scale] += step * rng.sample::<f64, _>(StandardNormal);
        let uniform = rng.random::<f64>();
        let there = Normal::at(curvature, evaluator, &position);
        let Some(there) = there.filter(|there| there.free == here.free) else { continue };
        there.place(&z, &mut position);
        let ln_density = evaluator.value(&position);
        n += 1;
        let ln_volume = volume * (here.precision.ln_det() - there.precision.ln_det());
        // NaN is not accepted
        if uniform.ln() < ln_density - point.ln_density + ln_volume {
            point.position.copy_from_slice(&position);
            point.ln_density = ln_density;
            here = there;
        }
    }
    n
}

/// The coordinates that are multiplied, given all others, under the normal likelihood.
struct Normal {
    /// Which they are.
    free: Vec<usize>,
    mean: Vec<f64>,
    /// L
    precision: Factor,
}

impl Normal {
    /// `None` where the likelihood's information is no normal's.
    fn at(curvature: &Curvature, evaluator: &mut dyn Evaluator, position: &[f64]) -> Option<Self> {
        let c = evaluator.multipliers(position);
        let free: Vec<usize> = (0..c.len()).filter(|i| c[*i] != 0.0).collect();
        let others: Vec<usize> =
            (0..c.len()).filter(|i| c[*i] == 0.0 && !curvature.still().contains(i)).collect();
        let information = |i: usize, j: usize| curvature.information(i, j);
        let n = free.len();
        let precision = Mat::from_fn(n, n, |a, b| {
            let (i, j) = (free[a], free[b]);
            c[i] * c[j] * information(i, j) + f64::from(u8::from(a == b))
        });
        let precision = Factor::of(precision.as_ref())?;
        let pull = |i: &usize| {
            let told: f64 = others.iter().map(|j| information(*i, *j) * position[*j]).sum();
            c[*i] * (curvature.slope(*i) - told)
        };
        let mut mean: Vec<f64> = free.iter().map(pull).collect();
        precision.solve(&mut mean);
        precision.solve_transposed(&mut mean);
        Some(Self { free, mean, precision })
    }

    /// z at a position.
    fn whitened(&self, position: &[f64]) -> Vec<f64> {
        let off: Vec<f64> =
            self.free.iter().zip(&self.mean).map(|(i, mean)| position[*i] - mean).collect();
        self.precision.whitened(&off)
    }

    /// Writes the coordinates at this z.
    fn place(&self, z: &[f64], position: &mut [f64]) {
        let mut x = z.to_vec();
        self.precision.solve_transposed(&mut x);
        for ((i, x), mean) in self.free.iter().zip(x).zip(&self.mean) {
            position[*i] = mean + x;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::Moments;
    use rand::SeedableRng as _;
    use rand_chacha::ChaCha8Rng;

    /// t + t³/10 of t = exp(s) (a + 2 b) was measured as 1 with an error of 0.3, and exp(s) a as d − 0.5 with one of 1; s has an sd of 0.5, the
    /// others of 1.
    struct Bent;

    impl Evaluator for Bent {
        fn ln_density(&mut self, q: &[f64], g: &mut [f64]) -> f64 {
            let [s, a, b, d] = [q[0], q[1], q[2], q[3]];
            let sum = s.exp() * (a + 2.0 * b);
            let seen = sum + 0.1 * sum.powi(3);
            let force = -(seen - 1.0) / 0.09 * (1.0 + 0.3 * sum * sum);
            let off = d - 0.5 - s.exp() * a;
            g.copy_from_slice(&[
                force * sum + off * s.exp() * a - 4.0 * s,
                force * s.exp() + off * s.exp() - a,
                2.0 * force * s.exp() - b,
                -off - d,
            ]);
            -0.5 * ((seen - 1.0).powi(2) / 0.09 + off * off + 4.0 * s * s + a * a + b * b + d * d)
        }
        fn multipliers(&mut self, q: &[f64]) -> Vec<f64> {
            vec![0.0, q[0].exp(), q[0].exp(), 0.0]
        }
    }

    /// Largest z of the changes of moments over draws of the density itself, and the share of moves that led elsewhere.
    fn worst(volume: f64) -> (f64, f64) {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let curvature = Curvature::at(&mut Bent, &[0.2, 0.3, 0.2, 0.6], &[0]);
        let mut changes = Moments::new(8);
        let (mut moved, mut point) = (0.0, PhasePoint::new(4));
        for _ in 0..20_000 {
            // from the prior, by rejection
            loop {
                let sds = [0.5, 1.0, 1.0, 1.0];
                for (q, sd) in point.position.iter_mut().zip(sds) {
                    *q = sd * rng.sample::<f64, _>(StandardNormal);
                }
                let q = &point.position;
                let prior = -0.5 * (4.0 * q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
                point.ln_density = Bent.ln_density(q, &mut point.gradient);
                if rng.random::<f64>().ln() < point.ln_density - prior {
                    break;
                }
            }
            let before = point.position.clone();
            moves(&curvature, &mut Bent, &mut point, &mut rng, volume);
            moved += f64::from(u8::from(point.position[0].to_bits() != before[0].to_bits()));
            let pairs = || point.position.iter().zip(&before);
            changes.add(pairs().map(|(a, b)| a - b).chain(pairs().map(|(a, b)| a * a - b * b)));
        }
        let n: f64 = 20_000.0;
        let z =
            |(mean, sd): (&f64, &f64)| if *sd > 0.0 { (mean / (sd / n.sqrt())).abs() } else { 0.0 };
        (changes.means().iter().zip(&changes.sds()).map(z).fold(0.0, f64::max), moved / n)
    }

    /// Within √(2 ln(8/0.001)): eight moments, 0.1 % in all. The volume left out, draws are off.
    #[test]
    fn the_moves_leave_the_density_as_it_is() {
        let ((right, moved), (wrong, _)) = (worst(1.0), worst(0.0));
        assert!(right < 4.24 && wrong > 9.0 && moved > 0.5, "{right} {wrong} {moved}");
    }
}
