//! How much memory a run takes, foreseen from its sizes before it samples.
//!
//! The figures were measured (`tests/memory.rs` measures again): a run without a table, on meshes of three sizes, with
//! 200 to 40,000 draws, and with 1000 to 16,000 rows. What was foreseen is within a factor of 1.5 of the peak.

use super::{Problem, RunError};
use crate::infer::{LogDensity as _, Settings};
use crate::manifold::Basis;
use crate::report::numbers_at_rows;
use crate::store::memory;

/// The program itself, bytes.
const PROGRAM: f64 = 30e6;
/// Of each vertex besides its eigenfunctions: the mesh, maps and their files.
const VERTEX: f64 = 1700.0;
/// Of each row besides what is kept of it at draws.
const ROW: f64 = 15e3;
/// Copies of what is kept of each row at draws: log likelihoods and replicates, each by itself and together.
const COPIES_AT_ROWS: f64 = 4.5;
/// Copies of a draw: as the sampler made it, and in the units of the parameters.
const COPIES_OF_DRAWS: f64 = 2.0;
/// Numbers of each draw beside its position and values: energy, step size, …
const BESIDE: usize = 8;

/// What a run's memory depends on.
#[derive(Clone, Copy, Debug)]
pub(super) struct Needs {
    n_vertices: usize,
    n_modes: usize,
    n_rows: usize,
    chains: usize,
    draws: usize,
    /// Numbers of a draw.
    each: usize,
}

impl Needs {
    pub(super) fn of(problem: &Problem<'_>, settings: &Settings) -> Self {
        let (loaded, model) = (problem.loaded(), problem.model());
        let Settings { chains, draws, .. } = *settings;
        Self {
            n_vertices: loaded.surface().map_or(0, |surface| surface.mesh.n_vertices()),
            n_modes: loaded.basis().map_or(0, Basis::n_modes),
            n_rows: model.row_ids().len(),
            chains,
            draws,
            each: model.dim() + model.n_reported() + BESIDE,
        }
    }

    /// Bytes, about.
    pub(super) fn bytes(&self) -> u128 {
        let n_draws = self.chains as f64 * self.draws as f64;
        let at_rows = numbers_at_rows(self.n_rows, self.chains, self.draws) as f64;
        let numbers = self.n_vertices as f64 * self.n_modes as f64
            + COPIES_OF_DRAWS * n_draws * self.each as f64
            + COPIES_AT_ROWS * at_rows;
        (PROGRAM + VERTEX * self.n_vertices as f64 + ROW * self.n_rows as f64 + 8.0 * numbers)
            as u128
    }

    /// Refuses a run for which there is no memory, before anything of it is done.
    ///
    /// # Errors
    /// [`RunError::Memory`].
    pub(super) fn require_memory(&self) -> Result<(), RunError> {
        let (bytes, Some(free)) = (self.bytes(), memory::available()) else { return Ok(()) };
        if bytes <= u128::from(free) {
            return Ok(());
        }
        let Self { n_vertices, n_modes, n_rows, chains, draws, each } = self;
        let what = format!(
            "{n_vertices} vertices with {n_modes} modes, {draws} draws of each of {chains} chains with {each} numbers each, and {n_rows} rows"
        );
        let help = "ask for fewer draws with --draws and --chains (1000 of each of 4 are the default), or take a coarser mesh \
                    (`eplat mesh decimate`) or fewer rows";
        Err(RunError::Memory { what, bytes, free, help })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Peaks of `eplat run erp --chains 2`, MB: vertices, modes, rows, draws of a chain.
    #[test]
    fn what_is_foreseen_is_what_was_measured() {
        let measured = [
            (14_174, 24, 39, 100, 57.0),
            (44_605, 24, 39, 100, 130.0),
            (5_166, 24, 1000, 1000, 130.0),
            (5_166, 24, 4000, 500, 286.0),
            (5_166, 24, 4000, 4000, 435.0),
            (5_166, 24, 16_000, 100, 381.0),
            (5_166, 500, 20, 20_000, 128.0),
        ];
        for (n_vertices, n_modes, n_rows, draws, peak) in measured {
            let needs = Needs { n_vertices, n_modes, n_rows, chains: 2, draws, each: 112 };
            let ratio = needs.bytes() as f64 / 1e6 / peak;
            assert!((1.0 / 1.5..1.5).contains(&ratio), "{needs:?}: {ratio}");
        }
    }

    #[test]
    fn numbers_that_overflow_are_more_than_there_is() {
        let huge = usize::MAX / 2;
        let needs = Needs {
            n_vertices: 5166,
            n_modes: 24,
            n_rows: 20,
            chains: huge,
            draws: huge,
            each: 112,
        };
        assert!(needs.bytes() > 1 << 100);
        let refusal = needs.require_memory().map_err(|error| error.to_string());
        assert!(refusal.is_err() || memory::available().is_none());
    }
}
