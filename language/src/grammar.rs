//! The grammar: one function for each rule, with the rule above it.
//!
//! Words in capitals stand for names, numbers and expressions of the user's; `?` marks what may be left out,
//! `…` what may be repeated.

use std::fmt::Display;

use proc_macro2::{Span, TokenStream};
use quote::ToTokens;
use syn::ext::IdentExt as _;
use syn::parse::{ParseStream, Parser as _};
use syn::{Error, Expr, Ident, Lit, LitInt, Result, Token, token};

use crate::mistake::Mistake;
use crate::syntax::{
    Block, Column, Density, Effect, Field, Form, Hyper, Item, Let, Model, Observe, Over, Param,
    Prior, Range, Statement, Term, Unit, Value,
};
use crate::vocabulary::{KEYWORDS, is_joint, is_unit, nearest, unit_names};

const PARAM: &str = "write `param NAME [unit] ~ PRIOR;`, `param NAME(label_column) [unit] ~ PRIOR;` or `param NAME(3) ~ PRIOR;`";
const FIELD: &str = "write `field NAME(x) [unit] in 1.0..30.0 = m + alpha * gp(Rbf(rho), K = 24) where { m [ms] ~ Flat; … }`";
const LET: &str = "write `let NAME(x) [unit] = EXPRESSION;`";
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

/// `NAME (OVER)? [UNIT]? ~ PRIOR`
fn param(input: ParseStream<'_>, form: &str) -> Result<Param> {
    let name = name(input, form)?;
    let over = over(input)?;
    let unit = unit(input)?;
    if !input.peek(Token![~]) {
        let message = format!("`{name}` has no prior");
        let help = format!("give it one, for instance `{name}{} ~ HalfNormal(5.0);`", show(&unit));
        return Err(wrong(name.span(), message, help));
    }
    let prior = prior(input)?;
    Ok(Param { name, over, unit, prior })
}

/// `~ jointly? EXPR`
fn prior(input: ParseStream<'_>) -> Result<Prior> {
    let tilde: Token![~] = input.parse()?;
    let marked = input.peek(Ident) && input.fork().parse::<Ident>()? == "jointly";
    if marked {
        input.parse::<Ident>()?;
    }
    let expr = expr(input, tilde.span, "a prior")?;
    Ok(Prior { is_joint: marked || is_joint(&expr), expr })
}

