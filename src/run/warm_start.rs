//! A run that starts from the draws of an earlier one.
//!
//! Metric, stand-in and proposals are not carried over but made anew from those draws on the present
//! measurements, which therefore may be more, or others.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use thiserror::Error;

use super::unknowns::{FILE, Unknowns};
use super::{Event, RunError, Watch};
use crate::infer::{LogDensity as _, Settings};
use crate::model::Model;
use crate::report::RunRecord;

/// Draws that scales and correlations are learnt from, over all chains.
const LEARNT_FROM: usize = 200;

/// Why a run cannot start from an earlier one.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum WarmStartError {
    /// The earlier run is of another model.
    #[error(
        "--init: the run in {} is of the model {theirs}, not of {ours}\nhelp: name a run of this model, or start without --init",
        folder.display()
    )]
    AnotherModel {
        /// The earlier run.
        folder: PathBuf,
        /// Its model.
        theirs: String,
        /// The model that is to be sampled.
        ours: &'static str,
    },
    /// The earlier run has no unknown in common with the model.
    #[error(
        "--init: the run in {} has none of this model's unknowns\nhelp: start without --init",
        folder.display()
    )]
    NothingInCommon {
        /// The earlier run.
        folder: PathBuf,
    },
}

impl Unknowns {
    /// Fewer draws of each chain, the last first.
    fn latest(mut self) -> Self {
        let n: usize = self.chains.iter().map(Vec::len).sum();
        let step = n.div_ceil(LEARNT_FROM).max(1);
        for chain in &mut self.chains {
            *chain = chain.iter().rev().step_by(step).cloned().collect();
        }
        self
    }

    /// The draws as unknowns of `model`; what is new there is taken from `usual` starts in turn.
    fn matched(&self, model: &Model, usual: &[Vec<f64>]) -> Vec<Vec<Vec<f64>>> {
        let at: BTreeMap<&String, usize> =
            self.about.unknowns.iter().enumerate().map(|(i, name)| (name, i)).collect();
        let from: Vec<Option<usize>> =
            model.unknown_names().iter().map(|name| at.get(name).copied()).collect();
        let draw = |draw: &Vec<f64>, usual: &Vec<f64>| {
            from.iter().zip(usual).map(|(from, usual)| from.map_or(*usual, |i| draw[i])).collect()
        };
        let chain = |chain: &Vec<Vec<f64>>| {
            chain.iter().zip(usual.iter().cycle()).map(|(d, u)| draw(d, u)).collect()
        };
        self.chains.iter().map(chain).collect()
    }

    /// Names that `model` has and the earlier run had not, and the other way round.
    fn unmatched(&self, model: &Model) -> [Vec<String>; 2] {
        let here = model.unknown_names();
        let without = |a: &[String], b: &[String]| {
            a.iter().filter(|name| !b.contains(name)).cloned().collect()
        };
        [without(&here, &self.about.unknowns), without(&self.about.unknowns, &here)]
    }
}

/// Starting points from the earlier run in `folder`, with what is new from the `usual` ones; its draws go into the settings.
pub(super) fn starts(
    folder: &Path,
    model: &Model,
    usual: Vec<Vec<f64>>,
    settings: &mut Settings,
    watch: &Watch<'_>,
) -> Result<Vec<Vec<f64>>, RunError> {
    let earlier = Unknowns::read(&RunRecord::file_of(folder, FILE)?)?.latest();
    if earlier.about.model != model.name {
        let (folder, theirs, ours) = (folder.to_owned(), earlier.about.model, model.name);
        return Err(WarmStartError::AnotherModel { folder, theirs, ours }.into());
    }
    let [new, gone] = earlier.unmatched(model);
    let (n_unknowns, n_matched) = (model.dim(), model.dim() - new.len());
    if n_matched == 0 {
        return Err(WarmStartError::NothingInCommon { folder: folder.to_owned() }.into());
    }
    let draws = earlier.matched(model, &usual);
    let starts =
        (0..settings.chains).map(|c| start(model, &draws[c % draws.len()], c / draws.len()));
    let starts: Vec<Option<Vec<f64>>> = starts.collect();
    let unsupported: Vec<usize> = (0..starts.len()).filter(|c| starts[*c].is_none()).collect();
    let (new, gone, unsupported) = (&new, &gone, &unsupported);
    watch.tell(&Event::WarmStart { folder, n_matched, n_unknowns, new, gone, unsupported });
    settings.earlier = draws.concat();
    Ok(starts.into_iter().zip(usual).map(|(start, usual)| start.unwrap_or(usual)).collect())
}

/// The latest draw of a chain, after `skip` others, that the model supports.
fn start(model: &Model, chain: &[Vec<f64>], skip: usize) -> Option<Vec<f64>> {
    let mut evaluator = model.evaluator();
    let mut gradient = vec![0.0; model.dim()];
    let mut supported = chain.iter().filter(|draw| {
        evaluator.ln_density(draw, &mut gradient).is_finite()
            && gradient.iter().all(|g| g.is_finite())
    });
    supported.nth(skip).cloned()
}
