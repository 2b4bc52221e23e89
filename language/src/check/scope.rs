//! What an expression mentions, against what is declared above its statement.

use std::collections::BTreeSet;

use proc_macro2::{Delimiter, TokenTree};

use super::bound::bound;
use crate::around::Around;
use crate::mistake::Mistake;
use crate::names::{Mention, mentions};
use crate::syntax::{Expr, Field, Hyper, Ident, Item, Let, Model, Over, Param};
use crate::vocabulary::{PRELUDE, WORDS, elsewhere, nearest};

/// Where an expression stands: what it sees beside parameters.
#[derive(Clone, Copy)]
pub(super) enum Place<'a> {
    /// In a prior: nothing else.
    Prior,
    /// In a field's mean, amplitude or kernel: nothing else.
    Field(&'a Field),
    /// In a `let` or a likelihood, of a row of this name: its columns, fields, `let`s.
    Row(&'a Ident),
    /// In a density, which may see the columns of a table of this name.
    Table(Option<&'a Ident>),
    /// In what a measurement is computed from, and in the numbers of an effect: columns alone.
    Cells(Option<&'a Ident>),
}

/// A hyperparameter in sight.
#[derive(Clone, Copy)]
pub(super) struct Local<'a> {
    pub(super) param: &'a Param,
    /// Whether it is declared above the expression.
    pub(super) is_above: bool,
}

/// The names in sight of the statement at `at`.
#[derive(Clone, Copy)]
pub(super) struct Scope<'a> {
    pub(super) model: &'a Model,
    pub(super) around: &'a Around,
    pub(super) at: usize,
}

/// What an expression reads: where it stands, its hyperparameters, and the names that it binds itself.
struct Reading<'a> {
    place: Place<'a>,
    locals: &'a [Local<'a>],
    bound: BTreeSet<String>,
}

