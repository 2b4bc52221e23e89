//! The whole search: base fit, candidates, null searches, what is claimed and what cannot be told.

use super::candidates::{Candidate, Maker, Unusable, covariates};
use super::checks::{Warning, check, copies};
use super::claim::Claim;
use super::engine::{Engine, Outer, Term};
use super::error::CriticismError;
use super::fine::finer_fields;
use super::fit::Fit;
use super::judge::CLAIM;
use super::leave::Left;
use super::observable::{observables, step_of};
use super::outer::{Free, optimise, score};
use super::screen::field_sd;
use super::search::{Tried, search};
use super::units::{Unit, by_site, random_unit};
use crate::manifold::Basis;
use crate::model::{Declare, Form, Model};
use crate::table::Measurements;

/// p-value of the screen up to which a candidate is fitted.
const GATE: f64 = 0.05;
/// What a form with more coefficients must gain in log Bayes factor.
const SIMPLER: f64 = 1.0;

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
    /// Its form when it was tried.
    pub form: Option<Form>,
    /// p-value of the screen.
    pub p_screen: f64,
    /// Log Bayes factor; −∞ if the screen stopped it.
    pub log_bf: f64,
    /// Share of null searches whose best candidate did as well; `None` in a round without them.
    pub p_null: Option<f64>,
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
    /// Place in `tried` of what is claimed.
    pub taken: Option<usize>,
    /// Its effects: candidates, as they are claimed.
    pub claimed: Vec<usize>,
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
    /// What is claimed, in order: names of causes, of which one may have several effects.
    pub fn findings(&self) -> Vec<&str> {
        let mut names: Vec<&str> =
            self.found.iter().map(|f| self.candidates[*f].name.as_str()).collect();
        names.dedup();
        names
    }

    /// Whether sites differ by more than the model with its findings says.
    pub fn is_unexplained(&self) -> bool {
        self.site_log_bf > CLAIM || self.unit_log_bf.as_ref().is_some_and(|(_, bf)| *bf > CLAIM)
    }
}

/// Lays a case out for Laplace fits, with these candidates to try and, last, the random effect of `unit`.
pub(super) fn engine(
    case: &Case<'_>,
    on: &[String],
    terms: &[Candidate],
    unit: Option<&Unit>,
) -> Result<Engine, CriticismError> {
    let outline = Model::outline(case.model)?;
    let fields = outline.field_names().into_iter().map(String::from);
    let offsets_on: Vec<String> = on.iter().cloned().chain(fields).collect();
    let model = Model::with_offsets(case.model, case.basis, case.table, &offsets_on)?;
    let terms = terms.iter().map(|candidate| {
        let design = |form: &Form| form.design(case.table);
        let (design, n) = candidate.form.as_ref().map_or((vec![], 0), design);
        Term { on: candidate.on.clone(), design, n, sd: Some(candidate.sd) }
    });
    let unit =
        unit.map(|unit| Term { on: on.to_vec(), design: unit.design(), n: unit.n, sd: None });
    let terms = terms.chain(unit).collect();
    // copies make errors look small, so that whatever sites differ by looks like a cause
    let copies = copies(case.table, &covariates(&model, case.table));
    Ok(Engine::new(model, on, &by_site(case.table).group, &copies, terms))
}

/// The base fit, before anything is tried: from the model's own start, noise at a third of a step. Sites that
/// differ can be explained by smooth fields and random effects or by rough fields; the better of both counts.
fn base_fit(engine: &Engine, unit: Option<&Unit>, step: f64) -> Result<Fit, CriticismError> {
    let initial = engine.model.initial();
    let active: &[usize] = if unit.is_some() { &[0] } else { &[] };
    let third = (step / 3.0).ln();
    let from = |site: f64| {
        let outer = Outer {
            other: engine.split.other.iter().map(|u| initial[*u]).collect(),
            ln_site: (site * step).ln(),
            ln_noise: third,
            ln_unit: unit.map(|_| third),
            outliers: None,
        };
        let start = engine.fit(&outer, active, None)?;
        optimise(engine, active, &start, Free::All, step)
    };
    let fits = [1.0 / 3.0, 0.1].into_iter().filter_map(from);
    let best = fits.max_by(|a, b| a.1.total_cmp(&b.1));
    best.map(|(fit, _)| fit).ok_or(CriticismError::NoFit)
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
    let mut laid = engine(case, &on, &candidates, unit.as_ref())?;
    let n_sites = laid.sites.len();
    let mut finer = vec![];
    for terms in finer_fields(&plain.model, case.basis, case.table, n_sites, &maker.field_sd) {
        let first = laid.terms.len();
        laid.terms.extend(terms);
        finer.push((first..laid.terms.len()).collect());
    }
    let run = Run { case, settings, on, candidates, engine: laid, finer, step, unit };
    start.active = run.active(&[]);
    run.rounds(start, (unusable, warnings), watch)
}

