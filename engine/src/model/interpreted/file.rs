//! What stands in a model file around its model.

use eplat_language::{File, print};
use syn::{Expr, FnArg, GenericParam, Item, ItemFn, Local, Pat, ReturnType, Stmt, Type};

use super::expression::{Around, Beyond, OwnFunction, Parameter, Read};

/// The plain numbers and the functions of numbers that a file declares.
///
/// # Errors
/// Anything but these, the model and `use eplat::prelude::*;`: only a compiler knows what it means for the model.
pub(super) fn around(file: &File) -> Read<Around> {
    let whole: syn::File = syn::parse2(file.tokens.clone())
        .map_err(|_| Beyond("what stands around the model".into()))?;
    let mut around = Around::default();
    for item in &whole.items {
        match item {
            Item::Macro(of) if of.mac.path.is_ident("model") => {}
            Item::Use(of) if print(&of.tree) == "eplat::prelude::*" => {}
            Item::Const(of) => match print(&of.expr).parse() {
                Ok(x) if is(&of.ty, "f64") => {
                    around.constants.insert(of.ident.to_string(), x);
                }
                _ => return Err(Beyond(in_short(item))),
            },
            Item::Fn(of) => match function(of) {
                Some(own) => {
                    around.functions.insert(of.sig.ident.to_string(), own);
                }
                None => return Err(Beyond(in_short(item))),
            },
            item => return Err(Beyond(in_short(item))),
        }
    }
    Ok(around)
}

/// `fn saturating`, of an item that stands around the model.
fn in_short(item: &Item) -> String {
    match item {
        Item::Const(of) => format!("const {}", of.ident),
        Item::Fn(of) => format!("fn {}", of.sig.ident),
        Item::Struct(of) => format!("struct {}", of.ident),
        Item::Enum(of) => format!("enum {}", of.ident),
        Item::Mod(of) => format!("mod {}", of.ident),
        item => print(item),
    }
}

fn is(of: &Type, name: &str) -> bool {
    matches!(of, Type::Path(path) if path.path.is_ident(name))
}

/// A function of numbers that names values and gives a result; `None` of any other.
fn function(of: &ItemFn) -> Option<OwnFunction> {
    let sig = &of.sig;
    if !print(sig).starts_with("fn ") || sig.generics.where_clause.is_some() {
        return None;
    }
    // `<D: Real>`, or nothing
    let generics: Vec<&GenericParam> = sig.generics.params.iter().collect();
    let number = match &generics[..] {
        [] => None,
        [GenericParam::Type(own)] if print(&own.bounds) == "Real" => Some(own.ident.to_string()),
        _ => return None,
    };
    let kind = |of: &Type| match &number {
        _ if is(of, "f64") => Some(Parameter::Plain),
        Some(own) if is(of, own) => Some(Parameter::Generic),
        Some(own) if print(of).replace(' ', "") == format!("Num<{own}>") => Some(Parameter::Number),
        _ => None,
    };
    let parameter = |of: &FnArg| match of {
        FnArg::Typed(of) => Some((name(&of.pat)?, kind(&of.ty)?)),
        FnArg::Receiver(_) => None,
    };
    let parameters = sig.inputs.iter().map(parameter).collect::<Option<_>>()?;
    let ReturnType::Type(_, result) = &sig.output else { return None };
    let gives = kind(result)?;
    let (last, before) = of.block.stmts.split_last()?;
    let Stmt::Expr(result, None) = last else { return None };
    let values = before.iter().map(value).collect::<Option<_>>()?;
    Some(OwnFunction { parameters, values, result: result.clone(), gives })
}

/// `let name = EXPR;`
fn value(of: &Stmt) -> Option<(syn::Ident, Expr)> {
    let Stmt::Local(Local { pat, init: Some(init), .. }) = of else { return None };
    if init.diverge.is_some() {
        return None;
    }
    Some((name(pat)?, (*init.expr).clone()))
}

fn name(of: &Pat) -> Option<syn::Ident> {
    match of {
        Pat::Ident(own)
            if own.by_ref.is_none() && own.mutability.is_none() && own.subpat.is_none() =>
        {
            Some(own.ident.clone())
        }
        _ => None,
    }
}
