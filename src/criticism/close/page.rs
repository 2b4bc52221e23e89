//! What `report.html` tells.

use super::Story;
use crate::criticism::{Judgement, Record, Round, least_log_bf, site_column};
use crate::report::{
    Against, LoopPage, Residuals, SiteResidual, TriedEffect, TriedRound, loop_page,
};

impl Story {
    /// The page, with `files` as those beside it.
    pub fn page(&self, files: &[String]) -> String {
        let criticism = &self.criticism;
        let surface = self.loaded.surface();
        let notes = surface.map_or(&[][..], |s| &s.notes);
        let warnings: Vec<String> = notes.iter().cloned().chain(self.doubts()).collect();
        let not_tried: Vec<[String; 2]> =
            criticism.unusable.iter().map(|u| [u.column.clone(), u.why.clone()]).collect();
        let rounds = criticism.rounds.iter().enumerate();
        let effects = self.effects.iter().map(|found| found.size.in_words(&found.effect));
        loop_page(&LoopPage {
            model: self.before.model,
            data: &self.loaded.measurements.file_name(),
            verdict: &self.verdict(),
            effects: &effects.collect::<Vec<_>>(),
            before: &self.before.equations,
            after: self.after.as_ref().map(|after| after.equations.as_str()),
            comparisons: &self.comparisons(),
            rounds: &rounds.map(|(i, round)| self.tried(i, round)).collect::<Vec<_>>(),
            residuals: Residuals {
                unit: &self.before.unit,
                mesh: surface.map(|s| &s.mesh),
                sites: &self.site_residuals(),
                against: self.against().as_ref(),
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
                verdict: t.judgement.to_string(),
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
    fn site_residuals(&self) -> Vec<SiteResidual> {
        let (engine, table) = (&self.criticism.engine, &self.loaded.measurements);
        let residuals = self.left.residuals(&self.criticism);
        let mesh = self.loaded.surface().map(|surface| &surface.mesh);
        let one = |rows: &Vec<usize>| {
            let first = engine.table_row(*rows.first()?);
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
        let first = &self.effects.first()?.effect;
        let name = first.form.column().unwrap_or("protocol");
        let column = self.loaded.measurements.column(name)?; // a field has none
        let engine = &self.criticism.engine;
        let rows = (0..engine.rows.len()).map(|row| engine.table_row(row));
        let mut labels = column.labels();
        labels.sort_unstable();
        let x: Vec<f64> = match column.numbers() {
            Some(numbers) => rows.map(|row| numbers[row]).collect(),
            None => rows
                .map(|row| labels.iter().position(|l| l == column.text(row)))
                .map(|label| label.map_or(f64::NAN, |label| label as f64))
                // side by side, where rows share a label
                .enumerate()
                .map(|(i, label)| label + 0.03 * ((i % 11) as f64 - 5.0))
                .collect(),
        };
        let ticks = if column.numbers().is_some() {
            let finite = || x.iter().copied().filter(|x| x.is_finite());
            let low = finite().fold(f64::INFINITY, f64::min);
            let high = finite().fold(f64::NEG_INFINITY, f64::max);
            vec![(low, format!("{low}")), (high, format!("{high}"))]
        } else {
            labels.iter().enumerate().map(|(i, label)| (i as f64, label.clone())).collect()
        };
        let residuals = self.left.residuals(&self.criticism);
        let rows = x.iter().zip(&residuals).map(|(x, [before, after])| (*x, *before, *after));
        Some(Against { column: name.to_owned(), rows: rows.collect(), ticks })
    }
}
