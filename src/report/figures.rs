//! Pictures of surrogates as SVG files that stand on their own: contours of ERP, indices and main effects.
//!
//! Knows functions to draw and where; it knows nothing of how they were fitted.

use std::fmt::Write as _;

use super::svg::{escape, tick};
use crate::ep::cell::RANGES;
use crate::surrogate::Sensitivity;
use crate::surrogate::inputs::{ERP_INPUTS, input_range};

/// A panel's size, and the room to its left and below it for labels.
const WIDTH: f64 = 300.0;
const HEIGHT: f64 = 240.0;
const LEFT: f64 = 64.0;
const BELOW: f64 = 52.0;

/// Cells of a contour panel along each axis.
const CELLS: usize = 75;

/// Between neighbouring contours, ms.
const STEP: f64 = 10.0;

const STYLE: &str = "<style>text{font:12px sans-serif;fill:#222}.t{font-weight:bold}.m{text-anchor:middle}\
.e{text-anchor:end}.b{fill:none;stroke:#222}.c{fill:none;stroke:#fff;stroke-width:0.8}\
.g{fill:#3b6ea5}.s{fill:#c9872b}.l{fill:none;stroke:#3b6ea5;stroke-width:2}.v{font-size:10px}</style>";

/// A title and a function of `tau_out` and `apd_max` (ms); `None` where it is void.
pub type Panel<'a> = (&'a str, &'a dyn Fn(f64, f64) -> Option<f64>);

