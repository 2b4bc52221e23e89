//! One search: what the base fit leaves over, screened against every covariate, and each candidate's
//! evidence.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use super::candidates::{Candidate, Level, Screen};
use super::engine::{Engine, Term};
use super::fit::{Cavity, Fit};
use super::outer::{Free, optimise, score};
use super::units::Unit;
use crate::dsl::Noise;

/// Draws from each cavity.
const DRAWS: usize = 128;

/// Shares of outlying measurements that are tried, and the sds of their further error in steps.
const OUTLYING_SHARES: [f64; 2] = [0.05, 0.15];
const OUTLYING_STEPS: [f64; 2] = [2.0, 5.0];
/// So far below the base, the sds of sites and noise would not bring them above it.
const HOPELESS: f64 = 5.0;

/// A candidate's evidence.
#[derive(Clone, Debug)]
pub(super) struct Tried {
    /// Number of the candidate.
    pub candidate: usize,
    /// p-value of the screen; 1 for what is not screened.
    pub p_screen: f64,
    /// Log Bayes factor against the base; −∞ where the screen stopped it.
    pub log_bf: f64,
    /// Its fit.
    pub fit: Option<Fit>,
}

/// What rows would have been, had their site not been seen.
#[derive(Clone, Debug)]
pub struct Left {
    /// Normal score of each row's randomised leave-one-site-out quantile.
    pub residual: Vec<f64>,
    /// Predicted value of each row.
    pub predicted: Vec<f64>,
    /// Leave-one-site-out log predictive density of each site.
    pub elpd: Vec<f64>,
}

/// Leave-one-site-out predictions from one fit; the same `seed` gives the same random numbers for
/// every fit, so that differences between fits are not noise.
pub fn leave_sites_out(engine: &Engine, fit: &Fit, seed: u64) -> Left {
    let all: Vec<usize> = (0..engine.rows.len()).collect();
    leave_out(engine, fit, &all, seed)
}

/// As [`leave_sites_out`], of these rows alone (ascending); where `fit` has not seen them, their
/// predictions.
pub fn leave_out(engine: &Engine, fit: &Fit, of: &[usize], seed: u64) -> Left {
    let n = engine.rows.len();
    let mut left = Left {
        residual: vec![0.0; n],
        predicted: vec![f64::NAN; n],
        elpd: vec![0.0; engine.sites.len()],
    };
    for (site, rows) in engine.sites.iter().enumerate() {
        let own: Vec<usize> =
            rows.iter().copied().filter(|r| of.binary_search(r).is_ok()).collect();
        if own.is_empty() {
            continue;
        }
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(site as u64);
        left.elpd[site] = fit.cavity(engine, &own).map_or(f64::NEG_INFINITY, |cavity| {
            predict(engine, fit, &cavity, &mut rng, &mut left.residual, &mut left.predicted)
        });
    }
    left
}

/// Most folds of [`leave_units_out`].
const FOLDS: usize = 20;

/// As [`leave_sites_out`], each unit predicted from the others by a fit that has not seen it (at most 20
/// folds); `elpd` is of folds, sites counting as independent given the fit. `None` where a fit fails.
pub fn leave_units_out(engine: &Engine, fit: &Fit, unit: &Unit, seed: u64) -> Option<Left> {
    let (n, folds) = (engine.rows.len(), unit.n.min(FOLDS));
    let mut all = Left { residual: vec![0.0; n], predicted: vec![f64::NAN; n], elpd: vec![] };
    for fold in 0..folds {
        let is_hidden =
            |r: &usize| unit.group[engine.model.table_row(engine.rows[*r].id)] % folds == fold;
        let hidden: Vec<usize> = (0..n).filter(is_hidden).collect();
        let part = engine.fit_without(&hidden, &fit.outer, &fit.active, Some(fit))?;
        let left = leave_out(engine, &part, &hidden, seed);
        for r in hidden {
            (all.residual[r], all.predicted[r]) = (left.residual[r], left.predicted[r]);
        }
        all.elpd.push(left.elpd.iter().sum());
    }
    Some(all)
}

