//! Lines between the openings of a left atrium, which divide it into a posterior and an anterior half.
//!
//! ```text
//! roof        from LSPV to RSPV; on along each of these veins to where it is nearest to the inferior one
//! left seam   from there, between LIPV and LSPV, to halfway between LIPV and the mitral valve, to the valve
//! right seam  the same on the right
//! ```
//! Where an atlas has landmarks set by hand, on the lateral wall and on the septum, this has the middle of the shortest
//! way from the inferior vein to the valve. On the left that is the mitral isthmus, so the appendage lies in front.

use super::AnatomyError;
use super::openings::{Opening, Openings};
use super::ways::{Ways, lengths, sides};
use crate::mesh::TriMesh;
use std::collections::{BTreeMap, BTreeSet};

/// The lines, each from the vein on; and the halves.
pub(super) struct Seams {
    pub(super) roof: Vec<u32>,
    /// Of the left and of the right side.
    pub(super) sides: [Side; 2],
    /// The triangles of the posterior and of the anterior half.
    pub(super) halves: [Vec<u32>; 2],
}

/// The lines on one side.
pub(super) struct Side {
    /// From the superior vein to the mitral valve.
    pub(super) seam: Vec<u32>,
    /// The superior vein's opening, from the seam to the roof: its posterior and its anterior half.
    pub(super) arcs: [Vec<u32>; 2],
}

impl Seams {
    /// On a surface whose edges are `ways`.
    pub(super) fn new(
        mesh: &TriMesh,
        ways: &Ways,
        openings: &Openings,
    ) -> Result<Self, AnatomyError> {
        let ring = |opening| openings.of(opening);
        let rims: BTreeSet<u32> = Opening::ALL.iter().flat_map(|o| ring(*o)).copied().collect();
        let closed = |lines: &[&[u32]]| -> BTreeSet<u32> {
            rims.iter().chain(lines.iter().copied().flatten()).copied().collect()
        };
        let way = |from: &[u32], to: &[u32], lines: &[&[u32]], what| {
            let way = ways.around(from, to, &closed(lines));
            way.ok_or(AnatomyError::NoWay { what })
        };
        let veins = [(Opening::Lspv, Opening::Lipv), (Opening::Rspv, Opening::Ripv)]
            .map(|(superior, inferior)| (ring(superior), ring(inferior)));
        // where a superior vein is nearest to the inferior one, and farthest from that
        let [left, right] = veins.map(|(superior, inferior)| {
            let near = nearest(mesh, superior, inferior);
            (near, farthest(mesh, superior, near))
        });
        let roof = way(&[left.1], &[right.1], &[], "from LSPV to RSPV")?;
        let across = way(veins[0].1, veins[1].1, &[&roof], "from LIPV to RIPV")?;
        let gap = |(superior, inferior): (&[u32], &[u32]), near: u32| {
            way(
                &[near],
                &[nearest(mesh, inferior, superior)],
                &[&roof],
                "between the veins of a side",
            )
        };
        let gaps = [gap(veins[0], left.0)?, gap(veins[1], right.0)?];
        let seam = |side: usize, near: u32, other: &[u32]| {
            let wall = way(
                veins[side].1,
                ring(Opening::Mv),
                &[&roof, &across, other],
                "from an inferior vein to the valve",
            )?;
            let length = lengths(ways, &wall);
            let half = length.iter().position(|l| 2.0 * l >= length[length.len() - 1]).unwrap_or(0);
            let (_, end) = wall.split_at(half);
            let lines = [&roof[..], &across, &gaps[1 - side], other, end];
            let mut seam =
                way(&[near], &end[..1], &lines, "from a superior vein to the wall below")?;
            seam.extend(&end[1..]);
            Ok::<_, AnatomyError>(seam)
        };
        let left_seam = seam(0, left.0, &[])?;
        let right_seam = seam(1, right.0, &left_seam)?;
        let arcs = |side: usize, (near, far): (u32, u32)| {
            let [a, b] = arcs(veins[side].0, near, far);
            // the posterior one is the nearer to what lies between the inferior veins
            let [to_a, to_b] = [&a, &b].map(|arc| {
                let middle = arc[arc.len() / 2];
                ways.between(&[middle], &across).map_or(f64::INFINITY, |way| ways.length(&way))
            });
            if to_a < to_b { [a, b] } else { [b, a] }
        };
        let arcs = [arcs(0, left), arcs(1, right)];
        let halves = halves(mesh, &[&roof, &left_seam, &right_seam], openings)?;
        let [a, b] = arcs;
        let sides = [Side { seam: left_seam, arcs: a }, Side { seam: right_seam, arcs: b }];
        Ok(Self { roof, sides, halves })
    }
}

