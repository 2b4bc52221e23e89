//! What several tests share: a basis of made-up numbers, tables, random numbers.
#![allow(dead_code, clippy::unwrap_used, reason = "each test uses a part of it")]

pub(crate) mod oracle;

use eplat::infer::LogDensity as _;
use eplat::manifold::Basis;
use eplat::model::Model;
use eplat::table::Measurements;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A seeded stream.
pub(crate) fn rng(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

/// `n_modes` made-up modes at `n_vertices` vertices, the first constant as on a closed surface.
pub(crate) fn basis(n_vertices: usize, n_modes: usize) -> Basis {
    let mut rng = rng(12345);
    Basis {
        eigenvalues: (0..n_modes).map(|k| 4e-4 * k as f64).collect(),
        eigenfunctions: (0..n_vertices * n_modes)
            .map(|i| if i % n_modes == 0 { 0.007 } else { rng.random_range(-0.012..0.012) })
            .collect(),
    }
}

/// The largest error of the gradient against central differences, relative to 1 + |derivative|, at `point`s
/// around the start.
pub(crate) fn gradient_error(model: &Model, point: u64) -> f64 {
    let mut rng = rng(point);
    let mut u = model.initial();
    for x in &mut u {
        *x += rng.random_range(-0.4..0.4);
    }
    let mut evaluator = model.evaluator();
    let mut gradient = vec![0.0; u.len()];
    assert!(evaluator.ln_density(&u, &mut gradient).is_finite());
    let mut f = |i: usize, h: f64| {
        let mut x = u.clone();
        x[i] += h;
        evaluator.ln_density(&x, &mut vec![0.0; x.len()])
    };
    let mut error: f64 = 0.0;
    for (i, slope) in gradient.iter().enumerate() {
        let central =
            |f: &mut dyn FnMut(usize, f64) -> f64, h: f64| (f(i, h) - f(i, -h)) / (2.0 * h);
        let difference = (4.0 * central(&mut f, 5e-6) - central(&mut f, 1e-5)) / 3.0;
        error = error.max((difference - slope).abs() / (1.0 + slope.abs()));
    }
    error
}

/// A table from a header and rows of text.
pub(crate) fn table(header: &str, rows: &[String]) -> Measurements {
    let cells = |line: &str| line.split(',').map(String::from).collect::<Vec<_>>();
    Measurements::from_cells("test", cells(header), rows.iter().map(|r| cells(r)).collect())
        .unwrap()
}

/// Eighty numbers at fewer places, of a smooth function and noise, by two catheters.
pub(crate) fn numbers_on(basis: &Basis, protocols: &[&str]) -> Measurements {
    let mut rng = rng(7);
    let line = |i: usize| {
        let vertex = rng.random_range(0..basis.n_vertices());
        let smooth = 100.0 * (basis.at(vertex)[1] + basis.at(vertex)[2]);
        let value = 1.0 + smooth + rng.random_range(-0.6..0.6);
        let catheter = ["A", "B"][i % 2];
        let (dose, force) = (1.0 + (7 * i % 11) as f64 / 5.0, (5 * i % 13) as f64 / 6.0);
        let protocol = protocols[i / 2 % protocols.len()];
        format!("{protocol},{vertex},{value},{catheter},{dose},{force}")
    };
    let lines: Vec<String> = (0..80).map(line).collect();
    let mut rows = table("protocol,vertex,value,catheter,dose,force", &lines);
    rows.place_at_indices(basis.n_vertices()).unwrap();
    rows
}

/// Fifty rows of every protocol of the model `Mixed`, at as many vertices.
pub(crate) fn mixed_rows() -> Measurements {
    let mut rng = rng(3);
    let protocols = ["warm_up", "s1s2", "open", "direct", "beats"];
    let row = |i: usize| {
        let lower = 190.0 + 10.0 * (i % 3) as f64;
        let value = match i % 5 {
            0 => 4.0 + (i % 3) as f64,
            3 => 195.0 + (i % 9) as f64,
            _ => (i % 11) as f64,
        };
        let (force, dose) = (rng.random_range(0.5..3.0), rng.random_range(0.0..2.0));
        let protocol = protocols[i % 5];
        format!("{protocol},{},{lower},{},{value},{force},{dose},c{}", 3 * i, lower + 10.0, i % 3)
    };
    let lines: Vec<String> = (0..50).map(row).collect();
    let header = "protocol,vertex,lower,upper,value,force_g,dose,catheter";
    let mut table = table(header, &lines);
    table.place_at_indices(200).unwrap();
    table
}
