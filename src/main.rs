//! The `eplat` program: the command line with the models that ship compiled in.

use std::process::ExitCode;

fn main() -> ExitCode {
    eplat::cli::main(eplat_models::MODELS)
}
