//! What several tests share: a basis of made-up numbers, tables, random numbers.
#![allow(dead_code, clippy::unwrap_used, reason = "each test uses a part of it")]

pub(crate) mod oracle;

use eplat::dsl::Measurements;
use eplat::manifold::Basis;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A seeded stream.
pub(crate) fn rng(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

/// `n_modes` made-up modes at `n_vertices` vertices, the first constant as on a closed surface.
pub(crate) fn basis(n_vertices: usize, n_modes: usize) -> Basis {
    let mut rng = rng(12345);
    Basis {
        eigenvalues: (0..n_modes).map(|k| 4e-4 * k as f64).collect(),
        eigenfunctions: (0..n_vertices * n_modes)
            .map(|i| if i % n_modes == 0 { 0.007 } else { rng.random_range(-0.012..0.012) })
            .collect(),
    }
}

/// A table from a header and rows of text.
pub(crate) fn table(header: &str, rows: &[String]) -> Measurements {
    let cells = |line: &str| line.split(',').map(String::from).collect::<Vec<_>>();
    Measurements::from_cells("test", cells(header), rows.iter().map(|r| cells(r)).collect())
        .unwrap()
}