/// Sum of squared errors in each fold of [`leave_units_out`]; a row without a middle has none.
pub(super) fn squared_errors(engine: &Engine, left: &Left, unit: &Unit) -> Vec<f64> {
    let mut squares = vec![0.0; left.elpd.len()];
    for (row, predicted) in engine.rows.iter().zip(&left.predicted) {
        let cells = engine.model.observes[row.id.observe].observed_row(row.id.row);
        let square = (cells.iter().sum::<f64>() / cells.len() as f64 - predicted).powi(2);
        if square.is_finite() {
            squares[unit.group[engine.model.table_row(row.id)] % left.elpd.len()] += square;
        }
    }
    squares
}

/// Predicts a cavity's rows; returns their joint log predictive density.
fn predict(
    engine: &Engine,
    fit: &Fit,
    cavity: &Cavity,
    rng: &mut ChaCha8Rng,
    residual: &mut [f64],
    predicted: &mut [f64],
) -> f64 {
    let noise = fit.noise();
    let root = square_root(&cavity.covariance);
    let rows = &cavity.rows;
    let mut below = vec![[0.0; 2]; rows.len()];
    let mut sums = vec![(0.0, 0.0); rows.len()];
    let mut ln = vec![];
    for _ in 0..DRAWS {
        let z = DVector::from_fn(cavity.mean.len(), |_, _| rng.sample::<f64, _>(StandardNormal));
        let locals = &cavity.mean + &root * z;
        let (mut at, mut total) = (0, 0.0);
        for (i, r) in rows.iter().enumerate() {
            let row = &engine.rows[*r];
            let own = &mut locals.as_slice()[at..at + row.n].to_vec();
            at += row.n;
            total += engine.model.row_ln(row.id, own, &noise);
            if let Some(location) = engine.model.row_location(row.id, own) {
                sums[i].0 += location;
                sums[i].1 += 1.0;
            }
            own[row.observable] += fit.error(rng);
            let cells = engine.model.row_replicate(row.id, own, rng);
            let observed = &engine.model.observes[row.id.observe].observed_row(row.id.row);
            match order(&cells, observed) {
                std::cmp::Ordering::Less => below[i][0] += 1.0,
                std::cmp::Ordering::Equal => below[i][1] += 1.0,
                std::cmp::Ordering::Greater => {}
            }
        }
        ln.push(total);
    }
    for (i, r) in rows.iter().enumerate() {
        let u: f64 = rng.random();
        let rank = (below[i][0] + u * (below[i][1] + 1.0)) / (DRAWS as f64 + 1.0);
        residual[*r] = crate::diagnostics::normal_quantile(rank);
        predicted[*r] = sums[i].0 / sums[i].1;
    }
    let most = ln.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    most + (ln.iter().map(|l| (l - most).exp()).sum::<f64>() / DRAWS as f64).ln()
}

/// Share of a term's variance over the rows that a smooth through the model's fields could take up.
pub(super) fn r_squared_on_fields(engine: &Engine, fit: &Fit, term: usize, step: f64) -> f64 {
    let n = engine.rows.len();
    let slopes = fit.slopes(engine);
    let Some(slopes) = slopes else { return 0.0 };
    let outer = &fit.outer;
    let variance = (2.0 * outer.ln_site).exp() + (2.0 * outer.ln_noise).exp() + step * step / 12.0;
    // θ = F x, x ~ N(0, I): the smoother is F Fᵀ (F Fᵀ + variance)⁻¹
    let covariance = &slopes * slopes.transpose();
    let noisy = &covariance + DMatrix::identity(n, n) * variance;
    let Some(factor) = nalgebra::Cholesky::new(noisy) else { return 0.0 };
    let term = &engine.terms[term];
    let (mut left, mut total) = (0.0, 0.0);
    for k in 0..term.n {
        let z = DVector::from_fn(n, |r, _| {
            term.design[engine.model.table_row(engine.rows[r].id) * term.n + k]
        });
        let z = z.add_scalar(-z.mean());
        let rest = &z - &covariance * factor.solve(&z);
        left += rest.norm_squared();
        total += z.norm_squared();
    }
    if total > 0.0 { 1.0 - left / total } else { 0.0 }
}

