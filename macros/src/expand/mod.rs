//! The Rust that a model stands for: a unit struct, its columns as a struct, and for each statement an
//! implementation of a trait of one function and a call of the builder.

use eplat_language::print as text;
use eplat_language::syntax::{
    self, Column, Density, Effect, Expr, Hyper, Ident, Item, Model, Param, Prior, Range, Unit,
};
use eplat_language::vocabulary::{Class, find, shape};
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
        let mut state = State { scope, columns: state.columns.clone(), ..State::default() };
        observes.extend(state.observe(model, item));
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
                    self, Column, Columns, Computed, Decl, DensityFn, Dist, Form, Kernel, KernelFn, Len,
                    LetFn, Likelihood, Num, OwnKernel, OwnPrior, Place, PriorFn, Range, Real, RowFn,
                    ScalarFn, Terms, Vector, VectorFn,
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
            Item::Let(declared) => self.let_statement(model, declared),
            Item::Effect(effect) => self.effect(effect),
            Item::Density(density) => self.density(density),
            Item::Observe(_) => TokenStream::new(),
        }
    }

    fn column(&mut self, column: &Column) -> TokenStream {
        let Some(of) = &column.prior else { return TokenStream::new() };
        let decl = decl(&column.name, column.unit.as_ref(), &text(&of.expr));
        let Function { item, n, names } = prior(of, &self.scope, Over::Numbers);
        let m = n + 1;
        let call = quote!({ #item b.imputed::<Prior, #n, #m>(#decl, #names, Prior)?; });
        self.scope.declare(&column.name, column.name.to_string(), Kind::Cells);
        call
    }

    fn effect(&self, effect: &Effect) -> TokenStream {
        let decl = decl(&effect.name, effect.unit.as_ref(), &text(&effect.prior.expr));
        let (prior, form) = (any_prior(&effect.prior, &self.scope), &effect.form);
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

    fn density(&self, density: &Density) -> TokenStream {
        let (name, e) = (density.name.to_string(), &density.expr);
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
}

/// A `struct Prior` with a function of what an expression mentions; how much that is, and its names.
struct Function {
    item: TokenStream,
    n: Count,
    names: TokenStream,
}

/// What a prior is one of.
#[derive(Clone, Copy)]
enum Over {
    /// One number, or each of several.
    Numbers,
    /// A vector: of each number or of the whole, as the prior's type has it.
    Vector,
}

/// The prior as a function of what it mentions of `scope`.
fn prior(prior: &Prior, scope: &Scope, over: Over) -> Function {
    let mentioned = scope.mentioned(&prior.expr);
    let (n, names) = (mentioned.width(), mentioned.full_names());
    let (pattern, vectors) = mentioned.pattern();
    let e = &prior.expr;
    let (kind, result, e) = match over {
        Over::Numbers => (quote!(PriorFn), quote!(Dist), quote!(#e)),
        Over::Vector => {
            (quote!(VectorFn), quote!(Vector), quote!(expansion::vector::<Num<T>, _, _>(#e)))
        }
    };
    let item = quote! {
        #[derive(Clone, Copy)]
        struct Prior;
        impl #kind<#n> for Prior {
            #[inline]
            fn prior<T: Real>(&self, #pattern: [Num<T>; #n]) -> impl #result<Num<T>> + use<T> {
                #vectors
                #e
            }
        }
    };
    Function { item, n, names }
}

/// The prior of one number as an object: one that the library has compiled, where it is a word that ships with
/// plain numbers.
fn any_prior(of: &Prior, scope: &Scope) -> TokenStream {
    let Function { item, n, names } = prior(of, scope, Over::Numbers);
    let (m, e) = (n + 1, &of.expr);
    let made = if is_plain(of, scope) {
        quote!(expansion::Written(#e).prior(Prior))
    } else {
        quote!(expansion::prior::<Prior, #n, #m>(#names, Prior))
    };
    quote!({ #item #made })
}

/// Whether a prior is a word for a prior of one number that ships, of plain numbers.
fn is_plain(prior: &Prior, scope: &Scope) -> bool {
    let word = match &prior.expr {
        Expr::Call(call) => &*call.func,
        e => e,
    };
    let Expr::Path(path) = word else { return false };
    let word = path.path.get_ident().and_then(|word| find(&word.to_string()));
    let is_prior = word.is_some_and(|word| word.classes.contains(&Class::Prior));
    is_prior && scope.mentioned(&prior.expr).width().0 == 0
}

/// A field's mean or amplitude as an object.
fn scalar(e: &Expr, scope: &Scope) -> TokenStream {
    if let Expr::Lit(number) = e {
        return quote!(expansion::constant(f64::from(#number)));
    }
    let mentioned = scope.mentioned(e);
    let (n, names) = (mentioned.width(), mentioned.full_names());
    let (pattern, vectors) = mentioned.pattern();
    if matches!(e, Expr::Path(_)) && n.0 == 1 && vectors.is_empty() {
        return quote!(expansion::lone(#names));
    }
    quote! {{
        struct Value;
        impl ScalarFn<#n> for Value {
            #[inline]
            fn value<T: Real>(#pattern: [Num<T>; #n]) -> Num<T> {
                #vectors
                expansion::number::<T>(#e)
            }
        }
        expansion::scalar::<Value, #n>(#names)
    }}
}

fn option(ident: Option<&Ident>) -> TokenStream {
    let text = ident.map(ToString::to_string);
    text.map_or(quote!(None), |text| quote!(Some(#text)))
}

/// What the name of a parameter stands for.
fn kind_of(param: &Param) -> Kind {
    match &param.over {
        syntax::Over::One => Kind::Numbers(None),
        syntax::Over::Many(n) => Kind::Numbers(Some(*n)),
        syntax::Over::Each(_) => Kind::Row,
    }
}

/// A parameter whose prior sees `scope`.
fn param_call(param: &Param, scope: &Scope) -> TokenStream {
    let decl = decl(&param.name, param.unit.as_ref(), &text(&param.prior.expr));
    let len = match &param.over {
        syntax::Over::One => quote!(Len::One),
        syntax::Over::Many(len) if is_plain(&param.prior, scope) => {
            let len = Count(*len);
            quote!(Len::Many(#len))
        }
        syntax::Over::Many(len) => {
            let (len, prior) = (Count(*len), prior(&param.prior, scope, Over::Vector));
            let Function { item, n, names } = prior;
            let (m1, m2) = (n + 1, n + 2);
            return quote!({ #item b.vector::<Prior, #n, #m1, #m2>(#decl, #len, #names, Prior)?; });
        }
        syntax::Over::Each(column) => {
            let column = column.to_string();
            quote!(Len::Each(#column))
        }
    };
    let prior = any_prior(&param.prior, scope);
    quote!(b.param(#decl, #len, &#prior)?;)
}
