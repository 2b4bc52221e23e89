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

/// One start per chain. That of the first has climbed from `initial` `(dim)`; those of the others from a draw of the prior of
/// what [`Evaluator::multipliers`] names, the coefficients of fields, and from `initial` in all else.
///
/// So chains that agree have found the same answer from different ones. A climb can also come to rest on the way. Where it
/// ends further below the best than a draw of a normal with as many unknowns may be, and 10 nats more, it begins once more, from half of the draw.
///
/// # Errors
/// Those of [`maximise`] at `initial`.
pub(super) fn far_apart(
    density: &dyn LogDensity,
    initial: &[f64],
    chains: usize,
    seed: u64,
) -> Result<Vec<Vec<f64>>, InferError> {
    const TRIES: i32 = 5;
    let multipliers = density.evaluator().multipliers(initial);
    let n_climbed = density.dim() - density.unclimbed().len();
    let climb = |chain: usize, part: f64| {
        let mut rng = Stream::Start(chain).rng(seed);
        let mut start = initial.to_vec();
        for (x, c) in start.iter_mut().zip(&multipliers) {
            if chain > 0 && *c != 0.0 {
                *x = part * rng.sample::<f64, _>(StandardNormal) + (1.0 - part) * *x;
            }
        }
        uphill(density, &start)
    };
    let mut ends: Vec<Optimum> =
        (0..chains).into_par_iter().map(|chain| climb(chain, 1.0)).collect::<Result<_, _>>()?;
    for half in 1..TRIES {
        let best = ends.iter().map(|end| end.ln_density).fold(f64::NEG_INFINITY, f64::max);
        let floor = best - n_climbed as f64 - 10.0;
        let again = |(chain, end): (usize, &mut Optimum)| -> Result<(), InferError> {
            if end.ln_density < floor {
                *end = climb(chain, 0.5f64.powi(half))?;
            }
            Ok(())
        };
        ends.par_iter_mut().enumerate().try_for_each(again)?;
    }
    Ok(ends.into_iter().map(|end| end.position).collect())
}

/// The way uphill from `start` `(dim)` in units of the Hessian, taken anew after every twelve steps, until these gain less than
/// one nat. A Hessian costs as much as dozens of gradients.
///
/// # Errors
/// Those of [`maximise`] at `start`.
pub(super) fn uphill(density: &dyn LogDensity, start: &[f64]) -> Result<Optimum, InferError> {
    /// Most Hessians.
    const MOST: usize = 20;
    let settings = OptimumSettings { max_iterations: 12, least_gain: 0.3, ..Default::default() };
    let (still, mut evaluator) = (density.unclimbed(), density.evaluator());
    let mut step_of = |here: &[f64]| -> Result<Optimum, InferError> {
        let multipliers = evaluator.multipliers(here);
        let metric = Curvature::at(&mut *evaluator, here, &still).metric(&multipliers);
        let whitened = Whitened { density, origin: here, metric: &metric };
        let mut optimum = maximise(&whitened, &vec![0.0; here.len()], &settings)?;
        let steps = std::mem::replace(&mut optimum.position, here.to_vec());
        metric.drift(&mut optimum.position, 1.0, &steps);
        Ok(optimum)
    };
    let mut end = step_of(start)?;
    for _ in 1..MOST {
        let before = end.ln_density;
        end = step_of(&end.position)?;
        if end.ln_density - before < 1.0 {
            break;
        }
    }
    Ok(end)
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
