//! Pictures for print of what a command left: `NAME.svg` and `NAME.png`, 180 mm wide, 300 dpi.
//!
//! Every picture stands on its own: its styles are in it, its texts are texts (SVG) or drawn with the embedded font
//! (PNG), its surfaces are images. A PNG is painted from the same drawing as its SVG, by `paint`, which knows the
//! part of SVG that drawings here have and refuses the rest.

mod axes_pictures;
mod closed_loop;
mod finished;
mod font;
mod isolines;
mod opening;
mod paint;
mod palette;
mod path_data;
mod picture;
mod png;
mod raster;
mod scatter;
mod surface;
mod surrogate;
mod traces;
mod view;
mod vulnerability;

use std::path::Path;

use super::ReportError;
pub use axes_pictures::error_bars;
pub use picture::{DOTS_PER_INCH, Picture, WIDTH_MM};
pub use surrogate::{Surrogate, surrogates};

/// How pictures of fields show standard deviations.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Uncertainty {
    /// As a second map below the mean.
    Beside,
    /// The mean fades to grey.
    Opacity,
}

/// How maps of a run are drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Style {
    /// How standard deviations are shown.
    pub uncertainty: Uncertainty,
    /// Lines at every multiple of so many ms, on maps in ms.
    pub isochrones: Option<f64>,
}

/// Kinds of pictures of a run.
pub const OF_A_RUN: [&str; 5] = ["fields", "truth", "shares", "predicted", "traces"];
/// Of a loop.
pub const OF_A_LOOP: [&str; 2] = ["effects", "residuals"];
/// Of S1S2 at many sites.
pub const OF_VULNERABILITY: [&str; 2] = ["vulnerability", "activation"];

/// The pictures of one kind of a finished run; none where it has nothing of that kind.
///
/// # Errors
/// [`ReportError::Read`], [`ReportError::Malformed`] for a file that is not there or was edited.
pub fn of_a_run(folder: &Path, kind: &str, style: Style) -> Result<Vec<Picture>, ReportError> {
    let run = finished::Finished::read(folder)?;
    match kind {
        "fields" => run.fields(style),
        "truth" => run.truth(),
        "shares" => run.shares(),
        "predicted" => run.predicted(),
        "traces" => run.traces(),
        _ => Ok(vec![]),
    }
}

/// The pictures of one kind of a loop; none where it has nothing of that kind.
///
/// # Errors
/// As [`of_a_run`].
pub fn of_a_loop(folder: &Path, kind: &str) -> Result<Vec<Picture>, ReportError> {
    let finding = closed_loop::Finding::read(folder)?;
    match kind {
        "effects" => Ok(finding.effects()),
        "residuals" => finding.residuals(),
        _ => Ok(vec![]),
    }
}

/// The pictures of one kind of S1S2 at many sites.
///
/// # Errors
/// As [`of_a_run`].
pub fn of_vulnerability(folder: &Path, kind: &str) -> Result<Vec<Picture>, ReportError> {
    let found = vulnerability::Vulnerability::read(folder)?;
    match kind {
        "vulnerability" => Ok(found.vulnerability()),
        "activation" => Ok(found.activation()),
        _ => Ok(vec![]),
    }
}
