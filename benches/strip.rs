//! Seconds for the paper's 100 strip runs, as a strip and as a cable, and node-steps per second.
//!
//! ```text
//! cargo bench --bench strip
//! ```
//! A node-step is 0.1 ms of one of the strip's 243 nodes, with its five substeps of the cell. Threads are
//! as many as rayon takes (`RAYON_NUM_THREADS`); CPU seconds count all of them.
#![allow(clippy::unwrap_used, clippy::print_stdout, missing_docs, reason = "a bench")]

use std::time::Instant;

use eplat::ep::{Grid, Parameters, Protocol, Tissue, simulate_strips};
use eplat::surrogate::{ERP_INPUTS, design_points};

#[path = "../tests/support/cpu.rs"]
mod cpu;

use cpu::cpu_seconds;

fn main() {
    let tissues: Vec<Tissue> =
        design_points(100, &ERP_INPUTS, 1).into_iter().map(Parameters::tissue).collect();
    let run = |what: &str, grid: &Grid, protocol: &Protocol| {
        let (wall, cpu) = (Instant::now(), cpu_seconds());
        simulate_strips(&tissues, grid, protocol, &|_| ()).unwrap();
        let (wall, cpu) = (wall.elapsed().as_secs_f64(), cpu_seconds() - cpu);
        println!("{what:<44} {wall:6.2} s, {cpu:6.2} CPU s");
        cpu
    };
    let (strip, cable) = (Grid::default(), Grid { n_across: 1, ..Grid::default() });
    let (reference, curve) = (Protocol::default(), (200..=600).step_by(20).collect());
    run("100 strips", &strip, &reference);
    run(
        "100 strips with restitution",
        &strip,
        &Protocol { restitution: curve, ..reference.clone() },
    );
    run("100 cables", &cable, &reference);
    let more = 32;
    let cpu = [8, 8 + more].map(|n_beats| {
        run(
            &format!("100 strips, {n_beats} beats"),
            &strip,
            &Protocol { n_beats, ..reference.clone() },
        )
    });
    let node_steps = f64::from(more) * 6000.0 * 243.0 * 100.0;
    println!("{:.2e} node-steps per CPU second", node_steps / (cpu[1] - cpu[0]));
}
