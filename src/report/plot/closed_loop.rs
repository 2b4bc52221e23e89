//! What a loop found: the curve of an effect over what it explains, and what sites leave over before and after.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::super::ReportError;
use super::super::axes::{Axes, Axis, Scale, group, line};
use super::super::run_record::nan_if_null;
use super::super::text::{escape, shown};
use super::finished::Finished;
use super::font;
use super::palette::Palette;
use super::picture::{FONT, Picture, WIDTH};
use super::surface::{Block, picture, range};

/// The plot area of both pictures; left of it, above and below it.
const SIZE: [f64; 2] = [624.0, 260.0];
const LEFT: f64 = 66.0;
const ABOVE: f64 = 26.0;
const BELOW: f64 = 44.0;
const LEGEND: f64 = 22.0;
const CURVE: &str = "#d55e00";
const WITH: &str = "#0072b2";
/// Names of sites are written below the axis up to so many.
const MOST_NAMES: usize = 14;
/// The fits of a loop, the last model first.
const FITS: [&str; 3] = ["after", "before", "declared"];

/// What pictures need of `finding.json`.
#[derive(Debug, Deserialize)]
pub(super) struct Finding {
    #[serde(skip)]
    folder: PathBuf,
    findings: Vec<String>,
    effect_curve: Option<Effect>,
    residuals: Residuals,
}

#[derive(Debug, Deserialize)]
struct Effect {
    column: String,
    unit: String,
    labels: Vec<String>,
    points: Vec<Point>,
    rows: Vec<Left>,
}

#[derive(Debug, Deserialize)]
struct Point {
    x: f64,
    q5: f64,
    q50: f64,
    q95: f64,
}

#[derive(Debug, Deserialize)]
struct Left {
    #[serde(deserialize_with = "nan_if_null")]
    x: f64,
    #[serde(deserialize_with = "nan_if_null")]
    without: f64,
    #[serde(deserialize_with = "nan_if_null")]
    with: f64,
}

#[derive(Debug, Deserialize)]
struct Residuals {
    unit: String,
    sites: Vec<Site>,
}

#[derive(Debug, Deserialize)]
struct Site {
    #[serde(rename = "site")]
    name: String,
    at: Option<[f64; 3]>,
    #[serde(deserialize_with = "nan_if_null")]
    before: f64,
    #[serde(deserialize_with = "nan_if_null")]
    after: f64,
}

impl Finding {
    pub(super) fn read(folder: &Path) -> Result<Self, ReportError> {
        let path = folder.join("finding.json");
        let text = fs::read_to_string(&path).map_err(ReportError::read(&path))?;
        let finding: Self = serde_json::from_str(&text).map_err(|error| {
            let reason = error.to_string();
            ReportError::Malformed { path: path.clone(), reason }
        })?;
        Ok(Self { folder: folder.to_owned(), ..finding })
    }

    /// The curve of the first effect that was found, if it reads a column.
    pub(super) fn effects(&self) -> Vec<Picture> {
        self.effect_curve.iter().map(|effect| self.effect(effect)).collect()
    }

