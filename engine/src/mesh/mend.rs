//! Makes a valid surface of what a file holds, as far as no choice is needed: vertices that coincide
//! are joined, triangles without area or there twice are dropped, neighbours are turned the same way.

use super::flat::{self, Flat};
use super::{MeshError, join, orient, topology, tri_mesh, vector};
use std::collections::BTreeSet;

/// Triangles after mending, and where they come from.
#[derive(Clone, Debug)]
pub(super) struct Mended {
    pub(super) triangles: Vec<[u32; 3]>,
    /// For each triangle the one of the file that it was, or was a part of.
    pub(super) origin: Vec<u32>,
    /// For each vertex the one that it was joined to: itself, if it was not.
    pub(super) target: Vec<u32>,
    pub(super) done: Done,
}

/// What was done, in numbers.
#[derive(Clone, Debug, Default)]
pub(super) struct Done {
    pub(super) joined: usize,
    pub(super) flat: usize,
    pub(super) double: usize,
    pub(super) turned: usize,
    /// What was left as it is.
    pub(super) left: Vec<&'static str>,
}

/// Why a surface cannot be mended, and the vertices where.
#[derive(Debug)]
pub(super) struct Refusal {
    pub(super) error: MeshError,
    pub(super) vertices: Vec<u32>,
}

impl From<MeshError> for Refusal {
    fn from(error: MeshError) -> Self {
        Self { error, vertices: vec![] }
    }
}

/// Mends `triangles` of `vertices` (mm). Vertices at the same place are joined, with a `tolerance`
/// (mm) those within it; a file that is to be repaired, which the tolerance means, must be orientable.
///
/// # Errors
/// `Empty`, `NotFinite` for a vertex that is used, `NonManifoldEdge`, and `NotOrientable`.
pub(super) fn mend(
    vertices: &[[f64; 3]],
    triangles: &[[u32; 3]],
    tolerance: Option<f64>,
) -> Result<Mended, Refusal> {
    check_used(vertices, triangles)?;
    let target = match tolerance {
        Some(tolerance) if tolerance > 0.0 => join::close(vertices, tolerance),
        _ => join::equal(vertices),
    };
    let mut mended = joined(vertices, triangles, target);
    if let Err(refusal) = check_edges(vertices, &mended) {
        mended = apart(vertices, triangles).filter(|_| tolerance.is_none()).ok_or(refusal)?;
    }
    if mended.triangles.is_empty() {
        return Err(MeshError::Empty.into());
    }
    match orient::orient(&mut mended.triangles) {
        Ok(turned) => mended.done.turned = turned,
        Err(error) if tolerance.is_some() => return Err(error.into()),
        Err(_) => mended.done.left.push("its triangles run either way: it has only one side"),
    }
    Ok(mended)
}

/// There must be a triangle, and every corner a place.
fn check_used(vertices: &[[f64; 3]], triangles: &[[u32; 3]]) -> Result<(), MeshError> {
    if triangles.is_empty() {
        return Err(MeshError::Empty);
    }
    let is_nowhere = |v: &&u32| vertices[**v as usize].iter().any(|x| !x.is_finite());
    match triangles.iter().flatten().filter(is_nowhere).min() {
        None => Ok(()),
        Some(&vertex) => Err(MeshError::NotFinite {
            vertex: vertex as usize,
            position: vertices[vertex as usize],
        }),
    }
}

/// The triangles with their corners joined, without those that have no area or are there twice.
fn joined(vertices: &[[f64; 3]], triangles: &[[u32; 3]], target: Vec<u32>) -> Mended {
    let used: BTreeSet<u32> = triangles.iter().flatten().copied().collect();
    let n_joined = |target: &[u32]| used.iter().filter(|v| target[**v as usize] != **v).count();
    let mut mended = Mended {
        triangles: triangles.to_vec(),
        origin: (0..triangles.len() as u32).collect(),
        done: Done::default(),
        target,
    };
    mended.rename();
    mended.done.flat += mended.keep(|t| tri_mesh::repeated(t).is_none());
    mended.drop_doubles();
    // A flat triangle is joined or turned away, after which others may be flat.
    for _ in 0..flat::MOST_ROUNDS {
        let Flat { joined, turned, n } =
            flat::resolve(vertices, &mut mended.triangles, &mut mended.origin);
        mended.done.flat += joined.len() + turned;
        for [from, into] in joined {
            mended.target[from as usize] = into;
        }
        mended.rename();
        mended.keep(|t| tri_mesh::repeated(t).is_none());
        mended.drop_doubles();
        if n == 0 {
            break;
        }
    }
    let is_flat = |t: [u32; 3]| tri_mesh::is_flat(t.map(|v| vector(vertices[v as usize])));
    mended.done.flat += mended.keep(|t| !is_flat(t));
    mended.done.joined = n_joined(&mended.target);
    mended
}

impl Mended {
    /// Lets every corner be the vertex that it was joined to.
    fn rename(&mut self) {
        for v in 0..self.target.len() {
            let mut first = v;
            while self.target[first] as usize != first {
                first = self.target[first] as usize;
            }
            self.target[v] = first as u32;
        }
        for v in self.triangles.iter_mut().flatten() {
            *v = self.target[*v as usize];
        }
    }

