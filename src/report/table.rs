//! The posterior summary as a table for people, at most [`WIDTH`] columns wide.

use std::fmt::Write as _;

use super::Row;
use super::text::shown;
use super::verdict::{MAX_R_HAT, MIN_ESS};

/// Columns of a terminal that the table never exceeds.
pub const WIDTH: usize = 100;
/// Vectors longer than this are one line unless every element is asked for.
const LONGEST_VECTOR: usize = 10;
/// Units longer than this are shortened on the screen.
const LONGEST_UNIT: usize = 8;
/// Numbers longer than this are written in powers of ten, and with fewer digits.
const LONGEST_NUMBER: usize = 8;
/// Width of the marks at the end of a line.
const MARKS: usize = 4;

/// Column titles; the third is right-aligned like all after it.
pub(super) const TITLES: [&str; 7] =
    ["parameter", "unit", "median", "90 % interval", "mean ± sd", "R̂", "ESS"];

/// One line of the table, as texts.
#[derive(Debug)]
pub(super) struct Line {
    pub(super) cells: [String; 7],
    /// Mean and standard deviation hang on rare draws.
    pub(super) heavy: bool,
    /// R̂ or ESS is out of bounds.
    pub(super) suspect: bool,
}

/// The explanation of the marks of [`console_table`], also under the table in the report.
pub(super) const HEAVY_TAIL: &str =
    "† heavy tail: mean and sd hang on a few draws; use the median and the interval";

/// Renders the rows: parameter, unit, median, 90 % interval, mean ± sd, R̂ and the smaller of bulk and tail ESS.
///
/// The digits of a number stop where its own Monte Carlo error begins.  A vector of more than ten elements is one line with
/// its worst R̂ and smallest ESS, unless `every` element is asked for.
pub fn console_table(rows: &[Row], every: bool) -> String {
    let mut lines = lines(rows, every);
    for line in &mut lines {
        line.cells[1] = shortened(&line.cells[1], LONGEST_UNIT);
    }
    let mut widths = TITLES.map(width);
    for line in &lines {
        for (widest, cell) in widths.iter_mut().zip(&line.cells) {
            *widest = width(cell).max(*widest);
        }
    }
    let gaps = 2 * (TITLES.len() - 1);
    let others = widths[1..].iter().sum::<usize>() + gaps + MARKS;
    widths[0] = widths[0].min(WIDTH.saturating_sub(others).max(TITLES[0].len()));
    let mut table = join(&TITLES.map(str::to_owned), &widths, "");
    for line in &mut lines {
        line.cells[0] = shortened(&line.cells[0], widths[0]);
        table += &join(&line.cells, &widths, line.marks());
    }
    if lines.iter().any(|line| line.heavy) {
        table += HEAVY_TAIL;
        table += "\n";
    }
    if lines.iter().any(|line| line.suspect) {
        let _ = writeln!(table, "✗ not to be trusted: R̂ above {MAX_R_HAT} or ESS below {MIN_ESS}");
    }
    table
}

impl Line {
    /// What to warn of, at the end of the line.
    pub(super) fn marks(&self) -> &'static str {
        match (self.heavy, self.suspect) {
            (false, false) => "",
            (true, false) => "†",
            (false, true) => "✗",
            (true, true) => "† ✗",
        }
    }
}

/// The lines of the table, long vectors condensed unless `every` element is asked for.
pub(super) fn lines(rows: &[Row], every: bool) -> Vec<Line> {
    let stem = |row: &Row| row.name.split('[').next().unwrap_or_default().to_owned();
    let vectors = rows.chunk_by(|a, b| a.name.contains('[') && stem(a) == stem(b));
    let lines = vectors.flat_map(|rows| {
        if every || rows.len() <= LONGEST_VECTOR {
            rows.iter().map(line).collect()
        } else {
            vec![condensed(&stem(&rows[0]), rows)]
        }
    });
    lines.collect()
}

fn line(row: &Row) -> Line {
    let summary = &row.summary;
    let number = |value: f64, mcse: f64| rounded(value, decimals(mcse, summary.sd));
    // A normal distribution has sd = 0.30 (q95 − q5), an exponential 0.34; at twice that the tail has the word.
    let heavy = summary.sd > 0.6 * (summary.q95 - summary.q5);
    let cells = [
        row.name.clone(),
        shown(&row.unit).to_owned(),
        number(summary.q50, summary.mcse_q50),
        format!(
            "{} … {}",
            number(summary.q5, summary.mcse_q5),
            number(summary.q95, summary.mcse_q95)
        ),
        format!("{} ± {}", number(summary.mean, summary.mcse), number(summary.sd, summary.mcse_sd)),
        diagnostic(summary.r_hat, 3),
        diagnostic(row.ess(), 0),
    ];
    Line { cells, heavy, suspect: is_suspect(summary.r_hat, row.ess()) }
}

/// One line for a whole vector: its worst diagnostics.
fn condensed(stem: &str, rows: &[Row]) -> Line {
    let r_hat = rows.iter().map(|row| row.summary.r_hat).fold(f64::NAN, f64::max);
    let ess = rows.iter().map(Row::ess).fold(f64::NAN, f64::min);
    let cells = [
        format!("{stem}[…]"),
        shown(&rows[0].unit).to_owned(),
        format!("{} values", rows.len()),
        String::new(),
        String::new(),
        diagnostic(r_hat, 3),
        diagnostic(ess, 0),
    ];
    Line { cells, heavy: false, suspect: is_suspect(r_hat, ess) }
}

fn is_suspect(r_hat: f64, ess: f64) -> bool {
    r_hat > MAX_R_HAT || ess < MIN_ESS
}

