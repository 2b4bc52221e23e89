//! What a calibration recovered of a known truth, its draws made physical as the truth was.
//!
//! Differs from `eplat run`, whose maps of derived quantities leave unphysical draws out: here each draw
//! is repaired like a truth, as the paper does, and then counts.

use rayon::prelude::*;

use super::calibrate::MAP_DRAWS;
use crate::diagnostics::Moments;
use crate::experiment::{ExperimentError, Truth, coverage, repaired, rms_error};
use crate::manifold::Basis;
use crate::model::{Declare, Maps, Model};

/// Draws that are held in memory at a time.
const WAVE: usize = 16;

/// One field or derived quantity: its truth and what is known of it.
#[derive(Clone, Debug)]
pub struct RecoveredMap {
    /// Name in the model file.
    pub name: String,
    /// Declared unit.
    pub unit: String,
    /// Truth (n_vertices).
    pub truth: Vec<f64>,
    /// Mean of the draws (n_vertices).
    pub mean: Vec<f64>,
    /// Their standard deviation (n_vertices).
    pub sd: Vec<f64>,
    /// Share of vertices whose truth lies in each of [`INTERVALS`](crate::experiment::INTERVALS).
    pub coverage: [f64; 3],
}

impl RecoveredMap {
    /// Independent standard errors, `|mean − truth|/sd`.
    pub fn ise(&self) -> Vec<f64> {
        self.errors().zip(&self.sd).map(|(error, sd)| error.abs() / sd).collect()
    }

    /// Root mean squared error over the vertices.
    pub fn rmse(&self) -> f64 {
        rms_error(&self.mean, &self.truth)
    }

    /// Mean error over the vertices.
    pub fn bias(&self) -> f64 {
        let known: Vec<f64> = self.errors().filter(|error| error.is_finite()).collect();
        known.iter().sum::<f64>() / known.len() as f64
    }

    fn errors(&self) -> impl Iterator<Item = f64> {
        self.mean.iter().zip(&self.truth).map(|(mean, truth)| mean - truth)
    }
}

/// What draws of whole fields say of a known truth.
#[derive(Clone, Debug)]
pub struct Recovery {
    /// Fields, then derived quantities.
    pub maps: Vec<RecoveredMap>,
    /// Share of draws in which each vertex was unphysical and repaired (n_vertices).
    pub repaired: Vec<f64>,
    /// Draws that were used.
    pub n_draws: usize,
    /// Draws without a physical vertex, from which nothing follows; they are left out.
    pub n_void: usize,
}

/// Sums over draws of one map.
struct Tally {
    moments: Moments,
    /// Draws below the truth (n_vertices).
    below: Vec<f64>,
}

/// Sums over draws of all maps.
struct Sums<'t> {
    truth: &'t [(String, Vec<f64>)],
    tallies: Vec<Tally>,
    /// Draws in which each vertex was unphysical (n_vertices).
    unphysical: Vec<f64>,
    n_draws: usize,
    n_void: usize,
}

/// Compares draws with the truth, by name and (n_vertices), of an experiment: at most 400 of the `n_draws`,
/// evenly spaced; `draw` gives the fields of one, each (n_vertices).
///
/// For models whose derived quantities depend on a place through its fields alone.
///
/// # Errors
/// [`ExperimentError::NothingPhysical`] where no draw has a physical vertex.
pub fn recover(
    model: &dyn Declare,
    basis: &Basis,
    truth: &[(String, Vec<f64>)],
    n_draws: usize,
    draw: &(dyn Fn(usize) -> Vec<Vec<f64>> + Sync),
) -> Result<Recovery, ExperimentError> {
    let outline = Model::outline(model)?;
    let maps = Maps::new(&outline, basis);
    let mut tape = outline.tape();
    outline.forward(&mut tape, &outline.initial());
    let physical = |i: &usize| match repaired(&maps, &tape, draw(*i), basis) {
        Err(ExperimentError::NothingPhysical) => Ok(None),
        made => made.map(Some),
    };
    let mut sums = Sums::new(truth, basis.n_vertices());
    let thinned: Vec<usize> = (0..n_draws).step_by(n_draws.div_ceil(MAP_DRAWS).max(1)).collect();
    for wave in thinned.chunks(WAVE) {
        let made: Vec<Result<_, ExperimentError>> = wave.par_iter().map(physical).collect();
        for made in made {
            sums.add(made?.as_ref());
        }
    }
    sums.recovery(&maps)
}

impl<'t> Sums<'t> {
    fn new(truth: &'t [(String, Vec<f64>)], n_vertices: usize) -> Self {
        let zeros = || vec![0.0; n_vertices];
        let tally = |_: &_| Tally { moments: Moments::new(n_vertices), below: zeros() };
        let tallies = truth.iter().map(tally).collect();
        Self { truth, tallies, unphysical: zeros(), n_draws: 0, n_void: 0 }
    }

    /// Takes a draw; `None` if it has no physical vertex.
    fn add(&mut self, made: Option<&Truth>) {
        let Some(made) = made else {
            self.n_void += 1;
            return;
        };
        self.n_draws += 1;
        for (count, bad) in self.unphysical.iter_mut().zip(&made.unphysical) {
            *count += f64::from(u8::from(*bad));
        }
        for ((tally, values), (_, truth)) in
            self.tallies.iter_mut().zip(made.maps()).zip(self.truth)
        {
            tally.add(values, truth);
        }
    }

    fn recovery(self, maps: &Maps<'_>) -> Result<Recovery, ExperimentError> {
        if self.n_draws == 0 {
            return Err(ExperimentError::NothingPhysical);
        }
        let recovered = self.tallies.into_iter().zip(self.truth).zip(maps.names());
        let recovered = recovered.map(|((tally, (_, truth)), name)| RecoveredMap {
            name: name.name.into(),
            unit: name.unit.into(),
            truth: truth.clone(),
            mean: tally.moments.means(),
            sd: tally.moments.sds(),
            coverage: coverage(&tally.ranks(truth)),
        });
        let n = self.n_draws as f64;
        Ok(Recovery {
            maps: recovered.collect(),
            repaired: self.unphysical.iter().map(|count| count / n).collect(),
            n_draws: self.n_draws,
            n_void: self.n_void,
        })
    }
}

impl Tally {
    fn add(&mut self, values: &[f64], truth: &[f64]) {
        self.moments.add(values.iter().copied());
        for ((below, value), truth) in self.below.iter_mut().zip(values).zip(truth) {
            *below += f64::from(u8::from(value < truth));
        }
    }

    /// The share of draws below the truth; NaN where that is unknown.
    fn ranks(&self, truth: &[f64]) -> Vec<f64> {
        let known = |((below, n), truth): ((&f64, &f64), &f64)| {
            if truth.is_nan() { f64::NAN } else { below / n }
        };
        self.below.iter().zip(self.moments.counts()).zip(truth).map(known).collect()
    }
}
