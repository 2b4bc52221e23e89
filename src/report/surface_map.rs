//! Values at sites of a surface, as inline SVG: seen from both sides, along the direction in which it is thinnest.

use std::fmt::Write as _;

use nalgebra::{Matrix3, SymmetricEigen, Vector3};

use super::text::{escape, tick};
use crate::mesh::TriMesh;

/// Size of one view, in SVG units.
const WIDTH: f64 = 360.0;
const HEIGHT: f64 = 300.0;
const MARGIN: f64 = 12.0;
/// A surface whose thickness is less than this share of its length is a sheet: one view shows all of it.
const SHEET: f64 = 1e-3;
/// A site this deep below the surface in front of it, as a share of the surface's length, is behind it.
const BEHIND: f64 = 0.03;
/// Radius of a dot, and of more than so many dots together as much area as these would have.
const RADIUS: f64 = 6.0;
const FULL_SIZE: f64 = 100.0;
/// Greys of triangles, from those seen edge-on to those seen face-on.
const GREYS: [&str; 4] = ["#c3ccd5", "#d3dae1", "#e0e5ea", "#e9edf1"];
/// Ends of the diverging scale, below and above zero (Okabe and Ito), and its middle.
const BELOW: [f64; 3] = [0.0, 114.0, 178.0];
const ABOVE: [f64; 3] = [213.0, 94.0, 0.0];
const MIDDLE: [f64; 3] = [250.0, 250.0, 247.0];

/// A value at a place; NaN is drawn hollow.
#[derive(Debug)]
pub(super) struct Dot {
    /// mm.
    pub(super) at: [f64; 3],
    pub(super) value: f64,
    /// What it is.
    pub(super) title: String,
}

/// A surface and the views of it.
pub(super) struct SurfaceMap {
    views: Vec<View>,
}

struct View {
    /// Right, up, towards the viewer.
    axes: [Vector3<f64>; 3],
    centre: Vector3<f64>,
    scale: f64,
    /// Triangles that face the viewer, projected, with their greys.
    facing: Vec<([[f64; 3]; 3], usize)>,
    is_sheet: bool,
}

impl SurfaceMap {
    pub(super) fn new(mesh: &TriMesh) -> Self {
        let points: Vec<Vector3<f64>> =
            mesh.vertices().iter().copied().map(Vector3::from).collect();
        let centre = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
        let covariance: Matrix3<f64> =
            points.iter().map(|p| (p - centre) * (p - centre).transpose()).sum();
        let eigen = SymmetricEigen::new(covariance);
        let mut order = [0, 1, 2];
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
        let [right, up] = [order[0], order[1]].map(|k| eigen.eigenvectors.column(k).into_owned());
        let towards = right.cross(&up);
        let extent = |axis: &Vector3<f64>| {
            points.iter().map(|p| (p - centre).dot(axis).abs()).fold(0.0, f64::max)
        };
        let scale = ((0.5 * WIDTH - MARGIN) / extent(&right))
            .min((0.5 * HEIGHT - MARGIN) / extent(&up).max(f64::MIN_POSITIVE));
        let is_sheet = extent(&towards) < SHEET * extent(&right);
        let front = [right, up, towards];
        let back = [-right, up, -towards];
        let sides = if is_sheet { vec![front] } else { vec![front, back] };
        let turned = orientation(mesh, &centre);
        let view = |axes| {
            let mut view = View { axes, centre, scale, facing: vec![], is_sheet };
            view.facing = view.triangles(mesh, turned);
            view
        };
        Self { views: sides.into_iter().map(view).collect() }
    }

