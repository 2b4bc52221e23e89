//! A claim: a cause that was found, with the effects by which it will predict.

use super::bench::Bench;
use super::candidate::{Candidate, Level};
use super::fit::LaplaceFit;
use super::judgement::Refutation;
use super::leave::Left;
use super::observable::readable;
use super::outer::Free;
use super::propose::mean_and_sd;
use crate::model::Form;
use crate::model::forms::{Above, logistic};

/// Least scale of a soft edge of a patch, in standard deviations of the distances.
const LEAST_SCALE: f64 = 0.1;

/// What a round claims.
#[derive(Clone, Debug)]
pub(super) struct Claim<'a> {
    /// The bench. Its candidates that are claimed have the form in which they are claimed.
    pub(super) bench: Bench<'a>,
    /// The effects of one cause, as numbers of candidates.
    pub(super) effects: Vec<usize>,
    /// The fit, of which they are the last terms.
    pub(super) fit: LaplaceFit,
}

impl<'a> Claim<'a> {
    /// What to claim of a candidate. A patch of different tissue is found on one field and with a
    /// sharp edge, because that is easier. But such tissue differs in every field. And a sharp edge
    /// is placed so that the sites just inside it fit. So a patch is claimed on every field, with
    /// an edge that is as soft as its place is uncertain.
    ///
    /// # Errors
    /// Why this claim does not predict what was left out.
    pub(super) fn of(
        bench: &Bench<'a>,
        taken: usize,
        fit: &LaplaceFit,
        left: &Left,
    ) -> Result<Self, Refutation> {
        let effects = fields_of_patch(bench, taken);
        if effects.is_empty() {
            let fit = bench.declared(fit).unwrap_or_else(|| fit.clone());
            return Ok(Self { bench: bench.clone(), effects: vec![taken], fit });
        }
        let shared = (effects.len() as f64).sqrt();
        let sharp =
            bench.with(&effects, |candidate| candidate.sd = readable(candidate.sd / shared));
        let patch = Patch { bench: &sharp, taken, effects: &effects, fit };
        let bench = patch.edge().map_or(sharp.clone(), |edge| sharp.with_form(&effects, &edge));
        let fit = patch.fitted(&bench).ok_or(Refutation::NoFitOnEveryField)?.0;
        match bench.refutation(&effects, &fit, left) {
            Some(why) => Err(Refutation::OnEveryField(Box::new(why))),
            None => Ok(Self { bench, effects, fit }),
        }
    }
}

/// The candidates of the same patch, one for each field; the one that was found comes first. Where
/// there is no field, only the one that was found. Empty if the candidate is no patch.
fn fields_of_patch(bench: &Bench<'_>, taken: usize) -> Vec<usize> {
    let found = &bench.candidates[taken];
    if found.edge().is_none() {
        return vec![]; // no patch
    }
    let is_same = |c: &usize| bench.candidates[*c].form == found.form;
    let is_of_field = |c: &usize| bench.candidates[*c].level == Level::Parameter;
    let mut fields: Vec<usize> =
        (0..bench.candidates.len()).filter(is_same).filter(is_of_field).collect();
    fields.sort_by_key(|c| *c != taken);
    if fields.is_empty() { vec![taken] } else { fields }
}

/// A patch that was found on one field, and its effects on every field.
struct Patch<'a> {
    bench: &'a Bench<'a>,
    taken: usize,
    effects: &'a [usize],
    /// The fit with the effect that was found.
    fit: &'a LaplaceFit,
}

impl Patch<'_> {
    /// Centre and scale of the edge: mean and spread of the thresholds that were tried, each
    /// weighted by its evidence.
    fn edge(&self) -> Option<Form> {
        let Above { column, .. } = self.bench.candidates[self.taken].edge()?;
        let least = LEAST_SCALE * mean_and_sd(self.bench.table.column(column)?.numbers()?).1;
        let logistic = |centre, scale| logistic(column, centre, readable(scale));
        let score = |threshold: f64| {
            let soft = self.bench.with_form(self.effects, &logistic(threshold, least));
            self.fitted(&soft).map(|(_, score)| (threshold, score))
        };
        let scored: Vec<(f64, f64)> =
            self.thresholds(column).into_iter().filter_map(score).collect();
        let most = scored.iter().map(|s| s.1).fold(f64::NEG_INFINITY, f64::max);
        let average = |of: &dyn Fn(f64) -> f64| {
            let (sum, total) = scored.iter().fold((0.0, 0.0), |(sum, total), (at, score)| {
                let weight = (score - most).exp();
                (sum + weight * of(*at), total + weight)
            });
            sum / total
        };
        let centre = average(&|at| at);
        // a logistic distribution of scale s has variance (π s)²/3
        let spread = 3.0 * average(&|at| (at - centre).powi(2)) / std::f64::consts::PI.powi(2);
        (!scored.is_empty()).then(|| logistic(readable(centre), (least * least + spread).sqrt()))
    }

    /// The thresholds of the column that were tried on the first of the fields.
    fn thresholds(&self, column: &str) -> Vec<f64> {
        let field = &self.bench.candidates[self.effects[0]];
        let own = self.bench.candidates.iter();
        let own = own.filter(|c| c.cause == field.cause && c.on == field.on);
        let edges = own.filter_map(Candidate::edge).filter(|edge| edge.column == column);
        edges.map(|edge| edge.threshold).collect()
    }

    /// The best fit with the effects of `bench` on every field in the place of the effect that was
    /// found, and its score.
    fn fitted(&self, bench: &Bench<'_>) -> Option<(LaplaceFit, f64)> {
        let others: Vec<usize> =
            self.fit.active.iter().copied().filter(|c| *c != self.taken).collect();
        let active = [&others[..], self.effects].concat();
        let start = bench.engine.fit(&self.fit.outer, &active, Some(self.fit))?;
        bench.optimised(&start, Free::All)
    }
}
