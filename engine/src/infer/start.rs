//! Starting points: near an optimum, spread on the scale of the posterior.

use super::curvature::conditional_scales;
use super::density::{Evaluator, LogDensity};
use super::error::InferError;
use super::far_apart;
use super::optimise::{OptimumSettings, maximise};
use crate::random::Stream;
use rand::RngExt;
use rand_distr::StandardNormal;

/// Largest jitter per coordinate. Where the density is flatter than this, exploring it is left to
/// the sampler.
const LARGEST_SCALE: f64 = 1.0;

/// One start per chain: an early-stopped climb from `initial` `(dim)`, then normal jitter.
///
/// The climb stops once an iteration gains less than dim/100 nats. By then it has reached the level
/// of the typical set, dim/2 below the mode. It does not go on to the joint mode: in a hierarchical
/// model this is a corner far from the mass.
///
/// The jitter has each coordinate's conditional standard deviation (at most 1). On a normal
/// density, however correlated, this lowers the log density by dim/2 on average, which is where its
/// draws lie. Some densities fall off faster than their curvature tells: a bracket is flat inside
/// and steep outside. There the jitter shrinks until it loses less than dim + 10 nats.
///
/// A density that knows moves of its own ([`LogDensity::interwoven`]) has other starts: each but the first climbs from fields
/// drawn from their prior. So chains that agree have come to one answer from far apart. What is not to be climbed
/// ([`LogDensity::unclimbed`]) stays at `initial`.
///
/// # Errors
/// Those of [`maximise`] at `initial`; [`InferError::NoStart`] if no jittered point has support.
pub fn jittered_starts(
    density: &dyn LogDensity,
    initial: &[f64],
    chains: usize,
    seed: u64,
) -> Result<Vec<Vec<f64>>, InferError> {
    let ends = climbs(density, initial, chains, seed)?;
    starts_at(density, &ends, chains, seed)
}

/// Where the climbs from `initial` `(dim)` end that [`jittered_starts`] begins with, the best first: one for each chain of a
/// density that knows moves of its own, else one.
///
/// # Errors
/// Those of [`maximise`] at `initial`.
pub(crate) fn climbs(
    density: &dyn LogDensity,
    initial: &[f64],
    chains: usize,
    seed: u64,
) -> Result<Vec<Vec<f64>>, InferError> {
    let starts = match density.interwoven() {
        Some(_) => far_apart::far_apart(density, initial, chains, seed),
        None => vec![initial.to_vec()],
    };
    climbs_on(density, &starts, seed)
}

/// Where climbs from `starts` end, each `(dim)`, the best first.
///
/// # Errors
/// Those of [`maximise`] at one of `starts`.
pub(crate) fn climbs_on(
    density: &dyn LogDensity,
    starts: &[Vec<f64>],
    seed: u64,
) -> Result<Vec<Vec<f64>>, InferError> {
    if density.interwoven().is_some() {
        return far_apart::climbs(density, starts, seed);
    }
    let least_gain = 0.01 * density.dim() as f64;
    let settings = OptimumSettings { max_iterations: 200, least_gain, ..Default::default() };
    starts.iter().map(|start| Ok(maximise(density, start, &settings)?.position)).collect()
}

/// The starts of [`jittered_starts`], of climbs that ended there.
///
/// # Errors
/// [`InferError::NoStart`].
pub(crate) fn starts_at(
    density: &dyn LogDensity,
    ends: &[Vec<f64>],
    chains: usize,
    seed: u64,
) -> Result<Vec<Vec<f64>>, InferError> {
    if density.interwoven().is_some() {
        return Ok(ends.to_vec());
    }
    let (mut evaluator, end) = (density.evaluator(), &ends[0]);
    let ln_density = evaluator.ln_density(end, &mut vec![0.0; end.len()]);
    let mut scales = conditional_scales(&mut *evaluator, end, LARGEST_SCALE);
    for scale in &mut scales {
        *scale = scale.min(LARGEST_SCALE);
    }
    let about = (&end[..], ln_density, &scales[..]);
    (0..chains).map(|chain| jitter(&mut *evaluator, about, chain, seed)).collect()
}

