//! The measurement that teaches most: by how much a further one would lower the posterior variance.
//!
//! ```text
//! Var(t | f) = Var t − Cov(t, f) (Cov f + Σ)⁻¹ Cov(f, t)
//! ```
//! t is a map at a vertex, f what further measurements would see, Σ their own errors (of a bracket, that of
//! a value somewhere within it), all from draws of the posterior. Exact for jointly normal t and f, and it
//! does not depend on what will be measured.
//!
//! # Source
//! Cohn 1996, "Neural network exploration using optimal experiment design".

use crate::num::vector::dot;
use crate::random::procedure;
use std::collections::BTreeMap;

use nalgebra::{Cholesky, DMatrix};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{ExperimentError, Laboratory};
use crate::infer::LogDensity as _;
use crate::manifold::Basis;
use crate::model::{Declare, Maps, Model, RowId};

/// Vertices that stand for the surface.
const VERTICES: usize = 1500;

/// What a site would teach.
#[derive(Clone, Debug)]
pub struct Lesson {
    /// The site.
    pub vertex: u32,
    /// What would be measured there: one `observe`, or all of them.
    pub observes: Vec<&'static str>,
    /// Share of the posterior variance over the surface that it is expected to take away, mean over the derived
    /// quantities (the fields, if there are none).
    pub gain: f64,
    /// Predicted measurement, mean and standard deviation, of each of `observes`.
    pub predicted: Vec<(f64, f64)>,
}

/// How long it takes to measure, in minutes.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(try_from = "BTreeMap<String, f64>")]
pub struct Minutes {
    /// To move to a site.
    pub moving: f64,
    /// To measure there, by protocol: the name of an `observe`.
    #[serde(flatten)]
    pub protocols: BTreeMap<String, f64>,
}

impl TryFrom<BTreeMap<String, f64>> for Minutes {
    type Error = String;
    fn try_from(mut given: BTreeMap<String, f64>) -> Result<Self, String> {
        let moving = given.remove("moving").unwrap_or(f64::NAN);
        if !(moving >= 0.0 && moving.is_finite()) {
            return Err("expected moving = 0 or more: the minutes to move to a site".to_owned());
        }
        match given.iter().find(|(_, minutes)| !(**minutes > 0.0 && minutes.is_finite())) {
            Some((name, minutes)) => {
                Err(format!("{name} = {minutes}: expected a positive number of minutes"))
            }
            None => Ok(Self { moving, protocols: given }),
        }
    }
}

impl Minutes {
    /// All of these at one place. A protocol that is not named takes no time.
    pub fn measuring(&self, observes: &[&str]) -> f64 {
        observes.iter().filter_map(|name| self.protocols.get(*name)).sum()
    }

    /// Whether these are the protocols of a model that observes `known`.
    ///
    /// # Errors
    /// What there is and what is observed, in words.
    pub fn check_names(&self, known: &[&str]) -> Result<(), String> {
        let named: Vec<&str> = self.protocols.keys().map(String::as_str).collect();
        if named.len() == known.len() && known.iter().all(|name| named.contains(name)) {
            return Ok(());
        }
        let example: Vec<String> = known.iter().map(|name| format!("{name} = 2.0")).collect();
        Err(format!(
            "minutes of {}, where the model observes {}\nhelp: minutes = {{ moving = 1.0, {} }}",
            if named.is_empty() { "no protocol".to_owned() } else { named.join(", ") },
            known.join(", "),
            example.join(", "),
        ))
    }
}

/// What each of `sites` would teach, after `draws` of the unknowns of `fitted`: each measurement of its
/// own and then all together, site by site. `resolution` is the width of a bracket.
///
/// # Errors
/// [`ExperimentError`] for a model whose measurements cannot be made at a place alone, or do not predict one
/// value.
pub fn lessons(
    model: &dyn Declare,
    fitted: &Model,
    basis: &Basis,
    draws: &[Vec<f64>],
    sites: &[u32],
    resolution: f64,
) -> Result<Vec<Lesson>, ExperimentError> {
    let laboratory = Laboratory::new(model, basis)?;
    let outline = laboratory.outline();
    let (_, blank) = laboratory.blank(&laboratory.visits(sites), resolution)?;
    let f = Predicted::new(&blank, fitted, draws)?;
    let covariance = f.with_surface(fitted, basis, draws);
    let n = outline.observes.len();
    let of_site = |(i, vertex): (usize, &u32)| {
        let all: Vec<usize> = (0..n).map(|o| f.row(&blank, o, i)).collect();
        let mut sets: Vec<Vec<usize>> = (0..n).map(|o| vec![o]).collect();
        if n > 1 {
            sets.push((0..n).collect());
        }
        let lesson = |set: Vec<usize>| {
            let rows: Vec<usize> = set.iter().map(|o| all[*o]).collect();
            Lesson {
                vertex: *vertex,
                observes: set.iter().map(|o| outline.observes[*o].name).collect(),
                gain: covariance.gain(&f, &rows),
                predicted: rows.iter().map(|r| (f.mean[*r], f.variance(*r, *r).sqrt())).collect(),
            }
        };
        sets.into_iter().map(lesson).collect::<Vec<_>>()
    };
    Ok(sites.iter().enumerate().flat_map(of_site).collect())
}

/// Predicted measurements of all candidates in every draw.
struct Predicted {
    /// Centred, (candidate, draw).
    centred: Vec<Vec<f64>>,
    mean: Vec<f64>,
    /// Variance of a measurement about what is predicted.
    noise: Vec<f64>,
    ids: Vec<RowId>,
}

