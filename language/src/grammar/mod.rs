//! The grammar: one function for each rule, with the rule above it.
//!
//! Words in capitals stand for names, numbers and expressions of the user's; `?` marks what may be left out,
//! `…` what may be repeated.

use std::fmt::Display;

use proc_macro2::{Span, TokenStream};
use syn::ext::IdentExt as _;
use syn::parse::{ParseStream, Parser as _};
use syn::{Error, Ident, Result, Token};

use crate::mistake::Mistake;
use crate::syntax::{Column, Item, Model, Over, Param, Statement};
use crate::vocabulary::{KEYWORDS, nearest};
use field::{field, hyper};
use pieces::{docs, name, over, param, prior, semicolon, unit};
use row::{density, effect, let_statement, observe};

mod field;
mod pieces;
mod row;

pub(crate) use pieces::{first_span, last_span};

const PARAM: &str = "write `param NAME [unit] ~ PRIOR;`, `param NAME(label_column) [unit] ~ PRIOR;` or `param NAME(3) ~ PRIOR;`";
const FIELD: &str = "write `field NAME(x) [unit] in 1.0..30.0 = m + alpha * gp(Rbf(rho), K = 24) where { m [ms] ~ Flat; … }`";
const LET: &str = "write `let NAME(x) [unit] = EXPRESSION;`";
const EIKONAL: &str = "write `eikonal(SLOWNESS; x.source)`, with the ratio of velocities along and across fibres `eikonal(SLOWNESS, RATIO; x.source)`, with an angle of the fibres `eikonal(SLOWNESS, RATIO, ANGLE; x.source)`, and with the thickness of fronts `eikonal(SLOWNESS, RATIO, ANGLE, THICKNESS; x.source)`";
const FURTHER: &str = "add a parameter: `eikonal(SLOWNESS; x.source, x.source2 + later)` with `param later [ms] ~ PRIOR;` above";
const PATH: &str = "write `path(EXPRESSION; x.source)`: the integral along the way from the vertex in column `source`";
const COLUMN: &str = "write `column NAME [unit];` or `column NAME(3);`";
const OBSERVE: &str = "write `observe NAME(x): Bracket [unit] ~ LIKELIHOOD;` or `observe NAME(row): Number [unit] from (row.a / row.b) ~ LIKELIHOOD;`";
const EFFECT: &str = "write `effect NAME on LET, LET [unit] = linear(row.COLUMN) ~ PRIOR;`";
const DENSITY: &str =
    "write `density NAME(data) = f(PARAMETER, data.COLUMN);` or `density NAME = f(PARAMETER);`";
const HYPER: &str = "write `hyper NAME { m [ms] ~ Flat; … }`";

/// Reads the tokens between the brackets of `model! { … }`.
///
/// # Errors
/// The first mistake.
pub fn parse(tokens: TokenStream) -> std::result::Result<Model, Mistake> {
    model.parse2(tokens).map_err(Mistake::from)
}

/// Reads the text between the brackets of `model! { … }`.
///
/// # Errors
/// The first mistake.
pub fn parse_text(text: &str) -> std::result::Result<Model, Mistake> {
    model.parse_str(text).map_err(Mistake::from)
}

/// Between message, help and place in an error on its way through syn.
const BETWEEN: char = '\u{1}';

/// A mistake in the tokens at `span`.
fn wrong(span: Span, message: impl Display, help: impl Display) -> Error {
    Error::new(span, format_args!("{message}{BETWEEN}{help}{BETWEEN}"))
}

/// Something that is missing behind the tokens at `span`.
fn missing(span: Span, message: impl Display, help: impl Display) -> Error {
    Error::new(span, format_args!("{message}{BETWEEN}{help}{BETWEEN}after"))
}

impl From<Error> for Mistake {
    fn from(error: Error) -> Self {
        let text = error.to_string();
        let mut parts = text.split(BETWEEN);
        let message = parts.next().unwrap_or_default();
        let help = parts.next().unwrap_or("mend the statement there");
        match parts.next() {
            Some("after") => Self::after(error.span(), message, help),
            _ => Self::at(error.span(), message, help),
        }
    }
}

fn begin(at: Span) -> Error {
    wrong(at, "a model begins with `model NAME;`", "name it in the first line: `model Atrium;`")
}

/// `model NAME; STATEMENT …`
fn model(input: ParseStream<'_>) -> Result<Model> {
    let docs = docs(input)?;
    let word = Ident::parse_any(input).map_err(|e| begin(e.span()))?;
    if word != "model" {
        return Err(begin(word.span()));
    }
    let name: Ident = input.parse().map_err(|_| begin(word.span()))?;
    semicolon(input, name.span())?;
    let mut statements = vec![];
    while !input.is_empty() {
        statements.push(statement(input)?);
    }
    Ok(Model { docs, name, statements })
}

/// `/// DOC …? KEYWORD …`
fn statement(input: ParseStream<'_>) -> Result<Statement> {
    let docs = docs(input)?;
    let known = "a statement begins with `param`, `field`, `let`, `column`, `observe`, `effect`, `density` or `hyper`";
    let Ok(word) = Ident::parse_any(input) else {
        return Err(wrong(input.span(), known, "write one of these words there"));
    };
    let item = match word.to_string().as_str() {
        "param" => Item::Param(param_statement(input)?),
        "column" => Item::Column(column(input)?),
        "hyper" => Item::Hyper(hyper(input)?),
        "field" => Item::Field(field(input)?),
        "let" => Item::Let(let_statement(input)?),
        "observe" => Item::Observe(observe(input)?),
        "effect" => Item::Effect(effect(input)?),
        "density" => Item::Density(density(input)?),
        other => {
            let help = nearest(other, KEYWORDS)
                .map_or("write one of these words there".into(), |near| {
                    format!("did you mean `{near}`?")
                });
            return Err(wrong(word.span(), known, help));
        }
    };
    Ok(Statement { docs, item })
}

/// `param NAME (OVER)? [UNIT]? ~ PRIOR;`
fn param_statement(input: ParseStream<'_>) -> Result<Param> {
    let param = param(input, PARAM)?;
    semicolon(input, last_span(&param.prior.expr))?;
    Ok(param)
}

/// `column NAME (3)? [UNIT]? (~ PRIOR)?;`
fn column(input: ParseStream<'_>) -> Result<Column> {
    let name = name(input, COLUMN)?;
    let len = match over(input)? {
        Over::One => None,
        Over::Many(n) => Some(n),
        Over::Each(label) => {
            return Err(wrong(label.span(), "expected how many columns there are", COLUMN));
        }
    };
    let unit = unit(input)?;
    let prior = if input.peek(Token![~]) { Some(prior(input)?) } else { None };
    let end = prior.as_ref().map_or(name.span(), |prior| last_span(&prior.expr));
    semicolon(input, end)?;
    Ok(Column { name, len, unit, prior })
}
