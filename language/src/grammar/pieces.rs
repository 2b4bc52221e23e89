//! What rules have in common: names, units, ranges, priors, expressions.

use proc_macro2::{Span, TokenStream};
use quote::ToTokens;
use syn::ext::IdentExt as _;
use syn::parse::ParseStream;
use syn::{Error, Expr, Ident, Lit, LitInt, Result, Token, token};

use super::{missing, wrong};
use crate::syntax::{Over, Param, Prior, Range, Unit};
use crate::vocabulary::{KEYWORDS, is_joint, is_unit, nearest, unit_names};

/// `NAME (OVER)? [UNIT]? ~ PRIOR`
pub(super) fn param(input: ParseStream<'_>, form: &str) -> Result<Param> {
    let name = name(input, form)?;
    let over = over(input)?;
    let unit = unit(input)?;
    if !input.peek(Token![~]) {
        let message = format!("`{name}` has no prior");
        let help =
            format!("give it one, for instance `{name}{} ~ HalfNormal(5.0);`", show(unit.as_ref()));
        return Err(wrong(name.span(), message, help));
    }
    let prior = prior(input)?;
    Ok(Param { name, over, unit, prior })
}

/// `~ EXPR`
pub(super) fn prior(input: ParseStream<'_>) -> Result<Prior> {
    let tilde: Token![~] = input.parse()?;
    let expr = expr(input, tilde.span, "a prior")?;
    Ok(Prior { is_joint: is_joint(&expr), expr })
}

/// `(3)` or `(COLUMN)`
pub(super) fn over(input: ParseStream<'_>) -> Result<Over> {
    if !input.peek(token::Paren) {
        return Ok(Over::One);
    }
    let content;
    let brackets = syn::parenthesized!(content in input);
    let over = if content.peek(LitInt) {
        Over::Many(content.parse::<LitInt>()?.base10_parse()?)
    } else if content.peek(Ident) {
        Over::Each(content.parse()?)
    } else {
        let help = "round brackets hold a length or a column of labels, square brackets the unit: `b(3) [ms]`, `b(operator) [ms]`";
        return Err(wrong(brackets.span.join(), "expected a length or a column", help));
    };
    all_read(&content)?;
    Ok(over)
}

/// `[UNIT]`: a name or a number, or one over another.
pub(super) fn unit(input: ParseStream<'_>) -> Result<Option<Unit>> {
    if !input.peek(token::Bracket) {
        return Ok(None);
    }
    let content;
    let brackets = syn::bracketed!(content in input);
    let tokens: Vec<_> = content.parse::<TokenStream>()?.into_iter().collect();
    let text: String = tokens.iter().map(ToString::to_string).collect();
    let unknown = tokens.iter().find(|token| {
        let text = token.to_string();
        text != "/" && !is_unit(&text)
    });
    let is_one = matches!(text.split('/').collect::<Vec<_>>()[..], [a] | [a, _] if !a.is_empty());
    if unknown.is_some() || !is_one || text.ends_with('/') {
        let span = unknown.map_or(brackets.span.join(), proc_macro2::TokenTree::span);
        let unknown = unknown.map_or(text.clone(), ToString::to_string);
        let names: Vec<&str> = unit_names().collect();
        let help = match nearest(&unknown, &names) {
            Some(near) if near != "1" => format!("did you mean `{near}`? "),
            _ => String::new(),
        };
        let help = format!(
            "{help}{} are {}, or one over another such as m/s; a unit may be left out",
            if help.is_empty() { "units" } else { "Units" },
            names.join(", ")
        );
        return Err(wrong(span, format!("unknown unit `{unknown}`"), help));
    }
    let span = tokens.first().map_or(brackets.span.join(), proc_macro2::TokenTree::span);
    Ok(Some(Unit { text, span }))
}

/// `in LOW..HIGH`
pub(super) fn range(input: ParseStream<'_>) -> Result<Option<Range>> {
    if !input.peek(Token![in]) {
        return Ok(None);
    }
    let word: Token![in] = input.parse()?;
    ends(input, word.span, "in").map(Some)
}

