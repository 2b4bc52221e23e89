//! Expressions that are linear in some of the things that they mention.

use syn::{BinOp, UnOp};

use crate::syntax::Expr;

/// Whether `e` is a sum of terms, each times or by a factor, up to something free. `is_free` says what mentions nothing that
/// terms are made of, `is_factor` what may be a factor, `is_term` what is a term without one.
pub(crate) fn is_linear(
    e: &Expr,
    is_free: &dyn Fn(&Expr) -> bool,
    is_factor: &dyn Fn(&Expr) -> bool,
    is_term: &dyn Fn(&Expr) -> bool,
) -> bool {
    let linear = |e: &Expr| is_linear(e, is_free, is_factor, is_term);
    match e {
        _ if is_free(e) || is_term(e) => true,
        Expr::Paren(e) => linear(&e.expr),
        Expr::Group(e) => linear(&e.expr),
        Expr::Unary(e) => matches!(e.op, UnOp::Neg(_)) && linear(&e.expr),
        Expr::Binary(e) => match e.op {
            BinOp::Add(_) | BinOp::Sub(_) => linear(&e.left) && linear(&e.right),
            BinOp::Mul(_) => {
                is_factor(&e.left) && linear(&e.right) || linear(&e.left) && is_factor(&e.right)
            }
            BinOp::Div(_) => linear(&e.left) && is_factor(&e.right),
            _ => false,
        },
        _ => false,
    }
}
