//! Derivatives of the arrivals, along the ways by which each vertex is reached.
//!
//! ```text
//! dT_v = Σ_parents w dT_parent + w_o d onset + Σ_triangles (g_s ds + g_r dr + g_φ dφ)
//! ```
//! `backward` adds the transpose of this, last vertices first; `push` is this, first vertices first.  Vertices of a
//! group (`order.rs`) depend on each other, and their linear system is solved by iterating it.

use super::front::Front;
use super::geometry::Geometry;
use super::step::{Slope, Step};
use super::way::{NONE, Way};
use super::{Medium, MediumBar};

/// Iterations of a group end once what is left is smaller than this part of where they began.
const SMALL: f64 = 1e-17;
const MOST_ITERATIONS: usize = 10_000;

/// One vertex's arrival as a linear function of what it depends on, but for the medium.
#[derive(Clone, Copy, Debug)]
struct Link {
    parents: [(u32, f64); 2],
    onset: (u32, f64),
}

/// By the medium of one triangle: slowness, ratio, angle.
type OfMedium = (u32, [f64; 3]);

struct Linear<'a> {
    geometry: &'a Geometry,
    front: &'a Front,
}

impl Linear<'_> {
    /// The link of a vertex; `visit` is told what it owes to the medium of each triangle.
    fn link(&self, v: u32, visit: impl FnMut(OfMedium)) -> Link {
        let none = (NONE, 0.0);
        let nothing = Link { parents: [none; 2], onset: none };
        match self.front.ways[v as usize] {
            Way::Never => nothing,
            Way::Ray(index) => self.ray(index, visit),
            Way::Along { triangle, to, end } => {
                self.along(triangle, to as usize, end as usize, visit)
            }
            Way::Across { triangle, to, is_round } => {
                self.across(triangle, to as usize, is_round, visit)
            }
        }
    }

    fn ray(&self, index: u32, mut visit: impl FnMut(OfMedium)) -> Link {
        let ray = self.front.rays.ray(index);
        if self.front.plain_medium(ray.source).is_none() {
            for piece in self.front.rays.pieces(ray) {
                let tissue = &self.front.tissue[piece.triangle as usize];
                visit((piece.triangle, weighted(tissue, tissue.timed(piece.step))));
            }
        }
        Link { parents: [(NONE, 0.0); 2], onset: (ray.source, 1.0) }
    }

    /// Tells `visit` what a vertex that a front with a thickness reached along a line owes to the medium of each
    /// triangle without, and to the thickness there.
    fn line(&self, v: u32, mut visit: impl FnMut(OfMedium, f64)) {
        let Way::Ray(index) = self.front.ways[v as usize] else { return };
        let ray = self.front.rays.ray(index);
        let Some((tissue, thickness)) = self.front.plain_medium(ray.source) else { return };
        self.front.rays.late_slopes(ray, tissue, thickness, |piece, by_time, by_thickness| {
            let tissue = &tissue[piece.triangle as usize];
            let of = weighted(tissue, tissue.timed(piece.step)).map(|of| by_time * of);
            visit((piece.triangle, of), by_thickness);
        });
    }

    fn along(&self, index: u32, to: usize, end: usize, mut visit: impl FnMut(OfMedium)) -> Link {
        let triangle = &self.geometry.triangles[index as usize];
        let (tissue, from) = (&self.front.tissue[index as usize], (to + 1 + end) % 3);
        let d = minus(triangle.points[to], triangle.points[from]);
        visit((index, weighted(tissue, tissue.timed(d))));
        Link { parents: [(triangle.corners[from], 1.0), (NONE, 0.0)], onset: (NONE, 0.0) }
    }

    fn across(
        &self,
        index: u32,
        to: usize,
        is_round: bool,
        mut visit: impl FnMut(OfMedium),
    ) -> Link {
        let triangle = &self.geometry.triangles[index as usize];
        let tissue = &self.front.tissue[index as usize];
        let ends = [(to + 1) % 3, (to + 2) % 3];
        let vertices = ends.map(|k| triangle.corners[k]);
        let arrivals = vertices.map(|v| self.front.arrival[v as usize]);
        let step = Step::new(&self.front.timed[index as usize], to, arrivals);
        let origin = if is_round { self.front.origins[vertices[0] as usize] } else { NONE };
        let slope: Slope = if is_round {
            step.round_slope(self.front.births[origin as usize])
        } else {
            step.plane_slope()
        };
        // the step's axes in the timed plane
        let side = tissue.timed(minus(triangle.points[ends[1]], triangle.points[ends[0]]));
        let rise = tissue.timed(minus(triangle.points[to], triangle.points[ends[0]]));
        let along = unit(side);
        let mut into = [-along[1], along[0]];
        if into[0] * rise[0] + into[1] * rise[1] < 0.0 {
            into = into.map(|x| -x);
        }
        let mut sum = [0.0; 3];
        for ([x, y], weight) in slope.ways {
            let n = [x * along[0] + y * into[0], x * along[1] + y * into[1]];
            let of = tissue.derivative(n);
            (0..3).for_each(|k| sum[k] += weight * of[k]);
        }
        visit((index, sum));
        let [a, b] = slope.ends;
        Link { parents: [(vertices[0], a), (vertices[1], b)], onset: (origin, slope.birth) }
    }
}

/// Derivatives of the time along a displacement of the timed plane.
fn weighted(tissue: &super::metric::Tissue, timed: [f64; 2]) -> [f64; 3] {
    let length = (timed[0] * timed[0] + timed[1] * timed[1]).sqrt();
    tissue.derivative(timed.map(|x| x / length)).map(|x| length * x)
}

