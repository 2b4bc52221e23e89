//! How much memory a run takes, foreseen from its sizes before it samples, and whether it goes on with less.
//!
//! ```text
//! whole   program + vertices + rows + draws · (beside + unknowns + reported + columns · threads + at rows)
//! less    program + vertices + rows + draws · (beside + columns) + blocks of what is on disk
//! ```
//! A run that is kept has the unknowns on disk in any case. The figures were measured (`tests/memory.rs` measures again)
//! on meshes of four sizes, with 200 to 400,000 draws, and with 20 to 16,000 rows. What was foreseen is within a factor
//! of 1.5 of the peak.

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
/// Numbers of each draw beside its unknowns and values: energy, step size, …
const BESIDE: f64 = 12.0;
/// Copies of one parameter's draws while they are summarised, by each thread.
const COLUMNS: f64 = 8.0;

/// How often draws of the unknowns are in memory, where there is room for them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum InMemory {
    /// The run is kept, with its draws.
    Never,
    Once,
    /// As they were drawn, and chosen by weight.
    Twice,
}

/// What a run's memory depends on.
#[derive(Clone, Copy, Debug)]
pub(super) struct Needs {
    n_vertices: usize,
    n_modes: usize,
    n_rows: usize,
    chains: usize,
    draws: usize,
    /// Numbers of a draw as the sampler has it.
    unknowns: usize,
    pub(super) draws_in_memory: InMemory,
    /// Numbers that are reported of a draw: parameters, and `let`s that are no maps.
    reported: usize,
    /// That summarise parameters, one each at a time.
    threads: usize,
}

impl Needs {
    pub(super) fn of(
        problem: &Problem<'_>,
        settings: &Settings,
        draws_in_memory: InMemory,
    ) -> Self {
        let (loaded, model) = (problem.loaded(), problem.model());
        let Settings { chains, draws, .. } = *settings;
        Self {
            n_vertices: loaded.surface().map_or(0, |surface| surface.mesh.n_vertices()),
            n_modes: loaded.basis().map_or(0, Basis::n_modes),
            n_rows: model.row_ids().len(),
            chains,
            draws,
            unknowns: model.dim(),
            draws_in_memory,
            reported: model.n_reported() + model.lets.iter().map(|l| l.len).sum::<usize>(),
            threads: rayon::current_num_threads(),
        }
    }

    /// Bytes, about, with everything in memory.
    fn bytes(&self) -> u128 {
        let columns = COLUMNS * self.threads.min(self.reported) as f64;
        let (unknowns, blocks) = match self.draws_in_memory {
            InMemory::Never => (0, self.block(self.unknowns)),
            InMemory::Once => (self.unknowns, 0.0),
            InMemory::Twice => (2 * self.unknowns, 0.0),
        };
        let at_rows = numbers_at_rows(self.n_rows, self.chains, self.draws) as f64;
        let each = (unknowns + self.reported) as f64 + columns;
        self.with(each, COPIES_AT_ROWS * at_rows + blocks)
    }

    /// Bytes, about, with draws, and what is told of them, on disk.
    fn least(&self) -> u128 {
        let on_disk = [self.unknowns, self.reported, self.n_rows, self.n_rows];
        self.with(COLUMNS, on_disk.map(|width| self.block(width)).iter().sum())
    }

    /// Bytes, about, of a fit with these settings.
    pub(super) fn taken(&self, settings: &Settings) -> u128 {
        if settings.disk.is_some() { self.least() } else { self.bytes() }
    }

    /// Numbers in memory of rows that are on disk.
    fn block(&self, width: usize) -> f64 {
        let all = width as f64 * self.draws as f64;
        self.chains as f64 * all.min(Spool::numbers_in_memory(width) as f64)
    }

    /// Bytes, about, with so many numbers of each draw, and others.
    fn with(&self, each: f64, others: f64) -> u128 {
        let n_draws = self.chains as f64 * self.draws as f64;
        let numbers =
            self.n_vertices as f64 * self.n_modes as f64 + n_draws * (BESIDE + each) + others;
        (PROGRAM + VERTEX * self.n_vertices as f64 + ROW * self.n_rows as f64 + 8.0 * numbers)
            as u128
    }

