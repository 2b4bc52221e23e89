//! How good an estimate is: draws thinned, chains that agree, errors and coverage over a surface.

use std::io;

use crate::diagnostics::r_hat;
use crate::infer::{Chain, LogDensity as _};
use crate::model::Model;

/// Central intervals whose coverage is counted.
pub const INTERVALS: [f64; 3] = [0.5, 0.9, 0.95];

/// At most `most` draws (but one at least of each chain), evenly spaced in each chain.
///
/// # Errors
/// From the disk that the draws are on, if they are on one.
pub fn thinned(chains: &[Chain], most: usize) -> io::Result<Vec<Vec<f64>>> {
    let most = (most / chains.len().max(1)).max(1);
    let mut thinned = vec![];
    for chain in chains {
        chain.draws.each(chain.n_draws().div_ceil(most).max(1), |_, draw| {
            thinned.push(draw.to_vec());
            io::Result::Ok(())
        })?;
    }
    Ok(thinned)
}

/// Whether every unknown has an R̂ that short chains can have.
///
/// # Errors
/// From the disk that the draws are on, if they are on one.
pub fn agree(model: &Model, chains: &[Chain]) -> io::Result<bool> {
    const MAX_R_HAT: f64 = 1.05;
    for i in 0..model.dim() {
        let mut columns = vec![vec![]; chains.len()];
        for (chain, column) in chains.iter().zip(&mut columns) {
            chain.draws.column(i, column)?;
        }
        let slices: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
        if r_hat(&slices) > MAX_R_HAT {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Share of ranks within the central interval of each of [`INTERVALS`]; unknown ranks (NaN) do not count.
pub fn coverage(ranks: &[f64]) -> [f64; 3] {
    let known = || ranks.iter().filter(|rank| !rank.is_nan());
    INTERVALS.map(|level| {
        let inside = known().filter(|rank| (*rank - 0.5).abs() <= 0.5 * level).count();
        inside as f64 / known().count() as f64
    })
}

/// Root mean squared difference over the vertices where both are known.
pub fn rms_error(estimate: &[f64], truth: &[f64]) -> f64 {
    let squares = estimate.iter().zip(truth).map(|(e, t)| (e - t) * (e - t));
    let known: Vec<f64> = squares.filter(|square| square.is_finite()).collect();
    (known.iter().sum::<f64>() / known.len() as f64).sqrt()
}
