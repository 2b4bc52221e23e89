//! The record of a fit: `run.json`.

use std::collections::BTreeMap;
use std::time::Instant;

use super::fit::{Drawn, Fit};
use super::results::VERSION;
use crate::diagnostics::e_bfmi;
use crate::diagnostics::verdict::{Questions, Verdict};
use crate::infer::{Chain, LogDensity as _};
use crate::model::Model;
use crate::report::{Provenance, Row, RunRecord, Seconds, SettingsRecord, verdict};

/// Most measurements that divergences are told to come from.
const MOST_SUSPECTS: usize = 3;

impl Fit<'_> {
    /// The record, if writing the results took `writing` s so far.
    pub(super) fn record_after(&self, writing: f64) -> RunRecord {
        let (maps, judged) = (self.maps(), self.record_of_verdict());
        let spent = Spent::of(self.chains(), self.drawn.seconds);
        RunRecord {
            seconds: self.seconds_of(&spent, self.seconds + writing + self.drawn.seconds_before),
            rmse: some(maps.iter().filter_map(|m| Some((m.name.clone(), m.rmse()?))).collect()),
            coverage: some(
                maps.iter().filter_map(|m| Some((m.name.clone(), m.coverage?))).collect(),
            ),
            unphysical: self.unphysical().map(|all| all.iter().sum::<f64>() / all.len() as f64),
            units: maps.iter().map(|m| (m.name.clone(), m.unit.clone())).collect(),
            loo: self.loo().map(|loo| loo.record.clone()),
            ..judged
        }
    }

    /// The record as far as it tells whether the posterior is worth believing.
    pub(super) fn record_of_verdict(&self) -> RunRecord {
        let questions = self.questions().clone();
        let mut record = RunRecord { questions, ..self.record_of_sampling() };
        record.verdict = verdict(&record, self.summary());
        record
    }

    /// The record as far as it tells how the draws were made.
    pub(super) fn record_of_sampling(&self) -> RunRecord {
        let posterior = self.posterior();
        let Drawn { chains, failures, approximation, .. } = &self.drawn;
        let spent = Spent::of(chains, self.drawn.seconds);
        let gradient = *self.gradient.get_or_init(|| seconds_of_gradient(self.model(), &self.kept));
        let least =
            |of: fn(&Row) -> f64| posterior.rows.iter().map(of).fold(f64::INFINITY, f64::min);
        let min_ess_bulk = least(|r| r.summary.ess_bulk);
        RunRecord {
            model: self.model().name.into(),
            version: VERSION.into(),
            seed: self.settings.seed,
            provenance: self.provenance(),
            settings: SettingsRecord {
                draws: chains.first().map_or(0, Chain::n_draws),
                ..self.method.record(self.model(), &self.settings)
            },
            hashes: self.hashes.clone(),
            files: BTreeMap::new(),
            n_params: self.model().dim(),
            grad_evals: spent.gradients,
            ns_per_grad: 1e9 * gradient,
            sampler_ns_per_grad: (spent.ns_per_gradient - 1e9 * gradient).max(0.0),
            seconds: self.seconds_of(&spent, self.seconds),
            divergences: chains.iter().map(Chain::n_divergences).sum(),
            failed_chains: failures.iter().map(ToString::to_string).collect(),
            max_r_hat: -least(|r| -r.summary.r_hat),
            min_ess_bulk,
            min_ess_tail: least(|r| r.summary.ess_tail),
            ess_per_second: min_ess_bulk / self.drawn.seconds,
            e_bfmi: chains.iter().map(|c| e_bfmi(&c.energy)).fold(f64::INFINITY, f64::min),
            rmse: None,
            coverage: None,
            unphysical: None,
            units: BTreeMap::new(),
            divergent_at: self.suspects(),
            strays: posterior.strays.clone(),
            not_simulated: self.not_simulated(),
            loo: None,
            laplace: approximation.clone(),
            questions: Questions::default(),
            verdict: Verdict::default(),
        }
    }

    /// What was fitted to what.
    fn provenance(&self) -> Provenance {
        let loaded = self.problem.loaded();
        let surface = loaded.surface();
        Provenance {
            mesh: surface.map(|_| loaded.origin.mesh.clone()),
            n_vertices: surface.map_or(0, |surface| surface.mesh.n_vertices()),
            mesh_notes: surface.map_or_else(Vec::new, |surface| surface.notes.clone()),
            model: loaded.origin.model.as_ref().and_then(|model| model.path.clone()),
            surface: surface.and(loaded.origin.surface.clone()),
            basis: loaded.origin.basis.clone(),
            data: loaded.origin.data.clone(),
            n_rows: self.model().row_ids().len(),
            n_sites: self.problem.measurements().vertices().len(),
            command: loaded.origin.command.clone(),
            date: time::UtcDateTime::now().date().to_string(),
        }
    }

    fn seconds_of(&self, spent: &Spent, elapsed: f64) -> Seconds {
        Seconds {
            compile: self.compile_seconds,
            setup: elapsed - self.drawn.seconds,
            warmup: spent.warmup,
            sampling: spent.sampling,
            total: elapsed + self.compile_seconds,
        }
    }

    /// Statements over the table that measurements cannot be simulated from.
    fn not_simulated(&self) -> Vec<String> {
        let densities = self.model().densities.iter().filter(|density| density.reads_data);
        densities.map(|density| density.name.to_owned()).collect()
    }

    /// The measurements whose log likelihood falls most along divergent transitions.
    fn suspects(&self) -> Vec<String> {
        let mut blamed: BTreeMap<usize, usize> = BTreeMap::new();
        let (model, mut tape) = (self.model(), self.model().tape());
        let mut pointwise = |u: &[f64]| {
            let mut out = vec![];
            model.forward(&mut tape, u);
            model.pointwise(&tape, &mut out);
            out
        };
        for divergence in self.chains().iter().flat_map(|c| &c.divergences) {
            let (start, end) = (pointwise(&divergence.start), pointwise(&divergence.end));
            let falls = end.iter().zip(&start).map(|(e, s)| e - s).enumerate();
            let worst = falls.min_by(|a, b| a.1.total_cmp(&b.1));
            if let Some((row, fall)) = worst
                && fall < 0.0
            {
                *blamed.entry(row).or_default() += 1;
            }
        }
        let mut blamed: Vec<(usize, usize)> = blamed.into_iter().collect();
        blamed.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
        let words = |(row, count): &(usize, usize)| format!("{} ({count})", self.place_of(*row));
        blamed.iter().take(MOST_SUSPECTS).map(words).collect()
    }

    /// Measurement number `row` of all, in words.
    fn place_of(&self, mut row: usize) -> String {
        for (name, rows) in self.model().measured() {
            match rows.get(row) {
                Some(at) => return format!("{name} {}", self.problem.measurements().place(*at)),
                None => row -= rows.len(),
            }
        }
        String::new()
    }
}

