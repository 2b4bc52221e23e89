//! A mistake in a model file as it is shown: what is wrong, the place in the file's text, what to do.

use std::fmt::Write as _;
use std::ops::Range;

use super::models::ModelFile;
use crate::model::ModelError;

/// One mistake.
#[derive(Debug, PartialEq)]
pub(super) struct Mistake {
    /// What is wrong, in one line.
    pub(super) message: String,
    /// Where, in bytes of the file's text.
    pub(super) at: Option<Range<usize>>,
    /// A remark beside the place.
    pub(super) label: String,
    /// What to do.
    pub(super) help: Option<String>,
}

impl Mistake {
    /// A mistake at a known place.
    pub(super) fn new(
        message: impl Into<String>,
        at: Range<usize>,
        help: impl Into<String>,
    ) -> Self {
        let (message, help) = (message.into(), Some(help.into()));
        Self { message, at: Some(at), label: String::new(), help }
    }

    /// A model that contradicts itself; `None` where the error has no place in the model file.
    pub(super) fn of_model(error: &ModelError, source: &str) -> Option<Self> {
        let (statement, expression) = error.place()?;
        let text = error.to_string();
        let (message, help) = text.split_once("\nhelp: ").unwrap_or((&text, ""));
        Some(Self {
            message: message.into(),
            at: find(source, &statement, expression),
            label: String::new(),
            help: Some(help.into()),
        })
    }

    /// As rustc shows errors, without what only a Rust programmer would read.
    pub(super) fn show(&self, file: &ModelFile) -> String {
        let (mut out, path) = (self.message.clone(), file.path.display());
        match self.at.as_ref().and_then(|at| Some((at, file.source.get(..at.start)?))) {
            Some((at, before)) => {
                let (row, start) = (before.matches('\n').count() + 1, line_start(before));
                let line = file.source[start..].lines().next().unwrap_or_default();
                let column = before[start..].chars().count();
                let end = (at.end - start).min(line.len()).max(at.start - start);
                let marked =
                    line.get(at.start - start..end).map_or(1, |t| t.chars().count()).max(1);
                let gutter = " ".repeat(row.to_string().len());
                let _ = write!(
                    out,
                    "\n{gutter}--> {path}:{row}:{}\n{gutter} |\n{row} | {line}\n",
                    column + 1
                );
                let carets = "^".repeat(marked);
                let marks = format!("{gutter} | {:column$}{carets} {}", "", self.label);
                out.push_str(marks.trim_end());
            }
            None => out = format!("{path}: {out}"), // the statement is not in this file's text
        }
        if let Some(help) = &self.help {
            let _ = write!(out, "\nhelp: {help}");
        }
        out
    }
}

fn line_start(before: &str) -> usize {
    before.rfind('\n').map_or(0, |i| i + 1)
}

/// What statements begin with.
const KEYWORDS: [&str; 7] = ["param", "field", "let", "column", "observe", "effect", "density"];

/// Where `expression` stands in the statement that begins with `head`, else where that head stands.
fn find(source: &str, head: &str, expression: &str) -> Option<Range<usize>> {
    let source = &code(source);
    let head = position(source, head)?;
    let rest = &source[head.end..];
    let statement = &rest[..next_statement(rest)];
    let within = position(statement, expression);
    Some(within.map_or(head.clone(), |at| head.end + at.start..head.end + at.end))
}

/// Names behind a statement's keyword: where `name` is declared, in order.
pub(super) fn declarations(source: &str, name: &str) -> Vec<Range<usize>> {
    let source = &code(source);
    let tokens: Vec<_> = tokens(source).collect();
    let declares = |w: &&[(usize, &str)]| KEYWORDS.contains(&w[0].1) && w[1].1 == name;
    tokens.windows(2).filter(declares).map(|w| w[1].0..w[1].0 + name.len()).collect()
}

/// What the statement around byte `at` calls its row: `x` in `let erp(x) = …`.
pub(super) fn row_name(source: &str, at: usize) -> Option<&str> {
    let before: Vec<_> = tokens(source.get(..at)?).collect();
    let keyword = before.iter().rposition(|(_, token)| KEYWORDS.contains(token))?;
    let &[(_, "("), (_, row)] = before.get(keyword + 2..keyword + 4)? else { return None };
    Some(row)
}

/// The last token of the statement around byte `at` if it is not the `;` that should stand there.
pub(super) fn missing_semicolon(source: &str, at: usize) -> Option<Range<usize>> {
    let source = &code(source);
    let statement = &source[at..at + next_statement(&source[at..])];
    let (last, token) = tokens(statement).last()?;
    (token != ";" && token != "}").then(|| at + last..at + last + token.len())
}

