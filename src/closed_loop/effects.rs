//! What was found, as effects that a model file declares.

use eplat_language::syntax::Item;

use super::LoopError;
use super::discrepancy::scatter_on;
use super::sizes::Size;
use crate::criticism::{Cause, Criticism};
use crate::model::{AddedEffect, Declare, Model};
use crate::table::Measurements;

/// Prior sd of the coefficients of scatter: errors e times as large or as small.
const SD_OF_SCATTER: f64 = 1.0;

/// An effect that was found.
#[derive(Clone, Debug)]
pub struct FoundEffect {
    /// The cause that it stands for. A cause may have several effects.
    pub cause: Cause,
    /// The effect as the model file declares it.
    pub effect: AddedEffect,
    /// Why it is there, one sentence.
    pub why: String,
    /// How large it is.
    pub size: Size,
}

impl FoundEffect {
    /// Whether it moves nothing that is predicted, but is ln of a factor of the measurements' error.
    pub fn is_scatter(&self) -> bool {
        matches!(self.cause, Cause::Hetero(_))
    }

    /// Its size in words.
    pub(super) fn size_in_words(&self) -> String {
        if !self.is_scatter() {
            return self.size.in_words(&self.effect);
        }
        let [low, high] = self.size.interval.map(f64::exp);
        format!("errors {low:.1} to {high:.1} times as large {} (90 % interval)", self.size.of)
    }
}

/// What was found, as effects with names of their own. Each has its cause and a sentence that says
/// why it is there.
pub(super) fn found(
    declared: &dyn Declare,
    criticism: &Criticism,
    table: &Measurements,
) -> Result<Vec<(AddedEffect, Cause, String)>, LoopError> {
    let tree = Model::outline(declared)?.syntax().ok();
    let on_scatter = tree.as_ref().map_or_else(String::new, |tree| scatter_on(tree, table));
    let items: Vec<&Item> =
        tree.iter().flat_map(|tree| &tree.statements).map(|s| &s.item).collect();
    let item_of = |name: &str| items.iter().find(|item| item.name() == name);
    let unit_of = |name: &str| {
        let unit = item_of(name).and_then(|item| item.unit());
        unit.map_or_else(String::new, |unit| unit.text.clone())
    };
    let mut effects: Vec<(AddedEffect, Cause, String)> = vec![];
    for round in &criticism.rounds {
        let log_bf = round.taken().map_or(f64::NAN, |taken| taken.log_bf);
        for (k, candidate) in round.claimed.iter().enumerate() {
            let found = &criticism.candidates[*candidate];
            let Some(form) = found.form.clone() else { continue };
            let (on, sd) = if found.is_scatter() {
                (vec![on_scatter.clone()], SD_OF_SCATTER)
            } else {
                (found.on.clone(), found.sd)
            };
            let mut name = found.cause.name();
            if k > 0 {
                name = format!("{name}_{}", on.join("_"));
            }
            while item_of(&name).is_some() || effects.iter().any(|(e, ..)| e.name == name) {
                name += "_effect";
            }
            let data = table.file_name();
            let why = format!("Found by `eplat loop` in {data}: log Bayes factor {log_bf:.1}.");
            let unit = unit_of(&on[0]);
            let effect = AddedEffect { name, on, unit, form, sd };
            effects.push((effect, found.cause.clone(), why));
        }
    }
    Ok(effects)
}
