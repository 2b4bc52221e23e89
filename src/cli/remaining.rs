//! How long sampling will take, from what all chains have done. A chain by itself does not tell: there may be
//! more chains than cores, and some wait for others.

use std::time::{Duration, Instant};

use crate::infer::{ChainProgress, Settings};
use crate::model::Sampler;

/// Share of the work that is to be done before its time says something.
const LEAST: f64 = 0.05;

/// The work of a run's chains, in transitions of the warm-up.
pub(super) struct Remaining {
    warmup: usize,
    /// What a transition of sampling costs.
    cost: f64,
    total: f64,
    /// By chain, what is done.
    done: Vec<f64>,
    /// By chain, what was done when it first told: of a run that is resumed, much.
    before: Vec<Option<f64>>,
    /// When the first chain told.
    begun: Option<Instant>,
}

impl Remaining {
    pub(super) fn new(settings: &Settings, sampler: Sampler) -> Self {
        let Settings { chains, warmup, draws, .. } = *settings;
        // the blocked sampler sweeps oftener between draws than in its warm-up
        let cost = if sampler == Sampler::Blocked { 2.0 } else { 1.0 };
        let total = chains as f64 * (warmup as f64 + cost * draws as f64);
        let (done, before) = (vec![0.0; chains], vec![None; chains]);
        Self { warmup, cost, total, done, before, begun: None }
    }

    /// What is left after this progress; `None` while it cannot be told.
    pub(super) fn after(&mut self, p: &ChainProgress, now: Instant) -> Option<Duration> {
        let warmup = p.iteration.min(self.warmup);
        let own = warmup as f64 + self.cost * (p.iteration - warmup) as f64;
        *self.done.get_mut(p.chain)? = own;
        self.before[p.chain].get_or_insert(own);
        let begun = *self.begun.get_or_insert(now);
        let done: f64 = self.done.iter().sum();
        let here = done - self.before.iter().flatten().sum::<f64>();
        if here < LEAST * self.total {
            return None;
        }
        let seconds = (now - begun).as_secs_f64() * (self.total - done) / here;
        Duration::try_from_secs_f64(seconds).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::infer::Phase;

    fn at(chain: usize, iteration: usize) -> ChainProgress {
        let (phase, total) = (Phase::Sampling, 300);
        ChainProgress { chain, phase, iteration, total, divergences: 0, step_size: 1.0 }
    }

    #[test]
    fn chains_that_wait_for_others_do_not_lengthen_what_is_left() {
        let settings = Settings { chains: 4, warmup: 100, draws: 200, ..Settings::default() };
        let mut remaining = Remaining::new(&settings, Sampler::Nuts);
        let begun = Instant::now();
        let after = |seconds| begun + Duration::from_secs(seconds);
        assert_eq!(remaining.after(&at(0, 0), begun), None);
        // the second one tells later than it began: that is no progress in no time
        assert_eq!(remaining.after(&at(1, 90), begun), None);
        // two of four chains run: 200 of 1200 transitions in 10 s
        remaining.after(&at(0, 100), after(10));
        let left = remaining.after(&at(1, 190), after(10)).unwrap();
        assert!((left.as_secs_f64() - 45.5).abs() < 1e-9, "{left:?}");
    }

    #[test]
    fn what_was_done_before_an_interruption_says_nothing_about_the_time() {
        let settings = Settings { chains: 1, warmup: 100, draws: 200, ..Settings::default() };
        let mut remaining = Remaining::new(&settings, Sampler::Blocked);
        let begun = Instant::now();
        assert_eq!(remaining.after(&at(0, 150), begun), None);
        // 50 of the 150 draws that were left
        let left = remaining.after(&at(0, 200), begun + Duration::from_secs(10)).unwrap();
        assert!((left.as_secs_f64() - 20.0).abs() < 1e-9, "{left:?}");
    }
}
