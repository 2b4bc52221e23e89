//! One search: what the base fit leaves over, screened against every covariate, and each candidate's
//! evidence.

use super::candidates::{Candidate, Level, Screen};
use super::engine::{Engine, Term};
use super::fit::Fit;
use super::leave::residuals;
use super::outer::{Free, optimise, score};
use super::screen::{f_test, of_sites, of_units};
use crate::model::Noise;

/// Shares of outlying measurements that are tried, and the sds of their further error in steps.
const OUTLYING_SHARES: [f64; 2] = [0.05, 0.15];
const OUTLYING_STEPS: [f64; 2] = [2.0, 5.0];
/// So far below the base, the sds of sites and noise would not bring them above it.
const HOPELESS: f64 = 5.0;

/// A candidate's evidence.
#[derive(Clone, Debug)]
pub(super) struct Tried {
    /// Number of the candidate.
    pub candidate: usize,
    /// p-value of the screen; 1 for what is not screened.
    pub p_screen: f64,
    /// Log Bayes factor against the base; −∞ where the screen stopped it.
    pub log_bf: f64,
    /// Its fit.
    pub fit: Option<Fit>,
}

/// Scores every candidate against `base`; `accepted` are terms that are in both.
pub(super) fn search(
    engine: &Engine,
    candidates: &[Candidate],
    base: &Fit,
    accepted: &[usize],
    gate: f64,
    step: f64,
    seed: u64,
) -> Vec<Tried> {
    let sites = of_sites(engine, &residuals(engine, base, seed));
    let units = of_units(engine, base);
    let reference = score(base, step);
    let one = |candidate: usize| {
        let Candidate { level, screen, .. } = candidates[candidate];
        let p_screen = match screen {
            Screen::Sites => f_test(engine, &sites, candidate),
            Screen::Units => f_test(engine, &units, candidate),
            Screen::None => 1.0,
        };
        let mut tried = Tried { candidate, p_screen, log_bf: f64::NEG_INFINITY, fit: None };
        if screen != Screen::None && p_screen > gate {
            return tried;
        }
        let active = [accepted, &[candidate]].concat();
        if level == Level::Noise {
            if let Some((fit, score)) = with_outliers(engine, base, &active, step) {
                (tried.log_bf, tried.fit) = (score - reference, Some(fit));
            }
            return tried;
        }
        let Some(fit) = engine.fit(&base.outer, &active, Some(base)) else { return tried };
        tried.log_bf = score(&fit, step) - reference;
        tried.fit = Some(fit.clone());
        // what varies over units gains only once it has taken the place of their random effect
        if (tried.log_bf > 0.0 || screen == Screen::Units)
            && let Some((best, score)) = optimise(engine, &active, &fit, Free::Spread, step)
            && score - reference > tried.log_bf
        {
            tried.log_bf = score - reference;
            tried.fit = Some(best);
        }
        tried
    };
    let is_new = |c: &usize| {
        let mut taken = accepted.iter().filter_map(|a| candidates.get(*a));
        taken.all(|taken| taken.name != candidates[*c].name)
    };
    (0..candidates.len()).filter(is_new).map(one).collect()
}

/// The fit with outliers, and its score averaged over their share and size.
fn with_outliers(engine: &Engine, base: &Fit, active: &[usize], step: f64) -> Option<(Fit, f64)> {
    let mut outer = base.outer.clone();
    // what is outlying has made the others' error look large
    outer.ln_noise = outer.ln_noise.min((step / 3.0).ln());
    let mut tried: Vec<(Fit, f64)> = vec![];
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
    let average = (tried.iter().map(|t| (t.1 - most).exp()).sum::<f64>() / tried.len() as f64).ln();
    let (fit, score) = optimise(engine, active, best, Free::Spread, step)?;
    Some((fit, score + average))
}

impl Fit {
    /// The random effect of units, which comes first among the terms, if there is one.
    pub(super) fn unit_term<'e>(&self, engine: &'e Engine) -> Option<&'e Term> {
        self.active.first().map(|a| &engine.terms[*a]).filter(|term| term.sd.is_none())
    }

    /// The noise of its rows.
    pub fn noise(&self) -> Noise {
        self.outer.noise()
    }
}
