//! A surface with fewer vertices, and the way between the two for fields.
//!
//! Edges are collapsed where the surface moves least, by the quadric error of M. Garland and
//! P. Heckbert (1997). One end of an edge goes, the other stays where it is: what is left are vertices of
//! the file, with their numbers and data.

use super::carry::{are_labels, mean_fibre};
use super::connectivity::Connectivity;
use super::nearest::nearest;
use super::quadric::Quadric;
use super::surface::{DROPPED, OnTriangle, Places, heaviest};
use super::{Data, Fine, MeshError, Surface, TriMesh, data, vector};
use nalgebra::Vector3;
use std::cmp::Ordering;
use std::collections::{BTreeMap, BinaryHeap};

type Point = Vector3<f64>;

/// Smallest shape of a new triangle: 4√3 area over the sum of the squared sides, 1 if they are equal.
const THINNEST: f64 = 0.3;
/// Weight of the border's shape beside the surface's.
const BORDER: f64 = 10.0;
/// Weight of an edge's length to the fourth beside the quadric error: even triangles in flat places.
const EVEN: f64 = 1e-2;

/// A coarser triangulation between some of the vertices of a surface.
#[derive(Clone, Debug)]
pub struct Coarse {
    /// The triangulation.
    pub mesh: TriMesh,
    /// The vertex of the surface that each of `mesh` is, ascending (one per vertex).
    pub vertices: Vec<u32>,
    /// The triangle of the surface whose middle is nearest to that of each of `mesh` (one per triangle).
    pub triangles: Vec<u32>,
    /// Where the vertices of the surface are on `mesh`.
    pub places: Places,
}

impl Coarse {
    /// Fibres of its triangles: the axis nearest to those of the surface's `vertices` in each, and of the triangle nearest to its
    /// middle, in its plane. `fibres` are the surface's, one for each of its triangles.
    pub(crate) fn mean_fibres(&self, vertices: &[[f64; 3]], fibres: &[[f64; 3]]) -> Vec<[f64; 3]> {
        let mut inside: BTreeMap<[u32; 3], Vec<[f64; 3]>> = BTreeMap::new();
        for (v, fibre) in vertices.iter().enumerate() {
            let mut corners: Vec<u32> = self.places.on(v).map(|(corner, _)| corner).collect();
            corners.sort_unstable();
            // a vertex at the border of triangles depends on fewer
            if let [a, b, c] = corners[..] {
                inside.entry([a, b, c]).or_default().push(*fibre);
            }
        }
        let of_triangle = |(t, nearest): (usize, &u32)| {
            let mut corners = self.mesh.triangles()[t];
            corners.sort_unstable();
            let own = fibres[*nearest as usize];
            let all = inside.get(&corners).into_iter().flatten().copied().chain([own]);
            let mean = mean_fibre(&self.mesh, t, all);
            // what has no direction here is refused by name where it is used
            if mean.iter().all(|x| *x == 0.0) { own } else { mean }
        };
        self.triangles.iter().enumerate().map(of_triangle).collect()
    }
}

impl TriMesh {
    /// A triangulation between about `n_vertices` of the vertices, among them all that `stay`; between more where
    /// fewer would fold it or change its topology.
    ///
    /// # Errors
    /// What [`TriMesh::new`] refuses.
    pub fn coarsened(&self, n_vertices: usize, stay: &[u32]) -> Result<Coarse, MeshError> {
        let mut decimation = Decimation::new(self);
        for vertex in stay {
            decimation.stays[*vertex as usize] = true;
        }
        decimation.run(n_vertices);
        let Decimation { faces, parent, points, .. } = decimation;
        let vertices: Vec<u32> =
            (0..points.len() as u32).filter(|v| parent[*v as usize] == *v).collect();
        let mut number = vec![DROPPED; points.len()];
        for (new, old) in (0..).zip(&vertices) {
            number[*old as usize] = new;
        }
        let triangles: Vec<[u32; 3]> =
            faces.triangles().map(|t| t.map(|v| number[v as usize])).collect();
        let kept = vertices.iter().map(|v| points[*v as usize].into()).collect();
        let mesh = Self::new(kept, triangles)?;
        let places = places(self, &mesh, |v| number[root(&parent, v as u32) as usize]);
        let triangles = sampled_triangles(self, &mesh, &places);
        Ok(Coarse { mesh, vertices, triangles, places })
    }
}

