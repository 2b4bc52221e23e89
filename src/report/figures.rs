//! Pictures of surrogates as SVG files that stand on their own: contours of ERP, indices and main effects.
//!
//! Knows functions to draw and where; it knows nothing of how they were fitted.

use std::fmt::Write as _;

use super::axes::{self, Axes, Axis, COLOURS, Scale};
use crate::ep::cell::RANGES;
use crate::surrogate::inputs::{ERP_INPUTS, input_range};
use crate::surrogate::{OutcomeSensitivity, Sensitivity};

/// A panel's size.
const SIZE: [f64; 2] = [300.0, 240.0];
/// From panel to panel.
const PITCH: [f64; 2] = [Axes::LEFT + SIZE[0] + 20.0, Axes::ABOVE + SIZE[1] + Axes::BELOW];

/// Cells of a contour panel along each axis.
const CELLS: usize = 75;

/// Between neighbouring contours, ms.
const STEP: f64 = 10.0;

/// Points of a main effect's line.
const POINTS: u32 = 60;
/// Fill of additive indices and of Sobol's.
const FILLS: [&str; 2] = [COLOURS[0], COLOURS[1]];

/// A title and a function of `tau_out` and `apd_max` (ms); `None` where it is void.
pub type Panel<'a> = (&'a str, &'a dyn Fn(f64, f64) -> Option<f64>);

