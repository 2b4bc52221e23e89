//! The unit of an expression, from the units of the names it mentions.
//!
//! Sums and comparisons need equal units, products multiply them. A plain number has any unit in a sum
//! or beside what has none, and none in a product with a dimensional quantity. What is not understood
//! (a user's function, `exp(x)`, a block) is unknown, and what is unknown agrees with everything.

use proc_macro2::Span;
use syn::{BinOp, Expr, Lit, Member, UnOp};

use super::unit::Unit;
use crate::mistake::span_of;
use crate::print;
use crate::vocabulary::{Class, Role, find};

/// What is known of an expression's unit.
#[derive(Clone, Copy, Debug)]
pub(super) enum Known {
    /// Nothing.
    Nothing,
    /// It is a plain number.
    Number,
    /// Its unit.
    Unit(Unit),
}

/// The unit that an expression should have, and why.
#[derive(Clone, Debug)]
pub(super) struct Wanted {
    pub(super) unit: Unit,
    pub(super) why: String,
}

/// An expression whose unit is not the wanted one.
#[derive(Debug)]
pub(super) struct Mismatch {
    pub(super) expression: String,
    /// Where it stands.
    pub(super) span: Span,
    /// The wanted unit, and why.
    pub(super) expected: String,
    pub(super) got: String,
}

/// Declared units, as far as they are known.
pub(super) trait Names {
    /// Of a parameter, field or `let`.
    fn name(&self, name: &str) -> Option<Unit>;
    /// Of a column of the row.
    fn column(&self, name: &str) -> Option<Unit>;
}

impl Known {
    pub(super) fn unit(self) -> Option<Unit> {
        if let Known::Unit(unit) = self { Some(unit) } else { None }
    }

    pub(super) fn of(unit: Option<Unit>) -> Self {
        unit.map_or(Known::Nothing, Known::Unit)
    }

    /// Of a sum of both.
    fn or(self, other: Self) -> Self {
        match (self, other) {
            (Known::Unit(_), _) => self,
            (_, Known::Unit(_)) | (Known::Number, _) => other,
            _ => self,
        }
    }

    /// This, if it may have the wanted unit; `e` stands at `span`.
    pub(super) fn wanted(
        self,
        wanted: Option<&Wanted>,
        span: Span,
        e: impl FnOnce() -> String,
    ) -> Result<Self, Mismatch> {
        match (self, wanted) {
            (Known::Unit(got), Some(wanted)) if !got.agrees(wanted.unit) => {
                let expected = format!("{} {}", wanted.unit, wanted.why);
                Err(Mismatch { expression: e(), span, expected, got: got.to_string() })
            }
            _ => Ok(self),
        }
    }

    /// Of a product with the other to the power ±1.
    pub(super) fn times(self, other: Self, power: i32) -> Self {
        match (self, other) {
            (Known::Nothing, _) | (_, Known::Nothing) => Known::Nothing,
            (Known::Number, Known::Number) => Known::Number,
            // 3.0 * gp(…): the number may be a time
            (Known::Unit(a), Known::Number) | (Known::Number, Known::Unit(a))
                if a.is_dimensionless() =>
            {
                Known::Number
            }
            (Known::Unit(a), Known::Number) => Known::Unit(a.rescaled()),
            (Known::Number, Known::Unit(b)) => Known::Unit(b.powi(power).rescaled()),
            (Known::Unit(a), Known::Unit(b)) => Known::Unit(a.times(b, power)),
        }
    }
}

impl Wanted {
    /// The unit of the first operand, for the second.
    fn like(known: Known, e: &Expr) -> Option<Self> {
        known.unit().map(|unit| Wanted { unit, why: format!("like `{}`", print(e)) })
    }
}

