//! The rules of what has a value in each row, `let`, `observe` and `effect`, and of densities.

use proc_macro2::Span;
use syn::parse::ParseStream;
use syn::{Expr, Ident, Result, Token, token};

use super::field::place;
use super::pieces::{all_read, equals, expr, last_span, name, over, prior, range, semicolon, unit};
use super::{DENSITY, EFFECT, EIKONAL, FURTHER, LET, OBSERVE, PATH, wrong};
use crate::print;
use crate::syntax::{Density, Effect, Form, Let, Observe, Operation, Operator, Over, Value};

/// `let NAME(ROW) [UNIT]? in LOW..HIGH? = VALUE;`
pub(super) fn let_statement(input: ParseStream<'_>) -> Result<Let> {
    let name = name(input, LET)?;
    let (row, _) = row(input, &name)?;
    let unit = unit(input)?;
    let range = range(input)?;
    let equals = equals(input, &name, LET)?;
    let value = if let Some(value) = linear(input, &row)? {
        value
    } else if let Some(value) = operator(input, &row)? {
        value
    } else {
        let value = expr(input, equals, "an expression")?;
        semicolon(input, last_span(&value))?;
        Value::Expr(value)
    };
    Ok(Let { name, row, unit, range, value })
}

/// `linear(ROW.COLUMN, …; BETA);`
fn linear(input: ParseStream<'_>, row: &Ident) -> Result<Option<Value>> {
    if !is_call(input, "linear") {
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

/// `eikonal(SLOWNESS, RATIO?, ANGLE?, THICKNESS?; ROW.source, ROW.source2 + LATER);`, `path(EXPR; ROW.source);` or `gradient(EXPR);`
fn operator(input: ParseStream<'_>, row: &Ident) -> Result<Option<Value>> {
    let called = |operation: &Operation| is_call(input, operation.word());
    let Some(operation) = Operation::SHIPPED.into_iter().find(called) else {
        return own_operator(input);
    };
    let word: Ident = input.parse()?;
    let content;
    let bracket = syn::parenthesized!(content in input).span.close();
    let (first, further) = operation.operands().split_first().unwrap_or((&"", &[]));
    let mut operands = vec![expr(&content, word.span(), first)?];
    for what in further {
        if content.peek(Token![,]) {
            let comma: Token![,] = content.parse()?;
            operands.push(expr(&content, comma.span, what)?);
        }
    }
    let source = if operation.has_source() {
        if content.parse::<Token![;]>().is_err() {
            let message = format!("`{}` does not say where activation starts", operation.word());
            let help = if operation == Operation::Eikonal { EIKONAL } else { PATH };
            return Err(wrong(word.span(), message, help));
        }
        Some(member(&content, row)?)
    } else {
        None
    };
    let mut further = vec![];
    while operation == Operation::Eikonal && content.peek(Token![,]) {
        content.parse::<Token![,]>()?;
        let column = member(&content, row)?;
        if !content.peek(Token![+]) {
            let message = format!("`{row}.{column}` does not say by how much later it starts");
            return Err(wrong(column.span(), message, FURTHER));
        }
        let plus: Token![+] = content.parse()?;
        further.push((column, expr(&content, plus.span, "a parameter")?));
    }
    all_read(&content)?;
    semicolon(input, bracket)?;
    Ok(Some(Value::Operator(Box::new(Operator {
        operation,
        operands,
        source,
        own: None,
        further,
    }))))
}

/// `FUNCTION(EXPR, …; NUMBER, …);`, an operator of the file's own: what tells it from an expression is the semicolon.
fn own_operator(input: ParseStream<'_>) -> Result<Option<Value>> {
    let ahead = input.fork();
    if ahead.call(syn::Path::parse_mod_style).is_err() || !ahead.peek(token::Paren) {
        return Ok(None);
    }
    let content;
    syn::parenthesized!(content in ahead);
    let inner: proc_macro2::TokenStream = content.parse()?;
    let is_semicolon =
        |token| matches!(token, proc_macro2::TokenTree::Punct(p) if p.as_char() == ';');
    if !inner.into_iter().any(is_semicolon) {
        return Ok(None);
    }
    let function = input.call(syn::Path::parse_mod_style)?;
    let span = last_span(&function);
    let content;
    let bracket = syn::parenthesized!(content in input).span.close();
    let mut operands = vec![expr(&content, span, "an expression")?];
    while content.peek(Token![,]) {
        let comma: Token![,] = content.parse()?;
        operands.push(expr(&content, comma.span, "an expression")?);
    }
    if !content.peek(Token![;]) {
        let help = "write `FUNCTION(EXPRESSION, …; NUMBER, …)`: what varies over the surface, then numbers";
        return Err(wrong(content.span(), "expected `;` and the numbers of the operator", help));
    }
    content.parse::<Token![;]>()?;
    let mut numbers = vec![];
    while !content.is_empty() {
        numbers.push(expr(&content, span, "a number")?);
        if content.peek(Token![,]) {
            content.parse::<Token![,]>()?;
        } else {
            break;
        }
    }
    all_read(&content)?;
    semicolon(input, bracket)?;
    let (operation, own) = (Operation::Own, Some((function, numbers)));
    Ok(Some(Value::Operator(Box::new(Operator {
        operation,
        operands,
        source: None,
        own,
        further: vec![],
    }))))
}

/// Whether `WORD(` follows.
fn is_call(input: ParseStream<'_>, word: &str) -> bool {
    let ahead = input.fork();
    ahead.parse::<Ident>().is_ok_and(|found| found == word) && ahead.peek(token::Paren)
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
pub(super) fn observe(input: ParseStream<'_>) -> Result<Observe> {
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
pub(super) fn effect(input: ParseStream<'_>) -> Result<Effect> {
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
            print(&form.name)
        );
        return Err(wrong(name.span(), format!("`{name}` has no prior"), help));
    }
    let prior = prior(input)?;
    semicolon(input, last_span(&prior.expr))?;
    Ok(Effect { name, on, unit, form, prior })
}

/// `FORM(ROW.COLUMN | ROW | EXPR, …)`
fn form(input: ParseStream<'_>) -> Result<Form> {
    let name = input.call(syn::Path::parse_mod_style);
    let name = name.map_err(|e| wrong(e.span(), "expected the form of the effect", EFFECT))?;
    let (span, text) = (last_span(&name), print(&name));
    let (mut row, mut columns, mut numbers) = (None, vec![], vec![]);
    if !input.peek(token::Paren) {
        return Err(wrong(span, format!("expected `{text}(row.COLUMN)`"), EFFECT));
    }
    let content;
    syn::parenthesized!(content in input);
    while !content.is_empty() {
        let argument = expr(&content, span, "an argument")?;
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
pub(super) fn density(input: ParseStream<'_>) -> Result<Density> {
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
