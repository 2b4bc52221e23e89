//! Draws of the posterior, each simulated: means and standard deviations of the maps.

use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::json;

use super::drive::{Drive, Kept, Progress};
use super::tissue::Column;
use super::{AtriumArgs, Outcome, Setup};
use crate::diagnostics::Moments;
use crate::ep::cell::RANGES;
use crate::ep::surface::{BeatMap, Simulation};
use crate::ep::{Parameters, Precision};
use crate::error::Failure;
use crate::report::FieldDraws;
use crate::store::{Keeper, take_chain};

/// Suffix of the fields in fields.vtp that a draw takes the place of.
const MEAN: &str = "_mean";

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

    fn outcome(self) -> Outcome {
        let n = f64::from(self.n_draws);
        let share = |counts: &[f64]| counts.iter().map(|x| x / n).collect::<Vec<f64>>();
        let (captured, in_range) = (share(&self.captured), share(&self.in_range));
        let mean = |shares: &[f64]| shares.iter().sum::<f64>() / shares.len() as f64;
        let never = captured.iter().filter(|share| **share < 1.0).count();
        eprintln!(
            "{} draws: {:.2} % of (vertex, draw) pairs captured, all draws at {} of {} vertices; {:.2} % of pairs \
             out of range: simulated at the nearest valid values, left out of the maps",
            self.n_draws,
            100.0 * mean(&captured),
            captured.len() - never,
            captured.len(),
            100.0 * (1.0 - mean(&in_range))
        );
        let record = vec![
            ("draws", json!(self.n_draws)),
            ("captured_pairs", json!(mean(&captured))),
            ("pairs_in_range", json!(mean(&in_range))),
        ];
        let mut maps = vec![];
        for (name, moments) in BeatMap::NAMES.iter().zip(&self.maps) {
            maps.push((format!("{name}_mean"), moments.means()));
            maps.push((format!("{name}_sd"), moments.sds()));
        }
        maps.push(("captured".into(), captured));
        maps.push(("in_range".into(), in_range));
        Outcome { maps, record }
    }
}

/// A posterior to take parameters from.
pub(super) struct Posterior<'a> {
    setup: &'a Setup,
    draws: FieldDraws,
    n: usize,
}

impl Posterior<'_> {
    /// The field whose draws take the place of a column, if there are some.
    fn drawn<'c>(&self, column: &'c Column) -> Option<&'c str> {
        let Column::Field { name, .. } = column else { return None };
        name.strip_suffix(MEAN).filter(|name| self.draws.coefficients.contains_key(*name))
    }

    /// The parameters of draw `i` of `n`, evenly spaced over those that were kept, at every vertex; those
    /// out of range brought to its ends, and where that was not needed.
    fn parameters(&self, i: usize) -> (Vec<Parameters>, Vec<bool>) {
        let draw = i * self.draws.n_draws() / self.n;
        let drawn = |column: &Column| self.draws.at_vertices(self.drawn(column)?, draw);
        let columns = self.setup.columns.each_ref().map(|c| (drawn(c), c));
        let at = |v: usize| {
            let value = |(drawn, column): &(Option<Vec<f64>>, &Column)| {
                drawn.as_ref().map_or_else(|| column.at(v), |values| values[v])
            };
            columns.each_ref().map(value)
        };
        let parameters = self.setup.parameters((0..self.setup.n_coarse).map(at).collect());
        let in_range = parameters.iter().map(|p| p.validate().is_ok()).collect();
        let nearest = |p: Parameters| {
            let mut values = p.to_array();
            for (value, (_, _, low, high)) in values.iter_mut().zip(RANGES) {
                *value = value.clamp(low, high);
            }
            Parameters::from_array(values)
        };
        (parameters.into_iter().map(nearest).collect(), in_range)
    }

    /// Simulates the draws, as many at a time as there are threads; `None` if interrupted.
    pub(super) fn ensemble<F: Precision>(
        &self,
        drive: &Drive<'_>,
    ) -> Result<Option<Outcome>, Failure> {
        let (setup, n) = (self.setup, self.n);
        let n_threads = rayon::current_num_threads().min(n);
        let mut sums = take_chain(drive.checkpoint, SUMS)?
            .unwrap_or_else(|| Sums::new(setup.mesh().n_vertices()));
        let mut kept = (0..n_threads)
            .map(|slot| take_chain(drive.checkpoint, SUMS + 1 + slot))
            .collect::<Result<Vec<Option<Kept<F>>>, _>>()?;
        let progress = Progress::new(setup.pacing.end * n as f64)?;
        let mut keeper = Keeper::new(Some(drive.checkpoint), SUMS);
        while (sums.n_draws as usize) < n {
            let first = sums.n_draws as usize;
            let times = Mutex::new(vec![0.0; n_threads]);
            let told = |slot: usize, time: f64| {
                let mut times = times.lock().unwrap_or_else(PoisonError::into_inner);
                times[slot] = time;
                progress.at(setup.pacing.end * first as f64 + times.iter().sum::<f64>());
            };
            let one = |(slot, kept): (usize, &mut Option<Kept<F>>)| {
                let draw = first + slot;
                let (parameters, in_range) = self.parameters(draw);
                let mut simulation = setup.begin::<F>(&parameters)?;
                let mut each = |s: &Simulation<F>| {
                    told(slot, s.time());
                    Ok(())
                };
                let place = (SUMS + 1 + slot, draw as u32);
                let is_done = drive.run(place, &mut simulation, kept.take(), &mut each)?;
                Ok(is_done.then(|| (simulation.beat(), in_range)))
            };
            let wave = n_threads.min(n - first);
            let beats: Vec<Result<_, Failure>> =
                kept[..wave].par_iter_mut().enumerate().map(one).collect();
            for beat in beats {
                let Some((beat, in_range)) = beat? else { return Ok(None) };
                sums.add(beat, &in_range);
            }
            keeper.keep(&sums);
        }
        progress.finish();
        Ok(Some(sums.outcome()))
    }
}

impl AtriumArgs {
    /// `n` draws of the posterior of --run.
    pub(super) fn posterior<'a>(
        &self,
        setup: &'a Setup,
        n: usize,
    ) -> Result<Posterior<'a>, Failure> {
        let folder = self.tissue.run.clone().unwrap_or_default();
        let draws = FieldDraws::read(&folder.join(FieldDraws::FILE))?;
        let has = draws.n_draws();
        if has < n || draws.n_vertices() != setup.n_coarse {
            return Err(Failure::new(format_args!(
                "--draws {n}: the run in {} kept {has} draws at {} vertices; its fields.vtp has {}\n\
                 help: ask for fewer draws, or repeat the run",
                folder.display(),
                draws.n_vertices(),
                setup.n_coarse
            )));
        }
        let posterior = Posterior { setup, draws, n };
        let drawn: Vec<&str> = setup.columns.iter().filter_map(|c| posterior.drawn(c)).collect();
        if drawn.is_empty() {
            let has: Vec<&str> = posterior.draws.coefficients.keys().map(String::as_str).collect();
            return Err(Failure::new(format_args!(
                "--draws {n}: no parameter is the mean of a field that was drawn; these were: {}\n\
                 help: give one as {}{MEAN}",
                has.join(", "),
                has.first().unwrap_or(&"NAME")
            )));
        }
        eprintln!("{n} of {} draws of {}", posterior.draws.n_draws(), drawn.join(", "));
        Ok(posterior)
    }
}