/// Tries ever smaller jitters on these scales. Gives the first point that is near enough to `end` in log density.
fn jitter(
    evaluator: &mut dyn Evaluator,
    (end, ln_density, scales): (&[f64], f64, &[f64]),
    chain: usize,
    seed: u64,
) -> Result<Vec<f64>, InferError> {
    const TRIES: usize = 100;
    let mut rng = Stream::Start(chain).rng(seed);
    let mut gradient = vec![0.0; end.len()];
    let floor = ln_density - end.len() as f64 - 10.0;
    for attempt in 0..TRIES {
        let shrink = 0.5f64.powf(attempt as f64 / 5.0);
        let start: Vec<f64> = end
            .iter()
            .zip(scales)
            .map(|(q, scale)| q + shrink * scale * rng.sample::<f64, _>(StandardNormal))
            .collect();
        let ln_density = evaluator.ln_density(&start, &mut gradient);
        if ln_density.is_finite() && ln_density > floor && gradient.iter().all(|g| g.is_finite()) {
            return Ok(start);
        }
    }
    Err(InferError::NoStart { chain, seed, tried: TRIES })
}

#[cfg(test)]
mod tests {
    use super::super::test_densities::{FnDensity, normal};
    use super::*;

    #[test]
    fn starts_lie_in_the_typical_set_of_a_normal_and_differ() {
        let sd: Vec<f64> = (0..100).map(|i| 10f64.powf(f64::from(i) / 50.0 - 2.0)).collect();
        let density = normal(sd);
        let starts = jittered_starts(&density, &[0.3; 100], 8, 5).unwrap();
        let mut gradient = vec![0.0; 100];
        for start in &starts {
            let ln_density = density.evaluator().ln_density(start, &mut gradient);
            assert!((-100.0..-20.0).contains(&ln_density), "{ln_density}");
        }
        assert!(starts[0] != starts[1]);
        assert_eq!(starts, jittered_starts(&density, &[0.3; 100], 8, 5).unwrap());
    }

    /// A scale s, the likelier the smaller, and an x near 3.
    struct Shrinking {
        knows_moves: bool,
    }

    impl LogDensity for Shrinking {
        fn dim(&self) -> usize {
            2
        }
        fn evaluator(&self) -> Box<dyn Evaluator + '_> {
            Box::new(Shrinking { knows_moves: false })
        }
        fn interwoven(&self) -> Option<Vec<usize>> {
            self.knows_moves.then(|| vec![0])
        }
    }

    impl Evaluator for Shrinking {
        fn ln_density(&mut self, q: &[f64], g: &mut [f64]) -> f64 {
            let off = q[1] - 3.0;
            g.copy_from_slice(&[-5.0 * q[0].exp() - 0.1 * q[0], -off]);
            -5.0 * q[0].exp() - 0.05 * q[0] * q[0] - 0.5 * off * off
        }
    }

    #[test]
    fn a_scale_that_the_density_moves_itself_starts_where_it_is() {
        let starts = |knows_moves| jittered_starts(&Shrinking { knows_moves }, &[1.0, 0.0], 4, 5);
        for start in starts(true).unwrap() {
            assert!(start[0].to_bits() == 1f64.to_bits() && start[1] > 0.5, "{start:?}");
        }
        // all climb alike, and then they are moved at random
        let climbed = starts(false).unwrap();
        assert!(climbed.iter().map(|start| start[0]).sum::<f64>() < 0.0, "{climbed:?}");
    }

    #[test]
    fn a_wall_next_to_the_optimum_is_avoided() {
        // Support only q > 0 in all of ten coordinates, optimum within a few scales of it.
        let f = |q: &[f64], g: &mut [f64]| {
            g.iter_mut().zip(q).for_each(|(g, q)| *g = 1.0 / q - 1.0);
            if q.iter().any(|&q| q <= 0.0) {
                return f64::NEG_INFINITY;
            }
            q.iter().map(|q| q.ln() - q).sum()
        };
        let density = FnDensity { dim: 10, f };
        let starts = jittered_starts(&density, &[2.0; 10], 20, 1).unwrap();
        assert!(starts.iter().flatten().all(|&q| q > 0.0));
    }
}
