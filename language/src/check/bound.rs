//! The names that an expression binds itself: by `let`, in a closure, a loop or an arm of a `match`.

use std::collections::BTreeSet;

use proc_macro2::{Spacing, TokenStream, TokenTree};
use quote::ToTokens;

/// The names that `e` binds anywhere, and words that are no names: members of a struct, lifetimes.
pub(super) fn bound(e: &impl ToTokens) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    walk(e.to_token_stream(), &mut found);
    found
}

fn walk(tokens: TokenStream, found: &mut BTreeSet<String>) {
    let tokens: Vec<TokenTree> = tokens.into_iter().collect();
    for (i, token) in tokens.iter().enumerate() {
        match token {
            TokenTree::Group(group) => walk(group.stream(), found),
            TokenTree::Ident(word) if word == "let" => until(&tokens[i + 1..], "=;", found),
            TokenTree::Ident(word) if word == "for" => until_in(&tokens[i + 1..], found),
            TokenTree::Ident(word) if word == "fn" => until(&tokens[i + 1..], "", found),
            TokenTree::Ident(word) => {
                let is_member = sign(tokens.get(i + 1)) == Some((':', Spacing::Alone));
                if is_member || i > 0 && sign(tokens.get(i - 1)).is_some_and(|(c, _)| c == '\'') {
                    found.insert(word.to_string());
                }
            }
            TokenTree::Punct(punct) if punct.as_char() == '|' && is_first(&tokens, i) => {
                until(&tokens[i + 1..], "|", found);
            }
            TokenTree::Punct(punct) if punct.as_char() == '>' && is_arrow(&tokens, i) => {
                arm(&tokens[..i - 1], found);
            }
            _ => {}
        }
    }
}

fn sign(token: Option<&TokenTree>) -> Option<(char, Spacing)> {
    match token {
        Some(TokenTree::Punct(punct)) => Some((punct.as_char(), punct.spacing())),
        _ => None,
    }
}

/// Whether no operand stands before token `i`: a bar there begins a closure.
fn is_first(tokens: &[TokenTree], i: usize) -> bool {
    match i.checked_sub(1).map(|before| &tokens[before]) {
        None => true,
        Some(TokenTree::Punct(punct)) => punct.as_char() != '|' && punct.as_char() != '?',
        Some(TokenTree::Ident(word)) => *word == "move" || *word == "return",
        Some(_) => false,
    }
}

fn is_arrow(tokens: &[TokenTree], i: usize) -> bool {
    i > 0 && sign(tokens.get(i - 1)) == Some(('=', Spacing::Joint))
}

/// The words up to one of these signs, those in brackets too.
fn until(tokens: &[TokenTree], signs: &str, found: &mut BTreeSet<String>) {
    for token in tokens {
        if sign(Some(token)).is_some_and(|(c, _)| signs.contains(c)) {
            break;
        }
        words(token, found);
    }
}

fn until_in(tokens: &[TokenTree], found: &mut BTreeSet<String>) {
    let is_in = |token: &&TokenTree| matches!(token, TokenTree::Ident(word) if *word == "in");
    tokens.iter().take_while(|token| !is_in(token)).for_each(|token| words(token, found));
}

/// The pattern that stands before `=>`.
fn arm(tokens: &[TokenTree], found: &mut BTreeSet<String>) {
    let is_end = |token: &&TokenTree| sign(Some(token)).is_some_and(|(c, _)| c == ',');
    tokens.iter().rev().take_while(|token| !is_end(token)).for_each(|token| words(token, found));
}

fn words(token: &TokenTree, found: &mut BTreeSet<String>) {
    match token {
        TokenTree::Ident(word) => drop(found.insert(word.to_string())),
        TokenTree::Group(group) => group.stream().into_iter().for_each(|t| words(&t, found)),
        _ => {}
    }
}
