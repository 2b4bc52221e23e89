//! Leave-one-out prediction where importance weights cannot tell it: a short fit without the measurement.
//!
//! The fit starts from the draws of the fit with it, so that a short warm-up is enough. The measurement
//! stays where it is in the model and only stops to count, so that both have the same unknowns.

use std::collections::BTreeMap;
use std::io;

use crate::infer::{LogDensity as _, Settings, Silent};
use crate::model::{Model, Noise, RowId, Sampler};
use crate::num::ln_mean_exp;
use crate::random::Stream;
use crate::report::LeaveOneOut;
use crate::run::fit::Method;
use crate::run::{Event, Fit, Watch};

/// Most measurements that are left out, if a fit is cheap.
const MOST: usize = 40;
/// Most that are left out if it is not.
const MOST_DEAR: usize = 8;
/// Work of the run beyond which a fit is dear: some ten seconds. Work is the number of gradients times that of
/// unknowns, in which a row counts as so many unknowns.
const DEAR: f64 = 1e9;
const ROW: f64 = 10.0;
/// Warm-up and draws of each chain.
const WARMUP: usize = 100;
const DRAWS: usize = 250;
/// Draws of the run that a fit starts from.
const EARLIER: usize = 200;

/// How each measurement is predicted from the others.
pub(in crate::run) struct LeftOut {
    /// The figures of all measurements.
    pub(in crate::run) loo: LeaveOneOut,
    /// Replicates, of a bracket its lower end, of those that were left out in a fit of their own.
    pub(in crate::run) replicates: BTreeMap<usize, Vec<f64>>,
}

impl LeftOut {
    /// With no measurement left out in a fit of its own.
    pub(in crate::run) fn by_weights(loo: LeaveOneOut) -> Self {
        Self { loo, replicates: BTreeMap::new() }
    }
}

/// `loo` with the elpd of those measurements whose Pareto k is too high from fits without them; `watch` is told
/// how many of these are done.
pub(in crate::run) fn exact(fit: &Fit<'_>, loo: LeaveOneOut, watch: &Watch<'_>) -> LeftOut {
    let mut left = LeftOut::by_weights(loo);
    let Method::Sampled(sampler) = fit.method() else { return left };
    if !fit.converged() {
        return left;
    }
    let loo = &mut left.loo;
    let ids = fit.model().row_ids();
    let threshold = loo.record.k_threshold;
    let mut high: Vec<usize> =
        (0..ids.len()).filter(|i| loo.rows[*i].pareto_k > threshold).collect();
    high.sort_by(|a, b| loo.rows[*b].pareto_k.total_cmp(&loo.rows[*a].pareto_k));
    let gradients: u64 = fit.chains().iter().map(|c| c.n_grad_warmup + c.n_grad_sampling).sum();
    // where each place has a deviation of its own nearly every measurement would have to be left out
    let size = fit.model().dim() as f64 + ROW * ids.len() as f64;
    let is_dear = fit.model().has_spreads() || gradients as f64 * size > DEAR;
    high.truncate(if is_dear { MOST_DEAR } else { MOST });
    let of = high.len();
    for (done, i) in high.into_iter().enumerate() {
        watch.tell(&Event::LeavingOut { done, of });
        if let Some((elpd, replicates)) = without(fit, sampler, ids[i], i) {
            loo.set_exact(i, elpd);
            left.replicates.insert(i, replicates);
        }
    }
    if of > 0 {
        watch.tell(&Event::LeavingOut { done: of, of });
    }
    left
}

/// Log predictive density of measurement `i` in a fit without it, and replicates of it; `None` if that
/// fit fails.
fn without(fit: &Fit<'_>, sampler: Sampler, id: RowId, i: usize) -> Option<(f64, Vec<f64>)> {
    let loaded = fit.problem().loaded();
    let mut model =
        Model::new(fit.problem().declared(), loaded.basis(), &loaded.measurements).ok()?;
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
    let (mut ln, mut replicates) = (vec![], vec![]);
    let mut rng = Stream::WithoutRow { row: i }.rng(fit.settings.seed);
    for chain in chains {
        let each = chain.ok()?.draws.each(1, |_, draw| {
            model.locals_at(&mut tape, draw, &[id], &mut locals);
            ln.push(model.row_ln(id, &cells, &locals, &Noise::default()));
            replicates.push(model.row_replicate(id, &cells, &locals, &mut rng)[0]);
            io::Result::Ok(())
        });
        each.ok()?;
    }
    let elpd = ln_mean_exp(&ln);
    elpd.is_finite().then_some((elpd, replicates))
}
