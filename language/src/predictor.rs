//! Linear predictors: expressions of a row that are sums of parameters, each times a factor that the
//! row's columns alone decide. Such a factor is the same at every draw, so a model computes it once.
//!
//! ```text
//! a + b[0] * row.dose - (c + 1.0) / row.weight.sqrt()
//! ```
//! What is no such expression stays as it is.

use quote::ToTokens as _;
use syn::{BinOp, Ident, parse_quote};

use crate::linear::is_linear;
use crate::names::mentions;
use crate::syntax::{Expr, Item, Model, Over};

/// An expression from which linear predictors are taken.
#[allow(missing_debug_implementations, reason = "syn's expressions have none")]
pub struct Parted {
    /// The expression, with `NAME(row)` in place of each predictor.
    pub expr: Expr,
    /// Name and expression of each predictor.
    pub predictors: Vec<(Ident, Expr)>,
}

impl Model {
    /// Whether `e` is a linear predictor: it is linear in at least two parameters, and reads a column of what it calls
    /// `row`. In a model with fields there is none, because how fields enter a measurement decides
    /// which sampler serves it.
    pub fn is_predictor(&self, e: &Expr, row: &Ident) -> bool {
        let has_fields = self.statements.iter().any(|s| matches!(s.item, Item::Field(_)));
        let reads_row = || mentions(e).iter().any(|mention| mention.name == *row);
        !has_fields && self.is_linear_in_parameters(e) && reads_row() && self.n_parameters(e) > 1
    }

    /// `e` with a name in place of the largest linear predictors in it. Number k of these is called `name(k)`.
    /// What stands in closures, blocks and macros is left as it is.
    pub fn parted(&self, e: &Expr, row: &Ident, name: &dyn Fn(usize) -> Ident) -> Parted {
        let (mut expr, mut predictors) = (e.clone(), vec![]);
        self.part(&mut expr, row, name, &mut predictors);
        Parted { expr, predictors }
    }

