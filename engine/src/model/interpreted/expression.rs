//! From the text of an expression to a program. What is read here means what the compiler would make of the same
//! text; all else is left to the compiler.

use std::collections::BTreeMap;
use std::f64::consts;

use eplat_language::plan::Function;
use eplat_language::print;
use eplat_language::syntax::{Expr, Ident};
use proc_macro2::TokenStream;
use syn::{BinOp, Lit, Member, UnOp};

use super::functions::Unary;
use super::program::{LIMIT, Operator, PlainStep, Program, Step, Value};
use super::rows::Columns;

/// What only a compiler understands, in short.
#[derive(Debug)]
pub struct Beyond(pub String);

pub(super) type Read<T> = Result<T, Beyond>;

/// That `e` is left to the compiler.
pub(super) fn beyond<T>(e: &impl quote::ToTokens) -> Read<T> {
    Err(Beyond(print(e)))
}

/// What a file declares around its model, by name.
#[derive(Debug, Default)]
pub(super) struct Around {
    /// Plain numbers.
    pub(super) constants: BTreeMap<String, f64>,
    /// Functions of numbers.
    pub(super) functions: BTreeMap<String, OwnFunction>,
}

/// A function of numbers: values that it names, and its result.
#[derive(Debug)]
pub(super) struct OwnFunction {
    pub(super) parameters: Vec<(Ident, Parameter)>,
    pub(super) values: Vec<(Ident, Expr)>,
    pub(super) result: Expr,
    /// The type of the result.
    pub(super) gives: Parameter,
}

/// The type of a function's parameter, or of its result.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Parameter {
    /// `D` of a function of `D: Real`: of the same type as the others.
    Generic,
    /// `Num<T>`
    Number,
    /// `f64`
    Plain,
}

/// So deep may functions call each other.
pub(super) const DEEPEST: usize = 16;

/// What a word of an expression stands for.
#[derive(Clone, Copy, Debug)]
pub(super) enum Named {
    One(Value),
    /// The first of so many numbers.
    Vector(u32, usize),
}

/// Reads the expressions of one function.
pub(super) struct Reader<'a> {
    program: Program,
    pub(super) names: BTreeMap<String, Named>,
    pub(super) row: Option<Ident>,
    columns: &'a Columns,
    pub(super) around: &'a Around,
    /// How many functions the expression stands in, and whether the innermost is one of `D: Real`.
    pub(super) depth: usize,
    pub(super) is_generic: bool,
}

impl<'a> Reader<'a> {
    /// A reader of what `of` mentions: its numbers, and its `let`s, each with its offset.
    pub(super) fn new(of: &Function, columns: &'a Columns, around: &'a Around) -> Read<Self> {
        let width = of.width();
        let program = Program { n: width + of.lets.len(), ..Program::default() };
        if program.n > LIMIT {
            return beyond(&of.value);
        }
        let mut reader = Reader {
            program,
            names: BTreeMap::new(),
            row: None,
            columns,
            around,
            depth: 0,
            is_generic: false,
        };
        let mut first = 0;
        for number in &of.numbers {
            let named = match number.len {
                None => Named::One(Value::Number(first)),
                Some(n) => Named::Vector(first, n),
            };
            reader.names.insert(number.word.clone(), named);
            first += number.len.unwrap_or(1) as u32;
        }
        for (i, through) in of.lets.iter().enumerate() {
            reader.row = Some(through.row.clone());
            let value = reader.tokens(&through.value)?;
            let value = reader.as_number(value)?;
            let offset = Value::Number((width + i) as u32);
            let value = reader.step(Step::Operator(Operator::Add, value, offset))?;
            reader.names.insert(through.word.clone(), Named::One(value));
        }
        reader.row.clone_from(&of.row);
        Ok(reader)
    }

    /// What was read.
    pub(super) fn program(self) -> Program {
        self.program
    }

    fn tokens(&mut self, tokens: &TokenStream) -> Read<Value> {
        match syn::parse2(tokens.clone()) {
            Ok(e) => self.value(&e),
            Err(_) => beyond(tokens),
        }
    }

