//! Whether a cause predicts what was left out.

use super::bench::Bench;
use super::candidate::{Candidate, Level};
use super::fit::LaplaceFit;
use super::judgement::{Refutation, UnitScore};
use super::leave::{Left, leave_sites_out, leave_units_out, squared_errors};
use super::outer::Free;
use super::units::{LEAST_UNITS, Unit};
use crate::table::Role;

/// A sum of differences and its standard error.
#[derive(Clone, Copy, Debug)]
struct Gain {
    gain: f64,
    se: f64,
}

impl Gain {
    fn is_beyond_error(self) -> bool {
        self.gain > self.se
    }
}

impl Bench<'_> {
    /// Whether predictions of what was left out speak against a cause, and why. Its effects are the
    /// last terms of `fit`. What is left out is sites, and units over which the cause varies.
    /// `left` is what the fit without the effects leaves over.
    pub(super) fn refutation(
        &self,
        effects: &[usize],
        fit: &LaplaceFit,
        left: &Left,
    ) -> Option<Refutation> {
        let unit = self.left_out(self.column(*effects.first()?));
        if unit.is_none() || unit != self.unit {
            // what units share is known from a unit's other sites: these tell nothing of what varies over units
            let with = leave_sites_out(&self.engine, fit, self.seed);
            let gained = gain(&left.elpd, &with.elpd);
            if !gained.is_beyond_error() {
                return Some(Refutation::Sites { gain: gained.gain, se: gained.se });
            }
        }
        let unit = unit.filter(|unit| unit.n >= LEAST_UNITS)?;
        let without = self.without(effects, fit);
        let Some(gained) = without.and_then(|without| self.unit_gain(&without, fit, &unit)) else {
            return Some(Refutation::NoFitWithoutUnits { unit: unit.name });
        };
        let (score, Gain { gain, se }) = (self.unit_score(&unit), gained);
        (!gained.is_beyond_error()).then_some(Refutation::Units {
            unit: unit.name,
            score,
            gain,
            se,
        })
    }

    /// Whether a field predicts what was left out better than another field does, by more than the
    /// error of the difference.
    pub(super) fn is_better_field(&self, field: &LaplaceFit, than: &LaplaceFit) -> bool {
        let sites = |fit: &LaplaceFit| leave_sites_out(&self.engine, fit, self.seed).elpd;
        let gained = match self.left_out(None).filter(|unit| unit.n >= LEAST_UNITS) {
            Some(unit) => self.unit_gain(than, field, &unit),
            None => Some(gain(&sites(than), &sites(field))),
        };
        gained.is_some_and(Gain::is_beyond_error)
    }

    fn unit_score(&self, unit: &Unit) -> UnitScore {
        if self.table.role(&unit.name) == Role::Fold {
            UnitScore::SquaredError
        } else {
            UnitScore::Log
        }
    }

    /// What one fit gains on another if units are left out as a whole.
    fn unit_gain(&self, before: &LaplaceFit, after: &LaplaceFit, unit: &Unit) -> Option<Gain> {
        let [before, after] = [self.leave_out(before, unit)?, self.leave_out(after, unit)?];
        let squares = |left: &Left| squared_errors(&self.engine, left, unit);
        Some(match self.unit_score(unit) {
            UnitScore::SquaredError => gain(&squares(&after), &squares(&before)),
            UnitScore::Log => gain(&before.elpd, &after.elpd),
        })
    }

    /// Predictions of each unit from the others, with all outer values at their best, as they will
    /// be reported.
    fn leave_out(&self, fit: &LaplaceFit, unit: &Unit) -> Option<Left> {
        let best = self.optimised(fit, Free::All);
        let fit = best.map_or_else(|| fit.clone(), |(fit, _)| fit);
        leave_units_out(&self.engine, &fit, unit, self.seed)
    }

    /// The fit without its last terms.
    fn without(&self, last: &[usize], fit: &LaplaceFit) -> Option<LaplaceFit> {
        let active = fit.active.strip_suffix(last)?;
        let is = |of: &dyn Fn(&Candidate) -> bool| last.iter().any(|c| of(&self.candidates[*c]));
        let is_outliers = is(&|c| c.level == Level::Noise && !c.is_scatter());
        let mut outer = fit.outer.clone();
        outer.outliers = outer.outliers.filter(|_| !is_outliers);
        if is(&Candidate::is_scatter) {
            outer.scatter.pop();
        }
        let start = self.engine.fit(&outer, active, Some(fit))?;
        self.optimised(&start, Free::Spread).map(|(fit, _)| fit)
    }
}

/// Sum of the differences of two vectors, and its standard error.
fn gain(before: &[f64], after: &[f64]) -> Gain {
    let d: Vec<f64> = after.iter().zip(before).map(|(a, b)| a - b).collect();
    let n = d.len() as f64;
    let mean = d.iter().sum::<f64>() / n;
    let variance = d.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / (n - 1.0);
    Gain { gain: n * mean, se: (n * variance).sqrt() }
}
