//! How much memory a run takes, foreseen from its sizes before it samples, and whether it goes on with less.
//!
//! ```text
//! whole   program + vertices + rows + draws · (sampled + reported + columns · threads)
//! less    program + vertices + rows + draws · (sampled + columns)      what is reported is on disk
//! ```
//! The figures were measured (`tests/memory.rs` measures again): a run without a table, on meshes of four sizes, with
//! 200 to 40,000 draws, and with 1000 to 16,000 rows. What was foreseen is within a factor of 1.5 of the peak.
//! Draws of the unknowns are in memory: the samplers have no other place for them.

use super::{Event, Problem, RunError, Watch};
use crate::infer::{LogDensity as _, Settings};
use crate::manifold::Basis;
use crate::report::numbers_at_rows;
use crate::store::{Spool, memory};

/// The program itself, bytes.
const PROGRAM: f64 = 30e6;
/// Of each vertex besides its eigenfunctions: the factor that distances are computed with, the mesh, maps.
const VERTEX: f64 = 1500.0;
/// Of each row besides what is kept of it at draws: most of it is the sampler's.
const ROW: f64 = 12e3;
/// Copies of what is kept of each row at draws: log likelihoods and replicates.
const COPIES_AT_ROWS: f64 = 2.0;
/// Numbers of each draw beside its position and values: energy, step size, …
const BESIDE: usize = 10;
/// Copies of one parameter's draws while they are summarised, by each thread.
const COLUMNS: f64 = 6.0;

/// What a run's memory depends on.
#[derive(Clone, Copy, Debug)]
pub(super) struct Needs {
    n_vertices: usize,
    n_modes: usize,
    n_rows: usize,
    chains: usize,
    draws: usize,
    /// Numbers of a draw as the sampler has it.
    sampled: usize,
    /// Numbers that are reported of a draw: parameters, and `let`s that are no maps.
    reported: usize,
    /// That summarise parameters, one each at a time.
    threads: usize,
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
            sampled: model.dim() + BESIDE,
            reported: model.n_reported() + model.lets.iter().map(|l| l.len).sum::<usize>(),
            threads: rayon::current_num_threads(),
        }
    }

    /// Bytes, about, with everything in memory.
    pub(super) fn bytes(&self) -> u128 {
        let columns = COLUMNS * self.threads.min(self.reported) as f64;
        self.with(self.reported as f64 + columns)
    }

    /// Bytes, about, with what is reported of draws on disk.
    pub(super) fn least(&self) -> u128 {
        let blocks = 8 * Spool::numbers_in_memory(self.reported) as u128 * self.chains as u128;
        self.with(COLUMNS).saturating_add(blocks)
    }

    /// Bytes, about, with so many numbers of each draw besides those of the sampler.
    fn with(&self, each: f64) -> u128 {
        let n_draws = self.chains as f64 * self.draws as f64;
        let at_rows = numbers_at_rows(self.n_rows, self.chains, self.draws) as f64;
        let numbers = self.n_vertices as f64 * self.n_modes as f64
            + n_draws * (self.sampled as f64 + each)
            + COPIES_AT_ROWS * at_rows;
        (PROGRAM + VERTEX * self.n_vertices as f64 + ROW * self.n_rows as f64 + 8.0 * numbers)
            as u128
    }

    /// Refuses a run for which there is no memory, before anything of it is done.
    ///
    /// # Errors
    /// [`RunError::Memory`].
    pub(super) fn require_memory(&self) -> Result<(), RunError> {
        self.require(self.bytes(), free())
    }

    /// Whether what is reported of draws is to be kept on disk, because there is no memory for it; this is told.
    ///
    /// # Errors
    /// [`RunError::Memory`] where there is not even memory for the rest.
    pub(super) fn are_on_disk(&self, watch: &Watch<'_>) -> Result<bool, RunError> {
        self.are_on_disk_of(free(), watch)
    }

    fn are_on_disk_of(&self, free: Option<u64>, watch: &Watch<'_>) -> Result<bool, RunError> {
        if self.require(self.bytes(), free).is_ok() {
            return Ok(false);
        }
        self.require(self.least(), free)?;
        let [bytes, least] = [self.bytes(), self.least()].map(|bytes| bytes as u64);
        watch.tell(&Event::OnDisk { bytes, least, free: free.unwrap_or_default() });
        Ok(true)
    }

    fn require(&self, bytes: u128, free: Option<u64>) -> Result<(), RunError> {
        let Some(free) = free.filter(|free| bytes > u128::from(*free)) else { return Ok(()) };
        let Self { n_vertices, n_modes, n_rows, chains, draws, sampled, reported, .. } = self;
        let each = sampled + reported;
        let what = format!(
            "{n_vertices} vertices with {n_modes} modes, {draws} draws of each of {chains} chains with {each} numbers each, and {n_rows} rows"
        );
        let help = "ask for fewer draws with --draws and --chains (1000 of each of 4 are the default), or take a coarser mesh \
                    (`eplat mesh decimate`) or fewer rows";
        Err(RunError::Memory { what, bytes, free, help })
    }
}

