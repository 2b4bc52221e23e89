//! What NUTS chains learn from each other when they meet in the warm-up.

use super::hamiltonian::PhasePoint;
use super::moments::DrawMoments;
use super::settings::MetricKind;
use crate::num::Moments;
use serde::{Deserialize, Serialize};

/// The draws of one chain in one round of the warm-up.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct Lesson {
    /// Positions, gradients, log densities.
    draws: Vec<(Vec<f64>, Vec<f64>, f64)>,
    n_divergences: usize,
}

impl Lesson {
    /// Chains agree if no coordinate's variance of all draws is larger than that within half a chain
    /// by more than the square of this.
    const R_HAT: f64 = 1.1;

    pub(super) fn add(&mut self, point: &PhasePoint, diverging: bool) {
        self.draws.push((point.position.clone(), point.gradient.clone(), point.ln_density));
        self.n_divergences += usize::from(diverging);
    }

    pub(super) fn diverged(&self) -> bool {
        self.n_divergences > 0
    }

    /// The moments of all chains' draws.
    pub(super) fn moments(lessons: &[Self], kind: MetricKind) -> DrawMoments {
        let mut draws = lessons.iter().flat_map(|lesson| &lesson.draws).peekable();
        let dim = draws.peek().map_or(0, |draw| draw.0.len());
        let mut moments = DrawMoments::new(dim, kind);
        draws.for_each(|(position, gradient, _)| moments.add(position, gradient));
        moments
    }

    /// Whether all halves of all chains tell the same, of every coordinate and of the log density.
    pub(super) fn agree(lessons: &[Self]) -> bool {
        let mut halves = vec![];
        for lesson in lessons {
            let (a, b) = lesson.draws.split_at(lesson.draws.len() / 2);
            halves.extend([a, b].map(|half| {
                let width = half.first().map_or(0, |draw| draw.0.len() + 1);
                let mut moments = Moments::new(width);
                for (position, _, ln_density) in half {
                    moments.add(position.iter().copied().chain([*ln_density]));
                }
                (moments.means(), moments.sds())
            }));
        }
        let (n, width) = (halves.len() as f64, halves.first().map_or(0, |half| half.0.len()));
        let mean =
            |of: &dyn Fn(&(Vec<f64>, Vec<f64>)) -> f64| halves.iter().map(of).sum::<f64>() / n;
        (0..width).all(|i| {
            let within = mean(&|half| half.1[i].powi(2));
            let centre = mean(&|half| half.0[i]);
            let between = mean(&|half| (half.0[i] - centre).powi(2)) * n / (n - 1.0);
            // `!(a > b)` would take NaN for agreement
            between <= (Self::R_HAT.powi(2) - 1.0) * within
        })
    }
}

/// The mean acceptance that the step size is tuned to.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Target {
    accept: f64,
    is_given: bool,
}

impl Target {
    /// Where none is given: the first of these, and the next one after each round with a divergence.
    const LEVELS: [f64; 5] = [0.8, 0.9, 0.95, 0.98, 0.99];

    pub(super) fn new(given: Option<f64>) -> Self {
        Self { accept: given.unwrap_or(Self::LEVELS[0]), is_given: given.is_some() }
    }

    pub(super) fn accept(&self) -> f64 {
        self.accept
    }

    pub(super) fn raise(&mut self) {
        let next = Self::LEVELS.into_iter().find(|level| *level > self.accept);
        if let (false, Some(next)) = (self.is_given, next) {
            self.accept = next;
        }
    }
}