/// A search under way.
pub(super) struct Run<'a> {
    pub(super) case: &'a Case<'a>,
    pub(super) settings: &'a Settings,
    pub(super) on: Vec<String>,
    pub(super) candidates: Vec<Candidate>,
    pub(super) engine: Engine,
    /// Terms of finer fields, once for each size.
    pub(super) finer: Vec<Vec<usize>>,
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
        mut self,
        start: Fit,
        (unusable, warnings): (Vec<Unusable>, Vec<Warning>),
        watch: &(dyn Fn(usize, usize) + Sync),
    ) -> Result<Outcome, CriticismError> {
        let (mut rounds, mut found, mut ambiguous): (Vec<Round>, Vec<usize>, Vec<[String; 2]>) =
            (vec![], vec![], vec![]);
        let mut base = start;
        while rounds.len() < self.settings.rounds + 1 {
            let tried;
            (base, tried) = self.searched(&self.engine, base, &found);
            let nulls = self.nulls(rounds.len(), &tried, &base, &found, watch)?;
            let (round, taken, rivals) = self.judge(rounds.len(), (tried, nulls), &base, &found);
            rounds.push(round);
            ambiguous.extend(rivals);
            let Some(Claim { effects, fit }) = taken else { break };
            found.extend(effects);
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

    /// A search on the rows of `engine`, measured or simulated: every candidate, best first, and the base that
    /// they are compared with: a better one, if a candidate's fit leads to it.
    pub(super) fn searched(
        &self,
        engine: &Engine,
        mut base: Fit,
        found: &[usize],
    ) -> (Fit, Vec<Tried>) {
        let (active, seed) = (self.active(found), self.settings.seed);
        loop {
            let mut tried = search(engine, &self.candidates, &base, &active, GATE, self.step, seed);
            self.refine(engine, &mut tried, &base);
            self.simplest_first(&mut tried);
            let better = self.better_base(engine, &tried, &base, &active);
            let Some(better) = better else { return (base, tried) };
            base = better;
        }
    }

    /// The base fit from where the best candidate has led, if that is better.
    fn better_base(
        &self,
        engine: &Engine,
        tried: &[Tried],
        base: &Fit,
        active: &[usize],
    ) -> Option<Fit> {
        let best = tried.first().filter(|t| t.log_bf > 1.0)?.fit.as_ref()?;
        let outer = Outer { outliers: base.outer.outliers, ..best.outer.clone() };
        let start = engine.fit(&outer, active, Some(base))?;
        let (fit, score_there) = optimise(engine, active, &start, Free::All, self.step)?;
        (score_there > score(base, self.step) + 0.5).then_some(fit)
    }

    /// Fits the best form of each of the best causes again with the model's own unknowns free, as the base is:
    /// its fields have taken up what they could of a cause that a candidate may now take over.
    fn refine(&self, engine: &Engine, tried: &mut [Tried], base: &Fit) {
        tried.sort_by(|a, b| b.log_bf.total_cmp(&a.log_bf));
        let best = tried.first().map_or(0.0, |t| t.log_bf);
        let least = (best - CLAIM).min(0.5 * best).max(0.0);
        let reference = score(base, self.step);
        let mut names: Vec<&String> = vec![];
        for t in tried.iter_mut().take_while(|t| t.log_bf > least) {
            let name = &self.candidates[t.candidate].name;
            if names.contains(&name) {
                continue;
            }
            names.push(name);
            let refined = t
                .fit
                .as_ref()
                .and_then(|fit| optimise(engine, &fit.active, fit, Free::All, self.step));
            if let Some((fit, score)) = refined.filter(|(_, s)| s - reference > t.log_bf) {
                (t.log_bf, t.fit) = (score - reference, Some(fit));
            }
        }
    }

    /// Sorts candidates, best first; before the best of all, though, a simpler form of the same cause that
    /// is hardly worse.
    fn simplest_first(&self, tried: &mut [Tried]) {
        tried.sort_by(|a, b| b.log_bf.total_cmp(&a.log_bf));
        let Some(best) = tried.first().map(|t| (t.candidate, t.log_bf)) else { return };
        let name = |candidate: usize| &self.candidates[candidate].name;
        let is_near = |t: &Tried| name(t.candidate) == name(best.0) && t.log_bf > best.1 - SIMPLER;
        let near = (0..tried.len()).filter(|t| is_near(&tried[*t]));
        if let Some(simplest) = near.min_by_key(|t| self.engine.terms[tried[*t].candidate].n) {
            tried[..=simplest].rotate_right(1);
        }
    }
}
