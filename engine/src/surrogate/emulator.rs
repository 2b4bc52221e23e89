//! The form in which a model evaluates a Gaussian process: polynomials for its mean and for the
//! logarithm of its sd.
//!
//! Knows a box of inputs and two lists of terms. It knows nothing of what they mean. A Gaussian
//! process of 63 points costs 4000 multiplications for one sd. Both polynomials together cost some
//! hundred, and carry derivatives.
//!
//! ```text
//! f(x) = Σ c T_i(u₁) … T_k(u_D),   u_d = x_d scaled from its range to −1..1,   T_i Chebyshev's polynomials
//! ```
//! Of all terms up to degree 8 only a few are kept: those that bring the polynomials near the
//! process over the box. A difference counts in predictive standard deviations of the process, so
//! where the process knows little, its mean need not be followed. What difference is left adds to
//! the sd.
//!
//! Beyond the range of an input, the mean goes on as a straight line, and the sd keeps its value at
//! the end.

use std::borrow::Cow;
use std::fmt::Write as _;

use crate::random::procedure;

use super::chebyshev::{DEGREE, Derivatives, Higher, Term, value_and_slopes};
use super::design::random_hypercube;
use super::gp::Gp;
use super::sparse::few_terms;
use crate::num::{Real, exp};

/// Most terms of the mean, and of ln sd.
const MOST_TERMS: usize = 120;

/// How far the mean may be off, in predictive standard deviations, and how far ln sd may be off;
/// both root mean square.
const TOLERANCE: f64 = 0.4;
const LN_SD_TOLERANCE: f64 = 0.1;

/// Number of points of the box at which terms are fitted. They are judged at as many others.
const N_POINTS: usize = 2000;

/// The mean and standard deviation of an output at D inputs.
#[derive(Debug, Clone, PartialEq)]
pub struct Emulator<const D: usize> {
    /// Lower and upper end of each input.
    pub ranges: [(f64, f64); D],
    /// Terms of the mean.
    pub mean: Cow<'static, [Term<D>]>,
    /// Terms of the logarithm of the standard deviation.
    pub ln_sd: Cow<'static, [Term<D>]>,
}

/// How far an emulator is from its Gaussian process over the box, root mean square.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Departure {
    /// Difference of the means in predictive standard deviations.
    pub mean: f64,
    /// Relative difference of the standard deviations.
    pub sd: f64,
}

impl<const D: usize> Emulator<D> {
    /// The predicted output at `x`.
    #[inline]
    pub fn mean<T: Real>(&self, x: [T; D]) -> T {
        self.lift(&self.mean, x, true)
    }

    /// Standard deviation of an output at `x`, in its unit. It holds both how well the prediction
    /// is known and what the inputs leave open.
    #[inline]
    pub fn sd<T: Real>(&self, x: [T; D]) -> T {
        exp(self.lift(&self.ln_sd, x, false))
    }

    /// Whether every input is in its range.
    pub fn covers(&self, x: [f64; D]) -> bool {
        x.iter().zip(self.ranges).all(|(x, (lower, upper))| (lower..=upper).contains(x))
    }

    /// A polynomial at numbers that carry derivatives.
    #[inline]
    fn lift<T: Real>(&self, terms: &[Term<D>], x: [T; D], goes_on: bool) -> T {
        let real = x.map(|x| x.re());
        let (value, slope) = value_and_slopes(terms, real, &self.ranges, goes_on);
        let step = x.map(|x| x - x.re());
        let mut sum = T::from(value);
        for (step, slope) in step.iter().zip(slope) {
            sum += *step * slope;
        }
        if T::ORDER < 2 {
            return sum;
        }
        let how = Derivatives { goes_on, order: T::ORDER };
        let at = Higher::of(terms, real, &self.ranges, how);
        for d in 0..D {
            for e in 0..D {
                let square = step[d] * step[e];
                sum += square * (0.5 * at.curvature[d][e]);
                for (step, third) in step.iter().zip(&at.third[d][e]) {
                    if T::ORDER > 2 {
                        sum += square * *step * (third / 6.0);
                    }
                }
            }
        }
        sum
    }

