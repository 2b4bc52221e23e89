//! The command line: one file per command, one enum that is matched once.

mod atrium;
mod cargo;
mod cell;
mod check;
mod close_loop;
mod compare;
mod compile;
mod completions;
mod coverage;
mod design;
mod doctor;
mod events;
mod export;
mod import;
mod init;
mod inputs;
mod interrupt;
mod library;
mod mesh;
mod models;
mod options;
mod panic;
mod plot;
mod predict;
mod programs;
mod progress;
mod reading;
mod remaining;
mod report;
mod run;
mod rustc;
mod show;
mod simulate;
mod simulation;
mod study;
mod surrogate;
mod voice;
mod vulnerability;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

pub use library::shipped_models;
pub use models::Compiled;
pub use options::{CommandOption, Takes, options};
use voice::{Voice, Voiced, speak, tell_failure};

#[derive(Debug, Parser)]
#[command(name = "eplat", version, about, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Make a folder to begin in: a model, a table of measurements, and what to do with them
    Init(init::Command),
    /// Sample a model's posterior and write the results
    Run(run::Command),
    /// Print a model as equations, with parameters, units and supports
    Show(show::Command),
    /// Validate a model's input without sampling, and time its gradient
    Check(check::Command),
    /// Predict measurements at new rows or sites from a finished run
    Predict(predict::Command),
    /// Make a surface and a table of measurements of a laboratory's study
    Import(import::Command),
    /// Write a calibrated atrium as files of openCARP: its surface, and the parameters at every node
    Export(Box<export::Command>),
    /// Find what a model lacks, add it, and tell the error before and after
    Loop(close_loop::Command),
    /// Choose where to measure next
    #[command(subcommand)]
    Design(design::Command),
    /// Compare two runs by how well they predict the same measurements
    Compare(compare::Command),
    /// Print again what the end of a run said; the exit code is that of the run
    Report(report::Command),
    /// Draw what a command left as pictures for print, SVG and PNG
    Plot(plot::Command),
    /// Look at, convert, repair or make a surface mesh
    #[command(subcommand)]
    Mesh(mesh::Command),
    /// Run the electrophysiology simulator
    Simulate(Voiced<simulate::Command>),
    /// Calibrate many synthetic truths from a plan, here or as a Slurm job array
    Study(Voiced<study::Command>),
    /// Make surrogates of the simulator, in this order: design, run, fit; sensitivity tells what matters
    Surrogate(Voiced<surrogate::Command>),
    /// Say what this machine has for eplat, and what runs on it
    Doctor(doctor::Command),
    /// Print what makes a shell complete commands and options
    Completions(completions::Command),
}

impl Command {
    /// How the command speaks on stderr.
    fn voice(&self) -> Voice {
        match self {
            Self::Run(command) => command.voice,
            Self::Loop(command) => command.voice,
            Self::Predict(command) => command.voice,
            Self::Plot(command) => command.voice,
            Self::Simulate(Voiced { voice, .. })
            | Self::Study(Voiced { voice, .. })
            | Self::Surrogate(Voiced { voice, .. }) => *voice,
            _ => Voice::default(),
        }
    }
}

/// Runs the command line of this process; `models` are compiled into it.
pub fn main(models: &[Compiled]) -> ExitCode {
    let command = Cli::parse().command;
    speak(command.voice());
    panic::told(|| run(command, models))
}

fn run(command: Command, models: &[Compiled]) -> ExitCode {
    let done = |result: Result<(), _>| result.map(|()| ExitCode::SUCCESS);
    let outcome = match command {
        Command::Run(command) => command.run(models),
        Command::Show(command) => command.run(models),
        Command::Check(command) => command.run(models),
        Command::Import(command) => done(command.run(models)),
        Command::Export(command) => done(command.run()),
        Command::Loop(command) => command.run(models),
        Command::Compare(command) => command.run(),
        Command::Init(command) => done(command.run(models)),
        Command::Completions(command) => done(command.run()),
        Command::Doctor(command) => command.run(),
        Command::Predict(command) => command.run(models),
        Command::Report(command) => command.run(),
        Command::Plot(command) => done(command.run()),
        Command::Mesh(command) => done(command.run()),
        Command::Simulate(voiced) => voiced.command.run(),
        Command::Design(command) => command.run(models),
        Command::Study(voiced) => voiced.command.run(models),
        Command::Surrogate(voiced) => done(voiced.command.run()),
    };
    outcome.unwrap_or_else(|failure| {
        tell_failure(&failure);
        ExitCode::from(failure.code())
    })
}
