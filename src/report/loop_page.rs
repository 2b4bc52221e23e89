//! `report.html` of the loop: what a model lacks, the evidence for it, and the errors before and after.
//!
//! The page is `loop.html` with its slots filled. Its figures are inline SVG: it needs neither network nor script.

use std::fmt::Write as _;

use super::html::{STYLE, fill};
use super::loop_errors::{ErrorChange, behind, comparison, error_line, tiles};
use super::surface_map::{Dot, SurfaceMap, colour_scale};
use super::svg::{Curve, evidence_plot, residual_plot};
use super::text::{escape, tick};
use crate::mesh::TriMesh;

const PAGE: &str = include_str!("loop.html");

/// What the page tells.
#[derive(Debug)]
pub struct LoopPage<'a> {
    /// Name of the model.
    pub model: &'a str,
    /// File of the measurements.
    pub data: &'a str,
    /// What speaks against the fits: which, and what to do.
    pub troubles: &'a [String],
    /// The answer, one sentence.
    pub verdict: &'a str,
    /// What the intervals of the model as written hold, if that is too little.
    pub narrow: Option<&'a str>,
    /// What sites and measurements differ by, one line each.
    pub spread: &'a [String],
    /// What was found: the effect's size in words, one line each.
    pub effects: &'a [String],
    /// The model as equations.
    pub before: &'a str,
    /// The model with what was added to it; `None` if nothing was.
    pub after: Option<&'a str>,
    /// Whether an effect was found.
    pub is_found: bool,
    /// Errors of predictions; the first counts.
    pub comparisons: &'a [ErrorChange],
    /// What was tried, round by round.
    pub rounds: &'a [TriedRound],
    /// What the model leaves over.
    pub residuals: Residuals<'a>,
    /// What no candidate explains.
    pub unexplained: &'a str,
    /// Columns that could not be tried, and why.
    pub not_tried: &'a [[String; 2]],
    /// Doubts about surface and table.
    pub warnings: &'a [String],
    /// Files beside the page.
    pub files: &'a [String],
}

/// Everything tried in one round.
#[derive(Clone, Debug)]
pub struct TriedRound {
    /// Log Bayes factor that a claim must exceed.
    pub claim: f64,
    /// Best log Bayes factor of each search on simulated data.
    pub nulls: Vec<f64>,
    /// Candidates, best first.
    pub tried: Vec<TriedEffect>,
}

/// A candidate.
#[derive(Clone, Debug)]
pub struct TriedEffect {
    /// Its name in findings.
    pub name: String,
    /// What it acts on, and its form.
    pub statement: String,
    /// p-value of the screen.
    pub p_screen: f64,
    /// Log Bayes factor; not finite if the screen stopped it.
    pub log_bf: f64,
    /// Share of null searches that did as well; `None` without null searches.
    pub p_null: Option<f64>,
    /// What became of it.
    pub verdict: String,
    /// Whether it was taken.
    pub is_taken: bool,
}

/// Measured minus predicted from the other sites.
#[derive(Debug)]
pub struct Residuals<'a> {
    /// Unit of the measurements.
    pub unit: &'a str,
    /// The surface, if the model has one.
    pub mesh: Option<&'a TriMesh>,
    /// Means of sites.
    pub sites: &'a [SiteResidual],
    /// Each row's against the column of the first effect found, if it reads one.
    pub against: Option<&'a Against>,
    /// The first effect found (as `after`), if it is a field.
    pub field: &'a [SiteResidual],
}

/// Residual of a site; NaN where only open brackets were measured.
#[derive(Clone, Debug)]
pub struct SiteResidual {
    /// The site in words.
    pub name: String,
    /// Where, mm.
    pub at: Option<[f64; 3]>,
    /// Of the model as declared.
    pub before: f64,
    /// Of the model with what was found; NaN if nothing was.
    pub after: f64,
}

/// Residuals of rows against a column, and the effect that explains them.
#[derive(Clone, Debug)]
pub struct Against {
    /// The column.
    pub column: String,
    /// Cell, residual without the effect, residual with it.
    pub rows: Vec<(f64, f64, f64)>,
    /// Names of places on the x axis.
    pub ticks: Vec<(f64, String)>,
    /// The effect: its 5, 50 and 95 % quantiles at cells.
    pub curve: Vec<(f64, [f64; 3])>,
    /// The labels, if the column is one of labels: the points of the curve are theirs.
    pub labels: Vec<String>,
    /// Unit of the measurements.
    pub unit: String,
}

