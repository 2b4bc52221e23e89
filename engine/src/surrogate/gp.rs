//! A Gaussian process over a few inputs, with its own idea of how wrong it is.
//!
//! Knows inputs and one output as numbers; it knows nothing of what they mean.
//!
//! ```text
//! y = hᵀβ + f + ε,   h = (1, x),   f ~ GP(0, σ² exp(−½ Σ_d ((x_d − x'_d)/ℓ_d)²)),   ε ~ N(0, σ² g),   β flat
//! ```
//! The nugget g stands for everything that the inputs leave open: parameters that vary without
//! being inputs, and the rounding of the output. ℓ and g maximise the restricted likelihood times a
//! weak prior of ℓ. In this likelihood β and σ² have closed forms.
//!
//! Let R be the correlations of the points. Everything follows from the inverse of one matrix:
//!
//! ```text
//! [R + gI  H]⁻¹   [Q  B]
//! [Hᵀ      0]   = [Bᵀ C] = M,      σ² = yᵀQy/(n − p),      ln L = −½ ln|det M⁻¹| − ½ (n − p) ln σ²
//! mean(x) = cᵀ M (y, 0),   variance(x) = σ² (1 + g − cᵀ M c),   c = (r(x), h(x))
//! left out: yᵢ − mean₋ᵢ(xᵢ) = (Qy)ᵢ/Qᵢᵢ,   variance₋ᵢ(xᵢ) = σ²/Qᵢᵢ
//! ```
//! An output may vary faster in one corner than elsewhere. One σ² for all is then too small. So it
//! is raised until points left out are off by one predictive standard deviation, root mean square.
//!
//! # Source
//! Santner, Williams and Notz 2018, "The Design and Analysis of Computer Experiments", 3.3 and 4.1; Dubrule 1983
//! (points left out); Rasmussen and Williams 2006, 5.4.2 and 5.4.3 (choosing by them, several maxima).

use thiserror::Error;

use self::evidence::{Points, System, correlation, scaled, shrink};
use super::design::latin_hypercube;
use crate::infer::{OptimumSettings, maximise};

#[path = "gp_evidence.rs"]
mod evidence;

/// ln ℓ and ln g from which the search begins. ℓ is in half widths of the inputs' ranges, and the
/// same for all inputs.
const STARTS: [(f64, f64); 2] = [(0.0, -4.0), (1.2, -8.0)];

/// Number of further starts. They are a Latin hypercube over the ranges of ln ℓ (of each input) and
/// of ln g below.
const N_FURTHER: usize = 4;
const START_RANGES: [(f64, f64); 2] = [(-1.0, 2.5), (-12.0, -1.0)];

/// A Gaussian process given points.
#[derive(Debug, Clone)]
pub struct Gp {
    points: Points,
    ln_lengthscales: Vec<f64>,
    system: System,
    raised: f64,
}

/// A point that was left out: what the others say of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeftOut {
    /// The output less the others' prediction.
    pub error: f64,
    /// The others' predictive variance.
    pub variance: f64,
}

/// Points that determine no Gaussian process.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum GpError {
    /// Fewer than the mean and a few lengthscales need.
    #[error(
        "a Gaussian process of {n_inputs} inputs needs at least {needed} points, but only {n_points} are left after filtering\n\
         help: use a larger design (100 points) or a wider filter"
    )]
    TooFewPoints {
        /// Points given.
        n_points: usize,
        /// Inputs.
        n_inputs: usize,
        /// Points needed.
        needed: usize,
    },
    /// None.
    #[error(
        "no point is left after filtering\nhelp: use a larger design (100 points) or a wider filter"
    )]
    NoPoints,
    /// An input, or the output, is the same at all points, or the inputs depend on each other.
    #[error(
        "the {n_points} points determine no Gaussian process: an input or the output does not vary\n\
         help: use a design that varies every input, as `eplat surrogate design` makes"
    )]
    Degenerate {
        /// Points given.
        n_points: usize,
    },
}

/// ln ℓ of each input and ln g.
fn starts(n_inputs: usize) -> Vec<Vec<f64>> {
    let alike = |(ln_lengthscale, ln_nugget)| {
        let mut start = vec![ln_lengthscale; n_inputs];
        start.push(ln_nugget);
        start
    };
    let mut ranges = vec![START_RANGES[0]; n_inputs];
    ranges.push(START_RANGES[1]);
    let further = latin_hypercube(N_FURTHER, &ranges, 1);
    STARTS.into_iter().map(alike).chain(further).collect()
}

impl Gp {
    /// The process given `outputs` `(n)` at `inputs` `(n, n_inputs)`. There may be several maxima;
    /// this is the one that best predicts points left out.
    ///
    /// # Errors
    /// [`GpError`]
    pub fn fit(inputs: &[Vec<f64>], outputs: &[f64]) -> Result<Self, GpError> {
        let best = |a: &Self, b: &Self| a.left_out_rmse().total_cmp(&b.left_out_rmse());
        Self::maxima(inputs, outputs)?
            .min_by(best)
            .ok_or(GpError::Degenerate { n_points: outputs.len() })
    }

