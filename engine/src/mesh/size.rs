//! How large a surface is, and what that says of its unit.

use super::pieces::Pieces;
use super::units::Known;
use super::{TriMesh, Units, join};

/// The area a left atrium may have, mm².
const PLAUSIBLE_AREA: std::ops::RangeInclusive<f64> = 2_000.0..=60_000.0;

/// The largest extent of a piece, counted from 1, the largest first, along one of the axes, in the unit
/// of `vertices`; of the largest piece without one. Equal vertices count as joined.
pub(super) fn across(vertices: &[[f64; 3]], triangles: &[[u32; 3]], piece: Option<usize>) -> f64 {
    let first = join::equal(vertices);
    let is_finite =
        |t: &[u32; 3]| t.iter().all(|v| vertices[*v as usize].iter().all(|x| x.is_finite()));
    let joined: Vec<[u32; 3]> =
        triangles.iter().filter(|t| is_finite(t)).map(|t| t.map(|v| first[v as usize])).collect();
    let pieces = Pieces::new(vertices, &joined);
    // Whether there is such a piece is asked when it is chosen.
    let wanted = piece.unwrap_or(1).saturating_sub(1);
    let wanted = if wanted < pieces.ranked.len() { wanted } else { 0 };
    let inside = || (0..vertices.len()).filter(|v| pieces.rank_of(*v as u32) == Some(wanted));
    let extent = |k: usize| {
        let (low, high) = inside().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
            (low.min(vertices[v][k]), high.max(vertices[v][k]))
        });
        high - low
    };
    (0..3).map(extent).fold(0.0, f64::max)
}

/// Bounding box and area, how the unit is known, and a warning if no left atrium is that size.
pub(super) fn size_notes(mesh: &TriMesh, units: Units, known: Known) -> Vec<String> {
    let [low, high] = mesh.bounding_box();
    let [x, y, z]: [f64; 3] = std::array::from_fn(|k| high[k] - low[k]);
    let area = mesh.area();
    let cm2 = area / 100.0;
    let mut notes = vec![format!(
        "read as {units}{}: {} × {} × {} mm, area {} cm²",
        known.because(),
        rounded(x),
        rounded(y),
        rounded(z),
        rounded(cm2)
    )];
    if !PLAUSIBLE_AREA.contains(&area) {
        let ratio = |other: Units| (other.in_mm() / units.in_mm()).powi(2);
        let likely = Units::ALL.into_iter().find(|&u| PLAUSIBLE_AREA.contains(&(area * ratio(u))));
        let advice = match likely {
            Some(other) => format!(
                "with --units {other} it would be {} cm²: is the file in {other}?",
                rounded(cm2 * ratio(other))
            ),
            None => {
                "no unit of length makes it one; this is fine for a patch or a test shape".into()
            }
        };
        notes.push(format!(
            "WARNING: an area of {} cm² is not a left atrium's (20 to 600 cm²); {advice}",
            rounded(cm2)
        ));
    }
    notes
}

/// Three significant digits, without an exponent where a person would not write one.
fn rounded(x: f64) -> String {
    match x.abs() {
        a if a >= 1e6 || (a > 0.0 && a < 1e-3) => format!("{x:.2e}"),
        a if a >= 100.0 => format!("{x:.0}"),
        a if a >= 1.0 || a == 0.0 => format!("{x:.1}"),
        _ => format!("{x:.4}"),
    }
}
