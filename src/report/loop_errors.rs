//! Errors of predictions on the page of the loop: as written, before and after.

use std::fmt::Write as _;

use super::text::{after_number, escape, tick};

/// Errors of the same predictions by two models.
#[derive(Clone, Debug)]
pub struct ErrorChange {
    /// What was predicted, e.g. `held-out measurements`.
    pub what: String,
    /// Number of measurements.
    pub n: usize,
    /// Number of units (sites, mostly) that have a log predictive density each.
    pub n_units: usize,
    /// By the model as written, where the model before has more.
    pub declared: Option<PredictionError>,
    /// By the model before: as written, and what sites and measurements differ by.
    pub before: PredictionError,
    /// By the model with what was found too.
    pub after: Option<PredictionError>,
    /// Gain in elpd from before to after and its standard error.
    pub elpd_gain: [f64; 2],
    /// The unit that makes more than half of that, if one does.
    pub most: Option<MostOfTheGain>,
}

/// A unit that makes more than half of a gain.
#[derive(Clone, Debug, PartialEq)]
pub struct MostOfTheGain {
    /// The unit, in words.
    pub unit: String,
    /// The gain of the others and its standard error.
    pub without: [f64; 2],
}

impl ErrorChange {
    /// The gain with its standard error; what it is without a unit that makes most of it.
    pub fn gain(&self) -> String {
        let gain = with_error(self.elpd_gain);
        match &self.most {
            Some(MostOfTheGain { unit, without }) => {
                format!(
                    "{gain}, more than half of it at {unit}: without it {}",
                    with_error(*without)
                )
            }
            None => gain,
        }
    }
}

/// How well measurements were predicted; each with its standard error.
#[derive(Clone, Copy, Debug)]
pub struct PredictionError {
    /// Root mean squared error, in the measurements' unit.
    pub rmse: [f64; 2],
    /// Sum of log predictive densities.
    pub elpd: [f64; 2],
    /// Share of measurements inside their central 90 % predictive interval.
    pub coverage90: [f64; 2],
}

/// A number with its standard error, as many digits as that allows.
fn with_error([value, error]: [f64; 2]) -> String {
    let digits =
        if error > 0.0 && error < 1e5 { (1.0 - error.log10()).ceil().clamp(0.0, 6.0) } else { 2.0 };
    let digits = digits as usize;
    format!("{value:.digits$} ± {error:.digits$}").replace('-', "−")
}

fn percent([share, error]: [f64; 2]) -> String {
    format!("{:.0} ± {:.0} %", 100.0 * share, 100.0 * error)
}

/// A unit as it stands behind a number; 1 is none.
pub(super) fn behind(unit: &str) -> String {
    escape(&after_number(unit))
}

/// The three numbers of the first screen.
pub(super) fn tiles(c: &ErrorChange, unit: &str) -> String {
    let arrow = |of: &dyn Fn(&PredictionError) -> String| match &c.after {
        Some(after) => format!("{} → {}", of(&c.before), of(after)),
        None => of(&c.before),
    };
    let what = escape(&c.what);
    let mut html = format!(
        "<ul class=\"tiles\"><li><b>{}{}</b><span>error (rms) of {} {what}</span>",
        arrow(&|e| tick(e.rmse[0])),
        behind(unit),
        c.n
    );
    if c.after.is_some() {
        let gain = c.most.as_ref().map_or(c.elpd_gain, |most| most.without);
        let without = c.most.as_ref().map_or(String::new(), |most| {
            format!(", without {} that makes more than half of it", escape(&most.unit))
        });
        let _ = write!(
            html,
            "<li><b>{}</b><span>gain in log predictive density (elpd){without}</span>",
            with_error(gain)
        );
    }
    let _ = write!(
        html,
        "<li><b>{} %</b><span>lie in their 90 % interval</span></ul>",
        arrow(&|e| format!("{:.0}", 100.0 * e.coverage90[0]))
    );
    html
}

pub(super) fn error_line(c: &ErrorChange, unit: &str) -> String {
    let e = c.declared.as_ref().unwrap_or(&c.before);
    format!(
        "<p>Error of {} {}, as written: {}{}; elpd {}; {} lie in their 90 % interval.</p>",
        c.n,
        escape(&c.what),
        with_error(e.rmse),
        behind(unit),
        with_error(e.elpd),
        percent(e.coverage90)
    )
}

pub(super) fn comparison(c: &ErrorChange, unit: &str) -> String {
    let line = |name: &str, e: &PredictionError| {
        let (rmse, elpd) = (with_error(e.rmse), with_error(e.elpd));
        format!("<tr><td class=\"text\">{name}<td>{rmse}<td>{elpd}<td>{}", percent(e.coverage90))
    };
    let before = if c.declared.is_some() { "before" } else { "as written" };
    let declared = c.declared.as_ref().map_or(String::new(), |e| line("as written", e));
    let after = c.after.as_ref().map_or(String::new(), |after| {
        let gain = with_error(c.elpd_gain);
        let most = c.most.as_ref().map_or(String::new(), |most| {
            let (unit, without) = (escape(&most.unit), with_error(most.without));
            format!(
                "<tr><td class=\"text\">without {unit}, more than half of it<td><td>{without}<td>"
            )
        });
        let gain = format!("<tr><td class=\"text\">gain, before to after<td><td>{gain}<td>");
        line("after", after) + &gain + &most
    });
    let unit = if behind(unit).is_empty() { String::new() } else { format!(",{}", behind(unit)) };
    format!(
        "<table class=\"summary\"><thead><tr><th class=\"text\">{} {}<th>rms error{unit}<th>elpd<th>in 90 % interval</thead>\
         <tbody>{declared}{}{after}</tbody></table>",
        c.n,
        escape(&c.what),
        line(before, &c.before),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_the_digits_that_their_errors_allow() {
        let all = [[8.731, 0.52], [-120.44, 13.0], [0.5, 0.0]].map(with_error);
        assert_eq!(all, ["8.73 ± 0.52", "−120 ± 13", "0.50 ± 0.00"]);
    }
}
