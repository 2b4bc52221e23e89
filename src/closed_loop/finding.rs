//! `finding.json`.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use super::score::as_json;
use super::{HeldOut, Story};
use crate::criticism::{Record, Round};
use crate::model::Form;
use crate::report::{Against, SiteResidual};

impl Story {
    /// Everything that was found, in the shape of `finding.json`.
    pub fn finding(&self) -> Value {
        let criticism = &self.criticism;
        let rounds = criticism.rounds.iter().enumerate();
        let tried: Vec<Value> = rounds.flat_map(|(i, round)| self.tried_json(i, round)).collect();
        let pairs = criticism.rounds.iter().filter_map(|round| round.pair);
        let cause = |candidate: usize| criticism.candidates[candidate].cause.to_string();
        let pairs =
            pairs.map(|(pair, log_bf)| json!({ "effects": pair.map(cause), "log_bf": log_bf }));
        let unusable = criticism.unusable.iter();
        let unusable: Vec<Value> =
            unusable.map(|u| json!({ "column": u.column, "why": u.why })).collect();
        let warnings: Vec<Value> = self
            .warnings()
            .map(|w| json!({ "check": w.check, "column": w.column, "text": w.text }))
            .collect();
        let held_out = self.held_out.as_ref().and_then(HeldOut::comparison);
        let units = self.left_units.as_ref().map(|left| {
            let mut figures = as_json(&left.comparison(criticism));
            figures["unit"] = json!(left.unit);
            figures
        });
        let fits = self.fits().map(|told| {
            let verdict = json!({
                "colour": told.verdict.colour(), "questions": told.verdict.answers,
            });
            (told.which, verdict)
        });
        let troubles = self.troubles();
        let troubles: Vec<String> = troubles.iter().map(super::Trouble::text).collect();
        json!({
            "doubtful": troubles,
            "fits": fits.collect::<BTreeMap<_, _>>(),
            "as_written_too_narrow": self.narrow(),
            "discrepancy": self.discrepancy.statements(),
            "findings": names(criticism.findings()),
            "ambiguous": criticism.ambiguous().into_iter().map(names).collect::<Vec<_>>(),
            "unexplained": criticism.is_unexplained(),
            "effect_interval": self.intervals(),
            "effect_curve": self.against().as_ref().map(curve),
            "residuals": {
                "unit": self.declared.unit,
                "sites": self.site_residuals().iter().map(residual).collect::<Vec<_>>(),
            },
            "heldout": held_out.as_ref().map_or(Value::Null, as_json),
            "leave_one_site_out": as_json(&self.left.comparison(criticism)),
            "leave_one_unit_out": units,
            "data": self.loaded.measurements.file_name(),
            "nulls": criticism.rounds.iter().map(|r| r.nulls.clone()).collect::<Vec<_>>(),
            "site_log_bf": criticism.site_log_bf,
            "finer_log_bf": criticism.finer_log_bf,
            "unit_log_bf": criticism.unit_log_bf.as_ref().map(|(_, log_bf)| log_bf),
            "not_tried": unusable,
            "warnings": warnings,
            "tried": tried,
            "pairs": pairs.collect::<Vec<_>>(),
        })
    }

    /// The interval of each effect. The first effect of a finding is named after the finding,
    /// further effects after themselves.
    fn intervals(&self) -> BTreeMap<String, [f64; 2]> {
        let mut intervals = BTreeMap::new();
        for found in &self.effects {
            let cause = found.cause.to_string();
            let is_first = !intervals.contains_key(&cause);
            let name = if is_first { cause } else { found.effect.name.clone() };
            intervals.insert(name, found.size.interval);
        }
        intervals
    }

    fn tried_json(&self, number: usize, round: &Round) -> Vec<Value> {
        let one = |t: &Record| {
            let candidate = &self.criticism.candidates[t.candidate];
            json!({
                "round": number + 1,
                "effect": candidate.cause.to_string(),
                "on": candidate.on,
                "form": t.form.as_ref().map_or("Outliers".into(), Form::text),
                "p_screen": t.p_screen,
                "log_bf": t.log_bf.is_finite().then_some(t.log_bf),
                "p_null": t.p_null,
                "verdict": t.verdict(),
            })
        };
        round.tried.iter().map(one).collect()
    }
}

/// What an effect adds along its column, and what each measurement leaves over there.
fn curve(against: &Against) -> Value {
    let points = against.curve.iter();
    let points =
        points.map(|(x, [q5, q50, q95])| json!({ "x": x, "q5": q5, "q50": q50, "q95": q95 }));
    let rows = against.rows.iter();
    let rows = rows.map(|(x, without, with)| json!({ "x": x, "without": without, "with": with }));
    json!({
        "column": against.column,
        "unit": against.unit,
        "labels": against.labels,
        "points": points.collect::<Vec<_>>(),
        "rows": rows.collect::<Vec<_>>(),
    })
}

fn residual(site: &SiteResidual) -> Value {
    json!({ "site": site.name, "at": site.at, "before": site.before, "after": site.after })
}

fn names<'c>(causes: impl IntoIterator<Item = &'c crate::criticism::Cause>) -> Vec<String> {
    causes.into_iter().map(ToString::to_string).collect()
}
