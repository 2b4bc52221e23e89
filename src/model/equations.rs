//! A model as equations: what `eplat show` prints and the report's first page holds.

use std::fmt::Write as _;

use super::model::{Model, Statement};
use crate::dist::Support;

/// The model as equations, with parameters, units and supports.
pub fn equations(model: &Model) -> String {
    let mut out = format!("{}\n", model.name);
    for line in model.doc.lines().filter(|l| !l.trim().is_empty()) {
        let _ = writeln!(out, "  {}", line.trim());
    }
    let of = |keyword: &str| -> Vec<&Statement> {
        model.statements.iter().filter(|s| s.keyword == keyword).collect()
    };
    let section = |out: &mut String, title: &str, keyword: &str| {
        if !of(keyword).is_empty() {
            let _ = writeln!(out, "\n{title}");
        }
        for statement in of(keyword) {
            line(out, model, statement);
        }
    };
    section(&mut out, "Columns of the table", "column");
    section(&mut out, "Parameters", "param");
    section(
        &mut out,
        "Fields on the surface (GP: Σ η_k √S(√λ_k) φ_k(x), η_k ~ Normal(0, 1))",
        "field",
    );
    section(&mut out, "Derived", "let");
    section(&mut out, "Effects", "effect");
    section(&mut out, "Log densities", "density");
    section(&mut out, "Measurements", "observe");
    out
}

fn line(out: &mut String, model: &Model, s: &Statement) {
    for doc in s.decl.doc.lines().filter(|l| !l.trim().is_empty()) {
        let _ = writeln!(out, "  # {}", doc.trim());
    }
    let unit = unit(s.decl.unit);
    let text = tidy(s.decl.text);
    let range = s.range.map_or(String::new(), |(a, b)| format!("    expected in {a} to {b}{unit}"));
    let name = s.decl.name;
    let over = over(s.decl.over);
    match s.keyword {
        "column" => {
            let _ = writeln!(out, "  {name}{over}{unit}");
        }
        "param" => parameter_line(out, model, name, &over, 2),
        "effect" => {
            let _ = writeln!(out, "  {name}{unit} {text}");
        }
        "observe" => {
            let (kind, likelihood) = text.split_once(" ~ ").unwrap_or(("", &text));
            let (kind, from) = kind.split_at(kind.find(" from ").unwrap_or(kind.len()));
            let _ = writeln!(out, "  {name}{over}: {kind}{unit}{from} ~ {likelihood}");
        }
        "field" => {
            let _ = writeln!(out, "  {name}{over}{unit} = {text}{range}");
            for p in &model.parameters {
                if p.name.starts_with(&format!("{name}."))
                    && !p.name.starts_with(&format!("{name}.eta"))
                {
                    parameter_line(out, model, &p.name, "", 6);
                }
            }
        }
        "density" => {
            let _ = writeln!(out, "  ln p += {text}    ({name})");
        }
        _ => {
            let _ = writeln!(out, "  {name}{over}{unit} = {text}{range}");
        }
    }
}

fn parameter_line(out: &mut String, model: &Model, name: &str, over: &str, indent: usize) {
    let Some(p) = model.parameters.iter().find(|p| p.name == name) else { return };
    let short = name.rsplit('.').next().unwrap_or(name);
    let support = match p.support {
        Support::Real => "real".into(),
        Support::Positive => "positive".into(),
        Support::Interval(a, b) => format!("in ({a}, {b})"),
        Support::Between => "between its bounds".into(),
        Support::Simplex => "positive, sum 1".into(),
        Support::Ordered => "increasing".into(),
        Support::Described(words) => words.into(),
    };
    let head = format!("{short}{over}{}", unit(&p.unit));
    let _ = writeln!(out, "{:indent$}{head:<16} ~ {:<24} {support}", "", tidy(&p.prior));
}

fn over(over: &str) -> String {
    if over.is_empty() { String::new() } else { format!("({over})") }
}

fn unit(unit: &str) -> String {
    if unit.is_empty() { String::new() } else { format!(" [{unit}]") }
}

/// The compiler prints an expression's tokens with blanks where a person would not.
pub(super) fn tidy(text: &str) -> String {
    let mut out = text.split_whitespace().collect::<Vec<_>>().join(" ");
    for (from, to) in [
        (" :: ", "::"),
        (" (", "("),
        ("( ", "("),
        (" )", ")"),
        (" ,", ","),
        (" . ", "."),
        (" ;", ";"),
        (")+", ") +"),
    ] {
        out = out.replace(from, to);
    }
    for operator in ["+", "*", "-", "/", "=", "~"] {
        out = out.replace(&format!("{operator}("), &format!("{operator} ("));
    }
    out
}
