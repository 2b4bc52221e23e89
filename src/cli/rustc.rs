//! What the Rust compiler says about a model file, in the words of the model language.
//!
//! A wrong statement gives two errors: `model!`'s own, with the form that was expected, and one at the
//! token. Rust's other errors are told by their code and message; one that is not known here is
//! shown as it is.

use std::ops::Range;
use std::path::Path;

use serde::Deserialize;

use super::mistake::{Mistake, declarations, hint, missing_semicolon, position, row_name};
use super::models::ModelFile;

/// One error of rustc's `--error-format=json`.
#[derive(Deserialize)]
struct Diagnostic {
    message: String,
    level: String,
    code: Option<Code>,
    spans: Vec<Span>,
    children: Vec<Child>,
    rendered: Option<String>,
}

#[derive(Deserialize)]
struct Code {
    code: String,
}

#[derive(Deserialize)]
struct Child {
    level: String,
    message: String,
    spans: Vec<Span>,
}

#[derive(Deserialize)]
struct Span {
    file_name: String,
    byte_start: usize,
    byte_end: usize,
    is_primary: bool,
    label: Option<String>,
    suggested_replacement: Option<String>,
}

/// A line of cargo's `--message-format=json`.
#[derive(Deserialize)]
struct FromCargo {
    message: Diagnostic,
}

const NO_POINT: &str = "write the number with a decimal point: `x * 2.0` for `x * 2`";
const PLAIN_ON_THE_LEFT: &str = "a plain number or column goes on the right of a parameter or field: `x * 2.0` for `2.0 * x`, `-x + 1.0` for `1.0 - x`, `x.recip() * 2.0` for `2.0 / x`";

/// A line of the compiler's output.
fn parse(line: &str) -> Option<Diagnostic> {
    let from_cargo = serde_json::from_str::<FromCargo>(line).map(|m| m.message);
    from_cargo.or_else(|_| serde_json::from_str(line)).ok()
}

/// The compiler's output as it prints it itself.
pub(super) fn rendered(output: &str) -> String {
    let line = |line| parse(line).map_or(Some(format!("{line}\n")), |d| d.rendered);
    output.lines().filter_map(line).collect::<String>().trim_end().to_string()
}

/// The mistakes that the compiler's output tells of in the model file at `path`, each once.
pub(super) fn mistakes(output: &str, file: &ModelFile, path: &Path) -> Vec<Mistake> {
    let errors: Vec<Diagnostic> =
        output.lines().filter_map(parse).filter(|d| d.level == "error").collect();
    let is_place = |d: &Diagnostic| d.message.starts_with("no rules expected `");
    let mut found = vec![];
    for (i, error) in errors.iter().enumerate() {
        let place = errors.get(i + 1).filter(|next| is_place(next));
        let mistake = match place.and_then(|place| place.at(path)) {
            _ if is_place(error) => continue,
            Some(at) => Some(of_statement(&error.message, at, &file.source)),
            None => explain(error, path, &file.source),
        };
        found.extend(mistake.filter(|m| !found.contains(m)));
    }
    found
}

/// A statement that has none of the forms that `model!` knows.
fn of_statement(expected: &str, at: Range<usize>, source: &str) -> Mistake {
    if let Some(end) = missing_semicolon(source, at.start) {
        return Mistake::new("a `;` is missing", end, "it ends every statement: write it there");
    }
    let general = match expected {
        m if m.starts_with("unknown unit") => "write one of these, or leave the unit out",
        m if m.starts_with("a statement begins") => "write one of these words there",
        _ => "write the statement in this form",
    };
    let (at, help) = hint(source, &at).unwrap_or((at, general));
    Mistake::new(expected, at, help)
}

impl Diagnostic {
    /// The place in the model file: where the error is, else what else it points at.
    fn at(&self, path: &Path) -> Option<Range<usize>> {
        let own = || self.spans.iter().filter(|s| Path::new(&s.file_name) == path);
        let unclosed = own().find(|s| s.label.as_deref() == Some("unclosed delimiter"));
        let span = unclosed.or(own().find(|s| s.is_primary)).or(own().next())?;
        Some(span.byte_start..span.byte_end)
    }

    fn code(&self) -> &str {
        self.code.as_ref().map_or("", |c| &c.code)
    }

    fn label(&self) -> &str {
        let primary = self.spans.iter().find(|s| s.is_primary);
        primary.and_then(|s| s.label.as_deref()).unwrap_or_default()
    }

    /// What the compiler would write instead.
    fn suggestion(&self) -> Option<&str> {
        let helps = self.children.iter().filter(|c| c.level == "help");
        helps.flat_map(|c| &c.spans).find_map(|s| s.suggested_replacement.as_deref())
    }

    /// What to do about an error that is not known here.
    fn general_help(&self) -> String {
        match (self.suggestion(), &self.code) {
            (Some(text), _) if !text.trim().is_empty() => format!("write `{}`", text.trim()),
            (_, Some(code)) => format!("`rustc --explain {}` tells more", code.code),
            _ => "mend it there".into(),
        }
    }

    /// The function of `f64` that is called with numbers that carry derivatives.
    fn plain_function(&self, path: &Path) -> Option<Range<usize>> {
        if !self.label().contains("expected `f64`, found type parameter") {
            return None;
        }
        let callee =
            |s: &&Span| s.label.as_deref().is_some_and(|l| l.starts_with("arguments to this"));
        let callee = self.spans.iter().find(callee).map(|s| s.byte_start..s.byte_end);
        callee.or(self.at(path))
    }

