//! Panels of lines with error bars against a categorical axis, as one SVG file.

use std::fmt::Write as _;

use super::svg::{COLOURS, escape};

/// Plot area of a panel, SVG units.
const WIDTH: f64 = 200.0;
const HEIGHT: f64 = 150.0;
/// Space left of, above and below it.
const LEFT: f64 = 46.0;
const TOP: f64 = 24.0;
const BELOW: f64 = 40.0;

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
        let columns = self.rows.iter().map(Vec::len).max().unwrap_or(0) as f64;
        let width = columns * (LEFT + WIDTH + 10.0) + 130.0;
        let height = self.rows.len() as f64 * (TOP + HEIGHT + BELOW);
        let mut svg = format!(
            r#"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" font-family="sans-serif" font-size="11"><rect width="100%" height="100%" fill="white"/>"#
        );
        for (r, row) in self.rows.iter().enumerate() {
            let top = row.iter().flat_map(|panel| panel.points.iter().flatten().flatten());
            let top = nice(top.map(|(mean, sd)| mean + zero_if_nan(*sd)).fold(0.0, f64::max));
            for (c, panel) in row.iter().enumerate() {
                let x = c as f64 * (LEFT + WIDTH + 10.0) + LEFT;
                let y = r as f64 * (TOP + HEIGHT + BELOW) + TOP;
                let _ = write!(svg, r#"<g transform="translate({x} {y})">"#);
                self.axes(&mut svg, panel, top, c == 0);
                self.points(&mut svg, panel, top);
                svg += "</g>";
            }
        }
        let _ = write!(svg, r#"<g transform="translate({} {TOP})">"#, width - 118.0);
        for (i, line) in self.lines.iter().enumerate() {
            let (y, colour) = (16.0 * i as f64, COLOURS[i % COLOURS.len()]);
            let _ = write!(
                svg,
                r#"<path d="M0 {y}h16" stroke="{colour}" stroke-width="2"/><text x="22" y="{}">{line}</text>"#,
                y + 4.0,
                line = escape(line)
            );
        }
        svg + "</g></svg>\n"
    }

    fn at(&self, tick: usize) -> f64 {
        WIDTH * (tick as f64 + 0.5) / self.x.len() as f64
    }

    fn axes(&self, svg: &mut String, panel: &Panel, top: f64, is_first: bool) {
        let _ = write!(
            svg,
            r##"<path d="M0 0V{HEIGHT}H{WIDTH}" fill="none" stroke="#444"/><text x="{}" y="-8" text-anchor="middle">{}</text>"##,
            WIDTH / 2.0,
            escape(&panel.title)
        );
        for k in 0..=4 {
            let (y, value) = (HEIGHT * (1.0 - f64::from(k) / 4.0), top * f64::from(k) / 4.0);
            let _ = write!(
                svg,
                r##"<path d="M0 {y}H{WIDTH}" stroke="#ddd"/><text x="-5" y="{}" text-anchor="end">{value}</text>"##,
                y + 4.0
            );
        }
        for (tick, label) in self.x.iter().enumerate() {
            let _ = write!(
                svg,
                r#"<text x="{:.1}" y="{}" text-anchor="middle">{label}</text>"#,
                self.at(tick),
                HEIGHT + 14.0
            );
        }
        let _ = write!(
            svg,
            r#"<text x="{}" y="{}" text-anchor="middle">{}</text>"#,
            WIDTH / 2.0,
            HEIGHT + 30.0,
            self.x_label
        );
        if is_first {
            let _ = write!(
                svg,
                r#"<text transform="translate(-34 {}) rotate(-90)" text-anchor="middle">{}</text>"#,
                HEIGHT / 2.0,
                escape(&panel.y_label)
            );
        }
    }

    fn points(&self, svg: &mut String, panel: &Panel, top: f64) {
        let y = |value: f64| HEIGHT * (1.0 - value / top);
        let n = panel.points.len();
        for (i, line) in panel.points.iter().enumerate() {
            // beside each other, so that bars do not hide bars
            let shift = 5.0 * (i as f64 - 0.5 * (n as f64 - 1.0));
            let colour = COLOURS[i % COLOURS.len()];
            let known: Vec<(f64, f64, f64)> = line
                .iter()
                .enumerate()
                .filter_map(|(tick, point)| point.map(|(m, sd)| (self.at(tick) + shift, m, sd)))
                .collect();
            let path: Vec<String> =
                known.iter().map(|(x, m, _)| format!("{x:.1} {:.1}", y(*m))).collect();
            let _ = write!(
                svg,
                r#"<path d="M{}" fill="none" stroke="{colour}" stroke-width="1.5"/>"#,
                path.join("L")
            );
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

/// The smallest of 1, 2, 4, 8, 10, 20, … that is not less, so that quarters are round.
fn nice(x: f64) -> f64 {
    if x <= 0.0 || !x.is_finite() {
        return 1.0;
    }
    let decade = 10f64.powf(x.log10().floor());
    let steps = [1.0, 2.0, 4.0, 8.0, 10.0].map(|step| step * decade);
    steps.into_iter().find(|step| *step >= x).unwrap_or(10.0 * decade)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_end_at_round_numbers() {
        let tops = [0.0, 0.8, 1.1, 4.0, 4.1, 9.0, 13.0, 41.0].map(|x| nice(x).to_string());
        assert_eq!(tops, ["1", "0.8", "2", "4", "8", "10", "20", "80"]);
    }

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