/// That of `ring` which is nearest to one of `other`.
fn nearest(mesh: &TriMesh, ring: &[u32], other: &[u32]) -> u32 {
    let to_other = |v: u32| other.iter().map(|w| square(mesh, v, *w)).fold(f64::INFINITY, f64::min);
    ring.iter().copied().min_by(|a, b| to_other(*a).total_cmp(&to_other(*b))).unwrap_or(ring[0])
}

/// That of `ring` which is farthest from `from`.
fn farthest(mesh: &TriMesh, ring: &[u32], from: u32) -> u32 {
    let far = |v: &u32| square(mesh, *v, from);
    ring.iter().copied().max_by(|a, b| far(a).total_cmp(&far(b))).unwrap_or(ring[0])
}

fn square(mesh: &TriMesh, a: u32, b: u32) -> f64 {
    let at = |v: u32| mesh.vertices()[v as usize];
    at(a).iter().zip(at(b)).map(|(x, y)| (x - y).powi(2)).sum()
}

/// Both ways round an opening from one of its vertices to another.
fn arcs(ring: &[u32], from: u32, to: u32) -> [Vec<u32>; 2] {
    let n = ring.len();
    let begin = ring.iter().position(|v| *v == from).unwrap_or(0);
    let one = |step: usize| {
        let all = (0..n).map(|i| ring[(begin + i * step) % n]);
        let mut arc: Vec<u32> = all.take_while(|v| *v != to).collect();
        arc.push(to);
        arc
    };
    [one(1), one(n - 1)]
}

/// The triangles on the side of the lines where the inferior veins are, and the rest.
fn halves(
    mesh: &TriMesh,
    lines: &[&[u32]],
    openings: &Openings,
) -> Result<[Vec<u32>; 2], AnatomyError> {
    let ordered = |a: u32, b: u32| [a.min(b), a.max(b)];
    let cut: BTreeSet<[u32; 2]> = lines
        .iter()
        .flat_map(|line| line.windows(2).map(|pair| ordered(pair[0], pair[1])))
        .collect();
    let mut of_edge: BTreeMap<[u32; 2], Vec<u32>> = BTreeMap::new();
    for (t, side) in sides(mesh.triangles()).enumerate() {
        of_edge.entry(ordered(side[0], side[1])).or_default().push((t / 3) as u32);
    }
    let begins: BTreeSet<u32> = openings.of(Opening::Lipv).iter().copied().collect();
    let mut is_posterior = vec![false; mesh.n_triangles()];
    let mut reached: Vec<u32> = (0u32..)
        .zip(mesh.triangles())
        .filter(|(_, corners)| corners.iter().any(|v| begins.contains(v)))
        .map(|(t, _)| t)
        .collect();
    for t in &reached {
        is_posterior[*t as usize] = true;
    }
    while let Some(t) = reached.pop() {
        for side in sides(&mesh.triangles()[t as usize..][..1]) {
            let edge = ordered(side[0], side[1]);
            if cut.contains(&edge) {
                continue;
            }
            for other in &of_edge[&edge] {
                if !std::mem::replace(&mut is_posterior[*other as usize], true) {
                    reached.push(*other);
                }
            }
        }
    }
    let [posterior, anterior]: [Vec<u32>; 2] = [true, false].map(|half| {
        (0u32..).zip(&is_posterior).filter(|(_, is)| **is == half).map(|(t, _)| t).collect()
    });
    let touches = |half: &[u32], opening: Opening| {
        let ring: BTreeSet<u32> = openings.of(opening).iter().copied().collect();
        half.iter().any(|t| mesh.triangles()[*t as usize].iter().any(|v| ring.contains(v)))
    };
    if !touches(&posterior, Opening::Ripv) {
        return Err(AnatomyError::NotInTwo { what: "LIPV and RIPV are in different halves" });
    }
    if anterior.is_empty() || touches(&anterior, Opening::Lipv) || touches(&anterior, Opening::Ripv)
    {
        return Err(AnatomyError::NotInTwo { what: "there is a way around them" });
    }
    Ok([posterior, anterior])
}
