//! What depends on a row: `let` and `observe`.

use eplat_language::names::columns_of;
use eplat_language::print as text;
use eplat_language::syntax::{Expr, Ident, Let, Observe, Value};
use proc_macro2::TokenStream;
use quote::quote;

use super::{State, decl, range};
use crate::scope::{Kind, bind_row};

impl State<'_> {
    pub(super) fn let_statement(&mut self, declared: &Let) -> TokenStream {
        let (name, row) = (declared.name.to_string(), &declared.row);
        let unit = declared.unit.as_ref();
        let value = match &declared.value {
            Value::Linear { columns, beta } => {
                let columns: Vec<String> = columns.iter().map(ToString::to_string).collect();
                let beta = beta.to_string();
                let decl = decl(&declared.name, unit, "");
                self.scope.declare(&declared.name, name.clone(), Kind::Row);
                return quote!(b.linear(#decl, #name, &[#(#columns),*], #beta););
            }
            Value::Expr(value) => value,
        };
        let decl = decl(&declared.name, unit, &text(value));
        let mentioned = self.scope.mentioned(value);
        let (n, place) = (mentioned.width() + mentioned.lets.len(), self.place(value, row));
        let (pattern, vectors) = mentioned.pattern();
        let lets = mentioned.values(&self.scope);
        let plain = self.scope.plain(value, row);
        let (bind, range) = (bind_row(&plain, row), range(declared.range));
        let kind = Kind::Let { row: row.clone(), value: Box::new(value.clone()) };
        let call = quote! {{
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
            b.value(#decl, #name, #range, #place, expansion::value::<Value, #n>());
        }};
        self.scope.declare(&declared.name, name, kind);
        call
    }

    pub(super) fn observe(&self, observe: &Observe) -> TokenStream {
        let (name, row, likelihood) = (observe.name.to_string(), &observe.row, &observe.likelihood);
        let kind = &observe.kind;
        let decl = decl(&observe.name, observe.unit.as_ref(), &text(likelihood));
        let mentioned = self.scope.mentioned(likelihood);
        let (w, place) = (mentioned.width(), self.place(likelihood, row));
        let n = w + mentioned.lets.len();
        let (pattern, vectors) = mentioned.pattern();
        let lets = mentioned.values(&self.scope);
        let plain = self.scope.plain(likelihood, row);
        let bind = bind_row(&plain, row);
        let measured = observe
            .from
            .as_ref()
            .map(|from| quote!(fn measured(#row: &Row) -> Option<#kind> { Some(#from) }));
        let from = match &observe.from {
            None => quote!(None),
            Some(from) => {
                let (written, columns) = (text(from), self.columns_read(from, row));
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

    /// `Place { numbers: &["tau_out", "apd_max"], lets: &["erp_s2"], reads_row: false }`
    pub(super) fn place(&self, e: &Expr, row: &Ident) -> TokenStream {
        let mentioned = self.scope.mentioned(e);
        let (numbers, lets) = (mentioned.full_names(), mentioned.let_names());
        let reads_row = self.scope.reads_row(e, row);
        quote!(Place { numbers: #numbers, lets: #lets, reads_row: #reads_row })
    }

    /// The columns that `e` reads of the row or table that it calls `of`: all where it hands on the whole.
    pub(super) fn columns_read(&self, e: &Expr, of: &Ident) -> Vec<String> {
        match columns_of(e, of) {
            Some(columns) => columns.iter().map(ToString::to_string).collect(),
            None => self.columns.clone(),
        }
    }
}