/// Share of a term's variance over the rows that the design of another explains.
pub(super) fn r_squared(engine: &Engine, term: usize, by: usize) -> f64 {
    if engine.terms[term].n == 0 || engine.terms[by].n == 0 {
        return 0.0; // outliers have no design
    }
    let table_row = |r: usize| engine.model.table_row(engine.rows[r].id);
    let n = engine.rows.len();
    let [y, x] = [term, by].map(|t| {
        let term = &engine.terms[t];
        let design = DMatrix::from_fn(n, term.n, |r, k| term.design[table_row(r) * term.n + k]);
        let means = design.row_mean();
        DMatrix::from_fn(n, term.n, |r, k| design[(r, k)] - means[k])
    });
    let svd = x.svd(true, false);
    let rank = svd.rank(1e-9);
    let Some(u) = &svd.u else { return 0.0 };
    let explained = (u.columns(0, rank).transpose() * &y).norm_squared();
    explained / y.norm_squared()
}

/// Compares measurements by their first finite cell.
pub(super) fn order(a: &[f64], b: &[f64]) -> std::cmp::Ordering {
    let key = |x: &[f64]| {
        x.iter().copied().fold(0.0, |sum, x| sum + if x.is_finite() { x } else { x.signum() * 1e9 })
    };
    key(a).total_cmp(&key(b))
}

/// `R Rᵀ = covariance`, also where it is singular.
fn square_root(covariance: &DMatrix<f64>) -> DMatrix<f64> {
    let mut eigen = nalgebra::SymmetricEigen::new(covariance.clone());
    eigen.eigenvalues.apply(|e| *e = e.max(0.0).sqrt());
    &eigen.eigenvectors * DMatrix::from_diagonal(&eigen.eigenvalues)
}

/// p-value of the F-test of values of groups of rows on a design's means over these.
fn f_test(engine: &Engine, groups: &[(f64, Vec<usize>)], term: usize) -> f64 {
    let term = &engine.terms[term];
    let n = groups.len();
    let y = DVector::from_iterator(n, groups.iter().map(|(value, _)| *value));
    let mut x = DMatrix::from_element(n, term.n + 1, 1.0);
    for (g, (_, rows)) in groups.iter().enumerate() {
        for k in 0..term.n {
            let z =
                |r: &usize| term.design[engine.model.table_row(engine.rows[*r].id) * term.n + k];
            x[(g, k + 1)] = rows.iter().map(z).sum::<f64>() / rows.len() as f64;
        }
    }
    let total = y.add_scalar(-y.mean()).norm_squared();
    let svd = x.svd(true, true);
    let rank = svd.rank(1e-9);
    let Some(u) = &svd.u else { return 1.0 };
    let explained: f64 =
        (0..rank).map(|k| u.column(k).dot(&y).powi(2)).sum::<f64>() - n as f64 * y.mean().powi(2);
    let (d1, d2) = ((rank - 1) as f64, (n - rank) as f64);
    if d1 < 1.0 || d2 < 1.0 {
        return 1.0;
    }
    // F/(F + d2/d1) is Beta(d1/2, d2/2)
    crate::diagnostics::beta_above(explained / total, 0.5 * d1, 0.5 * d2)
}

/// Mean residual of each site, with its rows.
fn of_sites(engine: &Engine, residual: &[f64]) -> Vec<(f64, Vec<usize>)> {
    let mean = |rows: &Vec<usize>| {
        (rows.iter().map(|r| residual[*r]).sum::<f64>() / rows.len() as f64, rows.clone())
    };
    engine.sites.iter().filter(|rows| !rows.is_empty()).map(mean).collect()
}