/// `LOW..HIGH` after `word`, which stands at `span`.
pub(super) fn ends(input: ParseStream<'_>, span: Span, word: &str) -> Result<Range> {
    let none = || {
        let message = format!("expected a range after `{word}`");
        wrong(span, message, format!("write two numbers: `{word} 1.0..30.0`"))
    };
    let low = number(input).ok_or_else(none)?;
    input.parse::<Token![..]>().map_err(|_| none())?;
    let high = number(input).ok_or_else(none)?;
    if low < high {
        return Ok(Range { low, high });
    }
    let message = format!("the range {low} to {high} is empty");
    Err(wrong(span, message, format!("the lower end stands first: `{word} 1.0..30.0`")))
}

/// `1`, `-4.6`
fn number(input: ParseStream<'_>) -> Option<f64> {
    let sign = if input.parse::<Token![-]>().is_ok() { -1.0 } else { 1.0 };
    let value: f64 = match input.parse::<Lit>().ok()? {
        Lit::Int(n) => n.base10_parse().ok()?,
        Lit::Float(x) => x.base10_parse().ok()?,
        _ => return None,
    };
    Some(sign * value)
}

/// The name that a statement declares.
pub(super) fn name(input: ParseStream<'_>, form: &str) -> Result<Ident> {
    let at = input.span();
    input.parse().map_err(|_| wrong(at, "expected a name", form))
}

/// `=`
pub(super) fn equals(input: ParseStream<'_>, name: &Ident, form: &str) -> Result<Span> {
    let at = input.span();
    let sign: Token![=] = input
        .parse()
        .map_err(|_| wrong(at, format!("expected `=` in the statement of `{name}`"), form))?;
    Ok(sign.span)
}

/// Any Rust expression.
pub(super) fn expr(input: ParseStream<'_>, before: Span, what: &str) -> Result<Expr> {
    if input.is_empty() || input.peek(Token![;]) {
        let help = format!("write {what} there");
        return Err(missing(before, format!("expected {what}"), help));
    }
    input.parse().map_err(|error: Error| {
        let help = format!("what stands here is {what}, in Rust's syntax");
        wrong(error.span(), error.to_string(), help)
    })
}

/// `;`
pub(super) fn semicolon(input: ParseStream<'_>, before: Span) -> Result<()> {
    if input.peek(Token![;]) {
        input.parse::<Token![;]>()?;
        return Ok(());
    }
    let is_next = input.is_empty() || input.peek(Token![#]) || {
        let word = Ident::parse_any(&input.fork()).map(|word| word.to_string());
        word.is_ok_and(|word| {
            KEYWORDS.contains(&word.as_str()) || input.peek2(Ident) || input.peek2(token::Bracket)
        })
    };
    if is_next {
        let help = "it ends every statement: write it there";
        return Err(missing(before, "a `;` is missing", help));
    }
    let help = "an operator, a comma or the `;` that ends the statement is missing before it";
    Err(wrong(input.span(), "this does not belong to the expression before it", help))
}

/// Complains about what is left over between brackets.
pub(super) fn all_read(content: ParseStream<'_>) -> Result<()> {
    if content.is_empty() {
        return Ok(());
    }
    Err(wrong(content.span(), "this does not belong between these brackets", "take it out"))
}

/// Doc comments, a line each.
pub(super) fn docs(input: ParseStream<'_>) -> Result<Vec<String>> {
    let mut docs = vec![];
    for attribute in input.call(syn::Attribute::parse_outer)? {
        let line = match &attribute.meta {
            syn::Meta::NameValue(meta) if meta.path.is_ident("doc") => match &meta.value {
                Expr::Lit(literal) => match &literal.lit {
                    Lit::Str(text) => Some(text.value()),
                    _ => None,
                },
                _ => None,
            },
            _ => None,
        };
        let Some(line) = line else {
            let at = attribute.pound_token.span;
            return Err(wrong(
                at,
                "a model has no attributes",
                "take it out; a comment begins with `///`",
            ));
        };
        docs.push(line.trim().to_string());
    }
    Ok(docs)
}

/// ` [ms]`, or nothing.
fn show(unit: Option<&Unit>) -> String {
    unit.map_or(String::new(), |unit| format!(" [{}]", unit.text))
}

/// The place of an expression's first token.
pub(crate) fn first_span(e: &impl ToTokens) -> Span {
    e.to_token_stream().into_iter().next().map_or(Span::call_site(), |token| token.span())
}

/// The place of an expression's last token.
pub(crate) fn last_span(e: &impl ToTokens) -> Span {
    e.to_token_stream().into_iter().last().map_or(Span::call_site(), |token| token.span())
}
