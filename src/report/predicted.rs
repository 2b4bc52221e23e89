//! Predicted against measured, and the share of measurements in their intervals, as part of a page.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use super::axes::{Axes, Axis, Scale};
use super::rows::{LEVELS, LeftOutBy, PredictedRow, Predictions};
use super::text::{after_number, escape, shown, tick};

/// The plot area is a square: both axes have one scale.
const SIDE: f64 = 400.0;
/// With more rows than this only those outside their intervals can be pointed at.
const MOST_TITLES: usize = 200;
/// Most rows outside whose line is written beside them, and most that are named below.
const MOST_LABELS: usize = 6;
const MOST_NAMED: usize = 12;
/// More sets than this are shown when they are asked for.
const MOST_SETS: usize = 12;

/// A picture per statement, the rows outside their intervals by name, and a table of shares.
pub(super) fn section(predictions: &Predictions) -> String {
    let mut html = format!("<p class=\"note\">{}</p><div class=\"panels\">", legend(predictions));
    for rows in predictions.rows.chunk_by(|a, b| a.protocol == b.protocol) {
        html += &panel(rows);
    }
    html += "</div>";
    html += &outside(&predictions.rows);
    html + &coverage(predictions)
}

/// How to read the pictures.
fn legend(predictions: &Predictions) -> String {
    let brackets = if has_brackets(predictions) {
        " A grey square is a bracket, and dots and intervals are those of a bracket's middle; a row fits \
         if its interval meets the square. Rows of one bracket stand side by side in the order of their \
         predictions."
    } else {
        ""
    };
    format!(
        "Each row of the table: what was measured, to the right, and what the model predicts of such a \
         measurement, upwards, noise included: median and central 90 % interval. Dashed: both are \
         equal.{brackets} Red rows lie outside, some with their line in the table."
    )
}

fn has_brackets(predictions: &Predictions) -> bool {
    predictions.rows.iter().any(|row| row.measured[0] < row.measured[1])
}

/// How far a measurement lies from the median, in widths of its interval.
fn excess(row: &PredictedRow) -> f64 {
    let [q5, q50, q95] = row.fitted.quantiles;
    (middle(row) - q50).abs() / (q95 - q5).max(width(row)).max(f64::MIN_POSITIVE)
}

/// Rows outside their intervals, the farthest first.
pub(super) fn worst<'r>(rows: impl IntoIterator<Item = &'r PredictedRow>) -> Vec<&'r PredictedRow> {
    let mut worst: Vec<&PredictedRow> =
        rows.into_iter().filter(|row| !row.fitted.is_inside()).collect();
    worst.sort_by(|a, b| excess(b).total_cmp(&excess(a)));
    worst
}

/// The middle of a bracket, the end of an open one, or the number.
fn middle(row: &PredictedRow) -> f64 {
    match row.measured {
        [lower, upper] if lower.is_infinite() => upper,
        [lower, upper] if upper.is_infinite() => lower,
        [lower, upper] => 0.5 * (lower + upper),
    }
}

/// Of a bracket with two ends; else 0.
pub(super) fn width(row: &PredictedRow) -> f64 {
    let width = row.measured[1] - row.measured[0];
    if width.is_finite() { width } else { 0.0 }
}

/// Where each row stands on the axis of what was measured: rows of one bracket side by side in the order
/// of their predictions.
pub(super) fn places(rows: &[PredictedRow]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..rows.len()).collect();
    let key =
        |i: &usize| (rows[*i].measured[0], rows[*i].measured[1], rows[*i].fitted.quantiles[1]);
    order.sort_by(|a, b| {
        let (a, b) = (key(a), key(b));
        a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.total_cmp(&b.2))
    });
    let mut places = vec![0.0; rows.len()];
    let is_alike = |a: &usize, b: &usize| {
        let bits = |i: &usize| rows[*i].measured.map(f64::to_bits);
        bits(a) == bits(b)
    };
    for alike in order.chunk_by(is_alike) {
        for (k, i) in alike.iter().enumerate() {
            let share = (k as f64 + 0.5) / alike.len() as f64 - 0.5;
            places[*i] = middle(&rows[*i]) + 0.9 * share * width(&rows[*i]);
        }
    }
    places
}

