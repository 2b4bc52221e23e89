//! What the loop came to: `finding.json`, the lines on stdout and what `report.html` tells.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use super::predictions::{Heldout, LeftOut, as_json};
use super::sizes::Size;
use super::{Sampling, name_of};
use crate::criticism::{CLAIM, Outcome, Round, Warning, least_log_bf, site_column};
use crate::error::Failure;
use crate::model::{AddedEffect, Form, equations};
use crate::report::{
    Against, Comparison, LoopPage, ReportError, Residuals, SiteResidual, TriedEffect, TriedRound,
};

/// What there is to tell.
pub(super) struct Story<'a> {
    pub(super) outcome: &'a Outcome,
    /// What was found, and why each is there.
    pub(super) effects: &'a [(AddedEffect, String)],
    pub(super) inputs: &'a crate::run::Loaded,
    pub(super) before: &'a Sampling<'a>,
    pub(super) after: Option<&'a Sampling<'a>>,
    pub(super) heldout: Option<&'a Heldout>,
    pub(super) left: LeftOut,
    /// Where something other than the site is left out as a whole.
    pub(super) left_units: Option<LeftOut>,
}

impl Story<'_> {
    pub(super) fn finding(&self) -> Value {
        let outcome = self.outcome;
        let rounds = outcome.rounds.iter().enumerate();
        let tried = rounds.flat_map(|(i, round)| self.tried_json(i, round));
        let unusable: Vec<Value> =
            outcome.unusable.iter().map(|u| json!({ "column": u.column, "why": u.why })).collect();
        let warnings: Vec<Value> = self
            .warnings()
            .map(|w| json!({ "check": w.check, "column": w.column, "text": w.text }))
            .collect();
        let heldout = self.heldout.and_then(Heldout::comparison);
        let units = self.left_units.as_ref().map(|left| {
            let mut figures = as_json(&left.comparison(outcome));
            figures["unit"] = json!(left.unit);
            figures
        });
        json!({
            "findings": outcome.findings(),
            "ambiguous": outcome.ambiguous,
            "unexplained": outcome.is_unexplained(),
            "effect_interval": self.intervals(),
            "heldout": heldout.as_ref().map_or(Value::Null, as_json),
            "leave_one_site_out": as_json(&self.left.comparison(outcome)),
            "leave_one_unit_out": units,
            "data": name_of(&self.inputs.measurements),
            "nulls": outcome.rounds.iter().map(|r| r.nulls.clone()).collect::<Vec<_>>(),
            "site_log_bf": outcome.site_log_bf,
            "unit_log_bf": outcome.unit_log_bf.as_ref().map(|(_, log_bf)| log_bf),
            "not_tried": unusable,
            "warnings": warnings,
            "tried": tried.collect::<Vec<_>>(),
        })
    }

    /// The interval of each effect: by the finding's name, of its further effects by their own.
    fn intervals(&self) -> BTreeMap<&str, [f64; 2]> {
        let found = self.outcome.found.iter().map(|f| &self.outcome.candidates[*f]);
        let mut intervals = BTreeMap::new();
        let effects = self.effects.iter().zip(found.filter(|c| c.form.is_some()));
        for (((effect, _), c), size) in effects.zip(&self.sizes()) {
            let is_first = !intervals.contains_key(c.name.as_str());
            intervals.insert(if is_first { &c.name[..] } else { &effect.name }, size.interval);
        }
        intervals
    }

    fn tried_json(&self, number: usize, round: &Round) -> Vec<Value> {
        let one = |t: &crate::criticism::Record| {
            let candidate = &self.outcome.candidates[t.candidate];
            json!({
                "round": number + 1,
                "effect": candidate.name,
                "on": candidate.on,
                "form": t.form.as_ref().map_or("Outliers".into(), Form::text),
                "p_screen": t.p_screen,
                "log_bf": t.log_bf.is_finite().then_some(t.log_bf),
                "p_null": t.p_null,
                "verdict": t.verdict,
            })
        };
        round.tried.iter().map(one).collect()
    }

    /// The errors that count, first: those of held-out measurements, else of what was left out as a whole.
    fn comparisons(&self) -> Vec<Comparison> {
        let heldout = self.heldout.and_then(Heldout::comparison);
        let left = self.left_units.iter().chain([&self.left]);
        heldout.into_iter().chain(left.map(|left| left.comparison(self.outcome))).collect()
    }

    /// Share and sd of outliers, if these were found.
    fn outliers(&self) -> Option<(f64, f64)> {
        self.outcome.last.outer.outliers
    }

    /// The answer in one sentence.
    fn verdict(&self) -> String {
        let (outcome, model) = (self.outcome, self.before.fit.model().name);
        let outliers = self.outliers().map(|(share, sd)| {
            format!(
                "room for outliers ({:.0} % of the measurements, {sd:.2} further off)",
                100.0 * share
            )
        });
        let of_one_cause =
            |a: &(AddedEffect, String), b: &(AddedEffect, String)| a.0.form == b.0.form;
        let effects = self.effects.chunk_by(of_one_cause).map(in_words);
        let lacked: Vec<String> = effects.chain(outliers).collect();
        if !lacked.is_empty() {
            return format!("{model} lacks {}.", lacked.join(" and "));
        }
        if let Some([a, b]) = outcome.ambiguous.first() {
            return format!(
                "{model} lacks an effect of {a} or of {b}: these data cannot tell which."
            );
        }
        let n = outcome.candidates.len();
        if outcome.is_unexplained() {
            return format!("{model} lacks something that none of {n} candidate effects explains.");
        }
        format!("Nothing is missing from {model} that these data could show.")
    }

    /// What no candidate explains.
    fn unexplained(&self) -> String {
        let outcome = self.outcome;
        let mut sentences: Vec<String> = outcome
            .ambiguous
            .iter()
            .map(|[a, b]| {
                format!("{a} and {b} explain the same: these data cannot tell them apart.")
            })
            .collect();
        for (what, log_bf) in self.differences() {
            let shown = (10.0 * log_bf).round() / 10.0 + 0.0; // no −0
            sentences.push(if log_bf > CLAIM {
                format!(
                    "{what} differ by more than the model says (log Bayes factor {shown:.1}), for a reason that is not among the columns."
                )
            } else {
                format!(
                    "{what} differ by no more than the model says (log Bayes factor {shown:.1} for a further difference)."
                )
            });
        }
        sentences.join(" ")
    }

    /// What may differ by more than the model with its findings says, and the evidence that it does.
    fn differences(&self) -> Vec<(String, f64)> {
        let units =
            self.outcome.unit_log_bf.iter().map(|(name, bf)| (format!("Units of `{name}`"), *bf));
        [("Sites".to_owned(), self.outcome.site_log_bf)].into_iter().chain(units).collect()
    }

    /// The lines on stdout.
    pub(super) fn text(&self) -> String {
        let outcome = self.outcome;
        let mut lines = vec![self.verdict()];
        lines.extend(
            self.effects.iter().map(|(effect, _)| format!("found     {}", effect.statement())),
        );
        for [a, b] in &outcome.ambiguous {
            lines.push(format!("ambiguous {a} or {b}: these data cannot tell"));
        }
        for (what, log_bf) in self.differences().into_iter().filter(|(_, bf)| *bf > CLAIM) {
            lines.push(format!(
                "remains   {} differ by more than the model says (log Bayes factor {log_bf:.1}), for a reason that is not among the columns",
                what.to_lowercase()
            ));
        }
        for c in self.comparisons().iter().take(1) {
            let after = c.after.unwrap_or(c.before);
            lines.push(format!(
                "error     rms {:.2} → {:.2}, elpd {:+.1} ± {:.1}, 90 % intervals cover {:.0} → {:.0} % of {} {}",
                c.before.rmse[0],
                after.rmse[0],
                c.elpd_gain[0],
                c.elpd_gain[1],
                100.0 * c.before.coverage90[0],
                100.0 * after.coverage90[0],
                c.n,
                c.what
            ));
        }
        lines.extend(outcome.unusable.iter().map(|u| format!("not tried {}: {}", u.column, u.why)));
        lines.extend(self.doubts().into_iter().map(|doubt| format!("doubt     {doubt}")));
        lines.join("\n")
    }

    /// What the checks of both tables say.
    fn warnings(&self) -> impl Iterator<Item = &Warning> {
        self.outcome.warnings.iter().chain(self.heldout.iter().flat_map(|h| &h.doubts))
    }

    /// Doubts about the tables.
    fn doubts(&self) -> Vec<String> {
        let table = &self.inputs.measurements;
        let mut doubts: Vec<String> = self.warnings().map(|warning| warning.text.clone()).collect();
        let mut columns: Vec<&str> =
            self.effects.iter().filter_map(|(effect, _)| effect.form.column()).collect();
        columns.dedup();
        for column in columns {
            if self.heldout.is_some_and(|h| h.missing.iter().any(|c| c == column)) {
                doubts.push(format!(
                    "the held-out table has no column {column}: its rows are predicted without the effect"
                ));
            }
            let empty =
                (0..table.len()).filter(|r| table.cell(*r, column).unwrap_or_default().is_empty());
            let n = empty.count();
            if n > 0 {
                doubts.push(format!(
                    "{column} is empty in {n} of {} rows: the effect is 0 there",
                    table.len()
                ));
            }
        }
        doubts
    }

    /// Builds the page, and hands it to `write`.
    pub(super) fn page(
        &self,
        files: &[String],
        write: impl Fn(&LoopPage<'_>) -> Result<(), ReportError>,
    ) -> Result<(), Failure> {
        let outcome = self.outcome;
        let surface = self.inputs.surface();
        let notes = surface.map_or(&[][..], |s| &s.notes);
        let warnings: Vec<String> = notes.iter().cloned().chain(self.doubts()).collect();
        let after = self.after.map(|after| equations(after.fit.model()));
        let observe = self.before.fit.model().statements.iter().find(|s| s.keyword == "observe");
        let not_tried: Vec<[String; 2]> =
            outcome.unusable.iter().map(|u| [u.column.clone(), u.why.clone()]).collect();
        let rounds = outcome.rounds.iter().enumerate();
        Ok(write(&LoopPage {
            model: self.before.fit.model().name,
            data: &name_of(&self.inputs.measurements),
            verdict: &self.verdict(),
            effects: &self.in_words(),
            before: &equations(self.before.fit.model()),
            after: after.as_deref(),
            comparisons: &self.comparisons(),
            rounds: &rounds.map(|(i, round)| self.tried(i, round)).collect::<Vec<_>>(),
            residuals: Residuals {
                unit: observe.map_or("", |o| o.decl.unit),
                mesh: surface.map(|s| &s.mesh),
                sites: &self.site_residuals(),
                against: self.against().as_ref(),
            },
            unexplained: &self.unexplained(),
            not_tried: &not_tried,
            warnings: &warnings,
            files,
        })?)
    }

    fn sizes(&self) -> Vec<Size> {
        let size = |after| self.effects.iter().map(move |(e, _)| Size::of(e, after, self.inputs));
        self.after.map_or(vec![], |after| size(after).collect())
    }

    /// The size of each effect in words.
    fn in_words(&self) -> Vec<String> {
        let sizes = self.sizes();
        self.effects.iter().zip(&sizes).map(|((effect, _), size)| size.in_words(effect)).collect()
    }

    fn tried(&self, number: usize, round: &Round) -> TriedRound {
        let one = |(i, t): (usize, &crate::criticism::Record)| {
            let candidate = &self.outcome.candidates[t.candidate];
            TriedEffect {
                name: candidate.name.clone(),
                statement: t.form.as_ref().map_or("every likelihood".into(), |form| {
                    format!("{} on {}", rounded(form), candidate.on.join(", "))
                }),
                p_screen: t.p_screen,
                log_bf: t.log_bf,
                p_null: t.p_null,
                verdict: t.verdict.clone(),
                is_taken: round.taken == Some(i),
            }
        };
        TriedRound {
            claim: least_log_bf(number),
            nulls: round.nulls.clone(),
            tried: round.tried.iter().enumerate().map(one).collect(),
        }
    }

    /// Mean residual of each site, where it is closed.
    fn site_residuals(&self) -> Vec<SiteResidual> {
        let (engine, table) = (&self.outcome.engine, &self.inputs.measurements);
        let residuals = self.left.residuals(self.outcome);
        let mesh = self.inputs.surface().map(|surface| &surface.mesh);
        let one = |rows: &Vec<usize>| {
            let first = engine.model.table_row(engine.rows[*rows.first()?].id);
            let column = site_column(table);
            let name = column.and_then(|c| table.cell(first, c)).map_or_else(
                || format!("line {}", table.line(first)),
                |cell| format!("{} {cell}", column.unwrap_or_default()),
            );
            let mean = |k: usize| {
                let own = rows.iter().map(|r| residuals[*r][k]).filter(|v| v.is_finite());
                let own: Vec<f64> = own.collect();
                own.iter().sum::<f64>() / own.len() as f64
            };
            let at = mesh.zip(table.vertex(first)).map(|(m, v)| m.vertices()[v as usize]);
            Some(SiteResidual { name, at, before: mean(0), after: mean(1) })
        };
        engine.sites.iter().filter_map(one).collect()
    }

    /// Residuals of rows against the column of the first effect; labels stand side by side.
    fn against(&self) -> Option<Against> {
        let (engine, table) = (&self.outcome.engine, &self.inputs.measurements);
        let (first, _) = self.effects.first()?;
        let column = first.form.column().unwrap_or("protocol").to_owned();
        if !table.has(&column) {
            return None; // a field
        }
        let text = |row: usize| table.cell(row, &column).unwrap_or_default();
        let cells: Vec<&str> =
            engine.rows.iter().map(|row| text(engine.model.table_row(row.id))).collect();
        let is_numeric = cells.iter().all(|c| c.is_empty() || c.parse::<f64>().is_ok());
        let mut labels = cells.clone();
        labels.sort_unstable();
        labels.dedup();
        let x = |cell: &str| {
            if is_numeric {
                return cell.parse().unwrap_or(f64::NAN);
            }
            labels.iter().position(|label| *label == cell).unwrap_or_default() as f64
        };
        let residuals = self.left.residuals(self.outcome);
        // side by side, where rows share a label
        let aside = |i: usize| if is_numeric { 0.0 } else { 0.03 * ((i % 11) as f64 - 5.0) };
        let rows: Vec<(f64, f64, f64)> = cells
            .iter()
            .zip(&residuals)
            .enumerate()
            .map(|(i, (cell, [before, after]))| (x(cell) + aside(i), *before, *after))
            .collect();
        let ticks = if is_numeric {
            let xs = || rows.iter().map(|r| r.0).filter(|x| x.is_finite());
            let (low, high) =
                (xs().fold(f64::INFINITY, f64::min), xs().fold(f64::NEG_INFINITY, f64::max));
            vec![(low, format!("{low}")), (high, format!("{high}"))]
        } else {
            labels.iter().enumerate().map(|(i, label)| (i as f64, (*label).to_owned())).collect()
        };
        Some(Against { column, rows, ticks })
    }
}

