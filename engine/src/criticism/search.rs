//! One search: what the base fit leaves over, screened against every covariate, and each candidate's
//! evidence.

use super::bench::Bench;
use super::candidate::{Candidate, Level, Screen};
use super::cause::Cause;
use super::engine::{Engine, Outer};
use super::fit::LaplaceFit;
use super::judgement::CLAIM;
use super::leave::residuals;
use super::outer::{Free, optimise, score};
use super::screen::{f_test, of_sites, of_units};

/// p-value of the screen up to which a candidate is fitted.
const GATE: f64 = 0.05;
/// That of scatter, part of which the fit has taken for what sites differ by.
const GATE_OF_SCATTER: f64 = 0.2;
/// What a form with more coefficients must gain in log Bayes factor. An effect that differs by region must gain
/// [`CLAIM`]: at seed 304 of force (`tests/loop_rates.rs`), which acts alike everywhere, it gained 1.9 on the curve.
const SIMPLER: f64 = 1.0;
/// Shares of outlying measurements that are tried, and the sds of their further error in steps.
const OUTLYING_SHARES: [f64; 2] = [0.05, 0.15];
const OUTLYING_STEPS: [f64; 2] = [2.0, 5.0];
/// Coefficients of scatter that are tried for a number, per standard deviation, and for each label alone: ln of the
/// factor by which errors are larger.
const SCATTER_OF_NUMBER: [f64; 4] = [-1.0, -0.5, 0.5, 1.0];
const SCATTER_OF_LABEL: [f64; 2] = [1.0, 2.0];
/// Causes of which every two are tried together, the best.
const PAIRED: usize = 3;
/// What a pair must explain more than a single cause to count as much: it is chosen among more.
const PRICE_OF_PAIR: f64 = CLAIM;
/// What scatter must explain more: it moves no prediction, so that no site left out speaks against a wrong column. Without
/// it two of 20 studies of nothing (seeds 501 to 520) ended in a claim, with 4.4 and 4.9.
const PRICE_OF_SCATTER: f64 = CLAIM;
/// Outliers or scatter that start so far below the base are not fitted further.
const HOPELESS: f64 = 5.0;

/// A candidate's evidence.
#[derive(Clone, Debug)]
pub(super) struct Tried {
    /// Number of the candidate.
    pub(super) candidate: usize,
    /// p-value of the screen; 1 for what is not screened.
    pub(super) p_screen: f64,
    /// Log Bayes factor against the base, less [`Self::price`]; −∞ where the screen stopped it.
    pub(super) log_bf: f64,
    /// What is taken off: for the choice of the best among several fits, and for [`PRICE_OF_SCATTER`].
    pub(super) price: f64,
    /// Its fit.
    pub(super) fit: Option<LaplaceFit>,
}

/// Two causes that hide each other: each alone leaves the other's effect over, which makes sites differ so much
/// that neither stands out.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pair {
    /// Numbers of the candidates, the one with more evidence alone first.
    pub(super) candidates: [usize; 2],
    /// Log Bayes factor of both against the base, less the price of a pair.
    pub(super) log_bf: f64,
}

/// What a search came to.
#[derive(Clone, Debug)]
pub(super) struct Searched {
    /// The fit that the candidates are compared with.
    pub(super) base: LaplaceFit,
    /// Every candidate, best first.
    pub(super) tried: Vec<Tried>,
    /// The best pair.
    pub(super) pair: Option<Pair>,
}

impl Searched {
    /// The most evidence of a candidate or a pair.
    pub(super) fn best(&self) -> f64 {
        let single = self.tried.iter().map(|t| t.log_bf).fold(f64::NEG_INFINITY, f64::max);
        self.pair.map_or(single, |pair| single.max(pair.log_bf))
    }
}

/// Searches the rows of `engine`, measured or simulated. The base of what it finds is `base`, or a better one
/// if a candidate's fit leads to it; `found` are candidates that are in both.
pub(super) fn search(
    bench: &Bench<'_>,
    engine: &Engine,
    base: LaplaceFit,
    found: &[usize],
) -> Searched {
    let mut pass = Pass { bench, engine, active: bench.active(found), base };
    loop {
        let mut tried = pass.scored();
        pass.refine(&mut tried);
        let pair = pass.paired(&tried);
        pass.simplest_first(&mut tried);
        match pass.better_base(&tried) {
            Some(better) => pass.base = better,
            None => return Searched { base: pass.base, tried, pair },
        }
    }
}

