//! Leave-one-out prediction where importance weights cannot tell it: with the fields integrated out
//! ([`Model::predictive`]), and where that does not do, in a short fit without the measurement.
//!
//! The fit starts from the draws of the fit with it, so that a short warm-up is enough. The measurement
//! stays where it is in the model and only stops to count, so that both have the same unknowns.

use std::collections::BTreeMap;
use std::io;

use rand::Rng;
use rand_distr::Distribution as _;
use rand_distr::weighted::WeightedIndex;
use rayon::prelude::*;

use crate::diagnostics::{LooPoint, bridged, k_threshold};
use crate::infer::{LogDensity as _, Settings, Silent};
use crate::model::{Model, Noise, Predictive, RowId, Sampler};
use crate::random::Stream;
use crate::report::{LeaveOneOut, LeftOutBy};
use crate::run::fit::Method;
use crate::run::{Event, Fit, Watch};

/// Most measurements that are left out, if a fit is cheap.
const MOST: usize = 40;
/// Most that are left out if it is not.
const MOST_DEAR: usize = 8;
/// Plain weights with a larger k have been wrong by half a nat, though it was below the threshold.
const BARELY_LOW: f64 = 0.5;
/// Work of the run beyond which a fit is dear: some ten seconds. Work is the number of gradients times that of
/// unknowns, in which a row counts as so many unknowns.
const DEAR: f64 = 1e9;
const ROW: f64 = 10.0;
/// Fits at a time: each has steps that one core does alone.
const SIDE_BY_SIDE: usize = 2;
/// Warm-up and draws of each chain.
const WARMUP: usize = 100;
const DRAWS: usize = 250;
/// Draws of the run that a fit starts from.
const EARLIER: usize = 200;

/// How each measurement is predicted from the others.
pub(in crate::run) struct LeftOut {
    /// The figures of all measurements.
    pub(in crate::run) loo: LeaveOneOut,
    /// Replicates of the measurements that plain weights do not tell; of a bracket its lower end.
    pub(in crate::run) replicates: BTreeMap<usize, Vec<f64>>,
}

impl LeftOut {
    /// By plain weights.
    pub(in crate::run) fn by_weights(loo: LeaveOneOut) -> Self {
        Self { loo, replicates: BTreeMap::new() }
    }
}

/// `loo` with a better elpd where the Pareto k of plain weights is too high; `watch` is told how many fits without a
/// measurement are done.
pub(in crate::run) fn exact(fit: &Fit<'_>, loo: LeaveOneOut, watch: &Watch<'_>) -> LeftOut {
    let mut left = LeftOut::by_weights(loo);
    let Method::Sampled(sampler) = fit.method() else { return left };
    if !fit.converged() {
        return left;
    }
    let LeftOut { loo, replicates } = &mut left;
    let ids = fit.model().row_ids();
    let threshold = loo.record.k_threshold;
    let mut high: Vec<usize> =
        (0..ids.len()).filter(|i| loo.rows[*i].pareto_k > threshold).collect();
    if high.is_empty() {
        return left;
    }
    // a k that is barely low hides errors, too: where there are few rows all of them are told so
    let is_few = ids.len() <= MOST;
    let asked: Vec<usize> =
        (0..ids.len()).filter(|i| is_few || loo.rows[*i].pareto_k > BARELY_LOW).collect();
    let of_asked: Vec<RowId> = asked.iter().map(|i| ids[*i]).collect();
    let predictive = fit.model().predictive(&fit.kept, &of_asked, fit.settings.seed);
    let mut rng = Stream::Resampled.rng(fit.settings.seed);
    for (i, predictive) in asked.iter().zip(&predictive) {
        let told = predictive.as_ref().and_then(|predictive| told(predictive, &mut rng));
        if let Some((elpd, own)) = told {
            loo.set(*i, elpd, LeftOutBy::Integrated);
            replicates.insert(*i, own);
        }
    }
    high.retain(|i| !replicates.contains_key(i));
    high.sort_by(|a, b| loo.rows[*b].pareto_k.total_cmp(&loo.rows[*a].pareto_k));
    let gradients: u64 = fit.chains().iter().map(|c| c.n_grad_warmup + c.n_grad_sampling).sum();
    let size = fit.model().dim() as f64 + ROW * ids.len() as f64;
    let is_dear = gradients as f64 * size > DEAR;
    // where a gradient costs milliseconds, one such fit takes a fifth of the run
    let is_slow = fit.model().interwoven().is_some();
    high.truncate(match (is_slow, is_dear) {
        (true, _) => 0,
        (false, true) => MOST_DEAR,
        (false, false) => MOST,
    });
    let of = high.len();
    for (turn, rows) in high.chunks(SIDE_BY_SIDE).enumerate() {
        watch.tell(&Event::LeavingOut { done: turn * SIDE_BY_SIDE, of });
        let fits: Vec<Option<(f64, Vec<f64>)>> =
            rows.par_iter().map(|i| without(fit, sampler, ids[*i], *i)).collect();
        for (i, told) in rows.iter().zip(fits) {
            if let Some((elpd, own)) = told {
                loo.set(*i, elpd, LeftOutBy::Fit);
                replicates.insert(*i, own);
            }
        }
    }
    if of > 0 {
        watch.tell(&Event::LeavingOut { done: of, of });
    }
    left
}

