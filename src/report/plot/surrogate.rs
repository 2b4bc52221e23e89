//! A surrogate of both ERP over its inputs, and its error at every strip.

use std::fmt::Write as _;

use super::super::axes::{Axes, Axis, Scale, group};
use super::super::figures::contour_panels;
use super::palette::{Palette, hex};
use super::picture::{Picture, WIDTH};
use super::raster::bar;
use super::surface::range;
use crate::surrogate::inputs::{ERP_INPUTS, input_range};

/// Of a panel of errors: size, left of it, above and below it.
const SIZE: [f64; 2] = [252.0, 220.0];
const LEFT: f64 = 60.0;
const ABOVE: f64 = 30.0;
const BELOW: f64 = 46.0;
const PITCH: f64 = 320.0;
const BAR: [f64; 2] = [14.0, 170.0];

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

/// Contours (`surrogate_KIND`) and errors (`error_KIND`).
pub fn surrogates(kind: &str, both: &[Surrogate<'_>; 2]) -> [Picture; 2] {
    let titles = both.each_ref().map(|one| format!("{} (ms), {kind}", one.name));
    let panels = [(titles[0].as_str(), both[0].predict), (titles[1].as_str(), both[1].predict)];
    let (size, drawing) = contour_panels(&panels);
    let contours = Picture::of(
        format!("surrogate_{kind}"),
        format!("{kind} surrogates of ERP_S2 and ERP_S3 over tau_out and apd_max"),
        size,
        drawing,
    );
    [contours, errors(kind, both)]
}

/// Surrogate − simulator at each strip.
fn errors(kind: &str, both: &[Surrogate<'_>; 2]) -> Picture {
    let mut picture = Picture::new(
        format!("error_{kind}"),
        format!("errors of the {kind} surrogates at the strips that they were fitted to"),
        ABOVE + SIZE[1] + BELOW,
    );
    let error = |one: &Surrogate<'_>, strip: &[f64; 3]| Some((one.predict)(strip[0], strip[1])? - strip[2]);
    let errors = both.each_ref().map(|one| {
        let known = one.strips.iter().filter_map(|strip| Some((*strip, error(one, strip)?)));
        known.collect::<Vec<_>>()
    });
    let all: Vec<f64> = errors.iter().flatten().map(|(_, error)| *error).collect();
    let [low, high] = range(Palette::Difference, &[&all]);
    let share = |error: f64| (error - low) / (high - low);
    let scales = [ERP_INPUTS[1], ERP_INPUTS[2]].map(|input| {
        let (low, high) = input_range(input);
        Scale::rounded([low, high].into_iter(), 6.0)
    });
    for (k, (one, errors)) in both.iter().zip(&errors).enumerate() {
        let n = errors.len().max(1) as f64;
        let rms = (errors.iter().map(|(_, error)| error * error).sum::<f64>() / n).sqrt();
        let title = format!("{}: surrogate − simulator, RMS {rms:.2} ms", one.name);
        let axes = Axes {
            size: SIZE,
            title: &title,
            x: Axis { label: "tau_out (ms)", ticks: scales[0].labelled(), has_lines: true },
            y: Axis { label: "apd_max (ms)", ticks: scales[1].labelled(), has_lines: true },
        };
        let mut svg = group(LEFT + k as f64 * PITCH, ABOVE) + &axes.svg();
        for ([tau_out, apd_max, _], error) in errors {
            let (x, y) = (SIZE[0] * scales[0].share(*tau_out), SIZE[1] * (1.0 - scales[1].share(*apd_max)));
            let _ = write!(
                svg,
                r##"<circle cx="{x:.1}" cy="{y:.1}" r="3.4" fill="{}" stroke="#333" stroke-width=".6"/>"##,
                hex(Palette::Difference.colour(share(*error)))
            );
        }
        picture.draw(&(svg + "</g>"));
    }
    let [x, y] = [LEFT + PITCH + SIZE[0] + 16.0, ABOVE + 24.0].map(f64::round);
    picture.place([x, y], bar(BAR, &|share, _| Palette::Difference.colour(share)));
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
    picture
}

/// The bar and its ticks end before the picture does.
const _: () = assert!(LEFT + PITCH + SIZE[0] + 16.0 + BAR[0] + 36.0 < WIDTH);
