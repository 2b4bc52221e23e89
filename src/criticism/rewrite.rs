//! The augmented model as a model file: the user's own text with the effects that were found.

use eplat_language::{File, Mistake};

use crate::model::AddedEffect;

/// `source` with these effects declared at the end of its model, each under a line that says why, and its
/// likelihoods within `Outliers(…, share, sd)` if there are outliers.
///
/// # Errors
/// A text that is no model file, or an effect that cannot be written: of a column whose name is none.
pub fn rewrite(
    source: &str,
    effects: &[(AddedEffect, String)],
    outliers: Option<(f64, f64)>,
) -> Result<String, Mistake> {
    let written = effects.iter().map(|(effect, why)| (effect.statement(), why.clone()));
    let written: Vec<(String, String)> = written.collect();
    File::read(source)?.with_effects(source, &written, outliers)
}
