//! What was found, as effects that a model file declares.

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

/// What was found as effects with names of their own, each with its cause and why it is there.
pub(super) fn found(
    declared: &dyn Declare,
    criticism: &Criticism,
    table: &Measurements,
) -> Result<Vec<(AddedEffect, Cause, String)>, LoopError> {
    let outline = Model::outline(declared)?;
    let unit_of = |name: &str| {
        let statement = outline.statements.iter().find(|s| s.decl.name == name);
        statement.map(|s| s.decl.unit.to_string()).unwrap_or_default()
    };
    let mut effects: Vec<(AddedEffect, Cause, String)> = vec![];
    for round in &criticism.rounds {
        let log_bf = round.taken().map_or(f64::NAN, |taken| taken.log_bf);
        for (k, candidate) in round.claimed.iter().enumerate() {
            let found = &criticism.candidates[*candidate];
            let Some(form) = found.form.clone() else { continue };
            let (on, sd) = (found.on.clone(), found.sd);
            let mut name = found.cause.name();
            if k > 0 {
                name = format!("{name}_{}", on.join("_"));
            }
            while outline.statements.iter().any(|s| s.decl.name == name)
                || effects.iter().any(|(e, ..)| e.name == name)
            {
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
