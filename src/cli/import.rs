//! `eplat import PATH --out DIR`: a laboratory's study as a surface and a table of measurements.

use std::io::Write as _;
use std::path::PathBuf;
use std::str::FromStr as _;

use clap::Args;

use super::coverage;
use super::models::Compiled;
use super::voice::stdout;
use crate::error::Failure;
use crate::import::{self, Given, Options, Selected, Study};
use crate::mesh::Units;
use crate::table::Measurements;

/// `eplat import PATH --out DIR`
#[derive(Debug, Args)]
pub(super) struct Command {
    /// Folder, zip archive or file
    path: PathBuf,
    /// Folder to make: surface.vtp, measurements.csv and import.json
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// The map to import; needed where the study has several with measurements
    #[arg(long, value_name = "NAME")]
    map: Option<String>,
    /// Leave out points farther from the surface than this, mm
    #[arg(long, value_name = "MM", default_value_t = 10.0)]
    within: f64,
    /// Take the values on the mesh as measurements, though there are points
    #[arg(long)]
    mesh_values: bool,
    /// Distance that measurements on the mesh keep from each other, mm [default: every vertex]
    #[arg(long, value_name = "MM")]
    thin: Option<f64>,
    /// Mesh that a pacing log, or values in a .dat or .igb file, belong to
    #[arg(long, value_name = "FILE")]
    mesh: Option<PathBuf>,
    /// Unit of a mesh file's coordinates: mm, cm, um or m [default: what the file says, or guessed from the size]
    #[arg(long, value_name = "UNIT", value_parser = Units::from_str)]
    units: Option<Units>,
    /// What the values of a mesh, .dat or .igb file are, where its name does not tell
    #[arg(long = "as", value_name = "QUANTITY", value_parser = ["lat", "bipolar", "unipolar"])]
    quantity: Option<String>,
    /// Array of the mesh file that holds them
    #[arg(long, value_name = "NAME")]
    array: Option<String>,
    /// Frame of an .igb file, from 0
    #[arg(long, value_name = "N")]
    frame: Option<usize>,
    /// Leave out brackets of a pacing log that have an open end
    #[arg(long)]
    closed: bool,
    /// Vertex of surface.vtp at which activation starts [default: the earliest]
    #[arg(long, value_name = "VERTEX")]
    source: Option<u32>,
    /// Replace the folder of an earlier import
    #[arg(long)]
    force: bool,
}

impl Command {
    pub(super) fn run(&self, compiled: &[Compiled]) -> Result<(), Failure> {
        self.check_distances()?;
        let given = Given {
            mesh: self.mesh.clone(),
            units: self.units,
            quantity: self.quantity.clone(),
            array: self.array.clone(),
            frame: self.frame,
        };
        let (mut study, sources) = import::read(&self.path, &given)?;
        let options = Options {
            map: self.map.clone(),
            within: self.within,
            thin: self.thin,
            mesh_values: self.mesh_values,
            closed: self.closed,
            source: self.source,
        };
        let selected = import::select(&mut study, &options)?;
        let record = selected.record(&self.path, &study, &sources, &options);
        import::write(&self.out, self.force, &selected, &record)?;
        self.tell(&study, &selected)?;
        self.tell_models(&selected, compiled)
    }

    fn check_distances(&self) -> Result<(), Failure> {
        for (name, given) in [("--within", Some(self.within)), ("--thin", self.thin)] {
            if let Some(mm) = given.filter(|mm| !(*mm > 0.0 && mm.is_finite())) {
                return Err(Failure::usage(format_args!(
                    "{name} {mm}: expected a distance above 0\nhelp: say it in mm, for instance {name} 5"
                )));
            }
        }
        Ok(())
    }

    /// What was found, what was left out, and where it is now.
    fn tell(&self, study: &Study, selected: &Selected) -> Result<(), Failure> {
        let mut out = stdout();
        let map = &selected.map;
        writeln!(out, "{}: {}", study.format, self.path.display())?;
        for other in &study.maps {
            writeln!(out, "not imported: {}", other.in_words().trim_start())?;
        }
        writeln!(out, "map {}", map.name)?;
        for (protocol, n) in selected.counts() {
            writeln!(out, "  {n} measurements of {protocol}")?;
        }
        for (reason, n) in &map.left_out {
            writeln!(out, "  left out: {reason} ({n})")?;
        }
        for remark in study.remarks.iter().chain(&map.remarks) {
            writeln!(out, "  {remark}")?;
        }
        if !selected.is_on_mesh {
            write!(out, "{}", coverage::histogram_text(&import::distances(&selected.rows)))?;
        }
        writeln!(out, "wrote {}", self.out.display())?;
        Ok(())
    }

    /// Which of the models that ship can be run on it.
    fn tell_models(&self, selected: &Selected, compiled: &[Compiled]) -> Result<(), Failure> {
        let mut out = stdout();
        if selected.rows.is_empty() {
            let folder = self.out.display();
            writeln!(
                out,
                "no measurements: there is nothing that a model could be run on\n\
                 next: eplat import LOG.csv --mesh {folder}/surface.vtp --units mm --out OUT, with a pacing log; or \
                 `eplat run MODEL --mesh {folder}/surface.vtp --units mm --data TABLE.csv`, with a table of measurements"
            )?;
            return Ok(());
        }
        let table = Measurements::read(&self.out.join("measurements.csv"))?;
        let (said, first) = coverage::in_words(compiled, selected.surface.as_ref(), &table);
        write!(out, "{said}")?;
        let folder = self.out.display();
        let mesh = match &selected.surface {
            Some(_) => format!("--mesh {folder}/surface.vtp --units mm"),
            None => "--mesh FILE --units UNIT".into(),
        };
        writeln!(
            out,
            "next: eplat run {} {mesh} --data {folder}/measurements.csv --out OUT",
            first.as_deref().unwrap_or("MODEL.rs")
        )?;
        Ok(())
    }
}
