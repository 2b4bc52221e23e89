//! A surrogate of both ERP over its inputs, and its error at every strip.

use std::fmt::Write as _;

use super::super::axes::{Axes, Axis, Scale, group};
use super::palette::{Colour, Palette, hex, mixed};
use super::picture::{PER_UNIT, Picture, WIDTH};
use super::png::Image;
use super::raster::bar;
use super::surface::range;
use crate::surrogate::inputs::{ERP_INPUTS, input_range};

/// Of a panel: size, left of it, above and below it.
const SIZE: [f64; 2] = [252.0, 220.0];
const LEFT: f64 = 60.0;
const ABOVE: f64 = 30.0;
const BELOW: f64 = 46.0;
const PITCH: f64 = 320.0;
const BAR: [f64; 2] = [14.0, 170.0];
/// Between neighbouring contours, ms.
const STEP: f64 = 10.0;
/// Share of black in a contour.
const LINE: f64 = 0.45;

/// One outcome: ERP_S2 or ERP_S3.
pub struct Surrogate<'a> {
    /// Name, e.g. `ERP_S2`.
    pub name: &'a str,
    /// From `tau_out` and `apd_max` (ms), ms; `None` where it is void.
    pub predict: &'a dyn Fn(f64, f64) -> Option<f64>,
    /// The strips it was fitted to: `tau_out`, `apd_max`, outcome, ms.
    pub strips: &'a [[f64; 3]],
}

impl std::fmt::Debug for Surrogate<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Surrogate").field("name", &self.name).finish_non_exhaustive()
    }
}

