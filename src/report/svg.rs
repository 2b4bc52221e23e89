//! Trace and rank plots of one scalar parameter, Pareto k of every measurement, evidence against its null
//! distribution and residuals against a column, as small inline SVG.
//!
//! # Source
//! Rank plots: Vehtari et al. 2021.  Colours: Okabe and Ito, distinguishable without red–green vision.

use std::fmt::Write as _;

use super::axes::{COLOURS, Scale};
use super::text::{escape, tick};

/// Plot area, in SVG units (CSS pixels at full size).
const HEIGHT: f64 = 96.0;
const TRACE_WIDTH: f64 = 480.0;
const RANK_WIDTH: f64 = 190.0;
const K_WIDTH: f64 = 750.0;
/// Space left of the plot area for the tick labels.
const MARGIN: f64 = 58.0;
/// Space below it for the labels of an x axis.
const AXIS: f64 = 18.0;
/// A trace is drawn as the range of its values in this many bins: a spike of one draw stays visible.
const TRACE_BINS: usize = 160;
pub(super) const RANK_BINS: usize = 20;
const NULL_BINS: usize = 60;

/// The draws of each chain against their index; logarithmic where a positive quantity spans decades.
pub(super) fn trace_plot(chains: &[&[f64]]) -> String {
    let mut pooled: Vec<f64> = chains.concat().into_iter().filter(|v| v.is_finite()).collect();
    pooled.sort_by(f64::total_cmp);
    let (Some(&low), Some(&high)) = (pooled.first(), pooled.last()) else { return String::new() };
    let logarithmic = low > 0.0 && high / pooled[pooled.len() / 2] > 20.0;
    let scale = |v: f64| if logarithmic { v.ln() } else { v };
    let span = (scale(high) - scale(low)).max(f64::MIN_POSITIVE);
    let y = |v: f64| HEIGHT * (1.0 - (scale(v) - scale(low)) / span);
    let mut svg = frame("trace", TRACE_WIDTH, [&tick(high), &tick(low)]);
    if logarithmic {
        let _ = write!(svg, r#"<text class="tick" x="-6" y="{}">log</text>"#, HEIGHT / 2.0);
    }
    for (chain, draws) in chains.iter().enumerate() {
        let points =
            envelope(draws, TRACE_BINS).into_iter().map(|(at, v)| (TRACE_WIDTH * at, y(v)));
        svg += &line(points, COLOURS[chain % COLOURS.len()]);
    }
    svg + "</svg>"
}

/// How often the draws of each chain fall into each twentieth of the ranks of all draws; level when the chains agree.
pub(super) fn rank_plot(chains: &[&[f64]]) -> String {
    let Some(counts) = rank_counts(chains) else { return String::new() };
    let n_draws: usize = counts.iter().flatten().sum();
    let level = n_draws as f64 / (chains.len() * RANK_BINS) as f64;
    let most = counts.iter().flatten().copied().max().unwrap_or(0) as f64;
    let top = most.max(2.0 * level);
    let y = |count: f64| HEIGHT * (1.0 - count / top);
    let mut svg = frame("ranks", RANK_WIDTH, [&tick(top), "0"]);
    let _ = write!(svg, r#"<path class="level" d="M0 {:.1}H{RANK_WIDTH}"/>"#, y(level));
    let bin_width = RANK_WIDTH / RANK_BINS as f64;
    for (chain, counts) in counts.iter().enumerate() {
        let steps = counts.iter().enumerate().flat_map(|(bin, &count)| {
            [bin, bin + 1].map(|edge| (bin_width * edge as f64, y(count as f64)))
        });
        svg += &line(steps, COLOURS[chain % COLOURS.len()]);
    }
    svg + "</svg>"
}

/// How many draws of each chain (chain, bin) have a rank among all draws in each twentieth of them; `None` without a
/// draw.
pub(super) fn rank_counts(chains: &[&[f64]]) -> Option<Vec<[usize; RANK_BINS]>> {
    let mut order: Vec<(usize, f64)> = Vec::new();
    for (chain, draws) in chains.iter().enumerate() {
        order.extend(draws.iter().map(|&v| (chain, v)));
    }
    order.sort_by(|a, b| a.1.total_cmp(&b.1));
    let mut counts = vec![[0_usize; RANK_BINS]; chains.len()];
    for (rank, (chain, _)) in order.iter().enumerate() {
        counts[*chain][rank * RANK_BINS / order.len()] += 1;
    }
    (!order.is_empty()).then_some(counts)
}

/// Pareto k of every named measurement in order, with the `threshold` beyond which plain weights say nothing; a k
/// that cannot be had is at the top. A point is marked if no other way could tell it either.
pub(super) fn k_plot(points: &[(String, f64, bool)], threshold: f64) -> String {
    let finite = || points.iter().map(|point| point.1).filter(|k| k.is_finite());
    let (low, high) = (finite().fold(0.0, f64::min), finite().fold(1.0, f64::max));
    let y = |k: f64| HEIGHT * (1.0 - (k.min(high) - low) / (high - low));
    let mut svg = frame("Pareto k", K_WIDTH, [&tick(high), &tick(low)]);
    let _ = write!(svg, r#"<path class="level" d="M0 {:.1}H{K_WIDTH}"/>"#, y(threshold));
    let _ = write!(
        svg,
        r#"<text class="tick" x="-6" y="{:.1}">{}</text>"#,
        y(threshold) + 4.0,
        tick(threshold)
    );
    for (i, (name, k, is_untold)) in points.iter().enumerate() {
        let x = K_WIDTH * (i as f64 + 0.5) / points.len() as f64;
        let class = if *is_untold { r#" class="high""# } else { "" };
        let _ = write!(
            svg,
            r#"<circle{class} cx="{x:.1}" cy="{:.1}" r="3.5"><title>{name}: {k:.2}</title></circle>"#,
            y(*k)
        );
    }
    svg + "</svg>"
}

/// Candidates (name, log Bayes factor, whether it was taken) over the histogram of what the best of them reached on
/// data without any effect; dashed is what a claim must exceed.
pub(super) fn evidence_plot(nulls: &[f64], tried: &[(String, f64, bool)], claim: f64) -> String {
    let values =
        || tried.iter().map(|t| t.1).chain(nulls.iter().copied()).filter(|v| v.is_finite());
    let low = values().fold(-1.0, f64::min).max(-12.0).floor();
    let high = 1.05 * values().fold(claim + 2.0, f64::max);
    let scale = Scale::between(low, high);
    let x = |v: f64| K_WIDTH * scale.share(v.clamp(low, high));
    let mut svg = histogram(nulls, x);
    let _ = write!(svg, r#"<path class="level" d="M{:.1} 0V{HEIGHT}"/>"#, x(claim));
    for (name, value, is_taken) in tried.iter().filter(|t| t.1.is_finite()) {
        let class = if *is_taken { r#" class="high""# } else { "" };
        let _ = write!(
            svg,
            r#"<circle{class} cx="{:.1}" cy="24" r="4"><title>{}: {value:.1}</title></circle>"#,
            x(*value),
            escape(name)
        );
    }
    let finite = tried.iter().filter(|t| t.1.is_finite());
    if let Some((name, value, _)) = finite.max_by(|a, b| a.1.total_cmp(&b.1)) {
        let anchor = if x(*value) > 0.5 * K_WIDTH { "end" } else { "start" };
        let _ = write!(
            svg,
            r#"<text class="name" x="{:.1}" y="14" style="text-anchor:{anchor}">{} {value:.1}</text>"#,
            x(*value),
            escape(name)
        );
    }
    // "asked" keeps clear of the labels at the ends
    let asked = x(claim).clamp(70.0, K_WIDTH - 170.0);
    svg += &below([0.0, HEIGHT], "start", &tick(low));
    svg += &below([asked, HEIGHT], "middle", &format!("asked: {}", tick(claim)));
    svg += &below([K_WIDTH, HEIGHT], "end", &format!("log Bayes factor {}", tick(high)));
    svg + "</svg>"
}

/// The frame of [`evidence_plot`] and how often each value occurs among `nulls`, at their places `x`.
fn histogram(nulls: &[f64], x: impl Fn(f64) -> f64) -> String {
    let mut counts = [0_usize; NULL_BINS];
    for null in nulls {
        counts[((x(*null) / K_WIDTH * NULL_BINS as f64) as usize).min(NULL_BINS - 1)] += 1;
    }
    let most = counts.iter().copied().max().unwrap_or(0).max(1);
    let mut svg = frame_of("evidence", [K_WIDTH, HEIGHT, AXIS], [&most.to_string(), "0"]);
    let bin = K_WIDTH / NULL_BINS as f64;
    for (i, count) in counts.iter().enumerate().filter(|(_, count)| **count > 0) {
        let (left, height) = (bin * i as f64, HEIGHT * 0.75 * *count as f64 / most as f64);
        let _ = write!(
            svg,
            r#"<rect class="null" x="{left:.1}" y="{:.1}" width="{bin:.1}" height="{height:.1}"><title>{count} of {} searches on simulated data</title></rect>"#,
            HEIGHT - height,
            nulls.len()
        );
    }
    svg
}

/// Residuals against a column: before (hollow) and after (full) at each x; `ticks` name places on the x axis.
pub(super) fn residual_plot(
    points: &[(f64, f64, f64)],
    ticks: &[(f64, String)],
    curves: &[Curve],
) -> String {
    let xs = || points.iter().map(|p| p.0).filter(|x| x.is_finite());
    let (low, high) = (xs().fold(f64::INFINITY, f64::min), xs().fold(f64::NEG_INFINITY, f64::max));
    let pad = 0.04 * (high - low).max(f64::MIN_POSITIVE);
    let x = |v: f64| K_WIDTH * (v - low + pad) / (high - low + 2.0 * pad);
    let limit = points
        .iter()
        .flat_map(|p| [p.1, p.2])
        .chain(curves.iter().flatten().flat_map(|(_, quantiles)| *quantiles))
        .filter(|v| v.is_finite())
        .fold(f64::MIN_POSITIVE, |limit, v| limit.max(v.abs()));
    let tall = 1.6 * HEIGHT;
    let y = |v: f64| tall * (0.5 - 0.48 * v / limit);
    let mut svg =
        frame_of("residuals", [K_WIDTH, tall, AXIS], [&tick(limit / 0.96), &tick(-limit / 0.96)]);
    let _ = write!(
        svg,
        r#"<path class="level" d="M0 {0:.1}H{K_WIDTH}"/><text class="tick" x="-6" y="{0:.1}">0</text>"#,
        y(0.0)
    );
    for (at, before, after) in points.iter().filter(|p| p.0.is_finite()) {
        for (class, value) in [("before", before), ("after", after)] {
            if value.is_finite() {
                let (x, y) = (x(*at), y(*value));
                let _ = write!(svg, r#"<circle class="{class}" cx="{x:.1}" cy="{y:.1}" r="3.5"/>"#);
            }
        }
    }
    svg.extend(curves.iter().map(|curve| band(curve, &x, &y)));
    for (at, name) in ticks {
        svg += &below([x(*at), tall], "middle", &escape(name));
    }
    svg + "</svg>"
}

/// A median with its 5 and 95 % quantiles along x: `(x, [low, median, high])`.
pub(super) type Curve = Vec<(f64, [f64; 3])>;

/// A curve with its band.
fn band(curve: &[(f64, [f64; 3])], x: &dyn Fn(f64) -> f64, y: &dyn Fn(f64) -> f64) -> String {
    let path = |points: &mut dyn Iterator<Item = (f64, f64)>| {
        let point = |(at, v): (f64, f64)| format!("{:.1} {:.1}", x(at), y(v));
        points.map(point).collect::<Vec<_>>().join("L")
    };
    let low = path(&mut curve.iter().map(|(at, q)| (*at, q[0])));
    let high = path(&mut curve.iter().rev().map(|(at, q)| (*at, q[2])));
    let middle = path(&mut curve.iter().map(|(at, q)| (*at, q[1])));
    format!(r#"<path class="band" d="M{low}L{high}Z"/><path class="curve" d="M{middle}"/>"#)
}

/// A label of the x axis, below the plot area at `x` that is so `tall`.
fn below([x, tall]: [f64; 2], anchor: &str, text: &str) -> String {
    format!(
        r#"<text class="tick" x="{x:.1}" y="{:.1}" style="text-anchor:{anchor}">{text}</text>"#,
        tall + 15.0
    )
}

/// The opening tag, the plot area and the labels of its top and bottom.
fn frame(label: &str, width: f64, labels: [&str; 2]) -> String {
    frame_of(label, [width, HEIGHT, 0.0], labels)
}

/// The same of any height, with room below for the labels of an x axis.
fn frame_of(label: &str, [width, height, below]: [f64; 3], [top, bottom]: [&str; 2]) -> String {
    let (left, full_width, full_height) = (-MARGIN, MARGIN + width + 2.0, height + below + 8.0);
    format!(
        r#"<svg role="img" aria-label="{label}" viewBox="{left} -4 {full_width} {full_height}">"#
    ) + &format!(r#"<rect class="area" width="{width}" height="{height}"/>"#)
        + &format!(r#"<text class="tick" x="-6" y="8">{top}</text>"#)
        + &format!(r#"<text class="tick" x="-6" y="{height}">{bottom}</text>"#)
}

fn line(points: impl Iterator<Item = (f64, f64)>, colour: &str) -> String {
    let mut path = String::new();
    for (x, y) in points {
        let command = if path.is_empty() { 'M' } else { 'L' };
        let _ = write!(path, "{command}{x:.1} {y:.1}");
    }
    format!(r#"<path class="chain" stroke="{colour}" d="{path}"/>"#)
}

/// Smallest and largest finite draw of each of at most so many bins, at the bin's middle as a share of the chain.
pub(super) fn envelope(draws: &[f64], most: usize) -> Vec<(f64, f64)> {
    let bins = most.min(draws.len());
    let bounds = |bin: usize| bin * draws.len() / bins..(bin + 1) * draws.len() / bins;
    let mut points = Vec::new();
    for bin in 0..bins {
        let finite = || draws[bounds(bin)].iter().copied().filter(|v| v.is_finite());
        let range = (finite().reduce(f64::min), finite().reduce(f64::max));
        if let (Some(low), Some(high)) = range {
            let at = (bin as f64 + 0.5) / bins as f64;
            points.extend([(at, low), (at, high)]);
        }
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spike_of_one_draw_stays_visible() {
        let mut draws = vec![0.0; 5000];
        draws[1234] = 7.0;
        let points = envelope(&draws, TRACE_BINS);
        assert_eq!(points.len(), 2 * TRACE_BINS);
        assert!(points.iter().any(|&(at, v)| v > 6.9 && (at - 0.2468).abs() < 1.0 / 160.0));
    }

    #[test]
    fn ranks_of_a_stuck_chain_leave_the_level() {
        let good: Vec<f64> = (0..100).map(f64::from).collect();
        let stuck = vec![1000.0; 100];
        let level = rank_plot(&[&good, &good]);
        let apart = rank_plot(&[&good, &stuck]);
        // Two chains that agree put half of each bin's ten draws into each: the line is at half height.
        assert!(level.matches(" 48.0").count() >= 2 * 2 * RANK_BINS - 8, "{level}");
        assert!(apart.contains("M0.0 0.0L") && apart.contains("M0.0 96.0L"), "{apart}");
    }

    #[test]
    fn empty_and_void_draws_draw_nothing() {
        assert_eq!(trace_plot(&[&[], &[f64::NAN]]), "");
        assert_eq!(rank_plot(&[]), "");
    }

    #[test]
    fn only_what_nothing_could_tell_is_marked() {
        let plot =
            k_plot(&[("told".to_owned(), 0.9, false), ("untold".to_owned(), 0.8, true)], 0.7);
        assert_eq!(plot.matches("class=\"high\"").count(), 1);
        let marked = plot.split("class=\"high\"").nth(1).unwrap_or_default();
        assert!(marked.contains("untold: 0.80"), "{plot}");
    }
}
