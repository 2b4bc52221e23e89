//! `report.html`: one run as one file that needs no network.
//!
//! The page is `page.html` with its slots filled; the fields are drawn by the scripts in `viewer` with the three.js
//! bundle of `assets/three`, or without WebGL on a plain canvas.

use std::fmt::Write as _;
use std::io::{self, Write as _};
use std::path::Path;

use super::end_of_run::leave_one_out_figures;
use super::files::{linked, list};
use super::packed::packed;
use super::predicted::section;
use super::svg::{k_plot, rank_plot, trace_plot};
use super::table::{HEAVY_TAIL, Line, TITLES, lines};
use super::text::{escape, shown};
use super::{
    Group, LeaveOneOut, LooRow, Predictions, Provenance, ReportError, Row, RunRecord,
    SettingsRecord, Values, Variable, verdict,
};
use crate::diagnostics::verdict::{Answer, Colour, Verdict};
use crate::mesh::{Axes, TriMesh};
use crate::store::write_file;

const PAGE: &str = include_str!("page.html");
pub(super) const STYLE: &str = include_str!("page.css");
pub(super) const VIEWER: &str = include_str!("viewer/viewer.html");
/// One function around all files, so that none of their names reaches the page.
const SCRIPT: &str = concat!(
    "\"use strict\";\n(async () => {\n",
    include_str!("viewer/decode.js"),
    include_str!("viewer/colours.js"),
    include_str!("viewer/threshold.js"),
    include_str!("viewer/camera.js"),
    include_str!("viewer/webgl.js"),
    include_str!("viewer/raster.js"),
    include_str!("viewer/pane.js"),
    include_str!("viewer/main.js"),
    "})().catch((error) => { document.getElementById(\"trouble\").textContent = `The maps cannot be shown: ${error.message}`; });\n"
);
const THREE: &str = include_str!("../../assets/three/three.bundle.min.js");
/// More scalars than this are too many to look at; the page says how many are left out.
const MOST_TRACES: usize = 16;

/// What the page shows.
#[derive(Debug)]
pub struct Page<'a> {
    /// Title, e.g. the model's documentation line.
    pub title: &'a str,
    /// The model as equations, shown as it is.
    pub equations: &'a str,
    /// What was run.
    pub record: &'a RunRecord,
    /// Summaries of all quantities.
    pub rows: &'a [Row],
    /// Draws; each variable with the dimensions chain and draw alone gets a trace and a rank plot.
    pub posterior: &'a Group,
    /// How well each measurement is predicted from the others, if that is known.
    pub loo: Option<&'a LeaveOneOut>,
    /// Every measurement beside what is predicted of it; without any, nothing could be predicted.
    pub predictions: &'a Predictions,
    /// Names of the files in the folder of the page: they are links.
    pub files: &'a [&'a str],
    /// The fields, if the model has any.
    pub surface: Option<Surface<'a>>,
}

/// A surface with data to show on it.
#[derive(Debug)]
pub struct Surface<'a> {
    /// The surface.
    pub mesh: &'a TriMesh,
    /// Arrays over its vertices; the first is shown at first.
    pub point_data: &'a [PointData<'a>],
    /// Measurement sites, mm.
    pub sites: &'a [[f64; 3]],
    /// Where its coordinates point: the standard views are named by it.
    pub axes: Axes,
}

/// One array over the vertices.
#[derive(Debug)]
pub struct PointData<'a> {
    /// Name, e.g. `tau_out_mean`.
    pub name: &'a str,
    /// Unit, empty if none.
    pub unit: &'a str,
    /// One value per vertex; NaN is shown grey.
    pub values: &'a [f64],
}

