#![allow(clippy::all, clippy::pedantic, clippy::unwrap_used, clippy::print_stdout)]
use eplat::infer::LogDensity as _;
use eplat::manifold::eigenpairs;
use eplat::mesh::{Reading, read};
use eplat::model::Model;
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
    let t = std::time::Instant::now();
    data.probe(&surface, &basis).unwrap();
    println!("probe {:?}, {} vertices", t.elapsed(), data.waves().unwrap().vertices.len());
    let model = Model::new(&m::LatFibres, Some(&basis), &data).unwrap();
    let us: Vec<Vec<f64>> = std::fs::read_to_string("/tmp/draws.csv")
        .unwrap()
        .lines()
        .map(|l| l.split(',').map(|x| x.parse().unwrap()).collect())
        .collect();
    let mut e = model.evaluator();
    let dim = us[0].len();
    let mut g = vec![0.0; dim];
    let t = std::time::Instant::now();
    for _ in 0..20 {
        e.ln_density(&us[0], &mut g);
    }
    println!("gradient {:?}", t.elapsed() / 20);
    let n = 400;
    for k in 0..4 {
        let (u, w) = (&us[k], &us[(k + 1) % 4]);
        for scale in [0.02, 0.1] {
            let step = scale / n as f64;
            let mut lp = vec![];
            let mut slope = vec![];
            for i in 0..n {
                let x: Vec<f64> =
                    u.iter().zip(w).map(|(a, b)| a + step * i as f64 * (b - a)).collect();
                lp.push(e.ln_density(&x, &mut g));
                slope.push(
                    g.iter().zip(u.iter().zip(w)).map(|(g, (a, b))| g * (b - a)).sum::<f64>(),
                );
            }
            // integral of slope against lp differences
            let mut gaps: Vec<f64> = (1..n)
                .map(|i| lp[i] - lp[i - 1] - 0.5 * step * (slope[i] + slope[i - 1]))
                .collect();
            let total = lp[n - 1] - lp[0];
            let sum: f64 = gaps.iter().sum();
            gaps.sort_by(|a, b| a.abs().total_cmp(&b.abs()));
            println!(
                "scale {scale}: lp {:.2} to {:.2}, change {total:.3}, unexplained by slopes {sum:.3}; largest jumps {:.4?}, median {:.1e}; slopes jump {:.3?}",
                lp[0],
                lp[n - 1],
                &gaps[n - 6..],
                gaps[n / 2].abs(),
                {
                    let mut j: Vec<f64> = (1..n).map(|i| (slope[i] - slope[i - 1])).collect();
                    j.sort_by(|a, b| a.abs().total_cmp(&b.abs()));
                    j[n - 5..].to_vec()
                }
            );
        }
    }
}
