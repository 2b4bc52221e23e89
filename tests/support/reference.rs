//! The two reference problems of every speed figure: the ERP model at 10 sites with 24 modes per field
//! (54 parameters, 52 of them sampled) and at 40 sites with 32 modes (70, 68).
//!
//! The paper's synthetic experiment on the clinical shell of the reference data: maximin sites, 10 ms
//! brackets, seed 1. Where the data are absent, on the embedded atrium.
#![allow(clippy::unwrap_used, reason = "for tests and benches")]
#![allow(dead_code, reason = "each user needs a part of it")]

use std::path::{Path, PathBuf};

use eplat::mesh::{self, TriMesh, Units, left_atrium};
use eplat::model::Declare;
use eplat::table::Measurements;

use crate::posterior::shipped::shipped;

#[path = "../../examples/validation/erp.rs"]
mod erp_32;

/// The clinical shell of `$EPLAT_SHARED` (or `../shared` beside the checkout), else the embedded
/// atrium; and its name.
pub(crate) fn surface() -> (&'static str, TriMesh) {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared");
    let shared = std::env::var_os("EPLAT_SHARED").map_or_else(beside, PathBuf::from);
    let shell = shared.join("data/openep_la/la_lat.vtk");
    if shell.exists() {
        ("clinical shell", mesh::read(&shell, Units::Mm).unwrap().mesh)
    } else {
        ("embedded atrium", left_atrium(1.5).mesh)
    }
}

/// The model for this many sites.
pub(crate) fn model(n_sites: usize) -> &'static dyn Declare {
    if n_sites < 40 { shipped("erp") } else { &erp_32::Erp }
}

/// Brackets of 10 ms at `n_sites` of the vertices, of no experiment: for timing alone.
pub(crate) fn brackets(n_vertices: usize, n_sites: usize) -> Measurements {
    let header = ["vertex", "protocol", "lower", "upper"].map(String::from).to_vec();
    let rows = (0..2 * n_sites).map(|i| {
        let (vertex, lower) = (i / 2 * n_vertices / n_sites, 200 + 10 * (i % 5));
        let protocol = ["s1s2", "s1s2s3"][i % 2];
        [vertex.to_string(), protocol.into(), lower.to_string(), (lower + 10).to_string()].to_vec()
    });
    let mut data = Measurements::from_cells("the bench", header, rows.collect()).unwrap();
    data.place_at_indices(n_vertices).unwrap();
    data
}
