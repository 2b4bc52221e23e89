//! A warm-up as a list of stages, and where a chain is in it.

use serde::{Deserialize, Serialize};

/// A part of the warm-up. The step size adapts in all of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Stage {
    /// Number of transitions.
    pub(super) length: usize,
    /// What else adapts.
    pub(super) metric: Option<Window>,
    /// Whether the chains of a run meet at its end, to learn from each other.
    pub(super) meets: bool,
}

/// From how many draws a metric is learnt.
///
/// Two windows overlap. The metric comes from the older one. Whenever the younger one has filled,
/// it takes the older one's place. So early draws are forgotten, and the metric never has to wait
/// for draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Window(pub(super) usize);

impl Stage {
    const EARLY: Window = Window(10);
    pub(super) const LATE: Window = Window(80);
    /// The fewest transitions between two meetings of NUTS chains.
    const LEAST_ROUND: usize = 20;

    /// The most transitions of the warm-up of a NUTS chain that learns its metric from draws. After every tenth of them
    /// the chains meet, and the metric is fitted to the draws of all; once they agree, only the last tenth follows. In
    /// the first tenth each chain learns from its own draws, unless earlier ones have told about scales.
    ///
    /// ```text
    /// 0 ──────────── 10 % ── 20 % ── … ── 90 % ───────────────── 100 %
    ///  windows of 10     ↑ meetings ↑        ↑     step size only
    /// ```
    pub(super) fn nuts(n: usize, knows_metric: bool) -> Vec<Self> {
        let last = n.div_ceil(10);
        let n_rounds = ((n - last) / Self::LEAST_ROUND).clamp(1, 9);
        let end = |round: usize| round * (n - last) / n_rounds;
        let round = |r: usize| Self {
            length: end(r + 1) - end(r),
            metric: (r == 0 && !knows_metric).then_some(Self::EARLY),
            meets: true,
        };
        let last = Self { length: last, metric: None, meets: false };
        (0..n_rounds).map(round).chain([last]).collect()
    }

    /// The most transitions of the warm-up of a NUTS chain whose metric is that of the Hessian: that must be known at a few
    /// places, and the step size. After every round the chains meet; once they agree, only the last one follows.
    pub(super) fn of_hessian(n: usize) -> Vec<Self> {
        const ROUND: usize = 30;
        let last = ROUND.min(n.div_ceil(2));
        let n_rounds = (n - last).div_ceil(ROUND);
        let end = |round: usize| round * (n - last) / n_rounds;
        let stage = |length, meets| Self { length, metric: None, meets };
        let last = stage(last, false);
        (0..n_rounds).map(|r| stage(end(r + 1) - end(r), true)).chain([last]).collect()
    }

    /// One round of a blocked chain's warm-up.
    ///
    /// ```text
    /// 0 ───── 30 % ──────────────── 85 % ───────── 100 %
    ///  windows of 10   windows of 80    step size only
    /// ```
    fn blocked_round(n: usize) -> [Self; 3] {
        let stage = |length, metric| Self { length, metric, meets: false };
        let (early, end) = (n * 3 / 10, n * 85 / 100);
        [
            stage(early, Some(Self::EARLY)),
            stage(end - early, Some(Self::LATE)),
            Self { meets: true, ..stage(n - end, None) },
        ]
    }

    /// The warm-up of a blocked chain. The chains meet after 10, 20, 30, 40, 60 and 100 %, and what
    /// they share is fitted anew. There are many meetings because a stand-in may claim to know too
    /// much. Chains under it spread slowly, so its successor, which is fitted to their draws, still
    /// claims too much, but less.
    ///
    /// If `knows_hyper`, draws of an earlier run have told how the hyperparameters' steps should
    /// be. The first meeting is then at the beginning.
    pub(super) fn blocked(n: usize, knows_hyper: bool) -> Vec<Self> {
        const ENDS: [f64; 6] = [0.1, 0.2, 0.3, 0.4, 0.6, 1.0];
        let (mut stages, mut before) = (vec![], 0);
        for (i, end) in ENDS.into_iter().enumerate() {
            let is_left_out = i == 0 && knows_hyper;
            let end = if is_left_out { 0 } else { (n as f64 * end).round() as usize };
            stages.extend(Self::blocked_round(end - before));
            before = end;
        }
        stages
    }
}

impl Stage {
    /// The warm-up of an integrated chain: after 20, 40 and 70 % and at its end the chains meet, and the proposal that
    /// they share is fitted anew.
    pub(super) fn integrated(n: usize) -> Vec<Self> {
        const ENDS: [f64; 4] = [0.2, 0.4, 0.7, 1.0];
        let mut before = 0;
        let round = |end: f64| {
            let end = (n as f64 * end).round() as usize;
            let length = end - before;
            before = end;
            Self { length, metric: None, meets: true }
        };
        ENDS.map(round).into()
    }
}

/// Where a chain is in its warm-up. A *round* is what lies between two meetings.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct WarmUp {
    stages: Vec<Stage>,
    n_meetings: usize,
    /// Transitions since the last meeting.
    done: usize,
}

impl WarmUp {
    pub(super) fn new(stages: Vec<Stage>) -> Self {
        Self { stages, n_meetings: 0, done: 0 }
    }

    fn rounds(&self) -> impl Iterator<Item = &[Stage]> {
        self.stages.split_inclusive(|stage| stage.meets)
    }

    /// The stages of the present round; none after the last meeting.
    fn round(&self) -> &[Stage] {
        self.rounds().nth(self.n_meetings).unwrap_or_default()
    }

