//! From the text of an expression to a program. What is read here means what the compiler would make of the same
//! text; all else is left to the compiler.

use std::collections::BTreeMap;
use std::f64::consts;

use eplat_language::plan::Function;
use eplat_language::print;
use eplat_language::syntax::{Expr, Ident};
use proc_macro2::TokenStream;
use syn::{BinOp, ExprCall, ExprMethodCall, Lit, Member, UnOp};

use super::functions::{MOST, Method, Surrogate, Unary};
use super::likelihoods::{self, Takes, Word, Written};
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
}

/// The type of a function's parameter.
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
const DEEPEST: usize = 16;

/// What a word of an expression stands for.
#[derive(Clone, Copy, Debug)]
enum Named {
    One(Value),
    /// The first of so many numbers.
    Vector(u32, usize),
}

/// Reads the expressions of one function.
pub(super) struct Reader<'a> {
    program: Program,
    names: BTreeMap<String, Named>,
    row: Option<Ident>,
    columns: &'a Columns,
    around: &'a Around,
    /// How many functions the expression stands in, and whether the innermost is one of `D: Real`.
    depth: usize,
    is_generic: bool,
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

    fn step(&mut self, step: Step) -> Read<Value> {
        let at = self.program.n + self.program.steps.len();
        if at >= LIMIT {
            return Err(Beyond("so long an expression".into()));
        }
        self.program.steps.push(step);
        Ok(Value::Number(at as u32))
    }

    fn plain_step(&mut self, step: PlainStep) -> Value {
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
    fn as_plain(&mut self, value: Value) -> Option<u32> {
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

    fn unary(&mut self, f: Unary, value: Value) -> Read<Value> {
        match value {
            Value::Number(x) => self.step(Step::Unary(f, x)),
            value => match self.as_plain(value) {
                Some(x) => Ok(self.plain_step(PlainStep::Unary(f, x))),
                None => Err(Beyond("a function of a whole number".into())),
            },
        }
    }

    fn method(&mut self, call: &ExprMethodCall) -> Read<Value> {
        // of a bare number the compiler asks which kind it is
        if matches!(&*call.receiver, Expr::Lit(_)) || call.turbofish.is_some() {
            return beyond(call);
        }
        let receiver = self.value(&call.receiver)?;
        let arguments = call.args.iter().map(|e| self.value(e)).collect::<Read<Vec<Value>>>()?;
        match (call.method.to_string().as_str(), receiver, &arguments[..]) {
            (_, Value::Whole(_), _) => beyond(call),
            ("powi", Value::Number(x), [Value::Whole(n)]) => self.step(Step::Powi(x, *n)),
            ("powi", Value::Plain(x), [Value::Whole(n)]) => {
                Ok(self.plain_step(PlainStep::Powi(x, *n)))
            }
            ("powf", Value::Number(x), [Value::Plain(y)]) => self.step(Step::Powf(x, *y)),
            ("powf", Value::Plain(x), [Value::Plain(y)]) => {
                Ok(self.plain_step(PlainStep::Operator(Operator::Pow, x, *y)))
            }
            ("powd", Value::Number(x), [Value::Number(y)]) => self.step(Step::Powd(x, *y)),
            (name, x, []) => match Method::of(name) {
                Some(method) => self.unary(Unary::method(method), x),
                None => beyond(call),
            },
            _ => beyond(call),
        }
    }

    fn call(&mut self, call: &ExprCall) -> Read<Value> {
        let Expr::Path(path) = &*call.func else { return beyond(call) };
        let name = print(path);
        if name == "ln_sum_exp" && !self.around.functions.contains_key(&name) {
            return self.ln_sum_exp(call);
        }
        let arguments = call.args.iter().map(|e| self.value(e)).collect::<Read<Vec<Value>>>()?;
        let number = |value: &Value| matches!(value, Value::Number(_));
        let around = self.around;
        if let Some(own) = around.functions.get(&name) {
            return self.own_function(own, &arguments)?.map_or_else(|| beyond(call), Ok);
        }
        match (name.as_str(), &arguments[..]) {
            ("max", [a, b]) => self.binary(call, Operator::Max, *a, *b),
            ("min", [a, b]) => self.binary(call, Operator::Min, *a, *b),
            ("pow", [Value::Plain(a), Value::Whole(n)]) => {
                Ok(self.plain_step(PlainStep::Powi(*a, *n)))
            }
            ("pow", [a, b]) if number(a) || number(b) || matches!(b, Value::Plain(_)) => {
                self.binary(call, Operator::Pow, *a, *b)
            }
            ("expansion::within", [low, high, Value::Number(x)]) => {
                match (self.constant(*low), self.constant(*high)) {
                    (Some(low), Some(high)) => self.step(Step::Within(low, high, *x)),
                    _ => beyond(call),
                }
            }
            (name, arguments) => match (Unary::of(name), Surrogate::of(name), arguments) {
                (Some(f), _, [Value::Whole(_)]) if !f.takes_whole() => beyond(call),
                (Some(f), _, [x]) => self.unary(f, *x),
                (_, Some((f, n)), all) if all.len() == n && all.iter().any(number) => {
                    let mut own = [Value::Whole(0); MOST];
                    own[..n].copy_from_slice(all);
                    self.step(Step::Surrogate(f, own))
                }
                _ => beyond(call),
            },
        }
    }

    /// The result of a function of the file's own; `None` of other arguments than it takes.
    fn own_function(&mut self, own: &OwnFunction, arguments: &[Value]) -> Read<Option<Value>> {
        let given = own.parameters.iter().map(|(_, takes)| *takes).zip(arguments.iter().copied());
        let is_one = given.clone().all(|(takes, value)| match takes {
            Parameter::Number => matches!(value, Value::Number(_)),
            Parameter::Plain => matches!(value, Value::Plain(_)),
            Parameter::Generic => !matches!(value, Value::Whole(_)),
        });
        let is_number = |value: Value| matches!(value, Value::Number(_));
        let generic: Vec<bool> = given
            .filter(|(takes, _)| *takes == Parameter::Generic)
            .map(|(_, value)| is_number(value))
            .collect();
        let is_same = generic.iter().all(|own| *own) || !generic.iter().any(|own| *own);
        let fits = own.parameters.len() == arguments.len() && is_one && is_same;
        if !fits || self.depth == DEEPEST {
            return Ok(None);
        }
        let names = own.parameters.iter().zip(arguments);
        let names = names.map(|((name, _), value)| (name.to_string(), Named::One(*value)));
        let outside = std::mem::replace(&mut self.names, names.collect());
        let row = self.row.take();
        let is_generic = std::mem::replace(&mut self.is_generic, !generic.is_empty());
        self.depth += 1;
        for (name, e) in &own.values {
            let value = self.value(e)?;
            self.names.insert(name.to_string(), Named::One(value));
        }
        let result = self.value(&own.result)?;
        self.depth -= 1;
        (self.names, self.row, self.is_generic) = (outside, row, is_generic);
        Ok(Some(result))
    }

    fn binary(&mut self, call: &ExprCall, operator: Operator, a: Value, b: Value) -> Read<Value> {
        if let (Some(a), Some(b)) = (self.as_plain(a), self.as_plain(b)) {
            return Ok(self.plain_step(PlainStep::Operator(operator, a, b)));
        }
        match (a, b) {
            (Value::Number(_), _) | (_, Value::Number(_)) => {
                self.step(Step::Operator(operator, a, b))
            }
            _ => beyond(call),
        }
    }

    /// `ln_sum_exp(&[a, b])`
    fn ln_sum_exp(&mut self, call: &ExprCall) -> Read<Value> {
        let Some(Expr::Reference(reference)) = call.args.first() else { return beyond(call) };
        let Expr::Array(array) = &*reference.expr else { return beyond(call) };
        let mut terms = vec![];
        for e in &array.elems {
            match self.value(e)? {
                Value::Number(x) => terms.push(x),
                _ => return beyond(call),
            }
        }
        self.step(Step::LnSumExp(terms.into()))
    }

    /// A number that is written out.
    fn constant(&self, value: Value) -> Option<f64> {
        match value {
            Value::Plain(i) => match self.program.plain[i as usize] {
                PlainStep::Constant(x) => Some(x),
                _ => None,
            },
            Value::Whole(n) => Some(f64::from(n)),
            Value::Number(_) => None,
        }
    }

    /// A likelihood of this kind of measurement.
    pub(super) fn likelihood(&mut self, kind: &str, e: &Expr) -> Read<Written> {
        let Expr::Call(call) = e else { return beyond(e) };
        let Expr::Path(path) = &*call.func else { return beyond(e) };
        let all: Vec<&Expr> = call.args.iter().collect();
        match (print(path).as_str(), &all[..]) {
            ("Censored", [inner, floor]) if kind == "Number" => self.censored(e, inner, floor),
            ("Outliers", [inner, share, sd]) => {
                let inner = self.likelihood(kind, inner)?;
                let (share, sd) = (self.value(share)?, self.value(sd)?);
                match (share, sd) {
                    (Value::Plain(share), Value::Plain(sd)) if inner.widens() => {
                        Ok(Written::Outliers(Box::new(inner), share, sd))
                    }
                    _ => beyond(e),
                }
            }
            ("Widened", [inner, sd]) => {
                let (inner, sd) = (self.likelihood(kind, inner)?, self.value(sd)?);
                if !inner.widens() {
                    return beyond(e);
                }
                Ok(Written::Widened(Box::new(inner), sd))
            }
            ("Mixture", [share, a, b]) => {
                let share = self.value(share)?;
                let (a, b) = (self.likelihood(kind, a)?, self.likelihood(kind, b)?);
                match share {
                    Value::Number(_) => Ok(Written::Mixture(share, Box::new(a), Box::new(b))),
                    _ => beyond(e),
                }
            }
            (name, all) => {
                let Some((word, takes)) = Word::of(kind, name) else { return beyond(e) };
                let arguments = self.arguments(e, takes, all)?;
                Ok(Written::Plain(word, arguments))
            }
        }
    }

    fn censored(&mut self, e: &Expr, inner: &Expr, floor: &Expr) -> Read<Written> {
        let Expr::Call(call) = inner else { return beyond(e) };
        let word = match print(&call.func).as_str() {
            "Normal" => "CensoredNormal",
            "LogNormal" => "CensoredLogNormal",
            _ => return beyond(e),
        };
        let Some((word, takes)) = Word::of("Number", word) else { return beyond(e) };
        let all: Vec<&Expr> = call.args.iter().chain([floor]).collect();
        Ok(Written::Plain(word, self.arguments(e, takes, &all)?))
    }

    fn arguments(
        &mut self,
        e: &Expr,
        takes: &[Takes],
        all: &[&Expr],
    ) -> Read<[Value; likelihoods::MOST]> {
        if takes.len() != all.len() {
            return beyond(e);
        }
        let mut own = [Value::Whole(0); likelihoods::MOST];
        for ((own, takes), e) in own.iter_mut().zip(takes).zip(all) {
            *own = self.value(e)?;
            match (takes, &own) {
                (Takes::Any, _)
                | (Takes::Derivatives, Value::Number(_))
                | (Takes::Plain, Value::Plain(_)) => {}
                _ => return beyond(*e),
            }
        }
        Ok(own)
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
