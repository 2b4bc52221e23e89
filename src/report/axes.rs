//! The axes of every picture: from values to places, ticks, labels.
//!
//! Places are in SVG units from the upper left corner of the plot area, y downwards.

use std::fmt::Write as _;

use super::text::{escape, tick};

/// Okabe and Ito, distinguishable without red–green vision.
pub(super) const COLOURS: [&str; 8] =
    ["#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#7f6f00", "#000000"];
/// Ticks of an axis with round ends, at most.
const TICKS: f64 = 7.0;

/// The range of values along an axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scale {
    low: f64,
    high: f64,
    step: f64,
}

impl Scale {
    /// From `low` to `high`, with ticks at the ends and in the middle.
    pub(super) fn between(low: f64, high: f64) -> Self {
        let high = if high > low { high } else { low + 1.0 };
        Self { low, high, step: 0.5 * (high - low) }
    }

    /// Round numbers around all values; from 0 to 1 without two different ones.
    pub(super) fn around(values: impl Iterator<Item = f64>) -> Self {
        Self::rounded(values, TICKS)
    }

    /// The same with steps of at least this share of the range, `1 / steps`.
    pub(super) fn rounded(values: impl Iterator<Item = f64>, steps: f64) -> Self {
        let [low, high] =
            values.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], x| [a.min(x), b.max(x)]);
        let (low, high) = if low < high { (low, high) } else { (0.0, 1.0) };
        let rough = (high - low) / steps;
        let power = 10_f64.powf(rough.log10().floor());
        let round = [1.0, 2.0, 5.0, 10.0].into_iter().find(|r| r * power >= rough);
        let step = round.unwrap_or(10.0) * power;
        Self { low: (low / step).floor() * step, high: (high / step).ceil() * step, step }
    }

    /// From zero to the smallest of 1, 2, 4, 8, 10, 20, … that is not less than all values, in quarters.
    pub(super) fn from_zero(values: impl Iterator<Item = f64>) -> Self {
        let most = values.fold(0.0, f64::max);
        let high = if most > 0.0 && most.is_finite() {
            let decade = 10f64.powf(most.log10().floor());
            let steps = [1.0, 2.0, 4.0, 8.0, 10.0].map(|step| step * decade);
            steps.into_iter().find(|step| *step >= most).unwrap_or(10.0 * decade)
        } else {
            1.0
        };
        Self { low: 0.0, high, step: high / 4.0 }
    }

    /// How far along the axis a value is, from 0 to 1.
    pub(super) fn share(&self, value: f64) -> f64 {
        (value - self.low) / (self.high - self.low)
    }

    /// Round values from `low` to `high`, at least `1 / steps` of the range apart: how far along each is, from 0 to 1,
    /// and its text.
    pub(super) fn within(low: f64, high: f64, steps: f64) -> Vec<(f64, String)> {
        let round = Self::rounded([low, high].into_iter(), steps);
        let range = Self::between(low, high);
        let slack = 1e-9 * (high - low);
        let inside = round.ticks().filter(|value| *value >= low - slack && *value <= high + slack);
        inside.map(|value| (range.share(value), round.label(value))).collect()
    }

    /// Values with a tick.
    fn ticks(&self) -> impl Iterator<Item = f64> {
        let n = ((self.high - self.low) / self.step).round() as u32;
        (0..=n).map(|k| self.low + f64::from(k) * self.step)
    }

    /// A tick's value without digits that no tick needs.
    fn label(&self, value: f64) -> String {
        let decimals = (3.0 - self.step.abs().log10().floor()).max(0.0) as i32;
        if decimals > 7 {
            return tick(value);
        }
        let unit = 10f64.powi(decimals);
        // adding zero makes zero of minus zero
        ((value * unit).round() / unit + 0.0).to_string().replace('-', "−")
    }

    /// Ticks as an axis shows them.
    pub(super) fn labelled(&self) -> Vec<(f64, String)> {
        self.ticks().map(|value| (self.share(value), self.label(value))).collect()
    }
}

/// What is written along one axis.
#[derive(Clone, Debug, Default)]
pub(super) struct Axis<'a> {
    /// What it shows, with the unit; empty for none.
    pub(super) label: &'a str,
    /// Place along the axis, from 0 to 1, and text of each tick.
    pub(super) ticks: Vec<(f64, String)>,
    /// Whether a line crosses the plot at each tick.
    pub(super) has_lines: bool,
}

/// The frame of a plot with its axes.
#[derive(Clone, Debug)]
pub(super) struct Axes<'a> {
    /// Width and height of the plot area.
    pub(super) size: [f64; 2],
    /// Above the plot; empty for none.
    pub(super) title: &'a str,
    pub(super) x: Axis<'a>,
    pub(super) y: Axis<'a>,
}

