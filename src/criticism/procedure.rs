//! The whole search: base fit, candidates, null searches, what is claimed and what cannot be told.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::candidates::{Candidate, Maker, Unusable, covariates};
use super::checks::{Warning, check};
use super::engine::{Engine, Outer, Term};
use super::error::CriticismError;
use super::fit::Fit;
use super::judge::CLAIM;
use super::observable::{observables, step_of};
use super::outer::{Free, optimise};
use super::search::{Left, Tried, field_sd, search, simulate};
use super::units::{Unit, by_site, random_unit};
use crate::dsl::{Declare, Measurements, Model};
use crate::manifold::Basis;

/// p-value of the screen up to which a candidate is fitted.
const GATE: f64 = 0.05;

/// What is criticised.
#[derive(Clone, Copy)]
pub struct Case<'a> {
    /// The model as declared.
    pub model: &'a dyn Declare,
    /// Eigenpairs, for a model with fields.
    pub basis: Option<&'a Basis>,
    /// The measurements.
    pub table: &'a Measurements,
}

impl std::fmt::Debug for Case<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Case").field("model", &self.model.name()).finish_non_exhaustive()
    }
}

/// How to search.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Null searches per round.
    pub nulls: usize,
    /// Most effects that are added.
    pub rounds: usize,
    /// Seed of every random stream.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self { nulls: 99, rounds: 3, seed: 1 }
    }
}

/// What became of a candidate in a round.
#[derive(Clone, Debug)]
pub struct Record {
    /// Number of the candidate.
    pub candidate: usize,
    /// p-value of the screen.
    pub p_screen: f64,
    /// Log Bayes factor; −∞ if the screen stopped it.
    pub log_bf: f64,
    /// Share of null searches whose best candidate did as well.
    pub p_null: f64,
    /// Why it was or was not taken.
    pub verdict: String,
}

/// One round of the search.
#[derive(Clone, Debug)]
pub struct Round {
    /// Every candidate, best first.
    pub tried: Vec<Record>,
    /// Best log Bayes factor of each null search, ascending.
    pub nulls: Vec<f64>,
    /// The fit that the candidates are compared with.
    pub base: Fit,
    /// What it leaves over.
    pub left: Left,
}

/// What the search came to.
#[derive(Debug)]
pub struct Outcome {
    /// Everything that could be tried.
    pub candidates: Vec<Candidate>,
    /// Columns that could not.
    pub unusable: Vec<Unusable>,
    /// Doubts about the table.
    pub warnings: Vec<Warning>,
    /// The model laid out with all candidates.
    pub engine: Engine,
    /// The rounds.
    pub rounds: Vec<Round>,
    /// Candidates that are claimed, in order.
    pub found: Vec<usize>,
    /// Pairs of causes that cannot be told apart.
    pub ambiguous: Vec<[String; 2]>,
    /// Log Bayes factor of the sites' random effect after everything that was found.
    pub site_log_bf: f64,
    /// That of the units' (recordings, sessions), where they have one, and the column that names them.
    pub unit_log_bf: Option<(String, f64)>,
    /// What is left out as a whole, where that is not the site.
    pub unit: Option<Unit>,
    /// The fit with everything that was found.
    pub last: Fit,
    /// Width of a protocol step, in the unit of the measurement.
    pub step: f64,
}

impl Outcome {
    /// Whether sites differ by more than the model with its findings says.
    pub fn is_unexplained(&self) -> bool {
        self.site_log_bf > CLAIM || self.unit_log_bf.as_ref().is_some_and(|(_, bf)| *bf > CLAIM)
    }
}

/// Lays a case out for Laplace fits, with these candidates to try and, last, the random effect of `unit`.
fn engine(
    case: &Case<'_>,
    on: &[String],
    terms: &[Candidate],
    unit: Option<&Unit>,
) -> Result<Engine, CriticismError> {
    let fields = Model::outline(case.model)?.field_names().into_iter().map(String::from);
    let offsets_on: Vec<String> = on.iter().cloned().chain(fields).collect();
    let model = Model::with_offsets(case.model, case.basis, case.table, &offsets_on)?;
    let terms = terms.iter().map(|candidate| {
        let (design, n) = candidate.form.design(case.table);
        Term { on: candidate.on.clone(), design, n, sd: Some(candidate.sd) }
    });
    let unit =
        unit.map(|unit| Term { on: on.to_vec(), design: unit.design(), n: unit.n, sd: None });
    let terms = terms.chain(unit).collect();
    Ok(Engine::new(model, on, &by_site(case.table).group, terms))
}

/// The base fit, before anything is tried: from the model's own start, sites and noise at a third of
/// a step.
fn base_fit(engine: &Engine, unit: Option<&Unit>, step: f64) -> Result<Fit, CriticismError> {
    let initial = engine.model.initial();
    let third = (step / 3.0).ln();
    let outer = Outer {
        other: engine.split.other.iter().map(|u| initial[*u]).collect(),
        ln_site: third,
        ln_noise: third,
        ln_unit: unit.map(|_| third),
        outliers: None,
    };
    let active: &[usize] = if unit.is_some() { &[0] } else { &[] };
    let start = engine.fit(&outer, active, None).ok_or(CriticismError::NoFit)?;
    optimise(engine, active, &start, Free::All, step)
        .map(|(fit, _)| fit)
        .ok_or(CriticismError::NoFit)
}

