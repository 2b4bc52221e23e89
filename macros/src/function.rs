//! Functions of a plan as Rust.

use eplat_language::names::mentions;
use eplat_language::plan::Function;
use eplat_language::syntax::Ident;
use proc_macro2::{Literal, TokenStream};
use quote::{ToTokens, format_ident, quote};
use std::ops::Add;

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

/// How many numbers carry derivatives.
pub(crate) fn width(f: &Function) -> Count {
    Count(f.width())
}

/// How many arguments there are.
pub(crate) fn arguments(f: &Function) -> Count {
    width(f) + f.lets.len()
}

/// `&["a", "tau_out.m"]`
pub(crate) fn full_names(f: &Function) -> TokenStream {
    let names = f.numbers.iter().map(|number| &number.full);
    quote!(&[#(#names),*])
}

/// `Place { numbers: &["tau_out", "apd_max"], lets: &["erp_s2"], reads_row: false }`
pub(crate) fn place(f: &Function) -> TokenStream {
    let (numbers, lets) = (full_names(f), f.lets.iter().map(|through| &through.word));
    let reads_row = f.reads_row;
    quote!(Place { numbers: #numbers, lets: &[#(#lets),*], reads_row: #reads_row })
}

/// The pattern of the arguments, `[a, w_0, w_1, erp_s2_offset]`, and what makes vectors of them, `let w = [w_0, w_1];`.
pub(crate) fn pattern(f: &Function) -> (TokenStream, TokenStream) {
    let (mut places, mut vectors) = (vec![], TokenStream::new());
    for number in &f.numbers {
        let word = format_ident!("{}", number.word);
        let Some(n) = number.len else {
            places.push(word);
            continue;
        };
        let own: Vec<Ident> = (0..n).map(|i| format_ident!("{word}_{i}")).collect();
        vectors.extend(quote!(let #word = [#(#own),*];));
        places.extend(own);
    }
    places.extend(f.lets.iter().map(|through| format_ident!("{}_offset", through.word)));
    (quote!([#(#places),*]), vectors)
}

/// `let erp_s2 = number(surrogate::erp_s2(tau_out, apd_max)) + erp_s2_offset;` for each `let`.
pub(crate) fn lets(f: &Function) -> TokenStream {
    let one = |through: &eplat_language::plan::Through| {
        let (word, plain) = (format_ident!("{}", through.word), &through.value);
        let offset = format_ident!("{}_offset", through.word);
        let bind = bind_row(plain, Some(&through.row));
        if bind.is_empty() {
            quote!(let #word = expansion::number::<T>(#plain) + #offset;)
        } else {
            quote!(let #word = { #bind expansion::number::<T>(#plain) } + #offset;)
        }
    };
    f.lets.iter().map(one).collect()
}

/// `let x = row;` where an expression still mentions its row.
pub(crate) fn bind_row(e: &TokenStream, row: Option<&Ident>) -> TokenStream {
    match row {
        Some(row) if row != "row" && mentions(e).iter().any(|m| m.name == *row) => {
            quote!(let #row = row;)
        }
        _ => TokenStream::new(),
    }
}