    pub(super) fn step(&mut self, step: Step) -> Read<Value> {
        let at = self.program.n + self.program.steps.len();
        if at >= LIMIT {
            return Err(Beyond("so long an expression".into()));
        }
        self.program.steps.push(step);
        Ok(Value::Number(at as u32))
    }

    pub(super) fn plain_step(&mut self, step: PlainStep) -> Value {
        let found = self.program.plain.iter().position(|own| *own == step);
        let at = found.unwrap_or_else(|| {
            self.program.plain.push(step);
            self.program.plain.len() - 1
        });
        Value::Plain(at as u32)
    }

    /// As a number with derivatives.
    fn as_number(&mut self, value: Value) -> Read<Value> {
        match value {
            Value::Number(_) => Ok(value),
            value => self.step(Step::Of(value)),
        }
    }

    /// As a plain number, unless it carries derivatives.
    pub(super) fn as_plain(&mut self, value: Value) -> Option<u32> {
        match value {
            Value::Number(_) => None,
            Value::Plain(i) => Some(i),
            Value::Whole(n) => match self.plain_step(PlainStep::Constant(f64::from(n))) {
                Value::Plain(i) => Some(i),
                _ => None,
            },
        }
    }

    pub(super) fn value(&mut self, e: &Expr) -> Read<Value> {
        match e {
            Expr::Paren(e) => self.value(&e.expr),
            Expr::Group(e) => self.value(&e.expr),
            Expr::Lit(lit) => match &lit.lit {
                Lit::Float(x) if matches!(x.suffix(), "" | "f64") => {
                    self.literal(e, x.base10_parse().ok())
                }
                Lit::Int(n) if n.suffix() == "f64" => {
                    self.literal(e, n.base10_digits().parse().ok())
                }
                Lit::Int(n) if n.suffix().is_empty() => {
                    n.base10_parse().map(Value::Whole).or_else(|_| beyond(e))
                }
                _ => beyond(e),
            },
            Expr::Unary(unary) if matches!(unary.op, UnOp::Neg(_)) => {
                let value = self.value(&unary.expr)?;
                match value {
                    Value::Plain(_) if let Some(x) = self.constant(value) => {
                        Ok(self.plain_step(PlainStep::Constant(-x)))
                    }
                    Value::Whole(n) => {
                        n.checked_neg().map_or_else(|| beyond(e), |n| Ok(Value::Whole(n)))
                    }
                    value => self.unary(Unary::neg, value),
                }
            }
            Expr::Binary(binary) => {
                let (a, b) = (self.value(&binary.left)?, self.value(&binary.right)?);
                let operator = match binary.op {
                    BinOp::Add(_) => Operator::Add,
                    BinOp::Sub(_) => Operator::Sub,
                    BinOp::Mul(_) => Operator::Mul,
                    BinOp::Div(_) => Operator::Div,
                    _ => return beyond(e),
                };
                match (a, b) {
                    // `D: Real` has plain numbers on its right alone
                    (Value::Plain(_) | Value::Whole(_), Value::Number(_))
                    | (Value::Number(_), Value::Whole(_))
                        if self.is_generic =>
                    {
                        beyond(e)
                    }
                    (Value::Number(_), _) | (_, Value::Number(_)) => {
                        self.step(Step::Operator(operator, a, b))
                    }
                    (Value::Plain(a), Value::Plain(b)) => {
                        Ok(self.plain_step(PlainStep::Operator(operator, a, b)))
                    }
                    // whole numbers divide otherwise, and do not mix with others
                    _ => beyond(e),
                }
            }
            Expr::Path(path) => self.name(&print(path)).map_or_else(|| beyond(e), Ok),
            Expr::Index(index) => self.element(index).map_or_else(|| beyond(e), Ok),
            Expr::Field(field) => match &field.member {
                Member::Named(column) if self.is_row(&field.base) => {
                    self.cell(column, None).map_or_else(|| beyond(e), Ok)
                }
                _ => beyond(e),
            },
            Expr::MethodCall(call) => self.method(call),
            Expr::Call(call) => self.call(call),
            e => beyond(e),
        }
    }

