//! The rules of fields and of blocks of hyperparameters.

use quote::ToTokens;
use syn::parse::ParseStream;
use syn::{Expr, Ident, Lit, Result, Token, token};

use super::pieces::{
    all_read, docs, ends, equals, expr, first_span, last_span, name, param, range, semicolon, unit,
};
use super::{FIELD, HYPER, missing, wrong};
use crate::syntax::{Block, Field, Hyper, Param, Range, Term};

/// `hyper NAME { PARAM; … }`
pub(super) fn hyper(input: ParseStream<'_>) -> Result<Hyper> {
    let name = name(input, HYPER)?;
    if !input.peek(token::Brace) {
        return Err(wrong(name.span(), format!("`{name}` holds no parameters"), HYPER));
    }
    Ok(Hyper { name, params: params(input)? })
}

/// `{ PARAM; … }`
fn params(input: ParseStream<'_>) -> Result<Vec<Param>> {
    let content;
    syn::braced!(content in input);
    let mut params = vec![];
    while !content.is_empty() {
        docs(&content)?;
        let param = param(&content, "write `rho [mm] ~ InvGamma(1.0, 50.0);`")?;
        semicolon(&content, last_span(&param.prior.expr))?;
        params.push(param);
    }
    Ok(params)
}

/// `field NAME(X, LABEL?) [UNIT]? (in|within LOW..HIGH)? = VALUE where (shared? BLOCK)? { PARAM; … }?`
pub(super) fn field(input: ParseStream<'_>) -> Result<Field> {
    let name = name(input, FIELD)?;
    let (place, label) = place(input, &name)?;
    let unit = unit(input)?;
    let (range, is_within) = range_of_field(input)?;
    let equals = equals(input, &name, FIELD)?;
    let value = expr(input, equals, "mean and Gaussian processes")?;
    let (mean, terms) = sum_of_terms(&value)?;
    let (block, params) = where_clause(input, &value)?;
    Ok(Field { name, place, label, unit, range, is_within, mean, terms, value, block, params })
}

/// `in LOW..HIGH` or `within LOW..HIGH`, and whether it is the latter.
fn range_of_field(input: ParseStream<'_>) -> Result<(Option<Range>, bool)> {
    match input.fork().parse::<Ident>() {
        Ok(word) if word == "within" => {
            let word: Ident = input.parse()?;
            Ok((Some(ends(input, word.span(), "within")?), true))
        }
        _ => Ok((range(input)?, false)),
    }
}

/// `(X)` or `(X, LABEL)`
pub(super) fn place(input: ParseStream<'_>, name: &Ident) -> Result<(Ident, Option<Ident>)> {
    if !input.peek(token::Paren) {
        return Err(wrong(
            input.span(),
            format!("expected `(x)` after `{name}`"),
            "round brackets hold what it varies over, square brackets its unit: `(x) [ms]`",
        ));
    }
    let content;
    syn::parenthesized!(content in input);
    let place = content.parse()?;
    let label = if content.peek(Token![,]) {
        content.parse::<Token![,]>()?;
        Some(content.parse()?)
    } else {
        None
    };
    all_read(&content)?;
    Ok((place, label))
}

/// `where shared? BLOCK;`, `where { PARAM; … }`, `where BLOCK { PARAM; … }`, or `;` where there is nothing.
fn where_clause(input: ParseStream<'_>, value: &Expr) -> Result<(Option<Block>, Vec<Param>)> {
    if input.peek(Token![;]) {
        input.parse::<Token![;]>()?;
        return Ok((None, vec![]));
    }
    if !input.peek(Token![where]) {
        let help = "the hyperparameters follow the word `where`: `where { m [ms] ~ Flat; … }`";
        return Err(if input.peek(token::Brace) {
            wrong(input.span(), "the word `where` is missing", help)
        } else {
            missing(last_span(value), "`where { … }` is missing", help)
        });
    }
    let word: Token![where] = input.parse()?;
    let mut block = None;
    if input.peek(Ident) {
        let first: Ident = input.parse()?;
        let is_shared = first == "shared" && input.peek(Ident);
        let name = if is_shared { input.parse()? } else { first };
        block = Some(Block { is_shared, name });
    }
    if input.peek(token::Brace) {
        return Ok((block, params(input)?));
    }
    semicolon(input, block.as_ref().map_or(word.span, |block| block.name.span()))?;
    Ok((block, vec![]))
}

