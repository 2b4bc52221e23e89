//! The answer in words.

use super::{FoundEffect, Story, Trouble};
use crate::report::{ErrorChange, PredictionError};
use crate::table::Role;

impl Story {
    /// The answer in one sentence.
    pub fn verdict(&self) -> String {
        let (criticism, model) = (&self.criticism, self.declared.model);
        let outliers = self.outliers().map(|(share, sd)| {
            format!(
                "room for outliers ({:.0} % of the measurements, {sd:.2} further off)",
                100.0 * share
            )
        });
        let of_one_cause = |a: &FoundEffect, b: &FoundEffect| a.cause == b.cause;
        let effects = self.effects.chunk_by(of_one_cause).map(|effects| self.in_words(effects));
        let lacked: Vec<String> = effects.chain(outliers).collect();
        if !lacked.is_empty() {
            return format!("{model} lacks {}.", lacked.join(" and "));
        }
        if let Some([a, b]) = criticism.ambiguous().first() {
            return format!(
                "{model} lacks an effect of {a} or of {b}: these data cannot tell which."
            );
        }
        let n = criticism.candidates.len();
        if criticism.is_unexplained() {
            return format!("{model} lacks something that none of {n} candidate effects explains.");
        }
        if let Some(narrow) = self.narrow() {
            return format!(
                "No effect is missing from {model} that these data could show, but its intervals are too narrow: {narrow}."
            );
        }
        format!("Nothing is missing from {model} that these data could show.")
    }

    /// What the intervals of the model as written hold, if that is too little.
    pub fn narrow(&self) -> Option<String> {
        let narrow = self.narrow.as_ref()?;
        let (share, n, what) = (100.0 * narrow.share, narrow.n, &narrow.what);
        Some(format!("{share:.0} % of {n} {what} lie in their 90 % intervals"))
    }

    /// The effects of one cause in words.
    fn in_words(&self, effects: &[FoundEffect]) -> String {
        if let [found] = effects
            && found.is_scatter()
        {
            let column = found.effect.form.column().unwrap_or_default();
            return format!("scatter that goes with {column} ({})", found.size_in_words());
        }
        let on: Vec<&str> =
            effects.iter().flat_map(|found| &found.effect.on).map(String::as_str).collect();
        let on = on.join(" and ");
        let role = |column: &str| self.loaded.measurements.role(column);
        let form = &effects[0].effect.form;
        match form.column() {
            Some(column) if role(column) == Role::Time => format!("a drift of {on} over {column}"),
            _ => form.in_words(&on),
        }
    }

    /// What no candidate explains.
    pub fn remainder(&self) -> String {
        let ambiguous = self.criticism.ambiguous().into_iter().map(|[a, b]| {
            format!("{a} and {b} explain the same: these data cannot tell them apart.")
        });
        let differences = self.differences().into_iter().map(|(what, log_bf, is_enough)| {
            let shown = (10.0 * log_bf).round() / 10.0 + 0.0; // no −0
            if is_enough {
                format!(
                    "{what} differ by more than the model says (log Bayes factor {shown:.1}), for a reason that is not among the columns."
                )
            } else {
                format!(
                    "{what} differ by no more than the model says (log Bayes factor {shown:.1} for a further difference)."
                )
            }
        });
        let short = self.short().map(|short| format!("The model's own fields are short: {short}."));
        ambiguous.chain(differences).chain(short).collect::<Vec<_>>().join(" ")
    }

    /// The answer in a few lines, for a terminal. What speaks against the fits comes first.
    pub fn text(&self) -> String {
        let criticism = &self.criticism;
        let mut lines: Vec<String> = self.troubles().iter().map(Trouble::text).collect();
        if !lines.is_empty() {
            lines.push(String::new());
        }
        lines.push(self.verdict());
        for found in &self.effects {
            lines.push(format!("found     {}", found.effect.statement()));
            lines.push(format!("          {}", found.size_in_words()));
        }
        for [a, b] in criticism.ambiguous() {
            lines.push(format!("ambiguous {a} or {b}: these data cannot tell"));
        }
        for (what, log_bf) in self.unexplained() {
            lines.push(format!(
                "remains   {} differ by more than the model says (log Bayes factor {log_bf:.1}), for a reason that is not among the columns",
                what.to_lowercase()
            ));
        }
        lines.extend(self.short().map(|short| format!("short     {short}")));
        if let Some(narrow) = self.narrow() {
            lines.push(format!("narrow    as written, {narrow}"));
        }
        lines.extend(self.spread.iter().map(|spread| format!("allowed   {spread}")));
        if let Some(c) = self.comparisons().first() {
            lines.extend(error_lines(c));
        }
        let unusable = criticism.unusable.iter();
        lines.extend(unusable.map(|u| format!("not tried {}: {}", u.column, u.why)));
        lines.extend(self.doubts().into_iter().map(|doubt| format!("doubt     {doubt}")));
        lines.join("\n")
    }
}

/// The errors of predictions: a line for each model, and what the effects gain.
fn error_lines(c: &ErrorChange) -> Vec<String> {
    let line = |which: &str, e: &PredictionError| {
        let (rmse, share) = (e.rmse[0], 100.0 * e.coverage90[0]);
        format!("  {which:<11} rms {rmse:<6.3} {share:.0} % in their 90 % intervals")
    };
    let mut lines = vec![format!("error     of {} {}:", c.n, c.what)];
    let before = if c.declared.is_some() { "before" } else { "as written" };
    lines.extend(c.declared.iter().map(|e| line("as written", e)));
    lines.push(line(before, &c.before));
    let Some(after) = &c.after else { return lines };
    lines.push(line("after", after));
    lines.push(format!("gain      {} in log predictive density from before to after", c.gain()));
    lines
}
