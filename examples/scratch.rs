#![allow(clippy::all, clippy::pedantic, clippy::unwrap_used, clippy::print_stdout)]
use eplat::infer::LogDensity as _;
use eplat::manifold::{Front, Medium, eigenpairs};
use eplat::mesh::{Reading, read};
use eplat::model::{Maps, Model};
use eplat::prelude::*;
use eplat::table::Measurements;
#[path = "../models/lat_fibres.rs"]
mod m;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let surface = read(a[1].as_ref(), Reading::default()).unwrap();
    let basis = eigenpairs(&surface.mesh, 64).unwrap();
    let mut data = Measurements::read(a[2].as_ref()).unwrap();
    data.place_on(&surface, 1.0).unwrap();
    data.probe(&surface, &basis).unwrap();
    let model = Model::new(&m::LatFibres, Some(&basis), &data).unwrap();
    let mut e = model.evaluator();
    let maps = Maps::new(&model, &basis);
    let w = data.waves().unwrap();
    let at: Vec<usize> = w.vertices.iter().map(|v| *v as usize).collect();
    let mut sources = w.source.clone();
    sources.sort();
    sources.dedup();
    let mut solve = |u: &[f64]| {
        let d = maps.draws_at(&[u], &at);
        let slow: Vec<f64> = d.iter().map(|m| 1.0 / m[0][0]).collect();
        let angle: Vec<f64> = d.iter().map(|m| m[1][0]).collect();
        let ratio: Vec<f64> = d.iter().map(|m| m[0][0] / m[3][0]).collect();
        sources
            .iter()
            .map(|s| {
                let mut f = Front::default();
                w.solver.forward(
                    &Medium { slowness: &slow, ratio: Some(&ratio), angle: Some(&angle) },
                    &[(*s, 0.0)],
                    &mut f,
                );
                f.arrival.clone()
            })
            .collect::<Vec<_>>()
    };
    for file in &a[3..] {
        let us: Vec<Vec<f64>> = std::fs::read_to_string(file)
            .unwrap()
            .lines()
            .map(|l| l.split(',').map(|x| x.parse().unwrap()).collect())
            .collect();
        let mut g = vec![0.0; us[0].len()];
        let (mut lo, mut hi) = (us[0].clone(), us[1].clone());
        let (l0, l1) = (e.ln_density(&lo, &mut g), e.ln_density(&hi, &mut g));
        for _ in 0..40 {
            let mid: Vec<f64> = lo.iter().zip(&hi).map(|(a, b)| 0.5 * (a + b)).collect();
            let (a, b, c) =
                (e.ln_density(&lo, &mut g), e.ln_density(&mid, &mut g), e.ln_density(&hi, &mut g));
            if (b - a).abs() > (c - b).abs() { hi = mid } else { lo = mid }
        }
        println!(
            "{file}: {l0:.3} {l1:.3}; jump {:.4}",
            e.ln_density(&hi, &mut g) - e.ln_density(&lo, &mut g)
        );
        let (x, y) = (solve(&lo), solve(&hi));
        for s in 0..3 {
            let mut d: Vec<(usize, f64)> = (0..at.len())
                .map(|v| (v, y[s][v] - x[s][v]))
                .filter(|d| d.1.abs() > 1e-4)
                .collect();
            d.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
            println!(
                "   source {s} ({}): {} vertices: {:?}",
                sources[s],
                d.len(),
                d.iter()
                    .take(6)
                    .map(|(v, d)| format!("{v}(t {:.2}): {d:.3}", x[s][*v]))
                    .collect::<Vec<_>>()
            );
        }
    }
}
