//! *Fits*: the measurements against what the model predicts of them.

use serde::{Deserialize, Serialize};

use super::Colour;
use crate::diagnostics::special::beta_above;

/// Share of measurements that the predictive intervals are made for.
const LEVEL: f64 = 0.9;
/// A right model with independent rows is amber with this probability, because of the share of rows
/// in their intervals, all sets together.
const FALSE_ALARM: f64 = 0.01;
/// A set with at least this share of its rows in their intervals is never a reason for amber,
/// however many rows it has.
const GOOD_ENOUGH: f64 = 0.85;
/// A model does not fit if fewer than this share of the rows are in their intervals.
const ABSURD: f64 = 0.5;
/// A model does not fit if more than this share of the rows, and at least two, are impossible.
const MOST_IMPOSSIBLE: f64 = 0.01;

/// How many of a set of measurements lie in their 90 % predictive intervals.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Within {
    /// What the measurements have in common, in words.
    pub name: String,
    /// How many there are.
    pub n: usize,
    /// How many lie in their intervals.
    pub inside: usize,
}

impl Within {
    /// The share that lies in the intervals.
    pub fn share(&self) -> f64 {
        self.inside as f64 / self.n as f64
    }

    /// Probability that as many measurements or more lie outside, if each does so with probability
    /// 10 %.
    ///
    /// The model was fitted to these measurements, so their intervals hold more than they say. A
    /// right model therefore falls below a given probability more rarely than the probability
    /// tells.
    pub fn p_value(&self) -> f64 {
        let outside = self.n - self.inside;
        if outside == 0 {
            return 1.0;
        }
        1.0 - beta_above(1.0 - LEVEL, outside as f64, (self.inside + 1) as f64)
    }
}

/// A measurement outside its predictive interval.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Misfit {
    /// Line of its file.
    pub line: u64,
    /// Its statement and place, in words.
    pub place: String,
    /// Declared unit.
    pub unit: String,
    /// What was measured: one number, or the two ends of a bracket, as text.
    pub measured: String,
    /// 90 % interval of what is predicted, the width of a bracket included.
    pub predicted: [f64; 2],
    /// Whether it lies beyond everything predicted, by more than three times as far as predictions reach
    /// from their median.
    pub is_impossible: bool,
}

/// What is wrong with measurements, or what they ask for. All but the last two is known before anything is sampled.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Doubt {
    /// Measurements of one quantity that exclude each other.
    Contradiction {
        /// The statement and place, in words.
        place: String,
        /// Declared unit.
        unit: String,
        /// Lines of the file.
        lines: Vec<u64>,
        /// What was measured there, as text.
        measured: Vec<String>,
    },
    /// Measurements that are all the same.
    Alike {
        /// The statement.
        observe: String,
        /// Declared unit.
        unit: String,
        /// How many.
        n: usize,
        /// What was measured, as text.
        measured: String,
    },
    /// Measurements far from everything that the model can mean.
    Range {
        /// The statement.
        observe: String,
        /// Declared unit.
        unit: String,
        /// How many of its measurements are far.
        n: usize,
        /// How many measurements it has.
        of: usize,
        /// Lines of the first of those that are far.
        lines: Vec<u64>,
        /// Smallest and largest of those that are far.
        measured: [f64; 2],
        /// Smallest and largest value that the model expects of those.
        expected: [f64; 2],
        /// A factor that would bring all of them near, if there is one: the table may be in another
        /// unit.
        factor: Option<f64>,
    },
    /// Activation that seems to have started at another place, too.
    Breakthrough {
        /// The map of the activation.
        activation: String,
        /// The vertex of that place, as the mesh file counts.
        vertex: u32,
        /// By how much later than at the first place, ms.
        later: f64,
        /// By how much the log likelihood grows with it, at the least.
        gain: f64,
        /// How many rows it would reach first, of how many.
        rows: [usize; 2],
    },
    /// Fields whose values fall into two regimes at some measured places.
    Regimes {
        /// The vertex where they are farthest apart, as the mesh file counts.
        vertex: u32,
        /// At how many measured vertices draws are cut in the same way.
        n: usize,
        /// The share of the draws in the smaller regime.
        share: f64,
        /// Name, unit and the means in the smaller regime and in the other, of each field that differs there.
        fields: Vec<(String, String, [f64; 2])>,
    },
}

impl Doubt {
    /// Red for a contradiction, and where at least half of a statement's measurements (and at least
    /// two) are out of range; else amber.
    pub fn colour(&self) -> Colour {
        match self {
            Self::Contradiction { .. } => Colour::Red,
            Self::Range { n, of, .. } if 2 * n >= *of && *n >= 2 => Colour::Red,
            Self::Range { .. }
            | Self::Alike { .. }
            | Self::Breakthrough { .. }
            | Self::Regimes { .. } => Colour::Amber,
        }
    }
}

