//! What a run leaves on disk and on the screen.
//!
//! Knows arrays of draws, summaries, a mesh and a record of the run; nothing of the simulator.
//! Every file and folder appears whole or not at all.

mod approximation;
mod axes;
mod cell;
mod columns;
mod curves;
mod dataset;
mod draws;
mod end_of_run;
mod enough;
mod error;
mod error_bars;
mod experiment_page;
mod field_draws;
pub mod figures;
mod files;
mod html;
mod loo;
mod loop_errors;
mod loop_page;
mod packed;
pub mod plot;
mod posterior;
mod predicted;
mod quantities;
mod rows;
mod run_record;
#[cfg(test)]
mod samples;
mod summary;
mod surface_map;
mod svg;
mod table;
mod text;
mod verdict;
mod zarr;

pub use approximation::Approximation;
pub use cell::{write_restitution, write_trace};
pub use columns::Columns;
pub use curves::Curves;
pub use dataset::{Group, Values, Variable};
pub use draws::write_draws;
pub use end_of_run::{end_of_run, rmse_line};
pub(crate) use enough::has_enough;
pub use error::ReportError;
pub use error_bars::{ErrorBars, Panel};
pub use experiment_page::{ExperimentPage, Figure, write_experiment_page};
pub use field_draws::FieldDraws;
pub use html::{Page, PointData, Surface, write_html};
pub use loo::{LeaveOneOut, LooRecord, LooRow, read_loo, worst_k, write_loo};
pub use loop_errors::{ErrorChange, MostOfTheGain, PredictionError};
pub use loop_page::{
    Against, LoopPage, Residuals, SiteResidual, TriedEffect, TriedRound, loop_page,
};
pub use posterior::{Posterior, numbers_at_rows};
pub use rows::{
    Forecasted, LEVELS, LeftOutBy, Predicted, PredictedRow, Predictions, read_rows, write_forecast,
    write_rows,
};
pub use run_record::{
    EMBEDDED_ATRIUM, Provenance, RunRecord, Seconds, SettingsRecord, SurfaceRecord,
};
pub use summary::{Row, read_summary_json, write_summary_csv, write_summary_json};
pub use table::{WIDTH, console_table};
pub(crate) use text::{after_number, shown};
pub use verdict::{
    MAX_DIVERGENT, MAX_R_HAT, MIN_E_BFMI, MIN_ESS, is_sampled, verdict, verdict_lines,
};
pub use verdict::{doubted, remedy};
pub use zarr::write_zarr;
