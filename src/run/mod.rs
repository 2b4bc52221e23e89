//! From a model and its inputs to a fit, its verdict and its files: all that the program does, for
//! programs.
//!
//! A [`Problem`] is a model laid out on a surface and measurements; [`Inputs`] say where these come
//! from. [`Problem::fit`] samples it, and the [`Fit`] tells what the draws say and writes the same files
//! as `eplat run`:
//!
//! ```
//! use eplat::diagnostics::verdict::Colour;
//! use eplat::prelude::*;
//! use eplat::run::{Inputs, Problem, Settings};
//! use eplat::table::Measurements;
//!
//! model! {
//!     /// The mean of some measurements whose error is known.
//!     model Mean;
//!     param mean [ms] ~ Normal(200.0, 50.0);
//!     observe value(row): Number [ms] ~ Normal(mean, 5.0);
//! }
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let cells = ["212", "221", "208"].map(|cell| vec![cell.to_owned()]).to_vec();
//! let table = Measurements::from_cells("three values", vec!["value".into()], cells)?;
//! let inputs = Inputs { data: table.clone().into(), ..Inputs::default() };
//!
//! let fit = Problem::load(&Mean, &inputs)?.fit(&Settings::default())?;
//! let mean = &fit.summary()[0];
//! assert_eq!(mean.name, "mean");
//! assert!((mean.summary.mean - 213.6).abs() < 1.0);
//! assert_eq!(fit.verdict().colour(), Colour::Green);
//!
//! // what a further measurement would give: the posterior's spread and the error of the measurement
//! let further = &fit.predict(&table)?.rows[0];
//! assert!((further.sd - 5.8).abs() < 0.7);
//!
//! # let out = tempfile::tempdir()?;
//! # let out = out.path();
//! let results = fit.write(out)?; // summary.csv, draws.csv, posterior.zarr, report.html, run.json …
//! assert!(results.files.contains(&"report.html"));
//! # Ok(())
//! # }
//! ```
//!
//! | instead of | there is |
//! |---|---|
//! | `eplat run --resume`, `--init` | [`Problem::run_into`] with [`Keep`], [`Options::warm_start`] |
//! | `eplat run --optimize`, `--laplace`, `--prior` | [`Problem::mode`], [`Problem::laplace`], [`Problem::prior`] |
//! | `eplat check` | [`Problem::check`] |
//! | `eplat report` | [`Results::read`] |
//! | `eplat predict` | [`Fit::predict`]; of a finished run [`Inputs::of_run`] and [`Problem::predict`] |
//! | `eplat compare` | [`Comparison::of`] |
//! | `eplat design next` | [`Fit::next`] |
//! | `eplat simulate atrium` | [`atrium`] |
//!
//! Nothing here prints. A [`Watch`] is told of every [`Event`], from whichever thread, and stops a run
//! through a flag. Whatever goes wrong is a [`RunError`].

pub mod atrium;
mod check;
mod compare;
mod corrected;
mod coverage;
mod error;
mod event;
mod fit;
mod folder;
mod forecast;
mod inputs;
mod keep;
mod maps;
mod mode;
mod needs;
mod next;
mod predict;
mod problem;
mod record;
mod results;
mod sample;
mod task;
mod unknowns;
mod verdict;
mod warm_start;
mod write;

pub use crate::experiment::Design;
pub use crate::infer::Settings;
pub use check::Check;
pub use compare::{CompareError, Comparison};
pub use coverage::{Coverage, coverage};
pub use error::RunError;
pub use event::{Event, Watch};
pub use fit::{Fit, Method, Options};
pub use folder::{NewFiles, OutputFolder};
pub use forecast::{Forecast, Prediction};
pub use inputs::{DataSource, Inputs, MeshSource, ModelText, Origin, hash, hash_file, hash_mesh};
pub use keep::Keep;
pub use maps::FittedMap;
pub use mode::Mode;
pub use next::{Candidates, Ranking};
pub use problem::{Domain, Loaded, Problem, surface};
pub use results::Results;
pub use sample::Ended;
pub use task::Task;
pub use warm_start::WarmStartError;

#[cfg(test)]
mod run_tests;