/// The measurements against their predictive intervals.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fits {
    /// All measurements, then those of each statement and of each label of a column.
    pub sets: Vec<Within>,
    /// How many sets were looked at, each site among them.
    pub n_sets: usize,
    /// The set with the smallest probability under the model.
    pub worst: Option<Within>,
    /// How many measurements are impossible.
    pub n_impossible: usize,
    /// The worst misfits, worst first.
    pub misfits: Vec<Misfit>,
    /// What was wrong before anything was sampled.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub doubts: Vec<Doubt>,
}

impl Fits {
    /// The figures of these sets, the first of which is all measurements. The first `n_kept` of
    /// them are reported, and the worst of all.
    pub fn new(sets: &[Within], n_kept: usize) -> Self {
        let worst = sets.iter().min_by(|a, b| a.p_value().total_cmp(&b.p_value()));
        Self {
            sets: sets[..n_kept.min(sets.len())].to_vec(),
            n_sets: sets.len(),
            worst: worst.cloned(),
            n_impossible: 0,
            misfits: vec![],
            doubts: vec![],
        }
    }

    /// The probability of the worst set or a worse one, over all sets together (Bonferroni).
    pub fn p_value(&self) -> f64 {
        let worst = self.worst.as_ref().map_or(1.0, Within::p_value);
        (worst * self.n_sets as f64).min(1.0)
    }

    /// Whether the worst set has fewer measurements in their intervals than chance would explain.
    pub fn is_misfit(&self) -> bool {
        let is_low = self.worst.as_ref().is_some_and(|worst| worst.share() < GOOD_ENOUGH);
        is_low && self.p_value() < FALSE_ALARM
    }

    /// Red where the measurements contradict each other or the model; amber where something is off.
    pub fn colour(&self) -> Colour {
        let doubts = self.doubts.iter().map(Doubt::colour).max().unwrap_or_default();
        let Some(all) = self.sets.first() else { return doubts };
        let most = (MOST_IMPOSSIBLE * all.n as f64).max(1.0);
        let is_absurd = self.is_misfit() && all.share() < ABSURD;
        let own = match () {
            () if self.n_impossible as f64 > most || is_absurd => Colour::Red,
            () if self.n_impossible > 0 || self.is_misfit() => Colour::Amber,
            () => Colour::Green,
        };
        own.max(doubts)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn within(name: &str, n: usize, inside: usize) -> Within {
        Within { name: name.to_owned(), n, inside }
    }

    /// Binomial tails by hand: P(X ≥ 3 of 3) = 0.001, P(X ≥ 1 of 2) = 0.19, P(X ≥ 2 of 3) = 0.028.
    #[test]
    fn the_tail_is_binomial() {
        for (n, inside, p) in [(3, 0, 0.001), (2, 1, 0.19), (3, 1, 0.028), (7, 7, 1.0)] {
            let found = within("", n, inside).p_value();
            assert!((found - p).abs() < 1e-12, "{n} {inside}: {found} {p}");
        }
    }

    #[test]
    fn few_in_their_intervals_is_amber_and_very_few_is_red() {
        let colour = |sets: &[Within]| Fits::new(sets, 1).colour();
        assert_eq!(colour(&[within("all", 20, 18)]), Colour::Green);
        assert_eq!(colour(&[within("all", 40, 28)]), Colour::Amber);
        assert_eq!(colour(&[within("all", 20, 9)]), Colour::Red);
        // 87 % of very many rows is no chance, but good enough
        assert_eq!(colour(&[within("all", 10_000, 8700)]), Colour::Green);
        // one site with four rows, all of them outside, among ten
        let site = [within("all", 40, 36), within("site", 4, 0)];
        assert_eq!(colour(&site), Colour::Amber);
        // three sets of ten: 0.028 · 11 is no evidence
        let site = [within("all", 30, 28), within("site", 3, 1)];
        assert_eq!(colour(&site), Colour::Green);
    }

    #[test]
    fn impossible_rows_and_doubts_count() {
        let mut fits = Fits::new(&[within("all", 20, 19)], 1);
        fits.n_impossible = 1;
        assert_eq!(fits.colour(), Colour::Amber);
        fits.n_impossible = 2;
        assert_eq!(fits.colour(), Colour::Red);
        fits.n_impossible = 0;
        let doubt = |n| Doubt::Range {
            observe: "s1s2".to_owned(),
            unit: "ms".to_owned(),
            n,
            of: 10,
            lines: vec![],
            measured: [0.2, 0.3],
            expected: [100.0, 280.0],
            factor: Some(1000.0),
        };
        fits.doubts = vec![doubt(1)];
        assert_eq!(fits.colour(), Colour::Amber);
        fits.doubts = vec![doubt(1), doubt(10)];
        assert_eq!(fits.colour(), Colour::Red);
    }
}
