//! What an expression mentions: names of the model, and columns of its row.
//!
//! Expressions are read as tokens, so that nothing between brackets of a macro or a closure is overlooked. A
//! name that an expression binds itself (`let a = …;`, `|a| …`) and that the model declares too counts as
//! mentioned: that makes a derivative one number wider, never wrong.

use proc_macro2::{Delimiter, Group, Spacing, TokenStream, TokenTree};
use quote::ToTokens;
use syn::Ident;

/// A word of an expression that may be a name: no member (`row.sigma`) and no part of a path (`f64::sqrt`).
#[derive(Clone, Debug)]
pub struct Mention {
    /// The word.
    pub name: Ident,
    /// What stands in round brackets behind it, if that is what follows.
    pub arguments: Option<Group>,
    /// The member that is taken of it: `force_g` of `row.force_g`.
    pub member: Option<Ident>,
}

/// Every word of `e` that may be a name, in order.
pub fn mentions(e: &impl ToTokens) -> Vec<Mention> {
    let mut found = vec![];
    walk(e.to_token_stream(), &mut |mention| found.push(mention));
    found
}

/// The columns that `e` reads of what it calls `row`, each once; `None` if it hands on the whole row.
pub fn columns_of(e: &impl ToTokens, row: &Ident) -> Option<Vec<Ident>> {
    let mut columns: Vec<Ident> = vec![];
    for mention in mentions(e).into_iter().filter(|m| m.name == *row) {
        let column = mention.member?;
        if !columns.contains(&column) {
            columns.push(column);
        }
    }
    Some(columns)
}

