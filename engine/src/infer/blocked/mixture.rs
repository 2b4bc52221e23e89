//! Independent proposals of the outer unknowns, fitted to weighted points: a mixture of Student
//! distributions, of which one number may be drawn anew from where its prior lies.
//!
//! ```text
//! q(h) = (1 − ε) Σ_k p_k t_k(h) + ε/n Σ_i c_i(h_i) Σ_k p_k t_k(h without h_i)
//! ```
//! The second part reaches regimes that no point has shown: lengthscales far beyond the surface, for
//! instance, under which a field is nearly constant.

use nalgebra::{Cholesky, DMatrix, DVector};
use rand::{Rng, RngExt as _};
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

use crate::dist::ln_gamma;

/// Components, beside the wide one.
const COMPONENTS: usize = 6;
/// Passes of expectation and maximisation.
const PASSES: usize = 8;
/// Degrees of freedom of a component.
const NU: usize = 5;
/// A wide component about all points: its share, how much wider it is, and its degrees of freedom.
const WIDE: (f64, f64, usize) = (0.1, 2.5, 2);
/// Added to each variance: points may all be the same.
const FLOOR: f64 = 1e-4;
/// Points with less than this share of the largest weight are left out.
const NEGLIGIBLE: f64 = 1e-9;

/// A multivariate Student distribution.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Student {
    /// Its share of a mixture.
    share: f64,
    mean: Vec<f64>,
    /// L of the scale matrix L Lᵀ, row-major.
    factor: Vec<f64>,
    nu: usize,
    /// ln of the density at the mean.
    ln_peak: f64,
}

impl Student {
    pub(super) fn new(
        share: f64,
        mean: &DVector<f64>,
        scale: DMatrix<f64>,
        nu: usize,
    ) -> Option<Self> {
        let n = mean.len();
        let l = Cholesky::new(scale)?.l();
        let ln_det: f64 = (0..n).map(|i| l[(i, i)].ln()).sum();
        let factor = (0..n * n).map(|k| l[(k / n, k % n)]).collect();
        let mean = mean.as_slice().to_vec();
        let standard = Self::standard(n, nu);
        Some(Self { share, mean, factor, ln_peak: standard.ln_peak - ln_det, ..standard })
    }

    /// Of the unit scale matrix about 0.
    pub(super) fn standard(n: usize, nu: usize) -> Self {
        let (df, dim) = (nu as f64, n as f64);
        let ln_peak = ln_gamma(0.5 * (df + dim)) - ln_gamma(0.5 * df) - 0.5 * dim * (df * PI).ln();
        let factor = (0..n * n).map(|k| if k / n == k % n { 1.0 } else { 0.0 }).collect();
        Self { share: 1.0, mean: vec![0.0; n], factor, nu, ln_peak }
    }

    /// (x − m)ᵀ(L Lᵀ)⁻¹(x − m); `y` is memory.
    fn distance(&self, x: &[f64], y: &mut Vec<f64>) -> f64 {
        y.clear();
        for (i, row) in self.factor.chunks_exact(x.len().max(1)).enumerate() {
            let done: f64 = row.iter().zip(y.iter()).map(|(l, y)| l * y).sum();
            y.push((x[i] - self.mean[i] - done) / row[i]);
        }
        y.iter().map(|y| y * y).sum()
    }

    fn ln_density(&self, x: &[f64], y: &mut Vec<f64>) -> f64 {
        let nu = self.nu as f64;
        self.ln_peak - 0.5 * (nu + x.len() as f64) * (self.distance(x, y) / nu).ln_1p()
    }

    /// The density at the mean.
    pub(super) fn peak(&self) -> f64 {
        self.ln_peak.exp()
    }

    /// The density in units of that at the mean.
    pub(super) fn relative_density(&self, x: &[f64], y: &mut Vec<f64>) -> f64 {
        let base = 1.0 + self.distance(x, y) / self.nu as f64;
        let power = self.nu + x.len();
        // base^(power/2)
        let root = if power.is_multiple_of(2) { 1.0 } else { base.sqrt() };
        1.0 / (0..power / 2).fold(root, |product, _| product * base)
    }

    pub(super) fn draw(&self, rng: &mut impl Rng, x: &mut [f64]) {
        let n = x.len();
        let scale = student_scale(self.nu, rng);
        x.copy_from_slice(&self.mean);
        for j in 0..n {
            let step = scale * rng.sample::<f64, _>(StandardNormal);
            for (x, row) in x.iter_mut().zip(self.factor.chunks_exact(n)).skip(j) {
                *x += row[j] * step;
            }
        }
    }

    /// The distribution of all numbers but `i`.
    fn without(&self, i: usize) -> Option<Self> {
        let n = self.mean.len();
        let l = DMatrix::from_row_slice(n, n, &self.factor);
        let scale = (&l * l.transpose()).remove_row(i).remove_column(i);
        let mean = DVector::from_column_slice(&self.mean).remove_row(i);
        Self::new(self.share, &mean, scale, self.nu)
    }
}

