//! The matrices of a time step, laid out for products with vectors: rows in patches of neighbours.

use super::Substrate;
use super::assembly::{Row, patches, rows};
use super::lanes::BLOCK;
use crate::ep::precision::Precision;
use std::ops::Range;

/// `S A S` and `S dt K` by rows: `A = M + ½ dt K`, M the consistent mass (mm²), K the stiffness with the diffusivity
/// in it (mm²/ms), and the scale S such that `S A S` has a unit diagonal. Rows beyond the mesh's vertices fill the
/// last block; nothing refers to them.
#[derive(Debug)]
pub(super) struct Operators<F> {
    /// The mesh's vertex behind each row.
    pub(super) vertex: Vec<u32>,
    blocks: Vec<Rows<F>>,
    /// S, 1/mm: V is S times what `S A S` is applied to.
    pub(super) scale: Vec<[F; BLOCK]>,
}

/// The rows of a block, without their diagonal: it is 1 in `S A S`, and rows of K sum to none.
#[derive(Debug)]
struct Rows<F> {
    /// Rows of equally many entries follow each other, so that the processor foresees where they end.
    runs: Vec<Run>,
    column: Vec<u32>,
    /// Entries of `S A S` and of `S dt K`.
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
        let implicit = |[mass, stiffness]: [f64; 2]| mass + 0.5 * dt * stiffness;
        let diagonal = |(v, row): (u32, &Row)| {
            row.iter().find(|(j, _)| *j == v).map(|(_, entry)| implicit(*entry))
        };
        let scale: Vec<f64> =
            (0..).zip(&by_vertex).filter_map(diagonal).map(|a| a.sqrt().recip()).collect();
        let block = |vertices: &[u32]| {
            let mut rows =
                Rows { runs: vec![], column: vec![], implicit: vec![], stiffness: vec![] };
            for v in vertices {
                let of_v = scale[*v as usize];
                let others = by_vertex[*v as usize].iter().filter(|(j, _)| j != v);
                rows.push(others.map(|(j, entry)| {
                    let j = *j as usize;
                    (row_of[j], of_v * implicit(*entry) * scale[j], of_v * dt * entry[1])
                }));
            }
            rows
        };
        let blocks = vertex.chunks(BLOCK).map(block).collect();
        let mut by_row = vec![[F::one(); BLOCK]; vertex.len().div_ceil(BLOCK)];
        for (s, v) in by_row.as_flattened_mut().iter_mut().zip(&vertex) {
            *s = F::of(scale[*v as usize]);
        }
        Self { vertex, blocks, scale: by_row }
    }

    /// The rows of `S A S x` in a block; `x` by row.
    #[inline(always)]
    pub(super) fn implicit(&self, block: usize, x: &[F], out: &mut [F; BLOCK]) {
        let rows = &self.blocks[block];
        out.copy_from_slice(&x[block * BLOCK..][..BLOCK]);
        rows.each(out, |column, implicit, _, out| {
            *out = *out + product(column, implicit, |j| x[j]);
        });
    }

    /// The rows of `−S dt K v − S A S x` in a block; `v` and `x` by row.
    #[inline(always)]
    pub(super) fn residual(&self, block: usize, v: &[F], x: &[F], out: &mut [F; BLOCK]) {
        let own = block * BLOCK..(block + 1) * BLOCK;
        out.copy_from_slice(&v[own.clone()]);
        self.blocks[block].each(out, |column, implicit, stiffness, out| {
            let here = *out;
            *out =
                product(column, stiffness, |j| here - v[j]) - product(column, implicit, |j| x[j]);
        });
        for (out, x) in out.iter_mut().zip(&x[own]) {
            *out = *out - *x;
        }
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
    /// Adds a row: columns and entries.
    fn push(&mut self, row: impl Iterator<Item = (u32, f64, f64)>) {
        let begin = self.column.len();
        for (j, implicit, stiffness) in row {
            self.column.push(j);
            self.implicit.push(F::of(implicit));
            self.stiffness.push(F::of(stiffness));
        }
        let entries = begin..self.column.len();
        let at = self.runs.last().map_or(0, |run| run.rows.end);
        match self.runs.last_mut() {
            Some(run) if run.length == entries.len() => {
                (run.rows.end, run.entries.end) = (at + 1, entries.end);
            }
            _ => self.runs.push(Run { length: entries.len(), rows: at..at + 1, entries }),
        }
    }

    /// Calls `row` with the columns and entries of each row, and its place in `out`.
    #[inline(always)]
    fn each(&self, out: &mut [F; BLOCK], row: impl Fn(&[u32], &[F], &[F], &mut F)) {
        for Run { length, rows, entries } in &self.runs {
            let entries = entries.clone();
            let of_run = (
                &self.column[entries.clone()],
                &self.implicit[entries.clone()],
                &self.stiffness[entries],
            );
            let out = &mut out[rows.clone()];
            match length {
                3 => each_of::<F, 3>(of_run, out, &row),
                4 => each_of::<F, 4>(of_run, out, &row),
                5 => each_of::<F, 5>(of_run, out, &row),
                6 => each_of::<F, 6>(of_run, out, &row),
                7 => each_of::<F, 7>(of_run, out, &row),
                8 => each_of::<F, 8>(of_run, out, &row),
                _ => {
                    let (column, a, k) = of_run;
                    let entries = a.chunks_exact(*length).zip(k.chunks_exact(*length));
                    for ((column, (a, k)), out) in
                        column.chunks_exact(*length).zip(entries).zip(out)
                    {
                        row(column, a, k, out);
                    }
                }
            }
        }
    }
}

/// As [`Rows::each`], of rows of N entries each.
#[inline(always)]
fn each_of<F, const N: usize>(
    (column, implicit, stiffness): (&[u32], &[F], &[F]),
    out: &mut [F],
    row: impl Fn(&[u32], &[F], &[F], &mut F),
) {
    let entries = implicit.as_chunks::<N>().0.iter().zip(stiffness.as_chunks::<N>().0);
    for ((column, (a, k)), out) in column.as_chunks::<N>().0.iter().zip(entries).zip(out) {
        row(column, a, k, out);
    }
}

#[inline(always)]
fn product<F: Precision>(column: &[u32], entry: &[F], x: impl Fn(usize) -> F) -> F {
    column.iter().zip(entry).fold(F::zero(), |sum, (j, a)| sum + *a * x(*j as usize))
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
        let (ones, zeros) = (vec![1.0; n_blocks * BLOCK], vec![0.0; n_blocks * BLOCK]);
        let scale = operators.scale.as_flattened();
        let unscaled: Vec<f64> = scale.iter().map(|s| s.recip()).collect();
        let (mut out, mut total) = ([0.0; BLOCK], 0.0);
        for block in 0..n_blocks {
            let n_rows = BLOCK.min(mesh.n_vertices() - block * BLOCK);
            operators.implicit(block, &unscaled, &mut out);
            let rows = &unscaled[block * BLOCK..];
            total += out[..n_rows].iter().zip(rows).map(|(a, s)| a * s).sum::<f64>();
            operators.residual(block, &ones, &zeros, &mut out);
            assert!(out[..n_rows].iter().all(|x| x.abs() < 1e-12));
        }
        assert!((total / mesh.area() - 1.0).abs() < 1e-12);
    }
}
