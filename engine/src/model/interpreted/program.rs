//! An expression as a list of steps. Each step computes a number from those before it, in the arithmetic that the
//! compiler would write for the same text: the results are the same to the bit.

use arrayvec::ArrayVec;
use num_dual::DualNum as _;
use pulp::{Arch, NullaryFnOnce};

use super::functions::{MOST, Surrogate, Unary, each};
use crate::num::functions::{max, min, pow};
use crate::num::{Num, Real, ln_sum_exp, within};
use crate::surrogate::{erp_s2, erp_s3};

/// At most so many numbers has an expression, arguments and steps together.
pub(super) const LIMIT: usize = 128;

/// The numbers of `L` evaluations side by side.
pub(super) type Registers<T, const L: usize> = ArrayVec<[Num<T>; L], LIMIT>;

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

    /// All its numbers, in `L` evaluations: to the arguments, which are there, it adds the steps.
    pub(super) fn run<T: Real, const L: usize>(
        &self,
        plain: [&[f64]; L],
        numbers: &mut Registers<T, L>,
    ) {
        let run = Run { program: self, plain, numbers };
        // what is computed alone fills no vector register
        if L == 1 { run.call() } else { Arch::new().dispatch(run) }
    }

    /// The number of a value in one evaluation.
    pub(super) fn value<T: Real>(
        &self,
        value: Value,
        argument: &dyn Fn(usize) -> Num<T>,
        plain: &[f64],
    ) -> Num<T> {
        let mut numbers = Registers::<T, 1>::new();
        numbers.extend((0..self.n).map(|i| [argument(i)]));
        self.run([plain], &mut numbers);
        Numbers { numbers: &numbers, plain: [plain] }.of(value, 0)
    }
}

struct Run<'a, T, const L: usize> {
    program: &'a Program,
    plain: [&'a [f64]; L],
    numbers: &'a mut Registers<T, L>,
}

impl<T: Real, const L: usize> NullaryFnOnce for Run<'_, T, L> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let Self { program, plain, numbers } = self;
        for step in &program.steps {
            let x = step.at(Numbers { numbers, plain });
            numbers.push(x);
        }
    }
}

/// Numbers that are there.
#[derive(Clone, Copy)]
pub(super) struct Numbers<'a, T, const L: usize> {
    pub(super) numbers: &'a Registers<T, L>,
    pub(super) plain: [&'a [f64]; L],
}

impl<T: Real, const L: usize> Numbers<'_, T, L> {
    #[inline(always)]
    fn at(self, i: u32) -> [Num<T>; L] {
        self.numbers[i as usize]
    }

    #[inline(always)]
    pub(super) fn plain(self, i: u32, lane: usize) -> f64 {
        self.plain[lane][i as usize]
    }

    /// The number of a value.
    #[inline(always)]
    pub(super) fn of(self, value: Value, lane: usize) -> Num<T> {
        match value {
            Value::Number(i) => self.numbers[i as usize][lane],
            Value::Plain(i) => Num::from(self.plain(i, lane)),
            Value::Whole(n) => Num::from(f64::from(n)),
        }
    }
}

/// `$a $op $b` of a number with derivatives and of one that may be plain, in each lane.
macro_rules! arithmetic {
    ($of:ident, $a:ident, $b:ident, $op:tt) => {
        match ($a, $b) {
            (Value::Number(a), Value::Number(b)) => {
                let (a, b) = ($of.at(a), $of.at(b));
                each(|lane| a[lane] $op b[lane])
            }
            (Value::Number(a), Value::Plain(b)) => {
                let a = $of.at(a);
                each(|lane| a[lane] $op $of.plain(b, lane))
            }
            (Value::Number(a), Value::Whole(b)) => {
                let a = $of.at(a);
                each(|lane| a[lane] $op b)
            }
            (Value::Plain(a), Value::Number(b)) => {
                let b = $of.at(b);
                each(|lane| $of.plain(a, lane) $op b[lane])
            }
            (Value::Whole(a), Value::Number(b)) => {
                let b = $of.at(b);
                each(|lane| a $op b[lane])
            }
            _ => each(|lane| $of.of($a, lane) $op $of.of($b, lane)),
        }
    };
}

impl Step {
    #[inline(always)]
    fn at<T: Real, const L: usize>(&self, of: Numbers<'_, T, L>) -> [Num<T>; L] {
        match *self {
            Self::Of(value) => each(|lane| of.of(value, lane)),
            Self::Unary(f, x) => {
                let x = of.at(x);
                each(|lane| f.at(x[lane]))
            }
            Self::Powi(x, n) => {
                let x = of.at(x);
                each(|lane| x[lane].powi(n))
            }
            Self::Powf(x, y) => {
                let x = of.at(x);
                each(|lane| x[lane].powf(of.plain(y, lane)))
            }
            Self::Powd(x, y) => {
                let (x, y) = (of.at(x), of.at(y));
                each(|lane| x[lane].powd(y[lane]))
            }
            Self::Operator(op, a, b) => match op {
                Operator::Add => arithmetic!(of, a, b, +),
                Operator::Sub => arithmetic!(of, a, b, -),
                Operator::Mul => arithmetic!(of, a, b, *),
                Operator::Div => arithmetic!(of, a, b, /),
                Operator::Max => each(|lane| max(of.of(a, lane), of.of(b, lane))),
                Operator::Min => each(|lane| min(of.of(a, lane), of.of(b, lane))),
                Operator::Pow => each(|lane| power(of, a, b, lane)),
            },
            // polynomials of the paper, which fill vector registers
            Self::Surrogate(Surrogate::ErpS2, [a, b, ..]) => {
                each(|lane| erp_s2(of.of(a, lane), of.of(b, lane)))
            }
            Self::Surrogate(Surrogate::ErpS3, [a, b, ..]) => {
                each(|lane| erp_s3(of.of(a, lane), of.of(b, lane)))
            }
            Self::Surrogate(f, arguments) => each(|lane| f.at(arguments.map(|x| of.of(x, lane)))),
            Self::LnSumExp(ref terms) => each(|lane| {
                let terms: Vec<Num<T>> =
                    terms.iter().map(|x| of.numbers[*x as usize][lane]).collect();
                ln_sum_exp(&terms)
            }),
            Self::Within(low, high, x) => {
                let x = of.at(x);
                each(|lane| within(low, high, x[lane]))
            }
        }
    }
}

fn power<T: Real, const L: usize>(
    of: Numbers<'_, T, L>,
    a: Value,
    b: Value,
    lane: usize,
) -> Num<T> {
    match (a, b) {
        (a, Value::Whole(n)) => pow(of.of(a, lane), n),
        (a, Value::Plain(b)) => pow(of.of(a, lane), of.plain(b, lane)),
        (Value::Plain(a), b) => pow(of.plain(a, lane), of.of(b, lane)),
        (Value::Whole(a), b) => pow(a, of.of(b, lane)),
        _ => pow(of.of(a, lane), of.of(b, lane)),
    }
}
