//! What can be known of a study by who knows how it was made: log Bayes factors under the generating truth.
//!
//! ```text
//! ERP of row r at site i = erp_r(tau_i, apd_i) + shift_i + error,   error ~ N(0, 2²)
//! tau, apd ~ N(mean + change, sd² U),   shift ~ N(0, 8² I),   U = Σ_k S(λ_k) φ_k φ_kᵀ, 128 modes
//! ```
//! The evidence is that of a Laplace approximation. Any figure of the data is a test, so that what these tell apart can
//! be told apart.
#![allow(dead_code, reason = "each test uses a part of it")]

use eplat::field::{Kernel as _, Matern52};
use eplat::manifold::Basis;
use eplat::surrogate::{erp_s2, erp_s3};
use nalgebra::{Cholesky, DMatrix, DVector};

use super::studies::{EFFECT, ERROR, FIELDS, Study};

/// What is known of how studies are made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Knows {
    /// The lengthscale, the fields' means and sds, and what acts if it acts.
    All,
    /// The forms alone: lengthscale, means and sds are averaged over, and the size of a region's change.
    Forms,
}

/// The lengthscales that are averaged over, mm; the truth's are between 18 and 49.
const LENGTHSCALES: [f64; 5] = [15.0, 21.0, 29.0, 40.0, 56.0];
/// Sds of a field that are averaged over, times the true one.
const SIZES: [f64; 4] = [0.5, 0.75, 1.1, 1.6];
/// Sds of the means of the fields where they are not known, ms.
const MEANS: [f64; 2] = [4.0, 25.0];
/// Sds of sites' differences that are averaged over, times the true one.
const DIFFERENCES: [f64; 3] = [0.5, 0.9, 1.5];

/// A study as its maker sees it.
pub(crate) struct Oracle<'a> {
    basis: &'a Basis,
    pub(crate) study: &'a Study,
    vertices: Vec<usize>,
    /// Site, protocol, ends of the bracket.
    rows: Vec<(usize, usize, [f64; 2])>,
}

/// A prior of what sites are.
struct Prior {
    /// Covariance of each field at the sites.
    fields: [DMatrix<f64>; 2],
    /// Means of the fields at the sites.
    means: [DVector<f64>; 2],
    /// Variance of what sites differ by.
    sites: f64,
    /// A direction in which both fields may move, with a standard normal coefficient.
    change: Option<[DVector<f64>; 2]>,
    /// What is known to be added to the ERP.
    shift: DVector<f64>,
    /// Standard deviation of a site's errors.
    errors: Vec<f64>,
}

impl<'a> Oracle<'a> {
    pub(crate) fn new(basis: &'a Basis, study: &'a Study) -> Self {
        let table = &study.train;
        let number =
            |row: usize, name: &str| table.cell(row, name).unwrap().parse::<f64>().unwrap();
        let mut vertices = vec![0; study.truth.shift.len()];
        let mut rows = vec![];
        for row in 0..table.len() {
            let site = number(row, "site") as usize;
            vertices[site] = number(row, "vertex") as usize;
            let protocol = usize::from(table.cell(row, "protocol").unwrap() == "S1S2S3");
            rows.push((site, protocol, [number(row, "lower"), number(row, "upper")]));
        }
        Self { basis, study, vertices, rows }
    }

    /// Log Bayes factor of "sites differ" against "they do not".
    pub(crate) fn sites(&self, knows: Knows) -> f64 {
        let without = self.averaged(knows, &|prior| prior);
        let sizes = if knows == Knows::All { &[1.0][..] } else { &DIFFERENCES[..] };
        let with: Vec<f64> = sizes
            .iter()
            .map(|size| {
                self.averaged(knows, &|prior| Prior { sites: (size * EFFECT).powi(2), ..prior })
            })
            .collect();
        ln_mean_exp(&with) - without
    }