/// Random effect of each unit, with its rows.
fn of_units(engine: &Engine, fit: &Fit) -> Vec<(f64, Vec<usize>)> {
    let Some(term) = fit.unit_term(engine) else { return vec![] };
    let own = |k: usize| {
        let is_own =
            |r: &usize| term.design[engine.model.table_row(engine.rows[*r].id) * term.n + k] > 0.0;
        (fit.x[engine.split.linear.len() + k], (0..engine.rows.len()).filter(is_own).collect())
    };
    (0..term.n).map(own).filter(|(_, rows): &(f64, Vec<usize>)| !rows.is_empty()).collect()
}

/// Scores every candidate against `base`; `accepted` are terms that are in both.
pub(super) fn search(
    engine: &Engine,
    candidates: &[Candidate],
    base: &Fit,
    accepted: &[usize],
    gate: f64,
    step: f64,
    seed: u64,
) -> Vec<Tried> {
    let left = leave_sites_out(engine, base, seed);
    let (sites, units) = (of_sites(engine, &left.residual), of_units(engine, base));
    let reference = score(base, step);
    let one = |candidate: usize| {
        let Candidate { level, screen, .. } = candidates[candidate];
        let p_screen = match screen {
            Screen::Sites => f_test(engine, &sites, candidate),
            Screen::Units => f_test(engine, &units, candidate),
            Screen::None => 1.0,
        };
        let mut tried = Tried { candidate, p_screen, log_bf: f64::NEG_INFINITY, fit: None };
        if screen != Screen::None && p_screen > gate {
            return tried;
        }
        let active = [accepted, &[candidate]].concat();
        if level == Level::Noise {
            if let Some((fit, score)) = with_outliers(engine, base, &active, step) {
                (tried.log_bf, tried.fit) = (score - reference, Some(fit));
            }
            return tried;
        }
        let Some(fit) = engine.fit(&base.outer, &active, Some(base)) else { return tried };
        tried.log_bf = score(&fit, step) - reference;
        tried.fit = Some(fit.clone());
        // what varies over units gains only once it has taken the place of their random effect
        if (tried.log_bf > 0.0 || screen == Screen::Units)
            && let Some((best, score)) = optimise(engine, &active, &fit, Free::Spread, step)
            && score - reference > tried.log_bf
        {
            tried.log_bf = score - reference;
            tried.fit = Some(best);
        }
        tried
    };
    let is_new = |c: &usize| {
        let mut taken = accepted.iter().filter_map(|a| candidates.get(*a));
        taken.all(|taken| taken.name != candidates[*c].name)
    };
    (0..candidates.len()).filter(is_new).map(one).collect()
}

/// The fit with outliers, and its score averaged over their share and size.
fn with_outliers(engine: &Engine, base: &Fit, active: &[usize], step: f64) -> Option<(Fit, f64)> {
    let mut outer = base.outer.clone();
    // what is outlying has made the others' error look large
    outer.ln_noise = outer.ln_noise.min((step / 3.0).ln());
    let mut tried: Vec<(Fit, f64)> = vec![];
    for share in OUTLYING_SHARES {
        for size in OUTLYING_STEPS {
            outer.outliers = Some((share, size * step));
            let fit = engine.fit(&outer, active, Some(base))?;
            let score = score(&fit, step);
            tried.push((fit, score));
        }
    }
    let (best, most) = tried.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
    if *most < score(base, step) - HOPELESS {
        return None;
    }
    let average = (tried.iter().map(|t| (t.1 - most).exp()).sum::<f64>() / tried.len() as f64).ln();
    let (fit, score) = optimise(engine, active, best, Free::Spread, step)?;
    Some((fit, score + average))
}

