//! A Gaussian process as a model evaluates it: its mean and the logarithm of its sd as polynomials.
//!
//! Knows a box of inputs and two sets of coefficients; it knows nothing of what they mean. A process of
//! 63 points costs 4000 multiplications per sd; both polynomials together cost some hundred, and carry derivatives.
//!
//! ```text
//! f(x) = Σ c_{i…k} T_i(u₁) … T_k(u_D),   u_d = x_d scaled from its range to −1..1,   T_i Chebyshev's polynomials
//! ```
//! Beyond its range each `T_i` goes on straight in the mean and stays what it is at the end in the sd.

use std::borrow::Cow;
use std::fmt::Write as _;

use super::gp::Gp;
use crate::num::Real;

/// Most terms per input.
const MOST_TERMS: usize = 12;

/// Terms are added until the mean is off by less than this many predictive standard deviations.
const TOLERANCE: f64 = 0.1;

/// The mean and standard deviation of an output at D inputs.
#[derive(Debug, Clone, PartialEq)]
pub struct Emulator<const D: usize> {
    /// Lower and upper end of each input.
    pub ranges: [(f64, f64); D],
    /// Terms per input, at most 12.
    pub n_terms: usize,
    /// Coefficients of the mean, `(n_terms, …, n_terms)`, the last input's index fastest.
    pub mean: Cow<'static, [f64]>,
    /// The same of the logarithm of the standard deviation.
    pub ln_sd: Cow<'static, [f64]>,
}

/// How far an emulator is from its Gaussian process, in predictive standard deviations of that.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Departure {
    /// Largest difference of the means.
    pub mean: f64,
    /// Largest difference of the standard deviations.
    pub sd: f64,
}

impl<const D: usize> Emulator<D> {
    /// The predicted output at `x`.
    #[inline]
    pub fn mean<T: Real>(&self, x: [T; D]) -> T {
        self.lift(&self.mean, x, true)
    }

    /// Standard deviation of an output at `x`, in its unit: how well the prediction is known, and what the inputs
    /// leave open.
    #[inline]
    pub fn sd<T: Real>(&self, x: [T; D]) -> T {
        self.lift(&self.ln_sd, x, false).exp()
    }

    /// Whether every input is in its range.
    pub fn covers(&self, x: [f64; D]) -> bool {
        x.iter().zip(self.ranges).all(|(x, (lower, upper))| (lower..=upper).contains(x))
    }

    /// A polynomial at numbers that carry derivatives: its Taylor polynomial in what they carry.
    #[inline]
    fn lift<T: Real>(&self, coefficients: &[f64], x: [T; D], goes_on: bool) -> T {
        let at = self.partials(coefficients, x.map(|x| x.re()), goes_on, T::SECOND);
        let step = x.map(|x| x - x.re());
        let mut sum = T::from(at.value);
        for d in 0..D {
            sum += step[d] * at.slope[d];
            for e in 0..D {
                if T::SECOND {
                    sum += step[d] * step[e] * (0.5 * at.curvature[d][e]);
                }
            }
        }
        sum
    }

    /// Not inlined: compiled with eplat, not again with every model.
    #[inline(never)]
    fn partials(
        &self,
        coefficients: &[f64],
        x: [f64; D],
        goes_on: bool,
        second: bool,
    ) -> Partials<D> {
        let bases =
            std::array::from_fn(|d| Basis::new(x[d], self.ranges[d], self.n_terms, goes_on));
        if second {
            Partials::sum::<true>(coefficients, &bases, 0, self.n_terms)
        } else {
            Partials::sum::<false>(coefficients, &bases, 0, self.n_terms)
        }
    }

    /// The emulator of `gp` over `ranges`, and how well it stands for it.
    pub fn of(gp: &Gp, ranges: [(f64, f64); D]) -> (Self, Departure) {
        let mut n_terms = 4;
        loop {
            let mean = interpolate(|x| gp.mean(x), &ranges, n_terms).into();
            let ln_sd = interpolate(|x| 0.5 * gp.variance(x).ln(), &ranges, n_terms).into();
            let emulator = Self { ranges, n_terms, mean, ln_sd };
            let departure = emulator.departure(gp);
            if departure.mean < TOLERANCE || n_terms == MOST_TERMS {
                return (emulator, departure);
            }
            n_terms += 2;
        }
    }

