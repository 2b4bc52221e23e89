//! Results of a plan: one file per block, that appears when the block is done; then one table of all.

use std::collections::BTreeMap;
use std::fs;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::outcome::Outcome;
use super::plan::{Block, Estimate, Plan};
use super::{JobArray, StudyError};
use crate::diagnostics::mean_and_sd;
use crate::experiment::INTERVALS;
use crate::run::{RunError, hash_file, hash_mesh};
use crate::store::{seals, write_file};

/// The record of a study, in its folder.
const RECORD: &str = "study.json";
/// The folder of what each truth gave.
const BLOCKS: &str = "blocks";
/// The table of all.
const TABLE: &str = "results.csv";
/// Columns that say which case a row is, and how it went.
const CASE: [&str; 8] = [
    "lengthscale_mm",
    "field",
    "sites",
    "design",
    "resolution",
    "converged",
    "truth_repaired",
    "repaired",
];
/// Columns by which cases are put together.
const GROUP: [&str; 3] = ["lengthscale_mm", "resolution", "sites"];

/// The folder of a plan's results.
#[derive(Clone, Debug)]
pub struct Results {
    folder: PathBuf,
}

/// Mean and standard deviation of every figure over the cases that differ in truth and design alone.
#[derive(Clone, Debug)]
pub struct Group {
    /// Lengthscale, resolution, number of sites.
    pub key: [f64; 3],
    /// Number of cases.
    pub n: usize,
    /// Mean and standard deviation by column.
    pub figures: BTreeMap<String, (f64, f64)>,
}

impl Results {
    /// What is made of all results: means and deviations, and their picture.
    pub const OF_ALL: [&str; 2] = ["summary.csv", "figure.svg"];

