//! The matrices of a time step, laid out for products with vectors: rows in patches of neighbours.

use super::Substrate;
use super::assembly::{Row, patches, rows};
use super::lanes::BLOCK;
use crate::ep::precision::Precision;
use std::ops::Range;

/// `A = M + ½ dt K` and `dt K` by rows: M the consistent mass (mm²), K the stiffness with the diffusivity
/// in it (mm²/ms). Rows beyond the mesh's vertices fill the last block; nothing refers to them.
#[derive(Debug)]
pub(super) struct Operators<F> {
    /// The mesh's vertex behind each row.
    pub(super) vertex: Vec<u32>,
    blocks: Vec<Rows<F>>,
    /// 1 / A(i, i).
    pub(super) inverse_diagonal: Vec<[F; BLOCK]>,
}

/// The rows of a block.
#[derive(Debug)]
struct Rows<F> {
    /// Rows of equally many entries follow each other, so that the processor foresees where they end.
    runs: Vec<Run>,
    column: Vec<u32>,
    /// Entries of A and of `dt K`.
    implicit: Vec<F>,
    stiffness: Vec<F>,
}

/// Neighbouring rows of `length` entries each.
#[derive(Debug)]
struct Run {
    length: usize,
    rows: Range<usize>,
    entries: Range<usize>,
}

impl<F: Precision> Operators<F> {
    /// Of `substrate`, for steps of `dt` ms.
    pub(super) fn assemble(substrate: &Substrate<'_>, dt: f64) -> Self {
        let by_vertex = rows(substrate);
        let mut vertex = patches(substrate.mesh);
        for block in vertex.chunks_mut(BLOCK) {
            block.sort_by_key(|v| by_vertex[*v as usize].len());
        }
        let mut row_of = vec![0; vertex.len()];
        for (row, v) in (0..).zip(&vertex) {
            row_of[*v as usize] = row;
        }
        let (mut blocks, mut inverse_diagonal) = (vec![], vec![]);
        for vertices in vertex.chunks(BLOCK) {
            let mut rows = Rows::new();
            let mut inverse = [F::one(); BLOCK];
            for (v, inverse) in vertices.iter().zip(&mut inverse) {
                let diagonal = rows.push(&by_vertex[*v as usize], &row_of, row_of[*v as usize], dt);
                *inverse = F::of(1.0 / diagonal);
            }
            blocks.push(rows);
            inverse_diagonal.push(inverse);
        }
        Self { vertex, blocks, inverse_diagonal }
    }

    /// The rows of `A x` in a block; `x` by row.
    #[inline(always)]
    pub(super) fn implicit(&self, block: usize, x: &[F], out: &mut [F; BLOCK]) {
        let rows = &self.blocks[block];
        rows.multiply(&rows.implicit, x, out);
    }

    /// The rows of `dt K x` in a block; `x` by row.
    #[inline(always)]
    pub(super) fn stiffness(&self, block: usize, x: &[F], out: &mut [F; BLOCK]) {
        let rows = &self.blocks[block];
        rows.multiply(&rows.stiffness, x, out);
    }

    /// The blocks that each block's rows refer to.
    pub(super) fn neighbours(&self) -> Vec<Vec<usize>> {
        let of_block = |rows: &Rows<F>| {
            let mut blocks: Vec<usize> = rows.column.iter().map(|j| *j as usize / BLOCK).collect();
            blocks.sort_unstable();
            blocks.dedup();
            blocks
        };
        self.blocks.iter().map(of_block).collect()
    }
}

impl<F: Precision> Rows<F> {
    fn new() -> Self {
        Self { runs: vec![], column: vec![], implicit: vec![], stiffness: vec![] }
    }

    /// Adds row `i`; its diagonal entry of A.
    fn push(&mut self, row: &Row, row_of: &[u32], i: u32, dt: f64) -> f64 {
        let begin = self.column.len();
        let mut diagonal = f64::NAN;
        for (v, [mass, stiffness]) in row {
            let (j, a) = (row_of[*v as usize], mass + 0.5 * dt * stiffness);
            self.column.push(j);
            self.implicit.push(F::of(a));
            self.stiffness.push(F::of(dt * stiffness));
            if j == i {
                diagonal = a;
            }
        }
        let (entries, row) = (begin..self.column.len(), i as usize % BLOCK);
        match self.runs.last_mut() {
            Some(run) if run.length == entries.len() => {
                (run.rows.end, run.entries.end) = (row + 1, entries.end);
            }
            _ => self.runs.push(Run { length: entries.len(), rows: row..row + 1, entries }),
        }
        diagonal
    }

    #[inline(always)]
    fn multiply(&self, entry: &[F], x: &[F], out: &mut [F; BLOCK]) {
        for Run { length, rows, entries } in &self.runs {
            let (column, entry) = (&self.column[entries.clone()], &entry[entries.clone()]);
            let out = &mut out[rows.clone()];
            match length {
                4 => products::<F, 4>(column, entry, x, out),
                5 => products::<F, 5>(column, entry, x, out),
                6 => products::<F, 6>(column, entry, x, out),
                7 => products::<F, 7>(column, entry, x, out),
                8 => products::<F, 8>(column, entry, x, out),
                9 => products::<F, 9>(column, entry, x, out),
                _ => {
                    let rows = column.chunks_exact(*length).zip(entry.chunks_exact(*length));
                    for ((column, entry), out) in rows.zip(out) {
                        *out = product(column, entry, x);
                    }
                }
            }
        }
    }
}

/// `x` times rows of N entries each.
#[inline(always)]
fn products<F: Precision, const N: usize>(column: &[u32], entry: &[F], x: &[F], out: &mut [F]) {
    let (columns, entries) = (column.as_chunks::<N>().0, entry.as_chunks::<N>().0);
    for ((column, entry), out) in columns.iter().zip(entries).zip(out) {
        *out = product(column, entry, x);
    }
}

#[inline(always)]
fn product<F: Precision>(column: &[u32], entry: &[F], x: &[F]) -> F {
    column.iter().zip(entry).fold(F::zero(), |sum, (j, a)| sum + *a * x[*j as usize])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ep::Parameters;
    use crate::mesh::left_atrium;

    #[test]
    fn mass_sums_to_the_area_and_constants_do_not_diffuse() {
        let mesh = left_atrium(3.0).mesh;
        let tissue = vec![
            Parameters::from_array([0.7, 0.05, 10.0, 120.0, 200.0]).tissue();
            mesh.n_vertices()
        ];
        let substrate = Substrate { mesh: &mesh, tissue: &tissue, fibres: None };
        let operators = Operators::<f64>::assemble(&substrate, 0.1);
        let n_blocks = mesh.n_vertices().div_ceil(BLOCK);
        let (ones, mut out) = (vec![1.0; n_blocks * BLOCK], [0.0; BLOCK]);
        let mut total = 0.0;
        for block in 0..n_blocks {
            operators.implicit(block, &ones, &mut out);
            total += out.iter().sum::<f64>();
            operators.stiffness(block, &ones, &mut out);
            assert!(out.iter().all(|x| x.abs() < 1e-12));
        }
        assert!((total / mesh.area() - 1.0).abs() < 1e-12);
    }
}
