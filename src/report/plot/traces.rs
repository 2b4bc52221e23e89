//! Draws of every scalar parameter against their index, and their ranks by chain.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use super::super::Row;
use super::super::axes::{Axes, Axis, COLOURS, Scale, group, line};
use super::super::svg::{RANK_BINS, envelope, rank_counts};
use super::super::text::{escape, shown};
use super::picture::{Picture, WIDTH};

/// Parameters in a picture.
const PER_PICTURE: usize = 10;
/// Of a parameter's plots: height, from one to the next, above the first, below the last.
const HEIGHT: f64 = 50.0;
const PITCH: f64 = 76.0;
const ABOVE: f64 = 22.0;
const BELOW: f64 = 38.0;
/// Left of the traces; their width; left of the ranks; their width.
const LEFT: f64 = 66.0;
const TRACE: f64 = 430.0;
const RANKS: f64 = 538.0;
const RANK: f64 = 160.0;
/// A trace is drawn as the range of its values in this many bins, each narrower than its line.
const BINS: usize = 800;

/// A parameter's draws by chain.
#[derive(Clone, Debug)]
pub(super) struct Scalar {
    pub(super) name: String,
    pub(super) chains: Vec<Vec<f64>>,
}

/// The pictures: ten parameters in each.
pub(super) fn pictures(scalars: &[Scalar], rows: &[Row]) -> Vec<Picture> {
    let summaries: BTreeMap<&str, &Row> = rows.iter().map(|row| (row.name.as_str(), row)).collect();
    let is_drawn = |scalar: &&Scalar| scalar.chains.iter().flatten().any(|x| x.is_finite());
    let drawn: Vec<&Scalar> = scalars.iter().filter(is_drawn).collect();
    let n = drawn.len().div_ceil(PER_PICTURE);
    let page = |(number, scalars): (usize, &[&Scalar])| {
        let name = if n > 1 { format!("traces_{}", number + 1) } else { "traces".into() };
        let names: Vec<&str> = scalars.iter().map(|scalar| scalar.name.as_str()).collect();
        let shows = format!("traces and ranks by chain: {}", names.join(", "));
        let last = scalars.len() - 1;
        let height = ABOVE + last as f64 * PITCH + HEIGHT + BELOW;
        let mut picture = Picture::new(name, shows, height);
        for (k, scalar) in scalars.iter().enumerate() {
            let y = ABOVE + k as f64 * PITCH;
            let row = summaries.get(scalar.name.as_str()).copied();
            picture.draw(&(group(LEFT, y) + &trace(scalar, row, k == last) + "</g>"));
            picture.draw(&(group(RANKS, y) + &ranks(scalar, k == last) + "</g>"));
        }
        picture
    };
    drawn.chunks(PER_PICTURE).enumerate().map(page).collect()
}