/// The effects of one cause in words.
fn in_words(effects: &[(AddedEffect, String)]) -> String {
    let on: Vec<&str> = effects.iter().flat_map(|(e, _)| &e.on).map(String::as_str).collect();
    let on = on.join(" and ");
    match &effects[0].0.form {
        Form::Surface { .. } => format!("a field over the surface in {on}"),
        Form::Path { .. } => format!("a slowness that varies along the paths, in {on}"),
        form => match form.column() {
            Some(column) => format!("an effect of {column} on {on}"),
            None => format!("an offset of {on}"),
        },
    }
}

/// A form with its numbers rounded for reading.
fn rounded(form: &Form) -> String {
    match form {
        Form::Scaled { column, centre, scale } => {
            format!("scaled({column}, {centre:.3}, {scale:.3})")
        }
        Form::Smooth { column, low, high, degree } => {
            format!("smooth({column}, {low:.3}, {high:.3}, {degree})")
        }
        Form::Above { column, threshold } => format!("above({column}, {threshold:.3})"),
        Form::Logistic { column, centre, scale } => {
            format!("logistic({column}, {centre:.3}, {scale:.3})")
        }
        Form::Surface { .. }
        | Form::Path { .. }
        | Form::Group { .. }
        | Form::Family { .. }
        | Form::All => form.text().replace("row.", ""),
    }
}