impl Surface {
    /// This surface with about `n_vertices`; more where fewer would fold it or change its topology.
    ///
    /// # Errors
    /// What [`TriMesh::new`] refuses.
    pub fn decimated(self, n_vertices: usize) -> Result<Self, MeshError> {
        let Coarse { mesh, vertices, triangles, places } = self.mesh.coarsened(n_vertices, &[])?;
        let distances = distances(&self.mesh, &mesh, &places);
        let nearest: Vec<u32> = places.0.iter().map(heaviest).collect();
        let vertex_of = self.vertex_of.iter().map(|v| match *v {
            DROPPED => DROPPED,
            v => nearest[v as usize],
        });
        let mut coarse = Self {
            source_vertex: vertices.iter().map(|v| self.source_vertex[*v as usize]).collect(),
            n_source_vertices: self.n_source_vertices,
            dropped: self.dropped.clone(),
            point_data: data::pick(&self.point_data, &vertices),
            cell_data: data::pick(&self.cell_data, &triangles),
            units: self.units,
            axes: self.axes,
            notes: self.notes.clone(),
            vertex_of: vertex_of.collect(),
            fine: None,
            mesh,
        };
        let fine = Fine { surface: self, places, distances };
        coarse.notes.push(note(&coarse, &fine));
        coarse.fine = Some(fine.into());
        Ok(coarse)
    }
}

fn root(parent: &[u32], mut v: u32) -> u32 {
    while parent[v as usize] != v {
        v = parent[v as usize];
    }
    v
}

/// What was done, and how far scalars that went there and back are off.
fn note(coarse: &Surface, fine: &Fine) -> String {
    let [mean, most] = fine.distances;
    let mut note = format!(
        "decimated from {} to {} vertices: the surface moves by {mean:.3} mm on average, {most:.2} mm at most",
        fine.surface.mesh.n_vertices(),
        coarse.mesh.n_vertices()
    );
    let off = errors(&fine.surface.point_data, &coarse.point_data, fine);
    if !off.is_empty() {
        note = format!("{note}; carried there and back are off by (rms): {}", off.join(", "));
    }
    note
}

fn errors(fine_data: &Data, coarse: &Data, fine: &Fine) -> Vec<String> {
    let error = |(name, array): (&String, &super::Array)| {
        let back = fine.carry(coarse.get(name)?.scalars()?);
        let scalars = array.scalars().filter(|_| !are_labels(array))?;
        let pairs = scalars.iter().zip(back);
        let known = pairs.filter(|(a, b)| a.is_finite() && b.is_finite());
        let (n, sum) =
            known.fold((0_u32, 0.0), |(n, sum), (a, b)| (n + 1, sum + (a - b) * (a - b)));
        (n > 0).then(|| format!("{name} {:.3}", (sum / f64::from(n)).sqrt()))
    };
    fine_data.iter().filter_map(error).collect()
}

/// Where each vertex of `fine` is on `coarse`: on one of the triangles about the vertex it was joined to.
fn places(fine: &TriMesh, coarse: &TriMesh, root: impl Fn(usize) -> u32) -> Places {
    let surface = Connectivity::new(coarse.n_vertices(), coarse.triangles());
    let at = |v: u32| vector(coarse.vertices()[v as usize]);
    let place = |v: usize| {
        let (p, home) = (vector(fine.vertices()[v]), root(v));
        let ring = surface.neighbours(home);
        let near = [home].into_iter().chain(ring).flat_map(|w| surface.around(w));
        let weighted = near.map(|t| (t, nearest(t.map(at), p)));
        let distance = |(t, w): &OnTriangle| {
            let q: Point = (0..3).map(|k| at(t[k]) * w[k]).sum();
            (q - p).norm_squared()
        };
        let best = weighted.min_by(|a, b| distance(a).total_cmp(&distance(b)));
        best.unwrap_or(([home; 3], [1.0, 0.0, 0.0]))
    };
    Places((0..fine.n_vertices()).map(place).collect())
}

fn distances(fine: &TriMesh, coarse: &TriMesh, Places(places): &Places) -> [f64; 2] {
    let distance = |(v, (t, w)): (usize, &OnTriangle)| {
        let q: Point = (0..3).map(|k| vector(coarse.vertices()[t[k] as usize]) * w[k]).sum();
        (q - vector(fine.vertices()[v])).norm()
    };
    let all = places.iter().enumerate().map(distance);
    let (sum, most) = all.fold((0.0, 0.0), |(sum, most): (f64, f64), d| (sum + d, most.max(d)));
    [sum / places.len() as f64, most]
}

