//! Derivatives of the arrivals, along the ways by which each vertex is reached.
//!
//! ```text
//! dT_v = Σ_parents w dT_parent + w_o d onset + Σ_triangles (g_s ds + g_r dr + g_φ dφ)
//! ```
//! `backward` adds the transpose of this, last vertices first; `push` is this, first vertices first.  Vertices of a
//! group (`order.rs`) depend on each other, and their linear system is solved by iterating it.  For `push`, of
//! which a Hessian asks hundreds of times, these numbers are kept ([`Linear`]).

use super::front::Front;
use super::geometry::Geometry;
use super::metric::Tissue;
use super::step::Step;
use super::way::{NONE, Way};
use super::{Medium, MediumBar};
use std::ops::Range;

/// Iterations of a group end once what is left is smaller than this part of where they began.
const SMALL: f64 = 1e-17;
const MOST_ITERATIONS: usize = 10_000;

/// The arrivals of a front as linear functions of each other, of the onsets and of the medium.
#[derive(Clone, Debug, Default)]
pub(super) struct Linear {
    /// Of each vertex (n_vertices).
    links: Vec<Link>,
    /// What vertices owe to the medium of triangles.
    dues: Vec<Due>,
    /// What vertices that a front with a thickness reached along a line owe to the medium of triangles without, with the
    /// derivative by the thickness there.
    of_lines: Vec<(Due, f64)>,
}

/// One vertex's arrival as a linear function of what it depends on.
#[derive(Clone, Copy, Debug)]
struct Link {
    parents: [(u32, f64); 2],
    onset: (u32, f64),
    /// Its parts of all dues, and of those of lines: first, and one after the last.
    dues: [u32; 2],
    of_lines: [u32; 2],
}

/// Derivatives by the medium of one triangle: slowness, ratio, angle.
#[derive(Clone, Copy, Debug)]
struct Due {
    triangle: u32,
    by: [f64; 3],
}

impl Linear {
    fn new(geometry: &Geometry, front: &Front) -> Self {
        let mut new = Self::default();
        new.links.reserve(front.ways.len());
        new.dues.reserve(front.ways.len());
        front.ways.iter().for_each(|way| new.add(geometry, front, *way));
        new
    }

    /// Adds a vertex that is reached so.
    fn add(&mut self, geometry: &Geometry, front: &Front, way: Way) {
        let (none, starts) = ((NONE, 0.0), [self.dues.len(), self.of_lines.len()]);
        let (parents, onset) = match way {
            Way::Never => ([none; 2], none),
            Way::Ray(index) => ([none; 2], self.ray(front, index)),
            Way::Along { triangle, to, end } => {
                ([self.along(geometry, front, triangle, [to, end]), none], none)
            }
            Way::Across { triangle, to, is_round } => {
                self.across(geometry, front, (triangle, to as usize), is_round)
            }
        };
        let dues = [starts[0], self.dues.len()].map(|at| at as u32);
        let of_lines = [starts[1], self.of_lines.len()].map(|at| at as u32);
        self.links.push(Link { parents, onset, dues, of_lines });
    }

    /// Along a line. Returns what is owed to its source.
    fn ray(&mut self, front: &Front, index: u32) -> (u32, f64) {
        let ray = front.rays.ray(index);
        let due = |triangle: u32, step: [f64; 2], tissue: &[Tissue], by: f64| {
            let tissue = &tissue[triangle as usize];
            Due { triangle, by: weighted(tissue, tissue.timed(step)).map(|x| by * x) }
        };
        match front.plain_medium(ray.source) {
            None => {
                for piece in front.rays.pieces(ray) {
                    self.dues.push(due(piece.triangle, piece.step, &front.tissue, 1.0));
                }
            }
            Some((tissue, thickness)) => {
                front.rays.late_slopes(ray, tissue, thickness, |piece, by_time, by_thickness| {
                    let due = due(piece.triangle, piece.step, tissue, by_time);
                    self.of_lines.push((due, by_thickness));
                });
            }
        }
        (ray.source, 1.0)
    }

    /// Along a side. Returns what is owed to the vertex at its end.
    fn along(
        &mut self,
        geometry: &Geometry,
        front: &Front,
        index: u32,
        [to, end]: [u8; 2],
    ) -> (u32, f64) {
        let triangle = &geometry.triangles[index as usize];
        let (tissue, from) = (&front.tissue[index as usize], (to + 1 + end) as usize % 3);
        let d = minus(triangle.points[to as usize], triangle.points[from]);
        self.dues.push(Due { triangle: index, by: weighted(tissue, tissue.timed(d)) });
        (triangle.corners[from], 1.0)
    }