/// The tokens of `e` with every `name(row)` in place of which `value` gives a name replaced by that name, and
/// likewise every `row.name`.
pub fn substitute(
    e: &impl ToTokens,
    row: &Ident,
    value: &dyn Fn(Seen<'_>) -> Option<Ident>,
) -> TokenStream {
    replaced(e.to_token_stream(), row, value)
}

/// What an expression sees of a row.
#[derive(Clone, Copy, Debug)]
pub enum Seen<'a> {
    /// `name(row)`
    Value(&'a Ident),
    /// `row.name`
    Column(&'a Ident),
}

fn replaced(
    tokens: TokenStream,
    row: &Ident,
    value: &dyn Fn(Seen<'_>) -> Option<Ident>,
) -> TokenStream {
    let tokens: Vec<TokenTree> = tokens.into_iter().collect();
    let (mut out, mut i) = (TokenStream::new(), 0);
    while i < tokens.len() {
        let found = match &tokens[i] {
            TokenTree::Ident(name) if is_free(&tokens, i) => {
                match (&tokens.get(i + 1), name == row) {
                    (Some(TokenTree::Group(group)), false) if is_row(group, row) => {
                        value(Seen::Value(name)).map(|name| (name, 2))
                    }
                    (_, true) => member(&tokens, i)
                        .and_then(|column| value(Seen::Column(column)))
                        .map(|name| (name, 3)),
                    _ => None,
                }
            }
            _ => None,
        };
        if let Some((name, length)) = found {
            out.extend([TokenTree::Ident(name)]);
            i += length;
            continue;
        }
        out.extend([match &tokens[i] {
            TokenTree::Group(group) => {
                let mut inner = Group::new(group.delimiter(), replaced(group.stream(), row, value));
                inner.set_span(group.span());
                TokenTree::Group(inner)
            }
            token => token.clone(),
        }]);
        i += 1;
    }
    out
}

/// Whether a group is `(row)`.
fn is_row(group: &Group, row: &Ident) -> bool {
    let mut tokens = group.stream().into_iter();
    group.delimiter() == Delimiter::Parenthesis
        && matches!((tokens.next(), tokens.next()), (Some(TokenTree::Ident(word)), None) if word == *row)
}

fn walk(tokens: TokenStream, found: &mut dyn FnMut(Mention)) {
    let tokens: Vec<TokenTree> = tokens.into_iter().collect();
    for i in 0..tokens.len() {
        match &tokens[i] {
            TokenTree::Group(group) => walk(group.stream(), found),
            TokenTree::Ident(name) if is_free(&tokens, i) => found(Mention {
                name: name.clone(),
                arguments: match tokens.get(i + 1) {
                    Some(TokenTree::Group(group))
                        if group.delimiter() == Delimiter::Parenthesis =>
                    {
                        Some(group.clone())
                    }
                    _ => None,
                },
                member: member(&tokens, i).cloned(),
            }),
            _ => {}
        }
    }
}

/// The member that is taken of token `i`; none where it is a method.
fn member(tokens: &[TokenTree], i: usize) -> Option<&Ident> {
    let is_call = matches!(tokens.get(i + 3), Some(TokenTree::Group(g)) if g.delimiter() == Delimiter::Parenthesis);
    match (tokens.get(i + 1), tokens.get(i + 2)) {
        (Some(TokenTree::Punct(dot)), Some(TokenTree::Ident(member)))
            if dot.as_char() == '.' && !is_call =>
        {
            Some(member)
        }
        _ => None,
    }
}

/// Whether the word at `i` stands for itself: not a member, not part of a path, no macro.
fn is_free(tokens: &[TokenTree], i: usize) -> bool {
    let punct = |i: Option<usize>| match i.and_then(|i| tokens.get(i)) {
        Some(TokenTree::Punct(p)) => Some((p.as_char(), p.spacing())),
        _ => None,
    };
    let before = |n: usize| punct(i.checked_sub(n));
    // `..name` ends a range, `.name` is a member
    let is_member = before(1).is_some_and(|(c, _)| c == '.')
        && !before(2).is_some_and(|(c, spacing)| c == '.' && spacing == Spacing::Joint);
    let is_path = |c: Option<(char, Spacing)>| c.is_some_and(|(c, _)| c == ':');
    let begins_path = punct(Some(i + 1)).is_some_and(|(c, s)| c == ':' && s == Spacing::Joint);
    let is_macro = punct(Some(i + 1)).is_some_and(|(c, s)| c == '!' && s == Spacing::Alone)
        && matches!(tokens.get(i + 2), Some(TokenTree::Group(_)));
    let ends_path = is_path(before(1)) && is_path(before(2));
    !is_member && !begins_path && !ends_path && !is_macro
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(text: &str) -> Vec<String> {
        let e: syn::Expr = syn::parse_str(text).unwrap();
        mentions(&e).into_iter().map(|m| m.name.to_string()).collect()
    }

    #[test]
    fn members_and_paths_are_no_names() {
        assert_eq!(words("m + alpha * gp"), ["m", "alpha", "gp"]);
        assert_eq!(words("surrogate::erp_s2(Normal(m, row.sigma))"), ["Normal", "m", "row"]);
        assert_eq!(words("(0..sigma).max(D::from(a))"), ["sigma", "a"]);
        assert_eq!(words("vec![a, b.c(d)]"), ["a", "b", "d"]);
    }

    #[test]
    fn values_and_columns_of_the_row_are_replaced() {
        let e: syn::Expr = syn::parse_str("f(x) + g(f(x)) * x.dose - x.other + h(y)").unwrap();
        let row = Ident::new("x", proc_macro2::Span::call_site());
        let value = |seen: Seen<'_>| match seen {
            Seen::Value(name) if name == "f" => Some(name.clone()),
            Seen::Column(name) if name == "dose" => Some(name.clone()),
            _ => None,
        };
        let text = substitute(&e, &row, &value).to_string();
        assert_eq!(text, "f + g (f) * dose - x . other + h (y)");
        let columns = columns_of(&e, &row);
        assert!(columns.is_none(), "f(x) hands on the row");
        let e: syn::Expr = syn::parse_str("x.dose / x.other + x.dose").unwrap();
        assert_eq!(columns_of(&e, &row).unwrap(), ["dose", "other"]);
    }
}