/// For each triangle of `coarse` the one of `fine` whose middle is nearest to its own.
fn sampled_triangles(fine: &TriMesh, coarse: &TriMesh, Places(places): &Places) -> Vec<u32> {
    let middle = |mesh: &TriMesh, t: [u32; 3]| {
        t.iter().map(|v| vector(mesh.vertices()[*v as usize])).sum::<Point>() / 3.0
    };
    // Of each coarse vertex the fine triangles that lie about it.
    let mut about = vec![vec![]; coarse.n_vertices()];
    for (t, corners) in (0u32..).zip(fine.triangles()) {
        for v in places[corners[0] as usize].0 {
            about[v as usize].push(t);
        }
    }
    let nearest = |t: &[u32; 3]| {
        let home = middle(coarse, *t);
        let far = |f: &u32| (middle(fine, fine.triangles()[*f as usize]) - home).norm_squared();
        let all = t.iter().flat_map(|v| about[*v as usize].iter().copied());
        all.min_by(|a, b| far(a).total_cmp(&far(b))).unwrap_or(0)
    };
    coarse.triangles().iter().map(nearest).collect()
}

/// The edge whose end `from` would go to `into`, at a cost that was true when both had these versions.
#[derive(Debug, PartialEq)]
struct Collapse {
    cost: f64,
    ends: [u32; 2],
    versions: [u32; 2],
}

impl Eq for Collapse {}

impl PartialOrd for Collapse {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Collapse {
    /// The cheapest is the greatest, which a heap gives first; of equals the first vertices.
    fn cmp(&self, other: &Self) -> Ordering {
        other.cost.total_cmp(&self.cost).then_with(|| other.ends.cmp(&self.ends))
    }
}

struct Decimation {
    points: Vec<Point>,
    faces: Connectivity,
    quadrics: Vec<Quadric>,
    is_border: Vec<bool>,
    /// Vertices that are not joined to others.
    stays: Vec<bool>,
    versions: Vec<u32>,
    /// The vertex that one was joined to; itself, if it is left.
    parent: Vec<u32>,
    heap: BinaryHeap<Collapse>,
}

impl Decimation {
    fn new(mesh: &TriMesh) -> Self {
        let points: Vec<Point> = mesh.vertices().iter().map(|p| vector(*p)).collect();
        let n = points.len();
        let faces = Connectivity::new(n, mesh.triangles());
        let mut quadrics = vec![Quadric::default(); n];
        let mut is_border = vec![false; n];
        for t in mesh.triangles() {
            let corners = t.map(|v| points[v as usize]);
            let plane = Quadric::of_triangle(corners);
            for k in 0..3 {
                quadrics[t[k] as usize] += plane;
                let (a, b) = (t[k], t[(k + 1) % 3]);
                if faces.is_border(a, b) {
                    let wall = Quadric::of_wall(corners, k) * BORDER;
                    for v in [a, b] {
                        is_border[v as usize] = true;
                        quadrics[v as usize] += wall;
                    }
                }
            }
        }
        let edges = faces.edges();
        let parent = (0..n as u32).collect();
        let (stays, versions, heap) = (vec![false; n], vec![0; n], BinaryHeap::new());
        let mut this = Self { points, faces, quadrics, is_border, stays, versions, parent, heap };
        for [a, b] in edges {
            this.offer(a, b);
            this.offer(b, a);
        }
        this
    }

    fn at(&self, v: u32) -> Point {
        self.points[v as usize]
    }

    fn offer(&mut self, from: u32, into: u32) {
        let (p, length) = (self.at(into), (self.at(from) - self.at(into)).norm_squared());
        let quadric = self.quadrics[from as usize] + self.quadrics[into as usize];
        let cost = quadric.at(p) + EVEN * length * length;
        let versions = [from, into].map(|v| self.versions[v as usize]);
        self.heap.push(Collapse { cost, ends: [from, into], versions });
    }

