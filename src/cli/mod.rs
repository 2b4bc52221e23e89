//! The command line: one file per command, one enum that is matched once.

mod mesh;
mod simulate;
mod surrogate;

use clap::{Parser, Subcommand};
use std::process::ExitCode;

use crate::error::Failure;

#[derive(Debug, Parser)]
#[command(name = "eplat", version, about, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Look at, convert, repair or make a surface mesh
    #[command(subcommand)]
    Mesh(mesh::Command),
    /// Run the electrophysiology simulator
    #[command(subcommand)]
    Simulate(simulate::Command),
    /// Design, run and fit the surrogate's training data
    #[command(subcommand)]
    Surrogate(surrogate::Command),
}

/// Runs the command line of this process.
pub fn main() -> ExitCode {
    let outcome = match Cli::parse().command {
        Command::Mesh(command) => command.run(),
        Command::Simulate(command) => command.run(),
        Command::Surrogate(command) => command.run(),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("error: {failure}");
            ExitCode::from(failure.code())
        }
    }
}

#[allow(dead_code)]
type Outcome = Result<(), Failure>;
