//! A cause that was found, as it will predict.

use super::candidates::{Column, Level, moments, read_column};
use super::fit::Fit;
use super::leave::Left;
use super::observable::readable;
use super::outer::{Free, optimise};
use super::procedure::Run;
use crate::model::Form;

/// Least scale of the edge of a patch, in standard deviations of the distances.
const LEAST_SCALE: f64 = 0.1;

/// What a round claims.
#[derive(Clone, Debug)]
pub(super) struct Claim {
    /// The effects of one cause: candidates, as they are now.
    pub effects: Vec<usize>,
    /// The fit, of which they are the last terms.
    pub fit: Fit,
}

impl Run<'_> {
    /// What to claim of a candidate. One field is enough to find a patch of different tissue, and a sharp edge is found
    /// more easily than a soft one; but such tissue differs in every field, and which sites are just inside an edge
    /// is chosen to fit them. So a patch is claimed on every field, with an edge as soft as its place is uncertain.
    /// `Err` says why this predicts nothing of what was left out.
    pub(super) fn claim(&mut self, taken: usize, fit: Fit, left: &Left) -> Result<Claim, String> {
        let fields = self.fields_of_patch(taken);
        if fields.is_empty() {
            return Ok(Claim { effects: vec![taken], fit });
        }
        let as_tried: Vec<_> = fields
            .iter()
            .map(|c| (self.candidates[*c].clone(), self.engine.terms[*c].clone()))
            .collect();
        for c in &fields {
            let sd = readable(self.candidates[*c].sd / (fields.len() as f64).sqrt());
            self.candidates[*c].sd = sd;
            self.engine.terms[*c].sd = Some(sd);
        }
        let claim = self.on_fields(taken, &fields, &fit, left);
        if claim.is_err() {
            for (c, (candidate, term)) in fields.iter().zip(as_tried) {
                (self.candidates[*c], self.engine.terms[*c]) = (candidate, term);
            }
        }
        claim
    }

    /// The candidates of the same patch on fields, the one that was found first; on what is observed, where there is
    /// no field; none of what is no patch.
    fn fields_of_patch(&self, taken: usize) -> Vec<usize> {
        let found = &self.candidates[taken];
        if !matches!(found.form, Some(Form::Above { .. })) {
            return vec![];
        }
        let is_same = |c: &usize| self.candidates[*c].form == found.form;
        let is_of_field = |c: &usize| self.candidates[*c].level == Level::Parameter;
        let mut fields: Vec<usize> =
            (0..self.candidates.len()).filter(is_same).filter(is_of_field).collect();
        fields.sort_by_key(|c| *c != taken);
        if fields.is_empty() { vec![taken] } else { fields }
    }

    fn on_fields(
        &mut self,
        taken: usize,
        fields: &[usize],
        fit: &Fit,
        left: &Left,
    ) -> Result<Claim, String> {
        if let Some(edge) = self.edge(taken, fields, fit) {
            self.set_form(fields, &edge);
        }
        let (fit, _) =
            self.optimised(taken, fields, fit).ok_or("there is no fit with every field")?;
        match self.refutation(fields, &fit, left) {
            Some(why) => Err(format!("with a soft edge on every field: {why}")),
            None => Ok(Claim { effects: fields.to_vec(), fit }),
        }
    }

    /// The edge of a patch: of the thresholds that were tried, each with its evidence, mean and spread.
    fn edge(&mut self, taken: usize, fields: &[usize], fit: &Fit) -> Option<Form> {
        let Some(Form::Above { column, .. }) = self.candidates[taken].form.clone() else {
            return None;
        };
        let Column::Numeric(x) = read_column(self.case.table, &column) else { return None };
        let least = LEAST_SCALE * moments(&x).1;
        let logistic = |centre, scale| Form::Logistic {
            column: column.clone(),
            centre,
            scale: readable(scale),
        };
        let field = &self.candidates[fields[0]];
        let tried = self.candidates.iter().filter(|c| c.name == field.name && c.on == field.on);
        let thresholds: Vec<f64> = tried
            .filter_map(|c| match &c.form {
                Some(Form::Above { column: own, threshold }) if *own == column => Some(*threshold),
                _ => None,
            })
            .collect();
        let mut scored: Vec<(f64, f64)> = vec![];
        for threshold in thresholds {
            self.set_form(fields, &logistic(threshold, least));
            let fitted = self.optimised(taken, fields, fit);
            scored.extend(fitted.map(|(_, score)| (threshold, score)));
        }
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

    fn set_form(&mut self, fields: &[usize], form: &Form) {
        let (design, _) = form.design(self.case.table);
        for c in fields {
            self.candidates[*c].form = Some(form.clone());
            self.engine.terms[*c].design.clone_from(&design);
        }
    }

    /// The best fit with effects on `fields` in the place of the one that was found.
    fn optimised(&self, taken: usize, fields: &[usize], fit: &Fit) -> Option<(Fit, f64)> {
        let others: Vec<usize> = fit.active.iter().copied().filter(|c| *c != taken).collect();
        let active = [&others[..], fields].concat();
        let start = self.engine.fit(&fit.outer, &active, Some(fit))?;
        optimise(&self.engine, &active, &start, Free::All, self.step)
    }
}
