//! What depends on a row: `let` and `observe`.

use quote::format_ident;

use super::scope::{Kind, Scope};
use super::{Call, Observe, Operator, Planner, declared};
use crate::print::print;
use crate::syntax::{self, Expr, Ident, Let, Value};

impl<'m> Planner<'m> {
    pub(super) fn let_statement(&mut self, of: &'m Let) {
        let (name, row, unit) = (&of.name, &of.row, of.unit.as_ref());
        let value = match &of.value {
            Value::Linear { columns, beta } => {
                let declared = declared(name, unit, String::new());
                self.calls.push(Call::Linear { declared, columns, beta });
                self.scope.declare(name, name.to_string(), Kind::Row);
                return;
            }
            Value::Operator(operator) => return self.operator(of, operator),
            Value::Expr(value) => value,
        };
        let declared = declared(name, unit, print(value));
        if self.model.is_predictor(value, row) {
            self.calls.push(Call::Predictor(declared, self.scope.function_of_row(value, row)));
            self.scope.declare(name, name.to_string(), Kind::Row);
            return;
        }
        let value = self.part(&format_ident!("let_{name}"), value, row);
        let function = self.scope.function_of_row(&value, row);
        self.calls.push(Call::Value { declared, range: of.range, value: function });
        let kind = Kind::Let { row: row.clone(), value: Box::new(value) };
        self.scope.declare(name, name.to_string(), kind);
    }

    /// An operator, with its operands as functions of what they mention and of these columns.
    fn operator(&mut self, of: &'m Let, operator: &'m syntax::Operator) {
        let (name, row) = (&of.name, &of.row);
        let operand = |e: &Expr| {
            let columns = self.words_or_all(self.scope.columns_behind(e, row));
            (self.scope.function_of_row(e, row), columns)
        };
        let operands = operator.operands.iter().map(operand).collect();
        let further = operator
            .further
            .iter()
            .filter_map(|(column, later)| Some((column, &self.model.later_by(later)?.name)));
        let call = Operator {
            declared: declared(name, of.unit.as_ref(), operator.text(row)),
            operation: operator.operation,
            own: operator.own.as_ref(),
            operands,
            further: further.collect(),
        };
        self.calls.push(Call::Operator(Box::new(call)));
        self.scope.declare(name, name.to_string(), Kind::Row);
    }

    /// Takes the linear predictors out of `e`, an expression of the statement `of` (a `let` and an `observe` may have the
    /// same name), if it then depends on fewer numbers. They are declared under names that are no names of a model;
    /// nothing is reported of them.
    fn part(&mut self, of: &Ident, e: &Expr, row: &Ident) -> Expr {
        let parted = self.model.parted(e, row, &|k| format_ident!("__{of}_{k}"));
        let (mut scope, mut calls) = (self.scope.clone(), vec![]);
        for (word, e) in &parted.predictors {
            calls.push(Call::Part(word.clone(), self.scope.function_of_row(e, row)));
            scope.declare(word, word.to_string(), Kind::Row);
        }
        let width = |scope: &Scope, e: &Expr| scope.mentioned(e).width();
        if width(&scope, &parted.expr) >= width(&self.scope, e) {
            return e.clone();
        }
        self.scope = scope;
        self.calls.extend(calls);
        parted.expr
    }

    pub(super) fn observe(&mut self, observe: &'m syntax::Observe) {
        let (name, row) = (&observe.name, &observe.row);
        let declared = declared(name, observe.unit.as_ref(), print(&observe.likelihood));
        let likelihood = self.part(&format_ident!("observe_{name}"), &observe.likelihood, row);
        let from = observe.from.as_ref().map_or(vec![], |from| self.columns_read(from, row));
        let likelihood = self.scope.function_of_row(&likelihood, row);
        let call = Observe { declared, observe, from, likelihood };
        self.calls.push(Call::Observe(Box::new(call)));
    }
}
