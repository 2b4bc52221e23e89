//! The judgement of a round: a finding, causes that cannot be told apart, or nothing.

use super::bench::Bench;
use super::claim::Claim;
use super::fit::LaplaceFit;
use super::judgement::{Judgement, Record, Round, least_log_bf};
use super::leave::{Left, leave_sites_out};
use super::outer::Free;
use super::rivals::Duel;
use super::search::{Searched, Tried, search};
use super::units::LEAST_UNITS;

/// Share of null searches that the best candidate must beat.
const LEVEL: f64 = 0.05;

/// The search of a round with all that it is judged by.
pub(super) struct Judge<'j, 'a> {
    pub(super) bench: &'j Bench<'a>,
    /// Number of the round, from 0.
    pub(super) number: usize,
    pub(super) searched: Searched,
    /// Best log Bayes factor of each null search.
    pub(super) nulls: Vec<f64>,
    /// Candidates that earlier rounds found, which are in the base.
    pub(super) found: &'j [usize],
}

impl<'a> Judge<'_, 'a> {
    /// The round, and what it claims.
    pub(super) fn judge(self) -> (Round, Option<Claim<'a>>) {
        let left = leave_sites_out(&self.bench.engine, &self.searched.base, self.bench.seed);
        let mut tried_so_far: Vec<Record> =
            self.searched.tried.iter().map(|t| self.record(t)).collect();
        // causes that hide each other come first: each alone may be mistaken for something else
        let mut claim = self.is_pair_best().then(|| self.of_pair(&mut tried_so_far)).flatten();
        if claim.is_none() {
            claim = self.of_one(&left, &mut tried_so_far);
        }
        let is_ambiguous = |r: &Record| matches!(r.judgement, Judgement::NotToldApart(_));
        if claim.is_none() && !self.is_pair_best() && !tried_so_far.iter().any(is_ambiguous) {
            claim = self.of_pair(&mut tried_so_far);
        }
        let claimed = claim.as_ref().map_or(vec![], |claim: &Claim<'_>| claim.effects.clone());
        let Self { searched: Searched { base, pair, .. }, nulls, .. } = self;
        let pair = pair.map(|pair| (pair.candidates, pair.log_bf));
        (Round { tried: tried_so_far, pair, nulls, base, left, claimed }, claim)
    }

    /// What is claimed of a single cause. Causes are judged in the order of their evidence, until one
    /// is claimed or is not told apart from others.
    fn of_one(&self, left: &Left, records: &mut [Record]) -> Option<Claim<'a>> {
        let base = &self.searched.base;
        // another may explain more where it was fitted, and predict nothing
        for (record, best) in records.iter_mut().zip(&self.searched.tried) {
            let Some(fit) = best.fit.as_ref().filter(|_| self.is_enough(best)) else { continue };
            match self.claimed(&Duel { best, base, left }, fit) {
                Ok(claim) => {
                    record.judgement = Judgement::Found;
                    return Some(claim);
                }
                Err(why) => record.judgement = why,
            }
            if matches!(record.judgement, Judgement::NotToldApart(_)) {
                return None;
            }
        }
        None
    }

    /// Whether two causes explain more together, at the price of a pair, than the first cause does alone.
    fn is_pair_best(&self) -> bool {
        let single = self.searched.tried.first().map_or(f64::NEG_INFINITY, |tried| tried.log_bf);
        self.searched.pair.is_some_and(|pair| pair.log_bf > single)
    }

    /// What is claimed of the best pair. Each of the two must
    /// predict with the other in the model, and must have more evidence there than any further
    /// cause. Then the first is claimed. The second is left to the next round.
    fn of_pair(&self, records: &mut [Record]) -> Option<Claim<'a>> {
        let pair = self.searched.pair.filter(|pair| pair.log_bf > least_log_bf(self.number))?;
        let p_null = self.p_null(pair.log_bf).filter(|share| *share <= LEVEL)?;
        let [first, second] = pair.candidates;
        let (taken, log_bf) = self.beside(second, first)?;
        self.beside(first, second)?;
        let bench = self.bench;
        let (outer, base) = (&self.searched.base.outer, &self.searched.base);
        let active = bench.active(&[self.found, &[taken]].concat());
        let fit = bench.engine.fit(outer, &active, Some(base))?;
        let record = records.iter_mut().find(|record| record.candidate == taken)?;
        record.beside = Some(bench.candidates[second].cause.clone());
        (record.judgement, record.log_bf, record.p_null) = (Judgement::Found, log_bf, Some(p_null));
        Some(Claim { bench: bench.clone(), effects: vec![taken], fit })
    }

    /// The candidate of the cause of `own` that would be claimed if `other` were in the model, and
    /// its evidence there.
    fn beside(&self, other: usize, own: usize) -> Option<(usize, f64)> {
        let (bench, base) = (self.bench, &self.searched.base);
        let found = [self.found, &[other]].concat();
        let fit = bench.engine.fit(&base.outer, &bench.active(&found), Some(base))?;
        let (fit, _) = bench.optimised(&fit, Free::All)?;
        let searched = search(bench, &bench.engine, fit, &found);
        let best = searched.tried.first()?;
        let cause = |candidate: usize| &bench.candidates[candidate].cause;
        let is_enough = best.log_bf > least_log_bf(self.number + 1);
        let fit = best.fit.as_ref().filter(|_| is_enough && cause(best.candidate) == cause(own))?;
        let left = leave_sites_out(&bench.engine, &searched.base, bench.seed);
        let duel = Duel { best, base: &searched.base, left: &left };
        let holds = self.objection(&duel, fit).is_ok();
        let is_alone = || bench.rivals(&searched.tried, &duel).is_empty();
        (holds && is_alone()).then_some((best.candidate, best.log_bf))
    }

    fn is_enough(&self, tried: &Tried) -> bool {
        tried.log_bf > least_log_bf(self.number)
    }

    /// Share of null searches that did as well as this log Bayes factor, or better.
    fn p_null(&self, log_bf: f64) -> Option<f64> {
        let above = self.nulls.iter().filter(|n| **n >= log_bf).count();
        (!self.nulls.is_empty()).then(|| (1 + above) as f64 / (1 + self.nulls.len()) as f64)
    }

    /// The judgement of a candidate that the round does not get to.
    fn record(&self, tried: &Tried) -> Record {
        let least = least_log_bf(self.number);
        let judgement = if self.is_enough(tried) {
            Judgement::LessEvidence
        } else if tried.fit.is_some() {
            Judgement::TooLittle { log_bf: tried.log_bf, least }
        } else {
            Judgement::ScreenedOut
        };
        Record {
            candidate: tried.candidate,
            form: self.bench.candidates[tried.candidate].form.clone(),
            p_screen: tried.p_screen,
            log_bf: tried.log_bf,
            p_null: self.p_null(tried.log_bf),
            beside: None,
            judgement,
        }
    }

    /// The claim of a candidate, or why nothing is claimed.
    fn claimed(&self, duel: &Duel<'_>, fit: &LaplaceFit) -> Result<Claim<'a>, Judgement> {
        self.objection(duel, fit)?;
        let rivals = self.bench.rivals(&self.searched.tried, duel);
        if !rivals.is_empty() {
            return Err(Judgement::NotToldApart(rivals));
        }
        Claim::of(self.bench, duel.best.candidate, fit, duel.left).map_err(Judgement::Refuted)
    }

    /// Why a candidate is no finding, if it is none.
    fn objection(&self, duel: &Duel<'_>, fit: &LaplaceFit) -> Result<(), Judgement> {
        let (bench, best) = (self.bench, duel.best);
        let share = self.p_null(best.log_bf).unwrap_or(1.0);
        if share > LEVEL {
            return Err(Judgement::ByChance { share });
        }
        let unit = bench.left_out(bench.column(best.candidate));
        if let Some(unit) = unit.filter(|unit| unit.n < LEAST_UNITS) {
            return Err(Judgement::TooFewUnits { unit: unit.name, n: unit.n });
        }
        let refutation = bench.refutation(&[best.candidate], fit, duel.left);
        refutation.map_or(Ok(()), |why| Err(Judgement::Refuted(why)))
    }
}