    /// As [`Gp::fit`], but the maximum that is reached from equal lengthscales, which is the
    /// smoothest. Shares of variance are taken from this one, since a rougher process puts its
    /// roughness into interactions.
    ///
    /// # Errors
    /// [`GpError`]
    pub fn smooth(inputs: &[Vec<f64>], outputs: &[f64]) -> Result<Self, GpError> {
        Self::maxima(inputs, outputs)?.next().ok_or(GpError::Degenerate { n_points: outputs.len() })
    }

    /// The processes at the maxima that are reached from each start.
    fn maxima(inputs: &[Vec<f64>], outputs: &[f64]) -> Result<impl Iterator<Item = Self>, GpError> {
        if outputs.is_empty() {
            return Err(GpError::NoPoints);
        }
        let points = Points::new(inputs, outputs);
        let (n_points, n_inputs) = (outputs.len(), points.scales.len());
        let needed = points.n_terms() + n_inputs + 3;
        if n_points < needed {
            return Err(GpError::TooFewPoints { n_points, n_inputs, needed });
        }
        let varies = |y: &f64| (y - outputs[0]).abs() > 1e-12 * outputs[0].abs();
        if !outputs.iter().any(varies) || points.scales.iter().any(|(_, half)| !(*half > 0.0)) {
            return Err(GpError::Degenerate { n_points });
        }
        Ok(starts(n_inputs).into_iter().filter_map(move |start| Self::climb(&points, &start)))
    }

    /// The process at the maximum that is reached from `start`.
    fn climb(points: &Points, start: &[f64]) -> Option<Self> {
        let settings =
            OptimumSettings { max_iterations: 100, gradient_tolerance: 1e-3, least_gain: 1e-4 };
        let optimum = maximise(points, start, &settings).ok()?;
        let (&ln_nugget, ln_lengthscales) = optimum.position.split_last()?;
        let system = points.system(ln_lengthscales, ln_nugget)?;
        let (points, ln_lengthscales) = (points.clone(), ln_lengthscales.to_vec());
        let mut gp = Self { ln_lengthscales, points, system, raised: 1.0 };
        let ratios = gp.leave_one_out().into_iter().map(|l| l.error * l.error / l.variance);
        let mean = ratios.sum::<f64>() / gp.n_points() as f64;
        if mean > 1.0 {
            gp.system.variance *= mean;
            gp.raised = mean.sqrt();
        }
        Some(gp)
    }

    /// Root mean square error at points left out, in the unit of the output.
    pub fn left_out_rmse(&self) -> f64 {
        let squares: f64 = self.leave_one_out().iter().map(|l| l.error * l.error).sum();
        (squares / self.n_points() as f64).sqrt()
    }

    /// The factor by which the standard deviations were raised to fit the points left out; 1 if not
    /// at all.
    pub fn raised(&self) -> f64 {
        self.raised
    }

    /// Points given.
    pub fn n_points(&self) -> usize {
        self.points.y.len()
    }

    /// Lengthscale of each input, in its own unit.
    pub fn lengthscales(&self) -> Vec<f64> {
        let scales = self.points.scales.iter();
        scales.zip(&self.ln_lengthscales).map(|((_, half), l)| half * l.exp()).collect()
    }

    /// Standard deviation of what the inputs leave open, in the unit of the output.
    pub fn nugget_sd(&self) -> f64 {
        (self.system.variance * self.system.nugget).sqrt()
    }

    /// The prediction at `x`, in the unit of the output.
    pub fn mean(&self, x: &[f64]) -> f64 {
        self.features(x).iter().zip(&self.system.weights).map(|(c, w)| c * w).sum()
    }

    /// Variance of an output at `x`, nugget included, in its unit squared.
    pub fn variance(&self, x: &[f64]) -> f64 {
        let c = self.features(x);
        let explained: f64 = c
            .iter()
            .enumerate()
            .map(|(j, cj)| {
                let column = self.system.inverse.col(j);
                cj * c.iter().zip(column.iter()).map(|(ci, m)| ci * m).sum::<f64>()
            })
            .sum();
        self.system.variance * (1.0 + self.system.nugget - explained)
    }

    /// c = (r(x), h(x))
    fn features(&self, x: &[f64]) -> Vec<f64> {
        let x = scaled(x, &self.points.scales);
        let shrunk = shrink(&x, &self.ln_lengthscales);
        let of = |point: &Vec<f64>| correlation(&shrink(point, &self.ln_lengthscales), &shrunk);
        let correlations = self.points.x.iter().map(of);
        correlations.chain([1.0]).chain(x).collect()
    }