fn diagnostic(value: f64, decimals: usize) -> String {
    if value.is_finite() && value < 1e5 { format!("{value:.decimals$}") } else { rounded(value, 0) }
}

/// Decimals up to the leading digit of a Monte Carlo error, or of a hundredth of the spread where there is none.
fn decimals(mcse: f64, sd: f64) -> usize {
    let last_digit = [mcse, 0.01 * sd, 0.01].into_iter().find(|x| x.is_finite() && *x > 0.0);
    (-last_digit.unwrap_or(0.01).log10().floor()).clamp(0.0, 300.0) as usize
}

/// `value` with so many decimals, in powers of ten where that would be long.
fn rounded(value: f64, decimals: usize) -> String {
    if !value.is_finite() {
        return "–".to_owned();
    }
    let exact = format!("{value:.decimals$}");
    let shorter = (0..3).rev().map(|digits| format!("{value:.digits$e}"));
    let fits = |text: &String| text.len() <= LONGEST_NUMBER;
    let text = [exact].into_iter().chain(shorter).find(fits);
    text.unwrap_or_else(|| format!("{value:.0e}")).replace('-', "−")
}

/// At most `longest` characters, an ellipsis in the middle.
fn shortened(text: &str, longest: usize) -> String {
    let characters: Vec<char> = text.chars().collect();
    if characters.len() <= longest {
        return text.to_owned();
    }
    let tail = longest / 2;
    let head = longest - tail - 1;
    let (start, end) = (&characters[..head], &characters[characters.len() - tail..]);
    start.iter().chain(&['…']).chain(end).collect()
}

/// Columns on the screen: the circumflex of R̂ takes none.
fn width(text: &str) -> usize {
    text.chars().filter(|c| *c != '\u{302}').count()
}

/// The cells padded to `widths`, names and units to the left, numbers to the right; then the marks.
fn join(cells: &[String; 7], widths: &[usize; 7], marks: &str) -> String {
    let padded = cells.iter().zip(widths).enumerate().map(|(column, (cell, widest))| {
        let padding = " ".repeat(widest - width(cell));
        if column < 2 { format!("{cell}{padding}") } else { format!("{padding}{cell}") }
    });
    let line = format!("{} {marks}", padded.collect::<Vec<_>>().join("  "));
    format!("{}\n", line.trim_end())
}

#[cfg(test)]
mod tests {
    use super::super::samples;
    use super::*;

    fn rows() -> Vec<Row> {
        let mut heavy = samples::row("tau_out.alpha", "ms", 5.0);
        heavy.summary.sd = 40.0;
        heavy.summary.mcse = 3.0;
        heavy.summary.mcse_sd = 20.0;
        let mut stuck = samples::row("apd_max.rho", "mm", 64.25);
        stuck.summary.r_hat = 1.523;
        stuck.summary.ess_tail = 12.3;
        let mut constant = samples::row("fixed", "", 0.0);
        constant.summary.r_hat = f64::NAN;
        let mut rows = vec![samples::row("tau_out.m", "ms", -12.34), heavy, stuck, constant];
        rows.extend((0..24).map(|k| samples::row(&format!("tau_out.eta[{k}]"), "", 0.5)));
        rows[10].summary.r_hat = 1.019;
        rows.extend((0..2).map(|k| samples::row(&format!("b[{k}]"), "kg", 1e-9)));
        rows
    }

    #[test]
    fn long_vectors_are_one_line() {
        insta::assert_snapshot!(console_table(&rows(), false), @r"
        parameter       unit     median       90 % interval           mean ± sd      R̂   ESS
        tau_out.m       ms       −12.34     −14.36 … −10.32       −12.34 ± 1.23  1.002  1513
        tau_out.alpha   ms         5.00         4.18 … 5.82              5 ± 40  1.002  1513 †
        apd_max.rho     mm         64.2         53.7 … 74.8          64.2 ± 6.4  1.523    12 ✗
        fixed                      0.00         0.00 … 0.00         0.00 ± 0.00      –  1513
        tau_out.eta[…]        24 values                                          1.019  1513
        b[0]            kg      1.00e−9  8.36e−10 … 1.16e−9  1.00e−9 ± 1.00e−10  1.002  1513
        b[1]            kg      1.00e−9  8.36e−10 … 1.16e−9  1.00e−9 ± 1.00e−10  1.002  1513
        † heavy tail: mean and sd hang on a few draws; use the median and the interval
        ✗ not to be trusted: R̂ above 1.02 or ESS below 400
        ");
    }

    #[test]
    fn every_element_on_demand() {
        let table = console_table(&rows(), true);
        assert!((0..24).all(|k| table.contains(&format!("tau_out.eta[{k}] "))), "{table}");
    }

    #[test]
    fn the_widest_table_fits() {
        let mut row = samples::row(&"x".repeat(60), "mm²/ms per kg", -1.0);
        for value in [9_999_999.4, 1e300, -1.234_567e-200, -99_999.0, f64::INFINITY] {
            let (mean, sd, mcse) = (value, value.abs(), value.abs() * 1e-5);
            let [mcse_sd, mcse_q5, mcse_q50, mcse_q95] = [mcse; 4];
            row.summary = crate::diagnostics::Summary {
                sd,
                mcse,
                q5: mean,
                q50: mean,
                q95: mean,
                mcse_sd,
                mcse_q5,
                mcse_q50,
                mcse_q95,
                ..row.summary
            };
            let table = console_table(std::slice::from_ref(&row), false);
            assert!(table.lines().all(|line| width(line) <= WIDTH), "{table}");
        }
    }
}
