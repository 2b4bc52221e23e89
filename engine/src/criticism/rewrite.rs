//! The augmented model as a model file: the user's own text with what was found.

use eplat_language::{Added, File, Mistake};

use crate::model::{AddedEffect, Discrepancy};

/// What is written into a model file.
#[derive(Clone, Debug, Default)]
pub struct Findings {
    /// What measurements differ by for reasons that no column tells.
    pub discrepancy: Discrepancy,
    /// Effects, each with a line that says why.
    pub effects: Vec<(AddedEffect, String)>,
    /// Share and sd of outliers.
    pub outliers: Option<(f64, f64)>,
}

/// `source` with these findings:
///
/// - what sites differ by, and effects, are declared at the end of its model, each under a line
///   that says why;
/// - a further error of rows is declared before its first `observe`, whose likelihood is put within
///   `Widened(…)`, and so is the `let` by which that error goes with a column;
/// - if there are outliers, likelihoods are put within `Outliers(…, share, sd)`.
///
/// # Errors
/// The text is no model file, or an effect cannot be written because the name of its column is no
/// name in a model file.
pub fn rewrite(source: &str, findings: &Findings) -> Result<String, Mistake> {
    let Findings { discrepancy, effects, outliers } = findings;
    let mut added = Added { outliers: *outliers, ..Added::default() };
    for error in &discrepancy.row_errors {
        added.statements.push((error.statement(), error.why.clone()));
        added.row_errors.extend(error.of_observes());
    }
    let why =
        "Added by `eplat loop`: ln of a factor of that error, by which scatter goes with a column.";
    for scatter in discrepancy.scatter() {
        added.statements.push((scatter, why.into()));
    }
    for spread in &discrepancy.spreads {
        let [sd, effect] = spread.statements();
        added.statements.push((sd, spread.why.clone()));
        added.statements.push((effect, String::new()));
    }
    added.statements.extend(effects.iter().map(|(e, why)| (e.statement(), why.clone())));
    File::read(source)?.with_added(source, &added)
}
