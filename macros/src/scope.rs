//! The names that an expression can see, and what it mentions of them.

use std::collections::BTreeSet;
use std::ops::Add;

use eplat_language::names::{Mention, Seen, columns_of, mentions, substitute};
use eplat_language::syntax::{Expr, Ident};
use proc_macro2::{Literal, TokenStream};
use quote::{ToTokens, format_ident, quote};

/// How many there are, as a plain literal.
#[derive(Clone, Copy)]
pub(crate) struct Count(pub(crate) usize);

impl Add<usize> for Count {
    type Output = Self;
    fn add(self, more: usize) -> Self {
        Self(self.0 + more)
    }
}

impl ToTokens for Count {
    fn to_tokens(&self, tokens: &mut TokenStream) {
        Literal::usize_unsuffixed(self.0).to_tokens(tokens);
    }
}

/// What a name stands for.
#[derive(Clone)]
pub(crate) enum Kind {
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
pub(crate) struct Name {
    /// As it stands in the model file.
    pub(crate) word: String,
    /// As the builder knows it: `tau_out.m` of the hyperparameter m.
    pub(crate) full: String,
    pub(crate) kind: Kind,
}

/// The names declared so far.
#[derive(Clone, Default)]
pub(crate) struct Scope {
    names: Vec<Name>,
}

/// What an expression mentions, in order of declaration: numbers first, then `let`s.
pub(crate) struct Mentioned<'s> {
    pub(crate) numbers: Vec<&'s Name>,
    pub(crate) lets: Vec<&'s Name>,
}

impl Scope {
    pub(crate) fn declare(&mut self, word: &Ident, full: String, kind: Kind) {
        self.names.push(Name { word: word.to_string(), full, kind });
    }

    /// The names of hyperparameters hide others of the same name only within their field.
    pub(crate) fn with(&self, other: &Self) -> Self {
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
    pub(crate) fn mentioned(&self, e: &impl ToTokens) -> Mentioned<'_> {
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
    pub(crate) fn plain(&self, e: &Expr, row: &Ident) -> TokenStream {
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
    pub(crate) fn columns_behind(&self, e: &Expr, row: &Ident) -> Option<Vec<Ident>> {
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
    pub(crate) fn reads_row(&self, e: &Expr, row: &Ident) -> bool {
        let is_cell =
            |m: &Ident| self.names.iter().any(|n| *m == n.word && matches!(n.kind, Kind::Cells));
        mentions(e).iter().any(|m| m.name == *row && m.member.as_ref().is_some_and(|c| !is_cell(c)))
    }
}

impl Mentioned<'_> {
    /// How many numbers carry derivatives.
    pub(crate) fn width(&self) -> Count {
        Count(self.numbers.iter().map(|name| name.len()).sum())
    }

    /// `&["a", "tau_out.m"]`
    pub(crate) fn full_names(&self) -> TokenStream {
        let names = self.numbers.iter().map(|name| &name.full);
        quote!(&[#(#names),*])
    }

    /// `&["erp_s2"]`
    pub(crate) fn let_names(&self) -> TokenStream {
        let names = self.lets.iter().map(|name| &name.word);
        quote!(&[#(#names),*])
    }

    /// The pattern of the numbers, `[a, w_0, w_1, erp_s2_offset]`, and what makes vectors of them, `let w = [w_0, w_1];`.
    pub(crate) fn pattern(&self) -> (TokenStream, TokenStream) {
        let (mut places, mut vectors) = (vec![], TokenStream::new());
        for name in &self.numbers {
            let word = format_ident!("{}", name.word);
            let Kind::Numbers(Some(n)) = name.kind else {
                places.push(word);
                continue;
            };
            let own: Vec<Ident> = (0..n).map(|i| format_ident!("{word}_{i}")).collect();
            vectors.extend(quote!(let #word = [#(#own),*];));
            places.extend(own);
        }
        places.extend(self.lets.iter().map(|name| format_ident!("{}_offset", name.word)));
        (quote!([#(#places),*]), vectors)
    }

    /// `let erp_s2 = number(surrogate::erp_s2(tau_out, apd_max)) + erp_s2_offset;` for each `let`.
    pub(crate) fn values(&self, scope: &Scope) -> TokenStream {
        let one = |name: &&Name| {
            let Kind::Let { row, value } = &name.kind else { return TokenStream::new() };
            let (word, offset) =
                (format_ident!("{}", name.word), format_ident!("{}_offset", name.word));
            let plain = scope.plain(value, row);
            let bind = bind_row(&plain, row);
            if bind.is_empty() {
                quote!(let #word = expansion::number::<T>(#plain) + #offset;)
            } else {
                quote!(let #word = { #bind expansion::number::<T>(#plain) } + #offset;)
            }
        };
        self.lets.iter().map(one).collect()
    }
}

impl Name {
    fn len(&self) -> usize {
        if let Kind::Numbers(Some(n)) = self.kind { n } else { 1 }
    }
}

/// `let x = row;` where an expression still mentions its row.
pub(crate) fn bind_row(e: &TokenStream, row: &Ident) -> TokenStream {
    if *row != "row" && mentions(e).iter().any(|m| m.name == *row) {
        quote!(let #row = row;)
    } else {
        TokenStream::new()
    }
}