/// `MEAN + AMPLITUDE * gp(KERNEL, K = 24) + …`, in any order.
fn sum_of_terms(value: &Expr) -> Result<(Option<Expr>, Vec<Term>)> {
    let mut addends = vec![];
    split(value, &|op| matches!(op, syn::BinOp::Add(_)), &mut addends);
    let (mut mean, mut terms): (Option<Expr>, Vec<Term>) = (None, vec![]);
    for addend in addends {
        match term(&addend)? {
            Some(term) => terms.push(term),
            None => {
                mean = Some(match mean {
                    Some(mean) => syn::parse_quote!(#mean + #addend),
                    None => addend,
                });
            }
        }
    }
    if terms.is_empty() {
        let help = "a field is a mean and at least one Gaussian process: `m + alpha * gp(Rbf(rho), K = 24)`";
        return Err(wrong(first_span(value), "the field has no `gp(…)`", help));
    }
    Ok((mean, terms))
}

/// The operands of a chain of `op`.
fn split(e: &Expr, is_op: &dyn Fn(&syn::BinOp) -> bool, out: &mut Vec<Expr>) {
    match e {
        Expr::Binary(b) if is_op(&b.op) => {
            split(&b.left, is_op, out);
            split(&b.right, is_op, out);
        }
        other => out.push(other.clone()),
    }
}

/// The most modes of a term. It is far above what measurements at points can tell apart.
const MOST_MODES: usize = 2048;

/// `AMPLITUDE * gp(KERNEL, K = 24)`, the factors in any order.
fn term(e: &Expr) -> Result<Option<Term>> {
    let mut factors = vec![];
    split(e, &|op| matches!(op, syn::BinOp::Mul(_)), &mut factors);
    let is_gp =
        |e: &Expr| matches!(e, Expr::Call(call) if call.func.to_token_stream().to_string() == "gp");
    let Some(at) = factors.iter().position(is_gp) else { return Ok(None) };
    let Expr::Call(gp) = factors.remove(at) else { return Ok(None) };
    let mut factors = factors.into_iter();
    let amplitude = factors
        .next()
        .map(|first| factors.fold(first, |product, factor| syn::parse_quote!(#product * #factor)));
    let mut arguments = gp.args.iter();
    let kernel = arguments.next().cloned();
    let modes = arguments.next().and_then(n_modes);
    if modes.is_some_and(|modes| !(1..=MOST_MODES).contains(&modes)) {
        let message = format!("a field has from 1 to {MOST_MODES} modes");
        let help = "24 are enough for most; `eplat run` tells down to which wavelength they go";
        return Err(wrong(first_span(&gp.func), &message, help));
    }
    match (kernel, modes) {
        (Some(kernel), Some(modes)) => Ok(Some(Term { amplitude, kernel, modes })),
        _ => Err(wrong(
            first_span(&gp.func),
            "`gp(…)` does not say how many modes it has",
            "say how many modes the term has: `gp(Rbf(rho), K = 24)`",
        )),
    }
}

/// `K = 24`
fn n_modes(e: &Expr) -> Option<usize> {
    let Expr::Assign(assign) = e else { return None };
    let mut value = &*assign.right;
    while let Expr::Group(inner) = value {
        value = &inner.expr; // a `$K` of a macro around the model
    }
    let Expr::Lit(literal) = value else { return None };
    match (&literal.lit, assign.left.to_token_stream().to_string().as_str()) {
        // one with too many digits is refused as one that is too large
        (Lit::Int(n), "K") => Some(n.base10_parse().unwrap_or(usize::MAX)),
        _ => None,
    }
}