impl Axes<'_> {
    /// Left of the plot area: the ticks and the label of the y axis.
    pub(super) const LEFT: f64 = 46.0;
    /// Below it: those of the x axis.
    pub(super) const BELOW: f64 = 40.0;
    /// Above it: the title.
    pub(super) const ABOVE: f64 = 24.0;

    /// The drawing, to be put before what is plotted.
    pub(super) fn svg(&self) -> String {
        let [width, height] = self.size;
        let mut svg = format!(r##"<path d="M0 0V{height}H{width}" fill="none" stroke="#444"/>"##);
        if !self.title.is_empty() {
            svg += &middle(&format!(r#"x="{}" y="-8""#, width / 2.0), self.title);
        }
        for (share, label) in &self.y.ticks {
            let y = short(height * (1.0 - share));
            if self.y.has_lines {
                let _ = write!(svg, r##"<path d="M0 {y}H{width}" stroke="#ddd"/>"##);
            }
            let label = escape(label);
            let _ = write!(svg, r#"<text x="-5" y="{}" text-anchor="end">{label}</text>"#, y + 4.0);
        }
        for (share, label) in &self.x.ticks {
            let x = width * share;
            if self.x.has_lines {
                let _ = write!(svg, r##"<path d="M{x:.1} 0V{height}" stroke="#ddd"/>"##);
            }
            svg += &middle(&format!(r#"x="{x:.1}" y="{}""#, height + 14.0), label);
        }
        if !self.x.label.is_empty() {
            svg += &middle(&format!(r#"x="{}" y="{}""#, width / 2.0, height + 30.0), self.x.label);
        }
        if !self.y.label.is_empty() {
            // beyond the longest tick
            let longest = self.y.ticks.iter().map(|(_, label)| label.chars().count()).max();
            let left = (7.0 * longest.unwrap_or(0) as f64 + 9.0).max(34.0);
            let place = format!(r#"transform="translate(-{left} {}) rotate(-90)""#, height / 2.0);
            svg += &middle(&place, self.y.label);
        }
        svg
    }
}

/// A text that is centred on its place.
fn middle(place: &str, text: &str) -> String {
    format!(r#"<text {place} text-anchor="middle">{}</text>"#, escape(text))
}

/// To a tenth of a unit.
fn short(place: f64) -> f64 {
    (10.0 * place).round() / 10.0
}

/// The opening of a file that stands on its own, as white as paper.
pub(super) fn open(width: f64, height: f64, font_size: u32) -> String {
    format!(
        r#"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" font-family="sans-serif" font-size="{font_size}"><rect width="100%" height="100%" fill="white"/>"#
    )
}

/// The opening of a group whose origin is here.
pub(super) fn group(x: f64, y: f64) -> String {
    format!(r#"<g transform="translate({x} {y})">"#)
}

/// A line through `places`; empty without one.
pub(super) fn line(places: impl Iterator<Item = [f64; 2]>, style: &str) -> String {
    let places: Vec<String> = places.map(|[x, y]| format!("{x:.1} {y:.1}")).collect();
    if places.is_empty() {
        return String::new();
    }
    format!(r#"<path d="M{}" {style}/>"#, places.join("L"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(scale: Scale) -> Vec<String> {
        scale.labelled().into_iter().map(|(_, label)| label).collect()
    }

    #[test]
    fn ticks_are_round_and_hold_all_points() {
        let scale = Scale::around([187.0, 233.4].into_iter());
        assert_eq!(labels(scale), ["180", "190", "200", "210", "220", "230", "240"]);
        let small = Scale::around([0.03, 0.98].into_iter());
        assert_eq!(labels(small), ["0", "0.2", "0.4", "0.6", "0.8", "1"]);
        assert_eq!(labels(Scale::around([-0.3, 0.3].into_iter()))[2..4], ["−0.1", "0"]);
        let inside = Scale::within(187.0, 233.4, 7.0);
        assert_eq!(
            inside.iter().map(|tick| &tick.1[..]).collect::<Vec<_>>(),
            ["190", "200", "210", "220", "230"]
        );
        assert!((inside[0].0 - 3.0 / 46.4).abs() < 1e-12);
    }

    #[test]
    fn axes_from_zero_end_at_round_numbers() {
        let top = |x: f64| labels(Scale::from_zero([x].into_iter())).pop().unwrap();
        let tops = [0.0, 0.8, 1.1, 4.0, 4.1, 9.0, 13.0, 41.0].map(top);
        assert_eq!(tops, ["1", "0.8", "2", "4", "8", "10", "20", "80"]);
        assert_eq!(labels(Scale::from_zero([0.7].into_iter())), ["0", "0.2", "0.4", "0.6", "0.8"]);
    }
}
