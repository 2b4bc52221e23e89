//! The Rust that a model stands for: a unit struct, its columns as a struct, and for each statement an
//! implementation of a trait of one function and a call of the builder.

use eplat_language::print as text;
use eplat_language::syntax::{
    Column, Density, Effect, Expr, Hyper, Ident, Item, Model, Over, Param, Prior, Range, Unit,
};
use proc_macro2::{Literal, TokenStream};
use quote::quote;

use crate::scope::{Count, Kind, Scope};

mod field;
mod rows;

/// What has been read so far.
#[derive(Default)]
struct State<'m> {
    scope: Scope,
    /// Hyperparameter blocks, with what fields that share a block see.
    blocks: Vec<(&'m Hyper, Scope)>,
    /// Names of the numeric columns.
    columns: Vec<String>,
}

/// The whole model; `source` is its text.
pub(crate) fn model(model: &Model, source: &str) -> TokenStream {
    let (name, docs) = (&model.name, &model.docs);
    let columns: Vec<&Column> = columns_of_model(model).filter(|c| c.prior.is_none()).collect();
    let mut state = State {
        columns: columns.iter().map(|column| column.name.to_string()).collect(),
        ..State::default()
    };
    // measurements come last, when every effect is known
    let (mut body, mut observes) = (TokenStream::new(), TokenStream::new());
    let mut later = vec![];
    for statement in &model.statements {
        match &statement.item {
            Item::Observe(observe) => later.push((observe, state.scope.clone())),
            item => body.extend(state.item(model, item)),
        }
    }
    for (item, scope) in later {
        let state = State { scope, columns: state.columns.clone(), ..State::default() };
        observes.extend(state.observe(item));
    }
    let row = row_struct(&columns);
    let name_text = name.to_string();
    quote! {
        #(#[doc = #docs])*
        #[derive(Clone, Copy, Debug)]
        #[allow(unreachable_pub, missing_docs)]
        pub struct #name;

        impl ::eplat::model::Declare for #name {
            fn name(&self) -> &'static str { #name_text }
            fn source(&self) -> String { #source.into() }
            #[allow(unused, unreachable_pub, non_snake_case, clippy::all, clippy::pedantic)]
            fn declare(
                &self,
                b: &mut ::eplat::model::expansion::Builder<'_>,
            ) -> Result<(), ::eplat::model::ModelError> {
                use ::eplat::model::expansion::{
                    self, Column, Columns, Computed, Decl, Dist, DensityFn, Form, Kernel, KernelFn, Len,
                    LetFn, Likelihood, Num, Place, PriorFn, Range, Real, RowFn, ScalarFn, Terms, Vector,
                    VectorFn,
                };
                #row
                #body
                #observes
                Ok(())
            }
        }
    }
}

fn columns_of_model(model: &Model) -> impl Iterator<Item = &Column> {
    model.statements.iter().filter_map(|s| match &s.item {
        Item::Column(column) => Some(column),
        _ => None,
    })
}

