//! The best outer values of a Laplace fit: hyperparameters, and the sds of sites and noise. They
//! are found by the exact gradient of the evidence (`slope`).

use super::engine::{Engine, Outer};
use super::fit::LaplaceFit;
use crate::infer::{Evaluator, LogDensity, OptimumSettings, maximise};

/// Which outer values are free.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Free {
    /// All of them.
    All,
    /// The sds of sites, of noise and of units.
    Spread,
}

/// Log prior of the sds. It is half-normal, one protocol step wide. It also keeps sds softly from
/// vanishing, because a bracket without a further error would be a box without curvature.
fn ln_prior(outer: &Outer, step: f64) -> f64 {
    let site = Some(outer.ln_site).filter(|ln| ln.is_finite());
    one(outer.ln_noise, LEAST_NOISE, step)[0]
        + site.map_or(0.0, |site| one(site, LEAST_SITE, step)[0])
        + outer.ln_unit.map_or(0.0, |unit| one(unit, LEAST_SITE, step)[0])
}

/// The log prior of one sd, and its slope in ln sd.
fn one(ln_sd: f64, least: f64, step: f64) -> [f64; 2] {
    let square = (2.0 * ln_sd).exp() / (step * step);
    let below = (least - (ln_sd - step.ln())).max(0.0);
    [-0.5 * square - 0.5 * below * below / 0.09, below / 0.09 - square]
}

/// ln of the sds below which the prior falls off, in steps.
const LEAST_SITE: f64 = -3.0;
const LEAST_NOISE: f64 = -1.6;

/// The fit with the best outer values, and its log posterior there.
pub(super) fn optimise(
    engine: &Engine,
    active: &[usize],
    start: &LaplaceFit,
    free: Free,
    step: f64,
) -> Option<(LaplaceFit, f64)> {
    let density = Climb { engine, active, start, free, step };
    let position = density.position(&start.outer);
    // a hundredth of a nat decides nothing
    let settings =
        OptimumSettings { max_iterations: 30, gradient_tolerance: 5e-2, least_gain: 1e-2 };
    let best = maximise(&density, &position, &settings).ok()?;
    let outer = density.outer(&best.position);
    let fit = engine.fit(&outer, active, Some(start))?;
    let score = fit.ln_evidence + ln_prior(&outer, step);
    Some((fit, score))
}

/// The best fit without random effects of sites, at these hyperparameters; and its score.
pub(super) fn without_sites(
    engine: &Engine,
    active: &[usize],
    fit: &LaplaceFit,
    step: f64,
) -> Option<(LaplaceFit, f64)> {
    let Outer { ln_noise, ln_site, .. } = fit.outer;
    // the noise must take up what sites differ by, unless finer fields do
    let both = 0.5 * ((2.0 * ln_noise).exp() + (2.0 * ln_site).exp()).ln();
    let from = |ln_noise: f64| {
        let outer = Outer { ln_site: f64::NEG_INFINITY, ln_noise, ..fit.outer.clone() };
        let start = engine.fit(&outer, active, None)?;
        optimise(engine, active, &start, Free::Spread, step)
    };
    let fits = [ln_noise.max((step / 3.0).ln()), both].into_iter().filter_map(from);
    fits.max_by(|a, b| a.1.total_cmp(&b.1))
}

/// The score of a fit as it is.
pub(super) fn score(fit: &LaplaceFit, step: f64) -> f64 {
    fit.ln_evidence + ln_prior(&fit.outer, step)
}

struct Climb<'a> {
    engine: &'a Engine,
    active: &'a [usize],
    start: &'a LaplaceFit,
    free: Free,
    step: f64,
}

impl Climb<'_> {
    fn position(&self, outer: &Outer) -> Vec<f64> {
        let mut position = vec![outer.ln_noise];
        // sites without a random effect stay so
        position.extend(Some(outer.ln_site).filter(|ln| ln.is_finite()));
        position.extend(outer.ln_unit);
        if self.free == Free::All {
            position.extend(&outer.other);
        }
        position
    }

    fn outer(&self, position: &[f64]) -> Outer {
        let mut outer = self.start.outer.clone();
        let mut rest = position.iter().copied();
        let sds = [Some(&mut outer.ln_noise), Some(&mut outer.ln_site), outer.ln_unit.as_mut()];
        for sd in sds.into_iter().flatten().filter(|sd| sd.is_finite()) {
            *sd = rest.next().unwrap_or(*sd);
        }
        if self.free == Free::All {
            outer.other = rest.collect();
        }
        outer
    }
}

impl LogDensity for Climb<'_> {
    fn dim(&self) -> usize {
        self.position(&self.start.outer).len()
    }
    fn evaluator(&self) -> Box<dyn Evaluator + '_> {
        Box::new(Climber { climb: self, last: self.start.clone() })
    }
}

struct Climber<'a> {
    climb: &'a Climb<'a>,
    /// The last fit, from which the next one starts.
    last: LaplaceFit,
}

impl Evaluator for Climber<'_> {
    fn ln_density(&mut self, position: &[f64], gradient: &mut [f64]) -> f64 {
        let Climb { engine, active, step, free, .. } = *self.climb;
        let outer = self.climb.outer(position);
        let Some(fit) = engine.fit(&outer, active, Some(&self.last)) else {
            return f64::NEG_INFINITY;
        };
        let slope = engine.slope(&fit);
        let mut all = vec![slope.ln_noise + one(outer.ln_noise, LEAST_NOISE, step)[1]];
        if outer.ln_site.is_finite() {
            all.push(slope.ln_site + one(outer.ln_site, LEAST_SITE, step)[1]);
        }
        all.extend(outer.ln_unit.map(|unit| slope.ln_unit + one(unit, LEAST_SITE, step)[1]));
        if free == Free::All {
            all.extend(slope.other);
        }
        gradient.copy_from_slice(&all);
        let value = score(&fit, step);
        self.last = fit;
        value
    }
}
