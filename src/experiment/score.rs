//! How good an estimate is: draws thinned, chains that agree, errors and coverage over a surface.

use crate::diagnostics::r_hat;
use crate::infer::{Chain, LogDensity as _};
use crate::model::Model;

/// Central intervals whose coverage is counted.
pub const INTERVALS: [f64; 3] = [0.5, 0.9, 0.95];

/// At most `most` draws (but one at least of each chain), evenly spaced in each chain.
pub fn thinned(chains: &[Chain], most: usize) -> Vec<&[f64]> {
    let most = (most / chains.len().max(1)).max(1);
    let of_chain = |chain: &'_ Chain| chain.n_draws().div_ceil(most).max(1);
    let draws =
        chains.iter().flat_map(|c| (0..c.n_draws()).step_by(of_chain(c)).map(|i| c.draw(i)));
    draws.collect()
}

/// Whether every unknown has an R̂ that short chains can have.
pub fn agree(model: &Model, chains: &[Chain]) -> bool {
    const MAX_R_HAT: f64 = 1.05;
    (0..model.dim()).all(|i| {
        let of = |chain: &Chain| (0..chain.n_draws()).map(|k| chain.draw(k)[i]).collect();
        let columns: Vec<Vec<f64>> = chains.iter().map(of).collect();
        let slices: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
        let r_hat = r_hat(&slices);
        r_hat.is_nan() || r_hat <= MAX_R_HAT
    })
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