/// `(3)` or `(COLUMN)`
fn over(input: ParseStream<'_>) -> Result<Over> {
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
fn unit(input: ParseStream<'_>) -> Result<Option<Unit>> {
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
fn range(input: ParseStream<'_>) -> Result<Option<Range>> {
    if !input.peek(Token![in]) {
        return Ok(None);
    }
    let word: Token![in] = input.parse()?;
    let none =
        || wrong(word.span, "expected a range after `in`", "write two numbers: `in 1.0..30.0`");
    let low = number(input).ok_or_else(none)?;
    input.parse::<Token![..]>().map_err(|_| none())?;
    let high = number(input).ok_or_else(none)?;
    if low < high {
        return Ok(Some(Range { low, high }));
    }
    let message = format!("the range {low} to {high} is empty");
    Err(wrong(word.span, message, "the lower end stands first: `in 1.0..30.0`"))
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

/// `hyper NAME { PARAM; … }`
fn hyper(input: ParseStream<'_>) -> Result<Hyper> {
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

/// `field NAME(X, LABEL?) [UNIT]? in LOW..HIGH? = VALUE where (shared? BLOCK)? { PARAM; … }?`
fn field(input: ParseStream<'_>) -> Result<Field> {
    let name = name(input, FIELD)?;
    let (place, label) = place(input, &name)?;
    let unit = unit(input)?;
    let range = range(input)?;
    let equals = equals(input, &name, FIELD)?;
    let value = expr(input, equals, "mean and Gaussian processes")?;
    let (mean, terms) = sum_of_terms(&value)?;
    let (block, params) = where_clause(input, &value)?;
    Ok(Field { name, place, label, unit, range, mean, terms, value, block, params })
}

/// `(X)` or `(X, LABEL)`
fn place(input: ParseStream<'_>, name: &Ident) -> Result<(Ident, Option<Ident>)> {
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
        (Lit::Int(n), "K") => n.base10_parse().ok(),
        _ => None,
    }
}

/// `let NAME(ROW) [UNIT]? in LOW..HIGH? = VALUE;`
fn let_statement(input: ParseStream<'_>) -> Result<Let> {
    let name = name(input, LET)?;
    let (row, _) = row(input, &name)?;
    let unit = unit(input)?;
    let range = range(input)?;
    let equals = equals(input, &name, LET)?;
    let value = match linear(input, &row)? {
        Some(value) => value,
        None => {
            let value = expr(input, equals, "an expression")?;
            semicolon(input, last_span(&value))?;
            Value::Expr(value)
        }
    };
    Ok(Let { name, row, unit, range, value })
}

/// `linear(ROW.COLUMN, …; BETA);`
fn linear(input: ParseStream<'_>, row: &Ident) -> Result<Option<Value>> {
    let ahead = input.fork();
    let is_linear = ahead.parse::<Ident>().is_ok_and(|word| word == "linear");
    if !is_linear || !ahead.peek(token::Paren) {
        return Ok(None);
    }
    let word: Ident = input.parse()?;
    let content;
    syn::parenthesized!(content in input);
    let mut columns = vec![];
    loop {
        columns.push(member(&content, row)?);
        if content.peek(Token![,]) {
            content.parse::<Token![,]>()?;
        } else {
            break;
        }
    }
    if content.parse::<Token![;]>().is_err() {
        let help = "name them after a semicolon: `linear(row.a, row.b; beta)` with `param beta(2) ~ PRIOR;` above";
        return Err(wrong(word.span(), "`linear` has no coefficients", help));
    }
    let beta: Ident = content.parse()?;
    all_read(&content)?;
    semicolon(input, beta.span())?;
    Ok(Some(Value::Linear { columns, beta }))
}

/// `ROW.COLUMN`
fn member(input: ParseStream<'_>, row: &Ident) -> Result<Ident> {
    let none =
        |at| wrong(at, "expected a column", format!("a column of the row is written `{row}.NAME`"));
    let at = input.span();
    let word: Ident = input.parse().map_err(|_| none(at))?;
    input.parse::<Token![.]>().map_err(|_| none(word.span()))?;
    input.parse().map_err(|_| none(word.span()))
}

/// `observe NAME(ROW): KIND [UNIT]? from (EXPR)? ~ LIKELIHOOD;`
fn observe(input: ParseStream<'_>) -> Result<Observe> {
    let name = name(input, OBSERVE)?;
    let (row, _) = row(input, &name)?;
    if input.parse::<Token![:]>().is_err() {
        return Err(wrong(input.span(), "expected `:` and what is observed", OBSERVE));
    }
    let kind: Ident = input.parse().map_err(|e| {
        wrong(e.span(), "expected what is observed", "a Bracket, a Number or a Count")
    })?;
    let unit = unit(input)?;
    let from = if input.peek(Ident) && input.fork().parse::<Ident>()? == "from" {
        let word: Ident = input.parse()?;
        if !input.peek(token::Paren) {
            return Err(wrong(word.span(), "expected `from (EXPRESSION)`", OBSERVE));
        }
        let content;
        syn::parenthesized!(content in input);
        let from = expr(&content, word.span(), "an expression")?;
        all_read(&content)?;
        Some(from)
    } else {
        None
    };
    if !input.peek(Token![~]) {
        return Err(wrong(name.span(), format!("`{name}` has no likelihood"), OBSERVE));
    }
    let tilde: Token![~] = input.parse()?;
    let likelihood = expr(input, tilde.span, "a likelihood")?;
    semicolon(input, last_span(&likelihood))?;
    Ok(Observe { name, row, kind, unit, from, likelihood })
}

/// `(ROW)`
fn row(input: ParseStream<'_>, name: &Ident) -> Result<(Ident, Span)> {
    let (row, label) = place(input, name)?;
    match label {
        None => Ok((row.clone(), row.span())),
        Some(label) => Err(wrong(
            label.span(),
            format!("`{name}` varies over its row alone"),
            format!(
                "write `{name}({row})`: what the row's labels have of their own is seen through it"
            ),
        )),
    }
}

/// `effect NAME on TARGET, … [UNIT]? = FORM ~ PRIOR;`
fn effect(input: ParseStream<'_>) -> Result<Effect> {
    let name = name(input, EFFECT)?;
    let word: Ident = input.parse().unwrap_or_else(|_| name.clone());
    if word != "on" {
        return Err(wrong(name.span(), format!("`{name}` does not say what it acts on"), EFFECT));
    }
    let mut on = vec![input.parse::<Ident>()?];
    while input.peek(Token![,]) {
        input.parse::<Token![,]>()?;
        on.push(input.parse()?);
    }
    let unit = unit(input)?;
    equals(input, &name, EFFECT)?;
    let form = form(input)?;
    if !input.peek(Token![~]) {
        let help = format!(
            "give its coefficients one, for instance `{} … ~ Normal(0.0, 10.0);`",
            form.name
        );
        return Err(wrong(name.span(), format!("`{name}` has no prior"), help));
    }
    let prior = prior(input)?;
    semicolon(input, last_span(&prior.expr))?;
    Ok(Effect { name, on, unit, form, prior })
}

/// `FORM(ROW.COLUMN | ROW | EXPR, …)`
fn form(input: ParseStream<'_>) -> Result<Form> {
    let name: Ident =
        input.parse().map_err(|e| wrong(e.span(), "expected the form of the effect", EFFECT))?;
    let (mut row, mut columns, mut numbers) = (None, vec![], vec![]);
    if !input.peek(token::Paren) {
        return Err(wrong(name.span(), format!("expected `{name}(row.COLUMN)`"), EFFECT));
    }
    let content;
    syn::parenthesized!(content in input);
    while !content.is_empty() {
        let argument = expr(&content, name.span(), "an argument")?;
        match argument {
            Expr::Field(syn::ExprField { base, member: syn::Member::Named(column), .. }) => {
                row = ident(&base).or(row);
                columns.push(column);
            }
            Expr::Path(_) if row.is_none() && columns.is_empty() && numbers.is_empty() => {
                row = ident(&argument);
            }
            number => numbers.push(number),
        }
        if !content.is_empty() {
            content.parse::<Token![,]>().map_err(|_| {
                wrong(content.span(), "expected a comma between the arguments", EFFECT)
            })?;
        }
    }
    Ok(Form { name, row, columns, numbers })
}

/// The single name that an expression is.
fn ident(e: &Expr) -> Option<Ident> {
    if let Expr::Path(path) = e { path.path.get_ident().cloned() } else { None }
}

/// `density NAME (DATA)? = EXPR;`
fn density(input: ParseStream<'_>) -> Result<Density> {
    let name = name(input, DENSITY)?;
    let data = match over(input)? {
        Over::One => None,
        Over::Each(data) => Some(data),
        Over::Many(_) => return Err(wrong(name.span(), "expected a name for the table", DENSITY)),
    };
    let equals = equals(input, &name, DENSITY)?;
    let expr = expr(input, equals, "a log density")?;
    semicolon(input, last_span(&expr))?;
    Ok(Density { name, data, expr })
}

/// The name that a statement declares.
fn name(input: ParseStream<'_>, form: &str) -> Result<Ident> {
    let at = input.span();
    input.parse().map_err(|_| wrong(at, "expected a name", form))
}

/// `=`
fn equals(input: ParseStream<'_>, name: &Ident, form: &str) -> Result<Span> {
    let at = input.span();
    let sign: Token![=] = input
        .parse()
        .map_err(|_| wrong(at, format!("expected `=` in the statement of `{name}`"), form))?;
    Ok(sign.span)
}

/// Any Rust expression.
fn expr(input: ParseStream<'_>, before: Span, what: &str) -> Result<Expr> {
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
fn semicolon(input: ParseStream<'_>, before: Span) -> Result<()> {
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
fn all_read(content: ParseStream<'_>) -> Result<()> {
    if content.is_empty() {
        return Ok(());
    }
    Err(wrong(content.span(), "this does not belong between these brackets", "take it out"))
}

/// Doc comments, a line each.
fn docs(input: ParseStream<'_>) -> Result<Vec<String>> {
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
fn show(unit: &Option<Unit>) -> String {
    unit.as_ref().map_or(String::new(), |unit| format!(" [{}]", unit.text))
}

/// The place of an expression's first token.
pub(crate) fn first_span(e: &impl ToTokens) -> Span {
    e.to_token_stream().into_iter().next().map_or(Span::call_site(), |token| token.span())
}

/// The place of an expression's last token.
pub(crate) fn last_span(e: &impl ToTokens) -> Span {
    e.to_token_stream().into_iter().last().map_or(Span::call_site(), |token| token.span())
}
