//! Options that say how a mesh file is read.

use std::path::{Path, PathBuf};

use clap::Args;

use crate::mesh::{Reading, Units};

/// Options that say how a mesh file is read.
#[derive(Debug, Args)]
pub(super) struct ReadingArgs {
    /// Unit of the mesh's coordinates: mm, cm, um or m [default: what the file says, or guessed from the size]
    #[arg(long, value_name = "UNIT")]
    pub(super) units: Option<Units>,
    /// Which connected piece of the mesh is the surface, counted from 1, the largest first
    #[arg(long, value_name = "N")]
    pub(super) piece: Option<usize>,
}

impl ReadingArgs {
    /// How `file` is read; where it cannot be mended is shown in a file in the working directory.
    pub(super) fn of(&self, file: &Path) -> Reading {
        let stem = file.file_stem().unwrap_or_default().to_string_lossy();
        let faults = Some(PathBuf::from(format!("{stem}_faults.vtp")));
        Reading { units: self.units, piece: self.piece, faults, tolerance: None }
    }
}
