//! Why two runs cannot be compared.

use thiserror::Error;

/// Why two runs cannot be compared.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CompareError {
    /// A run without leave-one-out figures.
    #[error(
        "{folder}: the run has no leave-one-out figures\nhelp: compare runs of models that observe something; a run by an earlier version must be repeated"
    )]
    NoLoo {
        /// The run.
        folder: String,
    },
    /// `loo.csv` is not what `run.json` says.
    #[error(
        "{folder}/loo.csv: expected {expected} measurements, as run.json says, got {got}\nhelp: the file was edited or comes from another run; repeat the run"
    )]
    Edited {
        /// The run.
        folder: String,
        /// Measurements in `run.json`.
        expected: usize,
        /// Lines in `loo.csv`.
        got: usize,
    },
    /// A measurement whose log likelihood is not finite at some draw.
    #[error(
        "{folder}/loo.csv: {measurement} has no elpd, as its log likelihood is not finite at some draw\nhelp: mend the model's likelihood, or drop the measurement from both runs"
    )]
    NoElpd {
        /// The run.
        folder: String,
        /// The measurement, in words.
        measurement: String,
    },
    /// The runs have different numbers of measurements.
    #[error("{} has {} measurements, {} has {}\nhelp: {SAME}", folders[0], n[0], folders[1], n[1])]
    Counts {
        /// The two runs.
        folders: [String; 2],
        /// Their numbers of measurements.
        n: [usize; 2],
    },
    /// A measurement that only one of the runs has.
    #[error(
        "the measurements differ: {measurement} = {observed} is in {has}, not in {lacks}\nhelp: {SAME}"
    )]
    Measurements {
        /// The measurement, in words.
        measurement: String,
        /// What was measured.
        observed: String,
        /// The run that has it.
        has: String,
        /// The run that has it not.
        lacks: String,
    },
}

/// What to do about runs that are not on the same measurements.
const SAME: &str =
    "elpd is comparable on the same measurements only; run both models with the same --data";
