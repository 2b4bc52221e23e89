//! What depends on a row: `let` and `observe`.

use eplat_language::names::columns_of;
use eplat_language::print as text;
use eplat_language::syntax::{Expr, Ident, Let, Model, Observe, Operation, Operator, Value};
use proc_macro2::TokenStream;
use quote::{format_ident, quote};

use super::{State, decl, range};
use crate::scope::{Count, Kind, Scope, bind_row};

impl State<'_> {
    pub(super) fn let_statement(&mut self, model: &Model, declared: &Let) -> TokenStream {
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
            Value::Operator(value) => return self.operator(model, declared, value),
            Value::Expr(value) => value,
        };
        let decl = decl(&declared.name, unit, &text(value));
        if model.is_predictor(value, row) {
            let (function, n, place) = self.value_function(value, row);
            self.scope.declare(&declared.name, name.clone(), Kind::Row);
            return quote! {{
                #function
                b.predictor(#decl, #name, #place, expansion::predictor::<Value, #n>());
            }};
        }
        let (value, predictors) = self.part(model, &format_ident!("let_{}", name), value, row);
        let (function, n, place) = self.value_function(&value, row);
        let kind = Kind::Let { row: row.clone(), value: Box::new(value) };
        self.scope.declare(&declared.name, name.clone(), kind);
        let range = range(declared.range);
        quote! {{
            #predictors
            #function
            b.value(#decl, #name, #range, #place, expansion::value::<Value, #n>());
        }}
    }

    /// `b.operator(…)` with its operands, each as a function of what it mentions and of these columns.
    fn operator(&mut self, model: &Model, declared: &Let, value: &Operator) -> TokenStream {
        let (name, row) = (declared.name.to_string(), &declared.row);
        let decl = decl(&declared.name, declared.unit.as_ref(), &value.text(row));
        let operand = |e: &Expr| {
            let (function, n, place) = self.value_function(e, row);
            let columns = self.words_or_all(self.scope.columns_behind(e, row));
            let w = self.scope.mentioned(e).width();
            quote!({ #function expansion::operand::<Value, #n, #w>(#place, &[#(#columns),*]) })
        };
        let operands: Vec<TokenStream> = value.operands.iter().map(operand).collect();
        let operation = match (value.operation, &value.own) {
            (_, Some((function, numbers))) => {
                quote!(Own(|surface| expansion::boxed(#function(surface, #(#numbers),*))))
            }
            (Operation::Eikonal, _) => quote!(Eikonal),
            (Operation::Gradient, _) => quote!(Gradient),
            (_, None) => quote!(Path),
        };
        let further = value.further.iter().filter_map(|(column, later)| {
            let (column, later) = (column.to_string(), model.later_by(later)?.name.to_string());
            Some(quote!((#column, #later)))
        });
        let further = quote!(&[#(#further),*]);
        self.scope.declare(&declared.name, name.clone(), Kind::Row);
        quote! {
            b.operator(#decl, #name, expansion::Operation::#operation, vec![#(#operands),*], #further)?;
        }
    }

    /// `struct Value` with a function of what `value` mentions; how much that is, and its place.
    fn value_function(&self, value: &Expr, row: &Ident) -> (TokenStream, Count, TokenStream) {
        let mentioned = self.scope.mentioned(value);
        let n = mentioned.width() + mentioned.lets.len();
        let (pattern, vectors) = mentioned.pattern();
        let lets = mentioned.values(&self.scope);
        let plain = self.scope.plain(value, row);
        let bind = bind_row(&plain, row);
        let function = quote! {
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
        };
        (function, n, self.place(value, row))
    }

    /// Takes the linear predictors out of `e`, an expression of the statement `of` (a `let` and an `observe` may have the
    /// same name), if it then depends on
    /// fewer numbers. They are declared under names that are no names of a model; nothing is reported of them.
    fn part(&mut self, model: &Model, of: &Ident, e: &Expr, row: &Ident) -> (Expr, TokenStream) {
        let parted = model.parted(e, row, &|k| format_ident!("__{of}_{k}"));
        let (mut scope, mut calls) = (self.scope.clone(), TokenStream::new());
        for (word, e) in &parted.predictors {
            let (function, n, place) = self.value_function(e, row);
            let name = word.to_string();
            calls.extend(quote! {{
                #function
                b.part(#name, #place, expansion::predictor::<Value, #n>());
            }});
            scope.declare(word, name, Kind::Row);
        }
        let width = |scope: &Scope, e: &Expr| scope.mentioned(e).width().0;
        if width(&scope, &parted.expr) >= width(&self.scope, e) {
            return (e.clone(), TokenStream::new());
        }
        self.scope = scope;
        (parted.expr, calls)
    }

    pub(super) fn observe(&mut self, model: &Model, observe: &Observe) -> TokenStream {
        let (name, row, kind) = (observe.name.to_string(), &observe.row, &observe.kind);
        let decl = decl(&observe.name, observe.unit.as_ref(), &text(&observe.likelihood));
        let (likelihood, predictors) =
            self.part(model, &format_ident!("observe_{}", name), &observe.likelihood, row);
        let likelihood = &likelihood;
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
            #predictors
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
        self.words_or_all(columns_of(e, of))
    }

    fn words_or_all(&self, columns: Option<Vec<Ident>>) -> Vec<String> {
        let words = |columns: Vec<Ident>| columns.iter().map(ToString::to_string).collect();
        columns.map_or_else(|| self.columns.clone(), words)
    }
}
