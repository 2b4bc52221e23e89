//! Expressions that are linear in some of the things that they mention.

use syn::{BinOp, UnOp};

use crate::syntax::Expr;

/// Whether `e` is a sum of terms, each times or by something free, up to something free. `is_free` says what mentions
/// nothing that terms are made of, `is_term` what is a term without a factor.
pub(crate) fn is_linear(
    e: &Expr,
    is_free: &dyn Fn(&Expr) -> bool,
    is_term: &dyn Fn(&Expr) -> bool,
) -> bool {
    let linear = |e: &Expr| is_linear(e, is_free, is_term);
    match e {
        _ if is_free(e) || is_term(e) => true,
        Expr::Paren(e) => linear(&e.expr),
        Expr::Group(e) => linear(&e.expr),
        Expr::Unary(e) => matches!(e.op, UnOp::Neg(_)) && linear(&e.expr),
        Expr::Binary(e) => match e.op {
            BinOp::Add(_) | BinOp::Sub(_) => linear(&e.left) && linear(&e.right),
            BinOp::Mul(_) => {
                is_free(&e.left) && linear(&e.right) || linear(&e.left) && is_free(&e.right)
            }
            BinOp::Div(_) => linear(&e.left) && is_free(&e.right),
            _ => false,
        },
        _ => false,
    }
}

/// Whether `e` is a sum of terms without factors, up to something free; the rest as in [`is_linear`].
pub(crate) fn is_sum(
    e: &Expr,
    is_free: &dyn Fn(&Expr) -> bool,
    is_term: &dyn Fn(&Expr) -> bool,
) -> bool {
    let sum = |e: &Expr| is_sum(e, is_free, is_term);
    match e {
        _ if is_free(e) || is_term(e) => true,
        Expr::Paren(e) => sum(&e.expr),
        Expr::Group(e) => sum(&e.expr),
        Expr::Unary(e) => matches!(e.op, UnOp::Neg(_)) && sum(&e.expr),
        Expr::Binary(e) => {
            matches!(e.op, BinOp::Add(_) | BinOp::Sub(_)) && sum(&e.left) && sum(&e.right)
        }
        _ => false,
    }
}