/// Writes the page.
///
/// # Errors
/// [`ReportError::PointData`] if an array has not one value per vertex; [`ReportError::Write`].
pub fn write_html(path: &Path, page: &Page<'_>) -> Result<(), ReportError> {
    let (scripts, surface_class) = match &page.surface {
        Some(surface) => (scripts(path, surface)?, ""),
        None => (String::new(), "absent"),
    };
    let verdict = verdict(page.record, page.rows);
    let absent = |is_there: bool| if is_there { "" } else { "absent" }.to_owned();
    let slots = [
        ("title", escape(page.title)),
        ("provenance", provenance(page.record)),
        ("style", STYLE.to_owned()),
        ("verdict", answers(&verdict)),
        ("verdict_class", class_of(verdict.colour()).to_owned()),
        ("surface_class", surface_class.to_owned()),
        ("viewer", VIEWER.to_owned()),
        ("equations", escape(page.equations)),
        ("summary", table(&lines(page.rows, false))),
        ("every_summary", table(&lines(page.rows, true))),
        ("traces", traces(page.posterior, page.files).map_err(ReportError::write(path))?),
        ("loo_class", absent(page.loo.is_some())),
        ("predicted_class", absent(!page.predictions.rows.is_empty())),
        ("predicted", predicted(page)),
        ("predicted_file", linked("rows.csv", page.files)),
        ("fields_file", linked("fields.vtp", page.files)),
        ("files_class", absent(!page.files.is_empty())),
        ("files", list(page.files)),
        ("loo", page.loo.map_or(String::new(), leave_one_out)),
        ("run", run(page.record)),
        ("scripts", scripts),
    ];
    let html = fill(PAGE, &slots);
    write_file(path, |file| file.write_all(html.as_bytes())).map_err(ReportError::write(path))
}

/// How an answer of this colour looks.
pub(super) fn class_of(colour: Colour) -> &'static str {
    match colour {
        Colour::Green => "good",
        Colour::Amber => "doubtful",
        Colour::Red => "bad",
    }
}

/// Every question with its answer and what to do.
pub(super) fn answers(verdict: &Verdict) -> String {
    let mut html = format!("<b>Verdict: {}</b><dl class=\"answers\">", verdict.colour());
    for Answer { question, colour, sentence, details, remedy } in &verdict.answers {
        let class = class_of(*colour);
        let _ = write!(
            html,
            "<dt>{question} <span class=\"{class}\">{colour}</span><dd>{}",
            escape(sentence)
        );
        for detail in details {
            let _ = write!(html, "<br>· {}", escape(detail));
        }
        if let Some(remedy) = remedy {
            let _ = write!(html, "<br>→ {}", escape(remedy));
        }
    }
    html + "</dl>"
}

/// Replaces each `{{name}}` of the template once; what a slot holds is not searched again.
pub(super) fn fill(template: &str, slots: &[(&str, String)]) -> String {
    let mut parts = template.split("{{");
    let mut filled = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let (name, rest) = part.split_once("}}").unwrap_or((part, ""));
        let slot = slots.iter().find(|(slot, _)| *slot == name);
        filled += slot.map_or("", |(_, content)| content);
        filled += rest;
    }
    filled
}

fn table(lines: &[Line]) -> String {
    let title = |(column, title): (usize, &str)| match column {
        0 | 1 => format!("<th class=\"text\">{title}"),
        _ => format!("<th>{title}"),
    };
    let titles: String = TITLES.into_iter().enumerate().map(title).collect();
    let mut html = format!("<table class=\"summary\"><thead><tr>{titles}<th></thead><tbody>");
    for line in lines {
        let class = if line.suspect { " class=\"suspect\"" } else { "" };
        let _ = write!(html, "<tr{class}>");
        for (column, cell) in line.cells.iter().enumerate() {
            let class = if column < 2 { " class=\"text\"" } else { "" };
            let _ = write!(html, "<td{class}>{}", escape(cell));
        }
        let _ = writeln!(html, "<td>{}", line.marks());
    }
    html += "</tbody></table>";
    if lines.iter().any(|line| line.heavy) {
        let _ = write!(html, "<p class=\"note\">{HEAVY_TAIL}.</p>");
    }
    html
}

