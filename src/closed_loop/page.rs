//! What `report.html` tells.

use super::contribution::places;
use super::{Story, Trouble};
use crate::criticism::site_name;
use crate::criticism::{Judgement, Record, Round, least_log_bf};
use crate::report::{
    Against, LoopPage, Residuals, SiteResidual, TriedEffect, TriedRound, loop_page,
};

impl Story {
    /// The page. `files` are the files beside it.
    pub fn page(&self, files: &[String]) -> String {
        let criticism = &self.criticism;
        let surface = self.loaded.surface();
        let notes = surface.map_or(&[][..], |s| &s.notes);
        let warnings: Vec<String> = notes.iter().cloned().chain(self.doubts()).collect();
        let not_tried: Vec<[String; 2]> =
            criticism.unusable.iter().map(|u| [u.column.clone(), u.why.clone()]).collect();
        let rounds = criticism.rounds.iter().enumerate();
        let effects = self.effects.iter().map(super::FoundEffect::size_in_words);
        loop_page(&LoopPage {
            model: self.declared.model,
            data: &self.loaded.measurements.file_name(),
            troubles: &self.troubles().iter().map(Trouble::text).collect::<Vec<_>>(),
            verdict: &self.verdict(),
            narrow: self.narrow().as_deref(),
            spread: &self.spread,
            effects: &effects.collect::<Vec<_>>(),
            before: &self.declared.equations,
            after: self.after.as_ref().or(self.before.as_ref()).map(|fit| fit.equations.as_str()),
            is_found: self.after.is_some(),
            comparisons: &self.comparisons(),
            rounds: &rounds.map(|(i, round)| self.tried(i, round)).collect::<Vec<_>>(),
            residuals: Residuals {
                unit: &self.declared.unit,
                mesh: surface.map(|s| &s.mesh),
                sites: &self.site_residuals(),
                against: self.against().as_ref(),
                field: &self.field(),
            },
            unexplained: &self.remainder(),
            not_tried: &not_tried,
            warnings: &warnings,
            files,
        })
    }

    fn tried(&self, number: usize, round: &Round) -> TriedRound {
        let one = |t: &Record| {
            let candidate = &self.criticism.candidates[t.candidate];
            TriedEffect {
                name: candidate.cause.to_string(),
                statement: t.form.as_ref().map_or("every likelihood".into(), |form| {
                    format!("{} on {}", form.rounded(), candidate.on.join(", "))
                }),
                p_screen: t.p_screen,
                log_bf: t.log_bf,
                p_null: t.p_null,
                verdict: t.verdict(),
                is_taken: t.judgement == Judgement::Found,
            }
        };
        TriedRound {
            claim: least_log_bf(number),
            nulls: round.nulls.clone(),
            tried: round.tried.iter().map(one).collect(),
        }
    }

    /// Mean residual of each site, where it is closed.
    pub(super) fn site_residuals(&self) -> Vec<SiteResidual> {
        let (engine, table) = (&self.criticism.engine, &self.loaded.measurements);
        let residuals = self.left.residuals(&self.criticism);
        let mesh = self.loaded.surface().map(|surface| &surface.mesh);
        let one = |rows: &Vec<usize>| {
            let first = engine.table_row(*rows.first()?);
            let name = site_name(table, first);
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

    /// What each measurement leaves over, without and with the effect, against the column that the
    /// effect reads; and the effect itself. *Without* is what everything else in the model after
    /// does not predict. So the effect shows even where another part of the model before has taken
    /// it up.
    pub(super) fn against(&self) -> Option<Against> {
        let contribution = self.contribution.as_ref()?;
        let name = contribution.column.as_deref()?; // a field has none
        let engine = &self.criticism.engine;
        let (places, labels) = places(&self.loaded.measurements, name);
        let left = self.left_units.as_ref().unwrap_or(&self.left);
        let rows = left.residuals(&self.criticism).into_iter().enumerate();
        let rows = rows.map(|(row, [_, after])| {
            let at = engine.table_row(row);
            let effect = contribution.rows.get(&at).copied().unwrap_or(0.0);
            // side by side, where rows share a label
            let aside = if labels.is_empty() { 0.0 } else { 0.03 * ((row % 11) as f64 - 5.0) };
            (places.get(at).copied().unwrap_or(f64::NAN) + aside, after + effect, after)
        });
        let rows: Vec<(f64, f64, f64)> = rows.collect();
        let ticks = if labels.is_empty() {
            let x = || rows.iter().map(|row| row.0).filter(|x| x.is_finite());
            let (low, high) =
                (x().fold(f64::INFINITY, f64::min), x().fold(f64::NEG_INFINITY, f64::max));
            vec![(low, plain(low)), (high, plain(high))]
        } else {
            labels.iter().enumerate().map(|(i, label)| (i as f64, label.clone())).collect()
        };
        let curve = contribution.curve.iter().map(|point| (point.x, point.quantiles));
        Some(Against {
            column: name.to_owned(),
            rows,
            ticks,
            curve: curve.collect(),
            labels,
            unit: self.declared.unit.clone(),
        })
    }

    /// The effect at each site, if it is a field.
    fn field(&self) -> Vec<SiteResidual> {
        let Some(contribution) = self.contribution.as_ref().filter(|c| c.column.is_none()) else {
            return vec![];
        };
        let engine = &self.criticism.engine;
        let mut sites = self.site_residuals();
        let first = engine.sites.iter().filter_map(|rows| rows.first());
        for (site, row) in sites.iter_mut().zip(first) {
            let value = contribution.rows.get(&engine.table_row(*row));
            site.after = value.copied().unwrap_or(f64::NAN);
        }
        sites
    }
}

/// A number with four digits at most.
fn plain(x: f64) -> String {
    let x: f64 = format!("{x:.3e}").parse().unwrap_or(x);
    x.to_string().replace('-', "−")
}