impl<'a> Scope<'a> {
    /// The mistakes in the names that `e` mentions.
    pub(super) fn read(&self, e: &Expr, place: Place<'_>, locals: &[Local<'_>]) -> Vec<Mistake> {
        let reading = Reading { place, locals, bound: bound(e) };
        let (mut mistakes, mut judged) = (vec![], 0);
        for (i, mention) in mentions(e).iter().enumerate() {
            let Some(mistake) = (i >= judged).then(|| self.mention(mention, &reading)).flatten()
            else {
                continue;
            };
            mistakes.push(mistake);
            // what stands between its brackets is wrong there too
            let within = mention.arguments.as_ref().map(proc_macro2::Group::stream);
            if self.declared(&mention.name).is_some() {
                judged = i + 1 + within.map_or(0, |within| mentions(&within).len());
            }
        }
        mistakes
    }

    /// One mention: a row's column, a declared name in its right form, or one known to the file.
    fn mention(&self, mention: &Mention, reading: &Reading<'_>) -> Option<Mistake> {
        let name = mention.name.to_string();
        if reading.place.row().is_some_and(|row| *row == mention.name) {
            return mention.member.as_ref().and_then(|column| self.column(column));
        }
        if reading.bound.contains(&name) {
            return None;
        }
        if let Some(local) = reading.locals.iter().rev().find(|l| l.param.name == mention.name) {
            let below = || self.below(&mention.name, local.param.name.span());
            return if local.is_above { plain(mention, &Over::One) } else { Some(below()) };
        }
        match (self.declared(&mention.name), reading.place) {
            (Some(item), place) => self.use_of(item, mention, place),
            (None, _) => self.undeclared(mention, reading),
        }
    }

    /// The parameter, field or `let` of this name above.
    fn declared(&self, name: &Ident) -> Option<&'a Item> {
        let above = self.model.statements[..self.at].iter().map(|statement| &statement.item);
        above.rev().find(|item| is_value(item) && item.name() == name)
    }

    /// Whether a declared name is used in the form that it has there.
    fn use_of(&self, item: &Item, mention: &Mention, place: Place<'_>) -> Option<Mistake> {
        let (name, span) = (&mention.name, mention.name.span());
        let items = self.model.items();
        if items.filter(|item| is_value(item) && item.name() == name).count() > 1 {
            return None; // which of them is meant is not known
        }
        let over = match item {
            Item::Param(p) => Some(&p.over),
            _ => None,
        };
        if let Place::Cells(_) = place {
            let message = format!("`{name}` is not known before the model is fitted");
            let help = "only columns, numbers and functions of these stand here";
            return Some(Mistake::at(span, message, help));
        }
        if let Some(over @ (Over::One | Over::Many(_))) = over {
            return plain(mention, over);
        }
        match place {
            Place::Row(row) => of_row(mention, row),
            Place::Field(field) if is_of_label(over, field) => plain(mention, &Over::One),
            _ => {
                let message = format!("`{name}` has a value in each row, and none here");
                let help = "priors, means, kernels and densities see parameters alone";
                Some(Mistake::at(span, message, help))
            }
        }
    }

    /// A name that the model does not declare above.
    fn undeclared(&self, mention: &Mention, reading: &Reading<'_>) -> Option<Mistake> {
        let (name, around) = (&mention.name, self.around);
        let text = name.to_string();
        if around.knows(&text) && !around.is_open() {
            return None;
        }
        let below = &self.model.statements[self.at..];
        if let Some(item) = below.iter().map(|s| &s.item).find(|i| is_value(i) && i.name() == name)
        {
            // a function outside may have the name that its own value is given
            let is_own = std::ptr::eq(item, &raw const below[0].item);
            if !(around.is_open() && is_own && mention.arguments.is_some()) {
                return Some(self.below(name, item.name().span()));
            }
        }
        if around.is_open() {
            return None;
        }
        let message = format!("unknown name `{text}`");
        if let Some(row) = reading.place.row()
            && mention.arguments.is_none()
            && self.columns().any(|column| column == name)
        {
            let help = format!("a column of the row is written `{row}.{name}`");
            return Some(Mistake::at(name.span(), message, help));
        }
        if let (Some(here), Some(_)) = (elsewhere(&text), &mention.arguments) {
            return Some(Mistake::at(name.span(), message, format!("here it is {here}")));
        }
        let help = self.nearest(mention, reading).map_or_else(
            || declare(&text, reading.place.row()),
            |near| format!("did you mean `{near}`?"),
        );
        Some(Mistake::at(name.span(), message, help))
    }

    /// A name that is declared below its use, at `span`.
    fn below(&self, name: &Ident, span: proc_macro2::Span) -> Mistake {
        let is_own = self.model.statements[self.at].item.name().span().byte_range()
            == span.byte_range()
            && self.model.statements[self.at].item.name() == name;
        let help = if is_own {
            "a statement does not see the name that it declares".into()
        } else {
            let line = span.start().line;
            format!("it is declared below, in line {line}: put that statement above this one")
        };
        Mistake::at(name.span(), format!("unknown name `{name}`"), help)
    }

    /// The name in sight that is nearest, of those that may stand where the mention stands.
    fn nearest(&self, mention: &Mention, reading: &Reading<'_>) -> Option<String> {
        let above = self.model.statements[..self.at].iter().map(|s| &s.item);
        let is_of_row = |item: &&Item| match item {
            Item::Param(p) => matches!(p.over, Over::Each(_)),
            item => is_value(item),
        };
        let with_row = reading.place.row().is_some_and(|row| is_row(mention, row));
        let mut known: Vec<String> = match (with_row, &mention.arguments) {
            (true, _) => above.filter(is_of_row).map(|i| i.name().to_string()).collect(),
            (false, Some(_)) => {
                let words = WORDS.iter().map(|word| word.name);
                words.chain(PRELUDE.iter().copied()).map(String::from).collect()
            }
            (false, None) => {
                let plain = above.filter(|item| is_value(item) && !is_of_row(item));
                let locals = reading.locals.iter().map(|local| local.param.name.to_string());
                let flat = WORDS.iter().filter(|word| word.arguments.is_empty());
                let flat = flat.map(|word| word.name.to_string());
                locals.chain(plain.map(|item| item.name().to_string())).chain(flat).collect()
            }
        };
        known.extend(self.around.names().map(String::from));
        let known: Vec<&str> = known.iter().map(String::as_str).collect();
        nearest(&mention.name.to_string(), &known).map(String::from)
    }

    fn columns(&self) -> impl Iterator<Item = &'a Ident> {
        self.model.statements.iter().filter_map(|statement| match &statement.item {
            Item::Column(column) => Some(&column.name),
            _ => None,
        })
    }

    /// A column of the row that no statement declares, above or below.
    fn column(&self, column: &Ident) -> Option<Mistake> {
        if self.columns().any(|declared| declared == column) {
            return None;
        }
        let declared: Vec<String> = self.columns().map(|column| format!("`{column}`")).collect();
        let known: Vec<&str> = declared.iter().map(|name| name.trim_matches('`')).collect();
        let near =
            nearest(&column.to_string(), &known).map(|near| format!("did you mean `{near}`? "));
        let verb = if near.is_some() { "Else declare" } else { "declare" };
        let declared = if declared.is_empty() { "none".into() } else { declared.join(", ") };
        let help = format!(
            "{}{verb} it: `column {column} [unit];` (declared are: {declared})",
            near.unwrap_or_default()
        );
        Some(Mistake::at(column.span(), format!("no column `{column}` is declared"), help))
    }

    /// The block of hyperparameters of this name above.
    pub(super) fn block(&self, name: &Ident) -> Option<&'a Hyper> {
        let mut above = self.model.statements[..self.at].iter();
        above.find_map(|statement| match &statement.item {
            Item::Hyper(hyper) if hyper.name == *name => Some(hyper),
            _ => None,
        })
    }

    /// A block that is not declared above.
    pub(super) fn unknown_block(&self, name: &Ident) -> Mistake {
        if let Some(below) = self.model.hyper(name) {
            return self.below(name, below.name.span());
        }
        let above = self.model.statements[..self.at].iter().map(|statement| &statement.item);
        let blocks = above.filter(|item| matches!(item, Item::Hyper(_)));
        let blocks: Vec<String> = blocks.map(|item| item.name().to_string()).collect();
        let blocks: Vec<&str> = blocks.iter().map(String::as_str).collect();
        let help = nearest(&name.to_string(), &blocks).map_or_else(
            || format!("declare it above: `hyper {name} {{ m [ms] ~ PRIOR; … }}`"),
            |near| format!("did you mean `{near}`?"),
        );
        let message = format!("unknown block of hyperparameters `{name}`");
        Mistake::at(name.span(), message, help)
    }

    /// The coefficients of a linear predictor: a vector above, as long as there are columns.
    pub(super) fn linear(&self, l: &Let, columns: &[Ident], beta: &Ident) -> Vec<Mistake> {
        let (name, expected) = (&l.name, columns.len());
        let got = match self.declared(beta) {
            Some(Item::Param(Param { over: Over::One, .. })) => 1,
            Some(Item::Param(Param { over: Over::Many(n), .. })) => *n,
            _ => {
                let message = format!("let {name}: `{beta}` is no vector of coefficients");
                let help = format!("declare it above: `param {beta}({expected}) ~ PRIOR;`");
                return vec![Mistake::at(beta.span(), message, help)];
            }
        };
        let is_plain = |column: &Ident| {
            let mut statements = self.model.statements.iter();
            statements.any(|statement| match &statement.item {
                Item::Column(c) => c.name == *column && c.len.is_none(),
                _ => false,
            })
        };
        if got == expected || !columns.iter().all(is_plain) {
            return vec![];
        }
        let message = format!(
            "let {name}: `{beta}` has {got} coefficients, the design has {expected} columns"
        );
        let help = format!("declare `param {beta}({expected}) ~ …;`");
        vec![Mistake::at(beta.span(), message, help)]
    }
}

