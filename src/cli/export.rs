//! `eplat export`: a calibrated atrium as files of openCARP.

#![allow(clippy::doc_markdown, reason = "help texts are read on the terminal, without backticks")]

use std::io::Write as _;
use std::path::PathBuf;

use clap::Args;

use super::atrium::TissueArgs;
use super::voice::stdout;
use crate::error::Failure;
use crate::run::atrium::{Exported, export_opencarp};

/// `eplat export --run DIR --out DIR`
#[derive(Debug, Args)]
pub(super) struct Command {
    #[command(flatten)]
    tissue: TissueArgs,
    /// Write this many draws of the posterior of --run beside the mean: every parameter that is NAME_mean
    /// becomes NAME of the draw
    #[arg(long, value_name = "N", requires = "run", conflicts_with = "fields", value_parser = clap::value_parser!(u32).range(1..))]
    draws: Option<u32>,
    /// Folder to make: atrium.pts, .elem and .lon, and mean/ and draw_001/ … with mMS.par and a file of each
    /// parameter
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

impl Command {
    pub(super) fn run(&self) -> Result<(), Failure> {
        let ground = self.tissue.ground(self.draws.is_some())?;
        let exported = export_opencarp(&ground, &self.tissue.settings(), self.draws, &self.out)?;
        let Exported { n_nodes, n_draws, edge, out_of_range } = exported;
        let mut out = stdout();
        writeln!(
            out,
            "wrote {}: {n_nodes} nodes, the mean and {n_draws} draws",
            self.out.display()
        )?;
        if out_of_range > 0.0 {
            writeln!(
                out,
                "{:.1} % of the nodes, of the mean and all draws, had a parameter outside its range: it is the nearest in it",
                100.0 * out_of_range
            )?;
        }
        if edge > 0.5 {
            writeln!(
                out,
                "edges of {edge:.2} mm are too long for a front: one more --refine halves them"
            )?;
        }
        writeln!(out, "not tried with openCARP itself: check a single beat before you rely on it")?;
        Ok(())
    }
}
