//! Made-up summaries and records for the tests of this layer.

use std::collections::BTreeMap;

use super::{
    LeftOutBy, LooRecord, LooRow, Predicted, PredictedRow, Predictions, Provenance, Row, RunRecord,
    Seconds, SettingsRecord,
};
use crate::diagnostics::Summary;
use crate::diagnostics::verdict::{Questions, Verdict};

/// A well-behaved quantity with this mean and a tenth of it as standard deviation.
pub(super) fn row(name: &str, unit: &str, mean: f64) -> Row {
    let sd = 0.1 * mean.abs();
    let summary = Summary {
        mean,
        sd,
        mcse: sd / 40.0,
        q5: mean - 1.64 * sd,
        q50: mean,
        q95: mean + 1.64 * sd,
        ess_bulk: 1600.0,
        ess_tail: 1512.7,
        r_hat: 1.0021,
        mcse_sd: sd / 56.0,
        mcse_q5: sd / 19.0,
        mcse_q50: sd / 32.0,
        mcse_q95: sd / 19.0,
    };
    Row { name: name.to_owned(), unit: unit.to_owned(), summary }
}

/// A run of 4 × 1000 draws without any trouble.
pub(super) fn record() -> RunRecord {
    RunRecord {
        model: "Erp".to_owned(),
        version: "0.1.0".to_owned(),
        seed: 1,
        provenance: Provenance {
            mesh: Some("atrium <1>.vtk".to_owned()),
            n_vertices: 5166,
            data: "brackets.csv".to_owned(),
            n_rows: 20,
            n_sites: 10,
            command: "eplat run erp.rs".to_owned(),
            date: "2026-11-22".to_owned(),
            ..Provenance::default()
        },
        settings: SettingsRecord {
            chains: 4,
            warmup: 1000,
            draws: 1000,
            most_draws: None,
            target_accept: Some(0.95),
            metric: "diag".to_owned(),
            sampler: "nuts".to_owned(),
        },
        hashes: BTreeMap::from([("mesh".to_owned(), "ab12".to_owned())]),
        files: BTreeMap::new(),
        n_params: 54,
        grad_evals: 901_234,
        ns_per_grad: 1830.5,
        sampler_ns_per_grad: 410.25,
        seconds: Seconds { compile: 0.0, setup: 1.25, warmup: 2.0, sampling: 2.5, total: 5.75 },
        failed_chains: vec![],
        divergences: 0,
        max_r_hat: 1.0021,
        min_ess_bulk: 1600.0,
        min_ess_tail: 1512.7,
        ess_per_second: 605.1,
        e_bfmi: 0.83,
        rmse: Some(BTreeMap::from([("tau_out".to_owned(), 2.25)])),
        coverage: Some(BTreeMap::from([("tau_out".to_owned(), [0.48, 0.871, 0.93])])),
        units: BTreeMap::from([("tau_out".to_owned(), "ms".to_owned())]),
        unphysical: None,
        divergent_at: vec![],
        strays: None,
        not_simulated: vec![],
        loo: Some(LooRecord {
            elpd_loo: -52.25,
            se: 4.1,
            p_loo: 8.2,
            n_measurements: 20,
            k_threshold: 0.7,
            n_high_k: 0,
            n_integrated: 0,
            n_left_out: 0,
            worst: vec![],
        }),
        laplace: None,
        questions: Questions::default(),
        verdict: Verdict::default(),
    }
}

/// A measurement of ERP_S2 that the others predict with this log density, k = 0.5.
pub(super) fn loo_row(measurement: &str, site: usize, elpd: f64) -> LooRow {
    LooRow {
        measurement: measurement.to_owned(),
        place: format!("at site {site}"),
        likelihood: "TopHat".to_owned(),
        observed: "240 250".to_owned(),
        elpd,
        pareto_k: 0.5,
        loo_by: LeftOutBy::Weights,
    }
}

/// Three brackets: one that fits, one at the edge that is not predicted from the others, one far off.
pub(super) fn predictions() -> Predictions {
    let predicted = |middle: f64, n_inside: usize| Predicted {
        quantiles: [middle - 10.0, middle, middle + 10.0],
        inside: std::array::from_fn(|i| i + n_inside >= 4),
    };
    let row = |line: u64, lower: f64, fitted, left_out| PredictedRow {
        line,
        protocol: "s1s2".to_owned(),
        site: (line - 1).to_string(),
        unit: "ms".to_owned(),
        measured: [lower, lower + 10.0],
        fitted,
        left_out,
    };
    let rows = vec![
        row(2, 230.0, predicted(235.0, 4), Some((predicted(240.0, 3), LeftOutBy::Weights))),
        row(3, 240.0, predicted(235.0, 3), None),
        row(4, 290.0, predicted(235.0, 0), Some((predicted(225.0, 1), LeftOutBy::Fit))),
    ];
    Predictions { rows, sets: vec![("all".to_owned(), vec![0, 1, 2])] }
}
