//! Known truths of several origins, and what is measured of them: what `tests/coverage.rs` calibrates.
#![allow(clippy::unwrap_used, reason = "for tests")]

use std::sync::Arc;

use eplat::ep::{Grid, Parameters, Protocol, simulate_strips};
use eplat::experiment::{Laboratory, TRUTH_MODES, conduction};
use eplat::field::{Matern52, unit_field};
use eplat::manifold::{Basis, eigenpairs_cached, maximin};
use eplat::mesh::Surface;
use eplat::model::Declare;
use eplat::run::Domain;
use eplat::surrogate::{erp_s2, erp_s3};
use eplat::table::Measurements;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// Where a truth comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Origin {
    /// Matérn fields through a logistic onto the range in which ERP_S2 stays below 280 ms; lengthscale, mean and
    /// amplitude are drawn.
    Bounded,
    /// As the paper: Matérn fields of 64 mm stretched onto the whole range and repaired.
    Paper,
    /// Bounded fields, measured by the strip simulator, with a `CV_max` of 0.5 to 1 m/s.
    Strip,
}

/// One condition of the study.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Condition {
    pub(crate) origin: Origin,
    pub(crate) sites: usize,
    /// Width of a bracket, ms.
    pub(crate) width: f64,
}

/// A truth with its measurements.
pub(crate) struct Case {
    pub(crate) train: Measurements,
    /// Twenty sites that were not measured.
    pub(crate) heldout: Measurements,
    /// `tau_out`, `apd_max`, `erp_s2`, `erp_s3` (n_vertices); NaN where unknown.
    pub(crate) maps: [Vec<f64>; 4],
}

/// Vertices whose strips are simulated, besides the sites: one in so many.
const STRIDE: usize = 40;
const HELDOUT: usize = 20;

/// The surface of all cases, with its modes.
pub(crate) fn domain() -> Arc<Domain> {
    let surface = Surface::left_atrium(1.5);
    let basis = eigenpairs_cached(&surface.mesh, TRUTH_MODES).unwrap();
    Arc::new(Domain { surface, basis, scale: 1.0 })
}

impl Condition {
    /// The case of this seed; `paper` is the model whose ranges the paper's truths are stretched onto.
    pub(crate) fn case(&self, domain: &Domain, paper: &dyn Declare, seed: u64) -> Case {
        let (mesh, basis) = (&domain.surface.mesh, &domain.basis);
        let fields = match self.origin {
            Origin::Paper => {
                let truth = Laboratory::new(paper, basis).unwrap().truth(64.0, seed).unwrap();
                [truth.fields[0].clone(), truth.fields[1].clone()]
            }
            Origin::Bounded | Origin::Strip => bounded(basis, seed),
        };
        let sites = maximin(mesh, self.sites, 6.0, seed).unwrap();
        let mut rng = ChaCha8Rng::seed_from_u64(8_000_000 + seed);
        let mut others: Vec<u32> =
            (0..HELDOUT).map(|_| rng.random_range(0..basis.n_vertices() as u32)).collect();
        others.retain(|vertex| !sites.contains(vertex));
        let measured: Vec<u32> = sites.iter().chain(&others).copied().collect();
        let erp = match self.origin {
            Origin::Strip => strips(basis, &fields, &measured, seed),
            _ => [erp_s2 as fn(f64, f64) -> f64, erp_s3].map(|erp| {
                fields[0].iter().zip(&fields[1]).map(|(tau, apd)| erp(*tau, *apd)).collect()
            }),
        };
        let (train, heldout) = (self.table(&sites, &erp, ""), self.table(&others, &erp, "h"));
        let [tau_out, apd_max] = fields;
        let [s2, s3] = erp;
        Case { train, heldout, maps: [tau_out, apd_max, s2, s3] }
    }

    /// The brackets of both protocols at these sites.
    fn table(&self, sites: &[u32], erp: &[Vec<f64>; 2], prefix: &str) -> Measurements {
        let mut rows = vec![];
        for (i, vertex) in sites.iter().enumerate() {
            for (protocol, erp) in ["s1s2", "s1s2s3"].iter().zip(erp) {
                let lower = (erp[*vertex as usize] / self.width).floor() * self.width;
                if lower.is_finite() {
                    let cells = [format!("{prefix}{i}"), vertex.to_string(), (*protocol).into()];
                    let ends = [lower, lower + self.width].map(|x| x.to_string());
                    rows.push(cells.into_iter().chain(ends).collect());
                }
            }
        }
        let header = ["site", "vertex", "protocol", "lower", "upper"].map(str::to_owned);
        Measurements::from_cells("coverage", header.to_vec(), rows).unwrap()
    }
}

/// `tau_out` in 1–30 ms; `apd_max` from 120 ms to where ERP_S2 is 280 ms, at most 270 ms.
fn bounded(basis: &Basis, seed: u64) -> [Vec<f64>; 2] {
    let mut rng = ChaCha8Rng::seed_from_u64(7_000_000 + seed);
    let mut logit = || {
        let lengthscale = 32.0 * 4f64.powf(rng.random::<f64>());
        let mean: f64 = 0.7 * rng.sample::<f64, _>(StandardNormal);
        let amplitude = rng.random_range(0.5..1.5);
        let eta: Vec<f64> = (0..basis.n_modes()).map(|_| rng.sample(StandardNormal)).collect();
        let unit = unit_field(basis, &Matern52(lengthscale), &eta);
        unit.into_iter().map(|x| mean + amplitude * x).collect::<Vec<f64>>()
    };
    let bent = |logit: f64, low: f64, high: f64| low + (high - low) / (1.0 + (-logit).exp());
    let tau_out: Vec<f64> = logit().into_iter().map(|x| bent(x, 1.0, 30.0)).collect();
    let apd_max = logit().into_iter().zip(&tau_out).map(|(x, t)| bent(x, 120.0, longest(*t)));
    let apd_max = apd_max.collect();
    [tau_out, apd_max]
}

/// The `apd_max` at which ERP_S2 is 280 ms, at most 270 ms.
fn longest(tau_out: f64) -> f64 {
    let (mut low, mut high) = (120.0, 270.0);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if erp_s2(tau_out, middle) < 280.0 { low = middle } else { high = middle }
    }
    low
}

/// ERP of strips with the parameters of these vertices and of some others; NaN elsewhere.
fn strips(basis: &Basis, fields: &[Vec<f64>; 2], sites: &[u32], seed: u64) -> [Vec<f64>; 2] {
    let cv_max = conduction(basis, 64.0, (0.5, 1.0), seed);
    let mut vertices: Vec<usize> = (0..basis.n_vertices()).step_by(STRIDE).collect();
    vertices.extend(sites.iter().map(|v| *v as usize));
    let tissue = |v: &usize| {
        let [tau_out, apd_max] = fields.each_ref().map(|field| field[*v]);
        Parameters { cv_max: cv_max[*v], tau_in: 0.05, tau_out, tau_open: 120.0, apd_max }.tissue()
    };
    let tissues: Vec<_> = vertices.iter().map(tissue).collect();
    let outcomes =
        simulate_strips(&tissues, &Grid::default(), &Protocol::default(), &|_| {}).unwrap();
    let mut erp = [vec![f64::NAN; basis.n_vertices()], vec![f64::NAN; basis.n_vertices()]];
    for (vertex, outcome) in vertices.into_iter().zip(outcomes) {
        erp[0][vertex] = outcome.erp_s2.map_or(f64::NAN, f64::from);
        erp[1][vertex] = outcome.erp_s3.map_or(f64::NAN, f64::from);
    }
    erp
}