    /// On a grid of seven values of each input, ends included.
    fn departure(&self, gp: &Gp) -> Departure {
        let mut worst = Departure { mean: 0.0, sd: 0.0 };
        for index in 0..7usize.pow(D as u32) {
            let x: [f64; D] = std::array::from_fn(|d| {
                let (lower, upper) = self.ranges[d];
                lower + (upper - lower) * (index / 7usize.pow(d as u32) % 7) as f64 / 6.0
            });
            let sd = gp.variance(&x).sqrt();
            worst.mean = worst.mean.max((self.mean(x) - gp.mean(&x)).abs() / sd);
            worst.sd = worst.sd.max((self.sd(x) / sd - 1.0).abs());
        }
        worst
    }

    /// Rust source of a static `name`; the file that includes it has `Emulator` in scope.
    pub fn to_rust(&self, name: &str, doc: &str) -> String {
        let mut text = String::new();
        for line in doc.lines() {
            let _ = writeln!(text, "{}", format!("/// {line}").trim_end());
        }
        let _ = writeln!(
            text,
            "#[rustfmt::skip]\npub(super) static {name}: Emulator<{D}> = Emulator {{\n    \
             ranges: {:?},\n    n_terms: {},",
            self.ranges, self.n_terms
        );
        for (field, coefficients) in [("mean", &self.mean), ("ln_sd", &self.ln_sd)] {
            let _ = writeln!(text, "    {field}: std::borrow::Cow::Borrowed(&[");
            for row in coefficients.chunks(self.n_terms) {
                let cells: Vec<String> = row.iter().map(|c| format!("{c:.6e}")).collect();
                let _ = writeln!(text, "        {},", cells.join(", "));
            }
            text.push_str("    ]),\n");
        }
        text + "};\n"
    }
}

/// `T_0` … at one input, and their first and second derivatives in it.
struct Basis([[f64; MOST_TERMS]; 3]);

impl Basis {
    /// `goes_on` says whether the terms go on straight beyond the range, or stay what they are at its end.
    fn new(x: f64, (lower, upper): (f64, f64), n_terms: usize, goes_on: bool) -> Self {
        let slope = 2.0 / (upper - lower);
        let u = (x - 0.5 * (lower + upper)) * slope;
        let end = u.clamp(-1.0, 1.0);
        let [mut t, mut dt, mut ddt] = [[0.0; MOST_TERMS]; 3];
        (t[0], t[1], dt[1]) = (1.0, end, slope);
        for i in 2..n_terms {
            t[i] = 2.0 * end * t[i - 1] - t[i - 2];
            dt[i] = 2.0 * (slope * t[i - 1] + end * dt[i - 1]) - dt[i - 2];
            ddt[i] = 2.0 * (2.0 * slope * dt[i - 1] + end * ddt[i - 1]) - ddt[i - 2];
        }
        let beyond = (u - end) / slope;
        if !(beyond == 0.0) {
            for i in 0..n_terms {
                (t[i], ddt[i]) = (t[i] + if goes_on { beyond * dt[i] } else { 0.0 }, 0.0);
                dt[i] = if goes_on { dt[i] } else { 0.0 };
            }
        }
        Self([t, dt, ddt])
    }
}

/// A function's value and derivatives at a point.
struct Partials<const D: usize> {
    value: f64,
    slope: [f64; D],
    curvature: [[f64; D]; D],
}

