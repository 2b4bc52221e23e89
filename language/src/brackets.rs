//! Brackets without their other half, found in a text that has no tokens yet.

use std::ops::Range;

use proc_macro2::Span;
use syn::parse::Parser as _;

use crate::mistake::Mistake;

/// The mistake in a text whose brackets do not match; `None` if they do.
pub(crate) fn mistake(source: &str) -> Option<Mistake> {
    let at = unmatched(source)?;
    let help = "close it, or take it out";
    Some(Mistake::at(span(source, &at), "this bracket is not closed", help))
}

/// The innermost opening bracket that nothing closes, or else a closing one that nothing opens.
fn unmatched(source: &str) -> Option<Range<usize>> {
    let mut open: Vec<(usize, char)> = vec![];
    let mut at = 0;
    while let Some(c) = source[at..].chars().next() {
        let end = at + skipped(&source[at..]).unwrap_or(c.len_utf8());
        match (end - at, c) {
            (1, '(' | '[' | '{') => open.push((at, c)),
            (1, ')' | ']' | '}') => match open.pop() {
                Some((_, opening)) if closes(opening, c) => {}
                Some((unclosed, _)) => return Some(unclosed..unclosed + 1),
                None => return Some(at..at + 1),
            },
            _ => {}
        }
        at = end;
    }
    open.pop().map(|(at, _)| at..at + 1)
}

fn closes(opening: char, closing: char) -> bool {
    matches!((opening, closing), ('(', ')') | ('[', ']') | ('{', '}'))
}

/// Bytes of the comment, string, character or lifetime that begins `text`.
fn skipped(text: &str) -> Option<usize> {
    let until = |from: usize, mark: &str| {
        text.get(from..)?.find(mark).map(|at| from + at + mark.len()).or(Some(text.len()))
    };
    let hashes = text.strip_prefix('r').map(|raw| raw.len() - raw.trim_start_matches('#').len());
    match text.as_bytes() {
        [b'/', b'/', ..] => until(2, "\n"),
        [b'/', b'*', ..] => Some(block_comment(text)),
        [b'r', ..] if text[1 + hashes?..].starts_with('"') => {
            until(2 + hashes?, &format!("\"{}", "#".repeat(hashes?)))
        }
        [b'"', ..] => Some(quoted(text, '"')),
        [b'\'', b'\\', ..] => Some(quoted(text, '\'')),
        [b'\'', ..] => {
            let mut characters = text.char_indices().skip(2);
            matches!(characters.next(), Some((_, '\''))).then(|| quoted(text, '\''))
        }
        // a word is skipped whole, so that the r of `for"` begins no raw string
        [b'a'..=b'z' | b'A'..=b'Z' | b'_', ..] => {
            let is_word = |c: char| c.is_alphanumeric() || c == '_';
            Some(text.find(|c| !is_word(c)).unwrap_or(text.len()))
        }
        _ => None,
    }
}

/// Bytes of a comment that may hold others.
fn block_comment(text: &str) -> usize {
    let (mut depth, mut at) = (0usize, 0);
    while let Some(rest) = text.get(at..) {
        let step = match rest.as_bytes() {
            [b'/', b'*', ..] => (depth + 1, 2),
            [b'*', b'/', ..] => (depth - 1, 2),
            [] => break,
            _ => (depth, rest.chars().next().map_or(1, char::len_utf8)),
        };
        (depth, at) = (step.0, at + step.1);
        if depth == 0 {
            break;
        }
    }
    at
}

/// Bytes of a text in quotation marks.
fn quoted(text: &str, mark: char) -> usize {
    let mut is_escaped = false;
    for (at, c) in text.char_indices().skip(1) {
        if c == mark && !is_escaped {
            return at + 1;
        }
        is_escaped = c == '\\' && !is_escaped;
    }
    text.len()
}

/// A span that covers these bytes: that of a token in a text of blanks.
fn span(source: &str, at: &Range<usize>) -> Span {
    let blank = |c: char| if c == '\n' { "\n".into() } else { " ".repeat(c.len_utf8()) };
    let mut blanks: String = source[..at.start].chars().map(blank).collect();
    blanks.push('x');
    let ident = |input: syn::parse::ParseStream<'_>| input.parse::<syn::Ident>();
    ident.parse_str(&blanks).map_or_else(|error| error.span(), |word| word.span())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(source: &str) -> Option<(usize, &str)> {
        let range = mistake(source)?.range();
        Some((range.start, &source[range]))
    }

    #[test]
    fn the_innermost_open_bracket_is_found() {
        assert_eq!(found("a { b (c; d }"), Some((6, "(")));
        assert_eq!(found("a { b [c]\n (e) "), Some((2, "{")));
        assert_eq!(found("a { b } }"), Some((8, "}")));
        assert_eq!(found("a { (b) } [c]"), None);
    }

    #[test]
    fn brackets_in_comments_and_texts_are_none() {
        let text = "/* ( /* [ */ { */ f(\"(\\\"\", 'ä', '(', '\\'', r#\"(\"#, &'a x) // (\n";
        assert_eq!(found(text), None);
        let text = "// ä (\nä {";
        assert_eq!(found(text), Some((text.len() - 1, "{")));
    }
}
