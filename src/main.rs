//! The `eplat` program: the command line with the models that ship compiled in.

use std::process::ExitCode;

use eplat::cli::Compiled;

#[path = "../models/erp.rs"]
mod erp;

fn main() -> ExitCode {
    eplat::cli::main(&[Compiled { source: include_str!("../models/erp.rs"), model: &erp::Erp }])
}