/// The page as HTML.
pub fn loop_page(page: &LoopPage<'_>) -> String {
    let absent = |is_absent: bool| if is_absent { "absent" } else { "" }.to_owned();
    let map = page.residuals.mesh.map(SurfaceMap::new);
    let residuals = &page.residuals;
    let slots = [
        ("model", escape(page.model)),
        ("data", escape(page.data)),
        ("style", STYLE.to_owned()),
        ("troubles", paragraphs("trouble", page.troubles)),
        ("verdict", escape(page.verdict)),
        ("narrow", page.narrow.map_or(String::new(), narrow)),
        ("effects", paragraphs("effect", page.effects)),
        ("tiles", page.comparisons.first().map_or(String::new(), |c| tiles(c, residuals.unit))),
        ("definitions", map.as_ref().map_or(String::new(), SurfaceMap::definitions)),
        ("before", escape(page.before)),
        ("residual_note", residual_note(residuals)),
        ("residuals_before", residual_figure(residuals, map.as_ref(), false)),
        (
            "error_before",
            page.comparisons.first().map_or(String::new(), |c| error_line(c, residuals.unit)),
        ),
        ("tried", page.rounds.iter().enumerate().map(|(i, r)| round(i, r)).collect()),
        ("spread", paragraphs("doubt", page.spread)),
        ("after_class", absent(page.after.is_none())),
        ("after", page.after.map_or(String::new(), |after| marked(page.before, after))),
        (
            "file",
            page.files.first().map_or(String::new(), |f| format!("{} runs by itself.", escape(f))),
        ),
        ("comparison", page.comparisons.iter().map(|c| comparison(c, residuals.unit)).collect()),
        ("against", against(residuals, page.is_found)),
        ("field", field(residuals, map.as_ref())),
        (
            "residuals_after",
            if page.is_found {
                residual_figure(residuals, map.as_ref(), true)
            } else {
                String::new()
            },
        ),
        ("unexplained_number", if page.after.is_some() { "6" } else { "4" }.to_owned()),
        ("unexplained", escape(page.unexplained)),
        ("not_tried", not_tried(page.not_tried)),
        ("warnings_class", absent(page.warnings.is_empty())),
        ("warnings", paragraphs("doubt", page.warnings)),
        ("files", escape(&page.files.join(", "))),
    ];
    fill(PAGE, &slots)
}

fn paragraphs(class: &str, texts: &[String]) -> String {
    texts.iter().fold(String::new(), |mut html, text| {
        let _ = write!(html, "<p class=\"{class}\">{}</p>", escape(text));
        html
    })
}

fn narrow(text: &str) -> String {
    format!("<p class=\"doubt\">As written its intervals are too narrow: {}.</p>", escape(text))
}

fn residual_note(residuals: &Residuals<'_>) -> String {
    let how = "Measured minus predicted from the other sites, mean of each site";
    if residuals.mesh.is_none() {
        return format!("{how}.");
    }
    format!(
        "{how}. Orange: longer than predicted; blue: shorter; faint: behind the surface; hollow: no closed bracket. \
         Point at a site to read it."
    )
}

/// Residuals on the surface; without one, in the order of the table.
fn residual_figure(residuals: &Residuals<'_>, map: Option<&SurfaceMap>, is_after: bool) -> String {
    let of = |site: &SiteResidual| if is_after { site.after } else { site.before };
    let Some(map) = map else {
        if is_after {
            return String::new(); // in the plot against the column
        }
        let rows = residuals.sites.iter().enumerate();
        let rows: Vec<(f64, f64, f64)> =
            rows.map(|(i, site)| (i as f64, f64::NAN, of(site))).collect();
        let last = residuals.sites.len().saturating_sub(1);
        let ticks = [0, last].map(|i| (i as f64, residuals.sites[i].name.clone()));
        return residual_plot(&rows, &ticks, &[]);
    };
    let both = residuals.sites.iter().flat_map(|s| [s.before, s.after]);
    let limit = both.filter(|v| v.is_finite()).fold(f64::MIN_POSITIVE, |m, v| m.max(v.abs()));
    let dots = dots(residuals.sites, residuals.unit, is_after);
    let label = if is_after { "residuals after" } else { "residuals before" };
    map.draw(label, &dots, limit) + &colour_scale(limit, residuals.unit)
}

/// The first effect that was found over the residuals that it explains.
fn against(residuals: &Residuals<'_>, is_found: bool) -> String {
    let Some(against) = residuals.against.filter(|_| is_found) else { return String::new() };
    let unit = if behind(&against.unit).is_empty() {
        String::new()
    } else {
        format!(" ({})", escape(&against.unit))
    };
    let mut html = format!(
        "<p class=\"note\">What each measurement leaves over{unit} against {}: hollow without the effect, full with it. \
         Line: the effect, its median and 90 % interval.</p>{}",
        escape(&against.column),
        residual_plot(&against.rows, &against.ticks, &curves(against))
    );
    if !against.labels.is_empty() {
        html += "<table class=\"summary\"><thead><tr><th class=\"text\">label<th>median<th>90 % interval</thead><tbody>";
        for (label, (_, [low, middle, high])) in against.labels.iter().zip(&against.curve) {
            let [low, middle, high] = [low, middle, high].map(|x| tick(*x));
            let (label, unit) = (escape(label), behind(&against.unit));
            let _ = write!(
                html,
                "<tr><td class=\"text\">{label}<td>{middle}{unit}<td>{low} to {high}{unit}"
            );
        }
        html += "</tbody></table>";
    }
    html
}

