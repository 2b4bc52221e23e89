//! What is needed at every place of the surface, where there is no row.

use crate::around::Around;
use crate::grammar::last_span;
use crate::mistake::Mistake;
use crate::names::{Mention, mentions};
use crate::print;
use crate::syntax::{Expr, Ident, Item, Let, Model, Operation, Over, Value};
use crate::vocabulary::nearest;

/// The column that names the vertex at which activation starts.
const SOURCE: &str = "source";

const HELP: &str = "it is needed at every place of the surface: only fields, parameters and columns have a value there, and what is computed of these alone";

/// What `e` mentions that has no value at every place: what labels have, columns with a prior, other operators and `linear`;
/// through `let`s, too. A column has its row's value everywhere.
pub(super) fn mistakes(e: &Expr, row: &Ident, model: &Model) -> Vec<Mistake> {
    let is_of_rows = |name: &Ident| {
        let behind = model.value(name).map(|item| model.and_behind(vec![item.name()]));
        is_labelled(name, model)
            || behind.is_some_and(|all| all.iter().any(|value| is_of_row(value, model)))
    };
    let mut mistakes = vec![];
    for mention in mentions(e) {
        let name = &mention.name;
        let (at, what) = match &mention.member {
            Some(column) if name == row && is_imputed(column, model) => {
                (column, format!("{row}.{column}"))
            }
            _ if name != row && is_of_rows(name) => (name, name.to_string()),
            _ => continue,
        };
        let message = format!("`{what}` has no value between the rows");
        mistakes.push(Mistake::at(at.span(), message, HELP));
    }
    mistakes
}

/// Whether the statement of this field or `let` says itself that it has no value at every place.
fn is_of_row(name: &Ident, model: &Model) -> bool {
    match model.value(name) {
        Some(Item::Field(field)) => field.label.is_some(),
        Some(Item::Let(Let { row, value: Value::Expr(e), .. })) => {
            let is_unknown = |m: &Mention| {
                m.name == *row && m.member.as_ref().is_some_and(|column| is_imputed(column, model))
            };
            mentions(e).iter().any(|m| is_unknown(m) || is_labelled(&m.name, model))
        }
        _ => true,
    }
}

/// Whether this is a parameter with a number for each label.
fn is_labelled(name: &Ident, model: &Model) -> bool {
    model.items().any(|item| {
        matches!(item, Item::Param(param) if param.name == *name && matches!(param.over, Over::Each(_)))
    })
}

/// Whether empty cells of this column are unknowns, each the one row's own.
fn is_imputed(column: &Ident, model: &Model) -> bool {
    model
        .items()
        .any(|item| matches!(item, Item::Column(own) if own.name == *column && own.prior.is_some()))
}

/// Activation starts where column `source` says.
pub(super) fn source(column: &Ident) -> Vec<Mistake> {
    if column == SOURCE {
        return vec![];
    }
    let message = format!("activation cannot start at column `{column}`");
    let help = format!("the column with the vertex at which it starts is called `{SOURCE}`");
    vec![Mistake::at(column.span(), message, help)]
}

/// A further source is one of the columns `source2`, `source3`, …, and what it is later by is a parameter.
pub(super) fn further_source(column: &Ident, later: &Expr, model: &Model) -> Vec<Mistake> {
    let word = column.to_string();
    let number = word.strip_prefix(SOURCE).and_then(|rest| rest.parse::<u32>().ok());
    if number.is_none_or(|number| number < 2) {
        let message = format!("activation cannot start at column `{column}`");
        let help = "columns with further vertices at which it starts are called `source2`, `source3` and so on";
        return vec![Mistake::at(column.span(), message, help)];
    }
    if model.later_by(later).is_none() {
        let message = format!("`{}` is no parameter", print(later));
        let help = "by how much later activation starts is one parameter, `later`, or one for each label, `later(row)`";
        return vec![Mistake::at(last_span(later), message, help)];
    }
    vec![]
}

/// An operator of the file's own is made by a function of the file.
pub(super) fn own(function: &syn::Path, around: &Around) -> Vec<Mistake> {
    let Some(name) = function.get_ident() else { return vec![] };
    if around.is_open() || around.declares(&name.to_string()) {
        return vec![];
    }
    let shipped: Vec<&str> = Operation::SHIPPED.iter().map(|own| own.word()).collect();
    let near = nearest(&name.to_string(), &shipped);
    let near = near.map_or(String::new(), |near| format!("did you mean `{near}`? "));
    let help = format!(
        "{near}Operators over the surface are `{}`, and functions of the file that make one",
        shipped.join("`, `")
    );
    vec![Mistake::at(name.span(), format!("unknown operator `{name}`"), help)]
}
