//! `report.html` of an experiment on known truth: every map beside its truth, in small views and to turn.
//!
//! The small views are drawn by the viewer from the data that it shows large.

use std::io::Write as _;
use std::path::Path;

use super::html::{STYLE, VIEWER, answers, class_of, fill, scripts};
use super::text::escape;
use super::{ReportError, Surface};
use crate::diagnostics::verdict::Verdict;
use crate::store::write_file;

const PAGE: &str = include_str!("experiment.html");

/// What the page shows.
#[derive(Debug)]
pub struct ExperimentPage<'a> {
    /// Whether the draws can be relied on.
    pub verdict: &'a Verdict,
    /// Figures that are read first, with what they are.
    pub tiles: &'a [(String, String)],
    /// Small views.
    pub figures: &'a [Figure],
    /// All figures as lines of text.
    pub table: &'a str,
    /// Name and value of each setting.
    pub settings: &'a [(String, String)],
    /// The maps.
    pub surface: Surface<'a>,
}

/// Rows of small views.
#[derive(Debug)]
pub struct Figure {
    /// What they show.
    pub title: String,
    /// How to read them.
    pub note: String,
    /// Names of arrays of the surface, row by row.
    pub rows: Vec<Vec<String>>,
}

/// Writes the page.
///
/// # Errors
/// [`ReportError::PointData`] if an array has not one value per vertex; [`ReportError::Write`].
pub fn write_experiment_page(path: &Path, page: &ExperimentPage<'_>) -> Result<(), ReportError> {
    let tile = |(value, what): &(String, String)| {
        format!("<li><b>{}</b><span>{}</span></li>", escape(value), escape(what))
    };
    let term =
        |(name, value): &(String, String)| format!("<dt>{}<dd>{}", escape(name), escape(value));
    let slots = [
        ("style", STYLE.to_owned()),
        ("verdict", answers(page.verdict)),
        ("verdict_class", class_of(page.verdict.colour()).to_owned()),
        ("tiles", page.tiles.iter().map(tile).collect()),
        ("viewer", VIEWER.to_owned()),
        ("figures", page.figures.iter().map(figure).collect()),
        ("table", escape(page.table)),
        ("settings", page.settings.iter().map(term).collect()),
        ("scripts", scripts(path, &page.surface)?),
    ];
    let html = fill(PAGE, &slots);
    write_file(path, |file| file.write_all(html.as_bytes())).map_err(ReportError::write(path))
}

fn figure(figure: &Figure) -> String {
    let view = |name: &String| {
        let name = escape(name);
        format!(
            "<figure><figcaption>{name}</figcaption><canvas data-array=\"{name}\"></canvas><p class=\"note\"></p></figure>"
        )
    };
    let row = |names: &Vec<String>| {
        let views: String = names.iter().map(view).collect();
        format!("<div class=\"views\">{views}</div>\n")
    };
    let rows: String = figure.rows.iter().map(row).collect();
    let (title, note) = (escape(&figure.title), escape(&figure.note));
    format!("<section><h2>{title}</h2><p class=\"note\">{note}</p>{rows}</section>\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_template_has_no_slot_that_nobody_fills() {
        for part in PAGE.split("{{").skip(1) {
            let name = part.split_once("}}").unwrap().0;
            let filled = format!("(\"{name}\", ");
            assert!(include_str!("experiment_page.rs").contains(&filled), "{name}");
        }
    }

    #[test]
    fn names_are_escaped() {
        let one =
            Figure { title: "a<b".into(), note: String::new(), rows: vec![vec!["x\"y".into()]] };
        let html = figure(&one);
        assert!(html.contains("a&lt;b") && html.contains("data-array=\"x&quot;y\""), "{html}");
    }
}