    fn literal(&mut self, e: &Expr, x: Option<f64>) -> Read<Value> {
        match x {
            Some(x) => Ok(self.plain_step(PlainStep::Constant(x))),
            None => beyond(e),
        }
    }

    fn name(&mut self, name: &str) -> Option<Value> {
        if let Some(named) = self.names.get(name) {
            return match named {
                Named::One(value) => Some(*value),
                Named::Vector(..) => None,
            };
        }
        let known = match name {
            "std::f64::consts::PI" => Some(consts::PI),
            "std::f64::consts::TAU" => Some(consts::TAU),
            "std::f64::consts::E" => Some(consts::E),
            "std::f64::consts::LN_2" => Some(consts::LN_2),
            name => self.around.constants.get(name).copied(),
        };
        Some(self.plain_step(PlainStep::Constant(known?)))
    }

    fn is_row(&self, e: &Expr) -> bool {
        let Expr::Path(path) = e else { return false };
        self.row.as_ref().is_some_and(|row| path.path.is_ident(row))
    }

    /// `mu[0]` or `row.x[0]`
    fn element(&mut self, index: &syn::ExprIndex) -> Option<Value> {
        let Expr::Lit(lit) = &*index.index else { return None };
        let Lit::Int(i) = &lit.lit else { return None };
        let i: usize = i.base10_parse().ok()?;
        match &*index.expr {
            Expr::Path(path) => match self.names.get(&print(path))? {
                Named::Vector(first, n) if i < *n => Some(Value::Number(first + i as u32)),
                _ => None,
            },
            Expr::Field(field) if self.is_row(&field.base) => match &field.member {
                Member::Named(column) => self.cell(column, Some(i)),
                Member::Unnamed(_) => None,
            },
            _ => None,
        }
    }

    /// A cell of the row, of a single column or of number `i` of several.
    fn cell(&mut self, column: &Ident, i: Option<usize>) -> Option<Value> {
        let mut first = 0;
        for (name, own) in self.columns {
            if column == name {
                let is_single = own.len() == 1 && own[0] == *name;
                let i = match (is_single, i) {
                    (true, None) => 0,
                    (false, Some(i)) if i < own.len() => i,
                    _ => return None,
                };
                return Some(self.plain_step(PlainStep::Cell((first + i) as u32)));
            }
            first += own.len();
        }
        None
    }

    pub(super) fn unary(&mut self, f: Unary, value: Value) -> Read<Value> {
        match value {
            Value::Number(x) => self.step(Step::Unary(f, x)),
            value => match self.as_plain(value) {
                Some(x) => Ok(self.plain_step(PlainStep::Unary(f, x))),
                None => Err(Beyond("a function of a whole number".into())),
            },
        }
    }

    /// A number that is written out.
    pub(super) fn constant(&self, value: Value) -> Option<f64> {
        match value {
            Value::Plain(i) => match self.program.plain[i as usize] {
                PlainStep::Constant(x) => Some(x),
                _ => None,
            },
            Value::Whole(n) => Some(f64::from(n)),
            Value::Number(_) => None,
        }
    }

    /// From now on the row is called so, and none of its values is known.
    pub(super) fn of_row(&mut self, row: &Ident) {
        self.row = Some(row.clone());
    }

    /// Where a plain number stands; `None` of one with derivatives.
    pub(super) fn plain(&mut self, e: &Expr) -> Read<Option<u32>> {
        let value = self.value(e)?;
        Ok(self.as_plain(value))
    }

    /// The expression of a function, which was given to [`Reader::new`].
    pub(super) fn whole(&mut self, of: &Function) -> Read<Value> {
        self.tokens(&of.value)
    }
}

/// The expression of a function.
pub(super) fn expression(of: &Function) -> Read<Expr> {
    syn::parse2(of.value.clone()).or_else(|_| beyond(&of.value))
}