/// `struct Row { dose: f64, x: [f64; 3] }`, the columns of a row, and `struct Data`, those of the table.
fn row_struct(columns: &[&Column]) -> TokenStream {
    let names: Vec<&Ident> = columns.iter().map(|column| &column.name).collect();
    let words: Vec<String> = names.iter().map(ToString::to_string).collect();
    let types: Vec<TokenStream> = columns
        .iter()
        .map(|column| {
            column.len.map_or(quote!(f64), |n| {
                let n = Count(n);
                quote!([f64; #n])
            })
        })
        .collect();
    quote! {
        #[derive(Debug)]
        pub struct Row { #(pub #names: #types),* }
        pub struct Data<'a> { #(pub #names: &'a [#types],)* rows: ::std::marker::PhantomData<&'a ()> }
        impl Columns for Row {
            type Data<'a> = Data<'a>;
            fn names() -> Vec<(&'static str, Vec<String>)> {
                vec![#((#words, <#types as Column>::names(#words))),*]
            }
            fn read<E>(column: &mut dyn FnMut(&str) -> Result<f64, E>) -> Result<Self, E> {
                Ok(Row { #(#names: expansion::read_column(#words, column)?),* })
            }
            fn data(cells: &[Vec<f64>]) -> Data<'_> {
                let mut cells = cells.iter();
                Data { #(#names: expansion::column_of(&mut cells),)* rows: ::std::marker::PhantomData }
            }
        }
    }
}

/// `Decl::new("tau_out", "ms", "…")`
fn decl(name: &Ident, unit: Option<&Unit>, text: &str) -> TokenStream {
    let (name, unit) = (name.to_string(), unit.map_or("", |unit| unit.text.as_str()));
    quote!(Decl::new(#name, #unit, #text))
}

/// `Some((1.0, 30.0))`
fn range(range: Option<Range>) -> TokenStream {
    let Some(Range { low, high }) = range else { return quote!(None) };
    let [low, high] = [low, high].map(Literal::f64_unsuffixed);
    quote!(Some((#low, #high)))
}

impl<'m> State<'m> {
    fn item(&mut self, model: &'m Model, item: &'m Item) -> TokenStream {
        match item {
            Item::Param(param) => {
                let call = param_call(param, &self.scope);
                self.scope.declare(&param.name, param.name.to_string(), kind_of(param));
                call
            }
            Item::Column(column) => self.column(column),
            Item::Hyper(hyper) => self.hyper(model, hyper),
            Item::Field(field) => self.field(field),
            Item::Let(declared) => self.let_statement(declared),
            Item::Effect(effect) => self.effect(effect),
            Item::Density(density) => self.density(density),
            Item::Observe(_) => TokenStream::new(),
        }
    }

    fn column(&mut self, column: &Column) -> TokenStream {
        let Some(of) = &column.prior else { return TokenStream::new() };
        let decl = decl(&column.name, column.unit.as_ref(), &text(&of.expr));
        let (prior, n, names) = prior(of, &self.scope);
        let m = n + 1;
        let call = quote!({ #prior b.imputed::<Prior, #n, #m>(#decl, #names)?; });
        self.scope.declare(&column.name, column.name.to_string(), Kind::Cells);
        call
    }

    fn effect(&self, effect: &Effect) -> TokenStream {
        let decl = decl(&effect.name, effect.unit.as_ref(), &text(&effect.prior.expr));
        let (prior, n, names) = prior(&effect.prior, &self.scope);
        let (m, form) = (n + 1, &effect.form);
        let on: Vec<String> = effect.on.iter().map(ToString::to_string).collect();
        let columns: Vec<String> = form.columns.iter().map(ToString::to_string).collect();
        if form.name == "linear" {
            return quote! {{
                #prior
                b.linear_effect::<Prior, #n, #m>(#decl, &[#(#on),*], &[#(#columns),*], #names)?;
            }};
        }
        let (kind, numbers) = (form.name.to_string(), &form.numbers);
        quote! {{
            #prior
            let form = Form::new(#kind, &[#(#columns),*], &[#(f64::from(#numbers)),*]);
            b.effect::<Prior, #n, #m>(#decl, &[#(#on),*], form, #names)?;
        }}
    }

    fn density(&self, density: &Density) -> TokenStream {
        let (name, e) = (density.name.to_string(), &density.expr);
        let decl = decl(&density.name, None, &text(e));
        let mentioned = self.scope.mentioned(e);
        let (n, names) = (mentioned.width(), mentioned.full_names());
        let (pattern, vectors) = mentioned.pattern();
        let reads = match &density.data {
            None => quote!(None),
            Some(data) => {
                let columns = self.columns_read(e, data);
                quote!(Some(&[#(#columns),*]))
            }
        };
        let data = density.data.iter();
        let bind = quote!(#(let #data = data;)*);
        quote! {{
            #[derive(Debug)]
            struct LogDensity;
            impl DensityFn<#n> for LogDensity {
                type Columns = Row;
                #[inline]
                fn terms<T: Real>(#pattern: [Num<T>; #n], data: &Data<'_>) -> impl Terms<Num<T>> + use<T> {
                    #vectors
                    #bind
                    #e
                }
            }
            b.density::<LogDensity, #n>(#decl, #name, #names, #reads)?;
        }}
    }
}

/// `struct Prior` with the prior as a function of what it mentions of `scope`; how much that is, and its names.
fn prior(prior: &Prior, scope: &Scope) -> (TokenStream, Count, TokenStream) {
    let mentioned = scope.mentioned(&prior.expr);
    let (n, names) = (mentioned.width(), mentioned.full_names());
    let (pattern, vectors) = mentioned.pattern();
    let e = &prior.expr;
    let tokens = quote! {
        #[derive(Debug)]
        struct Prior;
        impl PriorFn<#n> for Prior {
            #[inline]
            fn prior<T: Real>(#pattern: [Num<T>; #n]) -> impl Dist<Num<T>> + use<T> {
                #vectors
                #e
            }
        }
    };
    (tokens, n, names)
}

/// As [`prior`], of a vector: of each number, or of the whole.
fn vector_prior(prior: &Prior, scope: &Scope) -> (TokenStream, Count, TokenStream) {
    let mentioned = scope.mentioned(&prior.expr);
    let (n, names) = (mentioned.width(), mentioned.full_names());
    let (pattern, vectors) = mentioned.pattern();
    let e = &prior.expr;
    let tokens = quote! {
        #[derive(Debug)]
        struct Prior;
        impl VectorFn<#n> for Prior {
            #[inline]
            fn prior<T: Real>(#pattern: [Num<T>; #n]) -> impl Vector<Num<T>> + use<T> {
                #vectors
                expansion::vector::<Num<T>, _, _>(#e)
            }
        }
    };
    (tokens, n, names)
}

/// A field's mean or amplitude, and the call that hands it over.
fn scalar(e: &Expr, scope: &Scope) -> TokenStream {
    let mentioned = scope.mentioned(e);
    let (n, names) = (mentioned.width(), mentioned.full_names());
    let (pattern, vectors) = mentioned.pattern();
    quote! {{
        #[derive(Debug)]
        struct Value;
        impl ScalarFn<#n> for Value {
            #[inline]
            fn value<T: Real>(#pattern: [Num<T>; #n]) -> Num<T> {
                #vectors
                expansion::number::<T>(#e)
            }
        }
        b.scalar::<Value, #n>(#names)
    }}
}

fn option(ident: Option<&Ident>) -> TokenStream {
    let text = ident.map(ToString::to_string);
    text.map_or(quote!(None), |text| quote!(Some(#text)))
}

/// What the name of a parameter stands for.
fn kind_of(param: &Param) -> Kind {
    match &param.over {
        Over::One => Kind::Numbers(None),
        Over::Many(n) => Kind::Numbers(Some(*n)),
        Over::Each(_) => Kind::Row,
    }
}

/// A parameter whose prior sees `scope`.
fn param_call(param: &Param, scope: &Scope) -> TokenStream {
    let decl = decl(&param.name, param.unit.as_ref(), &text(&param.prior.expr));
    let (prior, n, names) = prior(&param.prior, scope);
    if let Over::Many(len) = param.over {
        let len = Count(len);
        let (prior, n, names) = vector_prior(&param.prior, scope);
        let (m1, m2) = (n + 1, n + 2);
        return quote!({ #prior b.vector::<Prior, #n, #m1, #m2>(#decl, #len, #names)?; });
    }
    let len = match &param.over {
        Over::One | Over::Many(_) => quote!(Len::One),
        Over::Each(column) => {
            let column = column.to_string();
            quote!(Len::Each(#column))
        }
    };
    let m = n + 1;
    quote!({ #prior b.param::<Prior, #n, #m>(#decl, #len, #names)?; })
}
