//! The strip simulator against the authors' openCARP table.

#![allow(clippy::unwrap_used, clippy::print_stdout, clippy::float_cmp, reason = "helpers of tests")]

#[path = "support/skipped.rs"]
mod skipped;

use std::path::PathBuf;

use eplat::ep::{Grid, Parameters, Protocol, StripOutcome, Tissue, simulate_strips};

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
        skipped::skipped("reference data not found");
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

/// S1; parameters in the order of `RANGES`; CV and APD90 of S1, ERP_S2, ERP_S3 (0: absent) by another
/// program (the C++ prototype of these simulations, without the reference's offset of APD).
///
/// Where the last tissue recovers only after the next stimulus there is no ERP, as in row 51 of the
/// authors' table.
#[rustfmt::skip]
const FAST_PACING: [(u32, [f64; 5], [f64; 4]); 12] = [
    (350, [0.2675, 0.2249, 10.11, 146.5, 243.1], [0.0, 0.0, 0.0, 0.0]),
    (350, [0.1816, 0.08667, 27.6, 104.8, 143.4], [0.0, 0.0, 0.0, 0.0]),
    (350, [0.4493, 0.08513, 24.88, 140.4, 239.9], [0.29285, 273.7648, 283.0, 0.0]),
    (350, [0.3473, 0.2997, 11.9, 138.9, 257.9], [0.23525, 248.3856, 276.0, 0.0]),
    (350, [0.6168, 0.2867, 25.83, 93.04, 234.9], [0.0, 0.0, 0.0, 0.0]),
    (350, [0.2388, 0.1868, 6.256, 118.7, 228.7], [0.19201, 223.5524, 243.0, 213.0]),
    (450, [0.1265, 0.2011, 9.868, 71.64, 223.2], [0.12744, 265.7041, 278.0, 0.0]),
    (450, [0.143, 0.1074, 19.09, 114.7, 267.6], [0.0, 0.0, 0.0, 0.0]),
    (450, [0.1028, 0.2493, 26.39, 142.3, 130.8], [0.09603, 203.5430, 230.0, 0.0]),
    (450, [1.489, 0.06502, 26.13, 173.3, 254.9], [1.09750, 309.2562, 319.0, 0.0]),
    (450, [0.8712, 0.06948, 25.36, 147.5, 229.1], [0.71343, 291.4491, 300.0, 0.0]),
    (450, [0.7118, 0.1611, 29.86, 175.0, 139.1], [0.59846, 215.5446, 239.0, 218.0]),
];

#[test]
fn fast_pacing_agrees_with_another_program() {
    for s1 in [350, 450] {
        let rows: Vec<_> = FAST_PACING.into_iter().filter(|row| row.0 == s1).collect();
        let tissues: Vec<Tissue> =
            rows.iter().map(|row| Parameters::from_array(row.1).tissue()).collect();
        let protocol = Protocol { s1, ..Protocol::default() };
        let found = simulate_strips(&tissues, &Grid::default(), &protocol, &|_| ()).unwrap();
        for ((_, parameters, [cv, apd90, erp_s2, erp_s3]), outcome) in rows.into_iter().zip(&found)
        {
            let expected = [erp_s2, erp_s3].map(|erp| (erp > 0.0).then_some(erp as u32));
            let erps = [outcome.erp_s2.ok(), outcome.erp_s3.ok()];
            assert_eq!(erps, expected, "S1 {s1}, {parameters:?}: {outcome:?}");
            assert_eq!(outcome.s1.is_ok(), cv > 0.0, "{parameters:?}");
            if let Ok(beat) = outcome.s1 {
                assert!((beat.cv - cv).abs() < 1e-5, "{parameters:?}: {}", beat.cv);
                let apart = beat.apd90 + Grid::default().dt - apd90;
                assert!(apart.abs() < 1e-4, "{parameters:?}: {apart}");
            }
        }
    }
}
