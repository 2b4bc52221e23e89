//! What is asked of a fit besides how well it was sampled: the figures behind its verdict.
//!
//! [`doubts`] look at the measurements before anything is sampled, [`fits`] after; [`surface`] has what
//! is asked of fields and parameters. [`leave_out`] fits again without a measurement, and [`rows`] has
//! every measurement beside its predictions.

mod breakthroughs;
mod doubts;
mod fits;
mod leave_out;
mod reading;
mod regimes;
mod rows;
mod surface;

pub(super) use doubts::doubts;
pub(super) use leave_out::{LeftOut, exact};
pub(super) use reading::Reading;
pub(super) use rows::unweighted;

use std::io;

use super::fit::{Fit, Method};
use crate::diagnostics::verdict::Questions;

impl Fit<'_> {
    /// The figures behind every question that can be asked of these draws, but for *sampled*.
    #[allow(
        clippy::expect_used,
        reason = "what is read from a disk was asked when the fit was made"
    )]
    pub fn questions(&self) -> &Questions {
        self.questions.get_or_init(|| self.ask().expect("no disk is used"))
    }

    /// # Errors
    /// From the disk that replicates are on.
    pub(super) fn ask(&self) -> io::Result<Questions> {
        if self.method == Method::Prior {
            return Ok(Questions { physical: self.physical(), ..Questions::default() });
        }
        Ok(Questions {
            fits: self.fits()?,
            physical: self.physical(),
            informed: self.informed(),
            trusted: self.trusted(),
        })
    }
}