/// Predicted against measured for the rows of one statement.
fn panel(rows: &[PredictedRow]) -> String {
    let ends = |row: &PredictedRow| {
        let [q5, _, q95] = row.fitted.quantiles;
        [row.measured[0], row.measured[1], q5, q95]
    };
    let scale = Scale::around(rows.iter().flat_map(ends).filter(|x| x.is_finite()));
    let unit = shown(&rows[0].unit);
    let in_unit = |what: &str| match unit {
        "" => what.to_owned(),
        unit => format!("{what} ({unit})"),
    };
    let title = format!("{}: {} upwards", rows[0].protocol, in_unit("predicted"));
    let x_label = in_unit("measured");
    let axis = |label| Axis { label, ticks: scale.labelled(), has_lines: false };
    let axes = Axes { size: [SIDE, SIDE], title: &title, x: axis(&x_label), y: axis("") };
    let (left, top) = (-Axes::LEFT, -Axes::ABOVE);
    let (wide, high) = (SIDE + Axes::LEFT + 14.0, SIDE + Axes::ABOVE + Axes::BELOW);
    let label = escape(&rows[0].protocol);
    format!(
        "<svg class=\"predicted\" role=\"img\" aria-label=\"{label}: predicted against measured\" \
         viewBox=\"{left} {top} {wide} {high}\" font-size=\"12\">{}{}\
         <path class=\"level\" d=\"M0 {SIDE}L{SIDE} 0\"/>{}</svg>",
        axes.svg(),
        brackets(rows, &scale),
        marks(rows, &scale)
    )
}

/// A square on the line of identity for each bracket.
fn brackets(rows: &[PredictedRow], scale: &Scale) -> String {
    let bits = |row: &PredictedRow| row.measured.map(f64::to_bits);
    let distinct: BTreeSet<[u64; 2]> =
        rows.iter().filter(|row| width(row) > 0.0).map(bits).collect();
    let square = |ends: &[u64; 2]| {
        let [from, to] = ends.map(|bits| SIDE * scale.share(f64::from_bits(bits)));
        format!("M{from:.1} {:.1}H{to:.1}V{:.1}H{from:.1}Z", SIDE - from, SIDE - to)
    };
    if distinct.is_empty() {
        return String::new();
    }
    let squares: String = distinct.iter().map(square).collect();
    format!("<path class=\"bracket\" d=\"{squares}\"/>")
}

/// An interval and a dot for each row, those outside on top and in red.
fn marks(rows: &[PredictedRow], scale: &Scale) -> String {
    let at = |value: f64| SIDE * scale.share(value);
    let has_titles = rows.len() <= MOST_TITLES;
    let [mut lines, mut dots, mut near, mut far] = [const { String::new() }; 4];
    let named: BTreeSet<u64> = worst(rows).iter().take(MOST_LABELS).map(|row| row.line).collect();
    for (row, x) in rows.iter().zip(places(rows)) {
        let [q5, q50, q95] = row.fitted.quantiles;
        if !(q5.is_finite() && q95.is_finite() && x.is_finite()) {
            continue;
        }
        let [x, bottom, y, top] = [at(x), SIDE - at(q5), SIDE - at(q50), SIDE - at(q95)];
        let (line, dot) = (format!("M{x:.1} {bottom:.1}V{top:.1}"), format!("M{x:.1} {y:.1}h0"));
        if row.fitted.is_inside() && !has_titles {
            lines += &line;
            dots += &dot;
            continue;
        }
        let (group, class) =
            if row.fitted.is_inside() { (&mut near, "") } else { (&mut far, " class=\"far\"") };
        let title = escape(&told(row));
        let _ = write!(group, "<g{class}><title>{title}</title>{}</g>", bar(&line, &dot));
        if named.contains(&row.line) {
            let (x, y, line) = (x + 6.0, y + 4.0, row.line);
            let _ = write!(group, "<text class=\"far\" x=\"{x:.1}\" y=\"{y:.1}\">{line}</text>");
        }
    }
    let class = if has_titles { "rows" } else { "rows many" };
    format!("<g class=\"{class}\">{}{near}{far}</g>", bar(&lines, &dots))
}