/// Runs the whole search; `watch` is told (round, null searches done).
///
/// # Errors
/// What does not fit between model and table; a model that cannot be criticised.
pub fn criticise(
    case: &Case<'_>,
    settings: &Settings,
    watch: &(dyn Fn(usize, usize) + Sync),
) -> Result<Outcome, CriticismError> {
    let outline = Model::outline(case.model)?;
    let on = observables(&outline)?;
    let plain = engine(case, &on, &[], None)?;
    let columns = covariates(&plain.model, case.table);
    let warnings = check(case.table, &columns);
    let unit = random_unit(case.table, columns.into_iter());
    let plain = if unit.is_some() { engine(case, &on, &[], unit.as_ref())? } else { plain };
    let step = step_of(&plain.model);
    let mut start = base_fit(&plain, unit.as_ref(), step)?;
    let mut once = on.clone();
    once.sort();
    once.dedup();
    let maker = Maker {
        model: &plain.model,
        table: case.table,
        on: once,
        step,
        field_sd: field_sd(&plain, &start, step),
        unit: unit.as_ref(),
    };
    let (candidates, unusable) = maker.all();
    let laid = engine(case, &on, &candidates, unit.as_ref())?;
    let run = Run { case, settings, on, candidates, engine: laid, step, unit };
    start.active = run.active(&[]);
    run.rounds(start, (unusable, warnings), watch)
}

/// A search as it runs.
pub(super) struct Run<'a> {
    pub(super) case: &'a Case<'a>,
    pub(super) settings: &'a Settings,
    on: Vec<String>,
    pub(super) candidates: Vec<Candidate>,
    pub(super) engine: Engine,
    pub(super) step: f64,
    /// The unit with a random effect.
    pub(super) unit: Option<Unit>,
}

impl Run<'_> {
    /// The terms of a fit: the random effect of units, which is always there, and these.
    pub(super) fn active(&self, candidates: &[usize]) -> Vec<usize> {
        let unit = self.unit.iter().map(|_| self.candidates.len());
        unit.chain(candidates.iter().copied()).collect()
    }

    fn rounds(
        self,
        start: Fit,
        (unusable, warnings): (Vec<Unusable>, Vec<Warning>),
        watch: &(dyn Fn(usize, usize) + Sync),
    ) -> Result<Outcome, CriticismError> {
        let (mut rounds, mut found, mut ambiguous): (Vec<Round>, Vec<usize>, Vec<[String; 2]>) =
            (vec![], vec![], vec![]);
        let mut base = start;
        while rounds.len() < self.settings.rounds + 1 {
            let round = self.round(rounds.len(), &base, &found, watch)?;
            let (round, taken, rivals) = self.judge(round, &base, &found);
            rounds.push(round);
            ambiguous.extend(rivals);
            let Some((taken, fit)) = taken else { break };
            found.push(taken);
            base = optimise(&self.engine, &self.active(&found), &fit, Free::All, self.step)
                .map_or(fit, |(fit, _)| fit);
            if rounds.len() == self.settings.rounds {
                break;
            }
        }
        let site_log_bf = self.site_evidence(&base);
        let unit_log_bf =
            self.unit.as_ref().map(|u| (u.name.clone(), self.unit_evidence(&base, &found)));
        let unit = self.left_out(None);
        let Run { candidates, engine, step, .. } = self;
        Ok(Outcome {
            candidates,
            unusable,
            warnings,
            engine,
            rounds,
            found,
            ambiguous,
            site_log_bf,
            unit_log_bf,
            unit,
            last: base,
            step,
        })
    }

    fn round(
        &self,
        number: usize,
        base: &Fit,
        found: &[usize],
        watch: &(dyn Fn(usize, usize) + Sync),
    ) -> Result<(Vec<Tried>, Vec<f64>), CriticismError> {
        let mut tried = self.search(&self.engine, base, found);
        tried.sort_by(|a, b| b.log_bf.total_cmp(&a.log_bf));
        let best = tried.first().map_or(f64::NEG_INFINITY, |t| t.log_bf);
        if number > 0 && best <= CLAIM {
            return Ok((tried, vec![]));
        }
        let done = std::sync::atomic::AtomicUsize::new(0);
        let null = |k: usize| -> Result<f64, CriticismError> {
            let best = self.null(number, k, base, found)?;
            watch(number, 1 + done.fetch_add(1, std::sync::atomic::Ordering::Relaxed));
            Ok(best)
        };
        let nulls: Result<Vec<f64>, _> =
            (0..self.settings.nulls).into_par_iter().map(null).collect();
        let mut nulls = nulls?;
        nulls.sort_by(f64::total_cmp);
        Ok((tried, nulls))
    }

    fn search(&self, engine: &Engine, base: &Fit, found: &[usize]) -> Vec<Tried> {
        let active = self.active(found);
        search(engine, &self.candidates, base, &active, GATE, self.step, self.settings.seed)
    }

    /// Best log Bayes factor of a search on data simulated from `base`.
    fn null(
        &self,
        round: usize,
        k: usize,
        base: &Fit,
        found: &[usize],
    ) -> Result<f64, CriticismError> {
        let mut rng = ChaCha8Rng::seed_from_u64(self.settings.seed);
        rng.set_stream((1 << 34) + ((round as u64) << 20) + k as u64);
        let cells = simulate(&self.engine, base, &mut rng);
        let mut simulated = engine(self.case, &self.on, &self.candidates, self.unit.as_ref())?;
        let ids: Vec<_> = simulated.rows.iter().map(|row| row.id).collect();
        for (id, cells) in ids.into_iter().zip(&cells) {
            simulated.model.set_observed(id, cells);
        }
        let active = self.active(found);
        let Some((fit, _)) = optimise(&simulated, &active, base, Free::Spread, self.step) else {
            return Ok(f64::INFINITY); // counts against a claim
        };
        let tried = self.search(&simulated, &fit, found);
        Ok(tried.iter().map(|t| t.log_bf).fold(f64::NEG_INFINITY, f64::max))
    }
}
