//! What is needed at every place of the surface, where there is no row.

use crate::mistake::Mistake;
use crate::names::{Mention, mentions};
use crate::syntax::{Expr, Ident, Item, Let, Model, Over, Value};

/// The column that names the vertex at which activation starts.
const SOURCE: &str = "source";

const HELP: &str = "an arrival depends on what lies on the way to it: fields and parameters, and what is computed of these alone";

/// What `e` mentions that rows alone have, or labels; through `let`s, too.
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
            Some(column) if name == row => (column, format!("{row}.{column}")),
            _ if name != row && is_of_rows(name) => (name, name.to_string()),
            _ => continue,
        };
        let message = format!("`{what}` has no value between the rows");
        mistakes.push(Mistake::at(at.span(), message, HELP));
    }
    mistakes
}

/// Whether the statement of this field or `let` says itself that only rows have it, or their labels.
fn is_of_row(name: &Ident, model: &Model) -> bool {
    match model.value(name) {
        Some(Item::Field(field)) => field.label.is_some(),
        Some(Item::Let(Let { row, value: Value::Expr(e), .. })) => {
            let is_column = |m: &Mention| m.name == *row && m.member.is_some();
            mentions(e).iter().any(|m| is_column(m) || is_labelled(&m.name, model))
        }
        _ => true,
    }
}

/// Whether this is a parameter with a number for each label.
fn is_labelled(name: &Ident, model: &Model) -> bool {
    let mut items = model.statements.iter().map(|statement| &statement.item);
    items.any(|item| {
        matches!(item, Item::Param(param) if param.name == *name && matches!(param.over, Over::Each(_)))
    })
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