/// Bytes that the run may take in all: what is free, and what the process has taken for it already, such as the surface.
fn free() -> Option<u64> {
    Some(memory::available()?.saturating_add(memory::taken().unwrap_or(0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of two chains of the model `erp`, on two threads.
    fn needs(n_vertices: usize, n_modes: usize, n_rows: usize, draws: usize) -> Needs {
        let (sampled, reported) = (52 + BESIDE, 52);
        let threads = 2;
        Needs { n_vertices, n_modes, n_rows, chains: 2, draws, sampled, reported, threads }
    }

    /// Peaks of `eplat run erp --chains 2`, MB: vertices, modes, rows, draws of a chain.
    #[test]
    fn what_is_foreseen_is_what_was_measured() {
        let measured = [
            (14_174, 24, 39, 100, 55.0),
            (44_605, 24, 39, 100, 106.0),
            (69_012, 24, 20, 100, 139.0),
            (5_166, 24, 1000, 1000, 89.0),
            (5_166, 24, 2000, 2000, 204.0),
            (5_166, 24, 4000, 500, 162.0),
            (5_166, 24, 16_000, 100, 222.0),
            (5_166, 24, 20, 20_000, 97.0),
            (5_166, 500, 20, 20_000, 123.0),
        ];
        for (n_vertices, n_modes, n_rows, draws, peak) in measured {
            let needs = needs(n_vertices, n_modes, n_rows, draws);
            let ratio = needs.bytes() as f64 / 1e6 / peak;
            assert!((1.0 / 1.5..1.5).contains(&ratio), "{needs:?}: {ratio}");
        }
    }

    #[test]
    fn numbers_that_overflow_are_more_than_there_is() {
        let huge = usize::MAX / 2;
        let needs = Needs { chains: huge, ..needs(5166, 24, 20, huge) };
        assert!(needs.bytes() > 1 << 100 && needs.least() > 1 << 100);
        let refusal = needs.require_memory().map_err(|error| error.to_string());
        assert!(refusal.is_err() || memory::available().is_none());
    }

    #[test]
    fn with_less_memory_the_run_goes_on_and_with_too_little_it_does_not() {
        let needs = needs(5166, 24, 20, 100_000);
        let [whole, least] = [needs.bytes() as u64, needs.least() as u64];
        assert!(least < whole - 50_000_000, "{whole} {least}");
        let told = std::sync::Mutex::new(vec![]);
        let on_event = |event: &Event<'_>| told.lock().unwrap().push(event.to_string());
        let watch = Watch { on_event: &on_event, ..Watch::default() };
        assert!(!needs.are_on_disk_of(None, &watch).unwrap());
        assert!(!needs.are_on_disk_of(Some(whole), &watch).unwrap());
        assert!(told.lock().unwrap().is_empty());
        assert!(needs.are_on_disk_of(Some(whole - 1), &watch).unwrap());
        assert!(needs.are_on_disk_of(Some(least), &watch).unwrap());
        let said = told.lock().unwrap().clone();
        assert!(
            said.len() == 2 && said[0].contains("go to the disk") && !said[0].contains('\n'),
            "{said:?}"
        );
        let refused = needs.are_on_disk_of(Some(least - 1), &watch).unwrap_err().to_string();
        assert!(refused.contains("100000 draws of each of 2 chains"), "{refused}");
    }
}