    /// Collapses the cheapest edges until `n_vertices` are left, or none may be.
    fn run(&mut self, n_vertices: usize) {
        let mut n = self.points.len();
        while n > n_vertices
            && let Some(Collapse { ends: [from, into], versions, .. }) = self.heap.pop()
        {
            if [from, into].map(|v| self.versions[v as usize]) != versions
                || !self.may_collapse(from, into)
            {
                continue;
            }
            self.faces.collapse(from, into);
            self.parent[from as usize] = into;
            self.quadrics[into as usize] =
                self.quadrics[from as usize] + self.quadrics[into as usize];
            self.versions[from as usize] += 1;
            self.versions[into as usize] += 1;
            n -= 1;
            for w in self.faces.neighbours(into) {
                self.offer(into, w);
                self.offer(w, into);
            }
        }
    }

    /// Whether the surface keeps its topology and its borders, and no triangle is turned over or thin.
    fn may_collapse(&self, from: u32, into: u32) -> bool {
        let is_border = self.is_border[from as usize];
        if self.stays[from as usize] || is_border && !self.faces.is_border(from, into) {
            return false;
        }
        let min_left = |v: u32| if self.is_border[v as usize] { 1 } else { 3 };
        if !self.faces.may_collapse(from, into, min_left) {
            return false;
        }
        let stays = self.faces.around(from).filter(|t| !t.contains(&into));
        stays.into_iter().all(|t| {
            let before = t.map(|v| self.at(v));
            let after = t.map(|v| self.at(if v == from { into } else { v }));
            let [old, new] = [before, after].map(super::area_vector);
            let [a, b, c] = after;
            let sides = (b - a).norm_squared() + (c - b).norm_squared() + (a - c).norm_squared();
            let shape = 2.0 * 3f64.sqrt() * new.norm() / sides;
            new.dot(&old) > 0.2 * new.norm() * old.norm() && shape > THINNEST
        })
    }
}

#[cfg(test)]
#[allow(clippy::float_cmp, reason = "what is handed on")]
mod tests {
    use super::super::carry::fibres_to_vertices;
    use crate::mesh::TriMesh;

    /// A sheet of 30 mm whose fibres run along the first axis, but that each is turned by up to 0.8 rad.
    fn rough() -> (TriMesh, Vec<[f64; 3]>) {
        let n = 30_u32;
        let nodes = || (0..=n).flat_map(|i| (0..=n).map(move |j| (i, j)));
        let vertices = nodes().map(|(i, j)| [f64::from(i), f64::from(j), 0.0]).collect();
        let corner = |i: u32, j: u32| i * (n + 1) + j;
        let squares = (0..n).flat_map(|i| (0..n).map(move |j| (i, j)));
        let cut = |(i, j): (u32, u32)| {
            let [p, q, r, s] =
                [corner(i, j), corner(i, j + 1), corner(i + 1, j), corner(i + 1, j + 1)];
            [[p, s, q], [p, r, s]]
        };
        let mesh = TriMesh::new(vertices, squares.flat_map(cut).collect()).unwrap();
        let turned = |t: usize| {
            let angle = 0.8 * (1.7 * (t * t) as f64).sin();
            [angle.cos(), angle.sin(), 0.0]
        };
        let fibres = (0..mesh.n_triangles()).map(turned).collect();
        (mesh, fibres)
    }

    #[test]
    fn fibres_of_large_triangles_are_means() {
        let (mesh, fibres) = rough();
        let coarse = mesh.coarsened(60, &[]).unwrap();
        let at_vertices = fibres_to_vertices(&mesh, &fibres);
        let off = |fibres: &[[f64; 3]]| {
            let square = |f: &[f64; 3]| (f[1] / f[0]).atan().powi(2);
            (fibres.iter().map(square).sum::<f64>() / fibres.len() as f64).sqrt()
        };
        let mean = coarse.mean_fibres(&at_vertices, &fibres);
        let sampled: Vec<[f64; 3]> = coarse.triangles.iter().map(|t| fibres[*t as usize]).collect();
        println!("off by {:.3} rad, of one triangle each {:.3}", off(&mean), off(&sampled));
        assert!(mean.len() == coarse.mesh.n_triangles() && off(&mean) < 0.5 * off(&sampled));
        // one that points out of the sheet has no part in a mean
        let out = vec![[0.0, 0.0, 1.0]; fibres.len()];
        assert_eq!(coarse.mean_fibres(&vec![[0.0, 0.0, 1.0]; mesh.n_vertices()], &out)[0], out[0]);
    }
}
