//! What depends on a row: `let` and `observe`.

use eplat_language::plan::{Function, Observe, Operator};
use eplat_language::print as text;
use eplat_language::syntax::Operation;
use proc_macro2::TokenStream;
use quote::quote;

use super::decl;
use crate::function::{arguments, bind_row, lets, pattern, place, width};

/// `struct Value` with the expression as a function of what it mentions.
pub(super) fn value(of: &Function) -> TokenStream {
    let (n, (pattern, vectors), lets, plain) = (arguments(of), pattern(of), lets(of), &of.value);
    let bind = bind_row(plain, of.row.as_ref());
    quote! {
        struct Value;
        impl LetFn<#n> for Value {
            type Columns = Row;
            #[inline]
            fn value<T: Real>(#pattern: [Num<T>; #n], row: &Row) -> Num<T> {
                #vectors
                #lets
                #bind
                expansion::number::<T>(#plain)
            }
        }
    }
}

/// `b.operator(…)` with its operands, each as a function of what it mentions and of these columns.
pub(super) fn operator(call: &Operator<'_>) -> TokenStream {
    let Operator { declared, operation, own, operands, further } = call;
    let (decl, name) = (decl(declared), declared.name.to_string());
    let operands = operands.iter().map(|(of, columns)| {
        let (function, n, w, place) = (value(of), arguments(of), width(of), place(of));
        quote!({ #function expansion::operand::<Value, #n, #w>(#place, &[#(#columns),*]) })
    });
    let operation = match (operation, own) {
        (_, Some((function, numbers))) => {
            quote!(Own(|surface| expansion::boxed(#function(surface, #(#numbers),*))))
        }
        (Operation::Eikonal, _) => quote!(Eikonal),
        (Operation::Gradient, _) => quote!(Gradient),
        (_, None) => quote!(Path),
    };
    let further = further.iter().map(|(column, later)| {
        let (column, later) = (column.to_string(), later.to_string());
        quote!((#column, #later))
    });
    quote! {
        b.operator(#decl, #name, expansion::Operation::#operation, vec![#(#operands),*], &[#(#further),*])?;
    }
}

pub(super) fn observe(call: &Observe<'_>) -> TokenStream {
    let Observe { declared, observe, from: columns, likelihood } = call;
    let (decl, name) = (decl(declared), declared.name.to_string());
    let (row, kind) = (&observe.row, &observe.kind);
    let (n, w, place) = (arguments(likelihood), width(likelihood), place(likelihood));
    let ((pattern, vectors), lets, plain) =
        (pattern(likelihood), lets(likelihood), &likelihood.value);
    let bind = bind_row(plain, Some(row));
    let measured = observe
        .from
        .as_ref()
        .map(|from| quote!(fn measured(#row: &Row) -> Option<#kind> { Some(#from) }));
    let from = match &observe.from {
        None => quote!(None),
        Some(from) => {
            let written = text(from);
            quote!(Some(Computed { text: #written, columns: &[#(#columns),*] }))
        }
    };
    quote! {{
        struct Rows;
        impl RowFn<#n> for Rows {
            type Columns = Row;
            type Y = #kind;
            #[inline(always)]
            fn likelihood<T: Real>(
                #pattern: [Num<T>; #n],
                row: &Row,
            ) -> impl Likelihood<Num<T>, #kind> + use<T> {
                #vectors
                #lets
                #bind
                #plain
            }
            #measured
        }
        b.observe(#decl, #name, #place, #from, expansion::rows::<Rows, #n, #w>())?;
    }}
}