/// Filled contours of each panel, 10 ms apart, `tau_out` to the right and `apd_max` upwards; white where void.
pub fn contours(panels: &[Panel<'_>]) -> String {
    let (x_range, y_range) = (input_range(ERP_INPUTS[1]), input_range(ERP_INPUTS[2]));
    let at = |(lower, upper): (f64, f64), i: usize| {
        lower + (upper - lower) * (i as f64 + 0.5) / CELLS as f64
    };
    let mut svg = open(panels.len(), 1, "contours of ERP over tau_out and apd_max");
    for (place, (title, f)) in panels.iter().enumerate() {
        let value =
            |i: usize, j: usize| f(at(x_range, i), at(y_range, j)).map(|v| (v / STEP).floor());
        let grid: Vec<Vec<Option<f64>>> =
            (0..CELLS).map(|j| (0..CELLS).map(|i| value(i, j)).collect()).collect();
        svg += &group(place, 0);
        svg += &filled(&grid);
        svg += &axes(title, ("tau_out (ms)", x_range), ("apd_max (ms)", y_range));
        svg += "</g>";
    }
    svg + "</svg>\n"
}

/// Runs of cells in the same band, and the band's lower end in its middle cell.
fn filled(grid: &[Vec<Option<f64>>]) -> String {
    let bands = || grid.iter().flatten().flatten().copied();
    let (low, high) =
        (bands().fold(f64::INFINITY, f64::min), bands().fold(f64::NEG_INFINITY, f64::max));
    let (w, h) = (WIDTH / CELLS as f64, HEIGHT / CELLS as f64);
    let mut svg = String::new();
    let mut middles = std::collections::BTreeMap::<i64, Vec<(f64, f64)>>::new();
    for (j, row) in grid.iter().enumerate() {
        let y = HEIGHT - (j + 1) as f64 * h;
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
            r#"<text class="m v" x="{x:.1}" y="{:.1}">{:.0}</text>"#,
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
    let n = result.inputs.len();
    let mut svg = open(1 + n, result.outcomes.len(), "sensitivity of outcomes to parameters");
    for (row, outcome) in result.outcomes.iter().enumerate() {
        svg += &group(0, row);
        svg += &axes(
            &format!("{}: share of variance", outcome.name),
            ("", (0.0, 0.0)),
            ("", (0.0, 1.0)),
        );
        let slot = WIDTH / n as f64;
        for (d, (smooth, s)) in outcome.gam.smooths.iter().zip(&outcome.sobol).enumerate() {
            for (class, offset, value) in [("g", 0.12, smooth.index), ("s", 0.5, s.total.value)] {
                let height = HEIGHT * value.clamp(0.0, 1.0);
                let _ = write!(
                    svg,
                    r#"<rect class="{class}" x="{:.1}" y="{:.1}" width="{:.1}" height="{height:.1}"><title>{value:.3}</title></rect>"#,
                    slot * (d as f64 + offset),
                    HEIGHT - height,
                    slot * 0.36
                );
            }
            let name = RANGES[result.inputs[d]].0;
            let x = slot * (d as f64 + 0.5);
            let _ = write!(
                svg,
                r#"<text class="m v" x="{x:.1}" y="{:.1}">{name}</text>"#,
                HEIGHT + 14.0
            );
        }
        let legend = "blue: additive model, ochre: Sobol, in all";
        let _ =
            write!(svg, r#"<text class="v" x="0" y="{:.1}">{legend}</text></g>"#, HEIGHT + 32.0);
        let values = || {
            outcome.gam.smooths.iter().flat_map(|smooth| {
                let (low, high) = smooth.range;
                (0..=60).map(move |i| smooth.at(low + (high - low) * f64::from(i) / 60.0))
            })
        };
        let (low, high) =
            (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max));
        let range = (outcome.gam.mean + low, outcome.gam.mean + high);
        for (d, smooth) in outcome.gam.smooths.iter().enumerate() {
            let (name, unit, ..) = RANGES[result.inputs[d]];
            svg += &group(d + 1, row);
            let title = format!("{} ({})", outcome.name, outcome.unit);
            svg += &axes(&title, (&format!("{name} ({unit})"), smooth.range), ("", range));
            let (x0, x1) = smooth.range;
            let point = |i: i32| {
                let share = f64::from(i) / 60.0;
                let y = (smooth.at(x0 + (x1 - x0) * share) - low) / (high - low);
                format!("{:.1} {:.1}", WIDTH * share, HEIGHT * (1.0 - y))
            };
            let path: Vec<String> = (0..=60).map(point).collect();
            let _ = write!(svg, r#"<path class="l" d="M{}"/></g>"#, path.join("L"));
        }
    }
    svg + "</svg>\n"
}

/// The opening of a picture of `columns` × `rows` panels.
fn open(columns: usize, rows: usize, label: &str) -> String {
    let (width, height) =
        (columns as f64 * (LEFT + WIDTH + 16.0), rows as f64 * (28.0 + HEIGHT + BELOW));
    format!(
        r##"<svg xmlns="http://www.w3.org/2000/svg" role="img" aria-label="{label}" viewBox="0 0 {width} {height}" width="{width}" height="{height}"><rect width="{width}" height="{height}" fill="#fff"/>{STYLE}"##
    )
}

/// The opening of the panel in this column and row.
fn group(column: usize, row: usize) -> String {
    let x = column as f64 * (LEFT + WIDTH + 16.0) + LEFT;
    let y = row as f64 * (28.0 + HEIGHT + BELOW) + 28.0;
    format!(r#"<g transform="translate({x} {y})">"#)
}

/// A panel's frame, title, and the ends of its axes.
fn axes(title: &str, (x_label, x): (&str, (f64, f64)), (y_label, y): (&str, (f64, f64))) -> String {
    let mut svg = format!(r#"<rect class="b" width="{WIDTH}" height="{HEIGHT}"/>"#);
    let _ = write!(svg, r#"<text class="t" x="0" y="-8">{}</text>"#, escape(title));
    let ends = [(y.1, 10.0), (0.5 * (y.0 + y.1), 0.5 * HEIGHT + 4.0), (y.0, HEIGHT)];
    for (value, at) in ends {
        let _ = write!(svg, r#"<text class="e" x="-6" y="{at:.1}">{}</text>"#, tick(value));
    }
    if !x_label.is_empty() {
        for (class, value, at) in [("", x.0, 0.0), ("e", x.1, WIDTH)] {
            let y = HEIGHT + 16.0;
            let _ = write!(
                svg,
                r#"<text class="{class}" x="{at:.1}" y="{y:.1}">{}</text>"#,
                tick(value)
            );
        }
        let _ = write!(
            svg,
            r#"<text class="m" x="{:.1}" y="{:.1}">{}</text>"#,
            0.5 * WIDTH,
            HEIGHT + 32.0,
            escape(x_label)
        );
    }
    if !y_label.is_empty() {
        let y = 0.5 * HEIGHT;
        let _ = write!(
            svg,
            r#"<text class="m" transform="translate(-44 {y}) rotate(-90)">{}</text>"#,
            escape(y_label)
        );
    }
    svg
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
