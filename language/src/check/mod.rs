//! The mistakes of a model that its text tells: names, what takes which arguments, and units.

use crate::around::Around;
use crate::file::File;
use crate::mistake::Mistake;
use crate::syntax::{Density, Field, Hyper, Item, Let, Model, Observe, Operator, Param, Value};
use crate::units;
use scope::{Local, Place, Scope};

mod bound;
mod declared;
mod effects;
mod everywhere;
mod scope;
mod words;

/// The mistakes that can be told without the rest of the file: a name may be that of a function there.
pub fn check(model: &Model) -> Vec<Mistake> {
    mistakes(model, &Around::unknown())
}

impl File {
    /// All mistakes of the model, with the rest of the file in view.
    pub fn check(&self) -> Vec<Mistake> {
        let around = Around::of(&self.tokens);
        let mut found = mistakes(&self.model, &around);
        if !around.has_prelude {
            let message = "cannot find macro `model` in this scope";
            let help = "begin the file with `use eplat::prelude::*;`";
            found.push(Mistake::at(self.word, message, help));
        }
        found.sort_by_key(|mistake| mistake.range().start);
        found
    }
}

fn mistakes(model: &Model, around: &Around) -> Vec<Mistake> {
    let mut check = Check { around, mistakes: declared::twice(model) };
    for (at, statement) in model.statements.iter().enumerate() {
        let scope = Scope { model, around, at };
        match &statement.item {
            Item::Param(p) => check.param(p, &scope, &[]),
            Item::Column(c) => {
                if let Some(prior) = &c.prior {
                    check.say(scope.read(&prior.expr, Place::Prior, &[]));
                    check.say(words::prior(&prior.expr, around));
                }
            }
            Item::Hyper(h) => drop(check.params(&h.params, vec![], &scope)),
            Item::Field(f) => check.field(f, &scope),
            Item::Let(l) => check.let_statement(l, &scope),
            Item::Observe(o) => check.observe(o, &scope),
            Item::Effect(e) => {
                check.say(effects::mistakes(e, model, around));
                for number in &e.form.numbers {
                    check.say(scope.read(number, Place::Cells(None), &[]));
                }
                check.say(scope.read(&e.prior.expr, Place::Prior, &[]));
                check.say(words::prior(&e.prior.expr, around));
            }
            Item::Density(d) => check.density(d, &scope),
        }
    }
    check.say(units::mistakes(model));
    check.mistakes
}

struct Check<'a> {
    around: &'a Around,
    mistakes: Vec<Mistake>,
}

impl<'a> Check<'a> {
    /// Each mistake once: a name that is misspelt three times is one.
    fn say(&mut self, mistakes: Vec<Mistake>) {
        for mistake in mistakes {
            let is_same = |m: &Mistake| m.message == mistake.message && m.help == mistake.help;
            if !self.mistakes.iter().any(is_same) {
                self.mistakes.push(mistake);
            }
        }
    }

    /// A prior sees the parameters above, and the hyperparameters above in its block.
    fn param(&mut self, param: &Param, scope: &Scope<'_>, locals: &[Local<'_>]) {
        self.say(scope.read(&param.prior.expr, Place::Prior, locals));
        self.say(words::prior(&param.prior.expr, self.around));
        self.say(declared::length(param));
    }

    /// The parameters of a block, after those of `locals`; gives all of them.
    fn params(
        &mut self,
        params: &'a [Param],
        mut locals: Vec<Local<'a>>,
        scope: &Scope<'_>,
    ) -> Vec<Local<'a>> {
        self.say(declared::twice_in(params));
        let first = locals.len();
        locals.extend(params.iter().map(|param| Local { param, is_above: false }));
        for (i, param) in params.iter().enumerate() {
            self.param(param, scope, &locals);
            locals[first + i].is_above = true;
        }
        locals
    }

    /// A field's mean, amplitudes and kernels see its hyperparameters and the parameters above.
    fn field(&mut self, field: &'a Field, scope: &Scope<'a>) {
        let mut locals = vec![];
        if let Some(block) = &field.block {
            let Some(Hyper { params, .. }) = scope.block(&block.name) else {
                self.say(vec![scope.unknown_block(&block.name)]);
                return;
            };
            locals.extend(params.iter().map(|param| Local { param, is_above: true }));
        }
        let locals = self.params(&field.params, locals, scope);
        self.say(declared::labels(field, &locals));
        self.say(declared::flat_within(field, &locals, scope.model));
        let amplitudes = field.terms.iter().filter_map(|term| term.amplitude.as_ref());
        let kernels = field.terms.iter().map(|term| &term.kernel);
        for e in field.mean.iter().chain(amplitudes).chain(kernels) {
            self.say(scope.read(e, Place::Field(field), &locals));
            self.say(words::arguments(e, self.around));
        }
        for term in &field.terms {
            self.say(words::kernel(&term.kernel, self.around));
        }
    }

    fn let_statement(&mut self, l: &Let, scope: &Scope<'_>) {
        match &l.value {
            Value::Expr(e) => {
                self.say(scope.read(e, Place::Row(&l.row), &[]));
                self.say(words::arguments(e, self.around));
            }
            Value::Linear { columns, beta } => self.say(scope.linear(l, columns, beta)),
            Value::Operator(o) => self.operator(l, o, scope),
        }
    }

    /// What an operator depends on has a value at every place: fields and parameters.
    fn operator(&mut self, l: &Let, o: &Operator, scope: &Scope<'_>) {
        for operand in &o.operands {
            self.say(scope.read(operand, Place::Row(&l.row), &[]));
            self.say(words::arguments(operand, self.around));
            self.say(everywhere::mistakes(operand, &l.row, scope.model));
        }
        self.say(o.source.as_ref().map_or(vec![], everywhere::source));
        if let Some((function, numbers)) = &o.own {
            self.say(everywhere::own(function, self.around));
            for number in numbers {
                self.say(scope.read(number, Place::Cells(None), &[]));
            }
        }
        for (column, later) in &o.further {
            self.say(scope.read(later, Place::Row(&l.row), &[]));
            self.say(everywhere::further_source(column, later, scope.model));
        }
    }

    fn observe(&mut self, observe: &Observe, scope: &Scope<'_>) {
        self.say(words::kind(observe, self.around));
        if let Some(from) = &observe.from {
            self.say(scope.read(from, Place::Cells(Some(&observe.row)), &[]));
            self.say(words::arguments(from, self.around));
        }
        self.say(scope.read(&observe.likelihood, Place::Row(&observe.row), &[]));
        self.say(words::likelihood(observe, self.around));
    }

    fn density(&mut self, density: &Density, scope: &Scope<'_>) {
        self.say(scope.read(&density.expr, Place::Table(density.data.as_ref()), &[]));
        self.say(words::arguments(&density.expr, self.around));
    }
}