    /// Makes the emulator of `gp` over `ranges`, and says how far it is from `gp`.
    pub fn of(gp: &Gp, ranges: [(f64, f64); D]) -> (Self, Departure) {
        let [fitted, judged] = [1, 2].map(|seed| Sampled::of(gp, &ranges, seed));
        let degrees = degrees_up_to::<D>(DEGREE);
        let columns: Vec<Vec<f64>> = degrees.iter().map(|of| fitted.column(of, &ranges)).collect();
        let weighted = |values: &[f64]| -> Vec<f64> {
            values.iter().zip(&fitted.ln_sd).map(|(value, ln_sd)| value / ln_sd.exp()).collect()
        };
        let scaled: Vec<Vec<f64>> = columns.iter().map(|column| weighted(column)).collect();
        let terms = |(place, c): (usize, f64)| (degrees[place], c);
        let mean = few_terms(&scaled, &weighted(&fitted.mean), TOLERANCE, MOST_TERMS);
        let ln_sd = few_terms(&columns, &fitted.ln_sd, LN_SD_TOLERANCE, MOST_TERMS);
        let mut emulator = Self {
            ranges,
            mean: mean.into_iter().map(terms).collect(),
            ln_sd: ln_sd.into_iter().map(terms).collect(),
        };
        let departure = judged.departure(&emulator);
        // the constant, if there is one, is first
        let wider = 0.5 * departure.mean.powi(2).ln_1p();
        let ln_sd = emulator.ln_sd.to_mut();
        match ln_sd.first_mut() {
            Some((of, constant)) if *of == [0; D] => *constant += wider,
            _ => ln_sd.insert(0, ([0; D], wider)),
        }
        (emulator, departure)
    }

    /// Rust source of a static `name`. The file that includes it must have `Emulator` in scope.
    pub fn to_rust(&self, name: &str, doc: &str) -> String {
        let mut text = String::new();
        for line in doc.lines() {
            let _ = writeln!(text, "{}", format!("/// {line}").trim_end());
        }
        let _ = writeln!(
            text,
            "#[rustfmt::skip]\npub(super) static {name}: Emulator<{D}> = Emulator {{\n    \
             ranges: {:?},",
            self.ranges
        );
        for (field, terms) in [("mean", &self.mean), ("ln_sd", &self.ln_sd)] {
            let _ = writeln!(text, "    {field}: std::borrow::Cow::Borrowed(&[");
            for line in terms.chunks(4) {
                let cells: Vec<String> =
                    line.iter().map(|(of, c)| format!("({of:?}, {c:.6e})")).collect();
                let _ = writeln!(text, "        {},", cells.join(", "));
            }
            text.push_str("    ]),\n");
        }
        text + "};\n"
    }
}

/// A Gaussian process at points of the box.
struct Sampled<const D: usize> {
    x: Vec<[f64; D]>,
    mean: Vec<f64>,
    ln_sd: Vec<f64>,
}

impl<const D: usize> Sampled<D> {
    fn of(gp: &Gp, ranges: &[(f64, f64); D], seed: u64) -> Self {
        let unit = random_hypercube(N_POINTS, D, &mut procedure(seed));
        let place = |u: &Vec<f64>, d: usize| ranges[d].0 + u[d] * (ranges[d].1 - ranges[d].0);
        let x: Vec<[f64; D]> = unit.iter().map(|u| std::array::from_fn(|d| place(u, d))).collect();
        let mean = x.iter().map(|x| gp.mean(x)).collect();
        let ln_sd = x.iter().map(|x| 0.5 * gp.variance(x).ln()).collect();
        Self { x, mean, ln_sd }
    }

    /// The product of Chebyshev's polynomials `of` at every point.
    fn column(&self, of: &[u8; D], ranges: &[(f64, f64); D]) -> Vec<f64> {
        let polynomial = |x: &[f64; D], d: usize| {
            let (lower, upper) = ranges[d];
            let u = (2.0 * x[d] - lower - upper) / (upper - lower);
            (f64::from(of[d]) * u.clamp(-1.0, 1.0).acos()).cos()
        };
        self.x.iter().map(|x| (0..D).map(|d| polynomial(x, d)).product()).collect()
    }

    fn departure(&self, emulator: &Emulator<D>) -> Departure {
        let [mut mean, mut sd] = [0.0; 2];
        for ((&x, at), ln_sd) in self.x.iter().zip(&self.mean).zip(&self.ln_sd) {
            mean += ((emulator.mean(x) - at) / ln_sd.exp()).powi(2);
            sd += (emulator.sd(x) / ln_sd.exp() - 1.0).powi(2);
        }
        let n = self.x.len() as f64;
        Departure { mean: (mean / n).sqrt(), sd: (sd / n).sqrt() }
    }
}

