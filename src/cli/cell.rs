//! `eplat simulate cell`: one cell, its action potential and its restitution.

#![allow(clippy::doc_markdown, reason = "help texts are read on the terminal, without backticks")]

use std::path::PathBuf;

use clap::Args;

use crate::ep::Parameters;
use crate::ep::cell::RANGES;
use crate::ep::paced_cell::{PacedCell, RestitutionPoint, Sample, restitution};
use crate::error::Failure;
use crate::report::Curves;
use crate::run::OutputFolder;
use crate::store::write_file;

/// Names of the durations, in the order of `CellBeat::apd`.
const APD: [&str; 4] = ["APD20", "APD30", "APD50", "APD90"];

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
    #[arg(long, value_name = "MS", default_value_t = 600.0)]
    s1: f64,
    /// Beats of the S1 train
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..))]
    beats: u32,
    /// Intervals of the S2 beats of the restitution curve, ms
    #[arg(long, value_name = "MS", value_delimiter = ',', default_values_t = (15..=60).map(|k| 10.0 * f64::from(k)))]
    s2: Vec<f64>,
    /// Strength of the stimuli, 1/ms: alone they need little
    #[arg(long, value_name = "X", default_value_t = 0.3)]
    strength: f64,
    /// Folder to write: trace.csv and trace.svg (V and h of the S1 train), restitution.csv and
    /// restitution.svg (APD over the diastolic interval)
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

impl CellArgs {
    pub(super) fn run(&self) -> Result<(), Failure> {
        let cell = self.parameters()?.tissue();
        let out = OutputFolder::open(&self.out)?;
        let mut paced = PacedCell::new(cell, self.strength);
        let mut trace = vec![paced.sample()];
        for _ in 0..self.beats {
            paced.beat(self.s1, &mut |sample| trace.push(sample));
        }
        let curve = restitution(cell, self.strength, (self.s1, self.beats), &self.s2);
        out.make()?;
        write_trace(&out, &trace)?;
        write_restitution(&out, &curve)?;
        let captured = curve.iter().filter(|point| point.beat.is_some()).count();
        eprintln!(
            "{} S1 beats; {captured} of {} S2 beats captured; written to {}",
            self.beats,
            curve.len(),
            out.path().display()
        );
        Ok(())
    }

    fn parameters(&self) -> Result<Parameters, Failure> {
        // a cell without neighbours has no conduction velocity
        let (_, _, any, _) = RANGES[0];
        let Self { tau_in, tau_out, tau_open, apd_max, .. } = *self;
        let parameters = Parameters { cv_max: any, tau_in, tau_out, tau_open, apd_max };
        parameters.validate()?;
        let wrong =
            |what: String, help: &str| Err(Failure::new(format_args!("{what}\nhelp: {help}")));
        if !(self.strength.is_finite() && self.strength > 0.0) {
            let what = format!("a stimulus of {} per ms excites nothing", self.strength);
            return wrong(what, "give a strength above 0");
        }
        if !(1.0..=1e5).contains(&self.s1) {
            return wrong(format!("--s1 {} is no interval", self.s1), "give ms, 1 or more");
        }
        if let Some(s2) = self.s2.iter().find(|s2| !(1.0..=self.s1).contains(*s2)) {
            let what =
                format!("--s2 {s2} is not between 1 ms and the S1 interval of {} ms", self.s1);
            return wrong(what, "an S2 comes earlier than the next S1 would");
        }
        Ok(parameters)
    }
}

fn write_trace(out: &OutputFolder, trace: &[Sample]) -> Result<(), Failure> {
    let rows =
        trace.iter().map(|s| vec![format!("{:.1}", s.time), s.v.to_string(), s.h.to_string()]);
    write_table(out, "trace.csv", &["time_ms", "v", "h"], rows)?;
    let curve = |of: fn(&Sample) -> f64| trace.iter().map(|s| [s.time, of(s)]).collect();
    let curves = [("V", curve(|s| s.v)), ("h", curve(|s| s.h))];
    let plot = Curves { x: "time (ms)", y: "V and h", curves: &curves, marks: false };
    Ok(plot.write(&out.file("trace.svg"))?)
}

fn write_restitution(out: &OutputFolder, curve: &[RestitutionPoint]) -> Result<(), Failure> {
    let row = |point: &RestitutionPoint| {
        let apd = |k: usize| point.beat.map_or(String::new(), |beat| beat.apd[k].to_string());
        let mut row = vec![point.s2.to_string(), point.di.to_string()];
        row.extend((0..4).map(apd));
        row
    };
    let header = ["s2_ms", "di_ms", "apd20_ms", "apd30_ms", "apd50_ms", "apd90_ms"];
    write_table(out, "restitution.csv", &header, curve.iter().map(row))?;
    let of = |k: usize| {
        let points = curve.iter().filter_map(|p| Some([p.di, p.beat?.apd[k]]));
        (APD[k], points.collect())
    };
    let curves = [of(0), of(1), of(2), of(3)];
    let x = "diastolic interval (ms)";
    let plot = Curves { x, y: "action potential duration (ms)", curves: &curves, marks: true };
    Ok(plot.write(&out.file("restitution.svg"))?)
}

fn write_table(
    out: &OutputFolder,
    name: &str,
    header: &[&str],
    rows: impl Iterator<Item = Vec<String>>,
) -> Result<(), Failure> {
    let path = out.file(name);
    let fill = |file: &mut std::io::BufWriter<&mut std::fs::File>| {
        let mut table = csv::Writer::from_writer(file);
        table.write_record(header)?;
        for row in rows {
            table.write_record(row)?;
        }
        table.flush()
    };
    write_file(&path, fill).map_err(|error| Failure::io("write", &path, &error))
}
