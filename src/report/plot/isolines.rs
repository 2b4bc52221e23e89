//! Lines along which an array on a surface has one value, such as isochrones.

use std::fmt::Write as _;

use super::raster::Seen;

/// Thinner than an opening's outline.
const STROKE: &str = r##"fill="none" stroke="#000" stroke-width=".5" stroke-linecap="round""##;
/// Most lines in one triangle: closer ones hide it.
const MOST: f64 = 100.0;

/// What is seen of the lines of `values` (n_vertices) at every multiple of `step`. In each triangle the array is linear;
/// there are none in one with a corner without a value.
pub(super) fn draw(values: &[f64], step: f64, seen: &Seen<'_>) -> String {
    let mut path = String::new();
    for triangle in seen.mesh().triangles() {
        let at = triangle.map(|v| values[v as usize]);
        let [low, high] = [at[0].min(at[1]).min(at[2]), at[0].max(at[1]).max(at[2])];
        let is_known = at.iter().all(|x| x.is_finite());
        if !is_known || !triangle.iter().any(|v| seen.shows(*v)) {
            continue;
        }
        let corners = triangle.map(|v| seen.frame().project(seen.mesh().vertices()[v as usize]));
        for level in levels(low, high, step) {
            let cut = |i: usize| {
                let (a, b) = (i, (i + 1) % 3);
                let crosses = (at[a] < level) != (at[b] < level);
                let share = (level - at[a]) / (at[b] - at[a]);
                let between = |k: usize| corners[a][k] + share * (corners[b][k] - corners[a][k]);
                crosses.then(|| [0, 1, 2].map(between))
            };
            let mut ends = (0..3).filter_map(cut);
            if let (Some(from), Some(to)) = (ends.next(), ends.next())
                && seen.is_visible(from)
                && seen.is_visible(to)
            {
                let _ = write!(path, "M{:.1} {:.1}L{:.1} {:.1}", from[0], from[1], to[0], to[1]);
            }
        }
    }
    if path.is_empty() { String::new() } else { format!(r#"<path d="{path}" {STROKE}/>"#) }
}

/// The multiples of `step` above `low`, up to `high`.
fn levels(low: f64, high: f64, step: f64) -> impl Iterator<Item = f64> {
    let first = (low / step).floor() + 1.0;
    let n = ((high / step).floor() - first + 1.0).clamp(0.0, MOST);
    (0..n as usize).map(move |k| (first + k as f64) * step)
}

#[cfg(test)]
mod tests {
    use super::super::raster::Shape;
    use super::super::view::{Frame, views};
    use super::*;
    use crate::mesh::TriMesh;

    #[test]
    fn levels_are_multiples_of_the_step() {
        let of = |low, high| levels(low, high, 10.0).collect::<Vec<_>>();
        assert_eq!(of(-12.0, 20.0), [-10.0, 0.0, 10.0, 20.0]);
        assert_eq!(of(20.0, 29.0), [0.0; 0]);
        assert_eq!(levels(0.0, 1e9, 1e-3).count(), 100);
    }

    /// On a sheet of 40 mm whose array is x, lines stand at every 10 mm, from one side to the other.
    #[test]
    fn lines_are_where_the_array_has_their_value() {
        let at = |i: u32| [f64::from(i % 9) * 5.0, f64::from(i / 9) * 5.0, 0.0];
        let vertices: Vec<[f64; 3]> = (0..81).map(at).collect();
        let squares = (0..64).map(|k| k / 8 * 9 + k % 8);
        let triangles = squares.flat_map(|v| [[v, v + 1, v + 10], [v, v + 10, v + 9]]).collect();
        let mesh = TriMesh::new(vertices, triangles).unwrap();
        let mut values: Vec<f64> = mesh.vertices().iter().map(|p| p[0] + 2.5).collect();
        let shape = Shape::new(&mesh);
        let frames = Frame::all(&views(&mesh, false), &mesh, [100.0, 100.0], [10.0, 10.0]);
        let seen = Seen::new(&shape, frames[0].clone());
        let svg = draw(&values, 10.0, &seen);
        // 2 units a mm: x of 7.5, 17.5, 27.5 and 37.5 mm, 8 squares with two triangles each
        for x in ["25.0", "45.0", "65.0", "85.0"] {
            assert_eq!(svg.matches(&format!("M{x} ")).count(), 16, "{x} in {svg}");
        }
        assert_eq!(svg.matches('M').count(), 64);
        values[40] = f64::NAN;
        assert_eq!(draw(&values, 10.0, &seen).matches('M').count(), 64 - 3);
    }
}
