//! The augmented model as a model file: the user's own text with the effects that were found.

use std::fmt::Write as _;

use crate::model::{AddedEffect, outlying};

/// `source` with these effects declared at the end of its model, each under a line that says why, and its
/// likelihoods within `Outliers(…, share, sd)` if there are outliers; `None` if no `model! { … }` is found in it.
pub fn rewrite(
    source: &str,
    effects: &[(AddedEffect, String)],
    outliers: Option<(f64, f64)>,
) -> Option<String> {
    let source = match outliers {
        Some((share, sd)) => with_outliers(source, share, sd)?,
        None => source.to_owned(),
    };
    let end = end_of_model(&source)?;
    let (before, after) = source.split_at(end);
    let mut text = before.trim_end().to_owned();
    text.push('\n');
    for (effect, why) in effects {
        let _ = write!(text, "\n    /// {why}\n    {}\n", effect.statement());
    }
    Some(text + after)
}

/// `source` with the likelihood of every `observe` of its model within `Outliers(…)`.
fn with_outliers(source: &str, share: f64, sd: f64) -> Option<String> {
    let code = blank_comments_and_strings(source);
    let (begin, end) = (code.find("model!")?, end_of_model(source)?);
    let (mut text, mut done) = (String::new(), 0);
    for (at, _) in code[begin..end].match_indices("observe ") {
        let tilde = begin + at + code[begin + at..end].find('~')? + 1;
        let semicolon = tilde + code[tilde..end].find(';')?;
        text += &source[done..tilde];
        text += " ";
        text += &outlying(&source[tilde..semicolon], share, sd);
        done = semicolon;
    }
    Some(text + &source[done..])
}

/// Where the bracket that closes `model! { … }` stands.
fn end_of_model(source: &str) -> Option<usize> {
    let code = blank_comments_and_strings(source);
    let begin = code.find("model!")?;
    let open = begin + code[begin..].find(['{', '('])?;
    let mut depth = 0usize;
    for (i, c) in code[open..].char_indices() {
        match c {
            '{' | '(' | '[' => depth += 1,
            '}' | ')' | ']' => {
                depth = depth.checked_sub(1)?;
                if depth == 0 {
                    return Some(open + i);
                }
            }
            _ => {}
        }
    }
    None
}

/// The text with the same length, bytes of comments and strings replaced by spaces.
fn blank_comments_and_strings(source: &str) -> String {
    let bytes = source.as_bytes();
    let mut out = bytes.to_vec();
    let mut i = 0;
    while i < bytes.len() {
        let end = match &bytes[i..] {
            [b'/', b'/', ..] => until(source, i, "\n"),
            [b'/', b'*', ..] => until(source, i + 2, "*/"),
            [b'"', ..] => end_of_string(bytes, i),
            _ => i,
        };
        out[i..end].fill(b' ');
        i = end.max(i + 1);
    }
    String::from_utf8_lossy(&out).into_owned()
}

/// The end of the first `mark` at or after `from`.
fn until(source: &str, from: usize, mark: &str) -> usize {
    let bytes = source.as_bytes();
    let found = bytes[from..].windows(mark.len()).position(|w| w == mark.as_bytes());
    found.map_or(bytes.len(), |at| from + at + mark.len())
}

fn end_of_string(bytes: &[u8], start: usize) -> usize {
    let mut i = start + 1;
    while i < bytes.len() && bytes[i] != b'"' {
        i += if bytes[i] == b'\\' { 2 } else { 1 };
    }
    (i + 1).min(bytes.len())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Form;

    fn force() -> AddedEffect {
        AddedEffect {
            name: "force".into(),
            on: vec!["erp_s2".into(), "erp_s3".into()],
            unit: "ms".into(),
            form: Form::Scaled { column: "force_g".into(), centre: 15.0, scale: 7.25 },
            sd: 10.0,
        }
    }

    #[test]
    fn the_statement_stands_before_the_bracket_that_closes_the_model() {
        let source = "// model! { not this }\nmodel! {\n    /// a } in a comment\n    model M;\n    let a(x) = f(\"}\");\n}\nfn f() {}\n";
        let text = rewrite(source, &[(force(), "why".into())], None).unwrap();
        let expected = "    let a(x) = f(\"}\");\n\n    /// why\n    effect force on erp_s2, erp_s3 [ms] = scaled(row.force_g, 15.0, 7.25) ~ Normal(0.0, 10.0);\n}\nfn f() {}\n";
        assert!(text.ends_with(expected), "{text}");
        assert!(text.starts_with("// model! { not this }\nmodel! {\n    /// a }"), "{text}");
    }

    #[test]
    fn outliers_surround_every_likelihood() {
        let source = "// observe a ~ b;\nmodel! {\n    model M;\n    observe s1s2(x):   Bracket [ms] ~ TopHat(erp(x)); // observe\n    observe y(x): Number ~ Normal(f(x), s);\n}\n";
        let text = rewrite(source, &[], Some((0.05, 50.0))).unwrap();
        let expected = "// observe a ~ b;\nmodel! {\n    model M;\n    observe s1s2(x):   Bracket [ms] ~ Outliers(TopHat(erp(x)), 0.05, 50.0); // observe\n    observe y(x): Number ~ Outliers(Normal(f(x), s), 0.05, 50.0);\n}\n";
        assert_eq!(text, expected);
    }

    #[test]
    fn a_text_without_a_model_has_no_place_for_it() {
        assert_eq!(rewrite("fn main() {}", &[], None), None);
        assert_eq!(rewrite("model! { model M;", &[], None), None);
    }
}
