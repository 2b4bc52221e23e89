//! The whole search: base fit, candidates, null searches, what is claimed and what cannot be told.

use super::bench::{Bench, Start, Subject};
use super::candidate::{Candidate, Unusable};
use super::cause::Cause;
use super::checks::Warning;
use super::claim::Claim;
use super::engine::Engine;
use super::error::CriticismError;
use super::fit::LaplaceFit;
use super::judge::Judge;
use super::judgement::{CLAIM, Judgement, Round, UNEXPLAINED, least_log_bf};
use super::nulls::Nulls;
use super::outer::Free;
use super::progress::{Remembered, Watch};
use super::search::search;
use super::units::Unit;

/// How to search.
#[derive(Clone, Copy, Debug)]
pub struct SearchSettings {
    /// Null searches per round.
    pub nulls: usize,
    /// Most effects that are added.
    pub rounds: usize,
    /// Seed of every random stream.
    pub seed: u64,
}

impl Default for SearchSettings {
    fn default() -> Self {
        Self { nulls: 99, rounds: 3, seed: 1 }
    }
}

/// What a search came to.
#[derive(Debug)]
pub struct Criticism {
    /// Everything that could be tried; what is claimed, as it is claimed.
    pub candidates: Vec<Candidate>,
    /// Columns that could not.
    pub unusable: Vec<Unusable>,
    /// Doubts about the table.
    pub warnings: Vec<Warning>,
    /// The model laid out with all candidates.
    pub engine: Engine,
    /// The rounds, at least one.
    pub rounds: Vec<Round>,
    /// Log Bayes factor of the sites' random effect after everything that was found.
    pub site_log_bf: f64,
    /// That of fields with [`FINER`](super::FINER) times as many modes, if the surface has them.
    pub finer_log_bf: Option<f64>,
    /// That of the units' (recordings, sessions), where they have one, and the column that names them.
    pub unit_log_bf: Option<(String, f64)>,
    /// What is left out as a whole, where that is not the site.
    pub unit: Option<Unit>,
    /// The fit with everything that was found.
    pub last: LaplaceFit,
    /// Width of a protocol step, in the unit of the measurement.
    pub step: f64,
}

impl Criticism {
    /// Candidates that are claimed, in order. A cause may have several.
    pub fn found(&self) -> Vec<usize> {
        found(&self.rounds)
    }

    /// Scatter that is claimed: the candidate and its coefficients, ln of the factor by which errors are larger.
    pub fn scatter(&self) -> Vec<(&Candidate, &[f64])> {
        let found = self.found().into_iter().map(|f| &self.candidates[f]);
        let scatter = self.last.outer.scatter.iter().map(Vec::as_slice);
        found.filter(|candidate| candidate.is_scatter()).zip(scatter).collect()
    }

    /// The causes that are claimed, in order.
    pub fn findings(&self) -> Vec<&Cause> {
        let mut causes: Vec<&Cause> =
            self.found().iter().map(|f| &self.candidates[*f].cause).collect();
        causes.dedup();
        causes
    }

    /// Pairs of causes that cannot be told apart.
    pub fn ambiguous(&self) -> Vec<[&Cause; 2]> {
        let mut pairs = vec![];
        for record in self.rounds.iter().flat_map(|round| &round.tried) {
            if let Judgement::NotToldApart(rivals) = &record.judgement {
                let own = &self.candidates[record.candidate].cause;
                pairs.extend(rivals.iter().map(|rival| [own, rival]));
            }
        }
        pairs
    }

    /// The fit of the model as declared.
    pub fn first(&self) -> &LaplaceFit {
        &self.rounds[0].base
    }

    /// Whether sites differ by more than the model with its findings says.
    pub fn is_unexplained(&self) -> bool {
        self.site_log_bf > UNEXPLAINED
            || self.unit_log_bf.as_ref().is_some_and(|(_, bf)| *bf > CLAIM)
    }
}

fn found(rounds: &[Round]) -> Vec<usize> {
    rounds.iter().flat_map(|round| round.claimed.iter().copied()).collect()
}

/// Runs the whole search; `watch` is told how far it is.
///
/// # Errors
/// What does not fit between model and table; a model that cannot be criticised; `watch` says to stop.
pub fn criticise(
    subject: &Subject<'_>,
    settings: &SearchSettings,
    watch: &Watch<'_>,
) -> Result<Criticism, CriticismError> {
    criticise_remembering(subject, settings, watch, &())
}

/// As [`criticise`]; searches on simulated data that are remembered are not made again.
///
/// # Errors
/// Those of [`criticise`].
pub fn criticise_remembering(
    subject: &Subject<'_>,
    settings: &SearchSettings,
    watch: &Watch<'_>,
    remembered: &dyn Remembered,
) -> Result<Criticism, CriticismError> {
    let Start { bench, base, unusable, warnings } = Start::new(subject, settings.seed)?;
    let (mut bench, mut last, mut rounds) = (bench, base, vec![]);
    loop {
        let (round, claim) = next_round(&bench, &rounds, last, settings, (watch, remembered))?;
        last = round.base.clone();
        rounds.push(round);
        let Some(claim) = claim else { break };
        bench = claim.bench;
        last = bench.optimised(&claim.fit, Free::All).map_or(claim.fit, |(fit, _)| fit);
        if rounds.len() >= settings.rounds {
            break;
        }
    }
    let found = found(&rounds);
    let unit_evidence = |unit: &Unit| (unit.name.clone(), bench.unit_evidence(&last, &found));
    Ok(Criticism {
        site_log_bf: bench.site_evidence(&last),
        finer_log_bf: bench.finer_evidence(&last),
        unit_log_bf: bench.unit.as_ref().map(unit_evidence),
        unit: bench.left_out(None),
        step: bench.step,
        candidates: bench.candidates,
        engine: bench.engine,
        unusable,
        warnings,
        rounds,
        last,
    })
}

/// A round: search, null searches, judgement.
fn next_round<'a>(
    bench: &Bench<'a>,
    rounds: &[Round],
    base: LaplaceFit,
    settings: &SearchSettings,
    (watch, remembered): (&Watch<'_>, &dyn Remembered),
) -> Result<(Round, Option<Claim<'a>>), CriticismError> {
    let (number, found) = (rounds.len(), found(rounds));
    let searched = search(bench, &bench.engine, base, &found);
    let best = searched.best();
    // a later round without enough evidence claims nothing, whatever null searches come to
    let is_idle = number > 0 && best <= least_log_bf(number);
    let n = if is_idle { 0 } else { settings.nulls };
    let nulls = Nulls { bench, round: number, n, base: &searched.base, found: &found, remembered };
    let nulls = nulls.run(watch)?;
    Ok(Judge { bench, number, searched, nulls, found: &found }.judge())
}
