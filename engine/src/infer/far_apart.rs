//! Starts far apart, of a density whose gradients are costly: each climbs from fields of its own.

use super::curvature::Curvature;
use super::density::{Evaluator, LogDensity};
use super::error::InferError;
use super::hamiltonian::Metric;
use super::optimise::{Optimum, OptimumSettings, maximise};
use crate::random::Stream;
use rand::RngExt;
use rand_distr::StandardNormal;
use rayon::prelude::*;

/// An answer whose log density is this much lower than another's holds next to nothing of the probability, nats.
const LOWER: f64 = 10.0;

/// A climb that is lower than another one by this much for each unknown, nats, does not go on.
const HOPELESS: f64 = 30.0;

/// One start per chain, far from each other: that of the first is `initial` `(dim)`; those of the others have a draw of the prior
/// of what [`Evaluator::multipliers`] names, the coefficients of fields, and are `initial` in all else.
pub(super) fn far_apart(
    density: &dyn LogDensity,
    initial: &[f64],
    chains: usize,
    seed: u64,
) -> Vec<Vec<f64>> {
    let multipliers = density.evaluator().multipliers(initial);
    let part = |chain| if chain == 0 { 0.0 } else { 1.0 };
    (0..chains)
        .map(|chain| towards_prior(&multipliers, initial, part(chain), chain, seed))
        .collect()
}

/// Where climbs from each of `starts` end, the best first.
///
/// So chains that agree have found the same answer from different ones. A climb can also end at a lower answer, come to rest
/// on the way, or stray to where a gradient costs ten times as much: where it ends more than [`LOWER`] below the best, it
/// begins once more, halfway between a draw of the prior and the best.
///
/// # Errors
/// Those of [`maximise`] at one of `starts`.
pub(super) fn climbs(
    density: &dyn LogDensity,
    starts: &[Vec<f64>],
    seed: u64,
) -> Result<Vec<Vec<f64>>, InferError> {
    const TRIES: i32 = 5;
    let by_density = |a: &Optimum, b: &Optimum| b.ln_density.total_cmp(&a.ln_density);
    let begun = starts.par_iter().map(|start| far(density, start));
    let mut ends: Vec<Optimum> = begun.collect::<Result<_, _>>()?;
    ends.sort_by(by_density);
    let Some(best) = ends.first().map(|best| best.ln_density) else { return Ok(vec![]) };
    ends.par_iter_mut().try_for_each(|end| near(density, end, best))?;
    ends.sort_by(by_density);
    for half in 1..TRIES {
        let Some(best) = ends.first().cloned() else { break };
        let multipliers = density.evaluator().multipliers(&best.position);
        let part = 0.5f64.powi(half);
        let again = |(chain, end): (usize, &mut Optimum)| -> Result<(), InferError> {
            if end.ln_density < best.ln_density - LOWER {
                let start = towards_prior(&multipliers, &best.position, part, chain, seed);
                *end = far(density, &start)?;
                near(density, end, best.ln_density)?;
            }
            Ok(())
        };
        ends.par_iter_mut().enumerate().try_for_each(again)?;
        ends.sort_by(by_density);
    }
    Ok(ends.into_iter().map(|end| end.position).collect())
}

/// What has a prior of its own, moved from where it is by this part of the way to a draw.
fn towards_prior(
    multipliers: &[f64],
    from: &[f64],
    part: f64,
    chain: usize,
    seed: u64,
) -> Vec<f64> {
    let mut rng = Stream::Start(chain).rng(seed);
    let mut start = from.to_vec();
    for (x, c) in start.iter_mut().zip(multipliers) {
        if *c != 0.0 {
            *x += part * (rng.sample::<f64, _>(StandardNormal) - *x);
        }
    }
    start
}

/// The first part of the way uphill from `start` `(dim)`, in units of the unknowns. It is short: most climbs need no more of it, and for one
/// that strays each step costs many times as much.
fn far(density: &dyn LogDensity, start: &[f64]) -> Result<Optimum, InferError> {
    let mut units = Metric::diagonal(vec![1.0; start.len()]);
    for i in &density.unclimbed() {
        units.scale[*i] = 0.0;
    }
    let least_gain = 0.01 * start.len() as f64;
    let settings = OptimumSettings { max_iterations: 30, least_gain, ..Default::default() };
    steps(density, start, &units, &settings)
}

/// The rest of the way from `end`, in units of the Hessian, taken anew after every twelve steps, until these gain less than one nat. A
/// Hessian costs as much as dozens of gradients, and far from any answer it is no guide. Another climb is at `best`; where there is no
/// hope to come near it, `end` stays.
fn near(density: &dyn LogDensity, end: &mut Optimum, best: f64) -> Result<(), InferError> {
    /// Most Hessians.
    const MOST: usize = 20;
    let (still, mut evaluator) = (density.unclimbed(), density.evaluator());
    let settings = OptimumSettings { max_iterations: 12, least_gain: 0.3, ..Default::default() };
    let mut gain = f64::INFINITY;
    for _ in 0..MOST {
        if gain < 1.0 || end.ln_density < best - HOPELESS * density.dim() as f64 {
            break;
        }
        let multipliers = evaluator.multipliers(&end.position);
        let metric = Curvature::at(&mut *evaluator, &end.position, &still).metric(&multipliers);
        let before = end.ln_density;
        *end = steps(density, &end.position, &metric, &settings)?;
        gain = end.ln_density - before;
    }
    Ok(())
}

