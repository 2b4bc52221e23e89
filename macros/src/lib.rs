//! `model!`: reads the statements of a model (`eplat_language`), and writes the Rust that they stand for.

use proc_macro::TokenStream;
use quote::quote_spanned;

mod expand;
mod function;

/// Declares a model: see `models/erp.rs` for a whole one, and `docs/write_a_model.md` for the language.
#[proc_macro]
pub fn model(input: TokenStream) -> TokenStream {
    let input = proc_macro2::TokenStream::from(input);
    let source = input.to_string();
    let expanded = match eplat_language::parse(input) {
        Ok(model) => {
            let mistakes = eplat_language::check(&model);
            if mistakes.is_empty() {
                expand::model(&model, &source)
            } else {
                mistakes.iter().map(error).collect()
            }
        }
        Err(mistake) => error(&mistake),
    };
    expanded.into()
}

/// A compiler's error at the mistake.
fn error(mistake: &eplat_language::Mistake) -> proc_macro2::TokenStream {
    let text = format!("{}\nhelp: {}", mistake.message, mistake.help);
    quote_spanned!(mistake.span=> compile_error!{#text})
}

#[cfg(test)]
mod tests {
    /// What `models/erp.rs` expands to, as a person reads it.
    #[test]
    fn the_expansion_of_the_erp_model() {
        let file = eplat_language::File::read(include_str!("../../models/erp.rs"));
        let model = file.unwrap_or_else(|mistake| panic!("{}", mistake.message)).model;
        let expanded = super::expand::model(&model, "model Erp; …");
        let file: syn::File = syn::parse2(expanded).unwrap_or_else(|error| panic!("{error}"));
        insta::assert_snapshot!(prettyplease::unparse(&file));
    }
}
