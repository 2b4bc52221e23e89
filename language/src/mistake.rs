//! A mistake in a model's text: what is wrong, where, and what to do.

use std::fmt::Write as _;
use std::ops::Range;

use proc_macro2::Span;
use quote::ToTokens;

/// A mistake in a model's text.
#[derive(Clone, Debug)]
pub struct Mistake {
    /// What is wrong, in the words of the language.
    pub message: String,
    /// What to do about it.
    pub help: String,
    /// The tokens that are wrong.
    pub span: Span,
    /// Whether the place is where these tokens end, and something is missing.
    pub is_after: bool,
}

impl Mistake {
    /// A mistake in the tokens at `span`.
    pub fn at(span: Span, message: impl Into<String>, help: impl Into<String>) -> Self {
        Self { message: message.into(), help: help.into(), span, is_after: false }
    }

    /// Something that is missing behind the tokens at `span`.
    pub fn after(span: Span, message: impl Into<String>, help: impl Into<String>) -> Self {
        Self { is_after: true, ..Self::at(span, message, help) }
    }

    /// Bytes of the text that the tree was read from; only of a text, not in a macro.
    pub fn range(&self) -> Range<usize> {
        let range = self.span.byte_range();
        if self.is_after { range.end.saturating_sub(1)..range.end } else { range }
    }

    /// The mistake as it is shown: message, place in `source` (named `file`), and help.
    ///
    /// ```text
    /// unknown unit `msec`
    ///  --> erp.rs:9:16
    ///   |
    /// 9 |         rho   [msec] ~ InvGamma(1.01, 64.0);
    ///   |                ^^^^
    /// help: write one of these, or leave the unit out
    /// ```
    pub fn show(&self, file: &str, source: &str) -> String {
        if self.range().is_empty() {
            return format!("{file}: {}\nhelp: {}", self.message, self.help); // of the whole file
        }
        let Range { start, end } = self.range();
        let start = start.min(source.len());
        let line_start = source[..start].rfind('\n').map_or(0, |at| at + 1);
        let line = source[line_start..].lines().next().unwrap_or_default();
        let number = source[..start].matches('\n').count() + 1;
        let before = source[line_start..start].chars().count();
        let marked = source.get(start..end.min(line_start + line.len())).unwrap_or_default();
        let (margin, carets) = (number.to_string(), "^".repeat(marked.chars().count().max(1)));
        let blank = " ".repeat(margin.len());
        let mut out = format!("{}\n{blank}--> {file}:{number}:{}\n", self.message, before + 1);
        let _ = write!(
            out,
            "{blank} |\n{margin} | {line}\n{blank} | {}{carets}\nhelp: {}",
            " ".repeat(before),
            self.help
        );
        out
    }
}

/// The place of all tokens of `e`; in a macro, where places cannot be joined, that of the first.
pub(crate) fn span_of(e: &impl ToTokens) -> Span {
    let mut tokens = e.to_token_stream().into_iter();
    let Some(first) = tokens.next() else { return Span::call_site() };
    let last = tokens.last().map_or(first.span(), |token| token.span());
    first.span().join(last).unwrap_or(first.span())
}
