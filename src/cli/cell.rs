//! `eplat simulate cell`: one cell, its action potential and its restitution.

#![allow(clippy::doc_markdown, reason = "help texts are read on the terminal, without backticks")]

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::voice::tell;
use crate::ep::Parameters;
use crate::ep::cell::{OutOfRange, RANGES};
use crate::ep::paced_cell::CellProtocol;
use crate::error::Failure;
use crate::report::{write_restitution, write_trace};
use crate::run::{OutputFolder, RunError};
use crate::store::memory;

/// The record, and the files that it names.
const RECORD: &str = "cell.json";
const FILES: [&str; 4] = ["trace.csv", "trace.svg", "restitution.csv", "restitution.svg"];

#[derive(Debug, Args)]
pub(super) struct CellArgs {
    /// tau_in, ms
    #[arg(long, value_name = "MS", default_value_t = 0.05)]
    tau_in: f64,
    /// tau_out, ms
    #[arg(long, value_name = "MS", default_value_t = 10.0)]
    tau_out: f64,
    /// tau_open, ms
    #[arg(long, value_name = "MS", default_value_t = 120.0)]
    tau_open: f64,
    /// APD_max, ms
    #[arg(long, value_name = "MS", default_value_t = 200.0)]
    apd_max: f64,
    /// Interval of the S1 train, ms
    #[arg(long, value_name = "MS", default_value_t = CellProtocol::default().s1)]
    s1: f64,
    /// Beats of the S1 train
    #[arg(long, value_name = "N", default_value_t = CellProtocol::default().beats, value_parser = clap::value_parser!(u32).range(1..))]
    beats: u32,
    /// Intervals of the S2 beats of the restitution curve, ms
    #[arg(long, value_name = "MS", value_delimiter = ',', default_values_t = CellProtocol::default().s2)]
    s2: Vec<f64>,
    /// Strength of the stimuli, 1/ms: alone they need little
    #[arg(long, value_name = "X", default_value_t = CellProtocol::default().strength)]
    strength: f64,
    /// Folder to write: trace.csv and trace.svg (V and h of the S1 train), restitution.csv and
    /// restitution.svg (APD over the diastolic interval), and cell.json (the settings)
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

impl CellArgs {
    /// Refuses a train whose trace there is no memory for: a time, V and h of every step.
    fn require_memory(&self, protocol: &CellProtocol) -> Result<(), RunError> {
        let Some((bytes, free)) = memory::exceeds(3 * protocol.n_samples() as u128) else {
            return Ok(());
        };
        let what = format!("{} beats {} ms apart", self.beats, self.s1);
        Err(RunError::Memory { what, bytes, free, help: "give fewer --beats" })
    }

    pub(super) fn run(&self) -> Result<(), Failure> {
        let cell = self.parameters()?.tissue();
        let protocol = self.protocol();
        protocol.validate()?;
        self.require_memory(&protocol)?;
        let out = OutputFolder::open(&self.out)?;
        let trace = protocol.trace(cell);
        let curve = protocol.restitution(cell);
        if out.earlier(RECORD).0.is_null() {
            out.refuse_foreign(FILES.into_iter())?;
        }
        let new = out.begin()?;
        write_trace(new.path(), &trace)
            .and_then(|()| write_restitution(new.path(), &curve))
            .map_err(|error| new.named(&out, error.into()))?;
        let record = json!({
            "version": env!("CARGO_PKG_VERSION"),
            "settings": {
                "tau_in_ms": self.tau_in, "tau_out_ms": self.tau_out, "tau_open_ms": self.tau_open,
                "apd_max_ms": self.apd_max, "s1_ms": self.s1, "beats": self.beats, "s2_ms": self.s2,
                "strength_per_ms": self.strength,
            },
        });
        out.publish(&new, (RECORD, record), &[], &[])?;
        let captured = curve.iter().filter(|point| point.beat.is_some()).count();
        let text = format_args!(
            "{} S1 beats; {captured} of {} S2 beats captured; written to {}",
            self.beats,
            curve.len(),
            out.path().display()
        );
        tell("written", text, json!({ "folder": out.path(), "captured": captured }));
        Ok(())
    }

    fn parameters(&self) -> Result<Parameters, OutOfRange> {
        // a cell without neighbours has no conduction velocity
        let (_, _, any, _) = RANGES[0];
        let Self { tau_in, tau_out, tau_open, apd_max, .. } = *self;
        let parameters = Parameters { cv_max: any, tau_in, tau_out, tau_open, apd_max };
        parameters.validate().map(|()| parameters)
    }

    fn protocol(&self) -> CellProtocol {
        let Self { strength, s1, beats, .. } = *self;
        CellProtocol { strength, s1, beats, s2: self.s2.clone() }
    }
}
