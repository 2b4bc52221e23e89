#![allow(clippy::all, warnings)]
#[path = "../models/lat_fibres.rs"]
mod lat_fibres;
use eplat::infer::Settings;
use eplat::mesh::Reading;
use eplat::model::Model;
use eplat::run::*;
#[test]
#[ignore]
fn how_far_off() {
    let mesh = MeshSource::File {
        path: "/work/shared/data/fibernet/LA_model.vtk".into(),
        reading: Reading::default(),
        whole: false,
    };
    let table = std::env::var("TABLE").unwrap_or("/tmp/w/new600x3.csv".into());
    let inputs = Inputs { mesh, data: DataSource::File(table.into()), ..Inputs::default() };
    let problem = Problem::load(&lat_fibres::LatFibres, &inputs).unwrap();
    let settings = Settings { chains: 2, warmup: 200, draws: 100, seed: 1, ..Settings::default() };
    let fit = problem.fit(&settings).unwrap();
    let draws = fit.thinned(12).unwrap();
    let loaded = problem.loaded();
    let model = fit.model();
    let ids = model.row_ids();
    let mut other = Model::new(problem.declared(), loaded.basis(), &loaded.measurements).unwrap();
    let at = |m: &Model, u: &[f64]| {
        let mut t = m.tape();
        let mut out = vec![];
        m.locals_at(&mut t, u, &ids, &mut out);
        out
    };
    let rms = |x: &[f64]| (x.iter().map(|x| x * x).sum::<f64>() / x.len() as f64).sqrt();
    let n_loc = model.n_locals(ids[0]);
    let pick = |x: Vec<f64>| -> Vec<f64> { x.chunks(n_loc).map(|c| c[2]).collect() };
    println!("locals {n_loc} {:?}", &at(model, &draws[0])[..n_loc]);
    let mut sum: Vec<f64> = vec![0.0; ids.len()];
    let mut all = vec![];
    let mut plain = vec![];
    for d in &draws {
        let here = pick(at(model, d));
        let rough = pick(at(
            &Model::new(problem.declared(), loaded.basis(), &loaded.measurements).unwrap(),
            d,
        ));
        other.correct_at(d).unwrap();
        let fine = pick(at(&other, d));
        let gap: Vec<f64> = fine.iter().zip(&here).map(|(a, b)| a - b).collect();
        let p: Vec<f64> = fine.iter().zip(&rough).map(|(a, b)| a - b).collect();
        sum.iter_mut().zip(&gap).for_each(|(s, g)| *s += g / draws.len() as f64);
        println!("gap of a draw {:.3}, uncorrected {:.3}", rms(&gap), rms(&p));
        all.push(gap);
        plain.push(p);
    }
    let spread: Vec<f64> = all
        .iter()
        .map(|g| {
            let d: Vec<f64> = g.iter().zip(&sum).map(|(a, b)| a - b).collect();
            rms(&d)
        })
        .collect();
    println!("mean gap {:.3}, spread about it {:.3}", rms(&sum), rms(&spread));
    // second correction at a draw
    other.correct_at(&draws[6]).unwrap();
    let gaps: Vec<f64> = draws
        .iter()
        .map(|d| {
            let h = pick(at(&other, d));
            let mut m =
                Model::new(problem.declared(), loaded.basis(), &loaded.measurements).unwrap();
            m.correct_at(d).unwrap();
            let f = pick(at(&m, d));
            rms(&f.iter().zip(&h).map(|(a, b)| a - b).collect::<Vec<_>>())
        })
        .collect();
    println!("corrected at a draw: {gaps:.3?}");
}