    /// The surface itself, once per page: [`SurfaceMap::draw`] refers to it.
    pub(super) fn definitions(&self) -> String {
        let mut svg = r#"<svg class="absent" aria-hidden="true"><defs>"#.to_owned();
        for (number, view) in self.views.iter().enumerate() {
            let _ = write!(svg, r#"<g id="view{number}">"#);
            for (grey, colour) in GREYS.iter().enumerate() {
                let _ =
                    write!(svg, r#"<path fill="{colour}" stroke="{colour}" stroke-width=".7" d=""#);
                for ([a, b, c], _) in view.facing.iter().filter(|(_, own)| *own == grey) {
                    let [ax, ay, bx, by, cx, cy] = [a[0], a[1], b[0], b[1], c[0], c[1]];
                    let _ = write!(svg, "M{ax:.1} {ay:.1}L{bx:.1} {by:.1}L{cx:.1} {cy:.1}Z");
                }
                svg += "\"/>";
            }
            svg += "</g>";
        }
        svg + "</defs></svg>"
    }

    /// The surface with dots, coloured from −`limit` to `limit`; those behind it are faint.
    pub(super) fn draw(&self, label: &str, dots: &[Dot], limit: f64) -> String {
        let width = WIDTH * self.views.len() as f64;
        let radius = RADIUS * (FULL_SIZE / dots.len().max(1) as f64).sqrt().min(1.0);
        let label = escape(label);
        let mut svg = format!(
            r#"<svg class="map" role="img" aria-label="{label}" viewBox="0 0 {width} {HEIGHT}" style="max-width:{width}px">"#
        );
        for (number, view) in self.views.iter().enumerate() {
            let left = WIDTH * number as f64;
            let _ =
                write!(svg, r##"<g transform="translate({left} 0)"><use href="#view{number}"/>"##);
            let mut shown: Vec<(bool, [f64; 3], &Dot)> = dots
                .iter()
                .map(|dot| (view.project(&Vector3::from(dot.at)), dot))
                .map(|(at, dot)| (view.is_before(at), at, dot))
                .collect();
            shown.sort_by(|a, b| a.0.cmp(&b.0).then(a.1[2].total_cmp(&b.1[2])));
            for (is_before, [x, y, _], dot) in shown {
                let class = if is_before { "site" } else { "site behind" };
                let (r, fill) = match colour(dot.value, limit) {
                    Some(fill) => (radius, fill),
                    None => (0.5 * radius, "none".into()),
                };
                let _ = write!(
                    svg,
                    r#"<circle class="{class}" cx="{x:.1}" cy="{y:.1}" r="{r:.1}" style="fill:{fill}"><title>{}</title></circle>"#,
                    escape(&dot.title)
                );
            }
            svg += "</g>";
        }
        svg + "</svg>"
    }
}

/// The scale of [`SurfaceMap::draw`].
pub(super) fn colour_scale(limit: f64, unit: &str) -> String {
    let stops: Vec<String> =
        (0..=8).filter_map(|k| colour(limit * (f64::from(k) / 4.0 - 1.0), limit)).collect();
    format!(
        r#"<div class="scale"><span>{}</span><i style="background:linear-gradient(to right,{})"></i><span>{} {}</span></div>"#,
        tick(-limit),
        stops.join(","),
        tick(limit),
        escape(unit)
    )
}

/// Colour of a value, `None` if there is no value.
fn colour(value: f64, limit: f64) -> Option<String> {
    if !value.is_finite() {
        return None;
    }
    let share = (value / limit).clamp(-1.0, 1.0);
    let end = if share < 0.0 { BELOW } else { ABOVE };
    let [r, g, b]: [f64; 3] =
        std::array::from_fn(|k| MIDDLE[k] + share.abs() * (end[k] - MIDDLE[k]));
    Some(format!("rgb({r:.0} {g:.0} {b:.0})"))
}

/// 1 if the triangles of a closed surface are counterclockwise from outside, else −1.
fn orientation(mesh: &TriMesh, centre: &Vector3<f64>) -> f64 {
    let volume = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(|v| Vector3::from(mesh.vertices()[v as usize]) - centre);
        a.cross(&b).dot(&c)
    };
    if mesh.triangles().iter().map(volume).sum::<f64>() < 0.0 { -1.0 } else { 1.0 }
}

impl View {
    /// Place on the page, and nearness to the viewer.
    fn project(&self, at: &Vector3<f64>) -> [f64; 3] {
        let [right, up, towards] = self.axes.map(|axis| self.scale * axis.dot(&(at - self.centre)));
        [0.5 * WIDTH + right, 0.5 * HEIGHT - up, towards]
    }

    fn triangles(&self, mesh: &TriMesh, turned: f64) -> Vec<([[f64; 3]; 3], usize)> {
        let projected: Vec<[f64; 3]> =
            mesh.vertices().iter().map(|v| self.project(&Vector3::from(*v))).collect();
        let one = |triangle: &[u32; 3]| {
            let [a, b, c] = triangle.map(|v| projected[v as usize]);
            let edge = |to: [f64; 3]| Vector3::from(to) - Vector3::from(a);
            let normal = edge(b).cross(&edge(c));
            // y points down on the page
            let facing = -normal.z * turned / normal.norm();
            let grey = (facing.abs() * GREYS.len() as f64) as usize;
            (self.is_sheet || facing > 0.0).then_some(([a, b, c], grey.min(GREYS.len() - 1)))
        };
        mesh.triangles().iter().filter_map(one).collect()
    }

    /// Whether nothing of the surface is in front of a place.
    fn is_before(&self, [x, y, depth]: [f64; 3]) -> bool {
        let covers = |[a, b, c]: &[[f64; 3]; 3]| {
            let side = |p: &[f64; 3], q: &[f64; 3]| {
                (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0])
            };
            let (u, v, w) = (side(b, c), side(c, a), side(a, b));
            let inside = (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0);
            let nearest = (u * a[2] + v * b[2] + w * c[2]) / (u + v + w);
            inside && nearest > depth + BEHIND * WIDTH
        };
        self.is_sheet || !self.facing.iter().any(|(triangle, _)| covers(triangle))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::left_atrium;

    fn dot(at: [f64; 3], value: f64) -> Dot {
        Dot { at, value, title: "site".into() }
    }

    #[test]
    fn each_site_of_a_closed_surface_is_seen_from_one_side() {
        let mesh = left_atrium(3.0).mesh;
        let map = SurfaceMap::new(&mesh);
        assert_eq!(map.views.len(), 2);
        let [towards, away] = [0, 1].map(|view: usize| map.views[view].axes[2]);
        let farthest = |axis: Vector3<f64>| {
            let along = |v: &&[f64; 3]| axis.dot(&Vector3::from(**v));
            *mesh.vertices().iter().max_by(|a, b| along(a).total_cmp(&along(b))).unwrap()
        };
        for (view, site) in [(0, farthest(towards)), (1, farthest(away))] {
            let seen = |view: usize| {
                let view = &map.views[view];
                view.is_before(view.project(&Vector3::from(site)))
            };
            assert!(seen(view) && !seen(1 - view), "view {view}");
        }
    }

    #[test]
    fn every_triangle_of_a_sheet_is_in_its_one_view() {
        let vertices = vec![[0.0, 0.0, 1.0], [30.0, 0.0, 1.0], [0.0, 20.0, 1.0], [30.0, 20.0, 1.0]];
        let mesh = TriMesh::new(vertices, vec![[0, 1, 2], [1, 2, 3]]).unwrap();
        let map = SurfaceMap::new(&mesh);
        assert_eq!((map.views.len(), map.views[0].facing.len()), (1, 2));
        let svg =
            map.draw("residual", &[dot([3.0, 4.0, 1.0], 2.0), dot([9.0, 9.0, 1.0], f64::NAN)], 4.0);
        assert!(svg.contains("fill:none") && !svg.contains("behind"), "{svg}");
    }

    #[test]
    fn many_dots_cover_no_more_than_a_hundred() {
        let mesh = left_atrium(3.0).mesh;
        let map = SurfaceMap::new(&mesh);
        let radius = |n: usize| {
            let dots: Vec<Dot> = (0..n).map(|_| dot(mesh.vertices()[0], 1.0)).collect();
            let svg = map.draw("residual", &dots, 4.0);
            svg.split_once(" r=\"").unwrap().1.split_once('"').unwrap().0.to_owned()
        };
        assert_eq!([radius(1), radius(100), radius(1600)], ["6.0", "6.0", "1.5"]);
    }

    #[test]
    fn colours_diverge_from_zero() {
        assert_eq!(colour(-8.0, 4.0).unwrap(), "rgb(0 114 178)");
        assert_eq!(colour(0.0, 4.0).unwrap(), "rgb(250 250 247)");
        assert_eq!(colour(4.0, 4.0).unwrap(), "rgb(213 94 0)");
        assert_eq!(colour(f64::NAN, 4.0), None);
    }
}
