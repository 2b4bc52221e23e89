//! Fields as effects: over the surface, and along the paths that activation takes over it.

#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/shipped.rs"]
mod shipped;
mod support;

use std::collections::BTreeMap;

use std::ops::ControlFlow;

use eplat::criticism::{Criticism, SearchSettings, Subject, criticise};
use eplat::infer::LogDensity as _;
use eplat::manifold::{Basis, eigenpairs, integrate_along_paths};
use eplat::mesh::{Surface, left_atrium};
use eplat::model::forms::{path, surface as surface_form};
use eplat::model::{AddedEffect, Augmented, Model};
use eplat::table::Measurements;
use rand::RngExt as _;
use rand_distr::StandardNormal;
use shipped::shipped;
use support::rng;

mod declared {
    use eplat::prelude::*;
    model! {
        /// `models/lat.rs` with two effects that are fields.
        model Declared;
        column path_mm [mm];
        param onset    [ms]    ~ Normal(0.0, 100.0);
        param slowness [ms/mm] ~ Normal(1.0, 0.5);
        param noise    [ms]    ~ HalfNormal(20.0);
        let arrival(row) [ms] = onset + slowness * row.path_mm;
        observe lat(row): Number [ms] ~ Normal(arrival(row), noise);

        effect delay on arrival [ms] = surface(row, 8, 30.0) ~ Normal(0.0, 10.0);
        effect slow on arrival [ms] = path(row, 12, 20.0) ~ Normal(0.0, 0.2);
    }
}

fn surface() -> (Surface, Basis) {
    let mesh = left_atrium(3.0).mesh;
    let basis = eigenpairs(&mesh, 24).unwrap();
    (Surface::new(mesh, BTreeMap::new()), basis)
}

/// `n` sites, folds by octants, and arrival times from vertex 0.
fn table(
    surface: &Surface,
    basis: &Basis,
    n: usize,
    lat: &dyn Fn(u32, f64) -> f64,
) -> Measurements {
    let mut rng = rng(21);
    let header = ["site", "vertex", "source", "fold", "lat"].map(String::from).to_vec();
    let vertices: Vec<u32> =
        (0..n).map(|_| rng.random_range(1..surface.mesh.n_vertices() as u32)).collect();
    let row = |(site, v): (usize, &u32)| {
        let p = surface.mesh.vertices()[*v as usize];
        let centre = surface.mesh.vertices()[0];
        let octant: String =
            p.iter().zip(centre).map(|(a, b)| if *a > b { '+' } else { '-' }).collect();
        vec![site.to_string(), v.to_string(), "0".into(), octant, "0".into()]
    };
    let cells: Vec<Vec<String>> = vertices.iter().enumerate().map(row).collect();
    let placed = |cells: Vec<Vec<String>>| {
        let mut table = Measurements::from_cells("made", header.clone(), cells).unwrap();
        table.place_on(surface, 1.0).unwrap();
        table.probe(surface, basis).unwrap();
        table
    };
    let blank = placed(cells.clone());
    let mut cells = cells;
    for (row, vertex) in vertices.iter().enumerate() {
        let length: f64 = blank.cell(row, "path_mm").unwrap().parse().unwrap();
        let error = 3.0 * rng.sample::<f64, _>(StandardNormal);
        cells[row][4] = (lat(*vertex, length) + error).to_string();
    }
    placed(cells)
}

#[test]
fn declared_or_added_they_are_the_same() {
    let (surface, basis) = surface();
    let data = table(&surface, &basis, 30, &|_, length| 10.0 + 1.2 * length);
    let effect = |name: &str, form, sd| AddedEffect {
        name: name.into(),
        on: vec!["arrival".into()],
        unit: "ms".into(),
        form,
        sd,
    };
    let effects =
        [effect("delay", surface_form(8.0, 30.0), 10.0), effect("slow", path(12.0, 20.0), 0.2)];
    let augmented = Augmented::new(shipped("lat"), &effects);
    let added = Model::new(&augmented, Some(&basis), &data).unwrap();
    let declared = Model::new(&declared::Declared, Some(&basis), &data).unwrap();
    assert_eq!((added.dim(), declared.n_modes()), (3 + 8 + 12, 12));
    let u: Vec<f64> = (0..added.dim()).map(|i| (i as f64).sin()).collect();
    let density = |model: &Model| {
        let mut gradient = vec![0.0; u.len()];
        (model.evaluator().ln_density(&u, &mut gradient), gradient)
    };
    let ((a, ga), (b, gb)) = (density(&added), density(&declared));
    assert!((a - b).abs() < 1e-9 * a.abs(), "{a} {b}");
    assert!(ga.iter().zip(&gb).all(|(a, b)| (a - b).abs() < 1e-9 * (1.0 + a.abs())));
    assert_eq!(
        effects[1].statement(),
        "effect slow on arrival [ms] = path(row, 12, 20.0) ~ Normal(0.0, 0.2);"
    );
}

#[test]
fn a_field_needs_a_surface_and_a_path_a_source() {
    let bare = Measurements::from_cells(
        "made",
        ["path_mm", "lat"].map(String::from).to_vec(),
        vec![vec!["1".into(), "2".into()]],
    );
    let text = Model::new(&declared::Declared, None, &bare.unwrap()).unwrap_err().to_string();
    assert!(text.contains("delay") && text.contains("--mesh"), "{text}");
}

fn searched(lat: &dyn Fn(u32, f64) -> f64) -> (Vec<String>, Criticism) {
    let (surface, basis) = surface();
    let table = table(&surface, &basis, 150, lat);
    let case = Subject { model: shipped("lat"), basis: Some(&basis), table: &table };
    let settings = SearchSettings { nulls: 19, ..SearchSettings::default() };
    let outcome = criticise(&case, &settings, &|_| ControlFlow::Continue(())).unwrap();
    let names = outcome.findings().into_iter().map(ToString::to_string).collect();
    (names, outcome)
}

#[test]
fn one_velocity_is_enough_where_there_is_one() {
    let (names, outcome) = searched(&|_, length| 10.0 + 1.2 * length);
    assert!(names.is_empty() && outcome.ambiguous().is_empty(), "{names:?}");
}

#[test]
fn a_slowness_that_varies_is_found_along_the_paths() {
    let (surface, basis) = surface();
    // ∫ (1.2 + 0.4 φ₃/φ₀) ds
    let slowness: Vec<f64> =
        (0..basis.n_vertices()).map(|v| 0.4 * basis.at(v)[3] / basis.at(v)[0]).collect();
    let more = integrate_along_paths(&surface.mesh, 0, &slowness, 1).unwrap();
    let (names, outcome) = searched(&|v, length| 10.0 + 1.2 * length + more[v as usize]);
    assert_eq!(names, ["slowness_field"], "{:?}", outcome.rounds[0].tried);
}

#[test]
fn a_field_of_delays_is_told_from_one_of_slowness() {
    let (_, basis) = surface();
    let delay = |v: u32| 12.0 * basis.at(v as usize)[5] / basis.at(v as usize)[0];
    let (names, outcome) = searched(&|v, length| 10.0 + 1.2 * length + delay(v));
    assert_eq!(names, ["spatial_field"], "{:?}", outcome.rounds[0].tried);
}