    /// Across a side. Returns what is owed to its ends, and to a source.
    fn across(
        &mut self,
        geometry: &Geometry,
        front: &Front,
        (index, to): (u32, usize),
        is_round: bool,
    ) -> ([(u32, f64); 2], (u32, f64)) {
        let triangle = &geometry.triangles[index as usize];
        let tissue = &front.tissue[index as usize];
        let ends = [(to + 1) % 3, (to + 2) % 3];
        let vertices = ends.map(|k| triangle.corners[k]);
        let arrivals = vertices.map(|v| front.arrival[v as usize]);
        let step = Step::new(&front.timed[index as usize], to, arrivals);
        let origin = if is_round { front.reached[vertices[0] as usize].origin } else { NONE };
        let slope = step.across_slope(is_round.then(|| front.births[origin as usize]));
        // the step's axes in the timed plane
        let side = tissue.timed(minus(triangle.points[ends[1]], triangle.points[ends[0]]));
        let rise = tissue.timed(minus(triangle.points[to], triangle.points[ends[0]]));
        let along = unit(side);
        let mut into = [-along[1], along[0]];
        if into[0] * rise[0] + into[1] * rise[1] < 0.0 {
            into = into.map(|x| -x);
        }
        let mut by = [0.0; 3];
        for ([x, y], weight) in slope.ways.into_iter().filter(|way| way.1 != 0.0) {
            let n = [x * along[0] + y * into[0], x * along[1] + y * into[1]];
            let of = tissue.derivative(n);
            (0..3).for_each(|k| by[k] += weight * of[k]);
        }
        self.dues.push(Due { triangle: index, by });
        let [a, b] = slope.ends;
        ([(vertices[0], a), (vertices[1], b)], (origin, slope.birth))
    }

    /// A vertex: its link, what it owes, and what it owes along lines.
    fn at(&self, v: usize) -> (&Link, &[Due], &[(Due, f64)]) {
        let link = &self.links[v];
        (link, &self.dues[range(link.dues)], &self.of_lines[range(link.of_lines)])
    }
}

/// The links of a front: those that are kept, or else each computed when it is asked for. A gradient asks for some of them,
/// once, so that keeping all would take longer.
struct Links<'a> {
    geometry: &'a Geometry,
    front: &'a Front,
    kept: Option<&'a Linear>,
    /// The last one that was computed.
    one: Linear,
}

impl<'a> Links<'a> {
    fn of(geometry: &'a Geometry, front: &'a Front) -> Self {
        Self { geometry, front, kept: front.linear.get(), one: Linear::default() }
    }

    fn at(&mut self, v: u32) -> (&Link, &[Due], &[(Due, f64)]) {
        if let Some(kept) = self.kept {
            return kept.at(v as usize);
        }
        let one = &mut self.one;
        one.links.clear();
        one.dues.clear();
        one.of_lines.clear();
        one.add(self.geometry, self.front, self.front.ways[v as usize]);
        one.at(0)
    }
}

fn range([start, end]: [u32; 2]) -> Range<usize> {
    start as usize..end as usize
}

/// Derivatives of the time along a displacement of the timed plane.
fn weighted(tissue: &Tissue, timed: [f64; 2]) -> [f64; 3] {
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
    let mut links = Links::of(geometry, front);
    let mut total = bar.to_vec();
    front.order.each_group(true, |start, end| {
        let group = &front.order.vertices[start..end];
        if end - start > 1 {
            links.gather(group, &mut total);
        }
        for &v in group {
            let x = total[v as usize];
            if x == 0.0 {
                continue;
            }
            let (link, dues, _) = links.at(v);
            for Due { triangle, by } in dues {
                let corners = geometry.triangles[*triangle as usize].corners.map(|v| v as usize);
                into.add(corners, by.map(|g| x * g / 3.0));
            }
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
    let mut links = Links::of(geometry, front);
    let is_along_line = |v: u32| matches!(front.ways[v as usize], Way::Ray(_));
    for (v, &x) in (0..).zip(total).filter(|(v, x)| **x != 0.0 && is_along_line(*v)) {
        let (_, _, of_lines) = links.at(v);
        for (Due { triangle, by }, by_thickness) in of_lines {
            let corners = geometry.triangles[*triangle as usize].corners.map(|v| v as usize);
            into.add(corners, by.map(|g| x * g / 3.0));
            if let Some(thickness) = &mut into.thickness {
                for v in corners {
                    thickness[v] += x * by_thickness / 3.0;
                }
            }
        }
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
    front.linear.get_or_init(|| Linear::new(geometry, front));
    let mut links = Links::of(geometry, front);
    let mean = |values: Option<&[f64]>, t: u32| {
        values.map_or(0.0, |values| geometry.triangles[t as usize].mean(values))
    };
    let of_medium = |change: &Medium<'_>, due: &Due| {
        let of = [Some(change.slowness), change.ratio, change.angle];
        of.iter().zip(due.by).map(|(of, by)| by * mean(*of, due.triangle)).sum::<f64>()
    };
    front.order.each_group(false, |start, end| {
        let group = &front.order.vertices[start..end];
        for &v in group {
            let (link, dues, of_lines) = links.at(v);
            let mut sum: f64 = dues.iter().map(|due| of_medium(change, due)).sum();
            for (due, by_thickness) in of_lines {
                sum += of_medium(on_lines, due)
                    + by_thickness * mean(on_lines.thickness, due.triangle);
            }
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
            links.settle(group, out);
        }
    });
}

impl Links<'_> {
    /// Links within a group: (child, parent, weight) by places in it.
    fn inside(&mut self, group: &[u32]) -> Vec<(usize, usize, f64)> {
        let mut links = vec![];
        for (child, &v) in group.iter().enumerate() {
            for (parent, weight) in self.at(v).0.parents {
                if let Some(parent) = group.iter().position(|&u| u == parent) {
                    links.push((child, parent, weight));
                }
            }
        }
        links
    }

    /// Solves `x = b + Wᵀ x` within a group; `total` holds b, then x.
    fn gather(&mut self, group: &[u32], total: &mut [f64]) {
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
    fn settle(&mut self, group: &[u32], out: &mut [f64]) {
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