/// See [`Eikonal::backward`](super::Eikonal::backward). Of lines of fronts with a thickness, [`backward_lines`] does
/// the rest. Returns the adjoint of each arrival, with what others owe to it.
pub(super) fn backward(
    geometry: &Geometry,
    front: &Front,
    bar: &[f64],
    into: &mut MediumBar<'_>,
) -> Vec<f64> {
    let linear = Linear { geometry, front };
    let mut total = bar.to_vec();
    front.order.each_group(true, |start, end| {
        let group = &front.order.vertices[start..end];
        if end - start > 1 {
            linear.gather(group, &mut total);
        }
        for &v in group {
            let x = total[v as usize];
            if x == 0.0 {
                continue;
            }
            let link = linear.link(v, |(t, of)| {
                let corners = geometry.triangles[t as usize].corners.map(|v| v as usize);
                into.add(corners, of.map(|g| x * g / 3.0));
            });
            if link.onset.0 != NONE {
                into.onsets[link.onset.0 as usize] += x * link.onset.1;
            }
            for (parent, weight) in link.parents {
                // those within the group have theirs
                if parent != NONE && !(end - start > 1 && group.contains(&parent)) {
                    total[parent as usize] += x * weight;
                }
            }
        }
    });
    total
}

/// Adds the adjoint of the medium without a thickness, and of the thickness, that lines of fronts with one owe.
pub(super) fn backward_lines(
    geometry: &Geometry,
    front: &Front,
    total: &[f64],
    into: &mut MediumBar<'_>,
) {
    let linear = Linear { geometry, front };
    for (v, &x) in (0..).zip(total).filter(|(_, x)| **x != 0.0) {
        linear.line(v, |(t, of), by_thickness| {
            let corners = geometry.triangles[t as usize].corners.map(|v| v as usize);
            into.add(corners, of.map(|g| x * g / 3.0));
            if let Some(thickness) = &mut into.thickness {
                for v in corners {
                    thickness[v] += x * by_thickness / 3.0;
                }
            }
        });
    }
}

/// See [`Eikonal::push`](super::Eikonal::push). Changes are of the medium, and of that which lines of fronts with a
/// thickness run through.
pub(super) fn push(
    geometry: &Geometry,
    front: &Front,
    [change, on_lines]: [&Medium<'_>; 2],
    onset_change: &[f64],
    out: &mut [f64],
) {
    let linear = Linear { geometry, front };
    let mean = |values: Option<&[f64]>, t: u32| {
        values.map_or(0.0, |values| geometry.triangles[t as usize].mean(values))
    };
    let of_medium = |change: &Medium<'_>, (t, of): OfMedium| {
        let by = [Some(change.slowness), change.ratio, change.angle];
        by.iter().zip(of).map(|(by, of)| of * mean(*by, t)).sum::<f64>()
    };
    front.order.each_group(false, |start, end| {
        let group = &front.order.vertices[start..end];
        for &v in group {
            let mut sum = 0.0;
            let link = linear.link(v, |of| sum += of_medium(change, of));
            linear.line(v, |of, by_thickness| {
                sum += of_medium(on_lines, of) + by_thickness * mean(on_lines.thickness, of.0);
            });
            if link.onset.0 != NONE {
                sum += link.onset.1 * onset_change[link.onset.0 as usize];
            }
            for (parent, weight) in link.parents {
                if parent != NONE && !(end - start > 1 && group.contains(&parent)) {
                    sum += weight * out[parent as usize];
                }
            }
            out[v as usize] = sum;
        }
        if end - start > 1 {
            linear.settle(group, out);
        }
    });
}

impl Linear<'_> {
    /// Links within a group: (child, parent, weight) by places in it.
    fn inside(&self, group: &[u32]) -> Vec<(usize, usize, f64)> {
        let mut links = vec![];
        for (child, &v) in group.iter().enumerate() {
            for (parent, weight) in self.link(v, |_| ()).parents {
                if let Some(parent) = group.iter().position(|&u| u == parent) {
                    links.push((child, parent, weight));
                }
            }
        }
        links
    }

    /// Solves `x = b + Wᵀ x` within a group; `total` holds b, then x.
    fn gather(&self, group: &[u32], total: &mut [f64]) {
        let links = self.inside(group);
        let mut left: Vec<f64> = group.iter().map(|&v| total[v as usize]).collect();
        let size = largest(&left);
        for _ in 0..MOST_ITERATIONS {
            let mut next = vec![0.0; left.len()];
            for &(child, parent, weight) in &links {
                next[parent] += weight * left[child];
            }
            for (&v, x) in group.iter().zip(&next) {
                total[v as usize] += x;
            }
            left = next;
            if largest(&left) <= SMALL * size {
                break;
            }
        }
    }

    /// Solves `x = b + W x` within a group; `out` holds b, then x.
    fn settle(&self, group: &[u32], out: &mut [f64]) {
        let links = self.inside(group);
        let mut left: Vec<f64> = group.iter().map(|&v| out[v as usize]).collect();
        let size = largest(&left);
        for _ in 0..MOST_ITERATIONS {
            let mut next = vec![0.0; left.len()];
            for &(child, parent, weight) in &links {
                next[child] += weight * left[parent];
            }
            for (&v, x) in group.iter().zip(&next) {
                out[v as usize] += x;
            }
            left = next;
            if largest(&left) <= SMALL * size {
                break;
            }
        }
    }
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |most: f64, x| most.max(x.abs()))
}

fn minus(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

fn unit(a: [f64; 2]) -> [f64; 2] {
    let length = (a[0] * a[0] + a[1] * a[1]).sqrt();
    a.map(|x| x / length)
}
