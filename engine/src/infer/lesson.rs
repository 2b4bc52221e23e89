//! What NUTS chains learn from each other when they meet in the warm-up.

use super::hamiltonian::{Metric, PhasePoint};
use super::moments::DrawMoments;
use super::settings::MetricKind;
use crate::num::Moments;
use serde::{Deserialize, Serialize};

/// Position, gradient, log density.
type WarmUpDraw = (Vec<f64>, Vec<f64>, f64);

/// Means and standard deviations in half of a chain's draws.
type Half = (Vec<f64>, Vec<f64>);

/// The draws of one chain in one round of the warm-up.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct Lesson {
    draws: Vec<WarmUpDraw>,
    n_divergences: usize,
}

impl Lesson {
    /// Chains agree if no coordinate's variance of all draws is larger than that within half a chain
    /// by more than the square of this.
    const R_HAT: f64 = 1.1;
    /// The same of the log density alone, which is asked after rounds of 30 transitions. A half then has ten draws, which depend
    /// on each other. So their means may differ by more than 1.1 allows, though all is well.
    const R_HAT_OF_DENSITY: f64 = 1.2;

    /// Directions must lower the Fisher divergence at least to this part of that of scales alone.
    const LEAST_GAIN: f64 = 0.25;

    pub(super) fn add(&mut self, point: &PhasePoint, diverging: bool) {
        self.draws.push((point.position.clone(), point.gradient.clone(), point.ln_density));
        self.n_divergences += usize::from(diverging);
    }

    /// Positions of `n` draws, evenly spaced and the last among them; of all if there are fewer.
    pub(super) fn positions(&self, n: usize) -> impl Iterator<Item = Vec<f64>> {
        let (n, of) = (n.min(self.draws.len()), self.draws.len());
        (1..=n).map(move |i| self.draws[i * of / n - 1].0.clone())
    }

    /// Whether it has `n` draws of `dim` coordinates.
    pub(super) fn fits(&self, n: usize, dim: usize) -> bool {
        let is_draw = |draw: &WarmUpDraw| [draw.0.len(), draw.1.len()] == [dim; 2];
        self.draws.len() == n && self.draws.iter().all(is_draw)
    }

    /// The metric that suits all chains' draws. Directions are taken up only if they also suit draws
    /// that they were not fitted to: those of the second halves.
    pub(super) fn fit(lessons: &[Self], kind: MetricKind, metric: &mut Metric) {
        let scale = metric.scale.clone();
        let fitted = |lessons: &[&[WarmUpDraw]], kind| {
            let mut moments = DrawMoments::new(scale.len(), kind);
            for (position, gradient, _) in lessons.iter().copied().flatten() {
                moments.add(position, gradient);
            }
            let mut new = Metric::diagonal(scale.clone());
            moments.fit(&mut new);
            new
        };
        let (first, second): (Vec<_>, Vec<_>) = lessons.iter().map(Self::halves).unzip();
        let seconds: Vec<&WarmUpDraw> = second.iter().copied().flatten().collect();
        let error = |kind| fisher_divergence(&fitted(&first, kind), &seconds);
        let pays = kind == MetricKind::LowRank
            && error(MetricKind::LowRank) < Self::LEAST_GAIN * error(MetricKind::Diagonal);
        let kind = if pays { MetricKind::LowRank } else { MetricKind::Diagonal };
        *metric = fitted(&[first, second].concat(), kind);
    }

    fn halves(&self) -> (&[WarmUpDraw], &[WarmUpDraw]) {
        self.draws.split_at(self.draws.len() / 2)
    }

    /// Whether no chain diverged, and all halves of all chains tell the same, of every coordinate and
    /// of the log density.
    pub(super) fn agree(lessons: &[Self]) -> bool {
        Self::halves_agree(lessons, Self::R_HAT, |(position, _, ln_density)| {
            position.iter().chain([ln_density]).copied().collect()
        })
    }

    /// The same of the log density alone.
    pub(super) fn agree_on_density(lessons: &[Self]) -> bool {
        Self::halves_agree(lessons, Self::R_HAT_OF_DENSITY, |(_, _, ln_density)| vec![*ln_density])
    }

