//! Seconds for a beat of a whole atrium of 110,000 vertices, in single and double precision.
//!
//! ```text
//! cargo bench --bench atrium
//! ```
//! A node-step is 0.1 ms of one vertex, at rest or not, with its five substeps of the cell. Threads are as
//! many as rayon takes (`RAYON_NUM_THREADS`); CPU seconds count all of them.
#![allow(clippy::unwrap_used, clippy::print_stdout, missing_docs, reason = "a bench")]

use std::time::Instant;

use eplat::ep::surface::{BeatMap, Pacing, simulate_surface};
use eplat::ep::{Parameters, Precision, Tissue};
use eplat::mesh::{TriMesh, left_atrium};

#[path = "../tests/support/cpu.rs"]
mod cpu;

use cpu::cpu_seconds;

/// Interval of the beats, ms.
const S1: f64 = 600.0;

fn beats<F: Precision>(mesh: &TriMesh, n: usize) -> BeatMap {
    let z = mesh.bounding_box().map(|corner| corner[2]);
    let fields = |p: &[f64; 3]| {
        let s = (p[2] - z[0]) / (z[1] - z[0]);
        Parameters::from_array([0.7, 0.05, 5.0 + 10.0 * s, 120.0, 180.0 + 40.0 * s]).tissue()
    };
    let tissue: Vec<Tissue> = mesh.vertices().iter().map(fields).collect();
    let near =
        |p: &[f64; 3]| (0..3).map(|k| (p[k] - mesh.vertices()[0][k]).powi(2)).sum::<f64>() < 9.0;
    let vertices = (0..mesh.n_vertices() as u32).filter(|v| near(&mesh.vertices()[*v as usize]));
    let pacing = Pacing {
        vertices: vertices.collect(),
        times: (0..n).map(|i| i as f64 * S1).collect(),
        strength: 1.0,
        end: n as f64 * S1,
        measured: n - 1,
    };
    let (wall, cpu, mut iterations) = (Instant::now(), cpu_seconds(), 0);
    let beat = simulate_surface::<F>(mesh, &tissue, &pacing, 0.1, &mut |moment| {
        iterations = moment.n_iterations();
    });
    let (wall, cpu) = (wall.elapsed().as_secs_f64(), cpu_seconds() - cpu);
    let steps = pacing.end / 0.1;
    println!(
        "{n} beats {:4} {wall:6.1} s, {cpu:6.1} CPU s, {:.2e} node-steps per CPU second, {:.2} iterations a step",
        std::any::type_name::<F>(),
        steps * mesh.n_vertices() as f64 / cpu,
        iterations as f64 / steps
    );
    beat.unwrap()
}

fn main() {
    let edge = std::env::args().skip(1).find_map(|a| a.parse().ok()).unwrap_or(0.32);
    let mesh = left_atrium(edge).mesh;
    println!("{} vertices, edges {:.2} mm", mesh.n_vertices(), mesh.mean_edge_length());
    let single = beats::<f32>(&mesh, 1);
    let double = beats::<f64>(&mesh, 1);
    let worst =
        |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    println!(
        "largest difference: LAT {:.4} ms, APD90 {:.4} ms",
        worst(&single.lat, &double.lat),
        worst(&single.apd90, &double.apd90)
    );
    if edge < 0.5 {
        beats::<f32>(&mesh, 8);
    }
}
