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
/// What a form with more coefficients must gain in log Bayes factor.
const SIMPLER: f64 = 1.0;
/// Shares of outlying measurements that are tried, and the sds of their further error in steps.
const OUTLYING_SHARES: [f64; 2] = [0.05, 0.15];
const OUTLYING_STEPS: [f64; 2] = [2.0, 5.0];
/// So far below the base, the sds of sites and noise would not bring them above it.
const HOPELESS: f64 = 5.0;

/// A candidate's evidence.
#[derive(Clone, Debug)]
pub(super) struct Tried {
    /// Number of the candidate.
    pub(super) candidate: usize,
    /// p-value of the screen; 1 for what is not screened.
    pub(super) p_screen: f64,
    /// Log Bayes factor against the base; −∞ where the screen stopped it.
    pub(super) log_bf: f64,
    /// Its fit.
    pub(super) fit: Option<LaplaceFit>,
}

/// What a search came to.
#[derive(Clone, Debug)]
pub(super) struct Searched {
    /// The fit that the candidates are compared with.
    pub(super) base: LaplaceFit,
    /// Every candidate, best first.
    pub(super) tried: Vec<Tried>,
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
        pass.simplest_first(&mut tried);
        match pass.better_base(&tried) {
            Some(better) => pass.base = better,
            None => return Searched { base: pass.base, tried },
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
        let sites = of_sites(self.engine, &residuals(self.engine, &self.base, self.bench.seed));
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
                Screen::Units => f_test(self.engine, &units, candidate),
                Screen::None => 1.0,
            };
            let tried = Tried { candidate, p_screen, log_bf: f64::NEG_INFINITY, fit: None };
            if screen != Screen::None && p_screen > GATE { tried } else { self.fitted(tried) }
        };
        (0..candidates.len()).filter(is_new).map(one).collect()
    }

    /// The candidate with its fit and its score against the base.
    fn fitted(&self, tried: Tried) -> Tried {
        let Self { engine, base, .. } = self;
        let step = self.bench.step;
        let Candidate { level, screen, .. } = self.bench.candidates[tried.candidate];
        let reference = score(base, step);
        let active = [&self.active[..], &[tried.candidate]].concat();
        if level == Level::Noise {
            let Some((fit, score)) = self.with_outliers(&active) else { return tried };
            return Tried { log_bf: score - reference, fit: Some(fit), ..tried };
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

    /// The fit with outliers, and its score averaged over their share and size.
    fn with_outliers(&self, active: &[usize]) -> Option<(LaplaceFit, f64)> {
        let (Self { engine, base, .. }, step) = (self, self.bench.step);
        let mut outer = base.outer.clone();
        // what is outlying has made the others' error look large
        outer.ln_noise = outer.ln_noise.min((step / 3.0).ln());
        let mut tried: Vec<(LaplaceFit, f64)> = vec![];
        for share in OUTLYING_SHARES {
            for size in OUTLYING_STEPS {
                outer.outliers = Some((share, size * step));
                let fit = engine.fit(&outer, active, Some(base))?;
                let score = score(&fit, step);
                tried.push((fit, score));
            }
        }
        let (best, most) = tried.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
        if *most < score(base, step) - HOPELESS {
            return None;
        }
        let total = tried.iter().map(|t| (t.1 - most).exp()).sum::<f64>();
        let average = (total / tried.len() as f64).ln();
        let (fit, score) = optimise(engine, active, best, Free::Spread, step)?;
        Some((fit, score + average))
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
        let cause = |candidate: usize| &self.bench.candidates[candidate].cause;
        let is_near =
            |t: &Tried| cause(t.candidate) == cause(best.0) && t.log_bf > best.1 - SIMPLER;
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
        let outer = Outer { outliers: base.outer.outliers, ..best.outer.clone() };
        let start = engine.fit(&outer, active, Some(base))?;
        let (fit, score_there) = optimise(engine, active, &start, Free::All, step)?;
        (score_there > score(base, step) + 0.5).then_some(fit)
    }
}
