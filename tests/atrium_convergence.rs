//! Conduction velocity of the surface solver against the length of edges and of time steps.
//!
//! ```text
//! cargo test --release --test atrium_convergence -- --nocapture
//! ```

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests")]

use eplat::ep::Parameters;
use eplat::ep::surface::{Pacing, Simulation, Substrate};
use eplat::mesh::TriMesh;

/// Length of the sheet, mm; CV is measured over its middle third.
const LENGTH: f64 = 18.0;

/// A sheet two squares wide, whose diagonals alternate.
fn sheet(edge: f64) -> TriMesh {
    let n = (LENGTH / edge).round() as u32;
    let node = |i: u32, j: u32| 3 * j + i;
    let vertices = (0..=n).flat_map(|j| (0..3).map(move |i| (i, j)));
    let vertices = vertices.map(|(i, j)| [f64::from(j) * edge, f64::from(i) * edge, 0.0]);
    let mut triangles = vec![];
    for (i, j) in (0..n).flat_map(|j| (0..2).map(move |i| (i, j))) {
        let (p, q, r, t) = (node(i, j), node(i + 1, j), node(i, j + 1), node(i + 1, j + 1));
        triangles.extend(if (i + j) % 2 == 0 {
            [[p, t, q], [p, r, t]]
        } else {
            [[p, r, q], [q, r, t]]
        });
    }
    TriMesh::new(vertices.collect(), triangles).unwrap()
}

/// CV, m/s, of tissue whose continuous `CV_max` is 0.7 m/s.
fn cv(edge: f64, dt: f64) -> f64 {
    let mesh = sheet(edge);
    let tissue = Parameters::from_array([0.7, 0.05, 10.0, 120.0, 200.0]).tissue();
    let tissue = vec![tissue; mesh.n_vertices()];
    let substrate = Substrate { mesh: &mesh, tissue: &tissue, fibres: None };
    let is_paced = |v: &u32| mesh.vertices()[*v as usize][0] < 1.21;
    let pacing = Pacing {
        vertices: (0..mesh.n_vertices() as u32).filter(is_paced).collect(),
        times: vec![0.0],
        strength: 1.0,
        end: 40.0,
        measured: 0,
    };
    let mut simulation = Simulation::<f64>::new(&substrate, &pacing, dt).unwrap();
    while !simulation.is_done() {
        simulation.step().unwrap();
    }
    let lat = simulation.beat().lat;
    let at = |x: f64| {
        let v = mesh.vertices().iter().position(|p| (p[0] - x).abs() < 1e-6 && p[1] < 1e-9);
        lat[v.unwrap()]
    };
    (LENGTH / 3.0) / (at(2.0 * LENGTH / 3.0) - at(LENGTH / 3.0))
}

#[test]
fn the_velocity_converges_in_edges_and_steps() {
    let (edges, steps) = ([0.6, 0.4, 0.3, 0.2, 0.1, 0.05, 0.025], [0.2, 0.1, 0.05, 0.025, 0.0125]);
    println!("CV, m/s; edge (mm) down, dt (ms) across\n      {steps:?}");
    let row = |edge: &f64| {
        let row: Vec<f64> = steps.iter().map(|dt| cv(*edge, *dt)).collect();
        println!("{edge:5} {row:.4?}");
        row
    };
    let table: Vec<Vec<f64>> = edges.iter().map(row).collect();
    // P1 elements: second order in the edge, once it is shorter than the front
    let at = |edge: usize| table[edge][4];
    let ratio = (at(4) - at(5)) / (at(5) - at(6));
    println!("0.1 to 0.05 mm over 0.05 to 0.025 mm: {ratio:.2}");
    assert!((3.0..5.0).contains(&ratio));
    // splitting and forward Euler: first order in the step
    let row = &table[5];
    let ratio = (row[2] - row[3]) / (row[3] - row[4]);
    println!("0.05 to 0.025 ms over 0.025 to 0.0125 ms: {ratio:.2}");
    assert!((1.6..2.5).contains(&ratio));
    // what the defaults are off by
    println!("0.3 mm and 0.1 ms: {:+.1} %", 100.0 * (table[2][1] / at(6) - 1.0));
    assert!((table[2][1] / at(6) - 1.0).abs() < 0.06);
}
