//! Draws of the posterior, each simulated: means and standard deviations of the maps.

use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::drive::{Drive, Event, Kept, Slot};
use super::setup::{Column, TissueFields};
use super::{Atrium, AtriumError, Map, Summary};
use crate::diagnostics::Moments;
use crate::ep::cell::RANGES;
use crate::ep::surface::{BeatMap, Simulation};
use crate::ep::{Parameters, Precision};
use crate::report::FieldDraws;
use crate::store::Keeper;

/// Suffix of the fields that a draw takes the place of.
const MEAN: &str = "_mean";

/// The first slot of a checkpoint holds the sums over the draws that are done; draws under way follow.
const SUMS: usize = 0;

/// Draws of a posterior to take parameters from.
#[derive(Debug)]
pub(super) struct Posterior {
    pub(super) draws: FieldDraws,
    /// How many of them are simulated.
    pub(super) n: usize,
}

/// Parameters at every vertex.
struct Drawn {
    parameters: Vec<Parameters>,
    /// Where they were in their valid ranges; elsewhere they are the nearest valid ones.
    in_range: Vec<bool>,
}

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
    /// `n` of `draws`, checked against the surface.
    pub(super) fn new(
        draws: FieldDraws,
        n: usize,
        tissue: &TissueFields,
    ) -> Result<Self, AtriumError> {
        let (kept, n_vertices) = (draws.n_draws(), draws.n_vertices());
        if kept < n || n_vertices != tissue.n_coarse {
            let expected = tissue.n_coarse;
            return Err(AtriumError::Draws { asked: n, kept, n_vertices, expected });
        }
        let posterior = Self { draws, n };
        if posterior.drawn(tissue).is_empty() {
            let drawn = posterior.draws.coefficients.keys().cloned().collect();
            return Err(AtriumError::NothingDrawn { asked: n, drawn });
        }
        Ok(posterior)
    }

    /// Names of the fields whose draws take the place of a column.
    pub(super) fn drawn<'c>(&self, tissue: &'c TissueFields) -> Vec<&'c str> {
        tissue.columns.iter().filter_map(|column| self.field(column)).collect()
    }

    /// The field whose draws take the place of a column, if there are some.
    fn field<'c>(&self, column: &'c Column) -> Option<&'c str> {
        let Column::Field { name, .. } = column else { return None };
        name.strip_suffix(MEAN).filter(|name| self.draws.coefficients.contains_key(*name))
    }

    /// The parameters of draw `i` of `n`, evenly spaced over those that were kept.
    fn parameters(&self, tissue: &TissueFields, i: usize) -> Drawn {
        let draw = i * self.draws.n_draws() / self.n;
        let drawn = |column: &Column| self.draws.at_vertices(self.field(column)?, draw);
        let columns = tissue.columns.each_ref().map(|c| (drawn(c), c));
        let at = |v: usize| {
            let value = |(drawn, column): &(Option<Vec<f64>>, &Column)| {
                drawn.as_ref().map_or_else(|| column.at(v), |values| values[v])
            };
            columns.each_ref().map(value)
        };
        let parameters = tissue.refine((0..tissue.n_coarse).map(at).collect());
        let in_range = parameters.iter().map(|p| p.validate().is_ok()).collect();
        Drawn { parameters: parameters.into_iter().map(nearest).collect(), in_range }
    }

    /// Simulates the draws, as many at a time as there are threads; `None` if interrupted.
    pub(super) fn simulate<F: Precision>(
        &self,
        atrium: &Atrium,
        drive: &Drive<'_>,
    ) -> Result<Option<(Vec<Map>, Summary)>, AtriumError> {
        let n_threads = rayon::current_num_threads().min(self.n);
        let mut sums: Sums =
            drive.kept(SUMS)?.unwrap_or_else(|| Sums::new(atrium.mesh().n_vertices()));
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
            let Drawn { parameters, in_range } = self.parameters(&atrium.tissue, first + i);
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

/// The nearest parameters in their valid ranges.
fn nearest(parameters: Parameters) -> Parameters {
    let mut values = parameters.to_array();
    for (value, (_, _, low, high)) in values.iter_mut().zip(RANGES) {
        *value = value.clamp(low, high);
    }
    Parameters::from_array(values)
}