/// The degrees of every product up to `total`, the constant first.
fn degrees_up_to<const D: usize>(total: usize) -> Vec<[u8; D]> {
    let mut all = vec![[0; D]];
    for d in 0..D {
        let of = |of: [u8; D]| {
            let used: u8 = of.iter().sum();
            (0..=total as u8 - used).map(move |degree| {
                let mut of = of;
                of[d] = degree;
                of
            })
        };
        all = all.into_iter().flat_map(of).collect();
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::{Hyper, Third, derivatives, variable};

    const RANGES: [(f64, f64); 2] = [(1.0, 30.0), (120.0, 270.0)];

    /// 200 + 4 u − 3 u v + 2 v³ of the scaled inputs u, v.
    fn cubic(x: &[f64]) -> f64 {
        let (u, v) = ((x[0] - 15.5) / 14.5, (x[1] - 195.0) / 75.0);
        200.0 + 4.0 * u - 3.0 * u * v + 2.0 * v.powi(3)
    }

    fn emulator() -> Emulator<2> {
        // v³ = (3 T_1 + T_3)/4
        let mean =
            vec![([0, 0], 200.0), ([0, 1], 1.5), ([0, 3], 0.5), ([1, 0], 4.0), ([1, 1], -3.0)];
        let ln_sd = vec![([0, 0], 0.3), ([0, 1], -0.75), ([1, 0], 1.45)];
        Emulator { ranges: RANGES, mean: mean.into(), ln_sd: ln_sd.into() }
    }

    #[test]
    fn polynomials_of_its_degree_are_exact_and_carry_derivatives() {
        let e = emulator();
        for x in [[1.0, 120.0], [7.3, 181.0], [30.0, 270.0]] {
            assert!((e.mean(x) - cubic(&x)).abs() < 1e-10);
            let (u, v) = ((x[0] - 15.5) / 14.5, (x[1] - 195.0) / 75.0);
            assert!((e.sd(x).ln() - 0.3 + 0.75 * v - 1.45 * u).abs() < 1e-12);
        }
        let (t, a) = (7.3, 181.0);
        let slopes = derivatives(&e.mean([variable::<2>(t, 0), variable(a, 1)]));
        let (u, v) = ((t - 15.5) / 14.5, (a - 195.0) / 75.0);
        assert!((slopes[0] - (4.0 - 3.0 * v) / 14.5).abs() < 1e-13);
        assert!((slopes[1] - (6.0 * v * v - 3.0 * u) / 75.0).abs() < 1e-13);
        let [tt, ta, aa] = [(0, 0), (0, 1), (1, 1)].map(|(d, k)| {
            let seed = |i: usize| [f64::from(d == i), f64::from(k == i)];
            let number = |x: f64, [a, b]: [f64; 2]| Hyper::new(x, a, b, 0.0);
            e.mean([number(t, seed(0)), number(a, seed(1))]).eps1eps2
        });
        assert!(tt.abs() < 1e-15 && (ta + 3.0 / (14.5 * 75.0)).abs() < 1e-15);
        assert!((aa - 12.0 * v / (75.0 * 75.0)).abs() < 1e-15);
        let number = |x: f64, by: f64| Third::new(x, by, by, by, 0.0, 0.0, 0.0, 0.0);
        let aaa = e.mean([number(t, 0.0), number(a, 1.0)]).eps1eps2eps3;
        assert!((aaa - 12.0 / 75f64.powi(3)).abs() < 1e-15);
    }

    #[test]
    fn beyond_its_ranges_the_mean_goes_on_straight_and_the_sd_stays() {
        let e = emulator();
        let at = |t: f64, a: f64| e.mean([t, a]);
        let slope = (at(30.0, 150.0) - at(29.9999, 150.0)) / 1e-4;
        assert!((at(40.0, 150.0) - at(30.0, 150.0) - 10.0 * slope).abs() < 1e-3);
        let below = derivatives(&e.mean([variable::<2>(-5.0, 0), variable(100.0, 1)]));
        assert!((below[0] - (at(1.0, 100.0) - at(0.0, 100.0))).abs() < 1e-9);
        let sd = e.sd([variable::<2>(40.0, 0), variable(150.0, 1)]);
        assert!((sd.re - e.sd([30.0, 150.0])).abs() < 1e-12);
        assert!(derivatives(&sd)[0].abs() < 1e-300 && derivatives(&sd)[1] < 0.0);
        assert!(e.covers([30.0, 270.0]) && !e.covers([30.1, 200.0]));
    }

    #[test]
    fn it_stands_for_its_process() {
        let x = crate::surrogate::design::latin_hypercube(60, &RANGES, 3);
        let rough = |i: usize| 0.5 * (17.0 * i as f64).sin();
        let y: Vec<f64> =
            x.iter().enumerate().map(|(i, x)| cubic(x) + (0.1 * x[0]).sin() + rough(i)).collect();
        let gp = Gp::fit(&x, &y).unwrap();
        let (emulator, departure) = Emulator::of(&gp, RANGES);
        assert!(
            departure.mean < 1.2 * TOLERANCE && departure.sd < 1.2 * LN_SD_TOLERANCE,
            "{departure:?}"
        );
        let text = emulator.to_rust("ERP", "Of a test.");
        assert!(
            text.starts_with(
                "/// Of a test.\n#[rustfmt::skip]\npub(super) static ERP: Emulator<2> ="
            )
        );
    }
}
