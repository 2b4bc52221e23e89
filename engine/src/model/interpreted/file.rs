//! What stands in a model file around its model.

use eplat_language::File;
use syn::{Item, Type, UseTree};

use super::expression::{Beyond, Constants, Read, beyond};

/// The plain numbers that a file declares.
///
/// # Errors
/// Anything but these, the model and `use eplat::prelude::*;`: only a compiler knows what it means for the model.
pub(super) fn constants(file: &File) -> Read<Constants> {
    let whole: syn::File = syn::parse2(file.tokens.clone())
        .map_err(|_| Beyond("what stands around the model".into()))?;
    let mut constants = Constants::new();
    for item in &whole.items {
        match item {
            Item::Macro(of) if of.mac.path.is_ident("model") => {}
            Item::Use(of) if is_prelude(&of.tree) => {}
            Item::Const(of) => {
                let is_number = matches!(&*of.ty, Type::Path(path) if path.path.is_ident("f64"));
                let x = eplat_language::print(&of.expr).parse();
                match x {
                    Ok(x) if is_number => constants.insert(of.ident.to_string(), x),
                    _ => return beyond(item),
                };
            }
            item => return beyond(item),
        }
    }
    Ok(constants)
}

/// `eplat::prelude::*`
fn is_prelude(tree: &UseTree) -> bool {
    eplat_language::print(tree) == "eplat::prelude::*"
}