/// The factor that makes a standard normal number one of Student's t.
pub(super) fn student_scale(nu: usize, rng: &mut impl Rng) -> f64 {
    // half the sum of two squared normal numbers is −ln of a uniform one
    let product: f64 = (0..nu / 2).map(|_| rng.random::<f64>()).product();
    let odd: f64 = if nu.is_multiple_of(2) { 0.0 } else { rng.sample(StandardNormal) };
    let chi_square = odd * odd - 2.0 * product.ln();
    (nu as f64 / chi_square).sqrt()
}

/// Where the prior of one number lies: a Cauchy distribution with its median, whose scales are the
/// distances of the quartiles from it.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Tails {
    centre: f64,
    scale: [f64; 2],
}

impl Tails {
    /// From draws, at least one.
    pub(super) fn of(mut draws: Vec<f64>) -> Self {
        draws.sort_by(f64::total_cmp);
        let at = |quarter: usize| draws[quarter * (draws.len() - 1) / 4];
        let floor = FLOOR.sqrt();
        Self { centre: at(2), scale: [(at(2) - at(1)).max(floor), (at(3) - at(2)).max(floor)] }
    }

    fn draw(&self, rng: &mut impl Rng) -> f64 {
        let y = (PI * (rng.random::<f64>() - 0.5)).tan();
        self.centre + y * self.scale[usize::from(y >= 0.0)]
    }

    fn density(&self, x: f64) -> f64 {
        let y = x - self.centre;
        let s = self.scale[usize::from(y >= 0.0)];
        1.0 / (PI * s * (1.0 + (y / s).powi(2)))
    }
}

/// q
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Mixture {
    components: Vec<Student>,
    /// ε
    far: f64,
    /// For each number its tails, and the components without it.
    tails: Vec<(Tails, Vec<Student>)>,
}

impl Mixture {
    /// Fits a mixture to points with these weights, by expectation and maximisation; `None` where they
    /// determine none. `far` is ε.
    pub(super) fn fit(
        points: &[Vec<f64>],
        weights: &[f64],
        (far, tails): (f64, &[Tails]),
        rng: &mut impl Rng,
    ) -> Option<Self> {
        let sample = Sample::new(points, weights)?;
        let n = sample.mean.len();
        // what the points of one component look like before there are enough to say
        let narrow = &sample.covariance * (COMPONENTS as f64).powf(-2.0 / n as f64);
        let begin = |_| Student::new(1.0, sample.pick(rng), narrow.clone(), NU);
        let mut components: Vec<Student> = (0..COMPONENTS).filter_map(begin).collect();
        for _ in 0..PASSES {
            let new = sample.improved(&components, &narrow);
            if new.is_empty() {
                break;
            }
            components = new;
        }
        let (share, wider, nu) = WIDE;
        let total: f64 = components.iter().map(|c| c.share).sum();
        for component in &mut components {
            component.share *= (1.0 - share) / total;
        }
        components.push(Student::new(share, &sample.mean, sample.covariance * wider.powi(2), nu)?);
        if n == 1 {
            return Some(Self { components, far: 0.0, tails: vec![] });
        }
        let without = |i: usize| components.iter().map(|c| c.without(i)).collect::<Option<_>>();
        let with_tails = |(i, own): (usize, &Tails)| Some((own.clone(), without(i)?));
        let tails = tails.iter().enumerate().map(with_tails).collect::<Option<_>>()?;
        Some(Self { components, far, tails })
    }

    /// Whether it is one of `n` numbers that can be used.
    pub(super) fn fits(&self, n: usize) -> bool {
        let fits = |components: &[Student], n: usize| {
            let of_n = |c: &Student| {
                c.mean.len() == n && c.factor.len() == n * n && [NU, WIDE.2].contains(&c.nu)
            };
            let shares: f64 = components.iter().map(|c| c.share).sum();
            components.iter().all(of_n) && (shares - 1.0).abs() < 1e-6
        };
        let n_tails = if self.far > 0.0 { n } else { 0 };
        fits(&self.components, n)
            && self.tails.len() == n_tails
            && self.tails.iter().all(|(_, components)| fits(components, n - 1))
    }

    pub(super) fn ln_density(&self, x: &[f64]) -> f64 {
        let mut y = vec![];
        let mut sum = |components: &[Student], x: &[f64]| -> f64 {
            components.iter().map(|c| c.share * c.ln_density(x, &mut y).exp()).sum()
        };
        let near = sum(&self.components, x);
        let mut others = x.to_vec();
        let mut far = 0.0;
        for (i, (tails, components)) in self.tails.iter().enumerate() {
            others.clear();
            others.extend(x.iter().enumerate().filter(|(k, _)| *k != i).map(|(_, x)| x));
            far += tails.density(x[i]) * sum(components, &others) / x.len() as f64;
        }
        ((1.0 - self.far) * near + self.far * far).ln()
    }

