//! The whole search: base fit, candidates, null searches, what is claimed and what cannot be told.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::candidates::{Candidate, Unusable, candidates, covariates};
use super::engine::{Engine, Outer, Term};
use super::error::CriticismError;
use super::fit::Fit;
use super::observable::{observables, step_of};
use super::outer::{Free, optimise, score};
use super::search::{Left, Tried, field_sd, leave_sites_out, leave_units_out, search, simulate};
use super::units::{LEAST_UNITS, Unit, by_site, random_unit, unit_of};
use crate::dsl::{Declare, Measurements, Model};
use crate::manifold::Basis;

/// Least log Bayes factor of a claim.
const CLAIM: f64 = 3.0;
/// A runner-up within this log Bayes factor is a rival.
const RIVAL: f64 = 2.0;
/// A winner that adds less than this with its rival in the model is not told apart from it.
const ADDS: f64 = 1.0;
/// R² on the fitted fields' span beyond which a covariate could be the fields' own.
const SPAN: f64 = 0.8;
/// Share of null searches that the best candidate must beat.
const LEVEL: f64 = 0.05;
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
    let unit = random_unit(case.table, covariates(&outline, case.table).into_iter());
    let plain = engine(case, &on, &[], unit.as_ref())?;
    let step = step_of(&plain.model);
    let mut start = base_fit(&plain, unit.as_ref(), step)?;
    let slopes = field_sd(&plain, &start, step);
    let (candidates, unusable) =
        candidates(&plain.model, case.table, &on, step, &slopes, unit.as_ref());
    let laid = engine(case, &on, &candidates, unit.as_ref())?;
    let run = Run { case, settings, on, candidates, engine: laid, step, unit };
    start.active = run.active(&[]);
    run.rounds(start, unusable, watch)
}

struct Run<'a> {
    case: &'a Case<'a>,
    settings: &'a Settings,
    on: Vec<String>,
    candidates: Vec<Candidate>,
    engine: Engine,
    step: f64,
    /// The unit with a random effect.
    unit: Option<Unit>,
}

