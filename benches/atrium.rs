//! Seconds for the beats of a whole atrium of 110,000 vertices, in single and double precision, and memory.
//!
//! ```text
//! cargo bench --bench atrium                 # a beat in f32 and f64, then 8 beats of 600 ms and 300 ms of a ninth
//! cargo bench --bench atrium -- 0.6          # a coarser atrium, without the nine beats
//! ```
//! A node-step is 0.1 ms of one vertex, at rest or not, with its five substeps of the cell. Threads are as
//! many as rayon takes (`RAYON_NUM_THREADS`); CPU seconds count all of them.
//!
//! Beside `TorchCor` on the same mesh: `benches/atrium_torchcor.py`.
#![allow(clippy::unwrap_used, clippy::print_stdout, missing_docs, reason = "a bench")]

use std::time::Instant;

use eplat::ep::surface::{BeatMap, Pacing, Simulation, Substrate};
use eplat::ep::{Parameters, Precision, Tissue};
use eplat::mesh::{TriMesh, left_atrium};

#[path = "../tests/support/cpu.rs"]
mod cpu;

use cpu::cpu_seconds;

/// Interval of the beats, ms.
const S1: f64 = 600.0;

/// Paces every 600 ms until `end`; the beat before the last.
fn beats<F: Precision>(mesh: &TriMesh, end: f64) -> BeatMap {
    let z = mesh.bounding_box().map(|corner| corner[2]);
    let fields = |p: &[f64; 3]| {
        let s = (p[2] - z[0]) / (z[1] - z[0]);
        Parameters::from_array([0.7, 0.05, 5.0 + 10.0 * s, 120.0, 180.0 + 40.0 * s]).tissue()
    };
    let tissue: Vec<Tissue> = mesh.vertices().iter().map(fields).collect();
    let near =
        |p: &[f64; 3]| (0..3).map(|k| (p[k] - mesh.vertices()[0][k]).powi(2)).sum::<f64>() < 9.0;
    let vertices = (0..mesh.n_vertices() as u32).filter(|v| near(&mesh.vertices()[*v as usize]));
    let times: Vec<f64> = (0..(end / S1).ceil() as u32).map(|i| f64::from(i) * S1).collect();
    let pacing = Pacing {
        vertices: vertices.collect(),
        measured: (end / S1) as usize - 1,
        times,
        strength: 1.0,
        end,
    };
    let substrate = Substrate { mesh, tissue: &tissue, fibres: None };
    let (wall, cpu, mut awake) = (Instant::now(), cpu_seconds(), 0.0);
    let mut simulation = Simulation::<F>::new(&substrate, &pacing, 0.1).unwrap();
    rayon::scope(|_| {
        while !simulation.is_done() {
            simulation.step().unwrap();
            awake += simulation.awake();
        }
    });
    let (wall, cpu) = (wall.elapsed().as_secs_f64(), cpu_seconds() - cpu);
    let steps = end / 0.1;
    println!(
        "{end} ms in {:4} {wall:6.1} s, {cpu:6.1} CPU s, {:.2e} node-steps per CPU second, {:.2} iterations a step, \
         {:.0} % of blocks awake",
        std::any::type_name::<F>(),
        steps * mesh.n_vertices() as f64 / cpu,
        simulation.n_iterations() as f64 / steps,
        100.0 * awake / steps
    );
    simulation.beat()
}

/// Most memory this process ever held, MB; Linux tells.
fn peak_memory() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kb = line.and_then(|line| line.split_whitespace().next()?.parse::<f64>().ok());
    kb.unwrap_or(f64::NAN) / 1000.0
}

fn main() {
    let edge = std::env::args().skip(1).find_map(|a| a.parse().ok()).unwrap_or(0.32);
    let mesh = left_atrium(edge).mesh;
    println!("{} vertices, edges {:.2} mm", mesh.n_vertices(), mesh.mean_edge_length());
    let single = beats::<f32>(&mesh, S1);
    let double = beats::<f64>(&mesh, S1);
    for ((name, single), (_, double)) in single.named().zip(double.named()) {
        let apart: Vec<f64> = single.iter().zip(&double).map(|(a, b)| (a - b).abs()).collect();
        let rms = (apart.iter().map(|x| x * x).sum::<f64>() / apart.len() as f64).sqrt();
        let worst = apart.iter().copied().fold(0.0, f64::max);
        let far = apart.iter().filter(|x| **x > 0.01).count();
        println!(
            "f32 against f64: {name:5} rms {rms:.5} ms, at worst {worst:.4} ms, above 0.01 ms at {far} vertices"
        );
    }
    if edge < 0.5 {
        beats::<f32>(&mesh, 8.5 * S1);
    }
    println!("{:.0} MB at most", peak_memory());
}