    /// Log Bayes factor of "the veins are a region of their own" against "they are not", if what is added to the ERP is
    /// known.
    pub(crate) fn region(&self, knows: Knows) -> f64 {
        let truth = &self.study.truth;
        let shift = || DVector::from_column_slice(&truth.shift);
        let change = || {
            [0, 1].map(|k| {
                DVector::from_iterator(truth.change.len(), truth.change.iter().map(|c| c[k]))
            })
        };
        let without = self.averaged(knows, &|prior| Prior { shift: shift(), ..prior });
        let with = self.averaged(knows, &|mut prior| {
            if knows == Knows::All {
                prior.means = [0, 1].map(|k| &prior.means[k] + &change()[k]);
            } else {
                prior.change = Some(change());
            }
            Prior { shift: shift(), ..prior }
        });
        with - without
    }

    /// Log Bayes factor of "errors grow as the force falls" against "they do not".
    pub(crate) fn scatter(&self, knows: Knows) -> f64 {
        let wide = |times: f64| {
            let scatter = self.study.truth.scatter.iter();
            scatter.map(|own| ERROR.hypot(times * own)).collect::<Vec<f64>>()
        };
        let sizes = if knows == Knows::All { &[1.0][..] } else { &DIFFERENCES[..] };
        let with: Vec<f64> = sizes
            .iter()
            .map(|size| self.averaged(knows, &|prior| Prior { errors: wide(*size), ..prior }))
            .collect();
        ln_mean_exp(&with) - self.averaged(knows, &|prior| prior)
    }

    /// Log evidence, averaged over what is not known.
    fn averaged(&self, knows: Knows, of: &dyn Fn(Prior) -> Prior) -> f64 {
        let n = self.vertices.len();
        let prior = |unit: &DMatrix<f64>, sizes: [f64; 2], means: [f64; 2]| {
            let field = |k: usize| {
                unit * (sizes[k] * FIELDS[k].1).powi(2)
                    + DMatrix::from_element(n, n, means[k].powi(2))
            };
            of(Prior {
                fields: [field(0), field(1)],
                means: FIELDS.map(|(mean, _)| DVector::from_element(n, mean)),
                sites: 0.0,
                change: None,
                shift: DVector::zeros(n),
                errors: vec![ERROR; n],
            })
        };
        if knows == Knows::All {
            return self.evidence(&prior(
                &self.unit(self.study.truth.lengthscale),
                [1.0; 2],
                [0.0; 2],
            ));
        }
        let mut all = vec![];
        for lengthscale in LENGTHSCALES {
            let unit = self.unit(lengthscale);
            for sizes in SIZES.iter().flat_map(|a| SIZES.map(|b| [*a, b])) {
                all.push(self.evidence(&prior(&unit, sizes, MEANS)));
            }
        }
        ln_mean_exp(&all)
    }

    /// Covariance of a field of unit size at the sites.
    fn unit(&self, lengthscale: f64) -> DMatrix<f64> {
        let kernel = Matern52(lengthscale);
        let weights: Vec<f64> =
            self.basis.eigenvalues.iter().map(|l| kernel.sqrt_density(l.max(0.0).sqrt())).collect();
        let z = DMatrix::from_fn(self.vertices.len(), weights.len(), |i, k| {
            weights[k] * self.basis.at(self.vertices[i])[k]
        });
        &z * z.transpose()
    }