/// One pass over all candidates.
struct Pass<'s> {
    bench: &'s Bench<'s>,
    engine: &'s Engine,
    /// Terms of the base.
    active: Vec<usize>,
    base: LaplaceFit,
}

impl Pass<'_> {
    /// Scores every candidate whose cause is not in the base already.
    fn scored(&self) -> Vec<Tried> {
        let mut residual = residuals(self.engine, &self.base, self.bench.seed);
        let sites = of_sites(self.engine, &residual);
        for r in &mut residual {
            *r = r.abs();
        }
        let scatter = of_sites(self.engine, &residual);
        let units = of_units(self.engine, &self.base);
        let candidates = &self.bench.candidates;
        let is_new = |c: &usize| {
            let mut taken = self.active.iter().filter_map(|a| candidates.get(*a));
            taken.all(|taken| taken.cause != candidates[*c].cause)
        };
        let one = |candidate: usize| {
            let screen = candidates[candidate].screen;
            let p_screen = match screen {
                Screen::Sites => f_test(self.engine, &sites, candidate),
                Screen::Scatter => f_test(self.engine, &scatter, candidate),
                Screen::Units => f_test(self.engine, &units, candidate),
                Screen::None => 1.0,
            };
            let log_bf = f64::NEG_INFINITY;
            let tried = Tried { candidate, p_screen, log_bf, price: 0.0, fit: None };
            let gate = if screen == Screen::Scatter { GATE_OF_SCATTER } else { GATE };
            if screen != Screen::None && p_screen > gate { tried } else { self.fitted(tried) }
        };
        (0..candidates.len()).filter(is_new).map(one).collect()
    }

    /// The candidate with its fit and its score against the base.
    fn fitted(&self, tried: Tried) -> Tried {
        let Self { engine, base, .. } = self;
        let step = self.bench.step;
        let Candidate { level, screen, .. } = self.bench.candidates[tried.candidate];
        let reference = score(base, step);
        let active = self.bench.and(&self.active, tried.candidate);
        if level == Level::Noise {
            let is_scatter = self.bench.candidates[tried.candidate].is_scatter();
            let scattered = || self.with_scatter(&active, tried.candidate);
            let found = if is_scatter { scattered() } else { self.with_outliers(&active) };
            let Some((fit, price)) = found else { return tried };
            let log_bf = score(&fit, step) - reference - price;
            return Tried { log_bf, price, fit: Some(fit), ..tried };
        }
        let Some(fit) = engine.fit(&base.outer, &active, Some(base)) else { return tried };
        let log_bf = score(&fit, step) - reference;
        // what varies over units gains only once it has taken the place of their random effect
        if (log_bf > 0.0 || screen == Screen::Units)
            && let Some((best, score)) = optimise(engine, &active, &fit, Free::Spread, step)
            && score - reference > log_bf
        {
            return Tried { log_bf: score - reference, fit: Some(best), ..tried };
        }
        Tried { log_bf, fit: Some(fit), ..tried }
    }

    /// The fit with outliers, and what is taken off its score for being the best of those tried.
    fn with_outliers(&self, active: &[usize]) -> Option<(LaplaceFit, f64)> {
        let tried = self.not_hopeless(active, self.outlying())?;
        let best = tried.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
        let price = best.1 - mean_evidence(&tried, tried.len());
        let (fit, _) = optimise(self.engine, active, &best.0, Free::Spread, self.bench.step)?;
        Some((fit, price))
    }

    /// The fit with scatter, and what is taken off its score. Which coefficient is best is seen once the model's
    /// own unknowns are free: with all errors alike its fields have followed the measurements that scatter. So those
    /// of the sign, and label, of the best one are fitted again.
    fn with_scatter(&self, active: &[usize], candidate: usize) -> Option<(LaplaceFit, f64)> {
        let Self { engine, bench, .. } = self;
        let outers = self.scattering(candidate);
        let n = outers.len();
        let tried = self.not_hopeless(active, outers)?;
        let best = tried.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
        let signs = |fit: &LaplaceFit| {
            let own = fit.outer.scatter.last();
            own.map(|own| own.iter().map(|c| c.partial_cmp(&0.0)).collect::<Vec<_>>())
        };
        let alike = tried.iter().filter(|one| signs(&one.0) == signs(&best.0));
        let free = alike.filter_map(|one| optimise(engine, active, &one.0, Free::All, bench.step));
        let free: Vec<(LaplaceFit, f64)> = free.collect();
        let mean = mean_evidence(&free, n);
        let (fit, score) = free.into_iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
        Some((fit, score - mean + PRICE_OF_SCATTER))
    }

    /// Fits at these outer values with their scores, unless all are so far below the base that the sds of sites and
    /// noise would not bring them above it.
    fn not_hopeless(&self, active: &[usize], outers: Vec<Outer>) -> Option<Vec<(LaplaceFit, f64)>> {
        let (Self { engine, base, .. }, step) = (self, self.bench.step);
        let one = |outer| {
            let fit = engine.fit(&outer, active, Some(base))?;
            let score = score(&fit, step);
            Some((fit, score))
        };
        let tried: Vec<(LaplaceFit, f64)> = outers.into_iter().map(one).collect::<Option<_>>()?;
        let is_near = |tried: &(LaplaceFit, f64)| tried.1 >= score(base, step) - HOPELESS;
        tried.iter().any(is_near).then_some(tried)
    }

    /// The base with each share and size of outliers.
    fn outlying(&self) -> Vec<Outer> {
        let (mut outer, step) = (self.base.outer.clone(), self.bench.step);
        // what is outlying has made the others' error look large
        outer.ln_noise = outer.ln_noise.min((step / 3.0).ln());
        let all =
            OUTLYING_SHARES.iter().flat_map(|share| OUTLYING_STEPS.map(|size| (*share, size)));
        all.map(|(share, size)| Outer { outliers: Some((share, size * step)), ..outer.clone() })
            .collect()
    }

    /// The base with each coefficient of scatter; the mean variance of errors stays what it is.
    fn scattering(&self, candidate: usize) -> Vec<Outer> {
        let Self { engine, base, .. } = self;
        let n = engine.terms[candidate].n;
        let coefficients: &[f64] = if n == 1 { &SCATTER_OF_NUMBER } else { &SCATTER_OF_LABEL };
        let all = (0..n).flat_map(|k| coefficients.iter().map(move |c| (k, *c)));
        let one = |(k, coefficient): (usize, f64)| {
            let factor =
                |row| (2.0 * coefficient * engine.design(&engine.terms[candidate], row)[k]).exp();
            let rows = engine.rows.len();
            let mean = (0..rows).map(factor).sum::<f64>() / rows as f64;
            let mut own = vec![0.0; n];
            own[k] = coefficient;
            let mut outer = base.outer.clone();
            outer.ln_noise -= 0.5 * mean.ln();
            outer.scatter.push(own);
            outer
        };
        all.map(one).collect()
    }

    /// The best two causes together. A patch has too many thresholds to be one of them, and scatter moves nothing.
    fn paired(&self, tried: &[Tried]) -> Option<Pair> {
        let candidate = |t: &Tried| &self.bench.candidates[t.candidate];
        let mut best: Vec<&Tried> = vec![];
        for t in tried.iter().filter(|t| t.fit.is_some()) {
            let is_new = best.iter().all(|other| candidate(other).cause != candidate(t).cause);
            let is_effect = candidate(t).level != Level::Noise && candidate(t).edge().is_none();
            if is_new && is_effect && best.len() < PAIRED {
                best.push(t);
            }
        }
        let pairs = (1..best.len()).flat_map(|b| (0..b).map(move |a| (a, b)));
        let scored = pairs.filter_map(|(a, b)| self.pair(best[a], best[b]));
        scored.max_by(|a, b| a.log_bf.total_cmp(&b.log_bf))
    }

    /// Two candidates in one fit, if both at the spread of one alone explain more than this one.
    fn pair(&self, one: &Tried, other: &Tried) -> Option<Pair> {
        let (Self { engine, base, .. }, step) = (self, self.bench.step);
        let fit = one.fit.as_ref()?;
        let active = self.bench.and(&fit.active, other.candidate);
        let both = engine.fit(&fit.outer, &active, Some(fit))?;
        if score(&both, step) - score(base, step) <= one.log_bf {
            return None;
        }
        let (_, both) = optimise(engine, &active, &both, Free::Spread, step)?;
        let log_bf = both - score(base, step) - PRICE_OF_PAIR;
        Some(Pair { candidates: [one.candidate, other.candidate], log_bf })
    }

    /// Fits the best form of each of the best causes again with the model's own unknowns free, as the base is:
    /// its fields have taken up what they could of a cause that a candidate may now take over.
    fn refine(&self, tried: &mut [Tried]) {
        tried.sort_by(|a, b| b.log_bf.total_cmp(&a.log_bf));
        let best = tried.first().map_or(0.0, |t| t.log_bf);
        let least = (best - CLAIM).min(0.5 * best).max(0.0);
        let reference = score(&self.base, self.bench.step);
        let mut causes: Vec<&Cause> = vec![];
        for t in tried.iter_mut().take_while(|t| t.log_bf > least) {
            let cause = &self.bench.candidates[t.candidate].cause;
            if causes.contains(&cause) {
                continue;
            }
            causes.push(cause);
            let refined = t.fit.as_ref().and_then(|fit| {
                optimise(self.engine, &fit.active, fit, Free::All, self.bench.step)
            });
            let log_bf = |score: f64| score - reference - t.price;
            if let Some((fit, score)) = refined.filter(|(_, s)| log_bf(*s) > t.log_bf) {
                (t.log_bf, t.fit) = (log_bf(score), Some(fit));
            }
        }
    }

    /// Sorts candidates, best first; before the best of all, though, a simpler form of the same cause that
    /// is hardly worse.
    fn simplest_first(&self, tried: &mut [Tried]) {
        tried.sort_by(|a, b| b.log_bf.total_cmp(&a.log_bf));
        let Some(best) = tried.first().map(|t| (t.candidate, t.log_bf)) else { return };
        let cause = |candidate: usize| &self.bench.candidates[candidate].cause;
        let form = self.bench.candidates[best.0].form.as_ref();
        let is_by_region =
            form.is_some_and(|form| form.column().is_some() && form.also_requires().is_some());
        let least = best.1 - if is_by_region { CLAIM } else { SIMPLER };
        let is_near = |t: &Tried| cause(t.candidate) == cause(best.0) && t.log_bf > least;
        let near = (0..tried.len()).filter(|t| is_near(&tried[*t]));
        if let Some(simplest) = near.min_by_key(|t| self.bench.engine.terms[tried[*t].candidate].n)
        {
            tried[..=simplest].rotate_right(1);
        }
    }

    /// The base fit from where the best candidate has led, if that is better.
    fn better_base(&self, tried: &[Tried]) -> Option<LaplaceFit> {
        let (Self { engine, active, base, .. }, step) = (self, self.bench.step);
        let best = tried.first().filter(|t| t.log_bf > 1.0)?.fit.as_ref()?;
        let Outer { outliers, scatter, .. } = base.outer.clone();
        let outer = Outer { outliers, scatter, ..best.outer.clone() };
        let start = engine.fit(&outer, active, Some(base))?;
        let (fit, score_there) = optimise(engine, active, &start, Free::All, step)?;
        (score_there > score(base, step) + 0.5).then_some(fit)
    }
}

/// ln of the mean evidence of `n` fits, of which those that are not here have next to none.
fn mean_evidence(fits: &[(LaplaceFit, f64)], n: usize) -> f64 {
    let most = fits.iter().map(|fit| fit.1).fold(f64::NEG_INFINITY, f64::max);
    let total = fits.iter().map(|fit| (fit.1 - most).exp()).sum::<f64>();
    most + (total / n as f64).ln()
}