/// Filled contours of each panel, 10 ms apart, `tau_out` to the right and `apd_max` upwards; white where void.
pub fn contours(panels: &[Panel<'_>]) -> String {
    let (x_range, y_range) = (input_range(ERP_INPUTS[1]), input_range(ERP_INPUTS[2]));
    let at = |(lower, upper): (f64, f64), i: usize| {
        lower + (upper - lower) * (i as f64 + 0.5) / CELLS as f64
    };
    let mut svg = open(panels.len(), 1);
    for (place, (title, f)) in panels.iter().enumerate() {
        let value =
            |i: usize, j: usize| f(at(x_range, i), at(y_range, j)).map(|v| (v / STEP).floor());
        let grid: Vec<Vec<Option<f64>>> =
            (0..CELLS).map(|j| (0..CELLS).map(|i| value(i, j)).collect()).collect();
        svg += &group(place, 0);
        svg += &axes(title, ("tau_out (ms)", x_range), ("apd_max (ms)", y_range)).svg();
        svg += &filled(&grid);
        svg += "</g>";
    }
    svg + "</svg>\n"
}

/// Runs of cells in the same band, and the band's lower end in its middle cell.
fn filled(grid: &[Vec<Option<f64>>]) -> String {
    let bands = || grid.iter().flatten().flatten().copied();
    let (low, high) =
        (bands().fold(f64::INFINITY, f64::min), bands().fold(f64::NEG_INFINITY, f64::max));
    let [w, h] = SIZE.map(|size| size / CELLS as f64);
    let mut svg = String::new();
    let mut middles = std::collections::BTreeMap::<i64, Vec<(f64, f64)>>::new();
    for (j, row) in grid.iter().enumerate() {
        let y = SIZE[1] - (j + 1) as f64 * h;
        for run in row.chunk_by(|a, b| a == b).scan(0, |start, run| {
            *start += run.len();
            Some((*start - run.len(), run))
        }) {
            let (start, Some(band)) = (run.0, run.1[0]) else { continue };
            let (x, width) = (start as f64 * w, run.1.len() as f64 * w);
            let _ = write!(
                svg,
                r#"<rect x="{x:.1}" y="{y:.1}" width="{:.1}" height="{:.1}" fill="{}"/>"#,
                width + 0.3,
                h + 0.3,
                colour((band - low) / (high - low).max(1.0))
            );
            middles.entry(band as i64).or_default().push((x + 0.5 * width, y + 0.5 * h));
        }
    }
    for (band, places) in middles.iter().filter(|(band, _)| *band % 2 == 0) {
        let (x, y) = places[places.len() / 2];
        let _ = write!(
            svg,
            r#"<text x="{x:.1}" y="{:.1}" font-size="10" text-anchor="middle">{:.0}</text>"#,
            y + 4.0,
            *band as f64 * STEP
        );
    }
    svg
}

/// From dark blue through green to light yellow: legible in grey, too.
fn colour(share: f64) -> String {
    let stops = [[68.0, 90.0, 160.0], [60.0, 160.0, 150.0], [250.0, 230.0, 110.0]];
    let t = share.clamp(0.0, 1.0) * 2.0;
    let (from, to, t) =
        if t < 1.0 { (stops[0], stops[1], t) } else { (stops[1], stops[2], t - 1.0) };
    let mixed = |k: usize| (from[k] + (to[k] - from[k]) * t) as u8;
    format!("#{:02x}{:02x}{:02x}", mixed(0), mixed(1), mixed(2))
}

/// For each outcome the additive indices (blue) beside Sobol's total ones (ochre), and how it goes with each input.
pub fn main_effects(result: &Sensitivity) -> String {
    let mut svg = open(1 + result.inputs.len(), result.outcomes.len());
    for (row, outcome) in result.outcomes.iter().enumerate() {
        svg += &group(0, row);
        svg += &indices(&result.inputs, outcome);
        svg += "</g>";
        svg += &effects(&result.inputs, outcome, row);
    }
    svg + "</svg>\n"
}

/// The panel of an outcome's indices.
fn indices(inputs: &[usize], outcome: &OutcomeSensitivity) -> String {
    let n = inputs.len() as f64;
    let centre = |d: usize| (d as f64 + 0.5) / n;
    let names = inputs.iter().enumerate().map(|(d, i)| (centre(d), RANGES[*i].0.to_owned()));
    let axes = Axes {
        size: SIZE,
        title: &format!("{}: share of variance", outcome.name),
        x: Axis {
            label: "blue: additive model, ochre: Sobol, in all",
            ticks: names.collect(),
            has_lines: false,
        },
        y: Axis { label: "", ticks: Scale::between(0.0, 1.0).labelled(), has_lines: true },
    };
    let mut svg = axes.svg();
    let slot = SIZE[0] / n;
    for (d, (smooth, sobol)) in outcome.gam.smooths.iter().zip(&outcome.sobol).enumerate() {
        let bars = [(0.12, smooth.index), (0.5, sobol.total.value)];
        for ((offset, value), fill) in bars.into_iter().zip(FILLS) {
            let height = SIZE[1] * value.clamp(0.0, 1.0);
            let _ = write!(
                svg,
                r#"<rect fill="{fill}" x="{:.1}" y="{:.1}" width="{:.1}" height="{height:.1}"><title>{value:.3}</title></rect>"#,
                slot * (d as f64 + offset),
                SIZE[1] - height,
                slot * 0.36
            );
        }
    }
    svg
}

/// The panels of how an outcome goes with each input, on one scale.
fn effects(inputs: &[usize], outcome: &OutcomeSensitivity, row: usize) -> String {
    let along = |(low, high): (f64, f64)| {
        (0..=POINTS).map(move |i| low + (high - low) * f64::from(i) / f64::from(POINTS))
    };
    let smooths = &outcome.gam.smooths;
    let values = || smooths.iter().flat_map(|smooth| along(smooth.range).map(|x| smooth.at(x)));
    let (low, high) =
        (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max));
    let (y, title) = (Scale::between(low, high), format!("{} ({})", outcome.name, outcome.unit));
    let mean = outcome.gam.mean;
    let mut svg = String::new();
    for (d, smooth) in smooths.iter().enumerate() {
        let (name, unit, ..) = RANGES[inputs[d]];
        let (label, range) = (format!("{name} ({unit})"), (mean + low, mean + high));
        svg += &group(d + 1, row);
        svg += &axes(&title, (&label, smooth.range), ("", range)).svg();
        let x = Scale::between(smooth.range.0, smooth.range.1);
        let place = |at: f64| [SIZE[0] * x.share(at), SIZE[1] * (1.0 - y.share(smooth.at(at)))];
        let style = format!(r#"fill="none" stroke="{}" stroke-width="2""#, FILLS[0]);
        svg += &axes::line(along(smooth.range).map(place), &style);
        svg += "</g>";
    }
    svg
}

/// The opening of a picture of `columns` × `rows` panels.
fn open(columns: usize, rows: usize) -> String {
    axes::open(columns as f64 * PITCH[0], rows as f64 * PITCH[1], 12)
}

/// The opening of the panel in this column and row.
fn group(column: usize, row: usize) -> String {
    let (x, y) = (column as f64 * PITCH[0], row as f64 * PITCH[1]);
    axes::group(x + Axes::LEFT, y + Axes::ABOVE)
}

/// A panel's axes with ticks at the ends and in the middle of these ranges.
fn axes<'a>(
    title: &'a str,
    (x_label, x): (&'a str, (f64, f64)),
    (y_label, y): (&'a str, (f64, f64)),
) -> Axes<'a> {
    let ticks = |(low, high): (f64, f64)| Scale::between(low, high).labelled();
    Axes {
        size: SIZE,
        title,
        x: Axis { label: x_label, ticks: ticks(x), has_lines: false },
        y: Axis { label: y_label, ticks: ticks(y), has_lines: false },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contours_leave_the_void_white_and_label_every_second_band() {
        let f = |t: f64, a: f64| (a < 195.0).then_some(t + a);
        let svg = contours(&[("ERP_S2 (ms)", &f)]);
        // half of the rows are drawn: 75 cells over 120–270 ms, 37 of them with a middle below 195 ms
        let rows = svg.matches("<rect x=\"0.0\"").count();
        assert!((37..=38).contains(&rows), "{rows}");
        assert!(svg.contains(">160</text>") && !svg.contains(">170</text>"));
        assert!(svg.contains("tau_out (ms)") && svg.contains("apd_max (ms)"));
    }

    #[test]
    fn colours_run_from_one_end_to_the_other() {
        assert_eq!([colour(0.0), colour(0.5), colour(1.0)], ["#445aa0", "#3ca096", "#fae66e"]);
    }
}
