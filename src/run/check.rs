//! A problem looked at without sampling: does its density exist at the start, and what does it cost?

use std::fmt;
use std::hint::black_box;
use std::time::{Duration, Instant};

use super::event::doubts_in_words;
use super::{Problem, RunError};
use crate::diagnostics::verdict::{Colour, Doubt};
use crate::infer::{InferError, LogDensity as _};
use crate::model::Model;

/// Most evaluations that the gradient is timed over.
const EVALUATIONS: u32 = 20_000;
/// Time after which no further one is made.
const LONGEST: Duration = Duration::from_millis(500);

/// What can be said of a problem without sampling. Its `Display` is what `eplat check` prints.
#[derive(Clone, Debug)]
pub struct Check {
    /// Name and number of measurements of each `observe`.
    pub observes: Vec<(String, usize)>,
    /// Name and number of measurements of each `density` that has a term for each.
    pub densities: Vec<(String, usize)>,
    /// Parameters with a number for each label of a column, and these labels.
    pub labels: Vec<(String, Vec<String>)>,
    /// Number of unknowns.
    pub n_unknowns: usize,
    /// Log density at the starting point.
    pub ln_density: f64,
    /// Time of a log density with its gradient, ns.
    pub nanoseconds: f64,
    /// What is wrong with the measurements.
    pub doubts: Vec<Doubt>,
}

impl Problem<'_> {
    /// Evaluates the log density at the starting point, and times it with its gradient (half a second at most).
    ///
    /// # Errors
    /// [`RunError::NoStart`] where it is not finite.
    pub fn check(&self) -> Result<Check, RunError> {
        let model = self.model();
        let (position, mut gradient) = (model.initial(), vec![0.0; model.dim()]);
        let mut evaluator = model.evaluator();
        let ln_density = evaluator.ln_density(&position, &mut gradient);
        if !ln_density.is_finite() || gradient.iter().any(|g| !g.is_finite()) {
            let place = where_it_fails(model, &position, ln_density, &gradient);
            return Err(RunError::NoStart { place });
        }
        let nanoseconds = timed(LONGEST, || {
            black_box(evaluator.ln_density(black_box(&position), &mut gradient));
        });
        let densities = model.densities.iter().filter(|d| !d.rows.is_empty());
        let labelled = model.parameters.iter().filter(|p| !p.labels.is_empty());
        Ok(Check {
            observes: model.observes.iter().map(|o| (o.name.to_string(), o.rows.len())).collect(),
            densities: densities.map(|d| (d.name.to_string(), d.rows.len())).collect(),
            labels: labelled.map(|p| (p.name.clone(), p.labels.clone())).collect(),
            n_unknowns: model.dim(),
            ln_density,
            nanoseconds,
            doubts: self.doubts().to_vec(),
        })
    }
}

/// Nanoseconds of one call, over as many as are made in this time, at least one.
fn timed(longest: Duration, mut call: impl FnMut()) -> f64 {
    let begun = Instant::now();
    let mut n = 0;
    while n < EVALUATIONS && (n == 0 || begun.elapsed() < longest) {
        call();
        n += 1;
    }
    begun.elapsed().as_secs_f64() * 1e9 / f64::from(n)
}

impl Check {
    /// The worst of the doubts: red where the measurements contradict each other or the model.
    pub fn colour(&self) -> Colour {
        self.doubts.iter().map(Doubt::colour).max().unwrap_or_default()
    }
}

impl fmt::Display for Check {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (name, n) in &self.observes {
            writeln!(f, "observe {name}: {n} measurements")?;
        }
        for (name, n) in &self.densities {
            writeln!(f, "density {name}: {n} measurements")?;
        }
        for (name, labels) in &self.labels {
            writeln!(f, "param {name}: {} labels ({})", labels.len(), labels.join(", "))?;
        }
        writeln!(f, "{} unknowns", self.n_unknowns)?;
        write!(
            f,
            "log density {:.3} at the starting point; {:.0} ns with its gradient",
            self.ln_density, self.nanoseconds
        )?;
        if self.doubts.is_empty() {
            return Ok(());
        }
        write!(f, "\n{}", doubts_in_words(&self.doubts))
    }
}

/// The error with the place at which there is no support, if it is that.
pub(super) fn placed(model: &Model, error: InferError) -> RunError {
    if !matches!(error, InferError::NoSupport { .. }) {
        return error.into();
    }
    let (position, mut gradient) = (model.initial(), vec![0.0; model.dim()]);
    let ln_density = model.evaluator().ln_density(&position, &mut gradient);
    RunError::NoStart { place: where_it_fails(model, &position, ln_density, &gradient) }
}

/// Where the log density or its gradient is no number: in a measurement, or in an unknown.
fn where_it_fails(model: &Model, position: &[f64], ln_density: f64, gradient: &[f64]) -> String {
    let (mut tape, mut each) = (model.tape(), vec![]);
    model.forward(&mut tape, position);
    model.pointwise(&tape, &mut each);
    let rows = model.measured().flat_map(|(name, rows)| rows.iter().map(move |row| (name, row)));
    let row = rows.zip(&each).find(|(_, ln_likelihood)| !ln_likelihood.is_finite());
    let names = model.unknown_names();
    let unknown = gradient.iter().position(|g| !g.is_finite()).and_then(|i| names.get(i));
    match (row, unknown) {
        (Some(((name, row), ln)), _) => {
            let is_observe = model.observes.iter().any(|o| o.name == name);
            let keyword = if is_observe { "observe" } else { "density" };
            format!("{keyword} {name}: the log likelihood of row {} of the table is {ln}", row + 1)
        }
        (None, Some(name)) => format!("the derivative of the log density in {name} is no number"),
        (None, None) => format!("the log density is {ln_density}, through a prior or a `density`"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_slow_is_called_no_longer_than_it_may() {
        let slow = Duration::from_millis(5);
        let calls = |longest: Duration, time: Duration| {
            let mut n = 0;
            let nanoseconds = timed(longest, || {
                n += 1;
                std::thread::sleep(time);
            });
            assert!(nanoseconds >= time.as_secs_f64() * 1e9);
            n
        };
        assert_eq!(calls(Duration::ZERO, slow), 1);
        assert!((1..=10).contains(&calls(10 * slow, slow)));
        assert_eq!(calls(Duration::from_hours(1), Duration::ZERO), EVALUATIONS);
    }
}
