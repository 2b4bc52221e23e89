//! An expression as a list of steps. Each step computes a number from those before it, in the arithmetic that the
//! compiler would write for the same text: the results are the same to the bit.

use arrayvec::ArrayVec;
use num_dual::DualNum as _;

use super::functions::{MOST, Surrogate, Unary};
use crate::num::functions::{max, min, pow};
use crate::num::{Num, Real, ln_sum_exp, within};

/// At most so many numbers has an expression, arguments and steps together.
pub(super) const LIMIT: usize = 128;

/// The numbers of one evaluation.
pub(super) type Registers<T> = ArrayVec<Num<T>, LIMIT>;

/// What a part of an expression is: where its number stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Value {
    /// A number with derivatives.
    Number(u32),
    /// A plain number, which columns and constants alone decide.
    Plain(u32),
    /// A whole number as it is written.
    Whole(i32),
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Operator {
    Add,
    Sub,
    Mul,
    Div,
    Max,
    Min,
    Pow,
}

/// A step whose result is a plain number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum PlainStep {
    Constant(f64),
    /// A cell of the row.
    Cell(u32),
    Unary(Unary, u32),
    Powi(u32, i32),
    Operator(Operator, u32, u32),
}

/// A step whose result is a number with derivatives.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Step {
    /// A plain number, or a number as it is.
    Of(Value),
    Unary(Unary, u32),
    Powi(u32, i32),
    Powf(u32, u32),
    Powd(u32, u32),
    Operator(Operator, Value, Value),
    Surrogate(Surrogate, [Value; MOST]),
    LnSumExp(Box<[u32]>),
    Within(f64, f64, u32),
}

/// An expression of `n` numbers.
#[derive(Clone, Debug, Default)]
pub(super) struct Program {
    pub(super) n: usize,
    pub(super) plain: Vec<PlainStep>,
    pub(super) steps: Vec<Step>,
}

impl Program {
    /// The plain numbers of a row with these cells.
    pub(super) fn plain(&self, cells: &[f64]) -> Vec<f64> {
        let mut of = Vec::with_capacity(self.plain.len());
        for step in &self.plain {
            let at = |i: u32| of[i as usize];
            let x: f64 = match *step {
                PlainStep::Constant(x) => x,
                PlainStep::Cell(i) => cells[i as usize],
                PlainStep::Unary(f, x) => f.at(at(x)),
                PlainStep::Powi(x, n) => at(x).powi(n),
                PlainStep::Operator(op, a, b) => {
                    let (a, b): (f64, f64) = (at(a), at(b));
                    match op {
                        Operator::Add => a + b,
                        Operator::Sub => a - b,
                        Operator::Mul => a * b,
                        Operator::Div => a / b,
                        Operator::Max => max(a, b),
                        Operator::Min => min(a, b),
                        Operator::Pow => a.powf(b),
                    }
                }
            };
            of.push(x);
        }
        of
    }

    /// All its numbers: arguments, then steps.
    pub(super) fn run<T: Real>(
        &self,
        argument: &dyn Fn(usize) -> Num<T>,
        plain: &[f64],
        numbers: &mut Registers<T>,
    ) {
        numbers.clear();
        numbers.extend((0..self.n).map(argument));
        for step in &self.steps {
            let x = step.at(&Numbers { numbers, plain });
            numbers.push(x);
        }
    }
}

/// Numbers that are there.
#[derive(Clone, Copy)]
pub(super) struct Numbers<'a, T> {
    pub(super) numbers: &'a Registers<T>,
    pub(super) plain: &'a [f64],
}

impl<T: Real> Numbers<'_, T> {
    #[inline(always)]
    fn at(self, i: u32) -> Num<T> {
        self.numbers[i as usize]
    }

    pub(super) fn plain(self, i: u32) -> f64 {
        self.plain[i as usize]
    }

    /// The number of a value.
    #[inline(always)]
    pub(super) fn of(self, value: Value) -> Num<T> {
        match value {
            Value::Number(i) => self.at(i),
            Value::Plain(i) => Num::from(self.plain(i)),
            Value::Whole(n) => Num::from(f64::from(n)),
        }
    }
}

/// `$a $op $b` of a number with derivatives and of one that may be plain.
macro_rules! arithmetic {
    ($of:ident, $a:ident, $b:ident, $op:tt) => {
        match ($a, $b) {
            (Value::Number(a), Value::Number(b)) => $of.at(a) $op $of.at(b),
            (Value::Number(a), Value::Plain(b)) => $of.at(a) $op $of.plain(b),
            (Value::Number(a), Value::Whole(b)) => $of.at(a) $op b,
            (Value::Plain(a), Value::Number(b)) => $of.plain(a) $op $of.at(b),
            (Value::Whole(a), Value::Number(b)) => a $op $of.at(b),
            _ => $of.of($a) $op $of.of($b),
        }
    };
}

impl Step {
    #[inline(always)]
    fn at<T: Real>(&self, of: &Numbers<'_, T>) -> Num<T> {
        match *self {
            Self::Of(value) => of.of(value),
            Self::Unary(f, x) => f.at(of.at(x)),
            Self::Powi(x, n) => of.at(x).powi(n),
            Self::Powf(x, y) => of.at(x).powf(of.plain(y)),
            Self::Powd(x, y) => of.at(x).powd(of.at(y)),
            Self::Operator(op, a, b) => match op {
                Operator::Add => arithmetic!(of, a, b, +),
                Operator::Sub => arithmetic!(of, a, b, -),
                Operator::Mul => arithmetic!(of, a, b, *),
                Operator::Div => arithmetic!(of, a, b, /),
                Operator::Max => max(of.of(a), of.of(b)),
                Operator::Min => min(of.of(a), of.of(b)),
                Operator::Pow => power(of, a, b),
            },
            Self::Surrogate(f, arguments) => f.at(arguments.map(|x| of.of(x))),
            Self::LnSumExp(ref terms) => {
                let terms: Vec<Num<T>> = terms.iter().map(|x| of.at(*x)).collect();
                ln_sum_exp(&terms)
            }
            Self::Within(low, high, x) => within(low, high, of.at(x)),
        }
    }
}

fn power<T: Real>(of: &Numbers<'_, T>, a: Value, b: Value) -> Num<T> {
    match (a, b) {
        (Value::Number(a), Value::Whole(n)) => pow(of.at(a), n),
        (Value::Number(a), Value::Plain(b)) => pow(of.at(a), of.plain(b)),
        (Value::Plain(a), Value::Number(b)) => pow(of.plain(a), of.at(b)),
        (Value::Whole(a), Value::Number(b)) => pow(a, of.at(b)),
        _ => pow(of.of(a), of.of(b)),
    }
}
