//! Curves over an axis as a standalone SVG file.

use std::fmt::Write as _;
use std::path::Path;

use super::ReportError;
use super::svg::{escape, tick};
use crate::store::write_file;

/// Okabe and Ito, distinguishable without red–green vision.
const COLOURS: [&str; 5] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#000000"];
/// Plot area, and the room around it for labels, in SVG units.
const AREA: [f64; 2] = [560.0, 300.0];
const MARGIN: [f64; 4] = [62.0, 16.0, 120.0, 44.0];
/// Ticks of an axis, at most.
const TICKS: f64 = 7.0;

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
        let [x, y] = [0, 1].map(|k| Axis::of(self.points().map(|p| p[k])));
        let [left, top, right, bottom] = MARGIN;
        let [width, height] = AREA;
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"{} {} {} {}\" font-family=\"sans-serif\" font-size=\"12\">\n",
            -left,
            -top,
            left + width + right,
            top + height + bottom
        );
        let _ = writeln!(
            svg,
            "<rect x=\"{}\" y=\"{}\" width=\"100%\" height=\"100%\" fill=\"#fff\"/>",
            -left, -top
        );
        let place = |p: &[f64; 2]| [width * x.share(p[0]), height * (1.0 - y.share(p[1]))];
        for at in x.ticks() {
            let px = width * x.share(at);
            let _ = writeln!(
                svg,
                "<path d=\"M{px:.1} 0V{height}\" stroke=\"#ddd\"/><text x=\"{px:.1}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
                height + 16.0,
                x.label(at)
            );
        }
        for at in y.ticks() {
            let py = height * (1.0 - y.share(at));
            let _ = writeln!(
                svg,
                "<path d=\"M0 {py:.1}H{width}\" stroke=\"#ddd\"/><text x=\"-6\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
                py + 4.0,
                y.label(at)
            );
        }
        let _ = writeln!(
            svg,
            "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
            width / 2.0,
            height + 36.0,
            escape(self.x)
        );
        let _ = writeln!(
            svg,
            "<text transform=\"translate(-46 {}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
            height / 2.0,
            escape(self.y)
        );
        for (k, (name, points)) in self.curves.iter().enumerate() {
            let colour = COLOURS[k % COLOURS.len()];
            let places: Vec<[f64; 2]> = points.iter().filter(|p| is_finite(p)).map(place).collect();
            let path: Vec<String> = places.iter().map(|[x, y]| format!("{x:.1} {y:.1}")).collect();
            if !path.is_empty() {
                let _ = writeln!(
                    svg,
                    "<path d=\"M{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.5\"/>",
                    path.join("L")
                );
            }
            for [x, y] in places.iter().filter(|_| self.marks) {
                let _ = writeln!(
                    svg,
                    "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3\" fill=\"{colour}\"/>"
                );
            }
            let _ = writeln!(
                svg,
                "<text x=\"{}\" y=\"{}\" fill=\"{colour}\">{}</text>",
                width + 10.0,
                14.0 + 18.0 * k as f64,
                escape(name)
            );
        }
        svg + "</svg>\n"
    }

    fn points(&self) -> impl Iterator<Item = &[f64; 2]> {
        self.curves.iter().flat_map(|(_, points)| points).filter(|p| is_finite(p))
    }
}

fn is_finite(point: &[f64; 2]) -> bool {
    point.iter().all(|x| x.is_finite())
}

/// A range with round ends.
struct Axis {
    low: f64,
    high: f64,
    step: f64,
}

impl Axis {
    fn of(values: impl Iterator<Item = f64>) -> Self {
        let [low, high] =
            values.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], x| [a.min(x), b.max(x)]);
        let (low, high) = if low < high { (low, high) } else { (0.0, 1.0) };
        let rough = (high - low) / TICKS;
        let power = 10_f64.powf(rough.log10().floor());
        let round = [1.0, 2.0, 5.0, 10.0].into_iter().find(|r| r * power >= rough);
        let step = round.unwrap_or(10.0) * power;
        Self { low: (low / step).floor() * step, high: (high / step).ceil() * step, step }
    }

    fn share(&self, x: f64) -> f64 {
        (x - self.low) / (self.high - self.low)
    }

    fn ticks(&self) -> impl Iterator<Item = f64> {
        let n = ((self.high - self.low) / self.step).round() as u32;
        (0..=n).map(|k| self.low + f64::from(k) * self.step)
    }

    /// Without digits that no tick needs.
    fn label(&self, x: f64) -> String {
        let decimals = (-self.step.log10().floor()).max(0.0) as usize;
        if decimals > 4 { tick(x) } else { format!("{x:.decimals$}") }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_hold_all_points() {
        let axis = Axis::of([187.0, 233.4].into_iter());
        let labels: Vec<String> = axis.ticks().map(|x| axis.label(x)).collect();
        assert_eq!(labels, ["180", "190", "200", "210", "220", "230", "240"]);
        let small = Axis::of([0.03, 0.98].into_iter());
        assert_eq!(small.label(small.low) + &small.label(small.high), "0.01.0");
    }

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
