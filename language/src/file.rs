//! A model file: Rust source with one `model! { … }` in it.

use std::ops::Range;
use std::str::FromStr as _;

use proc_macro2::{Delimiter, Group, Span, TokenStream, TokenTree};

use crate::brackets;
use crate::grammar::parse;
use crate::mistake::Mistake;
use crate::syntax::Model;

/// A model file, read.
pub struct File {
    /// The model.
    pub model: Model,
    /// The tokens of the whole file.
    pub tokens: TokenStream,
    /// The word `model` before its brackets.
    pub word: Span,
    /// Bytes of the brackets of `model! { … }`, these included.
    pub brackets: Range<usize>,
}

impl std::fmt::Debug for File {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("File").field("brackets", &self.brackets).finish_non_exhaustive()
    }
}

impl File {
    /// The tokens between the brackets of `model! { … }`, as the macro gets them.
    pub fn between_brackets(&self) -> String {
        the_model(&self.tokens)
            .map_or_else(|_| String::new(), |(_, group)| group.stream().to_string())
    }

    /// Reads the text of a model file.
    ///
    /// # Errors
    /// The first mistake: a bracket without its other half, no model or a second one, and those of [`parse`].
    pub fn read(source: &str) -> Result<Self, Mistake> {
        let tokens = tokens(source)?;
        let (word, group) = the_model(&tokens)?;
        let model = parse(group.stream()).map_err(|mistake| located(mistake, word))?;
        Ok(Self { model, tokens, word, brackets: group.span().byte_range() })
    }
}

/// A mistake about a model without any tokens is one about its first word.
fn located(mistake: Mistake, word: Span) -> Mistake {
    if mistake.range().is_empty() { Mistake { span: word, ..mistake } } else { mistake }
}

/// The tokens of a text.
fn tokens(source: &str) -> Result<TokenStream, Mistake> {
    TokenStream::from_str(source).map_err(|error| {
        let help = "a quotation mark that is not closed, or a sign that Rust does not know";
        let other = || Mistake::at(error.span(), "the text cannot be read from here on", help);
        brackets::mistake(source).unwrap_or_else(other)
    })
}

/// The one `model! { … }` among the tokens of a file: the word, and the brackets.
fn the_model(tokens: &TokenStream) -> Result<(Span, Group), Mistake> {
    let tokens: Vec<TokenTree> = tokens.clone().into_iter().collect();
    let mut models = tokens.windows(3).filter_map(|three| match three {
        [TokenTree::Ident(word), TokenTree::Punct(mark), TokenTree::Group(group)]
            if word == "model" && mark.as_char() == '!' && group.delimiter() != Delimiter::None =>
        {
            Some((word.span(), group.clone()))
        }
        _ => None,
    });
    match (models.next(), models.next()) {
        (Some(one), None) => Ok(one),
        (_, Some((second, _))) => Err(Mistake::at(
            second,
            "expected one model in a file, found another",
            "put it into a file of its own",
        )),
        (None, None) => Err(Mistake::at(
            Span::call_site(),
            "expected `model! { model NAME; … }`, found none",
            "a model file declares one; see models/normal.rs",
        )),
    }
}