    fn effect(&self, effect: &Effect) -> Picture {
        let Effect { column, unit, labels, points, rows } = effect;
        let drawn: Vec<&Left> = rows.iter().filter(|row| row.x.is_finite()).collect();
        let x = drawn.iter().map(|row| row.x).chain(points.iter().map(|point| point.x));
        let x = if labels.is_empty() {
            Scale::around(x)
        } else {
            Scale::between(-0.5, labels.len() as f64 - 0.5)
        };
        let left = drawn.iter().flat_map(|row| [row.without, row.with]);
        let ends = points.iter().flat_map(|point| [point.q5, point.q95]);
        let y = Scale::around(left.chain(ends).filter(|value| value.is_finite()));
        let ticks = if labels.is_empty() {
            x.labelled()
        } else {
            labels
                .iter()
                .enumerate()
                .map(|(at, label)| (x.share(at as f64), label.clone()))
                .collect()
        };
        let y_label = in_unit("measured − predicted", unit);
        let axes = Axes {
            size: SIZE,
            title: "",
            x: Axis { label: column, ticks, has_lines: false },
            y: Axis { label: &y_label, ticks: y.labelled(), has_lines: true },
        };
        let place = |at: f64, value: f64| [SIZE[0] * x.share(at), SIZE[1] * (1.0 - y.share(value))];
        let mut svg = group(LEFT, ABOVE) + &axes.svg();
        let radius = 3.0 * (150.0 / drawn.len().max(1) as f64).sqrt().clamp(0.4, 1.0);
        for row in drawn {
            for (value, fill, stroke) in [(row.without, "none", "#888"), (row.with, WITH, "none")] {
                if value.is_finite() {
                    let [x, y] = place(row.x, value);
                    let _ = write!(
                        svg,
                        r#"<circle cx="{x:.1}" cy="{y:.1}" r="{radius:.1}" fill="{fill}" stroke="{stroke}"/>"#
                    );
                }
            }
        }
        // of labels, a stroke for each
        let strokes: Vec<Vec<(f64, &Point)>> = if labels.is_empty() {
            vec![points.iter().map(|point| (point.x, point)).collect()]
        } else {
            points
                .iter()
                .map(|point| vec![(point.x - 0.28, point), (point.x + 0.28, point)])
                .collect()
        };
        for stroke in strokes {
            let low = stroke.iter().map(|(at, point)| place(*at, point.q5));
            let high = stroke.iter().rev().map(|(at, point)| place(*at, point.q95));
            svg += &line(low.chain(high), &format!(r#"fill="{CURVE}" opacity=".2""#));
            let middle = stroke.iter().map(|(at, point)| place(*at, point.q50));
            let style = format!(r#"fill="none" stroke="{CURVE}" stroke-width="2""#);
            svg += &line(middle, &style);
        }
        svg += "</g>";
        let what = [
            (
                r##"<circle cx="5" r="3" fill="none" stroke="#888"/>"##.to_owned(),
                "without the effect",
            ),
            (format!(r#"<circle cx="5" r="3" fill="{WITH}"/>"#), "with it"),
            (
                format!(
                    r#"<rect y="-5" width="14" height="10" fill="{CURVE}" opacity=".2"/><path d="M0 0h14" stroke="{CURVE}" stroke-width="2"/>"#
                ),
                "the effect: median and 90 % interval",
            ),
        ];
        let name = self.findings.first().map_or(column.as_str(), String::as_str);
        let shows = format!("effect of {name}: its curve along {column}, and what it explains");
        let mut picture = Picture::new("effect", shows, ABOVE + SIZE[1] + BELOW + LEGEND);
        picture.draw(&svg);
        picture.draw(&legend(&what));
        picture
    }

    /// What each site leaves over before and after: in their order, and on the surface.
    pub(super) fn residuals(&self) -> Result<Vec<Picture>, ReportError> {
        if self.residuals.sites.is_empty() {
            return Ok(vec![]);
        }
        let mut pictures = vec![self.by_site()];
        pictures.extend(self.on_the_surface()?);
        Ok(pictures)
    }

    fn has_after(&self) -> bool {
        self.residuals.sites.iter().any(|site| site.after.is_finite())
    }

    fn by_site(&self) -> Picture {
        let Residuals { unit, sites } = &self.residuals;
        let n = sites.len();
        let x = |at: usize| SIZE[0] * (at as f64 + 0.5) / n as f64;
        let values = || sites.iter().flat_map(|site| [site.before, site.after]);
        let y = Scale::around(values().filter(|value| value.is_finite()).chain([0.0]));
        // names that have no room are left out
        let widest = sites.iter().map(|site| font::width(&site.name, FONT)).fold(0.0, f64::max);
        let has_names = n <= MOST_NAMES && widest < SIZE[0] / n as f64 - 4.0;
        let ticks = sites.iter().enumerate().filter(|_| has_names);
        let ticks = ticks.map(|(at, site)| (x(at) / SIZE[0], site.name.clone())).collect();
        let y_label = in_unit("measured − predicted", unit);
        let x_label =
            format!("{n} sites in the order of the table; each predicted from the others");
        let axes = Axes {
            size: SIZE,
            title: "",
            x: Axis { label: &x_label, ticks, has_lines: false },
            y: Axis { label: &y_label, ticks: y.labelled(), has_lines: true },
        };
        let mut svg = group(LEFT, ABOVE) + &axes.svg();
        let place = |value: f64| SIZE[1] * (1.0 - y.share(value));
        let _ = write!(svg, r##"<path d="M0 {:.1}H{}" stroke="#444"/>"##, place(0.0), SIZE[0]);
        for (at, site) in sites.iter().enumerate() {
            let x = x(at);
            if site.before.is_finite() && site.after.is_finite() {
                let (from, to) = (place(site.before), place(site.after));
                let _ = write!(svg, r##"<path d="M{x:.1} {from:.1}V{to:.1}" stroke="#bbb"/>"##);
            }
            for (value, fill, stroke) in
                [(site.before, "white", "#666"), (site.after, WITH, "none")]
            {
                if value.is_finite() {
                    let y = place(value);
                    let _ = write!(
                        svg,
                        r#"<circle cx="{x:.1}" cy="{y:.1}" r="3.2" fill="{fill}" stroke="{stroke}"/>"#
                    );
                }
            }
        }
        svg += "</g>";
        let mut what =
            vec![(r##"<circle cx="5" r="3.2" fill="white" stroke="#666"/>"##.to_owned(), "before")];
        if self.has_after() {
            what.push((format!(r#"<circle cx="5" r="3.2" fill="{WITH}"/>"#), "after"));
        }
        let shows = "what each site leaves over, before and after";
        let mut picture = Picture::new("residuals", shows, ABOVE + SIZE[1] + BELOW + LEGEND);
        picture.draw(&svg);
        picture.draw(&legend(&what));
        picture
    }

    /// On the surface of the last fit, if the model has one.
    fn on_the_surface(&self) -> Result<Option<Picture>, ReportError> {
        let fit = FITS.into_iter().map(|fit| self.folder.join(fit)).find(|fit| fit.is_dir());
        let Some(maps) = fit.map(|fit| Finished::read(&fit)?.maps()).transpose()?.flatten() else {
            return Ok(None);
        };
        let Residuals { unit, sites } = &self.residuals;
        let dots = |of: fn(&Site) -> f64| -> Vec<([f64; 3], f64)> {
            sites.iter().filter_map(|site| Some((site.at?, of(site)))).collect()
        };
        let all = [dots(|site| site.before), dots(|site| site.after)];
        let values: Vec<f64> = all.iter().flatten().map(|dot| dot.1).collect();
        let range = range(Palette::Difference, &[&values]);
        let n = if self.has_after() { 2 } else { 1 };
        let blocks: Vec<Block<'_>> = all
            .iter()
            .zip(["before", "after"])
            .take(n)
            .map(|(dots, when)| Block {
                title: format!(
                    "{} {when}",
                    in_unit("measured − predicted from the other sites", unit)
                ),
                unit: shown(unit).into(),
                values: None,
                palette: Palette::Difference,
                range,
                fades: None,
                lines: None,
                dots,
            })
            .collect();
        let shows = "what each site leaves over, before and after, on the surface";
        Ok(Some(picture("residuals_map", shows, &maps.ground, &blocks)))
    }
}

fn in_unit(what: &str, unit: &str) -> String {
    match shown(unit) {
        "" => what.to_owned(),
        unit => format!("{what} ({unit})"),
    }
}

/// Marks with what they are, below the plot.
fn legend(what: &[(String, &str)]) -> String {
    let (mut x, y) = (LEFT, ABOVE + SIZE[1] + BELOW + 10.0);
    let mut svg = String::new();
    for (mark, text) in what {
        let _ =
            write!(svg, r#"{}{mark}<text x="20" y="4">{}</text></g>"#, group(x, y), escape(text));
        x += 20.0 + font::width(text, FONT) + 22.0;
    }
    svg
}

/// The plot ends before the picture does.
const _: () = assert!(LEFT + SIZE[0] + 12.0 < WIDTH);
