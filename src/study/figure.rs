//! Summary and figure of studies.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::Path;

use super::{Group, StudyError};
use crate::report::plot::{self, Picture};
use crate::report::{ErrorBars, Panel};
use crate::store::write_file;

/// Figures that are errors of maps.
const ERROR: &str = "rmse_";
/// Figures that are shares of surfaces within intervals.
const COVERAGE: &str = "coverage90_";

/// The errors of all groups, a line each, as mean ± standard deviation.
pub fn table_text(groups: &[Group]) -> String {
    let names = errors(groups);
    let mut text =
        format!("{:>14} {:>10} {:>5} {:>5}", "lengthscale mm", "resolution", "sites", "cases");
    for name in &names {
        let _ = write!(text, "  {:>14}", format!("RMSE {}", &name[ERROR.len()..]));
    }
    for Group { key: [lengthscale, resolution, sites], n, figures } in groups {
        let _ = write!(text, "\n{lengthscale:>14} {resolution:>10} {sites:>5} {n:>5}");
        for name in &names {
            let (mean, sd) = figures[name];
            let _ = write!(text, "  {:>14}", format!("{mean:.2} ± {sd:.2}"));
        }
    }
    text
}

/// Writes every figure of every group, mean and standard deviation, as CSV.
///
/// # Errors
/// [`StudyError::Write`].
pub fn write_summary(path: &Path, groups: &[Group]) -> Result<(), StudyError> {
    let columns: BTreeSet<&String> = groups.iter().flat_map(|g| g.figures.keys()).collect();
    write_file(path, |file| {
        let mut table = csv::Writer::from_writer(file);
        let keys = ["lengthscale_mm", "resolution", "sites", "cases"].map(str::to_owned);
        let pairs = columns.iter().flat_map(|c| [format!("{c}_mean"), format!("{c}_sd")]);
        table.write_record(keys.into_iter().chain(pairs))?;
        for group in groups {
            let keys = group.key.into_iter().chain([group.n as f64]).map(|x| x.to_string());
            let figures = columns.iter().flat_map(|column| {
                let (mean, sd) = group.figures[*column];
                [mean, sd].map(|x| if x.is_finite() { format!("{x:?}") } else { String::new() })
            });
            table.write_record(keys.chain(figures))?;
        }
        table.flush()
    })
    .map_err(StudyError::io(path))
}

/// Draws the errors of each map against the number of sites, a panel for each resolution, a line for each
/// lengthscale and study; studies have a name.
///
/// # Errors
/// [`StudyError::Write`].
pub fn write_figure(path: &Path, studies: &[(String, Vec<Group>)]) -> Result<(), StudyError> {
    let svg = figure(studies).svg();
    write_file(path, |file| std::io::Write::write_all(file, svg.as_bytes()))
        .map_err(StudyError::io(path))
}

/// Pictures for print of merged studies: `errors` of maps, or the `coverage` of their intervals, against the number of
/// sites; none where the studies have no such figures.
pub fn pictures(studies: &[(String, Vec<Group>)], kind: &str) -> Vec<Picture> {
    let (of, shows) = match kind {
        "errors" => (ERROR, "root mean squared errors of maps against the number of sites"),
        _ => (
            COVERAGE,
            "share of the surface whose truth lies in the 90 % interval, against the number of sites",
        ),
    };
    let figure = figure_of(studies, of);
    plot::error_bars(kind, shows, &figure)
}

fn figure(studies: &[(String, Vec<Group>)]) -> ErrorBars {
    figure_of(studies, ERROR)
}

/// Of all figures whose names begin with `of`.
fn figure_of(studies: &[(String, Vec<Group>)], of: &str) -> ErrorBars {
    let all = || studies.iter().flat_map(|(_, groups)| groups);
    let values = |at: usize| {
        let mut values: Vec<f64> = all().map(|group| group.key[at]).collect();
        values.sort_by(f64::total_cmp);
        values.dedup();
        values
    };
    let (lengthscales, resolutions, sites) = (values(0), values(1), values(2));
    let lines: Vec<(usize, f64)> = (0..studies.len())
        .flat_map(|study| lengthscales.iter().map(move |lengthscale| (study, *lengthscale)))
        .collect();
    let point = |study: usize, key: [f64; 3], name: &String| {
        let mut groups = studies[study].1.iter();
        let group = groups.find(|group| group.is(&key))?;
        group.figures.get(name).copied().filter(|(mean, _)| mean.is_finite())
    };
    let panel = |name: &String, resolution: f64| Panel {
        title: format!("brackets of {resolution}"),
        y_label: format!(
            "{} of {}",
            if of == ERROR { "RMSE" } else { "coverage" },
            &name[of.len()..]
        ),
        points: lines
            .iter()
            .map(|(study, l)| {
                sites.iter().map(|n| point(*study, [*l, resolution, *n], name)).collect()
            })
            .collect(),
    };
    let row = |name: &String| resolutions.iter().map(|r| panel(name, *r)).collect();
    let label = |(study, lengthscale): &(usize, f64)| {
        format!("{} {lengthscale} mm", studies[*study].0).trim_start().to_owned()
    };
    ErrorBars {
        x_label: "sites".to_owned(),
        x: sites.iter().map(ToString::to_string).collect(),
        lines: lines.iter().map(label).collect(),
        rows: names_of(all(), of).iter().map(row).collect(),
    }
}

/// Names of the errors, in the table's order of names.
fn errors<'g>(groups: impl IntoIterator<Item = &'g Group>) -> Vec<String> {
    names_of(groups, ERROR)
}

fn names_of<'g>(groups: impl IntoIterator<Item = &'g Group>, of: &str) -> Vec<String> {
    let names: BTreeSet<&String> =
        groups.into_iter().flat_map(|group| group.figures.keys()).collect();
    names.into_iter().filter(|name| name.starts_with(of)).cloned().collect()
}