    fn halves_agree(lessons: &[Self], r_hat: f64, of: impl Fn(&WarmUpDraw) -> Vec<f64>) -> bool {
        if lessons.iter().any(|lesson| lesson.n_divergences > 0) {
            return false;
        }
        let mut halves: Vec<Half> = vec![];
        for lesson in lessons {
            let (a, b) = lesson.halves();
            halves.extend([a, b].map(|half| {
                let mut moments = Moments::new(half.first().map_or(0, |draw| of(draw).len()));
                for draw in half {
                    moments.add(of(draw).into_iter());
                }
                (moments.means(), moments.sds())
            }));
        }
        let (n, width) = (halves.len() as f64, halves.first().map_or(0, |half| half.0.len()));
        let mean = |of: &dyn Fn(&Half) -> f64| halves.iter().map(of).sum::<f64>() / n;
        (0..width).all(|i| {
            let within = mean(&|half| half.1[i].powi(2));
            let centre = mean(&|half| half.0[i]);
            let between = mean(&|half| (half.0[i] - centre).powi(2)) * n / (n - 1.0);
            // `!(a > b)` would take NaN for agreement
            between <= (r_hat.powi(2) - 1.0) * within
        })
    }
}

/// How far the draws are from those of a normal whose covariance is this metric: the square of force plus
/// whitened position, which is 0 for such a normal. It is the median over the draws, because the tails of
/// a posterior do not tell how to move in its bulk.
fn fisher_divergence(metric: &Metric, draws: &[&WarmUpDraw]) -> f64 {
    let (dim, n) = (metric.scale.len(), draws.len() as f64);
    let mean = |i: usize| draws.iter().map(|draw| draw.0[i]).sum::<f64>() / n;
    let centre: Vec<f64> = (0..dim).map(mean).collect();
    let of_draw = |(position, gradient, _): &&WarmUpDraw| {
        let off: Vec<f64> = position.iter().zip(&centre).map(|(q, c)| q - c).collect();
        let (whitened, mut force) = (metric.whitened(&off), vec![0.0; dim]);
        metric.pull(gradient, &mut force);
        force.iter().zip(&whitened).map(|(f, x)| (f + x).powi(2)).sum::<f64>()
    };
    let mut all: Vec<f64> = draws.iter().map(of_draw).collect();
    all.sort_by(f64::total_cmp);
    all.get(all.len() / 2).copied().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngExt as _;
    use rand::SeedableRng as _;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;

    /// Four chains of twenty draws, the last with another coordinate and another log density.
    fn lessons(coordinate: f64, ln_density: f64) -> Vec<Lesson> {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut normal = || rng.sample::<f64, _>(StandardNormal);
        let mut one = |chain: usize| {
            let [x, ln] = if chain == 3 { [coordinate, ln_density] } else { [0.0; 2] };
            let draw = |_| (vec![x + normal()], vec![0.0], ln + normal());
            Lesson { draws: (0..20).map(draw).collect(), n_divergences: 0 }
        };
        (0..4).map(&mut one).collect()
    }

    #[test]
    fn some_positions_are_spread_over_all() {
        let draw = |i: i32| (vec![f64::from(i)], vec![0.0], 0.0);
        let lesson = Lesson { draws: (1..=20).map(draw).collect(), n_divergences: 0 };
        let of = |n| lesson.positions(n).flatten().collect::<Vec<f64>>();
        assert_eq!((of(4), of(3)), (vec![5.0, 10.0, 15.0, 20.0], vec![6.0, 13.0, 20.0]));
        assert_eq!((of(50).len(), Lesson::default().positions(4).count()), (20, 0));
    }

    #[test]
    fn chains_agree_on_all_or_on_the_density_alone() {
        let both = |lessons: &[Lesson]| [Lesson::agree(lessons), Lesson::agree_on_density(lessons)];
        assert_eq!(both(&lessons(0.0, 0.0)), [true, true]);
        assert_eq!(both(&lessons(5.0, 0.0)), [false, true]);
        assert_eq!(both(&lessons(0.0, 5.0)), [false, false]);
        // less is asked of the density alone, in short rounds
        assert_eq!(both(&lessons(0.0, 1.1)), [false, true]);
        let mut diverged = lessons(0.0, 0.0);
        diverged[2].n_divergences = 1;
        assert_eq!(both(&diverged), [false, false]);
    }
}