/// The curve of the effect; of labels, a stroke for each.
fn curves(against: &Against) -> Vec<Curve> {
    if against.labels.is_empty() {
        return vec![against.curve.clone()];
    }
    let stroke =
        |(x, quantiles): &(f64, [f64; 3])| vec![(x - 0.25, *quantiles), (x + 0.25, *quantiles)];
    against.curve.iter().map(stroke).collect()
}

/// The field that was found, at each site.
fn field(residuals: &Residuals<'_>, map: Option<&SurfaceMap>) -> String {
    let (Some(map), false) = (map, residuals.field.is_empty()) else { return String::new() };
    let values = residuals.field.iter().map(|site| site.after).filter(|v| v.is_finite());
    let limit = values.fold(f64::MIN_POSITIVE, |most, v| most.max(v.abs()));
    let note =
        "<p class=\"note\">The field that was found: what it adds at each site, its median.</p>";
    note.to_owned()
        + &map.draw("the field that was found", &dots(residuals.field, residuals.unit, true), limit)
        + &colour_scale(limit, residuals.unit)
}

fn dots(sites: &[SiteResidual], unit: &str, is_after: bool) -> Vec<Dot> {
    let dot = |site: &SiteResidual| {
        let value = if is_after { site.after } else { site.before };
        let text = if value.is_finite() { tick(value) } else { "open".into() };
        let title = format!("{}: {text}{}", site.name, behind(unit));
        site.at.map(|at| Dot { at, value, title })
    };
    sites.iter().filter_map(dot).collect()
}

/// A round's evidence as a plot and a table.
fn round(number: usize, round: &TriedRound) -> String {
    let marks: Vec<(String, f64, bool)> =
        round.tried.iter().map(|t| (t.name.clone(), t.log_bf, t.is_taken)).collect();
    let mut html = match number {
        0 => String::new(),
        n => format!("<p><b>Round {}</b>, with what was found before in the model.</p>", n + 1),
    };
    html += &if marks.iter().any(|mark| mark.1.is_finite()) {
        evidence_plot(&round.nulls, &marks, round.claim)
    } else {
        "<p>The screen stopped every candidate.</p>".into()
    };
    let open = if round.tried.len() <= 12 { " open" } else { "" };
    let _ = write!(
        html,
        "<details{open}><summary>All {} candidates</summary><table class=\"tried\"><thead><tr><th class=\"text\">effect\
         <th class=\"text\">as declared<th>p of the screen<th>log BF<th>p of the search<th class=\"text\">verdict</thead><tbody>",
        round.tried.len()
    );
    for tried in &round.tried {
        let class = if tried.is_taken { " class=\"taken\"" } else { "" };
        let log_bf =
            if tried.log_bf.is_finite() { format!("{:.1}", tried.log_bf) } else { "–".into() };
        let p_null = tried.p_null.filter(|_| tried.log_bf.is_finite());
        let _ = writeln!(
            html,
            "<tr{class}><td class=\"text\">{}<td class=\"text\">{}<td>{}<td>{}<td>{}<td class=\"text\">{}",
            escape(&tried.name),
            escape(&tried.statement),
            probability(tried.p_screen),
            log_bf.replace('-', "−"),
            p_null.map_or("–".into(), probability),
            escape(&tried.verdict)
        );
    }
    html + "</tbody></table></details>"
}

fn probability(p: f64) -> String {
    if p < 0.001 { format!("{p:.0e}").replace('-', "−") } else { format!("{p:.3}") }
}

/// The lines of `after`, those that are not in `before` marked.
fn marked(before: &str, after: &str) -> String {
    let old: Vec<&str> = before.lines().collect();
    let line = |line: &str| {
        let text = escape(line);
        if line.is_empty() || old.contains(&line) { text } else { format!("<mark>{text}</mark>") }
    };
    after.lines().map(line).collect::<Vec<_>>().join("\n")
}

fn not_tried(columns: &[[String; 2]]) -> String {
    if columns.is_empty() {
        return "<p>Every column of the table that could be an effect was tried.</p>".into();
    }
    let item = |[column, why]: &[String; 2]| format!("<dt>{}<dd>{}", escape(column), escape(why));
    format!("<dl>{}</dl>", columns.iter().map(item).collect::<String>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_template_has_no_slot_that_nobody_fills() {
        let slots = PAGE.split("{{").skip(1).map(|part| part.split_once("}}").unwrap().0);
        for name in slots {
            assert!(include_str!("loop_page.rs").contains(&format!("\"{name}\",")), "{name}");
        }
    }

    #[test]
    fn new_lines_are_marked_and_escaped() {
        let text = marked("model\n  a ~ b", "model\n\n  a ~ b\n  c < d");
        assert_eq!(text, "model\n\n  a ~ b\n<mark>  c &lt; d</mark>");
    }
}
