//! The `eplat` program.

use std::process::ExitCode;

fn main() -> ExitCode {
    eplat::cli::main()
}
