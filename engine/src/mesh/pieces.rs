//! The connected pieces of a mesh, and which of them is the surface.

use super::{MeshError, Piece, area_vector, topology, vector};

/// A piece with this part of the largest one's area is no stray one: which is meant is the user's choice.
const COMPARABLE: f64 = 0.1;

/// The pieces that have triangles, by area, the largest first.
#[derive(Debug)]
pub(super) struct Pieces {
    /// For each vertex the place of its piece in `ranked`; of unused vertices none.
    rank_of: Vec<Option<u32>>,
    pub(super) ranked: Vec<Piece>,
}

impl Pieces {
    /// The pieces of `triangles`.
    pub(super) fn new(vertices: &[[f64; 3]], triangles: &[[u32; 3]]) -> Self {
        let piece_of = topology::pieces(vertices.len(), triangles);
        let n_pieces = piece_of.iter().max().map_or(0, |last| *last as usize + 1);
        let mut area = vec![0.0; n_pieces];
        let mut is_used = vec![false; vertices.len()];
        for t in triangles {
            let corners = t.map(|v| vector(vertices[v as usize]));
            area[piece_of[t[0] as usize] as usize] += 0.5 * area_vector(corners).norm();
            for v in t {
                is_used[*v as usize] = true;
            }
        }
        let (mut n_vertices, mut sum) = (vec![0_usize; n_pieces], vec![[0.0; 3]; n_pieces]);
        for v in (0..vertices.len()).filter(|v| is_used[*v]) {
            let piece = piece_of[v] as usize;
            n_vertices[piece] += 1;
            (0..3).for_each(|k| sum[piece][k] += vertices[v][k]);
        }
        let mut order: Vec<usize> = (0..n_pieces).filter(|p| n_vertices[*p] > 0).collect();
        // A stable sort: of equal pieces the first in the file comes first.
        order.sort_by(|a, b| area[*b].total_cmp(&area[*a]));
        let mut rank = vec![None; n_pieces];
        order.iter().zip(0..).for_each(|(piece, r)| rank[*piece] = Some(r));
        let described = |p: &usize| Piece {
            n_vertices: n_vertices[*p],
            area: area[*p],
            centre: sum[*p].map(|x| x / n_vertices[*p] as f64),
        };
        Self {
            rank_of: piece_of.iter().map(|p| rank[*p as usize]).collect(),
            ranked: order.iter().map(described).collect(),
        }
    }

    /// The place in `ranked` of a vertex' piece; `None` if no triangle has it.
    pub(super) fn rank_of(&self, vertex: u32) -> Option<usize> {
        self.rank_of[vertex as usize].map(|rank| rank as usize)
    }

    /// The place in `ranked` of the piece that is wanted, counted from 1; of the largest if none is.
    ///
    /// # Errors
    /// `NoPiece`; `SeveralPieces` if none is wanted and the largest is not much the largest.
    pub(super) fn choose(&self, wanted: Option<usize>) -> Result<usize, MeshError> {
        let n_pieces = self.ranked.len();
        if let Some(piece) = wanted {
            let is_there = (1..=n_pieces).contains(&piece);
            return if is_there {
                Ok(piece - 1)
            } else {
                Err(MeshError::NoPiece { piece, n_pieces })
            };
        }
        let least = self.ranked.first().map_or(0.0, |first| COMPARABLE * first.area);
        let large: Vec<Piece> = self.ranked.iter().filter(|p| p.area >= least).cloned().collect();
        if large.len() > 1 { Err(MeshError::SeveralPieces { pieces: large }) } else { Ok(0) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_ranked_by_area_and_a_choice_is_asked_for() {
        let mut vertices = vec![[9.0; 3]];
        for (x, size) in [(0.0, 1.0), (10.0, 4.0), (20.0, 3.0)] {
            vertices.extend([[x, 0.0, 0.0], [x + size, 0.0, 0.0], [x, size, 0.0]]);
        }
        let triangles = [[1, 2, 3], [4, 5, 6], [7, 8, 9]];
        let pieces = Pieces::new(&vertices, &triangles);
        assert_eq!([0, 1, 4, 7].map(|v| pieces.rank_of(v)), [None, Some(2), Some(0), Some(1)]);
        assert_eq!(pieces.choose(Some(2)).unwrap(), 1);
        let text = pieces.choose(None).unwrap_err().to_string();
        assert!(text.contains("\n  1: 3 vertices, 0.1 cm², centred at (11.3, 1.3, 0.0)"), "{text}");
        assert!(text.contains("\n  2: ") && !text.contains("\n  3: "), "{text}");
        assert!(
            pieces.choose(Some(4)).unwrap_err().to_string().contains("no piece 4: the mesh has 3")
        );
        assert!(pieces.choose(Some(0)).is_err());
        let two = Pieces::new(&vertices, &triangles[..2]);
        assert_eq!(two.choose(None).unwrap(), 0, "a sixteenth is a stray piece");
    }
}