/// Intervals, and medians on them.
fn bar(lines: &str, dots: &str) -> String {
    if lines.is_empty() {
        return String::new();
    }
    format!("<path d=\"{lines}\"/><path class=\"dot\" d=\"{dots}\"/>")
}

/// `240 to 250`, `above 240`, `below 60` or a number.
fn measured(row: &PredictedRow) -> String {
    match row.measured {
        [lower, upper] if lower.is_infinite() => format!("below {}", tick(upper)),
        [lower, upper] if upper.is_infinite() => format!("above {}", tick(lower)),
        [lower, upper] if lower < upper => format!("{lower} to {upper}"),
        [number, _] => tick(number),
    }
}

/// A row in words.
fn told(row: &PredictedRow) -> String {
    let ([q5, q50, q95], unit) = (row.fitted.quantiles.map(tick), after_number(&row.unit));
    let (protocol, place, measured) = (&row.protocol, row.place(), measured(row));
    format!("{protocol} {place}: measured {measured}{unit}, predicted {q50} ({q5} to {q95}){unit}")
}

/// The rows outside their intervals by name.
fn outside(rows: &[PredictedRow]) -> String {
    let worst = worst(rows);
    let mut html = format!(
        "<p><b>{} of {} rows lie outside their 90 % predictive interval</b>",
        worst.len(),
        rows.len()
    );
    if worst.is_empty() {
        return html + ".</p>";
    }
    html += match worst.len() {
        n if n > MOST_NAMED => " (red; the farthest are named):</p><ul class=\"far\">",
        _ => " (red):</p><ul class=\"far\">",
    };
    for row in worst.iter().take(MOST_NAMED) {
        let _ = write!(html, "<li>{}", escape(&told(row)));
    }
    html + "</ul>"
}

/// The share of rows in their intervals, by set.
fn coverage(predictions: &Predictions) -> String {
    let has_left_out = predictions.rows.iter().any(|row| row.left_out.is_some());
    let levels = LEVELS.map(|p| format!("<th>{} %", 100.0 * p)).concat();
    let head = |sets: &[(String, Vec<usize>)]| {
        let mut html =
            "<div class=\"scroll\"><table class=\"coverage\"><thead><tr><th><th colspan=\"5\">\
                        rows that the model was fitted to"
                .to_owned();
        if has_left_out {
            html += "<th colspan=\"5\">each row from the others alone";
        }
        let _ = write!(html, "<tr><th class=\"text\">within the central<th>rows{levels}");
        if has_left_out {
            let _ = write!(html, "<th>rows{levels}");
        }
        html += "</thead><tbody>";
        for (name, own) in sets {
            let _ = write!(html, "<tr><td class=\"text\">{}", escape(name));
            for count in predictions.counts(own).iter().take(1 + usize::from(has_left_out)) {
                let _ = write!(html, "<td>{}", count.n);
                for (level, inside) in LEVELS.iter().zip(count.inside) {
                    html += &share(*level, count.n, inside);
                }
            }
        }
        html + "</tbody></table></div>"
    };
    let (shown, more) = predictions.sets.split_at(predictions.sets.len().min(MOST_SETS));
    let mut html =
        format!("<h3>Coverage</h3><p class=\"note\">{}</p>{}", how(predictions), head(shown));
    if !more.is_empty() {
        let _ =
            write!(html, "<details><summary>{} more</summary>{}</details>", more.len(), head(more));
    }
    html
}