/// Name, unit, R̂ and effective sample size above the draws; logarithmic where a positive quantity spans decades.
fn trace(scalar: &Scalar, row: Option<&Row>, is_last: bool) -> String {
    let mut pooled: Vec<f64> = scalar.chains.concat();
    pooled.retain(|x| x.is_finite());
    pooled.sort_by(f64::total_cmp);
    let (low, middle, high) = (pooled[0], pooled[pooled.len() / 2], pooled[pooled.len() - 1]);
    let is_log = low > 0.0 && high / middle > 20.0;
    let on_scale = |x: f64| if is_log { x.log10() } else { x };
    let scale = Scale::rounded([low, high].map(on_scale).into_iter(), 3.0);
    let mut ticks = scale.labelled();
    if is_log {
        let decades = (low.log10().floor() as i32)..=(high.log10().ceil() as i32);
        let decades = decades.map(|power| (scale.share(f64::from(power)), 10f64.powi(power)));
        let inside = decades.filter(|(share, _)| (-1e-9..=1.0 + 1e-9).contains(share));
        ticks = inside.map(|(share, value)| (share, power_of_ten(value))).collect();
    }
    let n_draws = scalar.chains.iter().map(Vec::len).max().unwrap_or(0);
    let x = if is_last { draws_axis(n_draws) } else { vec![] };
    let axes = Axes {
        size: [TRACE, HEIGHT],
        title: "",
        x: Axis { label: if is_last { "draw" } else { "" }, ticks: x, has_lines: false },
        y: Axis { label: "", ticks, has_lines: true },
    };
    let mut svg = axes.svg();
    for (k, chain) in scalar.chains.iter().enumerate() {
        let places = envelope(chain, BINS).into_iter();
        let places = places.map(|(at, v)| [TRACE * at, HEIGHT * (1.0 - scale.share(on_scale(v)))]);
        let colour = COLOURS[k % COLOURS.len()];
        let style = format!(r#"fill="none" stroke="{colour}" stroke-width=".6" opacity=".8""#);
        svg += &line(places, &style);
    }
    let unit = row.map_or("", |row| shown(&row.unit));
    let in_unit = if unit.is_empty() { String::new() } else { format!(" ({unit})") };
    let _ = write!(svg, r#"<text x="0" y="-6">{}{in_unit}</text>"#, escape(&scalar.name));
    if let Some(row) = row {
        let summary = &row.summary;
        let _ = write!(
            svg,
            r##"<text x="{TRACE}" y="-6" text-anchor="end" fill="#555">R-hat {:.3}, effective sample size {:.0}</text>"##,
            summary.r_hat, summary.ess_bulk
        );
    }
    svg
}

/// `0.01`, `100`; with an exponent where that is shorter.
fn power_of_ten(value: f64) -> String {
    if (1e-3..1e5).contains(&value) {
        value.to_string()
    } else {
        format!("{value:e}").replace('-', "−")
    }
}

fn draws_axis(n_draws: usize) -> Vec<(f64, String)> {
    Scale::within(0.0, n_draws as f64, 5.0)
}

/// How often the draws of each chain fall into each twentieth of all ranks; dashed where they agree.
fn ranks(scalar: &Scalar, is_last: bool) -> String {
    let chains: Vec<&[f64]> = scalar.chains.iter().map(Vec::as_slice).collect();
    let Some(counts) = rank_counts(&chains) else { return String::new() };
    let n_draws: usize = counts.iter().flatten().sum();
    let level = n_draws as f64 / (counts.len() * RANK_BINS) as f64;
    let most = counts.iter().flatten().copied().max().unwrap_or(0) as f64;
    let top = most.max(2.0 * level);
    let y = |count: f64| HEIGHT * (1.0 - count / top);
    let ticks = if is_last { Scale::between(0.0, 1.0).labelled() } else { vec![] };
    let label = if is_last { "rank among all draws" } else { "" };
    let axes = Axes {
        size: [RANK, HEIGHT],
        title: "",
        x: Axis { label, ticks, has_lines: false },
        y: Axis::default(),
    };
    let mut svg = axes.svg();
    svg += r##"<text x="0" y="-6" fill="#555">ranks by chain</text>"##;
    let _ = write!(
        svg,
        r##"<path d="M0 {:.1}H{RANK}" stroke="#888" stroke-dasharray="3 3" fill="none"/>"##,
        y(level)
    );
    for (k, counts) in counts.iter().enumerate() {
        let bin = RANK / RANK_BINS as f64;
        let steps = counts
            .iter()
            .enumerate()
            .flat_map(|(i, count)| [i, i + 1].map(|edge| [bin * edge as f64, y(*count as f64)]));
        let colour = COLOURS[k % COLOURS.len()];
        svg += &line(steps, &format!(r#"fill="none" stroke="{colour}" stroke-width="1""#));
    }
    svg
}

/// The ranks end before the picture does.
const _: () = assert!(LEFT + TRACE < RANKS && RANKS + RANK < WIDTH);