impl Predicted {
    fn new(blank: &Model, fitted: &Model, draws: &[Vec<f64>]) -> Result<Self, ExperimentError> {
        let ids = blank.row_ids();
        if blank.dim() != fitted.dim() {
            let why = "its unknowns depend on the table".to_owned();
            return Err(ExperimentError::NotSynthetic { why });
        }
        let (mut tape, mut locals) = (blank.tape(), vec![]);
        let mut rng = procedure(1);
        let mut values = vec![Vec::with_capacity(draws.len()); ids.len()];
        let mut noise = vec![0.0; ids.len()];
        for draw in draws {
            blank.locals_at(&mut tape, draw, &ids, &mut locals);
            let mut at = 0;
            for (r, id) in ids.iter().enumerate() {
                let own = &locals[at..at + blank.n_locals(*id)];
                at += own.len();
                let Some(location) = blank.row_location(*id, own) else {
                    let why = format!("{} predicts no one value", blank.observes[id.observe].name);
                    return Err(ExperimentError::NotSynthetic { why });
                };
                let cells = blank.row_replicate(*id, &blank.measured_row(*id), own, &mut rng);
                let measured = cells.iter().sum::<f64>() / cells.len() as f64;
                values[r].push(location);
                noise[r] += (measured - location).powi(2) / draws.len() as f64;
            }
        }
        let mean: Vec<f64> =
            values.iter().map(|v| v.iter().sum::<f64>() / v.len() as f64).collect();
        for (values, mean) in values.iter_mut().zip(&mean) {
            for x in values.iter_mut() {
                *x -= mean;
            }
        }
        Ok(Self { centred: values, mean, noise, ids })
    }

    /// The candidate of this observe at this site.
    fn row(&self, blank: &Model, observe: usize, site: usize) -> usize {
        let n = blank.observes.len();
        let row = site * n + observe;
        let is_it = |id: &RowId| id.observe == observe && blank.table_row(*id) == row;
        self.ids.iter().position(is_it).unwrap_or(row)
    }

    fn variance(&self, a: usize, b: usize) -> f64 {
        dot::<1>(&self.centred[a], &self.centred[b]) / (self.centred[a].len() as f64 - 1.0)
    }

    /// Covariances with the maps over the surface.
    fn with_surface(&self, fitted: &Model, basis: &Basis, draws: &[Vec<f64>]) -> Surface {
        let maps = Maps::new(fitted, basis);
        let (n_fields, n) = (maps.n_fields(), maps.names().len());
        let targets = if n > n_fields { n_fields..n } else { 0..n };
        let step = basis.n_vertices().div_ceil(VERTICES);
        let vertices: Vec<usize> = (0..basis.n_vertices()).step_by(step).collect();
        let values = maps.draws_at(draws, &vertices);
        let of = |map: &Vec<f64>| {
            let centred = centred(map);
            let scale = 1.0 / (centred.len() as f64 - 1.0);
            let covariance: Vec<f64> =
                self.centred.iter().map(|f| dot::<1>(f, &centred) * scale).collect();
            (dot::<1>(&centred, &centred) * scale, covariance)
        };
        let pairs: Vec<&Vec<f64>> =
            values.iter().flat_map(|maps| maps[targets.clone()].iter()).collect();
        let (variance, mut covariance): (Vec<f64>, Vec<Vec<f64>>) =
            pairs.par_iter().map(|map| of(map)).unzip();
        let n_maps = targets.len();
        let total = |map: usize| variance.iter().skip(map).step_by(n_maps).sum::<f64>();
        let totals: Vec<f64> = (0..n_maps).map(total).collect();
        for (i, covariance) in covariance.iter_mut().enumerate() {
            let total = totals[i % n_maps];
            let scale = if total > 0.0 { (total * n_maps as f64).sqrt().recip() } else { 0.0 };
            for c in covariance {
                *c *= scale;
            }
        }
        Surface { covariance }
    }
}

/// What is known of the maps over the surface.
struct Surface {
    /// Of a map at a vertex with what a candidate would see, (map at a vertex, candidate); each map in units in which
    /// its variances sum up to its share of 1.
    covariance: Vec<Vec<f64>>,
}

impl Surface {
    /// Share of the variance that measuring these candidates takes away.
    fn gain(&self, f: &Predicted, rows: &[usize]) -> f64 {
        let n = rows.len();
        let of_f = DMatrix::from_fn(n, n, |i, j| {
            f.variance(rows[i], rows[j]) + if i == j { f.noise[rows[i]] } else { 0.0 }
        });
        let Some(inverse) = Cholesky::new(of_f).map(|cholesky| cholesky.inverse()) else {
            return 0.0;
        };
        let one = |covariance: &Vec<f64>| {
            let c = nalgebra::DVector::from_fn(n, |i, _| covariance[rows[i]]);
            (c.transpose() * &inverse * c)[(0, 0)]
        };
        self.covariance.iter().map(one).sum()
    }
}

/// Draws minus their mean; unphysical ones at the mean.
fn centred(draws: &[f64]) -> Vec<f64> {
    let known = draws.iter().filter(|x| x.is_finite());
    let mean = known.clone().sum::<f64>() / known.count().max(1) as f64;
    draws.iter().map(|x| if x.is_finite() { x - mean } else { 0.0 }).collect()
}
