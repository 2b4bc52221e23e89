//! Predicted against measured, a panel for each statement.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use super::super::axes::{Axes, Axis, Scale, group};
use super::super::predicted::{places, width, worst};
use super::super::rows::PredictedRow;
use super::super::text::shown;
use super::picture::{Picture, WIDTH};

/// Panels in a row, and rows in a picture.
const COLUMNS: usize = 3;
const ROWS: usize = 3;
/// Left of a panel; above and below it.
const LEFT: f64 = 60.0;
const ABOVE: f64 = 28.0;
const BELOW: f64 = 44.0;
const LEGEND: f64 = 26.0;
/// Of a panel that stands alone.
const MOST_SIDE: f64 = 330.0;
/// Most rows outside whose line of the table is written beside them.
const MOST_LABELS: usize = 6;
const FAR: &str = "#d55e00";
const NEAR: &str = "#0072b2";

/// The pictures of all rows: one, or with many statements several.
pub(super) fn pictures(rows: &[PredictedRow]) -> Vec<Picture> {
    let panels: Vec<&[PredictedRow]> = rows.chunk_by(|a, b| a.protocol == b.protocol).collect();
    let pages: Vec<_> = panels.chunks(COLUMNS * ROWS).collect();
    let many = pages.len() > 1;
    let page = |(number, panels): (usize, &&[&[PredictedRow]])| {
        let name = if many { format!("predicted_{}", number + 1) } else { "predicted".into() };
        picture(name, panels)
    };
    pages.iter().enumerate().map(page).collect()
}

fn picture(name: String, panels: &[&[PredictedRow]]) -> Picture {
    let columns = panels.len().min(COLUMNS);
    let pitch = WIDTH / columns as f64;
    let side = (pitch - LEFT - 14.0).min(MOST_SIDE).floor();
    let rows = panels.len().div_ceil(columns);
    let height = rows as f64 * (ABOVE + side + BELOW) + LEGEND;
    let statements: Vec<&str> = panels.iter().map(|rows| rows[0].protocol.as_str()).collect();
    let shows = format!("predicted against measured: {}", statements.join(", "));
    let mut picture = Picture::new(name, shows, height);
    for (number, rows) in panels.iter().enumerate() {
        let (column, row) = (number % columns, number / columns);
        // a panel that is narrower than its column is in its middle
        let x = column as f64 * pitch + LEFT + 0.5 * (pitch - LEFT - 14.0 - side);
        let y = row as f64 * (ABOVE + side + BELOW) + ABOVE;
        picture.draw(&(group(x, y) + &panel(rows, side) + "</g>"));
    }
    let all: Vec<&PredictedRow> = panels.iter().copied().flatten().collect();
    picture.draw(&legend(&all, height - 9.0));
    picture
}

fn panel(rows: &[PredictedRow], side: f64) -> String {
    let ends = |row: &PredictedRow| {
        let [q5, _, q95] = row.fitted.quantiles;
        [row.measured[0], row.measured[1], q5, q95]
    };
    let scale = Scale::rounded(rows.iter().flat_map(ends).filter(|x| x.is_finite()), side / 45.0);
    let in_unit = |what: &str| match shown(&rows[0].unit) {
        "" => what.to_owned(),
        unit => format!("{what} ({unit})"),
    };
    let (x, y) = (in_unit("measured"), in_unit("predicted"));
    let axis = |label| Axis { label, ticks: scale.labelled(), has_lines: false };
    let axes = Axes { size: [side; 2], title: &rows[0].protocol, x: axis(&x), y: axis(&y) };
    let mut svg = axes.svg();
    svg += &brackets(rows, &scale, side);
    let _ = write!(
        svg,
        r##"<path d="M0 {side}L{side} 0" stroke="#888" stroke-dasharray="4 3" fill="none"/>"##
    );
    svg + &marks(rows, &scale, side)
}

/// A square on the line of identity for each bracket.
fn brackets(rows: &[PredictedRow], scale: &Scale, side: f64) -> String {
    let closed = rows.iter().filter(|row| width(row) > 0.0);
    let distinct: BTreeSet<[u64; 2]> = closed.map(|row| row.measured.map(f64::to_bits)).collect();
    let square = |ends: &[u64; 2]| {
        let [from, to] = ends.map(|bits| side * scale.share(f64::from_bits(bits)));
        let (top, size) = (side - to, to - from);
        format!(
            r##"<rect x="{from:.1}" y="{top:.1}" width="{size:.1}" height="{size:.1}" fill="#e6e9ec"/>"##
        )
    };
    distinct.iter().map(square).collect()
}

/// An interval and a dot for each row, those outside on top.
fn marks(rows: &[PredictedRow], scale: &Scale, side: f64) -> String {
    let at = |value: f64| side * scale.share(value);
    let named: BTreeSet<u64> = worst(rows).iter().take(MOST_LABELS).map(|row| row.line).collect();
    // many dots cover no more than a few
    let radius = 2.6 * (80.0 / rows.len() as f64).sqrt().clamp(0.35, 1.0);
    let [mut near, mut far] = [const { String::new() }; 2];
    for (row, x) in rows.iter().zip(places(rows)) {
        let [q5, q50, q95] = row.fitted.quantiles;
        if ![q5, q95, x].iter().all(|x| x.is_finite()) {
            continue;
        }
        let is_inside = row.fitted.is_inside();
        let (svg, colour) = if is_inside { (&mut near, NEAR) } else { (&mut far, FAR) };
        let [x, bottom, y, top] = [at(x), side - at(q5), side - at(q50), side - at(q95)];
        let _ = write!(
            svg,
            r#"<path d="M{x:.1} {bottom:.1}V{top:.1}" stroke="{colour}" stroke-width="{:.1}"/><circle cx="{x:.1}" cy="{y:.1}" r="{radius:.1}" fill="{colour}"/>"#,
            0.5 * radius
        );
        if named.contains(&row.line) {
            // on the side of the panel's middle
            let (dx, anchor) = if x > 0.8 * side { (-5.0, "end") } else { (5.0, "start") };
            let _ = write!(
                svg,
                r#"<text x="{:.1}" y="{:.1}" font-size="9" fill="{FAR}" text-anchor="{anchor}">{}</text>"#,
                x + dx,
                y + 3.0,
                row.line
            );
        }
    }
    near + &far
}

/// What the marks are.
fn legend(rows: &[&PredictedRow], y: f64) -> String {
    let n_outside = rows.iter().filter(|row| !row.fitted.is_inside()).count();
    let bracket = if rows.iter().any(|row| width(row) > 0.0) { "; grey: brackets" } else { "" };
    let lines = if n_outside > 0 { ", with their line in the table" } else { "" };
    let fill = if n_outside > 0 { FAR } else { "#000" };
    let mut svg =
        format!(r#"<text x="20" y="{y}">Median and central 90 % interval{bracket}.</text>"#);
    let _ = write!(
        svg,
        r#"<text x="{}" y="{y}" text-anchor="end" fill="{fill}">{n_outside} of {} rows lie outside{lines}.</text>"#,
        WIDTH - 12.0,
        rows.len()
    );
    svg
}

/// Above and left of a panel there is room for what its axes write.
const _: () = assert!(ABOVE > Axes::ABOVE && BELOW > Axes::BELOW && LEFT > Axes::LEFT);