/// What a statement lacks, and where, if it can be told from its tokens; `at` is its name.
pub(super) fn hint(source: &str, at: &Range<usize>) -> Option<(Range<usize>, &'static str)> {
    let source = &code(source);
    let keyword = tokens(&source[..at.start]).last().map_or("", |(_, token)| token);
    let statement = &source[at.start..at.start + next_statement(&source[at.start..])];
    let has = |token| tokens(statement).any(|(_, t)| t == token);
    let here = |token| position(statement, token).map(|p| at.start + p.start..at.start + p.end);
    let hyper =
        statement.split_once('{').map_or("", |(_, rest)| rest.split('}').next().unwrap_or(""));
    let no_prior = hyper.split(';').find(|h| !h.trim().is_empty() && !h.contains('~'));
    match keyword {
        _ if tokens(statement).nth(1).is_some_and(|(_, t)| t == "[")
            && has("(")
            && keyword != "param" =>
        {
            Some((
                here("[")?,
                "round brackets hold what it varies over, square brackets its unit: `(x) [ms]`",
            ))
        }
        "param" if !has("~") => {
            Some((at.clone(), "give it a prior: `~ HalfNormal(5.0)`, for instance"))
        }
        "field" if !has("K") => {
            Some((here("gp")?, "say how many modes the term has: `gp(Rbf(rho), K = 24)`"))
        }
        "field" if !has("where") => {
            Some((here("{")?, "the hyperparameters follow the word `where`"))
        }
        "field" => Some((
            here(no_prior?.trim())?,
            "give every hyperparameter a prior: `rho [mm] ~ InvGamma(1.0, 50.0);`",
        )),
        "observe" if !has(":") => {
            Some((at.clone(), "say what is measured: `: Bracket`, `: Number` or `: Count`"))
        }
        _ => None,
    }
}

/// The text with its comments blanked out.
pub(super) fn code(source: &str) -> String {
    let blank = |line: &str| match line.find("//") {
        Some(i) => format!("{}{}", &line[..i], " ".repeat(line.len() - i)),
        None => line.to_string(),
    };
    source.split('\n').map(blank).collect::<Vec<_>>().join("\n")
}

/// Where the statement that `text` begins in ends: at the next one, or at the end of the model.
fn next_statement(text: &str) -> usize {
    let mut depth = 0;
    let is_end = |&(_, token): &(usize, &str)| {
        let here = depth;
        depth += i32::from(token == "{") - i32::from(token == "}");
        here == 0 && (token == "}" || KEYWORDS.contains(&token))
    };
    tokens(text).find(is_end).map_or(text.len(), |(at, _)| at)
}

/// Where the tokens of `wanted` first stand in `text`.
pub(super) fn position(text: &str, wanted: &str) -> Option<Range<usize>> {
    let text: Vec<_> = tokens(text).collect();
    let wanted: Vec<_> = tokens(wanted).map(|(_, token)| token).collect();
    let mut windows = text.windows(wanted.len().max(1));
    let found = windows.find(|w| w.iter().map(|(_, token)| token).eq(wanted.iter()))?;
    let (first, (last, token)) = (found.first()?.0, found.last()?);
    Some(first..last + token.len())
}

/// Identifiers, numbers and single signs, each with its place.
fn tokens(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    let mut at = 0;
    std::iter::from_fn(move || {
        at += text[at..].find(|c: char| !c.is_whitespace())?;
        let rest = &text[at..];
        let first = rest.chars().next()?;
        let length = if is_word(first) {
            rest.find(|c| !is_word(c)).unwrap_or(rest.len())
        } else {
            first.len_utf8()
        };
        at += length;
        Some((at - length, &rest[..length]))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const MODEL: &str = "model! { // let erp(x) is below
    model M;
    field f(x) [ms] = m + alpha * gp(Rbf( rho ), K = 24) where { m ~ Flat; rho ~ Flat; }
    let erp(x) = f(x)
        * 2.0 // twice
    /// Seen.
    observe y(x): Number ~ Normal(erp(x), 1.0)
}
fn twice(x: f64) -> f64 { x }
";

    fn at(range: Option<Range<usize>>) -> &'static str {
        &MODEL[range.unwrap()]
    }

    #[test]
    fn expressions_are_found_whatever_blanks_and_comments_stand_between() {
        assert_eq!(at(find(MODEL, "let erp", "f(x)*2.0")), "f(x)\n        * 2.0");
        assert_eq!(at(find(MODEL, "field f", "Rbf(rho)")), "Rbf( rho )");
        assert_eq!(at(find(MODEL, "field f", "twice(x)")), "field f"); // not of this statement
        assert_eq!(find(MODEL, "let g", "f(x)"), None);
        assert_eq!(declarations(MODEL, "erp").len(), 1);
        assert_eq!(row_name(MODEL, MODEL.find("erp(x), 1.0").unwrap()), Some("x"));
    }

    #[test]
    fn the_end_of_a_statement_is_where_its_semicolon_is_missed() {
        let missing = |name| missing_semicolon(MODEL, MODEL.find(name).unwrap());
        assert_eq!(at(missing("erp(x) = ")), "0"); // of 2.0
        assert_eq!(at(missing("y(x)")), ")");
        assert_eq!(missing("f(x) [ms]"), None);
    }
}
