//! Which models can be run on a table, and how far its sites lie from the surface, in words.

use std::fmt::Write as _;

use super::models::Compiled;
use crate::import::{self, from_surface};
use crate::mesh::Surface;
use crate::run::coverage;
use crate::table::Measurements;

/// Bars of at most this many signs.
const WIDTH: usize = 40;

/// A small histogram of text, or nothing of nothing.
pub(super) fn histogram_text(ranges: &[(String, usize)]) -> String {
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

/// How far the rows that are given as x, y, z lie from the surface; `scale` is their unit, mm.
pub(super) fn off_surface(surface: &Surface, table: &Measurements, scale: f64) -> String {
    let place = |row: usize| {
        let number = |name: &str| table.column(name)?.number(row).map(|x| scale * x);
        Some([number("x")?, number("y")?, number("z")?])
    };
    let Some(places) = (0..table.len()).map(place).collect::<Option<Vec<_>>>() else {
        return String::new();
    };
    let names: Vec<String> = places.iter().map(|place| format!("{place:?}")).collect();
    let distances = from_surface(&surface.mesh, &places);
    let sites = names.iter().map(String::as_str).zip(distances).collect();
    histogram_text(&import::histogram(sites))
}

/// The models that the table suffices for, then what others lack; and the name of the first of them.
pub(super) fn in_words(
    compiled: &[Compiled],
    surface: Option<&Surface>,
    table: &Measurements,
) -> (String, Option<String>) {
    let (can, lack) = sorted(compiled, surface.map(|surface| (surface, 1.0)), table);
    let first = can.split_once(':').map(|(name, _)| name.trim().to_owned());
    let shown = if can.is_empty() { "  none of the models that ship\n" } else { &can };
    let lack = if lack.is_empty() { lack } else { format!("lacks something\n{lack}") };
    (format!("can be calibrated\n{shown}{lack}"), first)
}

/// As [`in_words`], of models beside the one that is checked; nothing where there is none.
pub(super) fn others(
    compiled: &[Compiled],
    surface: &Surface,
    scale: f64,
    table: &Measurements,
) -> String {
    let (can, lack) = sorted(compiled, Some((surface, scale)), table);
    let headed = |head: &str, lines: String| {
        if lines.is_empty() { lines } else { format!("{head}\n{lines}") }
    };
    headed("the table suffices for these models too", can)
        + &headed("for these models it lacks something", lack)
}

/// A line for each model that can be run, and for each that lacks something.
fn sorted(
    compiled: &[Compiled],
    surface: Option<(&Surface, f64)>,
    table: &Measurements,
) -> (String, String) {
    let (mut can, mut lack) = (String::new(), String::new());
    for model in compiled {
        let Some(found) = coverage(model.model, surface, table) else { continue };
        // a model that ships needs no file
        let name = model.file.trim_end_matches(".rs");
        let counts: Vec<String> =
            found.observes.iter().map(|(name, n)| format!("{n} {name}")).collect();
        let _ = match found.missing {
            None => writeln!(can, "  {name}: {}", counts.join(", ")),
            Some(missing) => writeln!(lack, "  {name}: {missing}"),
        };
    }
    (can, lack)
}