/// Steps uphill from `here` in units of a metric.
fn steps(
    density: &dyn LogDensity,
    here: &[f64],
    metric: &Metric,
    settings: &OptimumSettings,
) -> Result<Optimum, InferError> {
    let whitened = Whitened { density, origin: here, metric };
    let mut optimum = maximise(&whitened, &vec![0.0; here.len()], settings)?;
    let steps = std::mem::replace(&mut optimum.position, here.to_vec());
    metric.drift(&mut optimum.position, 1.0, &steps);
    Ok(optimum)
}

/// A density about `origin` in units of a metric.
struct Whitened<'d> {
    density: &'d dyn LogDensity,
    origin: &'d [f64],
    metric: &'d Metric,
}

struct WhitenedEvaluator<'d> {
    evaluator: Box<dyn Evaluator + 'd>,
    of: &'d Whitened<'d>,
    position: Vec<f64>,
    gradient: Vec<f64>,
}

impl LogDensity for Whitened<'_> {
    fn dim(&self) -> usize {
        self.origin.len()
    }
    fn evaluator(&self) -> Box<dyn Evaluator + '_> {
        let (position, gradient) = (self.origin.to_vec(), self.origin.to_vec());
        let evaluator = self.density.evaluator();
        Box::new(WhitenedEvaluator { evaluator, of: self, position, gradient })
    }
}

impl Evaluator for WhitenedEvaluator<'_> {
    fn ln_density(&mut self, position: &[f64], gradient: &mut [f64]) -> f64 {
        self.position.copy_from_slice(self.of.origin);
        self.of.metric.drift(&mut self.position, 1.0, position);
        let ln_density = self.evaluator.ln_density(&self.position, &mut self.gradient);
        self.of.metric.pull(&self.gradient, gradient);
        ln_density
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_densities::normal;
    use super::*;

    /// All of the way.
    fn uphill(density: &dyn LogDensity, start: &[f64]) -> Optimum {
        let mut end = far(density, start).unwrap();
        near(density, &mut end, f64::NEG_INFINITY).unwrap();
        end
    }

    /// A coefficient with two answers, near 1 and −1, of which the second is lower by twice `tilt`; and a scale that rests.
    struct TwoAnswers {
        tilt: f64,
    }

    impl LogDensity for TwoAnswers {
        fn dim(&self) -> usize {
            2
        }
        fn evaluator(&self) -> Box<dyn Evaluator + '_> {
            Box::new(TwoAnswers { tilt: self.tilt })
        }
        fn interwoven(&self) -> Option<Vec<usize>> {
            Some(vec![0])
        }
    }

    impl Evaluator for TwoAnswers {
        fn ln_density(&mut self, q: &[f64], g: &mut [f64]) -> f64 {
            let off = (q[1] * q[1] - 1.0) / 0.2;
            g.copy_from_slice(&[-q[0], self.tilt - q[1] - off * 2.0 * q[1] / 0.2]);
            self.tilt * q[1] - 0.5 * (q[0] * q[0] + q[1] * q[1] + off * off)
        }
        fn multipliers(&mut self, _: &[f64]) -> Vec<f64> {
            vec![0.0, 1.0]
        }
    }

    /// Chains begin at both of two answers, and at none that holds next to nothing of the probability.
    #[test]
    fn starts_are_at_every_answer_that_counts() {
        let at_second = |tilt: f64, initial: f64| {
            let density = TwoAnswers { tilt };
            let starts = climbs(&density, &far_apart(&density, &[0.3, initial], 12, 1), 1).unwrap();
            assert!(starts.iter().all(|start| start[0].to_bits() == 0.3f64.to_bits()));
            assert!(starts.iter().all(|start| (start[1].abs() - 1.0).abs() < 0.2), "{starts:?}");
            starts.iter().filter(|start| start[1] < 0.0).count()
        };
        for tilt in [0.0, 3.0] {
            assert!((2..=9).contains(&at_second(tilt, 0.5)), "{}", at_second(tilt, 0.5));
        }
        // the best comes first, also where the first climb led to the other
        let density = TwoAnswers { tilt: 3.0 };
        let ends = climbs(&density, &far_apart(&density, &[0.3, -0.83], 12, 1), 1).unwrap();
        assert!(uphill(&density, &[0.3, -0.83]).position[1] < -0.8 && ends[0][1] > 0.8);
        // also where the first chain climbs to the lower one
        let lower = uphill(&TwoAnswers { tilt: 12.0 }, &[0.3, -0.83]);
        assert!(lower.position[1] < -0.8, "{lower:?}");
        assert_eq!([0.5, -0.83].map(|initial| at_second(12.0, initial)), [0, 0]);
    }

    #[test]
    fn the_way_uphill_ends_at_the_top() {
        let density = normal((0..60).map(|i| 10f64.powf(f64::from(i) / 20.0 - 2.0)).collect());
        let end = uphill(&density, &[1.0; 60]);
        assert!(end.ln_density > -1.0, "{end:?}");
    }

    #[test]
    fn a_climb_without_hope_goes_no_further() {
        let density = normal((0..60).map(|i| 10f64.powf(f64::from(i) / 20.0 - 2.0)).collect());
        let begun = far(&density, &[1.0; 60]).unwrap();
        let after = |best: f64| {
            let mut end = begun.clone();
            near(&density, &mut end, best).unwrap();
            end.ln_density - begun.ln_density
        };
        let far_below = HOPELESS * 60.0;
        assert!(after(begun.ln_density + far_below + 1.0) == 0.0);
        assert!(after(begun.ln_density + far_below - 1.0) > 1.0);
    }
}