    /// Each point as the others predict it, with the same lengthscales and nugget.
    pub fn leave_one_out(&self) -> Vec<LeftOut> {
        let s = &self.system;
        let one = |(i, weight): (usize, &f64)| {
            let own = s.inverse[(i, i)];
            LeftOut { error: weight / own, variance: s.variance / own }
        };
        s.weights[..self.n_points()].iter().enumerate().map(one).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn smooth(x: &[f64]) -> f64 {
        200.0 + 5.0 * x[0] + 20.0 * (0.02 * x[1]).sin() + 0.02 * x[0] * x[1]
    }

    fn noise(i: usize) -> f64 {
        0.5 * (12.9898 * i as f64).sin() * (78.233 * i as f64).cos()
    }

    pub(super) fn sampled(n: usize, size: f64) -> (Vec<Vec<f64>>, Vec<f64>) {
        let x = latin_hypercube(n, &[(1.0, 30.0), (120.0, 270.0)], 3);
        let y = x.iter().enumerate().map(|(i, x)| smooth(x) + size * noise(i)).collect();
        (x, y)
    }

    #[test]
    fn a_smooth_function_is_learnt_and_its_noise_too() {
        let (x, y) = sampled(60, 0.0);
        let exact = Gp::fit(&x, &y).unwrap();
        let (x, y) = sampled(60, 2.0);
        let noisy = Gp::fit(&x, &y).unwrap();
        let mut worst = 0f64;
        for i in 0..20 {
            let at = [2.0 + 1.3 * f64::from(i), 130.0 + 6.5 * f64::from((7 * i) % 20)];
            worst = worst.max((exact.mean(&at) - smooth(&at)).abs());
            let (error, sd) = (noisy.mean(&at) - smooth(&at), noisy.variance(&at).sqrt());
            assert!(error.abs() < 4.0 * sd, "{at:?}: {error} {sd}, {:?}", noisy.lengthscales());
        }
        assert!(worst < 0.02, "{worst}");
        let rms = (x.iter().enumerate().map(|(i, _)| (2.0 * noise(i)).powi(2)).sum::<f64>() / 60.0)
            .sqrt();
        let sd = noisy.nugget_sd();
        assert!((sd / rms - 1.0).abs() < 0.2 && exact.nugget_sd() < 0.02, "{sd} {rms}");
    }

    /// The closed form against conditioning on the others, at the same lengthscales and nugget.
    #[test]
    fn leaving_one_out_is_predicting_from_the_others() {
        let (x, y) = sampled(20, 1.0);
        let all = Points::new(&x, &y);
        let (ln_lengthscales, ln_nugget) = ([0.3, 0.1], -4.0);
        let system = all.system(&ln_lengthscales, ln_nugget).unwrap();
        let variance = system.variance;
        let gp = Gp {
            points: all.clone(),
            ln_lengthscales: ln_lengthscales.to_vec(),
            system,
            raised: 1.0,
        };
        for (i, left_out) in gp.leave_one_out().into_iter().enumerate() {
            let mut others = all.clone();
            let (at, y) = (x[i].clone(), others.y.remove(i));
            others.x.remove(i);
            let system = others.system(&ln_lengthscales, ln_nugget).unwrap();
            // σ² as all points have it
            let system = System { variance, ..system };
            let without = Gp {
                points: others,
                ln_lengthscales: ln_lengthscales.to_vec(),
                system,
                raised: 1.0,
            };
            assert!((left_out.error - (y - without.mean(&at))).abs() < 1e-6);
            let ratio = left_out.variance / without.variance(&at);
            assert!((ratio - 1.0).abs() < 1e-6, "{ratio}");
        }
    }

    /// A step at the edge that few of the points see: from equal lengthscales the search ends where it is noise.
    #[test]
    fn a_start_that_ends_on_a_lower_maximum_is_escaped() {
        let x = latin_hypercube(60, &[(0.0, 1.0), (0.0, 1.0)], 3);
        let step = |x: &Vec<f64>| 0.5 * (-x[1] / 0.02).exp() * (1.0 + x[0]);
        let y: Vec<f64> = x.iter().map(|x| (3.0 * x[0]).sin() + x[1] + step(x)).collect();
        let points = Points::new(&x, &y);
        let alike: Vec<Gp> =
            starts(2)[..2].iter().map(|start| Gp::climb(&points, start).unwrap()).collect();
        let best = Gp::fit(&x, &y).unwrap();
        for stuck in alike {
            assert!(best.system.ln_evidence > stuck.system.ln_evidence + 10.0);
            assert!(best.left_out_rmse() < 0.7 * stuck.left_out_rmse());
        }
    }

    #[test]
    fn too_few_points_or_an_input_that_does_not_vary_are_refused() {
        let (x, y) = sampled(60, 1.0);
        let few = Gp::fit(&x[..7], &y[..7]).err();
        assert_eq!(few, Some(GpError::TooFewPoints { n_points: 7, n_inputs: 2, needed: 8 }));
        let flat: Vec<Vec<f64>> = x.iter().map(|x| vec![x[0], 5.0]).collect();
        let degenerate = Some(GpError::Degenerate { n_points: 60 });
        assert_eq!(Gp::fit(&flat, &y).err(), degenerate);
        assert_eq!(Gp::fit(&x, &[3.0; 60]).err(), degenerate);
    }
}