impl Run<'_> {
    /// The terms of a fit: the random effect of units, which is always there, and these.
    fn active(&self, candidates: &[usize]) -> Vec<usize> {
        let unit = self.unit.iter().map(|_| self.candidates.len());
        unit.chain(candidates.iter().copied()).collect()
    }

    fn rounds(
        self,
        start: Fit,
        unusable: Vec<Unusable>,
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

    /// What the round's best candidate is: a finding, ambiguous, or nothing.
    #[allow(clippy::type_complexity, reason = "what a round comes to, used once")]
    fn judge(
        &self,
        (tried, nulls): (Vec<Tried>, Vec<f64>),
        base: &Fit,
        found: &[usize],
    ) -> (Round, Option<(usize, Fit)>, Vec<[String; 2]>) {
        let left = leave_sites_out(&self.engine, base, self.settings.seed);
        let p_null = |log_bf: f64| {
            let above = nulls.iter().filter(|n| **n >= log_bf).count();
            (1 + above) as f64 / (1 + nulls.len()) as f64
        };
        let mut records: Vec<Record> = tried
            .iter()
            .map(|t| Record {
                candidate: t.candidate,
                p_screen: t.p_screen,
                log_bf: t.log_bf,
                p_null: p_null(t.log_bf),
                verdict: if t.fit.is_some() {
                    "less evidence".into()
                } else {
                    "screened out".into()
                },
            })
            .collect();
        let (mut taken, mut rivals) = (None, vec![]);
        if let Some((best, fit)) = tried.first().and_then(|t| Some((t, t.fit.clone()?))) {
            let p = p_null(best.log_bf);
            if let Some(why) = self.objection(best, &fit, p, &left) {
                records[0].verdict = why;
            } else {
                rivals = self.rivals(&tried, base, found);
                if rivals.is_empty() {
                    records[0].verdict = "found".into();
                    taken = Some((best.candidate, fit));
                } else {
                    let names: Vec<&str> = rivals.iter().map(|pair| pair[1].as_str()).collect();
                    records[0].verdict = format!("not told apart from {}", names.join(", "));
                }
            }
        }
        (Round { tried: records, nulls, base: base.clone(), left }, taken, rivals)
    }

    /// Why the best candidate is no finding, if it is none.
    fn objection(&self, best: &Tried, fit: &Fit, p_null: f64, left: &Left) -> Option<String> {
        if best.log_bf <= CLAIM {
            return Some(format!(
                "log Bayes factor {:.1}, more than {CLAIM} is asked",
                best.log_bf
            ));
        }
        if p_null > LEVEL {
            return Some(format!(
                "{:.0} % of searches on simulated data did as well",
                100.0 * p_null
            ));
        }
        let column = self.candidates[best.candidate].form.column();
        let unit = self.left_out(column);
        if unit.is_none() || unit != self.unit {
            // what units share is known from a unit's other sites: these tell nothing of what varies over units
            let with = leave_sites_out(&self.engine, fit, self.settings.seed);
            let (gain, se) = gain(&left.elpd, &with.elpd);
            if !(gain > se) {
                return Some(format!(
                    "leave-one-site-out gain {gain:.1} is not beyond its error {se:.1}"
                ));
            }
        }
        let unit = unit?;
        if unit.n < LEAST_UNITS {
            return Some(format!("not confirmable: it varies only over {} {}s", unit.n, unit.name));
        }
        let left = |fit: &Fit| leave_units_out(&self.engine, fit, &unit, self.settings.seed);
        let (gain, se) = gain(&left(&self.without(fit)?)?.elpd, &left(fit)?.elpd);
        let least = if Some(&unit) == self.unit.as_ref() { se } else { 0.0 };
        (!(gain > least)).then(|| {
            format!(
                "leaving {}s out as a whole, predictions do not improve ({gain:.1} ± {se:.1})",
                unit.name
            )
        })
    }

    /// What is left out as a whole to confirm an effect of `column`, or of none; `None` for the site.
    fn left_out(&self, column: Option<&str>) -> Option<Unit> {
        let table = self.case.table;
        let unit = Some(unit_of(table, column)).filter(|unit| *unit != by_site(table));
        if column.is_some() { unit } else { unit.or_else(|| self.unit.clone()) }
    }

    /// The fit without its last term.
    fn without(&self, fit: &Fit) -> Option<Fit> {
        let active = &fit.active[..fit.active.len() - 1];
        let start = self.engine.fit(&fit.outer, active, Some(fit))?;
        optimise(&self.engine, active, &start, Free::Spread, self.step).map(|(fit, _)| fit)
    }

    /// Causes that the best candidate cannot be told apart from.
    fn rivals(&self, tried: &[Tried], base: &Fit, found: &[usize]) -> Vec<[String; 2]> {
        let best = &tried[0];
        let name = |t: &Tried| self.candidates[t.candidate].name.clone();
        let mut pairs: Vec<[String; 2]> = vec![];
        let reference = score(base, self.step);
        for other in tried[1..].iter().filter(|t| name(t) != name(best) && t.log_bf > ADDS) {
            let both = self.active(&[found, &[other.candidate, best.candidate]].concat());
            let with_both = other.fit.as_ref().and_then(|fit| {
                let start = self.engine.fit(&fit.outer, &both, Some(fit))?;
                optimise(&self.engine, &both, &start, Free::Spread, self.step)
            });
            let adds = with_both.map_or(0.0, |(_, both)| both - reference - other.log_bf);
            // two causes that both add much with the other in the model are two effects
            let is_near = best.log_bf - other.log_bf < RIVAL;
            let is_rival = adds < ADDS || (is_near && adds < CLAIM);
            if is_rival && !pairs.iter().any(|pair| pair[1] == name(other)) {
                pairs.push([name(best), name(other)]);
            }
        }
        let r2 = super::search::r_squared_on_fields(&self.engine, base, best.candidate, self.step);
        if r2 > SPAN {
            pairs.push([name(best), "spatial_field".into()]);
        }
        pairs
    }

    /// Log Bayes factor of the sites' random effect.
    fn site_evidence(&self, fit: &Fit) -> f64 {
        let without = super::outer::without_sites(&self.engine, &fit.active, fit, self.step);
        score(fit, self.step) - without
    }

    /// Log Bayes factor of the units' random effect.
    fn unit_evidence(&self, fit: &Fit, found: &[usize]) -> f64 {
        let outer = Outer { ln_unit: None, ..fit.outer.clone() };
        let start = self.engine.fit(&outer, found, None);
        let without =
            start.and_then(|start| optimise(&self.engine, found, &start, Free::Spread, self.step));
        score(fit, self.step) - without.map_or(f64::NEG_INFINITY, |(_, score)| score)
    }
}

/// Sum of the differences of two vectors, and its standard error.
pub(super) fn gain(before: &[f64], after: &[f64]) -> (f64, f64) {
    let d: Vec<f64> = after.iter().zip(before).map(|(a, b)| a - b).collect();
    let n = d.len() as f64;
    let mean = d.iter().sum::<f64>() / n;
    let variance = d.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (n * mean, (n * variance).sqrt())
}