    fn part(
        &self,
        e: &mut Expr,
        row: &Ident,
        name: &dyn Fn(usize) -> Ident,
        found: &mut Vec<(Ident, Expr)>,
    ) {
        if let Some(sum) = self.gathered(e, row) {
            *e = sum;
        }
        if self.is_predictor(e, row) {
            let text = |e: &Expr| e.to_token_stream().to_string();
            let known = found.iter().find(|(_, other)| text(other) == text(e));
            let own = known.map_or_else(|| name(found.len()), |(own, _)| own.clone());
            if known.is_none() {
                found.push((own.clone(), e.clone()));
            }
            *e = parse_quote!(#own(#row));
            return;
        }
        let mut part = |e: &mut Expr| self.part(e, row, name, found);
        match e {
            Expr::Paren(e) => part(&mut e.expr),
            Expr::Group(e) => part(&mut e.expr),
            Expr::Unary(e) => part(&mut e.expr),
            Expr::Binary(e) => {
                part(&mut e.left);
                part(&mut e.right);
            }
            Expr::Call(e) => e.args.iter_mut().for_each(part),
            Expr::MethodCall(e) => {
                part(&mut e.receiver);
                e.args.iter_mut().for_each(part);
            }
            _ => {}
        }
    }

    /// The same sum with its linear terms first, between brackets, if these make a linear predictor and others remain:
    /// `c(row) + a - d(row) + b * row.dose` as `(a + b * row.dose) + c(row) - d(row)`.
    fn gathered(&self, e: &Expr, row: &Ident) -> Option<Expr> {
        let mut terms = vec![];
        collect(e, false, &mut terms);
        let (linear, others): (Vec<_>, Vec<_>) =
            terms.into_iter().partition(|(_, term)| self.is_linear_in_parameters(term));
        let linear = sum(None, &linear)?;
        let is_apart = !others.is_empty() && self.is_predictor(&linear, row);
        if is_apart { sum(Some(parse_quote!((#linear))), &others) } else { None }
    }

    /// Whether `e` is a sum of parameters times what [`Model::is_known`], up to something that is known.
    fn is_linear_in_parameters(&self, e: &Expr) -> bool {
        let is_parameter = |e: &Expr| match e {
            Expr::Path(_) => matches!(self.parameter(e), Some(Over::One)),
            Expr::Index(e) => {
                matches!(self.parameter(&e.expr), Some(Over::Many(_))) && self.is_known(&e.index)
            }
            _ => false,
        };
        let is_known = |e: &Expr| self.is_known(e);
        is_linear(e, &is_known, &is_known, &is_parameter)
    }

    /// Whether `e` is the same at every draw: it mentions no parameter, no `let`, no field and no column with a prior.
    fn is_known(&self, e: &Expr) -> bool {
        mentions(e).iter().all(|mention| {
            !self.statements.iter().any(|statement| match &statement.item {
                Item::Column(column) => {
                    column.prior.is_some() && mention.member.as_ref() == Some(&column.name)
                }
                Item::Param(_) | Item::Let(_) | Item::Field(_) => {
                    mention.name == *statement.item.name()
                }
                _ => false,
            })
        })
    }

    /// What the parameter that `e` names varies over.
    fn parameter(&self, e: &Expr) -> Option<&Over> {
        let Expr::Path(path) = e else { return None };
        let name = path.path.get_ident()?;
        self.statements.iter().find_map(|statement| match &statement.item {
            Item::Param(param) if param.name == *name => Some(&param.over),
            _ => None,
        })
    }

    /// How many numbers the parameters that `e` mentions have.
    fn n_parameters(&self, e: &Expr) -> usize {
        let mentioned = mentions(e);
        let numbers = self.statements.iter().map(|statement| match &statement.item {
            Item::Param(param) if mentioned.iter().any(|m| m.name == param.name) => {
                if let Over::Many(n) = param.over {
                    n
                } else {
                    1
                }
            }
            _ => 0,
        });
        numbers.sum()
    }
}

/// The terms of a sum, each with whether it is subtracted.
fn collect<'e>(e: &'e Expr, is_minus: bool, terms: &mut Vec<(bool, &'e Expr)>) {
    let inner = match e {
        Expr::Paren(paren) => &paren.expr,
        e => e,
    };
    match inner {
        Expr::Binary(sum) if matches!(sum.op, BinOp::Add(_) | BinOp::Sub(_)) => {
            collect(&sum.left, is_minus, terms);
            collect(&sum.right, is_minus != matches!(sum.op, BinOp::Sub(_)), terms);
        }
        _ => terms.push((is_minus, e)),
    }
}

/// The sum of what there is and of `terms`.
fn sum(first: Option<Expr>, terms: &[(bool, &Expr)]) -> Option<Expr> {
    terms.iter().fold(first, |sum, (is_minus, term)| {
        Some(match (sum, is_minus) {
            (None, false) => (*term).clone(),
            (None, true) => parse_quote!(-#term),
            (Some(sum), false) => parse_quote!(#sum + #term),
            (Some(sum), true) => parse_quote!(#sum - #term),
        })
    })
}

#[cfg(test)]
mod tests {
    use crate::File;
    use crate::syntax::{Item, Value};
    use syn::{Expr, Ident, parse_str};

    fn model(value: &str, field: &str) -> crate::syntax::Model {
        let text = format!(
            "model! {{
                model M;
                column dose;
                column x(3);
                column seen ~ Normal(0.0, 1.0);
                param a ~ Normal(0.0, 1.0);
                param b(2) ~ Normal(0.0, 1.0);
                param c(group) ~ Normal(0.0, 1.0);
                {field}
                let other(row) = a.exp() * row.dose;
                let eta(row) = {value};
                observe y(row): Number ~ Normal(eta(row), 1.0);
            }}"
        );
        File::read(&text).unwrap_or_else(|mistake| panic!("{value}: {}", mistake.message)).model
    }

    fn is_predictor(value: &str, field: &str) -> bool {
        let model = model(value, field);
        let eta = model.statements.iter().rev().find_map(|s| match &s.item {
            Item::Let(eta) => Some(eta),
            _ => None,
        });
        let Value::Expr(e) = &eta.unwrap().value else { panic!() };
        model.is_predictor(e, &eta.unwrap().row)
    }

    #[test]
    fn sums_of_parameters_times_columns_are_linear_predictors() {
        for linear in [
            "a + b[0] * row.dose + b[1] * row.dose * row.dose",
            "-(a - 2.0 * b[1]) * (row.dose - 50.0) / 10.0 + 3.0",
            "row.x[0] * b[0] + row.x[2] * a",
            "(a + b[0]) * row.dose.sqrt().max(1.0)",
            "a * exp(row.dose) + (b[1] / row.x[1] - row.dose)",
            "b[0] * row.dose",
        ] {
            assert!(is_predictor(linear, ""), "{linear}");
        }
    }

    #[test]
    fn what_is_not_linear_or_has_one_parameter_or_no_column_is_none() {
        for other in [
            "a * b[0] * row.dose",
            "a + row.dose / b[0]",
            "(a + b[0] * row.dose).exp()",
            "exp(a) + b[0] * row.dose",
            "a.powi(2) + b[0] * row.dose",
            "a * row.dose",
            "a + b[0]",
            "a + b[0] * row.seen",
            "c(row) + a + b[0] * row.dose",
            "other(row) + a + b[0] * row.dose",
            "{ let d = a; d + b[0] * row.dose }",
            "if row.dose > 1.0 { a + b[0] } else { a }",
        ] {
            assert!(!is_predictor(other, ""), "{other}");
        }
        let linear = "a + b[0] * row.dose";
        assert!(is_predictor(linear, ""));
        assert!(!is_predictor(linear, "field f(x) = gp(Rbf(2.0), K = 4);"));
    }

    #[test]
    fn the_largest_predictors_of_an_expression_are_taken_out_of_it() {
        let model = model("a + b[0] * row.dose", "");
        let parted = |text: &str| {
            let (e, row) = (parse_str::<Expr>(text).unwrap(), parse_str::<Ident>("row").unwrap());
            let parted = model.parted(&e, &row, &|k| quote::format_ident!("p{k}"));
            let all =
                parted.predictors.iter().map(|(name, e)| format!("{name}: {}", crate::print(e)));
            (crate::print(&parted.expr), all.collect::<Vec<_>>().join("; "))
        };
        let both = |a: &str, b: &str| (a.to_string(), b.to_string());
        assert_eq!(
            parted("Normal(a + b[0] * row.dose, exp(b[1] + a * row.dose) + c(row))"),
            both(
                "Normal(p0(row), exp(p1(row)) + c(row))",
                "p0: a + b[0] * row.dose; p1: b[1] + a * row.dose"
            )
        );
        assert_eq!(
            parted(
                "Outliers(Normal((a + b[1] * row.dose), 1.0 / (a + b[1] * row.dose).powi(2)), 0.1, 9.0)"
            ),
            both(
                "Outliers(Normal(p0(row), 1.0 / p0(row).powi(2)), 0.1, 9.0)",
                "p0: (a + b[1] * row.dose)"
            )
        );
        assert_eq!(
            parted("c(row) + a - (exp(a) - b[1] * row.dose)"),
            both("p0(row) + c(row) - exp(a)", "p0: (a + b[1] * row.dose)")
        );
        let whole = "Normal(eta(row) + a, f(|x| a + b[0] * row.dose))";
        assert_eq!(parted(whole), both(whole, ""));
    }
}
