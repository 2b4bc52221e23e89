//! The strip simulator against the authors' openCARP table.

#![allow(clippy::unwrap_used, clippy::print_stdout, clippy::float_cmp, reason = "helpers of tests")]

use std::path::PathBuf;

use eplat::ep::{Grid, Protocol, StripOutcome, Tissue, simulate_strips};

struct Row {
    tissue: Tissue,
    /// CV and APD90 of S1, ERP under S1S2; CV and APD90 of S2, ERP under S1S2S3.
    expected: [Option<f64>; 6],
}

fn reference() -> Option<Vec<Row>> {
    let shared = std::env::var_os("EPLAT_SHARED")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared"), PathBuf::from);
    let path = shared.join("data/opencarp_strip_100.csv");
    if !path.exists() {
        println!("reference data not found: skipped");
        return None;
    }
    let mut reader = csv::Reader::from_path(path).unwrap();
    let rows = reader.records().map(|record| {
        let record = record.unwrap();
        let cell = |i: usize| record[i].parse::<f64>().ok();
        let number = |i: usize| cell(i).unwrap();
        let tissue = Tissue {
            diffusivity: 100.0 * number(1),
            tau_in: number(2),
            tau_out: number(3),
            tau_open: number(4),
            tau_close: number(5),
        };
        Row { tissue, expected: std::array::from_fn(|i| cell(8 + i)) }
    });
    Some(rows.collect())
}

fn values(outcome: &StripOutcome) -> [Option<f64>; 6] {
    [
        outcome.s1.ok().map(|b| b.cv),
        outcome.s1.ok().map(|b| b.apd90),
        outcome.erp_s2.ok().map(f64::from),
        outcome.s2.ok().map(|b| b.cv),
        outcome.s2.ok().map(|b| b.apd90),
        outcome.erp_s3.ok().map(f64::from),
    ]
}

/// RMSE of each column; panics where one side has a value and the other has none.
fn rmse(rows: &[Row], outcomes: &[StripOutcome]) -> [f64; 6] {
    std::array::from_fn(|column| {
        let (mut sum, mut n) = (0.0, 0.0);
        for (i, (row, outcome)) in rows.iter().zip(outcomes).enumerate() {
            match (row.expected[column], values(outcome)[column]) {
                (Some(expected), Some(got)) => {
                    sum += (got - expected).powi(2);
                    n += 1.0;
                }
                (None, None) => {}
                other => panic!("row {i}, column {column}: expected and got {other:?}"),
            }
        }
        f64::sqrt(sum / n)
    })
}

#[test]
fn the_opencarp_table() {
    let Some(rows) = reference() else { return };
    let tissues: Vec<Tissue> = rows.iter().map(|row| row.tissue).collect();
    let outcomes =
        simulate_strips(&tissues, &Grid::default(), &Protocol::default(), &|_| ()).unwrap();
    let error = rmse(&rows, &outcomes);
    println!("{} rows, RMSE {error:?}", rows.len());
    assert!(error[0] <= 0.001 && error[3] <= 0.001, "CV, m/s");
    assert!(error[1] <= 0.05 && error[4] <= 0.05, "APD90, ms");
    assert!(error[2] == 0.0 && error[5] == 0.0, "ERP, ms");
}