    /// A field or `let` without its `(x)`: the compiler speaks of a closure.
    fn without_row(&self, path: &Path, source: &str) -> Option<Range<usize>> {
        if !self.message.contains("{closure@") {
            return None;
        }
        let labelled = |s: &&Span| s.label.as_deref().is_some_and(|l| l.starts_with("{closure@"));
        let operand = self.spans.iter().find(labelled).map(|s| s.byte_start..s.byte_end);
        let at = operand.or(self.at(path))?;
        let text = source.get(at.clone())?;
        let mut words = text.split(|c: char| !(c.is_alphanumeric() || c == '_'));
        let name = words.find(|w| !declarations(source, w).is_empty())?;
        let within = position(text, name)?;
        Some(at.start + within.start..at.start + within.end)
    }

    /// The first name that the message puts in backticks.
    fn quoted(&self) -> &str {
        self.message.split('`').nth(1).unwrap_or_default()
    }
}

/// An error of the Rust compiler; `None` where it is not about the model file.
fn explain(d: &Diagnostic, path: &Path, source: &str) -> Option<Mistake> {
    if let "E0428" | "E0124" = d.code() {
        let second = declarations(source, d.quoted()).into_iter().nth(1)?;
        let message = format!("`{}` is declared twice", d.quoted());
        return Some(Mistake::new(message, second, "give one of them another name"));
    }
    let at = d.at(path)?;
    if let Some((message, help)) = reworded(d, source, &at) {
        return Some(Mistake::new(message, at, help));
    }
    if let Some(function) = d.plain_function(path) {
        let name = source.get(function.clone())?;
        let message = format!("`{name}` takes an f64, which carries no derivatives");
        let help =
            format!("write `fn {name}<D: Real>(x: D) -> D`, with plain numbers on the right");
        return Some(Mistake::new(message, function, help));
    }
    if let Some(at) = d.without_row(path, source) {
        let (name, row) = (source.get(at.clone())?, row_name(source, at.start).unwrap_or("x"));
        let message = format!("`{name}` is used without its row");
        return Some(Mistake::new(message, at, format!("write `{name}({row})`")));
    }
    let is_ours = d.spans.iter().any(|s| s.is_primary && Path::new(&s.file_name) != path);
    let (label, help) =
        if is_ours { ("", d.label().into()) } else { (d.label(), d.general_help()) };
    Some(Mistake { label: label.into(), ..Mistake::new(plain(&d.message), at, help) })
}

/// Message and help for an error that is already at the right place.
fn reworded(d: &Diagnostic, source: &str, at: &Range<usize>) -> Option<(String, String)> {
    let (name, found) = (d.quoted(), source.get(at.clone())?);
    if let Some(operation) = d.label().strip_prefix("no implementation for `") {
        let message = ["`f64`", "`{float}`", "`{integer}`"]
            .iter()
            .fold(d.message.replace("`D`", "a parameter or field"), |m, t| {
                m.replace(t, "a plain number")
            });
        let is_integer = operation.ends_with("{integer}`");
        return Some((message, (if is_integer { NO_POINT } else { PLAIN_ON_THE_LEFT }).into()));
    }
    match d.code() {
        "E0425" | "E0412" => Some((format!("unknown name `{name}`"), unknown(d, source, at.start))),
        "E0609" if ["::Row`", "::Data<"].iter().any(|t| d.message.contains(t)) => {
            let note = d.children.iter().find(|c| c.message.starts_with("available field"));
            let known =
                note.and_then(|c| c.message.split_once(": ")).map_or("none", |(_, names)| names);
            let help = format!("declare it: `column {name} [unit];` (declared are: {known})");
            Some((format!("no column `{name}` is declared"), help))
        }
        "E0061" => {
            let arguments = d.suggestion().filter(|s| s.starts_with('('))?;
            let arguments = arguments.replace("/* ", "").replace(" */", "");
            let message = d.message.replace("this function", &format!("`{found}`"));
            Some((message, format!("write `{found}{arguments}`")))
        }
        _ if d.message.contains("closing delimiter")
            || d.message.contains("unclosed delimiter") =>
        {
            Some(("this bracket is not closed".into(), "close it, or take it out".into()))
        }
        _ if d.message.starts_with("cannot find macro `model`") => {
            Some((d.message.clone(), "begin the file with `use eplat::prelude::*;`".into()))
        }
        _ => None,
    }
}

/// What to do about a name that nothing declares.
fn unknown(d: &Diagnostic, source: &str, at: usize) -> String {
    let name = d.quoted();
    let line = |at: usize| source[..at].matches('\n').count() + 1;
    if let Some(below) = declarations(source, name).into_iter().find(|b| b.start > at) {
        return format!(
            "it is declared below, in line {}: put that statement above this one",
            line(below.start)
        );
    }
    if d.message.starts_with("cannot find type") {
        return "what is observed is a Bracket, a Number or a Count".into();
    }
    if let Some(similar) = d.suggestion() {
        return format!("did you mean `{similar}`?");
    }
    format!(
        "declare it above: `param {name} ~ PRIOR;`, `let {name}(x) = …;`, in the field's `where {{ … }}`, or as a function outside `model!`"
    )
}

/// A message without the paths and type parameters of this program.
fn plain(message: &str) -> String {
    ["eplat::dist::", "eplat::likelihood::", "eplat::field::", "eplat::num::", "<_>", "<D>"]
        .iter()
        .fold(message.to_string(), |text, part| text.replace(part, ""))
}