    /// Transitions of the present round.
    pub(super) fn length(&self) -> usize {
        length(self.round())
    }

    /// Transitions since the last meeting.
    pub(super) fn done(&self) -> usize {
        self.done
    }

    /// Whether the chain learns from the next draw: it does in the last two thirds of each round.
    pub(super) fn is_late(&self) -> bool {
        3 * self.done >= self.length()
    }

    /// From how many draws the chain has learnt since the last meeting.
    pub(super) fn n_late(&self) -> usize {
        self.done.saturating_sub(self.length().div_ceil(3))
    }

    /// Whether a warm-up that begins with the stages of `first` can come here. Rounds may have been left
    /// out.
    pub(super) fn follows(&self, first: &Self) -> bool {
        let mut stages = first.stages.iter();
        self.stages.iter().all(|stage| stages.any(|of_first| of_first == stage))
            && self.n_meetings <= self.rounds().count()
            && self.done <= self.length()
    }

    /// Transitions in all.
    pub(super) fn n_done(&self) -> usize {
        self.rounds().take(self.n_meetings).map(length).sum::<usize>() + self.done
    }

    pub(super) fn n_meetings(&self) -> usize {
        self.n_meetings
    }

    pub(super) fn must_meet(&self) -> bool {
        let round = self.round();
        self.done == length(round) && round.last().is_some_and(|stage| stage.meets)
    }

    /// Whether the last round is the next one.
    pub(super) fn is_last_but_one(&self) -> bool {
        self.rounds().count() == self.n_meetings + 2
    }

    pub(super) fn is_over(&self) -> bool {
        self.done == self.length() && !self.must_meet()
    }

    pub(super) fn advance(&mut self) {
        self.done += 1;
    }

    pub(super) fn met(&mut self) {
        self.n_meetings += 1;
        self.done = 0;
    }

    /// Leaves out all further rounds but the last.
    pub(super) fn shorten(&mut self) {
        let n_stages: Vec<usize> = self.rounds().map(<[Stage]>::len).collect();
        let begun: usize = n_stages.iter().take(self.n_meetings).sum();
        let last = self.stages.len() - n_stages.last().copied().unwrap_or(0);
        self.stages.drain(begun..last.max(begun));
    }

    /// The window at the next transition, if the metric adapts there.
    pub(super) fn window(&self) -> Option<usize> {
        let mut end = 0;
        let stage = self.round().iter().find(|stage| {
            end += stage.length;
            self.done < end
        });
        stage?.metric.map(|window| window.0)
    }

    /// Whether the next transition is the last of this round at which the metric adapts.
    pub(super) fn ends_metric(&self) -> bool {
        let round = self.round();
        let last = round.iter().rposition(|stage| stage.metric.is_some());
        last.is_some_and(|last| self.done + 1 == length(&round[..=last]))
    }
}

fn length(stages: &[Stage]) -> usize {
    stages.iter().map(|stage| stage.length).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stages_add_up_and_chains_meet_at_their_shares() {
        for n in 20..1200 {
            for knows in [false, true] {
                assert_eq!(
                    (length(&Stage::nuts(n, knows)), length(&Stage::blocked(n, knows))),
                    (n, n)
                );
            }
            let of_hessian = Stage::of_hessian(n);
            assert_eq!(length(&of_hessian), n);
            let is_short = |stage: &Stage| (1..=30).contains(&stage.length);
            assert!(of_hessian.iter().all(is_short), "{of_hessian:?}");
            let n_last = of_hessian.iter().filter(|stage| !stage.meets).count();
            assert!(n_last == 1 && of_hessian.last().is_some_and(|stage| !stage.meets));
        }
        let mut warm_up = WarmUp::new(Stage::blocked(60, false));
        let mut meetings = vec![];
        while !warm_up.is_over() {
            if warm_up.must_meet() {
                assert_eq!(warm_up.is_last_but_one(), meetings.len() == 4);
                meetings.push(warm_up.n_done());
                warm_up.met();
            } else {
                warm_up.advance();
            }
        }
        assert_eq!(meetings, [6, 12, 18, 24, 36, 60]);
        assert_eq!((warm_up.n_done(), warm_up.n_meetings()), (60, 6));
    }

    #[test]
    fn the_metric_adapts_in_the_stages_that_say_so() {
        let mut warm_up = WarmUp::new(Stage::blocked_round(100).to_vec());
        let mut windows = vec![];
        while !warm_up.must_meet() {
            windows.push((warm_up.window(), warm_up.ends_metric()));
            warm_up.advance();
        }
        let of = |window| windows.iter().filter(|w| w.0 == window).count();
        assert_eq!([of(Some(10)), of(Some(80)), of(None)], [30, 55, 15]);
        assert_eq!(windows.iter().position(|w| w.1), Some(84));
    }

    #[test]
    fn a_warm_up_that_is_shortened_goes_on_with_its_last_round() {
        for n_meetings in 0..10 {
            let mut warm_up = WarmUp::new(Stage::nuts(1000, false));
            for _ in 0..n_meetings {
                (0..warm_up.length()).for_each(|_| warm_up.advance());
                assert!(warm_up.must_meet());
                warm_up.met();
            }
            warm_up.shorten();
            assert!(!warm_up.is_last_but_one());
            assert_eq!((warm_up.n_done(), warm_up.length()), (100 * n_meetings, 100));
            (0..100).for_each(|_| warm_up.advance());
            assert!(warm_up.is_over());
        }
    }
}
