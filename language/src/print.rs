//! An expression as a person would write it.

use quote::ToTokens;

/// The tokens of an expression as text.
pub fn text(e: &impl ToTokens) -> String {
    let mut out = e.to_token_stream().to_string().split_whitespace().collect::<Vec<_>>().join(" ");
    for (from, to) in [
        (" :: ", "::"),
        (" (", "("),
        ("( ", "("),
        (" )", ")"),
        (" ,", ","),
        (" . ", "."),
        (" ;", ";"),
        (")+", ") +"),
    ] {
        out = out.replace(from, to);
    }
    for operator in ["+", "*", "-", "/", "=", "~"] {
        out = out.replace(&format!("{operator}("), &format!("{operator} ("));
    }
    out
}