impl<const D: usize> Partials<D> {
    /// Σ coefficients × products of one term of each input from the `d`-th on, the last innermost; curvatures if `SECOND`.
    fn sum<const SECOND: bool>(
        coefficients: &[f64],
        bases: &[Basis; D],
        d: usize,
        n_terms: usize,
    ) -> Self {
        let mut sum = Self { value: 0.0, slope: [0.0; D], curvature: [[0.0; D]; D] };
        let Basis([t, dt, ddt]) = &bases[d];
        let size = n_terms.pow((D - 1 - d) as u32);
        if d + 1 == D {
            for (i, c) in coefficients[..n_terms].iter().enumerate() {
                sum.value += t[i] * c;
                sum.slope[d] += dt[i] * c;
                if SECOND {
                    sum.curvature[d][d] += ddt[i] * c;
                }
            }
            return sum;
        }
        for (i, chunk) in coefficients.chunks_exact(size).enumerate() {
            let within = Self::sum::<SECOND>(chunk, bases, d + 1, n_terms);
            sum.value += t[i] * within.value;
            sum.slope[d] += dt[i] * within.value;
            for e in d + 1..D {
                sum.slope[e] += t[i] * within.slope[e];
            }
            if SECOND {
                sum.curvature[d][d] += ddt[i] * within.value;
                for e in d + 1..D {
                    sum.curvature[d][e] += dt[i] * within.slope[e];
                    sum.curvature[e][d] += dt[i] * within.slope[e];
                    for f in d + 1..D {
                        sum.curvature[e][f] += t[i] * within.curvature[e][f];
                    }
                }
            }
        }
        sum
    }
}

/// Coefficients of the polynomial that is `f` at Chebyshev's nodes.
fn interpolate<const D: usize>(
    f: impl Fn(&[f64]) -> f64,
    ranges: &[(f64, f64); D],
    n: usize,
) -> Vec<f64> {
    let angle = |k: usize| std::f64::consts::PI * (k as f64 + 0.5) / n as f64;
    let size = n.pow(D as u32);
    let place = |index: usize, d: usize| index / n.pow((D - 1 - d) as u32) % n;
    let mut values: Vec<f64> = (0..size)
        .map(|index| {
            let node = |d: usize| {
                let (lower, upper) = ranges[d];
                lower + 0.5 * (upper - lower) * (1.0 + angle(place(index, d)).cos())
            };
            f(&std::array::from_fn::<f64, D, _>(node))
        })
        .collect();
    // a cosine transform along each input in turn
    for d in 0..D {
        let stride = n.pow((D - 1 - d) as u32);
        let transformed = |index: usize| -> f64 {
            let (i, first) = (place(index, d), index - place(index, d) * stride);
            let scale = if i == 0 { 1.0 } else { 2.0 } / n as f64;
            let term = |k: usize| values[first + k * stride] * (i as f64 * angle(k)).cos();
            scale * (0..n).map(term).sum::<f64>()
        };
        values = (0..size).map(transformed).collect();
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::{derivatives, variable};

    const RANGES: [(f64, f64); 2] = [(1.0, 30.0), (120.0, 270.0)];

    fn cubic(x: &[f64]) -> f64 {
        200.0 + 2.0 * x[0] - 0.01 * x[0] * x[1] + 1e-4 * x[0] * x[0] * x[1] + 1e-6 * x[1].powi(3)
    }

    fn emulator() -> Emulator<2> {
        let mean = interpolate(cubic, &RANGES, 4).into();
        let ln_sd = interpolate(|x| 0.1 * x[0] - 0.01 * x[1], &RANGES, 4).into();
        Emulator { ranges: RANGES, n_terms: 4, mean, ln_sd }
    }

    #[test]
    fn polynomials_of_its_degree_are_exact_and_carry_derivatives() {
        let e = emulator();
        for x in [[1.0, 120.0], [7.3, 181.0], [30.0, 270.0]] {
            assert!((e.mean(x) - cubic(&x)).abs() < 1e-10);
            assert!((e.sd(x).ln() - 0.1 * x[0] + 0.01 * x[1]).abs() < 1e-12);
        }
        let (t, a) = (7.3, 181.0);
        let slopes = derivatives(&e.mean([variable::<2>(t, 0), variable(a, 1)]));
        assert!((slopes[0] - (2.0 - 0.01 * a + 2e-4 * t * a)).abs() < 1e-11);
        assert!((slopes[1] - (-0.01 * t + 1e-4 * t * t + 3e-6 * a * a)).abs() < 1e-11);
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
        assert!(departure.mean < TOLERANCE && departure.sd < 0.1, "{departure:?}");
        let text = emulator.to_rust("ERP", "Of a test.");
        assert!(
            text.starts_with(
                "/// Of a test.\n#[rustfmt::skip]\npub(super) static ERP: Emulator<2> ="
            )
        );
    }
}
