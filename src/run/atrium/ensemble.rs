//! Draws of the posterior, each simulated: means and standard deviations of the maps.

use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::drive::{Drive, Event, Kept, Slot};
use super::posterior::Posterior;
use super::tissue::InRange;
use super::{Atrium, AtriumError, Map, Summary};
use crate::diagnostics::Moments;
use crate::ep::Precision;
use crate::ep::surface::{BeatMap, Simulation};
use crate::store::Keeper;

/// The first slot of a checkpoint holds the sums over the draws that are done; draws under way follow.
const SUMS: usize = 0;

/// What the draws that are done gave.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Sums {
    n_draws: u32,
    /// In the order of [`BeatMap::NAMES`].
    maps: Vec<Moments>,
    /// Draws in which a vertex was activated and recovered, and in which its parameters were in range.
    captured: Vec<f64>,
    in_range: Vec<f64>,
}

impl Posterior {
    /// Simulates the draws, as many at a time as there are threads; `None` if interrupted.
    pub(super) fn simulate<F: Precision>(
        &self,
        atrium: &Atrium,
        drive: &Drive<'_>,
    ) -> Result<Option<(Vec<Map>, Summary)>, AtriumError> {
        let n_threads = rayon::current_num_threads().min(self.n);
        let n_vertices = atrium.mesh().n_vertices();
        let mut sums = match (drive.kept::<Sums>(SUMS)?, drive.checkpoint) {
            (Some(sums), Some(checkpoint)) if !sums.fits(n_vertices, self.n) => {
                return Err(checkpoint.misfit(Some(SUMS)).into());
            }
            (sums, _) => sums.unwrap_or_else(|| Sums::new(n_vertices)),
        };
        let mut kept = (0..n_threads)
            .map(|slot| drive.kept(SUMS + 1 + slot))
            .collect::<Result<Vec<Option<Kept<F>>>, _>>()?;
        let mut keeper = Keeper::new(drive.checkpoint, SUMS);
        while (sums.n_draws as usize) < self.n {
            let wave = n_threads.min(self.n - sums.n_draws as usize);
            if !self.wave(atrium, drive, &mut sums, &mut kept[..wave])? {
                return Ok(None);
            }
            keeper.keep(&sums);
        }
        Ok(Some(sums.maps()))
    }

    /// Simulates the next draws, one in each slot of `kept`; whether all came to their end.
    fn wave<F: Precision>(
        &self,
        atrium: &Atrium,
        drive: &Drive<'_>,
        sums: &mut Sums,
        kept: &mut [Option<Kept<F>>],
    ) -> Result<bool, AtriumError> {
        let first = sums.n_draws as usize;
        let times = Mutex::new(vec![0.0; kept.len()]);
        let told = |slot: usize, time: f64| {
            let mut times = times.lock().unwrap_or_else(PoisonError::into_inner);
            times[slot] = time;
            let done = atrium.pacing.end * first as f64 + times.iter().sum::<f64>();
            (drive.watch.on_event)(Event::Time(done));
        };
        let one = |(i, kept): (usize, &mut Option<Kept<F>>)| {
            let InRange { parameters, was: in_range } = self.parameters(&atrium.tissue, first + i);
            let mut simulation = atrium.begin::<F>(&parameters)?;
            let mut each = |s: &Simulation<F>| {
                told(i, s.time());
                Ok(())
            };
            let slot = Slot { slot: SUMS + 1 + i, draw: (first + i) as u32 };
            let is_done = drive.run(slot, &mut simulation, kept.take(), &mut each)?;
            Ok(is_done.then(|| (simulation.beat(), in_range)))
        };
        let beats: Vec<Result<_, AtriumError>> = kept.par_iter_mut().enumerate().map(one).collect();
        for beat in beats {
            let Some((beat, in_range)) = beat? else { return Ok(false) };
            sums.add(beat, &in_range);
        }
        Ok(true)
    }
}

impl Sums {
    fn new(n_vertices: usize) -> Self {
        let maps = BeatMap::NAMES.iter().map(|_| Moments::new(n_vertices)).collect();
        let zeros = || vec![0.0; n_vertices];
        Self { n_draws: 0, maps, captured: zeros(), in_range: zeros() }
    }

    /// Whether these are sums over at most `n_draws` draws at so many vertices.
    fn fits(&self, n_vertices: usize, n_draws: usize) -> bool {
        self.n_draws as usize <= n_draws
            && self.maps.len() == BeatMap::NAMES.len()
            && self.maps.iter().all(|moments| moments.has(n_vertices))
            && [self.captured.len(), self.in_range.len()] == [n_vertices; 2]
    }

    fn add(&mut self, beat: BeatMap, in_range: &[bool]) {
        self.n_draws += 1;
        for (v, apd90) in beat.apd90.iter().enumerate() {
            self.captured[v] += f64::from(u8::from(apd90.is_finite()));
            self.in_range[v] += f64::from(u8::from(in_range[v]));
        }
        for (moments, (_, values)) in self.maps.iter_mut().zip(beat.named()) {
            let physical = |(x, is_in): (f64, &bool)| if *is_in { x } else { f64::NAN };
            moments.add(values.into_iter().zip(in_range).map(physical));
        }
    }

    fn maps(self) -> (Vec<Map>, Summary) {
        let n = f64::from(self.n_draws);
        let share = |counts: &[f64]| counts.iter().map(|x| x / n).collect::<Vec<f64>>();
        let (captured, in_range) = (share(&self.captured), share(&self.in_range));
        let mean = |shares: &[f64]| shares.iter().sum::<f64>() / shares.len() as f64;
        let summary = Summary::Many {
            draws: self.n_draws,
            captured_pairs: mean(&captured),
            pairs_in_range: mean(&in_range),
        };
        let mut maps = vec![];
        for (name, moments) in BeatMap::NAMES.iter().zip(&self.maps) {
            maps.push((format!("{name}_mean"), moments.means()));
            maps.push((format!("{name}_sd"), moments.sds()));
        }
        maps.push(("captured".into(), captured));
        maps.push(("in_range".into(), in_range));
        (maps, summary)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_of_another_simulation_do_not_fit() {
        let sums = Sums { n_draws: 3, ..Sums::new(4) };
        assert!(sums.fits(4, 3));
        assert!(!sums.fits(5, 3) && !sums.fits(3, 3) && !sums.fits(4, 2));
        let changed = |change: fn(&mut Sums)| {
            let mut sums = sums.clone();
            change(&mut sums);
            sums
        };
        let forgeries: [fn(&mut Sums); 4] = [
            |sums| sums.maps.truncate(1),
            |sums| sums.captured.truncate(3),
            |sums| sums.in_range.truncate(3),
            |sums| sums.maps[1] = Moments::new(3),
        ];
        assert!(forgeries.iter().all(|change| !changed(*change).fits(4, 3)));
    }
}
