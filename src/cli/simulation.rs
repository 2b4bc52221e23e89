//! What simulations of an atrium tell before they begin and while they run, but for how far they are.

use serde_json::json;

use super::voice::{note, tell};
use crate::run::atrium::{Atrium, Event, Warning};

/// Says on stderr what a user should know of the tissue.
pub(super) fn warn(atrium: &Atrium) {
    for warning in atrium.warnings() {
        match warning {
            Warning::LongEdges { .. } => note(
                "warning: fronts need edges below 0.5 mm, or they slow down and block\nhelp: --refine N halves edges N times",
            ),
            Warning::TiltedFibres { degrees } => note(format_args!(
                "warning: fibres leave the surface at up to {degrees:.0}° and are laid into it"
            )),
            Warning::OutOfRange { share } => note(format_args!(
                "warning: {:.1} % of the vertices have a mean parameter outside its range: it is the nearest in it",
                100.0 * share
            )),
        }
    }
}

/// Says on stderr what happened that is no progress.
pub(super) fn tell_event(event: Event<'_>) {
    match event {
        Event::Resumed { folder, seconds } => {
            let text = format_args!("resume {}: {seconds:.1} s of it are done", folder.display());
            tell("resumed", text, json!({ "folder": folder, "seconds": seconds }));
        }
        Event::NotKept(reason) => {
            let text =
                format_args!("warning: the simulation could not be kept for --resume: {reason}");
            tell("not_kept", text, json!({ "reason": reason }));
        }
        Event::Time(_) | Event::Pairs { .. } => {}
    }
}