/// The unit of `e`, which should be `wanted`.
pub(super) fn check(
    e: &Expr,
    wanted: Option<&Wanted>,
    names: &dyn Names,
) -> Result<Known, Mismatch> {
    let known = match e {
        Expr::Paren(e) => return check(&e.expr, wanted, names),
        Expr::Group(e) => return check(&e.expr, wanted, names),
        Expr::Reference(e) => return check(&e.expr, wanted, names),
        Expr::Unary(e) if matches!(e.op, UnOp::Neg(_)) => return check(&e.expr, wanted, names),
        Expr::Binary(e) => match e.op {
            BinOp::Add(_) | BinOp::Sub(_) => return alike(&e.left, &e.right, wanted, names),
            BinOp::Mul(_) => check(&e.left, None, names)?.times(check(&e.right, None, names)?, 1),
            BinOp::Div(_) => check(&e.left, None, names)?.times(check(&e.right, None, names)?, -1),
            BinOp::Lt(_) | BinOp::Le(_) | BinOp::Gt(_) | BinOp::Ge(_) => {
                alike(&e.left, &e.right, None, names)?;
                Known::Nothing
            }
            _ => Known::Nothing,
        },
        Expr::Lit(_) => Known::Number,
        Expr::Path(e) => Known::of(e.path.get_ident().and_then(|i| names.name(&i.to_string()))),
        Expr::Index(e) => check(&e.expr, None, names)?,
        Expr::Field(e) => match &e.member {
            Member::Named(column) => Known::of(names.column(&column.to_string())),
            Member::Unnamed(_) => Known::Nothing,
        },
        Expr::Call(e) => call(e, wanted, names)?,
        Expr::MethodCall(e) => {
            let of = check(&e.receiver, None, names)?;
            elementary(&e.method.to_string(), of, e.args.first())
        }
        _ => Known::Nothing,
    };
    known.wanted(wanted, span_of(e), || print(e))
}

/// Two expressions that need the same unit.
fn alike(
    left: &Expr,
    right: &Expr,
    wanted: Option<&Wanted>,
    names: &dyn Names,
) -> Result<Known, Mismatch> {
    let first = check(left, wanted, names)?;
    let like = Wanted::like(first, left);
    Ok(first.or(check(right, wanted.or(like.as_ref()), names)?))
}

/// `tau_out(x)` has the unit of its name; priors, likelihoods and kernels say what their arguments
/// should be. Of any other function the arguments are looked into, and the result is unknown.
fn call(e: &syn::ExprCall, wanted: Option<&Wanted>, names: &dyn Names) -> Result<Known, Mismatch> {
    let Expr::Path(path) = &*e.func else { return Ok(Known::Nothing) };
    let function = path.path.get_ident().map(ToString::to_string).unwrap_or_default();
    if let Some(unit) = names.name(&function) {
        return Ok(Known::Unit(unit));
    }
    match (function.as_str(), &e.args.iter().collect::<Vec<_>>()[..]) {
        ("max" | "min", [a, b]) => return alike(a, b, wanted, names),
        ("abs" | "sqrt" | "pow", [of, exponent @ ..]) => {
            return Ok(elementary(&function, check(of, None, names)?, exponent.first().copied()));
        }
        _ => {}
    }
    let word = find(&function);
    let mut wanted = wanted.cloned();
    if word.is_some_and(|word| word.classes.contains(&Class::Kernel)) {
        let why = "like every lengthscale".into();
        wanted = Unit::parse("mm").map(|unit| Wanted { unit, why });
    }
    for (i, argument) in e.args.iter().enumerate() {
        match word.and_then(|word| word.arguments.get(i)).map(|(_, role)| role) {
            Some(Role::Inner) => {
                check(argument, wanted.as_ref(), names)?;
            }
            Some(Role::Same) => {
                let known = check(argument, wanted.as_ref(), names)?;
                wanted = wanted.or(Wanted::like(known, argument));
            }
            Some(Role::Inverse) => {
                let inverse = |w: &Wanted| Wanted {
                    unit: w.unit.powi(-1),
                    why: format!("for a rate of what is in {}", w.unit),
                };
                check(argument, wanted.as_ref().map(inverse).as_ref(), names)?;
            }
            Some(Role::Other) | None => {
                check(argument, None, names)?;
            }
        }
    }
    Ok(if function == "gp" { Known::Unit(Unit::one()) } else { Known::Nothing })
}

/// Of a function of one quantity, `sqrt(x)` or `x.sqrt()`; `exponent` is its further argument.
fn elementary(function: &str, of: Known, exponent: Option<&Expr>) -> Known {
    match (function, of) {
        ("abs", _) => of,
        ("sqrt" | "recip" | "powi" | "pow", Known::Number) => Known::Number,
        ("sqrt", Known::Unit(unit)) => Known::of(unit.sqrt()),
        ("recip", Known::Unit(unit)) => Known::Unit(unit.powi(-1)),
        ("powi" | "pow", Known::Unit(unit)) => {
            Known::of(exponent.and_then(integer).map(|n| unit.powi(n)))
        }
        _ => Known::Nothing,
    }
}

/// `2` or `-1`.
fn integer(e: &Expr) -> Option<i32> {
    match e {
        Expr::Lit(e) => match &e.lit {
            Lit::Int(n) => n.base10_parse::<i8>().ok().map(i32::from),
            _ => None,
        },
        Expr::Unary(e) if matches!(e.op, UnOp::Neg(_)) => Some(-integer(&e.expr)?),
        _ => None,
    }
}