    /// Opens or makes the folder for this plan.
    ///
    /// # Errors
    /// [`StudyError::Results`] for a folder that holds another plan's results; [`StudyError::Write`];
    /// [`StudyError::Run`] for a model or mesh that cannot be read.
    pub fn open(folder: &Path, plan: &Plan) -> Result<Self, StudyError> {
        let mut inputs = BTreeMap::from([("model", hash_file(&plan.beside(&plan.model))?)]);
        if let Some(mesh) = &plan.mesh {
            inputs.insert("mesh", hash_mesh(&plan.beside(mesh))?);
        }
        let results = Self { folder: folder.to_owned() };
        let record =
            json!({ "plan": plan, "version": env!("CARGO_PKG_VERSION"), "hashes": inputs });
        let path = results.file(RECORD);
        fs::create_dir_all(folder).map_err(StudyError::io(folder))?;
        match results.record() {
            Ok(there) if there == record => {}
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                results.refuse_foreign()?;
                results.write_record(&record)?;
            }
            _ => {
                let why = "the results there are of another plan, model, mesh or version\n\
                           help: give another --out, or remove the folder";
                return Err(StudyError::Results { path, why: why.to_owned() });
            }
        }
        fs::create_dir_all(results.file(BLOCKS)).map_err(StudyError::io(folder))?;
        Ok(results)
    }

    /// Refuses a folder without a record in which something has the name of a file of a study.
    fn refuse_foreign(&self) -> Result<(), StudyError> {
        let names = [BLOCKS, TABLE].into_iter().chain(Self::OF_ALL).chain(JobArray::FILES);
        match names.map(|name| self.file(name)).find(|path| path.exists()) {
            Some(path) => Err(RunError::Foreign { path }.into()),
            None => Ok(()),
        }
    }

    /// The record, but for the files that it names.
    fn record(&self) -> io::Result<Value> {
        let mut record: Value = serde_json::from_slice(&fs::read(self.file(RECORD))?)?;
        record.as_object_mut().and_then(|record| record.remove("files"));
        Ok(record)
    }

    fn write_record(&self, record: &Value) -> Result<(), StudyError> {
        let path = self.file(RECORD);
        write_file(&path, |file| writeln!(file, "{record:#}")).map_err(StudyError::io(&path))
    }

    /// Names these files beside the results of all truths in the record, with their hashes.
    ///
    /// # Errors
    /// [`StudyError::Write`].
    pub fn seal(&self, files: &[&str]) -> Result<(), StudyError> {
        let names = files.iter().copied().chain([BLOCKS, TABLE]);
        let scripts = JobArray::FILES.into_iter().filter(|name| self.file(name).exists());
        let files =
            seals(&self.folder, names.chain(scripts)).map_err(StudyError::io(&self.folder))?;
        let mut record = self.record().map_err(StudyError::io(&self.file(RECORD)))?;
        record["files"] = json!(files);
        self.write_record(&record)
    }

    /// Where a block's results are once it is done.
    pub fn path(&self, block: &Block) -> PathBuf {
        self.file(BLOCKS).join(format!("{:05}.csv", block.index))
    }

    /// Those of `blocks` that are not done.
    pub fn missing<'b>(&self, blocks: &'b [Block]) -> Vec<&'b Block> {
        blocks.iter().filter(|block| !self.path(block).is_file()).collect()
    }

    /// Writes a block's results, whole or not at all.
    ///
    /// # Errors
    /// [`StudyError::Write`].
    pub fn write(
        &self,
        plan: &Plan,
        names: &[String],
        block: &Block,
        truth_repaired: f64,
        outcomes: &[Outcome],
    ) -> Result<(), StudyError> {
        let path = self.path(block);
        write_file(&path, |file| {
            let mut table = csv::Writer::from_writer(file);
            table.write_record(header(plan, names, outcomes))?;
            for outcome in outcomes {
                table.write_record(row(block, truth_repaired, outcome))?;
            }
            table.flush()
        })
        .map_err(StudyError::io(&path))
    }

    /// Puts all blocks into `results.csv`, in the plan's order, and returns the table: columns, rows.
    ///
    /// # Errors
    /// [`StudyError::Results`] for a block that is missing, unless `partial`, or not as the plan has it.
    pub fn merge(&self, plan: &Plan, partial: bool) -> Result<Table, StudyError> {
        let blocks = plan.blocks();
        let missing: Vec<usize> = self.missing(&blocks).iter().map(|b| b.index).collect();
        if !missing.is_empty() && !partial {
            let some: Vec<String> = missing.iter().take(5).map(ToString::to_string).collect();
            let more = if missing.len() > some.len() { ", …" } else { "" };
            return Err(StudyError::Results {
                path: self.folder.clone(),
                why: format!(
                    "the results of {} of {} truths are missing (numbers {}{more})\n\
                     help: run the plan again with the same --out, which does what is missing; or merge what is there with --partial",
                    missing.len(),
                    blocks.len(),
                    some.join(", ")
                ),
            });
        }
        let mut merged = Table::default();
        for block in blocks.iter().filter(|block| !missing.contains(&block.index)) {
            merged.append(&self.path(block), plan.cases().len())?;
        }
        let path = self.file(TABLE);
        write_file(&path, |file| {
            let mut table = csv::Writer::from_writer(file);
            table.write_record(&merged.header)?;
            merged.rows.iter().try_for_each(|row| table.write_record(row))?;
            table.flush()
        })
        .map_err(StudyError::io(&path))?;
        Ok(merged)
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// A file of the folder.
    pub fn file(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }
}

/// Results as text: what is merged is what was written.
#[derive(Clone, Debug, Default)]
pub struct Table {
    /// Names of the columns.
    pub header: csv::StringRecord,
    /// One row per case.
    pub rows: Vec<csv::StringRecord>,
}

impl Table {
    /// Reads a table of results.
    ///
    /// # Errors
    /// [`StudyError::Results`].
    pub fn read(path: &Path) -> Result<Self, StudyError> {
        let mut reader = csv::Reader::from_path(path).map_err(|error| fault(path, &error))?;
        let header = reader.headers().map_err(|error| fault(path, &error))?.clone();
        let rows: Result<_, _> = reader.records().collect();
        Ok(Self { header, rows: rows.map_err(|error| fault(path, &error))? })
    }

