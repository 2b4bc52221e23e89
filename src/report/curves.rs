//! Curves over an axis as a standalone SVG file.

use std::fmt::Write as _;
use std::path::Path;

use super::ReportError;
use super::axes::{self, Axes, Axis, COLOURS, Scale};
use super::text::escape;
use crate::store::write_file;

/// Plot area, SVG units.
const SIZE: [f64; 2] = [560.0, 300.0];
/// Room right of it for the names of the curves, and above it.
const LEGEND: f64 = 120.0;
const TOP: f64 = 16.0;

/// Curves that share their axes.
#[derive(Clone, Debug)]
pub struct Curves<'a> {
    /// What the horizontal axis shows, with its unit.
    pub x: &'a str,
    /// What the vertical axis shows, with its unit.
    pub y: &'a str,
    /// Name and points (x, y) of each; points that are no numbers are left out.
    pub curves: &'a [(&'a str, Vec<[f64; 2]>)],
    /// Whether points have marks.
    pub marks: bool,
}

impl Curves<'_> {
    /// Writes the file.
    ///
    /// # Errors
    /// [`ReportError::Write`].
    pub fn write(&self, path: &Path) -> Result<(), ReportError> {
        use std::io::Write as _;
        write_file(path, |file| file.write_all(self.svg().as_bytes()))
            .map_err(ReportError::write(path))
    }

    /// The drawing.
    pub fn svg(&self) -> String {
        let [x, y] = [0, 1].map(|k| Scale::around(self.points().map(|p| p[k])));
        let [width, height] = SIZE;
        let place = |p: &[f64; 2]| [width * x.share(p[0]), height * (1.0 - y.share(p[1]))];
        let mut svg = axes::open(Axes::LEFT + width + LEGEND, TOP + height + Axes::BELOW, 12);
        svg += &axes::group(Axes::LEFT, TOP);
        let frame = Axes {
            size: SIZE,
            title: "",
            x: Axis { label: self.x, ticks: x.labelled(), has_lines: true },
            y: Axis { label: self.y, ticks: y.labelled(), has_lines: true },
        };
        svg += &frame.svg();
        for (k, (name, points)) in self.curves.iter().enumerate() {
            let colour = COLOURS[k % COLOURS.len()];
            let places = || points.iter().filter(|p| is_finite(p)).map(place);
            let style = format!(r#"fill="none" stroke="{colour}" stroke-width="1.5""#);
            svg += &axes::line(places(), &style);
            for [x, y] in places().filter(|_| self.marks) {
                let _ = write!(svg, r#"<circle cx="{x:.1}" cy="{y:.1}" r="3" fill="{colour}"/>"#);
            }
            let (at, name) = (14.0 + 18.0 * k as f64, escape(name));
            let _ =
                write!(svg, r#"<text x="{}" y="{at}" fill="{colour}">{name}</text>"#, width + 10.0);
        }
        svg + "</g></svg>\n"
    }

    fn points(&self) -> impl Iterator<Item = &[f64; 2]> {
        self.curves.iter().flat_map(|(_, points)| points).filter(|p| is_finite(p))
    }
}

fn is_finite(point: &[f64; 2]) -> bool {
    point.iter().all(|x| x.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_is_drawn_where_it_has_values() {
        let points = vec![[0.0, 0.0], [1.0, f64::NAN], [10.0, 5.0]];
        let curves = [("a < b", points)];
        let svg = Curves { x: "x (ms)", y: "y", curves: &curves, marks: true }.svg();
        assert!(svg.contains("<path d=\"M0.0 300.0L560.0 0.0\" fill=\"none\""), "{svg}");
        assert!(svg.contains("a &lt; b") && svg.matches("<circle").count() == 2, "{svg}");
        let empty = Curves { x: "", y: "", curves: &[("none", vec![])], marks: false }.svg();
        assert!(!empty.contains("NaN") && !empty.contains("inf"), "{empty}");
    }
}