fn predicted(page: &Page<'_>) -> String {
    let Predictions { rows, .. } = page.predictions;
    if rows.is_empty() { String::new() } else { section(page.predictions) }
}

fn traces(posterior: &Group, files: &[&str]) -> io::Result<String> {
    let is_scalar = |v: &&Variable| {
        v.dims.len() == 2 && matches!(v.values, Values::Float(_) | Values::Columns(_))
    };
    let scalars: Vec<&Variable> = posterior.variables.iter().filter(is_scalar).collect();
    let mut html = String::new();
    for variable in scalars.iter().take(MOST_TRACES) {
        let Some(values) = variable.values.floats()? else { continue };
        let chains: Vec<&[f64]> = values.chunks(variable.dims[1].1.max(1)).collect();
        let (name, unit) = (escape(&variable.name), escape(shown(&variable.unit)));
        let (trace, ranks) = (trace_plot(&chains), rank_plot(&chains));
        let _ = writeln!(
            html,
            "<figure><figcaption>{name} <span>{unit}</span></figcaption>{trace}{ranks}</figure>"
        );
    }
    if scalars.len() > MOST_TRACES {
        let more = scalars.len() - MOST_TRACES;
        let file = linked("posterior.zarr", files);
        let _ = write!(html, "<p class=\"note\">{more} more scalar parameters are in {file}.</p>");
    }
    Ok(html)
}

/// Pareto k of every measurement as a plot and, the worst first, as a table. Marked are those that cannot be told.
fn leave_one_out(loo: &LeaveOneOut) -> String {
    let threshold = loo.record.k_threshold;
    let point = |row: &LooRow| (escape(&row.name()), row.pareto_k, row.is_untold(threshold));
    let points: Vec<_> = loo.rows.iter().map(point).collect();
    let mut html = format!(
        "<p>{}.</p>{}<details><summary>Every measurement</summary><table><thead><tr><th class=\"text\">measurement\
         <th>observed<th>elpd<th class=\"text\">left out by<th>Pareto k</thead><tbody>",
        escape(&leave_one_out_figures(&loo.record)),
        k_plot(&points, threshold)
    );
    let mut rows: Vec<&LooRow> = loo.rows.iter().collect();
    rows.sort_by(|a, b| b.pareto_k.total_cmp(&a.pareto_k));
    for row in rows {
        let class = if row.is_untold(threshold) { " class=\"suspect\"" } else { "" };
        let observed = escape(&row.observed.replace(' ', " … "));
        let _ = writeln!(
            html,
            "<tr{class}><td class=\"text\">{}<td>{observed}<td>{:.2}<td class=\"text\">{}<td>{:.2}",
            escape(&row.name()),
            row.elpd,
            row.loo_by.name(),
            row.pareto_k
        );
    }
    html + "</tbody></table></details>"
}

/// What was fitted to what, when, by which version and command.
fn provenance(record: &RunRecord) -> String {
    let Provenance { mesh, n_vertices, data, n_rows, n_sites, command, date, .. } =
        &record.provenance;
    let how = match record.settings.sampler.as_str() {
        "prior" => "Draws from the prior, laid out on",
        "laplace" => "A normal approximation of the posterior, given",
        _ => "Fitted to",
    };
    let count = |n: usize, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
    let mut text = format!("{how} <b>{}</b>: {}", escape(data), count(*n_rows, "measurement"));
    if let Some(mesh) = mesh {
        let (sites, mesh) = (count(*n_sites, "site"), escape(mesh));
        let _ = write!(text, " at {sites} of <b>{mesh}</b> ({n_vertices} vertices)");
    }
    let _ = write!(text, ".<br>{} · eplat {}", escape(date), escape(&record.version));
    if !command.is_empty() {
        let _ = write!(text, " · <code>{}</code>", escape(command));
    }
    text
}

