//! Fields.

use eplat_language::plan::{Field, Function};
use eplat_language::vocabulary::{Class, find};
use proc_macro2::TokenStream;
use quote::quote;
use syn::{Expr, Ident};

use super::{decl, option, param_call, range, scalar};
use crate::function::{Count, full_names, pattern, width};

pub(super) fn call(call: &Field<'_>) -> TokenStream {
    let Field { declared, field, params, mean, lone_mean, terms } = call;
    let (decl, name) = (decl(declared), declared.name.to_string());
    let (range, label) = (range(field.range), option(field.label.as_ref()));
    let params = params.iter().map(param_call);
    let terms = terms.iter().map(|term| {
        let (amplitude, kernel, modes) =
            (scalar(&term.amplitude), kernel(&term.kernel), Count(term.modes));
        quote! {{
            let amplitude = b.scalar(&#amplitude);
            b.term(amplitude, #modes, &#kernel)
        }}
    });
    let (mean, is_within) = (scalar(mean), field.is_within);
    let lone_mean = lone_mean.as_ref().map_or(quote!(None), |name| quote!(Some(#name)));
    quote! {{
        b.field(#decl, Range { ends: #range, is_within: #is_within }, #label, #name)?;
        #(#params)*
        let mean = b.scalar(&#mean);
        let terms = Vec::from([#(#terms),*]);
        b.end_field(#lone_mean, mean, terms)?;
    }}
}

/// A kernel as an object: one that the library has compiled, where it is a word that ships with one parameter.
fn kernel(of: &Function) -> TokenStream {
    let (n, names, (pattern, vectors), e) = (width(of), full_names(of), pattern(of), &of.value);
    let argument = syn::parse2(e.clone()).ok().and_then(|e| lone_argument(&e));
    let made = match argument {
        Some(argument) if n.0 == 1 && vectors.is_empty() => quote! {
            let #argument = Num(1.0);
            expansion::Written(#e).kernel(#names, Covariance)
        },
        _ => quote!(expansion::kernel::<Covariance, #n>(#names, Covariance)),
    };
    quote! {{
        #[derive(Clone)]
        struct Covariance;
        impl KernelFn<#n> for Covariance {
            #[inline(always)]
            fn kernel<T: Real>(&self, #pattern: [Num<T>; #n]) -> impl Kernel<Num<T>> + use<T> {
                #vectors
                #e
            }
        }
        #made
    }}
}

/// `rho` of `Rbf(rho)` and of `authors(Rbf(rho))`.
fn lone_argument(kernel: &Expr) -> Option<Ident> {
    let Expr::Call(call) = kernel else { return None };
    let Expr::Path(word) = &*call.func else { return None };
    let word = find(&word.path.get_ident()?.to_string())?;
    match (word.name, call.args.first()?) {
        ("authors", inner) => lone_argument(inner),
        (_, Expr::Path(name)) if word.classes.contains(&Class::Kernel) => {
            name.path.get_ident().cloned()
        }
        _ => None,
    }
}
