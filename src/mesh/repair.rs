//! Makes a valid surface of a file that is not one: joins vertices that coincide, drops triangles
//! that have a vertex twice, orients the rest alike and keeps the largest piece.

use super::vtk::Content;
use super::{MeshError, Surface, Units, surface, topology, tri_mesh, vector};
use std::collections::BTreeMap;
use std::path::Path;

/// Reads the legacy VTK file `path` (coordinates in `units`) and repairs it.
///
/// Vertices closer than `tolerance` mm are joined (0 joins equal ones only; the first one's place
/// and data stay), triangles that have the same vertex twice or are there twice are dropped, and
/// neighbours are turned the same way.  What was done heads the notes of the result.
///
/// # Errors
/// As [`super::read`], for what cannot be repaired: a coordinate that is not finite, corners on one line, an edge of
/// three or more triangles, and a surface that cannot be oriented (`NotOrientable`).
pub fn repair(path: &Path, units: Units, tolerance: f64) -> Result<Surface, MeshError> {
    let content = surface::read_content(path, units)?;
    mend(content, units, tolerance)
        .map_err(|source| MeshError::Invalid { path: path.into(), source: source.into() })
}

/// As [`repair`], of a surface in memory: `vertices` in mm, `triangles` as their indices, and
/// `point_data` by name (one value per vertex).
///
/// # Errors
/// As [`repair`], and `DataLength`.
pub fn repair_arrays(
    vertices: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
    point_data: BTreeMap<String, Vec<f64>>,
) -> Result<Surface, MeshError> {
    let expected = vertices.len();
    if let Some((name, values)) = point_data.iter().find(|(_, values)| values.len() != expected) {
        return Err(MeshError::DataLength { name: name.clone(), expected, got: values.len() });
    }
    mend(Content { vertices, triangles, point_data }, Units::Mm, 0.0)
}

fn mend(mut content: Content, units: Units, tolerance: f64) -> Result<Surface, MeshError> {
    tri_mesh::check_finite(&content.vertices)?;
    for (triangle, corners) in content.triangles.iter().enumerate() {
        tri_mesh::check_range(corners.map(i64::from), triangle, content.vertices.len())?;
    }
    let n_joined = join_vertices(&mut content, tolerance);
    let n_dropped = drop_degenerate(&mut content.triangles);
    tri_mesh::validate(&content.vertices, &content.triangles)?;
    let n_turned = orient(&mut content.triangles)?;
    let mut surface = surface::largest_piece(content, units)?;
    let done = format!(
        "joined {n_joined} vertices, dropped {n_dropped} triangles (a vertex twice, or there twice), \
         turned {n_turned} triangles"
    );
    surface.notes.insert(0, done);
    Ok(surface)
}

/// Lets triangles name only the first of vertices within `tolerance` of each other; returns how
/// many others there were.
fn join_vertices(content: &mut Content, tolerance: f64) -> usize {
    // Cells of the tolerance's size: what is close is in the same or a neighbouring cell.
    let size = tolerance.max(1e-6);
    let cell_of = |p: &[f64; 3]| p.map(|x| (x / size).floor() as i64);
    let mut cells: BTreeMap<[i64; 3], Vec<u32>> = BTreeMap::new();
    let mut target = Vec::with_capacity(content.vertices.len());
    for (v, p) in (0u32..).zip(&content.vertices) {
        let is_close =
            |&w: &u32| (vector(content.vertices[w as usize]) - vector(*p)).norm() <= tolerance;
        let home = cell_of(p);
        let close = (0..27)
            .filter_map(|i| cells.get(&neighbour(home, i)))
            .flatten()
            .copied()
            .filter(is_close)
            .min();
        target.push(close.unwrap_or(v));
        if close.is_none() {
            cells.entry(home).or_default().push(v);
        }
    }
    for v in content.triangles.iter_mut().flatten() {
        *v = target[*v as usize];
    }
    target.iter().enumerate().filter(|&(v, &t)| v != t as usize).count()
}

fn neighbour([i, j, k]: [i64; 3], number: i64) -> [i64; 3] {
    let step = |axis: i64| number / axis % 3 - 1;
    [i.saturating_add(step(1)), j.saturating_add(step(3)), k.saturating_add(step(9))]
}

