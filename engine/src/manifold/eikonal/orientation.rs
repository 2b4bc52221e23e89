//! Which way is out: unit normals of the triangles that agree between neighbours.

use super::super::laplacian::{cross, dot, subtract};
use super::way::NONE;
use crate::mesh::TriMesh;

/// Less of the volume that a sphere of its area has, and a piece has no inside.
const LEAST_VOLUME: f64 = 1e-3;

/// Outward unit normal of every triangle, given the `beyond` of each.
///
/// Neighbours are made to agree, each piece the way that most of its triangles run round. A piece that
/// encloses a volume about its centre, also an open shell, is then turned so that its normals point out of it;
/// a flat one keeps the way of its triangles.
pub(super) fn outward(mesh: &TriMesh, beyond: &[[u32; 3]]) -> Vec<[f64; 3]> {
    let areas: Vec<[f64; 3]> = (0..mesh.n_triangles()).map(|t| area_vector(mesh, t)).collect();
    let mut sign = vec![0.0; areas.len()];
    for start in 0..areas.len() {
        if sign[start] != 0.0 {
            continue;
        }
        let piece = agree(mesh, beyond, start, &mut sign);
        let turn = way_out(mesh, &areas, &piece, &sign);
        for &t in &piece {
            sign[t] *= turn;
        }
    }
    let unit = |(area, sign): (&[f64; 3], f64)| {
        let size = dot(*area, *area).sqrt();
        area.map(|x| sign * x / size)
    };
    areas.iter().zip(sign).map(unit).collect()
}

/// Twice the area of a triangle times the unit normal that its corners run round.
fn area_vector(mesh: &TriMesh, triangle: usize) -> [f64; 3] {
    let [a, b, c] = mesh.triangles()[triangle].map(|v| mesh.vertices()[v as usize]);
    cross(subtract(b, a), subtract(c, a))
}

/// Gives the triangles of the piece of `start` signs that agree, and lists them.
fn agree(mesh: &TriMesh, beyond: &[[u32; 3]], start: usize, sign: &mut [f64]) -> Vec<usize> {
    sign[start] = 1.0;
    let mut piece = vec![start];
    let mut next = 0;
    while let Some(&at) = piece.get(next) {
        next += 1;
        for side in 0..3 {
            let other = beyond[at][side];
            if other == NONE || sign[other as usize] != 0.0 {
                continue;
            }
            let corners = mesh.triangles()[at];
            let (a, b) = (corners[(side + 1) % 3], corners[(side + 2) % 3]);
            let other = other as usize;
            let runs = mesh.triangles()[other];
            let is_opposite = (0..3).any(|i| runs[i] == b && runs[(i + 1) % 3] == a);
            sign[other] = if is_opposite { sign[at] } else { -sign[at] };
            piece.push(other);
        }
    }
    piece
}

/// 1, or −1 if the normals of a piece are to be turned.
fn way_out(mesh: &TriMesh, areas: &[[f64; 3]], piece: &[usize], sign: &[f64]) -> f64 {
    let middle = |t: usize| -> [f64; 3] {
        let at = mesh.triangles()[t].map(|v| mesh.vertices()[v as usize]);
        std::array::from_fn(|k| (at[0][k] + at[1][k] + at[2][k]) / 3.0)
    };
    let (mut total, mut centre, mut votes) = (0.0, [0.0; 3], 0.0);
    for &t in piece {
        let area = 0.5 * dot(areas[t], areas[t]).sqrt();
        let middle = middle(t);
        total += area;
        votes += sign[t];
        for k in 0..3 {
            centre[k] += area * middle[k];
        }
    }
    let centre = centre.map(|x| x / total);
    let of = |t: &usize| sign[*t] * dot(areas[*t], subtract(middle(*t), centre)) / 6.0;
    let volume: f64 = piece.iter().map(of).sum();
    let sphere = total.powf(1.5) / (6.0 * std::f64::consts::PI.sqrt());
    let deciding = if volume.abs() > LEAST_VOLUME * sphere { volume } else { votes };
    if deciding < 0.0 { -1.0 } else { 1.0 }
}