    /// So many draws.
    pub(super) fn draws(&self, n: usize, rng: &mut impl Rng) -> Vec<Vec<f64>> {
        let mut one = || {
            let mut x = vec![0.0; self.components[0].mean.len()];
            self.draw(rng, &mut x);
            x
        };
        (0..n).map(|_| one()).collect()
    }

    pub(super) fn draw(&self, rng: &mut impl Rng, x: &mut [f64]) {
        let mut left: f64 = rng.random();
        let own = self.components.iter().find(|c| {
            left -= c.share;
            left <= 0.0
        });
        own.unwrap_or(&self.components[0]).draw(rng, x);
        if rng.random::<f64>() < self.far {
            let i = rng.random_range(0..x.len());
            x[i] = self.tails[i].0.draw(rng);
        }
    }
}

/// Points with weights that sum to one.
struct Sample {
    points: Vec<DVector<f64>>,
    weights: Vec<f64>,
    /// How many equally weighted points they are worth.
    effective: f64,
    mean: DVector<f64>,
    covariance: DMatrix<f64>,
}

impl Sample {
    fn new(points: &[Vec<f64>], weights: &[f64]) -> Option<Self> {
        let largest = weights.iter().fold(0.0, |a: f64, b| a.max(*b));
        let pairs = points.iter().zip(weights).filter(|(_, w)| **w > NEGLIGIBLE * largest);
        let (points, mut weights): (Vec<_>, Vec<f64>) =
            pairs.map(|(x, w)| (DVector::from_column_slice(x), *w)).unzip();
        let total: f64 = weights.iter().sum();
        for weight in &mut weights {
            *weight /= total;
        }
        let effective = 1.0 / weights.iter().map(|w| w * w).sum::<f64>();
        let n = points.first()?.len();
        let (mut mean, mut covariance) = (DVector::zeros(n), DMatrix::identity(n, n) * FLOOR);
        for (x, w) in points.iter().zip(&weights) {
            mean += x * *w;
        }
        for (x, w) in points.iter().zip(&weights) {
            let d = x - &mean;
            covariance += &d * d.transpose() * *w;
        }
        Some(Self { points, weights, effective, mean, covariance })
    }

    /// One of the points.
    fn pick(&self, rng: &mut impl Rng) -> &DVector<f64> {
        let mut left: f64 = rng.random();
        let own = self.weights.iter().position(|w| {
            left -= w;
            left <= 0.0
        });
        &self.points[own.unwrap_or(0)]
    }

    /// The components after a pass. Those with hardly a point are dropped.
    fn improved(&self, components: &[Student], narrow: &DMatrix<f64>) -> Vec<Student> {
        let (n, mut y) = (self.mean.len(), vec![]);
        let mut parts = vec![];
        for (x, weight) in self.points.iter().zip(&self.weights) {
            let x = x.as_slice();
            let densities = components.iter().map(|c| c.share * c.ln_density(x, &mut y).exp());
            let mut part: Vec<f64> = densities.collect();
            let total: f64 = part.iter().sum();
            for part in &mut part {
                *part *= weight / total;
            }
            parts.push(part);
        }
        let improve = |(k, own): (usize, &Student)| {
            let share: f64 = parts.iter().map(|part| part[k]).sum();
            let count = share * self.effective;
            if count < 2.0 {
                return None;
            }
            let (mut pulls, mut total, mut mean) = (vec![], 0.0, vec![0.0; n]);
            for (x, part) in self.points.iter().zip(&parts) {
                let x = x.as_slice();
                // far points of a Student distribution count less
                let pull = part[k] * (NU + n) as f64 / (NU as f64 + own.distance(x, &mut y));
                mean.iter_mut().zip(x).for_each(|(mean, x)| *mean += pull * x);
                total += pull;
                pulls.push(pull);
            }
            for mean in &mut mean {
                *mean /= total;
            }
            let mut squares = vec![0.0; n * n];
            for (x, pull) in self.points.iter().zip(&pulls) {
                y.clear();
                y.extend(x.iter().zip(&mean).map(|(x, mean)| x - mean));
                for (row, left) in squares.chunks_exact_mut(n).zip(&y) {
                    row.iter_mut().zip(&y).for_each(|(sum, right)| *sum += pull * left * right);
                }
            }
            let prior = (n + 2) as f64;
            let scale = narrow * prior + DMatrix::from_row_slice(n, n, &squares) * self.effective;
            Student::new(share, &DVector::from_vec(mean), scale / (count + prior), NU)
        };
        components.iter().enumerate().filter_map(improve).collect()
    }
}