/// Drops triangles with a repeated vertex and all but the first of those with the same vertices.
fn drop_degenerate(triangles: &mut Vec<[u32; 3]>) -> usize {
    let before = triangles.len();
    let mut seen = std::collections::BTreeSet::new();
    triangles.retain(|&triangle| {
        let mut corners = triangle;
        corners.sort_unstable();
        tri_mesh::repeated(triangle).is_none() && seen.insert(corners)
    });
    before - triangles.len()
}

/// Turns triangles so that neighbours run opposite ways along their edge, in each piece towards
/// the way most of them had; returns how many were turned.
fn orient(triangles: &mut [[u32; 3]]) -> Result<usize, MeshError> {
    let links = links(triangles);
    let mut turn: Vec<Option<bool>> = vec![None; triangles.len()];
    let mut n_turned = 0;
    for start in 0..triangles.len() {
        if turn[start].is_some() {
            continue;
        }
        turn[start] = Some(false);
        let mut piece = vec![start];
        let mut next = 0;
        while let Some(&at) = piece.get(next) {
            next += 1;
            for &(other, agrees) in &links[at] {
                let wanted = turn[at].map(|turned| turned == agrees);
                if turn[other].is_none() {
                    turn[other] = wanted;
                    piece.push(other);
                } else if turn[other] != wanted {
                    return Err(MeshError::NotOrientable { triangles: [at, other] });
                }
            }
        }
        let turned = piece.iter().filter(|&&t| turn[t] == Some(true)).count();
        let minority = turned * 2 <= piece.len();
        for &t in piece.iter().filter(|&&t| turn[t] == Some(minority)) {
            triangles[t].swap(1, 2);
            n_turned += 1;
        }
    }
    Ok(n_turned)
}

/// For every triangle its neighbours, and whether the two already run opposite ways.
fn links(triangles: &[[u32; 3]]) -> Vec<Vec<(usize, bool)>> {
    let mut links = vec![Vec::new(); triangles.len()];
    for edge in topology::edges(&topology::sides(triangles)) {
        if let [a, b] = edge {
            let agrees = a.forward != b.forward;
            links[a.triangle as usize].push((b.triangle as usize, agrees));
            links[b.triangle as usize].push((a.triangle as usize, agrees));
        }
    }
    links
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two squares side by side, each with its own corners, one of them turned over.
    fn unwelded() -> Content {
        let square =
            |x: f64| [[x, 0.0, 0.0], [x + 1.0, 0.0, 0.0], [x + 1.0, 1.0, 0.0], [x, 1.0, 0.0]];
        Content {
            vertices: [square(0.0), square(1.0 + 1e-9)].concat(),
            triangles: vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 7, 6], [2, 0, 1], [1, 1, 4]],
            ..Content::default()
        }
    }

    #[test]
    fn close_vertices_are_joined_and_others_are_not() {
        let mut content = unwelded();
        assert_eq!(join_vertices(&mut content, 1e-6), 2);
        assert_eq!(content.triangles[2..4], [[1, 5, 6], [1, 2, 6]]);
        assert_eq!(join_vertices(&mut unwelded(), 0.0), 0);
    }

    #[test]
    fn degenerate_and_double_triangles_are_dropped() {
        let mut triangles = unwelded().triangles;
        assert_eq!(drop_degenerate(&mut triangles), 2);
        assert_eq!(triangles, [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 7, 6]]);
    }

    #[test]
    fn the_minority_is_turned() {
        let mut triangles = vec![[0, 1, 2], [0, 2, 3], [2, 0, 4], [7, 8, 9], [7, 8, 10]];
        triangles.remove(2);
        triangles.extend([[3, 2, 5], [5, 3, 6]]);
        assert_eq!(orient(&mut triangles).unwrap(), 2);
        assert_eq!(triangles[..2], [[0, 1, 2], [0, 2, 3]]);
        let sides = topology::sides(&triangles);
        assert!(topology::edges(&sides).all(|e| e.len() == 1 || e[0].forward != e[1].forward));
    }

    #[test]
    fn a_moebius_band_cannot_be_oriented() {
        let mut band: Vec<[u32; 3]> = (0..5).map(|i| [i, (i + 1) % 5, (i + 2) % 5]).collect();
        let text = orient(&mut band).unwrap_err().to_string();
        assert!(text.starts_with("the surface cannot be oriented: triangles"), "{text}");
        assert!(text.ends_with("help: cut the band open in a mesh editor"), "{text}");
    }
}
