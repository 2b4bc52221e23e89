//! An expression as a person would write it: its tokens, with blanks where they belong.

use proc_macro2::{Delimiter, Group, Spacing, TokenStream, TokenTree};
use quote::ToTokens;

/// Signs of more than one character, longest first.
const LONG: &[&str] = &[
    "..=", "...", "<<=", ">>=", "::", "->", "=>", "==", "!=", "<=", ">=", "&&", "||", "+=", "-=",
    "*=", "/=", "%=", "^=", "&=", "|=", "<<", ">>", "..",
];

/// Words after which a bracket begins something new, not the arguments of a call.
const WORDS: &[&str] = &[
    "if", "else", "match", "return", "in", "let", "mut", "as", "while", "for", "loop", "move",
    "ref", "break", "from", "where",
];

/// The tokens of `e`, as a person would write them.
///
/// ```
/// let e: syn::Expr = syn::parse_str("f ( x ) *2.0- surrogate :: g ( - a , row . dose )").unwrap();
/// assert_eq!(eplat_language::print(&e), "f(x) * 2.0 - surrogate::g(-a, row.dose)");
/// ```
pub fn print(e: &impl ToTokens) -> String {
    let mut printer = Printer::default();
    printer.all(e.to_token_stream());
    printer.text
}

/// What was printed last, as far as the next blank depends on it.
#[derive(Clone, Copy, Default, PartialEq)]
enum Last {
    /// Nothing yet, or an opening bracket.
    #[default]
    Open,
    /// A name, a number or a closing bracket: what an operator may follow.
    Operand,
    /// A word such as `if`.
    Word,
    /// A sign between two operands, a comma or a semicolon.
    Between,
    /// A sign that belongs to what follows: `-` of `-x`, `.`, `::`.
    Tight,
}

#[derive(Default)]
struct Printer {
    text: String,
    last: Last,
    /// Whether the bar that closes a closure's arguments is still to come.
    in_closure: bool,
    /// How many `<` of a path are open: `Vec::<f64>`.
    generics: usize,
}

impl Printer {
    fn all(&mut self, tokens: TokenStream) {
        let tokens: Vec<TokenTree> = tokens.into_iter().collect();
        let mut i = 0;
        while i < tokens.len() {
            i += match &tokens[i] {
                TokenTree::Group(group) => self.group(group),
                TokenTree::Ident(word) => self.word(&word.to_string()),
                TokenTree::Literal(literal) => self.operand(&literal.to_string()),
                TokenTree::Punct(_) => self.sign(&tokens[i..]),
            };
        }
    }

    /// A blank, unless what stands before joins what follows.
    fn blank(&mut self) {
        if matches!(self.last, Last::Operand | Last::Word | Last::Between) {
            self.text.push(' ');
        }
    }

    fn operand(&mut self, text: &str) -> usize {
        self.blank();
        self.text += text;
        self.last = Last::Operand;
        1
    }

    fn word(&mut self, word: &str) -> usize {
        self.operand(word);
        self.last = if WORDS.contains(&word) { Last::Word } else { Last::Operand };
        1
    }

    /// A bracket: tight behind a name, `f(x)`, apart elsewhere, `a * (b + c)`.
    fn group(&mut self, group: &Group) -> usize {
        let (open, close) = match group.delimiter() {
            Delimiter::Parenthesis => ("(", ")"),
            Delimiter::Bracket => ("[", "]"),
            Delimiter::Brace => ("{ ", " }"),
            Delimiter::None => ("", ""),
        };
        if self.last != Last::Operand || group.delimiter() == Delimiter::Brace {
            self.blank();
        }
        if group.stream().is_empty() {
            self.text += open.trim_end();
            self.text += close.trim_start();
        } else {
            self.text += open;
            self.last = Last::Open;
            self.all(group.stream());
            self.text += close;
        }
        self.last = Last::Operand;
        1
    }

    /// A sign, with all the characters that it is of; gives how many tokens these are.
    fn sign(&mut self, tokens: &[TokenTree]) -> usize {
        let sign = sign(tokens);
        let is_first = !matches!(self.last, Last::Operand);
        match sign.as_str() {
            "," | ";" | ":" => self.tight(&sign, Last::Between),
            "." | "::" | ".." | "..=" => {
                if is_first && sign.starts_with("..") && self.last != Last::Open {
                    self.blank();
                }
                self.tight(&sign, Last::Tight);
            }
            "?" => self.tight(&sign, Last::Operand),
            "!" if !is_first => self.tight(&sign, Last::Operand), // of a macro's name
            "'" => {
                self.blank();
                self.tight(&sign, Last::Tight);
            }
            "<" if self.text.ends_with("::") || self.generics > 0 => {
                self.generics += 1;
                self.tight(&sign, Last::Tight);
            }
            ">" if self.generics > 0 => {
                self.generics -= 1;
                self.tight(&sign, Last::Operand);
            }
            "|" if self.in_closure => {
                self.in_closure = false;
                self.tight(&sign, Last::Between);
            }
            "|" if is_first => {
                self.blank();
                self.in_closure = true;
                self.tight(&sign, Last::Tight);
            }
            "||" if is_first => {
                self.blank();
                self.tight(&sign, Last::Between);
            }
            "-" | "!" | "&" | "*" | "&&" if is_first => {
                self.blank();
                self.tight(&sign, Last::Tight);
            }
            _ => {
                self.blank();
                self.tight(&sign, Last::Between);
            }
        }
        sign.len()
    }

    fn tight(&mut self, sign: &str, last: Last) {
        self.text += sign;
        self.last = last;
    }
}

/// The sign that begins `tokens`.
fn sign(tokens: &[TokenTree]) -> String {
    let mut joined = String::new();
    for token in tokens {
        let TokenTree::Punct(punct) = token else { break };
        joined.push(punct.as_char());
        if punct.spacing() == Spacing::Alone {
            break;
        }
    }
    let long = LONG.iter().find(|long| joined.starts_with(**long));
    long.map_or_else(|| joined.chars().take(1).collect(), ToString::to_string)
}

#[cfg(test)]
mod tests {
    use std::str::FromStr as _;

    use super::*;

    #[test]
    fn what_a_person_wrote_is_printed_as_it_was() {
        for text in [
            "f(x) * 2.0 - -a + (b - c) / d[0]",
            "(m + 1.0) + alpha * gp(authors(Rbf(rho)), K = 24)",
            "if t < 3.0 { t } else { a_users(d) }",
            "Dirichlet([1.0, 2.0, 4.0])",
            "from (row.a / row.b) ~ Normal(-alpha1 + 1.0, s)",
            "x.iter().map(|x| *x - 1.0).fold(0.0, |a, b| a + b)",
            "vec![1.0; 3][0]",
            "(0..n).map(f64::from).sum::<f64>()",
            "[a, b][0]?.c.powi(-2) as f64",
            "!(a && b || c)",
            "f(&x, || 1.0, {})",
            "linear(row.a, row.b; beta)",
        ] {
            assert_eq!(print(&TokenStream::from_str(text).unwrap()), text);
        }
    }
}