impl<'a> Place<'a> {
    /// The name of the row or the table.
    fn row(self) -> Option<&'a Ident> {
        match self {
            Self::Row(row) => Some(row),
            Self::Table(row) | Self::Cells(row) => row,
            Self::Prior | Self::Field(_) => None,
        }
    }
}

/// Whether an expression mentions it by its bare name.
fn is_value(item: &Item) -> bool {
    matches!(item, Item::Param(_) | Item::Field(_) | Item::Let(_))
}

/// Whether a parameter has one value for each label of the field's own.
fn is_of_label(over: Option<&Over>, field: &Field) -> bool {
    matches!(over, Some(Over::Each(label)) if field.label.as_ref() == Some(label))
}

/// A parameter is not called.
fn plain(mention: &Mention, over: &Over) -> Option<Mistake> {
    mention.arguments.as_ref()?;
    let name = &mention.name;
    let message = format!("`{name}` is the same in every row");
    let help = match over {
        Over::Many(_) => format!("write `{name}[0]` for its first number"),
        _ => format!("write `{name}`"),
    };
    Some(Mistake::at(name.span(), message, help))
}

/// What has a value in each row is called with the row.
fn of_row(mention: &Mention, row: &Ident) -> Option<Mistake> {
    if is_row(mention, row) {
        return None;
    }
    let name = &mention.name;
    let message = match mention.arguments {
        None => format!("`{name}` is used without its row"),
        Some(_) => format!("`{name}` takes its row and nothing else"),
    };
    Some(Mistake::at(name.span(), message, format!("write `{name}({row})`")))
}

/// Whether `(row)` follows.
fn is_row(mention: &Mention, row: &Ident) -> bool {
    let Some(group) = &mention.arguments else { return false };
    let mut tokens = group.stream().into_iter();
    group.delimiter() == Delimiter::Parenthesis
        && matches!((tokens.next(), tokens.next()), (Some(TokenTree::Ident(word)), None) if word == *row)
}

/// How a name can be declared.
fn declare(name: &str, row: Option<&Ident>) -> String {
    let row = row.map_or("x".into(), ToString::to_string);
    format!(
        "declare it above: `param {name} ~ PRIOR;`, `let {name}({row}) = …;`, in the field's `where {{ … }}`, or as a function outside `model!`"
    )
}