/// Log predictive density of a measurement, and replicates of it; `None` if these weights cannot tell it either.
fn told(predictive: &Predictive, rng: &mut impl Rng) -> Option<(f64, Vec<f64>)> {
    // points are independent, or draws that are spread over the chains and nearly so
    let (point, weights) = LooPoint::weighted(&predictive.ln_density, &predictive.ln_weight)?;
    let n = weights.len();
    let weighted = WeightedIndex::new(weights).ok().filter(|_| point.pareto_k <= k_threshold(n))?;
    Some((point.elpd, (0..n).map(|_| predictive.replicates[weighted.sample(rng)]).collect()))
}

/// Log predictive density of measurement `i` in a fit without it, and replicates of it; `None` if that
/// fit fails.
fn without(fit: &Fit<'_>, sampler: Sampler, id: RowId, i: usize) -> Option<(f64, Vec<f64>)> {
    let loaded = fit.problem().loaded();
    let mut model =
        Model::new(fit.problem().declared(), loaded.basis(), &loaded.measurements).ok()?;
    model.correct_as(fit.model()).ok()?;
    model.leave_out(id);
    let settings = Settings {
        warmup: WARMUP,
        draws: DRAWS,
        chains: fit.chains().len(),
        earlier: fit.thinned(EARLIER).ok()?,
        disk: None,
        ..fit.settings.clone()
    };
    let starts: Option<Vec<Vec<f64>>> =
        fit.chains().iter().map(|c| Some(c.draw(c.n_draws() - 1).ok()?.into_owned())).collect();
    let chains = sampler.sample(&model, &starts?, &settings, &Silent).ok()?;
    let (cells, mut tape, mut locals) = (model.measured_row(id), model.tape(), vec![]);
    let mut ln_at = |draw: &[f64], locals: &mut Vec<f64>| {
        model.locals_at(&mut tape, draw, &[id], locals);
        model.row_ln(id, &cells, locals, &Noise::default())
    };
    let with: Vec<f64> = fit.kept.iter().map(|draw| ln_at(draw, &mut locals)).collect();
    let (mut ln, mut replicates) = (vec![], vec![]);
    let mut rng = Stream::WithoutRow { row: i }.rng(fit.settings.seed);
    for chain in chains {
        let each = chain.ok()?.draws.each(1, |_, draw| {
            ln.push(ln_at(draw, &mut locals));
            replicates.push(model.row_replicate(id, &cells, &locals, &mut rng)[0]);
            io::Result::Ok(())
        });
        each.ok()?;
    }
    let elpd = bridged(&with, &ln);
    elpd.is_finite().then_some((elpd, replicates))
}