    fn append(&mut self, path: &Path, n_cases: usize) -> Result<(), StudyError> {
        let block = Self::read(path)?;
        let differs = !self.header.is_empty() && self.header != block.header;
        if differs || block.rows.len() != n_cases {
            return Err(StudyError::Results {
                path: path.to_owned(),
                why: format!(
                    "{} rows, where the plan has {n_cases}, or other columns\nhelp: remove this file and run the plan again",
                    block.rows.len()
                ),
            });
        }
        self.header = block.header;
        self.rows.extend(block.rows);
        Ok(())
    }

    fn number(&self, row: &csv::StringRecord, column: &str) -> f64 {
        let at = self.header.iter().position(|name| name == column);
        at.and_then(|at| row[at].parse().ok()).unwrap_or(f64::NAN)
    }
}

/// Puts cases together that differ in truth and design alone, in the order of lengthscale, resolution and
/// sites.
pub fn summarise(table: &Table) -> Vec<Group> {
    let figures = table.header.iter().skip(CASE.len() - 3).map(str::to_owned);
    let figures: Vec<String> = figures.collect();
    let mut groups: Vec<([f64; 3], Vec<&csv::StringRecord>)> = vec![];
    for row in &table.rows {
        let key = GROUP.map(|column| table.number(row, column));
        match groups.iter_mut().find(|(other, _)| is_same(other, &key)) {
            Some((_, rows)) => rows.push(row),
            None => groups.push((key, vec![row])),
        }
    }
    groups.sort_by(|a, b| a.0.partial_cmp(&b.0).unwrap_or(std::cmp::Ordering::Equal));
    let group = |(key, rows): ([f64; 3], Vec<&csv::StringRecord>)| {
        let of = |column: &String| {
            let known = rows.iter().map(|row| table.number(row, column)).filter(|x| x.is_finite());
            (column.clone(), mean_and_sd(&[&known.collect::<Vec<_>>()]))
        };
        Group { key, n: rows.len(), figures: figures.iter().map(of).collect() }
    };
    groups.into_iter().map(group).collect()
}

/// Whether two keys are the same.
fn is_same(a: &[f64; 3], b: &[f64; 3]) -> bool {
    a.iter().zip(b).all(|(a, b)| a.total_cmp(b).is_eq())
}

impl Group {
    /// Whether this is the group of this key.
    pub fn is(&self, key: &[f64; 3]) -> bool {
        is_same(&self.key, key)
    }
}

fn header(plan: &Plan, names: &[String], outcomes: &[Outcome]) -> Vec<String> {
    let mut header: Vec<String> = CASE.iter().map(ToString::to_string).collect();
    header.extend(names.iter().map(|name| format!("rmse_{name}")));
    if plan.estimate == Estimate::Mean {
        for name in names {
            header.extend(INTERVALS.map(|level| format!("coverage{:.0}_{name}", 100.0 * level)));
        }
    }
    if let Some(time) = outcomes.first().and_then(|outcome| outcome.time.as_ref()) {
        header.push("minutes".to_owned());
        header.extend(time.measured.iter().map(|(name, _)| format!("measured_{name}")));
    }
    header
}

fn row(block: &Block, truth_repaired: f64, outcome: &Outcome) -> Vec<String> {
    let Outcome { case, converged, repaired, errors, time } = outcome;
    let number = |x: f64| if x.is_finite() { format!("{x:?}") } else { String::new() };
    let mut row = vec![
        number(block.lengthscale),
        block.field.to_string(),
        case.sites.to_string(),
        case.design.to_string(),
        number(case.resolution),
        u8::from(*converged).to_string(),
        number(truth_repaired),
        number(*repaired),
    ];
    row.extend(errors.iter().map(|error| number(error.rmse)));
    row.extend(errors.iter().filter_map(|error| error.coverage).flatten().map(number));
    if let Some(time) = time {
        row.push(number(time.minutes));
        row.extend(time.measured.iter().map(|(_, times)| times.to_string()));
    }
    row
}

fn fault(path: &Path, error: &dyn std::fmt::Display) -> StudyError {
    StudyError::Results { path: path.to_owned(), why: error.to_string() }
}
