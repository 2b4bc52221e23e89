//! What the candidates of a round are: a finding, causes that cannot be told apart, or nothing.

use super::engine::Outer;
use super::fit::Fit;
use super::outer::{Free, optimise, score, without_sites};
use super::procedure::{Record, Round, Run};
use super::search::{
    Left, Tried, leave_sites_out, leave_units_out, r_squared_on_fields, squared_errors,
};
use super::units::{FOLD, LEAST_UNITS, Unit, by_site, unit_of};

/// Least log Bayes factor of a claim.
pub(super) const CLAIM: f64 = 3.0;
/// A runner-up within this log Bayes factor is a rival.
const RIVAL: f64 = 2.0;
/// A winner that adds less than this with its rival in the model is not told apart from it.
const ADDS: f64 = 1.0;
/// R² on the fitted fields' span beyond which a covariate could be the fields' own.
const SPAN: f64 = 0.8;
/// Share of null searches that the best candidate must beat.
const LEVEL: f64 = 0.05;

impl Run<'_> {
    /// What the round's best candidate is: a finding, ambiguous, or nothing.
    #[allow(clippy::type_complexity, reason = "what a round comes to, used once")]
    pub(super) fn judge(
        &self,
        (tried, nulls): (Vec<Tried>, Vec<f64>),
        base: &Fit,
        found: &[usize],
    ) -> (Round, Option<(usize, Fit)>, Vec<[String; 2]>) {
        let left = leave_sites_out(&self.engine, base, self.settings.seed);
        let p_null = |log_bf: f64| {
            let above = nulls.iter().filter(|n| **n >= log_bf).count();
            (1 + above) as f64 / (1 + nulls.len()) as f64
        };
        let mut records: Vec<Record> = tried
            .iter()
            .map(|t| Record {
                candidate: t.candidate,
                p_screen: t.p_screen,
                log_bf: t.log_bf,
                p_null: p_null(t.log_bf),
                verdict: if t.log_bf > CLAIM {
                    "less evidence".into()
                } else if t.fit.is_some() {
                    format!("log Bayes factor {:.1}, more than {CLAIM} is asked", t.log_bf)
                } else {
                    "screened out".into()
                },
            })
            .collect();
        // another may explain more where it was fitted, and predict nothing
        let (mut taken, mut rivals) = (None, vec![]);
        for (i, best) in tried.iter().enumerate().filter(|(_, t)| t.log_bf > CLAIM) {
            let Some(fit) = best.fit.clone() else { continue };
            if let Some(why) = self.objection(best, &fit, p_null(best.log_bf), &left) {
                records[i].verdict = why;
                continue;
            }
            rivals = self.rivals(&tried, i, base, &left, found);
            if rivals.is_empty() {
                records[i].verdict = "found".into();
                taken = Some((best.candidate, fit));
            } else {
                let names: Vec<&str> = rivals.iter().map(|pair| pair[1].as_str()).collect();
                records[i].verdict = format!("not told apart from {}", names.join(", "));
            }
            break;
        }
        (Round { tried: records, nulls, base: base.clone(), left }, taken, rivals)
    }

    /// Why a candidate is no finding, if it is none.
    fn objection(&self, best: &Tried, fit: &Fit, p_null: f64, left: &Left) -> Option<String> {
        if p_null > LEVEL {
            return Some(format!(
                "{:.0} % of searches on simulated data did as well",
                100.0 * p_null
            ));
        }
        let unit = self.left_out(self.candidates[best.candidate].form.column());
        if let Some(unit) = unit.filter(|unit| unit.n < LEAST_UNITS) {
            return Some(format!("not confirmable: it varies only over {} {}s", unit.n, unit.name));
        }
        self.refutation(best.candidate, fit, left)
    }

    /// Why a candidate's predictions of what was left out speak against it, if they do: of sites, and of the
    /// units over which it varies.
    fn refutation(&self, candidate: usize, fit: &Fit, left: &Left) -> Option<String> {
        let unit = self.left_out(self.candidates[candidate].form.column());
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
        let without = self.without(fit).and_then(|fit| self.leave_out(&fit, &unit));
        let Some((before, after)) = without.zip(self.leave_out(fit, &unit)) else {
            return Some(format!("there is no fit with some {}s left out as a whole", unit.name));
        };
        let squares = |left: &Left| squared_errors(&self.engine, left, &unit);
        let (what, (gain, se)) = if unit.name == FOLD {
            ("squared error", gain(&squares(&after), &squares(&before)))
        } else {
            ("log score", gain(&before.elpd, &after.elpd))
        };
        (!(gain > se)).then(|| {
            format!(
                "leaving {}s out as a whole, the gain in {what} {gain:.1} is not beyond its error {se:.1}",
                unit.name
            )
        })
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

    /// The fit without its last term.
    fn without(&self, fit: &Fit) -> Option<Fit> {
        let active = &fit.active[..fit.active.len() - 1];
        let start = self.engine.fit(&fit.outer, active, Some(fit))?;
        optimise(&self.engine, active, &start, Free::Spread, self.step).map(|(fit, _)| fit)
    }

    /// Causes that the best candidate cannot be told apart from.
    fn rivals(
        &self,
        tried: &[Tried],
        best: usize,
        base: &Fit,
        left: &Left,
        found: &[usize],
    ) -> Vec<[String; 2]> {
        let best = &tried[best];
        let name = |t: &Tried| self.candidates[t.candidate].name.clone();
        let mut pairs: Vec<[String; 2]> = vec![];
        let reference = score(base, self.step);
        for other in tried.iter().filter(|t| name(t) != name(best) && t.log_bf > ADDS) {
            let both = self.active(&[found, &[other.candidate, best.candidate]].concat());
            let with_both = other.fit.as_ref().and_then(|fit| {
                let start = self.engine.fit(&fit.outer, &both, Some(fit))?;
                optimise(&self.engine, &both, &start, Free::Spread, self.step)
            });
            let adds = with_both.map_or(0.0, |(_, both)| both - reference - other.log_bf);
            // two causes that both add much with the other in the model are two effects
            let is_near = best.log_bf - other.log_bf < RIVAL;
            let is_rival = adds < ADDS || (is_near && adds < CLAIM);
            // what predicts nothing of what was left out is no rival
            let predicts = |fit: &Fit| self.refutation(other.candidate, fit, left).is_none();
            if is_rival
                && !pairs.iter().any(|pair| pair[1] == name(other))
                && other.fit.as_ref().is_some_and(predicts)
            {
                pairs.push([name(best), name(other)]);
            }
        }
        let r2 = r_squared_on_fields(&self.engine, base, best.candidate, self.step);
        if r2 > SPAN {
            pairs.push([name(best), "spatial_field".into()]);
        }
        pairs
    }

    /// Log Bayes factor of the sites' random effect.
    pub(super) fn site_evidence(&self, fit: &Fit) -> f64 {
        let without = without_sites(&self.engine, &fit.active, fit, self.step);
        score(fit, self.step) - without
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

/// Sum of the differences of two vectors, and its standard error.
pub(super) fn gain(before: &[f64], after: &[f64]) -> (f64, f64) {
    let d: Vec<f64> = after.iter().zip(before).map(|(a, b)| a - b).collect();
    let n = d.len() as f64;
    let mean = d.iter().sum::<f64>() / n;
    let variance = d.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (n * mean, (n * variance).sqrt())
}