/// The map, unless there is nothing in it.
fn some<T>(map: BTreeMap<String, T>) -> Option<BTreeMap<String, T>> {
    Some(map).filter(|map| !map.is_empty())
}

/// Time of one log density with its gradient at some draws, evenly spaced, s. It is the least of several means:
/// the one that other programs disturbed least.
fn seconds_of_gradient(model: &Model, draws: &[Vec<f64>]) -> f64 {
    const BATCHES: usize = 8;
    const LONGEST: f64 = 0.05;
    const DRAWS: usize = 32;
    let draws = || draws.iter().step_by(draws.len().div_ceil(DRAWS).max(1));
    let (mut evaluator, mut gradient) = (model.evaluator(), vec![0.0; model.dim()]);
    let (begun, mut least) = (Instant::now(), f64::NAN);
    for _ in 0..BATCHES {
        let batch = Instant::now();
        for draw in draws() {
            evaluator.ln_density(draw, &mut gradient);
        }
        least = least.min(batch.elapsed().as_secs_f64() / draws().count() as f64);
        if begun.elapsed().as_secs_f64() > LONGEST {
            break;
        }
    }
    least
}

/// What the draws cost.
struct Spent {
    gradients: u64,
    /// Time in the chains for each gradient, ns: that of the gradient and the sampler's own.
    ns_per_gradient: f64,
    /// Wall time of each phase, s, as if the chains had been in step.
    warmup: f64,
    sampling: f64,
}

impl Spent {
    /// `seconds` of wall time in all.
    fn of(chains: &[Chain], seconds: f64) -> Self {
        let sum = |of: fn(&Chain) -> f64| chains.iter().map(of).sum::<f64>();
        let (warmup, sampling) = (sum(|c| c.seconds_warmup), sum(|c| c.seconds_sampling));
        let gradients = chains.iter().map(|c| c.n_grad_warmup + c.n_grad_sampling).sum::<u64>();
        let wall = seconds / (warmup + sampling);
        Self {
            gradients,
            ns_per_gradient: 1e9 * (warmup + sampling) / gradients as f64,
            warmup: warmup * wall,
            sampling: sampling * wall,
        }
    }
}
