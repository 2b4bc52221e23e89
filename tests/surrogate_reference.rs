//! The ERP surrogates against the authors' published coefficients and table.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "helpers of tests")]

#[path = "support/skipped.rs"]
mod skipped;

use std::path::{Path, PathBuf};

use eplat::ep::table::read_rows;
use eplat::surrogate::cubic::TERMS;
use eplat::surrogate::{Cubic, ErpRow, erp_s2, erp_s3, fit_erp};

fn reference(name: &str) -> Option<PathBuf> {
    let shared = std::env::var_os("EPLAT_SHARED")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared"), PathBuf::from);
    let path = shared.join("data").join(name);
    if !path.exists() {
        skipped::skipped("reference data not found");
        return None;
    }
    Some(path)
}

/// The authors' polynomials for ERP_S2 and ERP_S3.
fn authors() -> Option<[Cubic; 2]> {
    let mut reader = csv::Reader::from_path(reference("surrogate_authors.csv")?).unwrap();
    let mut cubics = [Cubic([0.0; 10]); 2];
    for (i, record) in reader.records().enumerate() {
        let record = record.unwrap();
        assert_eq!(&record[0], TERMS[i]);
        for (output, cubic) in cubics.iter_mut().enumerate() {
            cubic.0[i] = record[1 + output].parse().unwrap();
        }
    }
    Some(cubics)
}

/// Root mean square difference of `f` and `g` where the authors' ERP_S2 is in 160–280 ms.
fn difference(
    erp_s2_authors: &Cubic,
    f: impl Fn(f64, f64) -> f64,
    g: impl Fn(f64, f64) -> f64,
) -> f64 {
    let (mut sum, mut n) = (0.0, 0.0);
    for i in 0..100 {
        for j in 0..100 {
            let t = 1.0 + 29.0 * (f64::from(i) + 0.5) / 100.0;
            let a = 120.0 + 150.0 * (f64::from(j) + 0.5) / 100.0;
            if (160.0..=280.0).contains(&erp_s2_authors.eval(t, a)) {
                sum += (f(t, a) - g(t, a)).powi(2);
                n += 1.0;
            }
        }
    }
    f64::sqrt(sum / n)
}

#[test]
fn the_projects_own_surrogates_are_near_the_authors() {
    let Some([s2, s3]) = authors() else { return };
    let d2 = difference(&s2, |t, a| s2.eval(t, a), erp_s2::<f64, f64>);
    let d3 = difference(&s2, |t, a| s3.eval(t, a), erp_s3::<f64, f64>);
    println!("rms difference: ERP_S2 {d2:.3} ms, ERP_S3 {d3:.3} ms");
    // Two designs of 100 points differ by about this much (seeds 1 to 3: 0.23–0.34 and 0.63–1.04):
    // a cubic leaves 0.5 and 1.3 ms unexplained, and where that shows depends on the design.
    assert!(d2 < 0.5 && d3 < 1.2);
}

#[test]
fn fitting_the_authors_table_gives_the_authors_coefficients() {
    let (Some([s2, s3]), Some(path)) = (authors(), reference("opencarp_strip_100.csv")) else {
        return;
    };
    let rows: Vec<ErpRow> = read_rows(&path).unwrap().into_iter().map(|(_, row)| row).collect();
    let fit = fit_erp(&rows, &(160.0..284.0)).unwrap();
    let d2 = difference(&s2, |t, a| s2.eval(t, a), |t, a| fit.erp_s2.cubic.eval(t, a));
    let d3 = difference(&s2, |t, a| s3.eval(t, a), |t, a| fit.erp_s3.cubic.eval(t, a));
    println!("rms difference: ERP_S2 {d2:.3} ms, ERP_S3 {d3:.3} ms");
    assert!(d2 < 0.2 && d3 < 0.1);
    // The residual RMSE of the authors' own ERP_S3 fit.
    assert!((fit.erp_s3.rmse - 0.976).abs() < 0.001);
}