    /// Keeps the triangles that `is_good`; returns how many it was not true of.
    fn keep(&mut self, mut is_good: impl FnMut([u32; 3]) -> bool) -> usize {
        let before = self.triangles.len();
        let good: Vec<bool> = self.triangles.iter().map(|t| is_good(*t)).collect();
        let mut next = good.iter();
        self.triangles.retain(|_| next.next().is_none_or(|good| *good));
        let mut next = good.iter();
        self.origin.retain(|_| next.next().is_none_or(|good| *good));
        before - self.triangles.len()
    }

    /// Drops all but the first of the triangles with the same corners.
    fn drop_doubles(&mut self) {
        let mut seen = BTreeSet::new();
        self.done.double += self.keep(|mut corners| {
            corners.sort_unstable();
            seen.insert(corners)
        });
    }
}

/// The triangles without any vertices joined, if they are a surface that joining made branch: two layers
/// that touch. Triangles that share no vertex at all are none.
fn apart(vertices: &[[f64; 3]], triangles: &[[u32; 3]]) -> Option<Mended> {
    let mut mended = joined(vertices, triangles, (0..vertices.len() as u32).collect());
    let pieces = topology::pieces(vertices.len(), &mended.triangles);
    let mut sizes = vec![0; vertices.len()];
    mended.triangles.iter().for_each(|t| sizes[pieces[t[0] as usize] as usize] += 1);
    let largest = sizes.into_iter().max().unwrap_or(0);
    let is_surface = 4 * largest >= mended.triangles.len();
    if !is_surface || check_edges(vertices, &mended).is_err() {
        return None;
    }
    mended.done.left.push("vertices at one place are not joined: the surface would branch there");
    Some(mended)
}

/// No edge may have more than two triangles.
fn check_edges(vertices: &[[f64; 3]], mended: &Mended) -> Result<(), Refusal> {
    let sides = topology::sides(&mended.triangles);
    let bad: Vec<&[topology::Side]> =
        topology::edges(&sides).filter(|edge| edge.len() > 2).collect();
    let Some(first) = bad.first() else { return Ok(()) };
    Err(Refusal {
        vertices: bad.iter().flat_map(|edge| edge[0].ends).collect(),
        error: MeshError::NonManifoldEdge {
            edge: first[0].ends,
            at: first[0].ends.map(|v| vertices[v as usize]),
            triangles: first.iter().map(|side| mended.origin[side.triangle as usize]).collect(),
            n_edges: bad.len(),
        },
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(x: f64, z: f64) -> [[f64; 3]; 4] {
        [[x, 0.0, z], [x + 1.0, 0.0, z], [x + 1.0, 1.0, z], [x, 1.0, z]]
    }

    /// Two squares side by side, each with its own corners, one of them turned over, and a double and a
    /// degenerate triangle.
    #[test]
    fn what_needs_no_choice_is_mended() {
        let vertices = [square(0.0, 0.0), square(1.0, 0.0)].concat();
        let triangles =
            [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 7, 6], [2, 0, 1], [1, 1, 4], [0, 1, 5]];
        let mended = mend(&vertices, &triangles, None).unwrap();
        assert_eq!(mended.triangles, [[0, 1, 2], [0, 2, 3], [1, 5, 6], [1, 6, 2]]);
        assert_eq!(mended.origin, [0, 1, 2, 3]);
        assert_eq!(mended.target, [0, 1, 2, 3, 1, 5, 6, 2]);
        let Done { joined, flat, double, turned, .. } = mended.done;
        assert_eq!((joined, flat, double, turned), (2, 2, 1, 1));
    }

    #[test]
    fn a_tolerance_joins_what_is_close() {
        let vertices = [square(0.0, 0.0), square(1.0 + 1e-9, 0.0)].concat();
        let triangles = [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]];
        assert_eq!(mend(&vertices, &triangles, None).unwrap().done.joined, 0);
        assert_eq!(mend(&vertices, &triangles, Some(1e-6)).unwrap().done.joined, 2);
    }

    #[test]
    fn layers_that_touch_stay_apart_and_a_branch_is_refused() {
        // Two sheets with the same places along an edge: joined they would branch.
        let vertices = [square(0.0, 0.0), square(0.0, 0.0), square(1.0, 0.0)].concat();
        let two = [[0, 1, 2], [0, 2, 3], [8, 9, 10], [8, 10, 11], [4, 5, 7], [5, 6, 7]];
        let mended = mend(&vertices, &two, None).unwrap();
        assert_eq!((mended.triangles.len(), mended.done.left.len()), (6, 1));
        let corners =
            [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]];
        let refusal = mend(&corners, &[[0, 1, 2], [1, 0, 3], [0, 1, 4]], None).unwrap_err();
        assert_eq!(refusal.vertices, [0, 1]);
        assert!(matches!(refusal.error, MeshError::NonManifoldEdge { n_edges: 1, .. }));
    }

    #[test]
    fn only_used_vertices_need_a_place() {
        let mut vertices = square(0.0, 0.0).to_vec();
        vertices.push([f64::NAN; 3]);
        assert!(mend(&vertices, &[[0, 1, 2]], None).is_ok());
        let refusal = mend(&vertices, &[[0, 1, 4]], None).unwrap_err();
        assert!(matches!(refusal.error, MeshError::NotFinite { vertex: 4, .. }));
    }
}
