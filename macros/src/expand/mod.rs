//! The Rust that a model stands for: a unit struct, its columns as a struct, and for each call of its plan an
//! implementation of a trait of one function and a call of the builder.

use eplat_language::plan::{Call, Declared, Function, Parameter, Prior};
use eplat_language::syntax::{Column, Effect, Ident, Model, Over, Range};
use eplat_language::vocabulary::shape;
use proc_macro2::{Literal, TokenStream};
use quote::quote;

use crate::function::{Count, arguments, full_names, pattern, place, width};

mod field;
mod rows;

/// The whole model; `source` is its text.
pub(crate) fn model(model: &Model, source: &str) -> TokenStream {
    let (name, docs) = (&model.name, &model.docs);
    let plan = model.plan();
    let row = row_struct(&plan.columns);
    let calls: TokenStream = plan.calls.iter().map(call).collect();
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
                    self, Column, Columns, Computed, Decl, DensityFn, Dist, Form, Kernel, KernelFn, Len,
                    LetFn, Likelihood, Num, OwnKernel, OwnPrior, Place, PriorFn, Range, Real, RowFn,
                    ScalarFn, Terms, Vector, VectorFn,
                };
                #row
                #calls
                Ok(())
            }
        }
    }
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
fn decl(Declared { name, unit, text }: &Declared<'_>) -> TokenStream {
    let (name, unit) = (name.to_string(), unit.map_or("", |unit| unit.text.as_str()));
    quote!(Decl::new(#name, #unit, #text))
}

/// `Some((1.0, 30.0))`
fn range(range: Option<Range>) -> TokenStream {
    let Some(Range { low, high }) = range else { return quote!(None) };
    let [low, high] = [low, high].map(Literal::f64_unsuffixed);
    quote!(Some((#low, #high)))
}

fn call(call: &Call<'_>) -> TokenStream {
    match call {
        Call::Param(param) => param_call(param),
        Call::Imputed { declared, prior } => {
            let (decl, item, n) = (decl(declared), prior_item(prior, Of::Numbers), width(prior));
            let (m, names) = (n + 1, full_names(prior));
            quote!({ #item b.imputed::<Prior, #n, #m>(#decl, #names, Prior)?; })
        }
        Call::Block { name, params } => {
            let (name, params) = (name.to_string(), params.iter().map(param_call));
            quote!(b.block(#name); #(#params)* b.end_block();)
        }
        Call::Field(field) => field::call(field),
        Call::Linear { declared, columns, beta } => {
            let (decl, name) = (decl(declared), declared.name.to_string());
            let columns: Vec<String> = columns.iter().map(ToString::to_string).collect();
            let beta = beta.to_string();
            quote!(b.linear(#decl, #name, &[#(#columns),*], #beta);)
        }
        Call::Predictor(declared, value) => {
            let (function, n, place) = (rows::value(value), arguments(value), place(value));
            let (decl, name) = (decl(declared), declared.name.to_string());
            quote! {{
                #function
                b.predictor(#decl, #name, #place, expansion::predictor::<Value, #n>());
            }}
        }
        Call::Part(name, value) => {
            let (function, n, place) = (rows::value(value), arguments(value), place(value));
            let name = name.to_string();
            quote! {{
                #function
                b.part(#name, #place, expansion::predictor::<Value, #n>());
            }}
        }
        Call::Value { declared, range: ends, value } => {
            let (function, n, place) = (rows::value(value), arguments(value), place(value));
            let (decl, name, ends) = (decl(declared), declared.name.to_string(), range(*ends));
            quote! {{
                #function
                b.value(#decl, #name, #ends, #place, expansion::value::<Value, #n>());
            }}
        }
        Call::Operator(operator) => rows::operator(operator),
        Call::Effect { declared, effect, prior } => effect_call(declared, effect, prior),
        Call::Density { name, table, value } => density(name, table.as_ref(), value),
        Call::Observe(observe) => rows::observe(observe),
    }
}

fn effect_call(declared: &Declared<'_>, effect: &Effect, prior: &Prior) -> TokenStream {
    let (decl, prior, form) = (decl(declared), any_prior(prior), &effect.form);
    let on: Vec<String> = effect.on.iter().map(ToString::to_string).collect();
    let columns: Vec<String> = form.columns.iter().map(ToString::to_string).collect();
    let kind = form.name.get_ident();
    if kind.is_some_and(|kind| kind == "linear") {
        return quote! {
            b.linear_effect(#decl, &[#(#on),*], &[#(#columns),*], &#prior)?;
        };
    }
    let (function, numbers) = (&form.name, &form.numbers);
    let ships = kind.is_some_and(|kind| shape(kind).is_some());
    let from = ships.then(|| quote!(::eplat::model::forms::));
    let columns = columns.iter().map(|column| quote!(#column));
    let arguments = columns.chain(numbers.iter().map(|number| quote!(f64::from(#number))));
    quote! {{
        let form = Form::from(#from #function(#(#arguments),*));
        b.effect(#decl, &[#(#on),*], form, &#prior)?;
    }}
}

fn density(name: &Ident, table: Option<&(&Ident, Vec<String>)>, value: &Function) -> TokenStream {
    let (name, e) = (name.to_string(), &value.value);
    let (n, names, (pattern, vectors)) = (width(value), full_names(value), pattern(value));
    let reads = match table {
        None => quote!(None),
        Some((_, columns)) => quote!(Some(&[#(#columns),*])),
    };
    let data = table.iter().map(|(data, _)| data);
    let bind = quote!(#(let #data = data;)*);
    quote! {{
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
        b.density(#name, #reads, &expansion::density::<LogDensity, #n>(#names))?;
    }}
}

/// What a prior is one of.
#[derive(Clone, Copy)]
enum Of {
    /// One number, or each of several.
    Numbers,
    /// A vector: of each number or of the whole, as the prior's type has it.
    Vector,
}

/// A `struct Prior` with the prior as a function of what it mentions.
fn prior_item(prior: &Function, over: Of) -> TokenStream {
    let (n, (pattern, vectors), e) = (width(prior), pattern(prior), &prior.value);
    let (kind, result, e) = match over {
        Of::Numbers => (quote!(PriorFn), quote!(Dist), quote!(#e)),
        Of::Vector => {
            (quote!(VectorFn), quote!(Vector), quote!(expansion::vector::<Num<T>, _, _>(#e)))
        }
    };
    quote! {
        #[derive(Clone)]
        struct Prior;
        impl #kind<#n> for Prior {
            #[inline]
            fn prior<T: Real>(&self, #pattern: [Num<T>; #n]) -> impl #result<Num<T>> + use<T> {
                #vectors
                #e
            }
        }
    }
}

/// The prior of one number as an object: one that the library has compiled, where it is a word that ships with
/// plain numbers.
fn any_prior(Prior { of, is_plain }: &Prior) -> TokenStream {
    let item = prior_item(of, Of::Numbers);
    let (n, names, e) = (width(of), full_names(of), &of.value);
    let m = n + 1;
    let made = if *is_plain {
        quote!(expansion::Written(#e).prior(Prior))
    } else {
        quote!(expansion::prior::<Prior, #n, #m>(#names, Prior))
    };
    quote!({ #item #made })
}

/// A field's mean or amplitude as an object.
fn scalar(of: &Function) -> TokenStream {
    let (n, names, (pattern, vectors), e) = (width(of), full_names(of), pattern(of), &of.value);
    match syn::parse2(e.clone()) {
        Ok(syn::Expr::Lit(number)) => return quote!(expansion::constant(f64::from(#number))),
        Ok(syn::Expr::Path(_)) if n.0 == 1 && vectors.is_empty() => {
            return quote!(expansion::lone(#names));
        }
        _ => {}
    }
    quote! {{
        #[derive(Clone)]
        struct Value;
        impl ScalarFn<#n> for Value {
            #[inline]
            fn value<T: Real>(&self, #pattern: [Num<T>; #n]) -> Num<T> {
                #vectors
                expansion::number::<T>(#e)
            }
        }
        expansion::scalar::<Value, #n>(#names, Value)
    }}
}

fn option(ident: Option<&Ident>) -> TokenStream {
    let text = ident.map(ToString::to_string);
    text.map_or(quote!(None), |text| quote!(Some(#text)))
}

fn param_call(Parameter { declared, over, prior }: &Parameter<'_>) -> TokenStream {
    let decl = decl(declared);
    let len = match over {
        Over::One => quote!(Len::One),
        Over::Many(len) if prior.is_plain => {
            let len = Count(*len);
            quote!(Len::Many(#len))
        }
        Over::Many(len) => {
            let (len, item, n) = (Count(*len), prior_item(&prior.of, Of::Vector), width(&prior.of));
            let (m1, m2, names) = (n + 1, n + 2, full_names(&prior.of));
            return quote!({ #item b.vector::<Prior, #n, #m1, #m2>(#decl, #len, #names, Prior)?; });
        }
        Over::Each(column) => {
            let column = column.to_string();
            quote!(Len::Each(#column))
        }
    };
    let prior = any_prior(prior);
    quote!(b.param(#decl, #len, &#prior)?;)
}
