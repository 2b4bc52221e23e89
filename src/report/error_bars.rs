//! Panels of lines with error bars against a categorical axis, as one SVG file.

use std::fmt::Write as _;

use super::axes::{self, Axes, Axis, COLOURS, Scale};
use super::text::escape;

/// Plot area of a panel, SVG units.
const SIZE: [f64; 2] = [200.0, 150.0];
/// From panel to panel.
const PITCH: [f64; 2] = [Axes::LEFT + SIZE[0] + 10.0, Axes::ABOVE + SIZE[1] + Axes::BELOW];
/// Room for the names of the lines.
const LEGEND: f64 = 130.0;

/// A grid of panels that share their axes.
#[derive(Clone, Debug)]
pub struct ErrorBars {
    /// What the horizontal axis counts.
    pub x_label: String,
    /// Its ticks, evenly spaced.
    pub x: Vec<String>,
    /// What the colours are, by line.
    pub lines: Vec<String>,
    /// Rows of panels, from the top.
    pub rows: Vec<Vec<Panel>>,
}

/// One panel.
#[derive(Clone, Debug)]
pub struct Panel {
    /// Above it.
    pub title: String,
    /// Left of it, if it is the first of its row.
    pub y_label: String,
    /// Mean and standard deviation, by line and tick; `None` where there is nothing.
    pub points: Vec<Vec<Option<(f64, f64)>>>,
}

impl ErrorBars {
    /// The whole file.
    pub fn svg(&self) -> String {
        let ([width, height], drawing) = self.drawing();
        axes::open(width, height, 11) + &drawing + "</svg>\n"
    }

    /// Its size, and what is in it; of font size 11.
    pub(super) fn drawing(&self) -> ([f64; 2], String) {
        let columns = self.rows.iter().map(Vec::len).max().unwrap_or(0) as f64;
        let width = columns * PITCH[0] + LEGEND;
        let height = self.rows.len() as f64 * PITCH[1];
        let mut svg = String::new();
        for (r, row) in self.rows.iter().enumerate() {
            let points = row.iter().flat_map(|panel| panel.points.iter().flatten().flatten());
            let scale = Scale::from_zero(points.map(|(mean, sd)| mean + zero_if_nan(*sd)));
            for (c, panel) in row.iter().enumerate() {
                let (x, y) = (c as f64 * PITCH[0], r as f64 * PITCH[1]);
                svg += &axes::group(x + Axes::LEFT, y + Axes::ABOVE);
                svg += &self.axes(panel, scale, c == 0).svg();
                self.points(&mut svg, panel, scale);
                svg += "</g>";
            }
        }
        svg += &axes::group(width - LEGEND + 12.0, Axes::ABOVE);
        for (i, line) in self.lines.iter().enumerate() {
            let (y, colour) = (16.0 * i as f64, COLOURS[i % COLOURS.len()]);
            let _ = write!(
                svg,
                r#"<path d="M0 {y}h16" stroke="{colour}" stroke-width="2"/><text x="22" y="{}">{line}</text>"#,
                y + 4.0,
                line = escape(line)
            );
        }
        ([width, height], svg + "</g>")
    }

    /// Place of a tick along the horizontal axis.
    fn share(&self, tick: usize) -> f64 {
        (tick as f64 + 0.5) / self.x.len() as f64
    }

    fn axes<'a>(&'a self, panel: &'a Panel, scale: Scale, is_first: bool) -> Axes<'a> {
        let ticks = self.x.iter().enumerate();
        let ticks = ticks.map(|(tick, label)| (self.share(tick), label.clone())).collect();
        let label = if is_first { panel.y_label.as_str() } else { "" };
        Axes {
            size: SIZE,
            title: &panel.title,
            x: Axis { label: &self.x_label, ticks, has_lines: false },
            y: Axis { label, ticks: scale.labelled(), has_lines: true },
        }
    }

    fn points(&self, svg: &mut String, panel: &Panel, scale: Scale) {
        let y = |value: f64| SIZE[1] * (1.0 - scale.share(value));
        let n = panel.points.len();
        for (i, line) in panel.points.iter().enumerate() {
            // beside each other, so that bars do not hide bars
            let shift = 5.0 * (i as f64 - 0.5 * (n as f64 - 1.0));
            let colour = COLOURS[i % COLOURS.len()];
            let place = |tick| SIZE[0] * self.share(tick) + shift;
            let known: Vec<(f64, f64, f64)> = line
                .iter()
                .enumerate()
                .filter_map(|(tick, point)| point.map(|(m, sd)| (place(tick), m, sd)))
                .collect();
            let places = known.iter().map(|(x, m, _)| [*x, y(*m)]);
            let style = format!(r#"fill="none" stroke="{colour}" stroke-width="1.5""#);
            *svg += &axes::line(places, &style);
            for (x, m, sd) in known {
                let sd = zero_if_nan(sd);
                let (low, high) = (y((m - sd).max(0.0)), y(m + sd));
                let _ = write!(
                    svg,
                    r#"<path d="M{x:.1} {low:.1}V{high:.1}" stroke="{colour}"/><circle cx="{x:.1}" cy="{:.1}" r="2.5" fill="{colour}"><title>{m:.2} ± {sd:.2}</title></circle>"#,
                    y(m)
                );
            }
        }
    }
}

/// Of one case there is no deviation.
fn zero_if_nan(x: f64) -> f64 {
    if x.is_nan() { 0.0 } else { x }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_point_is_drawn_and_the_file_is_well_formed() {
        let points = vec![vec![Some((1.0, 0.5)), None, Some((2.0, f64::NAN))]];
        let panel = Panel { title: "10 ms".into(), y_label: "RMSE, ms".into(), points };
        let figure = ErrorBars {
            x_label: "sites".into(),
            x: ["5", "10", "20"].map(str::to_owned).into(),
            lines: vec!["a & b, 64 mm".into()],
            rows: vec![vec![panel]],
        };
        let svg = figure.svg();
        let document = roxmltree::Document::parse(&svg).unwrap();
        let circles = document.descendants().filter(|node| node.has_tag_name("circle"));
        assert_eq!(circles.count(), 2);
        assert!(!svg.contains("NaN"));
    }
}