/// Values with contours (`surrogate_KIND`), and errors (`error_KIND`).
pub fn surrogates(kind: &str, both: &[Surrogate<'_>; 2]) -> [Picture; 2] {
    [values(kind, both), errors(kind, both)]
}

fn empty(name: String, shows: String) -> Picture {
    Picture::new(name, shows, ABOVE + SIZE[1] + BELOW)
}

/// Upper left corner of a panel.
fn corner(k: usize) -> [f64; 2] {
    [LEFT + k as f64 * PITCH, ABOVE]
}

/// The inputs at shares of a panel's width and height, from its lower left corner, ms.
fn inputs(shares: [f64; 2]) -> [f64; 2] {
    [0, 1].map(|k| {
        let (low, high) = input_range(ERP_INPUTS[k + 1]);
        low + shares[k] * (high - low)
    })
}

fn axes(title: &str) -> String {
    let ticks = |input| {
        let (low, high) = input_range(input);
        Scale::within(low, high, 7.0)
    };
    let x = Axis { label: "tau_out (ms)", ticks: ticks(ERP_INPUTS[1]), has_lines: false };
    let y = Axis { label: "apd_max (ms)", ticks: ticks(ERP_INPUTS[2]), has_lines: false };
    Axes { size: SIZE, title, x, y }.svg()
}

/// What both surrogates predict, with contours 10 ms apart; white where they are void.
fn values(kind: &str, both: &[Surrogate<'_>; 2]) -> Picture {
    let mut picture = empty(
        format!("surrogate_{kind}"),
        format!("{kind} surrogates of ERP_S2 and ERP_S3 over tau_out and apd_max"),
    );
    // one row and one column more than the panel has: a contour is where a neighbour is in another band
    let [width, height] = SIZE.map(|units| (units * PER_UNIT).round() as usize);
    let share = |at: usize, n: usize| (at as f64 + 0.5) / n as f64;
    let grids = both.each_ref().map(|one| {
        let rows = (0..=height).flat_map(|y| (0..=width).map(move |x| (x, y)));
        let predicted = rows.map(|(x, y)| {
            let [tau_out, apd_max] = inputs([share(x, width), 1.0 - share(y, height)]);
            (one.predict)(tau_out, apd_max).unwrap_or(f64::NAN)
        });
        predicted.collect::<Vec<f64>>()
    });
    let range = range(Palette::Values, &[&grids[0], &grids[1]]);
    for (k, (one, grid)) in both.iter().zip(&grids).enumerate() {
        let colour = |x: usize, y: usize| -> Colour {
            let [here, right, below] =
                [(x, y), (x + 1, y), (x, y + 1)].map(|(x, y)| grid[y * (width + 1) + x]);
            if here.is_nan() {
                return [255; 3];
            }
            let colour = Palette::Values.colour((here - range[0]) / (range[1] - range[0]));
            let band = (here / STEP).floor();
            let is_line = [right, below].iter().any(|v| ((v / STEP).floor() - band).abs() > 0.5);
            if is_line { mixed(colour, [0; 3], LINE) } else { colour }
        };
        let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let pixels = pixels.map(|(x, y)| colour(x, y)).collect();
        picture.place(corner(k), Image { width, height, pixels });
        let title = format!("{}: {kind} surrogate, contours {STEP} ms apart", one.name);
        picture.draw(&(group(corner(k)[0], corner(k)[1]) + &axes(&title) + "</g>"));
    }
    colour_bar(&mut picture, Palette::Values, range);
    picture
}

/// Surrogate − simulator at each strip.
fn errors(kind: &str, both: &[Surrogate<'_>; 2]) -> Picture {
    let mut picture = empty(
        format!("error_{kind}"),
        format!("errors of the {kind} surrogates at the strips that they were fitted to"),
    );
    let error =
        |one: &Surrogate<'_>, strip: &[f64; 3]| Some((one.predict)(strip[0], strip[1])? - strip[2]);
    let errors = both.each_ref().map(|one| {
        let known = one.strips.iter().filter_map(|strip| Some((*strip, error(one, strip)?)));
        known.collect::<Vec<_>>()
    });
    let all: Vec<f64> = errors.iter().flatten().map(|(_, error)| *error).collect();
    let [low, high] = range(Palette::Difference, &[&all]);
    let [[left, bottom], [right, top]] = [inputs([0.0; 2]), inputs([1.0; 2])];
    for (k, (one, errors)) in both.iter().zip(&errors).enumerate() {
        let n = errors.len().max(1) as f64;
        let rms = (errors.iter().map(|(_, error)| error * error).sum::<f64>() / n).sqrt();
        let title = format!("{}: surrogate − simulator, RMS {rms:.2} ms", one.name);
        let mut svg = group(corner(k)[0], corner(k)[1]) + &axes(&title);
        for ([tau_out, apd_max, _], error) in errors {
            let x = SIZE[0] * (tau_out - left) / (right - left);
            let y = SIZE[1] * (top - apd_max) / (top - bottom);
            let fill = hex(Palette::Difference.colour((error - low) / (high - low)));
            let _ = write!(
                svg,
                r##"<circle cx="{x:.1}" cy="{y:.1}" r="3.4" fill="{fill}" stroke="#333" stroke-width=".6"/>"##
            );
        }
        picture.draw(&(svg + "</g>"));
    }
    colour_bar(&mut picture, Palette::Difference, [low, high]);
    picture
}

/// One for both panels, right of them.
fn colour_bar(picture: &mut Picture, palette: Palette, [low, high]: [f64; 2]) {
    let [x, y] = [corner(1)[0] + SIZE[0] + 16.0, ABOVE + 24.0].map(f64::round);
    picture.place([x, y], bar(BAR, &|share, _| palette.colour(share)));
    let mut svg = group(x, y);
    let [width, height] = BAR;
    let _ = write!(
        svg,
        r##"<rect width="{width}" height="{height}" fill="none" stroke="#444" stroke-width=".7"/><text x="0" y="-8">ms</text>"##
    );
    for (share, label) in Scale::within(low, high, 7.0) {
        let y = height * (1.0 - share) + 4.0;
        let _ = write!(svg, r#"<text x="{}" y="{y:.1}">{label}</text>"#, width + 5.0);
    }
    picture.draw(&(svg + "</g>"));
}

/// The bar and its ticks end before the picture does.
const _: () = assert!(LEFT + PITCH + SIZE[0] + 16.0 + BAR[0] + 36.0 < WIDTH);
