//! Fields, and blocks of hyperparameters.

use eplat_language::print as text;
use eplat_language::syntax::{Expr, Field, Hyper, Ident, Item, Model, Param, Range};
use eplat_language::vocabulary::{Class, find};
use proc_macro2::TokenStream;
use quote::{format_ident, quote};

use super::{State, decl, kind_of, option, param_call, range, scalar};
use crate::scope::{Count, Kind, Scope};

impl<'m> State<'m> {
    /// A block: its parameters are declared here if a field shares them, otherwise by each field that takes it.
    pub(super) fn hyper(&mut self, model: &Model, hyper: &'m Hyper) -> TokenStream {
        let is_shared = model.statements.iter().any(|s| match &s.item {
            Item::Field(field) => {
                field.block.as_ref().is_some_and(|b| b.is_shared && b.name == hyper.name)
            }
            _ => false,
        });
        let (params, own) = self.params(&hyper.name, &hyper.params, &Scope::default());
        self.blocks.push((hyper, own));
        if !is_shared {
            return TokenStream::new();
        }
        let name = hyper.name.to_string();
        quote!(b.block(#name); #params b.end_block();)
    }

    /// Hyperparameters of `owner`, each of which sees those before it; and their names. `seen` are names of others.
    pub(super) fn params(
        &self,
        owner: &Ident,
        params: &[Param],
        seen: &Scope,
    ) -> (TokenStream, Scope) {
        let (mut calls, mut own) = (TokenStream::new(), seen.clone());
        for param in params {
            calls.extend(param_call(param, &self.scope.with(&own)));
            own.declare(&param.name, format!("{owner}.{}", param.name), kind_of(param));
        }
        (calls, own)
    }

    pub(super) fn field(&mut self, field: &Field) -> TokenStream {
        let name = field.name.to_string();
        let decl = decl(&field.name, field.unit.as_ref(), &text(&field.value));
        let (range, label) = (range(field.range), option(field.label.as_ref()));
        let block = field.block.as_ref().and_then(|own| {
            let found = self.blocks.iter().find(|(hyper, _)| hyper.name == own.name);
            found.map(|(hyper, names)| (own.is_shared, *hyper, names.clone()))
        });
        let (mut params, mut own) = match block {
            Some((true, _, names)) => (TokenStream::new(), names),
            Some((false, hyper, _)) => self.params(&field.name, &hyper.params, &Scope::default()),
            None => (TokenStream::new(), Scope::default()),
        };
        let (more, all) = self.params(&field.name, &field.params, &own);
        params.extend(more);
        own = all;
        let scope = self.scope.with(&own);
        let lone_mean = lone_name(field.mean.as_ref(), &own);
        let mean = match &field.mean {
            Some(mean) => scalar(mean, &scope),
            None => scalar(&syn::parse_quote!(0.0), &scope),
        };
        let terms = field.terms.iter().map(|term| {
            let amplitude = match &term.amplitude {
                Some(amplitude) => scalar(amplitude, &scope),
                None => scalar(&syn::parse_quote!(1.0), &scope),
            };
            let (kernel, modes) = (kernel(&term.kernel, &scope), Count(term.modes));
            quote! {{
                let amplitude = b.scalar(&#amplitude);
                b.term(amplitude, #modes, #kernel)
            }}
        });
        let terms: Vec<TokenStream> = terms.collect();
        let is_within = field.is_within;
        self.declare_field(field);
        quote! {{
            b.field(#decl, Range { ends: #range, is_within: #is_within }, #label, #name)?;
            #params
            let mean = b.scalar(&#mean);
            let terms = Vec::from([#(#terms),*]);
            b.end_field(#lone_mean, mean, terms)?;
        }}
    }
}

impl State<'_> {
    /// A field as expressions see it: its sum or, where it is bent into a range, a `let` of its sum.
    fn declare_field(&mut self, field: &Field) {
        let (name, place) = (&field.name, &field.place);
        let Some(Range { low, high }) = field.range.filter(|_| field.is_within) else {
            self.scope.declare(name, name.to_string(), Kind::Row);
            return;
        };
        let sum = format_ident!("{name}__sum");
        self.scope.declare(&sum, format!("{name}.sum"), Kind::Row);
        let value = Box::new(syn::parse_quote!(expansion::within(#low, #high, #sum(#place))));
        self.scope.declare(name, name.to_string(), Kind::Let { row: place.clone(), value });
    }
}

/// `Some("tau_out.m")` where the mean is a hyperparameter and nothing else.
fn lone_name(mean: Option<&Expr>, own: &Scope) -> TokenStream {
    let Some(Expr::Path(path)) = mean else { return quote!(None) };
    if path.path.get_ident().is_none() {
        return quote!(None);
    }
    let mentioned = own.mentioned(path);
    let full: Vec<&String> = mentioned.numbers.iter().map(|name| &name.full).collect();
    if let [name] = full[..] { quote!(Some(#name)) } else { quote!(None) }
}

/// A kernel as an object: one that the library has compiled, where it is a word that ships with one parameter.
fn kernel(e: &Expr, scope: &Scope) -> TokenStream {
    let mentioned = scope.mentioned(e);
    let (n, names) = (mentioned.width(), mentioned.full_names());
    let (pattern, vectors) = mentioned.pattern();
    let made = match lone_argument(e) {
        Some(argument) if n.0 == 1 && vectors.is_empty() => quote! {
            let #argument = Num(1.0);
            expansion::Written(#e).kernel(#names, Covariance)
        },
        _ => quote!(expansion::kernel::<Covariance, #n>(#names)),
    };
    quote! {{
        struct Covariance;
        impl KernelFn<#n> for Covariance {
            #[inline(always)]
            fn kernel<T: Real>(#pattern: [Num<T>; #n]) -> impl Kernel<Num<T>> + use<T> {
                #vectors
                #e
            }
        }
        #made
    }}
}

/// `rho` of `Rbf(rho)` and of `authors(Rbf(rho))`.
fn lone_argument(kernel: &Expr) -> Option<&Ident> {
    let Expr::Call(call) = kernel else { return None };
    let Expr::Path(word) = &*call.func else { return None };
    let word = find(&word.path.get_ident()?.to_string())?;
    match (word.name, call.args.first()?) {
        ("authors", inner) => lone_argument(inner),
        (_, Expr::Path(name)) if word.classes.contains(&Class::Kernel) => name.path.get_ident(),
        _ => None,
    }
}