/// Another data set from a fit: new random effects and errors, the same everything else.
pub(super) fn simulate(engine: &Engine, fit: &Fit, rng: &mut ChaCha8Rng) -> Vec<Vec<f64>> {
    let tau = fit.outer.ln_site.exp();
    let effects: Vec<f64> =
        engine.sites.iter().map(|_| rng.sample::<f64, _>(StandardNormal)).collect();
    let unit = fit.unit_term(engine);
    let unit_sd = fit.outer.ln_unit.map_or(0.0, f64::exp);
    let (first, n) = (engine.split.linear.len(), unit.map_or(0, |term| term.n));
    let moved: Vec<f64> = (0..n)
        .map(|k| unit_sd * (rng.sample::<f64, _>(StandardNormal) - fit.x[first + k]))
        .collect();
    let one = |row: &super::engine::RowAt| {
        let mut own = fit.locals[row.first..][..row.n].to_vec();
        own[row.observable] += tau * (effects[row.site] - fit.z[row.site]) + fit.error(rng);
        if let Some(term) = unit {
            let z = &term.design[engine.model.table_row(row.id) * n..][..n];
            own[row.observable] += z.iter().zip(&moved).map(|(z, m)| z * m).sum::<f64>();
        }
        engine.model.row_replicate(row.id, &own, rng)
    };
    engine.rows.iter().map(one).collect()
}

impl Fit {
    /// Slope of every row's predicted value in the standard normal coefficients of the fields,
    /// (rows, coefficients); `None` for a model without fields.
    fn slopes(&self, engine: &Engine) -> Option<DMatrix<f64>> {
        let etas: Vec<usize> =
            (0..engine.split.is_eta.len()).filter(|k| engine.split.is_eta[*k]).collect();
        if etas.is_empty() {
            return None;
        }
        let mut slopes = DMatrix::zeros(engine.rows.len(), etas.len());
        for (r, row) in engine.rows.iter().enumerate() {
            for l in 0..row.n {
                let mut own = self.locals[row.first..][..row.n].to_vec();
                let (centre, h) = (own[l], 1e-4 * own[l].abs().max(1.0));
                let mut at = |x: f64| {
                    own[l] = x;
                    engine.model.row_location(row.id, &own)
                };
                let slope = (at(centre + h)? - at(centre - h)?) / (2.0 * h);
                for (k, eta) in etas.iter().enumerate() {
                    slopes[(r, k)] += slope * self.design_row(row.first + l)[*eta];
                }
            }
        }
        Some(slopes)
    }

    /// The random effect of units, which comes first among the terms, if there is one.
    fn unit_term<'e>(&self, engine: &'e Engine) -> Option<&'e Term> {
        self.active.first().map(|a| &engine.terms[*a]).filter(|term| term.sd.is_none())
    }

    /// The noise of its rows.
    pub fn noise(&self) -> Noise {
        self.outer.noise()
    }

    /// A further error of one row.
    fn error(&self, rng: &mut dyn Rng) -> f64 {
        let noise = self.noise();
        let mut variance = noise.variance;
        if let Some((share, wide)) = noise.outliers
            && rng.random::<f64>() < share
        {
            variance += wide;
        }
        variance.sqrt() * rng.sample::<f64, _>(StandardNormal)
    }
}

/// The change of each field that moves what is observed by one protocol step, from the rms slope over
/// the rows of a fit; fields that nothing observed depends on are left out.
pub(super) fn field_sd(engine: &Engine, fit: &Fit, step: f64) -> BTreeMap<String, f64> {
    let mut found = BTreeMap::new();
    for field in engine.model.field_names() {
        let (mut squares, mut n) = (0.0, 0.0);
        for row in &engine.rows {
            let Some(local) = engine.model.local_of(row.id, field) else { continue };
            let mut own = fit.locals[row.first..][..row.n].to_vec();
            let h = 1e-4 * own[local].abs().max(1.0);
            let centre = own[local];
            let mut at = |x: f64| {
                own[local] = x;
                engine.model.row_location(row.id, &own)
            };
            if let (Some(above), Some(below)) = (at(centre + h), at(centre - h)) {
                squares += ((above - below) / (2.0 * h)).powi(2);
                n += 1.0;
            }
        }
        if squares > 0.0 {
            found.insert(field.to_string(), step / (squares / n).sqrt());
        }
    }
    found
}
