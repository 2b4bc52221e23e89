//! Valid files with bytes changed: every reader gives a value or an error, soon, and never panics; what is accepted
//! is what it should be.
//!
//! Some hundred mutations of each file, seeded. The readers, and what must hold of what they accept, are those of
//! `fuzz/`. For ten CPU minutes a reader: `EPLAT_MUTATION_SECONDS=600 cargo test --release --test mutated`.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout, reason = "tests")]

#[path = "../fuzz/src/mutation.rs"]
mod mutation;
#[path = "../fuzz/src/readers.rs"]
mod readers;
#[path = "../fuzz/src/seeds.rs"]
mod seeds;

use std::time::Duration;

use mutation::{Effort, survives};

/// Mutations of each target where nobody asks for a time.
const MUTATIONS: usize = 1500;

fn survive(names: &[&str]) {
    let seconds = std::env::var("EPLAT_MUTATION_SECONDS").ok().and_then(|n| n.parse().ok());
    let effort =
        seconds.map_or(Effort::Mutations(MUTATIONS), |s| Effort::Time(Duration::from_secs(s)));
    for name in names {
        let begun = std::time::Instant::now();
        let n = survives(readers::target(name), effort, 0, |read| {
            read();
            0
        });
        println!("{name}: {n} mutations in {:.1} s", begun.elapsed().as_secs_f64());
    }
}

#[test]
fn meshes_of_every_format() {
    survive(&["legacy_vtk", "vtp_vtu", "ply", "stl", "obj", "opencarp"]);
}

#[test]
fn studies_of_mapping_systems() {
    survive(&["carto", "ensite", "mat"]);
}

#[test]
fn tables_arrays_and_plans() {
    survive(&["csv", "npz", "plan"]);
}

#[test]
fn models() {
    survive(&["model_text"]);
}

/// What a run leaves, and what an interrupted one does.
#[test]
fn the_files_of_a_run() {
    survive(&["run_records", "checkpoints"]);
}

#[test]
fn every_target_is_tried() {
    let source = include_str!("mutated.rs");
    for target in readers::TARGETS {
        assert!(source.contains(&format!("\"{}\"", target.name)), "{}", target.name);
    }
    assert!(
        mutation::words("# none\n\"a\\x00\\\"b\"\n\"\\\\\"\n")
            == [b"a\0\"b".to_vec(), b"\\".to_vec()]
    );
}