    /// Log evidence by a Laplace approximation. What is solved for has the size of the rows.
    fn evidence(&self, prior: &Prior) -> f64 {
        let (n, sites) = (self.rows.len(), self.vertices.len());
        let mut fields = prior.means.clone();
        let mut shift = prior.shift.clone();
        // the first step takes brackets for normal errors
        let mut is_first = true;
        let mut last = f64::NEG_INFINITY;
        for _ in 0..40 {
            let mut slopes = vec![[0.0; 2]; n];
            let (mut value, mut pull, mut root) = (0.0, DVector::zeros(n), DVector::zeros(n));
            for (r, (site, protocol, bracket)) in self.rows.iter().enumerate() {
                let erp = |tau: f64, apd: f64| {
                    if *protocol == 0 { erp_s2(tau, apd) } else { erp_s3(tau, apd) }
                };
                let [tau, apd] = [fields[0][*site], fields[1][*site]];
                let f = erp(tau, apd) + shift[*site];
                slopes[r] = [
                    (erp(tau + 0.01, apd) - erp(tau - 0.01, apd)) / 0.02,
                    (erp(tau, apd + 0.01) - erp(tau, apd - 0.01)) / 0.02,
                ];
                let [v, g, h] = interval(f, *bracket, prior.errors[*site]);
                value += v;
                let (g, h) = if is_first {
                    let wide =
                        prior.errors[*site].powi(2) + (bracket[1] - bracket[0]).powi(2) / 12.0;
                    ((0.5 * (bracket[0] + bracket[1]) - f) / wide, 1.0 / wide)
                } else {
                    (g, h.max(1e-6))
                };
                root[r] = h.sqrt();
                // J (g − mean) + D⁻¹ slope
                let moved = [0, 1].map(|k| fields[k][*site] - prior.means[k][*site]);
                let own = slopes[r][0] * moved[0] + slopes[r][1] * moved[1] + shift[*site]
                    - prior.shift[*site];
                pull[r] = own + g / h;
            }
            let along = prior.change.as_ref().map(|change| {
                DVector::from_fn(n, |r, _| {
                    let site = self.rows[r].0;
                    slopes[r][0] * change[0][site] + slopes[r][1] * change[1][site]
                })
            });
            let a = DMatrix::from_fn(n, n, |r, q| {
                let (i, j) = (self.rows[r].0, self.rows[q].0);
                let of = |k: usize| slopes[r][k] * slopes[q][k] * prior.fields[k][(i, j)];
                let own = if i == j { prior.sites } else { 0.0 };
                of(0) + of(1) + own + along.as_ref().map_or(0.0, |h| h[r] * h[q])
            });
            let b = DMatrix::from_fn(n, n, |r, q| {
                f64::from(u8::from(r == q)) + root[r] * a[(r, q)] * root[q]
            });
            let factor = Cholesky::new(b).unwrap();
            let scaled = pull.component_mul(&root);
            let v = factor.solve(&scaled).component_mul(&root);
            let ln_det: f64 = factor.l_dirty().diagonal().iter().map(|l| l.ln()).sum();
            let score = value - 0.5 * v.dot(&(&a * &v)) - ln_det;
            if !is_first && (score - last).abs() < 1e-3 {
                return score;
            }
            last = if is_first { f64::NEG_INFINITY } else { score };
            // half of a step where a whole one might swing
            let length = if is_first { 1.0 } else { 0.7 };
            is_first = false;
            let mut at_site = [DVector::zeros(sites), DVector::zeros(sites), DVector::zeros(sites)];
            for (r, (site, ..)) in self.rows.iter().enumerate() {
                at_site[0][*site] += slopes[r][0] * v[r];
                at_site[1][*site] += slopes[r][1] * v[r];
                at_site[2][*site] += v[r];
            }
            let moved = along.as_ref().map_or(0.0, |h| h.dot(&v));
            for k in 0..2 {
                let mut goal = &prior.means[k] + &prior.fields[k] * &at_site[k];
                if let Some(change) = &prior.change {
                    goal += &change[k] * moved;
                }
                fields[k] = &fields[k] * (1.0 - length) + goal * length;
            }
            let goal = &prior.shift + &at_site[2] * prior.sites;
            shift = shift * (1.0 - length) + goal * length;
        }
        last
    }
}

/// Log probability of a bracket, its slope in `f` and minus its curvature.
fn interval(f: f64, [lower, upper]: [f64; 2], error: f64) -> [f64; 3] {
    let normal = |x: f64| (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt();
    let beyond = |x: f64| 0.5 * libm::erfc(x / std::f64::consts::SQRT_2);
    let (mut a, mut b) = ((lower - f) / error, (upper - f) / error);
    let is_turned = a + b < 0.0;
    if is_turned {
        (a, b) = (-b, -a);
    }
    // a bracket so far off would be a probability of nothing
    let a = a.min(35.0);
    let b = b.min(a + (upper - lower) / error);
    let p = beyond(a) - beyond(b);
    let slope = (normal(a) - normal(b)) / p;
    let bent = slope * slope + (b * normal(b) - a * normal(a)) / p;
    let sign = if is_turned { -1.0 } else { 1.0 };
    [p.ln(), sign * slope / error, bent / error.powi(2)]
}

fn ln_mean_exp(x: &[f64]) -> f64 {
    let most = x.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    most + (x.iter().map(|x| (x - most).exp()).sum::<f64>() / x.len() as f64).ln()
}
