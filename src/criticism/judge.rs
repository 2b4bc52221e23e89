//! What the candidates of a round are: a finding, causes that cannot be told apart, or nothing.

use super::candidates::Level;
use super::claim::Claim;
use super::engine::Outer;
use super::fit::Fit;
use super::leave::{Left, leave_sites_out, leave_units_out, squared_errors};
use super::outer::{Free, optimise, score, without_sites};
use super::procedure::{Record, Round, Run};
use super::search::Tried;
use super::units::{FOLD, LEAST_UNITS, Unit, by_site, unit_of};
use crate::model::Form;

/// Least log Bayes factor of a claim.
pub const CLAIM: f64 = 3.0;
/// Share of null searches that the best candidate must beat.
const LEVEL: f64 = 0.05;

impl Run<'_> {
    /// What the round's best candidate is: a finding, ambiguous, or nothing.
    pub(super) fn judge(
        &mut self,
        number: usize,
        (tried, nulls): (Vec<Tried>, Vec<f64>),
        base: &Fit,
        found: &[usize],
    ) -> (Round, Option<Claim>, Vec<[String; 2]>) {
        let least = least_log_bf(number);
        let left = leave_sites_out(&self.engine, base, self.settings.seed);
        let p_null = |log_bf: f64| {
            let above = nulls.iter().filter(|n| **n >= log_bf).count();
            (!nulls.is_empty()).then(|| (1 + above) as f64 / (1 + nulls.len()) as f64)
        };
        let mut records: Vec<Record> = tried
            .iter()
            .map(|t| Record {
                candidate: t.candidate,
                form: self.candidates[t.candidate].form.clone(),
                p_screen: t.p_screen,
                log_bf: t.log_bf,
                p_null: p_null(t.log_bf),
                verdict: if t.log_bf > least {
                    "less evidence".into()
                } else if t.fit.is_some() {
                    format!("log Bayes factor {:.1}, more than {least} is asked", t.log_bf)
                } else {
                    "screened out".into()
                },
            })
            .collect();
        // another may explain more where it was fitted, and predict nothing
        let (mut claim, mut rivals) = (None, vec![]);
        for (i, best) in tried.iter().enumerate().filter(|(_, t)| t.log_bf > least) {
            let Some(fit) = best.fit.clone() else { continue };
            if let Some(why) = self.objection(best, &fit, p_null(best.log_bf), &left) {
                records[i].verdict = why;
                continue;
            }
            rivals = self.rivals(&tried, best, base, &left, found);
            if rivals.is_empty() {
                match self.claim(best.candidate, fit, &left) {
                    Ok(own) => {
                        records[i].verdict = "found".into();
                        claim = Some((i, own));
                    }
                    Err(why) => {
                        records[i].verdict = why;
                        continue;
                    }
                }
            } else {
                let names: Vec<&str> = rivals.iter().map(|pair| pair[1].as_str()).collect();
                records[i].verdict = format!("not told apart from {}", names.join(", "));
            }
            break;
        }
        let (taken, claim) = claim.unzip();
        let claimed = claim.as_ref().map_or(vec![], |claim: &Claim| claim.effects.clone());
        let round = Round { tried: records, nulls, base: base.clone(), left, taken, claimed };
        (round, claim, rivals)
    }

    /// Why a candidate is no finding, if it is none.
    fn objection(
        &self,
        best: &Tried,
        fit: &Fit,
        p_null: Option<f64>,
        left: &Left,
    ) -> Option<String> {
        let p_null = p_null.unwrap_or(1.0);
        if p_null > LEVEL {
            return Some(format!(
                "{:.0} % of searches on simulated data did as well",
                100.0 * p_null
            ));
        }
        let unit = self.left_out(self.column(best.candidate));
        if let Some(unit) = unit.filter(|unit| unit.n < LEAST_UNITS) {
            return Some(format!("not confirmable: it varies only over {} {}s", unit.n, unit.name));
        }
        self.refutation(&[best.candidate], fit, left)
    }

    /// Why predictions of what was left out speak against a cause's effects, the last terms of `fit`, if they do:
    /// of sites, and of the units over which the cause varies.
    pub(super) fn refutation(&self, effects: &[usize], fit: &Fit, left: &Left) -> Option<String> {
        let unit = self.left_out(self.column(*effects.first()?));
        if unit.is_none() || unit != self.unit {
            // what units share is known from a unit's other sites: these tell nothing of what varies over units
            let with = leave_sites_out(&self.engine, fit, self.settings.seed);
            let (gain, se) = gain(&left.elpd, &with.elpd);
            if !(gain > se) {
                return Some(format!(
                    "leave-one-site-out gain {gain:.1} is not beyond its error {se:.1}"
                ));
            }
        }
        let unit = unit.filter(|unit| unit.n >= LEAST_UNITS)?;
        let gained =
            self.without(effects, fit).and_then(|without| self.unit_gain(&without, fit, &unit));
        let Some((what, (gain, se))) = gained else {
            return Some(format!("there is no fit with some {}s left out as a whole", unit.name));
        };
        (!(gain > se)).then(|| {
            format!(
                "leaving {}s out as a whole, the gain in {what} {gain:.1} is not beyond its error {se:.1}",
                unit.name
            )
        })
    }

    /// What one fit gains on another where units are left out as a whole, with its standard error, and in what.
    fn unit_gain(
        &self,
        before: &Fit,
        after: &Fit,
        unit: &Unit,
    ) -> Option<(&'static str, (f64, f64))> {
        let [before, after] = [self.leave_out(before, unit)?, self.leave_out(after, unit)?];
        let squares = |left: &Left| squared_errors(&self.engine, left, unit);
        Some(if unit.name == FOLD {
            ("squared error", gain(&squares(&after), &squares(&before)))
        } else {
            ("log score", gain(&before.elpd, &after.elpd))
        })
    }

    /// Whether a field predicts what was left out better than another field does, beyond the error of that.
    pub(super) fn is_better_field(&self, field: &Fit, than: &Fit) -> bool {
        let sites = |fit: &Fit| leave_sites_out(&self.engine, fit, self.settings.seed).elpd;
        let gained = match self.left_out(None).filter(|unit| unit.n >= LEAST_UNITS) {
            Some(unit) => self.unit_gain(than, field, &unit).map(|(_, gained)| gained),
            None => Some(gain(&sites(than), &sites(field))),
        };
        gained.is_some_and(|(gain, se)| gain > se)
    }

    /// The column that a candidate reads.
    pub(super) fn column(&self, candidate: usize) -> Option<&str> {
        self.candidates[candidate].form.as_ref().and_then(Form::column)
    }

    /// Predictions of each unit from the others, everything at its best, as it will be reported.
    fn leave_out(&self, fit: &Fit, unit: &Unit) -> Option<Left> {
        let best = optimise(&self.engine, &fit.active, fit, Free::All, self.step);
        let fit = best.map_or_else(|| fit.clone(), |(fit, _)| fit);
        leave_units_out(&self.engine, &fit, unit, self.settings.seed)
    }

    /// What is left out as a whole to confirm an effect of `column`, or of none; `None` for the site.
    pub(super) fn left_out(&self, column: Option<&str>) -> Option<Unit> {
        let table = self.case.table;
        let unit = Some(unit_of(table, column)).filter(|unit| *unit != by_site(table));
        if column.is_some() { unit } else { unit.or_else(|| self.unit.clone()) }
    }

    /// The fit without its last terms.
    fn without(&self, last: &[usize], fit: &Fit) -> Option<Fit> {
        let active = fit.active.strip_suffix(last)?;
        let is_noise = last.iter().any(|c| self.candidates[*c].level == Level::Noise);
        let outliers = fit.outer.outliers.filter(|_| !is_noise);
        let outer = Outer { outliers, ..fit.outer.clone() };
        let start = self.engine.fit(&outer, active, Some(fit))?;
        optimise(&self.engine, active, &start, Free::Spread, self.step).map(|(fit, _)| fit)
    }

    /// Log Bayes factor of the sites' random effect, against nothing or the model's fields at a finer
    /// resolution, whichever says more when fitted as well.
    pub(super) fn site_evidence(&self, fit: &Fit) -> f64 {
        let finer = self.finer.iter().map(|terms| [&fit.active[..], terms].concat());
        let without = [fit.active.clone()].into_iter().chain(finer);
        let fits =
            without.filter_map(|active| without_sites(&self.engine, &active, fit, self.step));
        let Some((best, _)) = fits.max_by(|a, b| a.1.total_cmp(&b.1)) else {
            return f64::INFINITY;
        };
        let best = optimise(&self.engine, &best.active, &best, Free::All, self.step);
        score(fit, self.step) - best.map_or(f64::NEG_INFINITY, |(_, score)| score)
    }

    /// Log Bayes factor of the units' random effect.
    pub(super) fn unit_evidence(&self, fit: &Fit, found: &[usize]) -> f64 {
        let outer = Outer { ln_unit: None, ..fit.outer.clone() };
        let start = self.engine.fit(&outer, found, None);
        let without =
            start.and_then(|start| optimise(&self.engine, found, &start, Free::Spread, self.step));
        score(fit, self.step) - without.map_or(f64::NEG_INFINITY, |(_, score)| score)
    }
}

/// Least log Bayes factor of a claim in round `number`. Every further round is another chance of a wrong
/// name, and its base is a model that was chosen by the same data.
pub fn least_log_bf(number: usize) -> f64 {
    if number == 0 { CLAIM } else { 2.0 * CLAIM }
}

/// Sum of the differences of two vectors, and its standard error.
pub(super) fn gain(before: &[f64], after: &[f64]) -> (f64, f64) {
    let d: Vec<f64> = after.iter().zip(before).map(|(a, b)| a - b).collect();
    let n = d.len() as f64;
    let mean = d.iter().sum::<f64>() / n;
    let variance = d.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (n * mean, (n * variance).sqrt())
}
