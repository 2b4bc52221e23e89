//! What a sampler reaches per CPU second, in the project's own diagnostics.
#![allow(clippy::unwrap_used, reason = "for tests and benches")]
#![allow(dead_code, reason = "each user needs a part of it")]

use std::fmt;

use eplat::infer::Chain;
use eplat::model::Model;

use crate::posterior::columns;

#[path = "cpu.rs"]
mod cpu;

pub(crate) use cpu::cpu_seconds;

/// One run's worst diagnostics over all reported numbers, and what it cost, warm-up included.
pub(crate) struct Figures {
    pub(crate) cpu: f64,
    pub(crate) bulk: f64,
    pub(crate) tail: f64,
    pub(crate) r_hat: f64,
    worst: [String; 3],
    divergences: usize,
    gradients: u64,
}

impl Figures {
    pub(crate) fn new(model: &Model, chains: &[Chain], cpu: f64) -> Self {
        let columns = columns(model, chains);
        let least = |of: &dyn Fn(&eplat::diagnostics::Summary) -> f64| {
            let values = columns.iter().map(|c| (of(&c.summary()), c.name.clone()));
            values.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap()
        };
        let (bulk, of_bulk) = least(&|s| s.ess_bulk);
        let (tail, of_tail) = least(&|s| s.ess_tail);
        let (r_hat, of_r_hat) = least(&|s| -s.r_hat);
        Self {
            cpu,
            bulk,
            tail,
            r_hat: -r_hat,
            worst: [of_bulk, of_tail, of_r_hat],
            divergences: chains.iter().flat_map(|c| &c.diverging).filter(|d| **d).count(),
            gradients: chains.iter().map(|c| c.n_grad_warmup + c.n_grad_sampling).sum(),
        }
    }

    /// Smallest bulk ESS per CPU second.
    pub(crate) fn rate(&self) -> f64 {
        self.bulk / self.cpu
    }
}

impl fmt::Display for Figures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { cpu, bulk, tail, r_hat, worst: [of_bulk, of_tail, of_r_hat], .. } = self;
        write!(
            f,
            "{:.0} ESS/s: {cpu:.2} s, bulk {bulk:.0} ({of_bulk}), tail {tail:.0} ({of_tail}), R-hat {r_hat:.4} \
             ({of_r_hat}), {} divergences, {} gradients",
            self.rate(),
            self.divergences,
            self.gradients,
        )
    }
}

/// Median rate and largest R-hat over runs that differ in their seed.
pub(crate) fn conclude(what: &str, runs: &[Figures]) -> String {
    let mut rates: Vec<f64> = runs.iter().map(Figures::rate).collect();
    rates.sort_by(f64::total_cmp);
    let r_hat = runs.iter().map(|f| f.r_hat).fold(0.0, f64::max);
    let (median, least) = (rates[rates.len() / 2], rates[0]);
    let n = runs.len();
    format!(
        "{what}: median {median:.0} ESS/CPU-s (least {least:.0}), R-hat at most {r_hat:.4} over {n} seeds"
    )
}