/// A cell; amber where so few rows would be inside in less than one of forty right models.
fn share(level: f64, n: usize, inside: usize) -> String {
    if n == 0 {
        return "<td>–".to_owned();
    }
    let spread = (n as f64 * level * (1.0 - level)).sqrt();
    let is_low = (inside as f64) < n as f64 * level - 2.0 * spread;
    let class = if is_low { " class=\"low\"" } else { "" };
    format!("<td{class}>{:.0} %", 100.0 * inside as f64 / n as f64)
}

/// What the table compares, and how rows were left out.
fn how(predictions: &Predictions) -> String {
    let by = |how: Option<LeftOutBy>| {
        let of = |row: &&PredictedRow| row.left_out.as_ref().map(|(_, by)| *by) == how;
        predictions.rows.iter().filter(of).count()
    };
    let [weights, integrated, fit] = LeftOutBy::ALL.map(|how| by(Some(how)));
    let mut rest =
        "A column's share should be near its title; amber: lower than chance explains.".to_owned();
    if has_brackets(predictions) {
        rest += " Brackets are compared on the grid of their width, which raises all shares.";
    }
    if weights + integrated + fit == 0 {
        return format!(
            "Share of rows in their central predictive intervals. The intervals have seen the rows, so they \
             hold more than they would of new ones; no row was left out in this run. {rest}"
        );
    }
    let mut parts = vec![];
    for (n, what) in [
        (weights, "by importance weights (PSIS)"),
        (integrated, "by such weights with the fields integrated out"),
        (fit, "in a fit without the row"),
        (by(None), "not known, Pareto k too high"),
    ] {
        if n > 0 {
            parts.push(format!("{n} {what}"));
        }
    }
    format!(
        "Share of rows in their central predictive intervals. Left: the intervals have seen the rows, so they \
         hold more than they would of new ones. Right: leave-one-out, {}. {rest}",
        parts.join(", ")
    )
}

#[cfg(test)]
mod tests {
    use super::super::samples;
    use super::*;

    #[test]
    fn rows_outside_are_red_and_named_with_line_and_site() {
        let html = section(&samples::predictions());
        assert_eq!(html.matches("<g class=\"far\"").count(), 1);
        assert!(html.contains("<b>1 of 3 rows lie outside"), "{html}");
        let named =
            "<li>s1s2 line 4 (site 3): measured 290 to 300 ms, predicted 235 (225 to 245) ms";
        assert!(html.contains(named), "{html}");
        assert!(html.contains(
            "leave-one-out, 1 by importance weights (PSIS), 1 in a fit without the row, 1 not known"
        ));
    }

    #[test]
    fn rows_of_one_bracket_stand_side_by_side_within_it() {
        let mut rows = samples::predictions().rows;
        for (row, median) in rows.iter_mut().zip([3.0, 1.0, 2.0]) {
            row.measured = [230.0, 240.0];
            row.fitted.quantiles[1] = median;
        }
        assert_eq!(places(&rows), [238.0, 232.0, 235.0]);
        rows[0].measured = [7.5, 7.5];
        assert!((places(&rows)[0] - 7.5).abs() < 1e-12);
    }

    #[test]
    fn shares_lower_than_chance_are_marked() {
        assert_eq!(share(0.9, 20, 18), "<td>90 %");
        // two standard errors are 2.7 of 20
        assert_eq!(share(0.9, 20, 16), "<td>80 %");
        assert_eq!(share(0.9, 20, 15), "<td class=\"low\">75 %");
        assert_eq!(share(0.9, 0, 0), "<td>–");
    }

    #[test]
    fn many_rows_are_one_path() {
        let one = samples::predictions().rows[0].clone();
        let rows: Vec<PredictedRow> =
            (0..1400).map(|line| PredictedRow { line, ..one.clone() }).collect();
        let html = panel(&rows);
        assert!(html.matches("<path").count() < 10 && html.len() < 60_000, "{}", html.len());
    }
}
