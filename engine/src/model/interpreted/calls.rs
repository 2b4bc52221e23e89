//! Methods and functions in expressions, those that ship and those of the file.

use eplat_language::print;
use eplat_language::syntax::Expr;
use syn::{ExprCall, ExprMethodCall};

use super::expression::{DEEPEST, Named, OwnFunction, Parameter, Read, Reader, beyond};
use super::functions::{MOST, Method, Surrogate, Unary};
use super::program::{Operator, PlainStep, Step, Value};

impl Reader<'_> {
    pub(super) fn method(&mut self, call: &ExprMethodCall) -> Read<Value> {
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

    pub(super) fn call(&mut self, call: &ExprCall) -> Read<Value> {
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
        let is_of_its_type = match own.gives {
            Parameter::Number => is_number(result),
            Parameter::Plain => matches!(result, Value::Plain(_)),
            Parameter::Generic => match generic.first() {
                Some(true) => is_number(result),
                Some(false) => matches!(result, Value::Plain(_)),
                None => false,
            },
        };
        Ok(Some(result).filter(|_| is_of_its_type))
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
}