    /// The settings, with a disk where there is no memory for everything, which is told.
    ///
    /// # Errors
    /// [`RunError::Memory`] where there is not even memory for the rest, or the settings have no disk.
    pub(super) fn placed(
        &self,
        settings: &Settings,
        watch: &Watch<'_>,
    ) -> Result<Settings, RunError> {
        self.placed_in(free(), settings, watch)
    }

    fn placed_in(
        &self,
        free: Option<u64>,
        settings: &Settings,
        watch: &Watch<'_>,
    ) -> Result<Settings, RunError> {
        let settings = settings.clone();
        match self.require(self.bytes(), free) {
            Ok(()) => return Ok(Settings { disk: None, ..settings }),
            Err(error) if settings.disk.is_none() => return Err(error),
            Err(_) => self.require(self.least(), free)?,
        }
        let [bytes, least] = [self.bytes(), self.least()].map(|bytes| bytes as u64);
        watch.tell(&Event::OnDisk { bytes, least, free: free.unwrap_or_default() });
        Ok(settings)
    }

    fn require(&self, bytes: u128, free: Option<u64>) -> Result<(), RunError> {
        let Some(free) = free.filter(|free| bytes > u128::from(*free)) else { return Ok(()) };
        let Self { n_vertices, n_modes, n_rows, chains, draws, unknowns, reported, .. } = self;
        let each = unknowns + reported;
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

    /// Of two chains of the model `erp`, on two threads, in a run that is kept.
    fn needs(n_vertices: usize, n_modes: usize, n_rows: usize, draws: usize) -> Needs {
        let [unknowns, reported] = [52, 52];
        let (chains, threads, draws_in_memory) = (2, 2, InMemory::Never);
        Needs {
            n_vertices,
            n_modes,
            n_rows,
            chains,
            draws,
            unknowns,
            draws_in_memory,
            reported,
            threads,
        }
    }

    /// Peaks of `eplat run erp --chains 2`, MB: vertices, modes, rows, draws of a chain.
    #[test]
    fn what_is_foreseen_is_what_was_measured() {
        let measured = [
            (11_354, 24, 39, 100, 51.0),
            (31_566, 24, 39, 100, 78.0),
            (53_603, 24, 39, 100, 121.0),
            (5_166, 24, 1000, 1000, 89.0),
            (5_166, 24, 2000, 2000, 203.0),
            (5_166, 24, 4000, 500, 161.0),
            (5_166, 24, 16_000, 100, 222.0),
            (5_166, 24, 20, 20_000, 81.0),
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
        let settings = Settings { disk: Some("there".into()), ..Settings::default() };
        let refusal = needs.placed(&settings, &Watch::default());
        assert!(refusal.is_err() || memory::available().is_none());
    }

    #[test]
    fn with_less_memory_the_run_goes_on_and_with_too_little_it_does_not() {
        for draws_in_memory in [InMemory::Never, InMemory::Once, InMemory::Twice] {
            let needs = Needs { draws_in_memory, ..needs(5166, 24, 20, 100_000) };
            let [whole, least] = [needs.bytes() as u64, needs.least() as u64];
            assert!(least < whole - 50_000_000, "{whole} {least}");
            let told = std::sync::Mutex::new(vec![]);
            let on_event = |event: &Event<'_>| told.lock().unwrap().push(event.to_string());
            let watch = Watch { on_event: &on_event, ..Watch::default() };
            let settings = Settings { disk: Some("there".into()), ..Settings::default() };
            let placed = |free, settings: &Settings| {
                needs.placed_in(free, settings, &watch).map(|settings| settings.disk)
            };
            for free in [None, Some(whole)] {
                assert_eq!(placed(free, &settings).unwrap(), None);
            }
            assert!(told.lock().unwrap().is_empty());
            for free in [whole - 1, least] {
                assert_eq!(placed(Some(free), &settings).unwrap(), settings.disk);
            }
            let said = told.lock().unwrap().clone();
            assert!(
                said.len() == 2 && said[0].contains("go to the disk") && !said[0].contains('\n'),
                "{said:?}"
            );
            let refused = placed(Some(least - 1), &settings).unwrap_err().to_string();
            assert!(refused.contains("100000 draws of each of 2 chains"), "{refused}");
            // there is no disk
            let without = Settings { disk: None, ..settings.clone() };
            assert!(placed(Some(whole - 1), &without).is_err());
            assert_eq!(placed(Some(whole), &without).unwrap(), None);
        }
    }
}
