//! What was found, as effects that a model file declares.

use eplat_language::syntax::Item;

use super::LoopError;
use super::sizes::Size;
use crate::criticism::{Cause, Criticism};
use crate::model::{AddedEffect, Declare, Model};
use crate::table::Measurements;

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

/// What was found, as effects with names of their own. Each has its cause and a sentence that says
/// why it is there.
pub(super) fn found(
    declared: &dyn Declare,
    criticism: &Criticism,
    table: &Measurements,
) -> Result<Vec<(AddedEffect, Cause, String)>, LoopError> {
    let tree = Model::outline(declared)?.syntax();
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
            // scatter moves nothing that an effect could add to
            let form = found.form.clone().filter(|_| !found.is_scatter());
            let Some(form) = form else { continue };
            let (on, sd) = (found.on.clone(), found.sd);
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