/// The record as a list of terms.
fn run(record: &RunRecord) -> String {
    let (settings, seconds) = (&record.settings, &record.seconds);
    let mut terms = vec![
        ("model", record.model.clone()),
        ("eplat", record.version.clone()),
        ("seed", record.seed.to_string()),
        (
            "chains",
            format!(
                "{} × ({} warm-up + {} draws)",
                settings.chains, settings.warmup, settings.draws
            ),
        ),
        ("sampler", sampler(settings)),
        ("parameters", record.n_params.to_string()),
        (
            "gradients",
            format!(
                "{} at {:.0} ns, and {:.0} ns of the sampler's own",
                record.grad_evals, record.ns_per_grad, record.sampler_ns_per_grad
            ),
        ),
        ("ESS per second", format!("{:.0}", record.ess_per_second)),
        ("E-BFMI", format!("{:.2}", record.e_bfmi)),
        (
            "seconds",
            format!(
                "{:.2} (compile {:.2}, setup {:.2}, warm-up {:.2}, sampling {:.2})",
                seconds.total, seconds.compile, seconds.setup, seconds.warmup, seconds.sampling
            ),
        ),
    ];
    if let Some(strays) = &record.strays {
        terms.push(("chains disagree", strays.clone()));
    }
    if !record.divergent_at.is_empty() {
        terms.push(("divergences come from", record.divergent_at.join(", ")));
    }
    for failed in &record.failed_chains {
        terms.push(("failed", failed.clone()));
    }
    for (field, rmse) in record.rmse.iter().flatten() {
        terms.push(("RMSE against the truth", format!("{field} {rmse:.2}")));
    }
    for (field, [half, ninety, most]) in record.coverage.iter().flatten() {
        let shares = [half, ninety, most].map(|x| format!("{:.0}", 100.0 * x)).join(", ");
        terms.push(("truth within 50, 90, 95 %", format!("{field} {shares} %")));
    }
    for (input, hash) in &record.hashes {
        terms.push(("SHA-256", format!("{input} {hash}")));
    }
    let term = |(name, value): &(&str, String)| format!("<dt>{name}<dd>{}", escape(value));
    terms.iter().map(term).collect::<Vec<_>>().join("\n")
}

/// How the draws were made, with the settings that mattered.
fn sampler(settings: &SettingsRecord) -> String {
    let target = match settings.target_accept {
        Some(target) => format!(", target acceptance {target}"),
        None => String::new(),
    };
    match settings.sampler.as_str() {
        "nuts" => format!("NUTS{target}, {} metric", settings.metric),
        "integrated" => "integrated".to_owned(),
        "blocked" => format!("blocked{target}"),
        "laplace" => "none: normal approximation at the mode".to_owned(),
        other => format!("none: {other}"),
    }
}

/// The data of the viewer, three.js and the viewer, as script elements of the page at `path`.
pub(super) fn scripts(path: &Path, surface: &Surface<'_>) -> Result<String, ReportError> {
    // `<` cannot end the element early when it is written as an escape, which JSON allows in any text.
    let data = packed(path, surface)?.to_string().replace('<', "\\u003c");
    Ok(format!(
        "<script type=\"application/json\" id=\"data\">{data}</script>\n\
         <script>{THREE}</script>\n<script>{SCRIPT}</script>"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_template_has_no_slot_that_nobody_fills() {
        let slots: Vec<&str> =
            PAGE.split("{{").skip(1).map(|part| part.split_once("}}").unwrap().0).collect();
        for name in slots {
            assert!(include_str!("html.rs").contains(&format!("(\"{name}\", ")), "{name}");
        }
    }

    #[test]
    fn the_bundle_exports_what_the_viewer_uses() {
        let exports = include_str!("../../assets/three/entry.js");
        for part in SCRIPT.split("THREE.").skip(1) {
            let name: String = part.chars().take_while(char::is_ascii_alphanumeric).collect();
            let listed = exports.contains(&format!("  {name},"))
                || exports.contains(&format!("{{ {name} }}"));
            // In the bundle an export is `name:()=>minified`.
            assert!(listed && THREE.contains(&format!("{name}:()=>")), "{name}");
        }
    }
}
