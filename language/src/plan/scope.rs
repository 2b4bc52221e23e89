//! The names that an expression can see, and what it mentions of them.

use std::collections::BTreeSet;

use proc_macro2::TokenStream;
use quote::ToTokens;

use super::{Function, Number, Through};
use crate::names::{Mention, Seen, columns_of, mentions, substitute};
use crate::syntax::{Expr, Ident};

/// What a name stands for.
#[derive(Clone)]
pub(super) enum Kind {
    /// So many numbers: a parameter; `None` for a single one.
    Numbers(Option<usize>),
    /// A number of each row: a field, a labelled parameter, a linear predictor.
    Row,
    /// A column with a prior.
    Cells,
    /// A `let`: its row, its value, and what it reads of the row.
    Let { row: Ident, value: Box<Expr> },
}

/// A name in sight.
#[derive(Clone)]
pub(super) struct Name {
    /// As it stands in the model file.
    pub(super) word: String,
    /// As the builder knows it: `tau_out.m` of the hyperparameter m.
    pub(super) full: String,
    pub(super) kind: Kind,
}

/// The names declared so far.
#[derive(Clone, Default)]
pub(super) struct Scope {
    names: Vec<Name>,
}

/// What an expression mentions, in order of declaration: numbers first, then `let`s.
pub(super) struct Mentioned<'s> {
    pub(super) numbers: Vec<&'s Name>,
    pub(super) lets: Vec<&'s Name>,
}

impl Scope {
    pub(super) fn declare(&mut self, word: &Ident, full: String, kind: Kind) {
        self.names.push(Name { word: word.to_string(), full, kind });
    }

    /// The names of hyperparameters hide others of the same name only within their field.
    pub(super) fn with(&self, other: &Self) -> Self {
        Self { names: self.names.iter().chain(&other.names).cloned().collect() }
    }

    fn position(&self, mention: &Mention) -> Option<usize> {
        self.names.iter().rposition(|name| {
            let word = match (&name.kind, &mention.member) {
                (Kind::Cells, member) => return member.as_ref().is_some_and(|m| *m == name.word),
                _ => &mention.name,
            };
            *word == name.word
        })
    }

    /// What `e` mentions, itself and through `let`s.
    pub(super) fn mentioned(&self, e: &impl ToTokens) -> Mentioned<'_> {
        let mut found = BTreeSet::new();
        self.collect(e, &mut found);
        let (mut numbers, mut lets) = (vec![], vec![]);
        let is_let = |i: &usize| matches!(self.names[*i].kind, Kind::Let { .. });
        let rank = |i: &usize| match self.names[*i].kind {
            Kind::Numbers(_) => 0,
            _ => 1,
        };
        let mut sorted: Vec<usize> = found.into_iter().collect();
        sorted.sort_by_key(|i| (rank(i), *i));
        for i in sorted {
            if is_let(&i) { &mut lets } else { &mut numbers }.push(&self.names[i]);
        }
        Mentioned { numbers, lets }
    }

    fn collect(&self, e: &impl ToTokens, found: &mut BTreeSet<usize>) {
        for mention in mentions(e) {
            let Some(i) = self.position(&mention) else { continue };
            if found.insert(i)
                && let Kind::Let { value, .. } = &self.names[i].kind
            {
                self.collect(value, found);
            }
        }
    }

    /// `e` with `name(row)` and imputed columns as plain names.
    pub(super) fn plain(&self, e: &Expr, row: &Ident) -> TokenStream {
        let is = |word: &Ident, wanted: fn(&Kind) -> bool| {
            let named = self.names.iter().rev().find(|n| *word == n.word && wanted(&n.kind));
            named.map(|_| word.clone())
        };
        substitute(e, row, &|seen| match seen {
            Seen::Value(name) => is(name, |k| matches!(k, Kind::Row | Kind::Let { .. })),
            Seen::Column(name) => is(name, |k| matches!(k, Kind::Cells)),
        })
    }

    /// The columns that `e` reads of its row, itself and through `let`s, but for those with a prior; `None` if
    /// it hands on the whole row.
    pub(super) fn columns_behind(&self, e: &Expr, row: &Ident) -> Option<Vec<Ident>> {
        let mut columns = columns_of(&self.plain(e, row), row)?;
        for name in self.mentioned(e).lets {
            let Kind::Let { row, value } = &name.kind else { continue };
            for column in columns_of(&self.plain(value, row), row)? {
                if !columns.contains(&column) {
                    columns.push(column);
                }
            }
        }
        Some(columns)
    }

    /// Whether `e` reads a column of the row that is no imputed one.
    pub(super) fn reads_row(&self, e: &Expr, row: &Ident) -> bool {
        let is_cell =
            |m: &Ident| self.names.iter().any(|n| *m == n.word && matches!(n.kind, Kind::Cells));
        mentions(e).iter().any(|m| m.name == *row && m.member.as_ref().is_some_and(|c| !is_cell(c)))
    }
}

/// Expressions as functions.
impl Scope {
    /// `e`, which knows no row.
    pub(super) fn function(&self, e: &Expr) -> Function {
        self.as_function(e, e.to_token_stream(), None)
    }

    /// `e` of a row.
    pub(super) fn function_of_row(&self, e: &Expr, row: &Ident) -> Function {
        self.as_function(e, self.plain(e, row), Some(row))
    }

    fn as_function(&self, e: &Expr, value: TokenStream, row: Option<&Ident>) -> Function {
        let Mentioned { numbers, lets } = self.mentioned(e);
        let number = |name: &&Name| Number {
            word: name.word.clone(),
            full: name.full.clone(),
            len: if let Kind::Numbers(len) = name.kind { len } else { None },
        };
        let through = |name: &&Name| {
            let Kind::Let { row, value } = &name.kind else { return None };
            let value = self.plain(value, row);
            Some(Through { word: name.word.clone(), row: row.clone(), value })
        };
        Function {
            numbers: numbers.iter().map(number).collect(),
            lets: lets.iter().filter_map(through).collect(),
            row: row.cloned(),
            reads_row: row.is_some_and(|row| self.reads_row(e, row)),
            value,
        }
    }
}

impl Mentioned<'_> {
    /// How many numbers there are.
    pub(super) fn width(&self) -> usize {
        let len = |name: &&Name| if let Kind::Numbers(Some(n)) = name.kind { n } else { 1 };
        self.numbers.iter().map(len).sum()
    }
}
