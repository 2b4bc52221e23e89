//! Which models can be run on a table, and how far its sites lie from the surface, in words.

use std::fmt::Write as _;

use super::models::Compiled;
use crate::mesh::Surface;
use crate::run::coverage;
use crate::table::Measurements;

/// Bars of at most this many signs.
const WIDTH: usize = 40;

/// A small histogram of text, or nothing of nothing.
pub(super) fn histogram(ranges: &[(String, usize)]) -> String {
    let Some(most) = ranges.iter().map(|(_, n)| *n).max().filter(|most| *most > 0) else {
        return String::new();
    };
    let mut out = String::from("  distance of the sites from the surface\n");
    for (range, n) in ranges {
        let bar = "#".repeat((n * WIDTH).div_ceil(most));
        let _ = writeln!(out, "    {range:<16}{n:>6} {bar}");
    }
    out
}

/// The models on this surface that the table suffices for, then what others lack.
pub(super) fn in_words(
    compiled: &[Compiled],
    surface: Option<&Surface>,
    table: &Measurements,
) -> String {
    let (mut can, mut lack) = (String::new(), String::new());
    for model in compiled {
        let Some(found) = coverage(model.model, surface, table) else { continue };
        let file = model.file;
        let counts: Vec<String> =
            found.observes.iter().map(|(name, n)| format!("{n} {name}")).collect();
        let _ = match found.missing {
            None => writeln!(can, "  models/{file}: {}", counts.join(", ")),
            Some(missing) => writeln!(lack, "  models/{file}: {missing}"),
        };
    }
    let mut out = String::new();
    let shown = if can.is_empty() { "  none of the models that ship\n" } else { &can };
    let _ = write!(out, "can be calibrated\n{shown}");
    if !lack.is_empty() {
        let _ = write!(out, "lacks something\n{lack}");
    }
    out
}
