//! Openings of a surface, outlined and labelled.

use std::fmt::Write as _;

use super::super::text::escape;
use super::font;
use super::picture::FONT;
use super::raster::Seen;
use crate::anatomy;
use crate::mesh::TriMesh;

/// With more openings only the largest have labels: small ones are holes in a scan.
const MOST_LABELS: usize = 9;
/// Half the width of a label, units, that has no room at the sides of a view.
const LONG: f64 = 25.0;
/// Names in the order of [`openings`] of the embedded atrium: the valve, then veins, the upper one first.
const OF_THE_ATRIUM: [&str; 5] = ["mitral valve", "LSPV", "LIPV", "RSPV", "RIPV"];

/// A closed chain of edges that have one triangle.
#[derive(Clone, Debug)]
pub(super) struct Opening {
    /// Empty for one without a label.
    pub(super) name: String,
    ring: Vec<u32>,
}

/// The largest first, named by number; of the embedded atrium by anatomy.
pub(super) fn openings(mesh: &TriMesh, is_atrium: bool) -> Vec<Opening> {
    let mut rings = anatomy::openings(mesh);
    let is_atrium = is_atrium && rings.len() == OF_THE_ATRIUM.len();
    if is_atrium {
        // x points to the patient's left, z to the head
        let order = |ring: &Vec<u32>| {
            let middle = anatomy::middle(mesh, ring);
            (middle.x < 0.0, -middle.z)
        };
        rings[1..].sort_by(|a, b| {
            let (a, b) = (order(a), order(b));
            a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
        });
    }
    let name = |at: usize| match at {
        at if is_atrium => OF_THE_ATRIUM[at].to_owned(),
        at if at < MOST_LABELS => (at + 1).to_string(),
        _ => String::new(),
    };
    rings.into_iter().enumerate().map(|(at, ring)| Opening { name: name(at), ring }).collect()
}

/// What is seen of the openings, and of their labels those that have room.
pub(super) fn draw(openings: &[Opening], seen: &Seen<'_>) -> String {
    let (mut svg, mut labels) = (String::new(), vec![]);
    for opening in openings {
        let places: Vec<[f64; 3]> = opening
            .ring
            .iter()
            .map(|v| seen.frame().project(seen.mesh().vertices()[*v as usize]))
            .collect();
        let n = places.len();
        let visible: Vec<bool> = places.iter().map(|place| seen.is_visible(*place)).collect();
        let mut path = String::new();
        for i in 0..n {
            let [a, b] = [places[i], places[(i + 1) % n]];
            if visible[i] && visible[(i + 1) % n] {
                let _ = write!(path, "M{:.1} {:.1}L{:.1} {:.1}", a[0], a[1], b[0], b[1]);
            }
        }
        if !path.is_empty() {
            let _ = write!(
                svg,
                r##"<path d="{path}" fill="none" stroke="#111" stroke-width="1.2" stroke-linecap="round"/>"##
            );
        }
        if 2 * visible.iter().filter(|is| **is).count() > n && !opening.name.is_empty() {
            labels.extend(label(&opening.name, &places, seen.frame().size, &labels));
        }
    }
    for Label { name, x, y, .. } in labels {
        let _ = write!(
            svg,
            r##"<text x="{x:.1}" y="{y:.1}" text-anchor="middle" fill="#111" stroke="white" stroke-width="2.6" paint-order="stroke">{}</text>"##,
            escape(name)
        );
    }
    svg
}

/// The middle of a text's baseline, and the text's half width.
struct Label<'n> {
    name: &'n str,
    x: f64,
    y: f64,
    half: f64,
}

/// In the middle of an opening that is larger than its label, else beside it, away from the middle of the view; `None`
/// where another label is.
fn label<'n>(
    name: &'n str,
    places: &[[f64; 3]],
    size: [f64; 2],
    others: &[Label<'_>],
) -> Option<Label<'n>> {
    let range = |k: usize| {
        let all = || places.iter().map(|place| place[k]);
        [all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max)]
    };
    let [[left, right], [top, bottom]] = [range(0), range(1)];
    let half = 0.5 * font::width(name, FONT);
    let (mut x, mut y) = (0.5 * (left + right), 0.5 * (top + bottom));
    if right - left < 2.0 * half + 4.0 || bottom - top < FONT + 4.0 {
        let away = [x - 0.5 * size[0], y - 0.5 * size[1]];
        if away[0].abs() > away[1].abs() && half < LONG {
            x += away[0].signum() * (0.5 * (right - left) + half + 3.0);
        } else {
            y += away[1].signum() * (0.5 * (bottom - top) + 0.7 * FONT);
        }
    }
    let x = x.clamp(half + 1.0, size[0] - half - 1.0);
    // the baseline is below the middle of the letters; the view's name is above all labels
    let y = (y + 0.36 * FONT).clamp(2.0 * FONT + 1.0, size[1] - 3.0);
    let is_free = others
        .iter()
        .all(|other| (x - other.x).abs() > half + other.half + 3.0 || (y - other.y).abs() > FONT);
    is_free.then_some(Label { name, x, y, half })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{REGION_NAMES, left_atrium};

    #[test]
    fn openings_of_the_atrium_are_those_of_its_regions() {
        let atrium = left_atrium(2.0);
        for opening in openings(&atrium.mesh, true) {
            let mut counts = [0; REGION_NAMES.len()];
            for vertex in &opening.ring {
                counts[usize::from(atrium.region[*vertex as usize])] += 1;
            }
            let most = (0..counts.len()).max_by_key(|region| counts[*region]).unwrap();
            let region = REGION_NAMES[most].replace("mitral rim", "mitral valve");
            assert_eq!(opening.name, region);
        }
        let numbers: Vec<String> =
            openings(&atrium.mesh, false).into_iter().map(|opening| opening.name).collect();
        assert_eq!(numbers, ["1", "2", "3", "4", "5"]);
    }
}
