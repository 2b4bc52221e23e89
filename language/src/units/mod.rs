//! Whether the units of a model agree, as far as they are declared.

use std::collections::BTreeMap;

use expression::{Known, Mismatch, Names, Wanted, check};
use unit::Unit;

use crate::mistake::Mistake;
use crate::syntax;
use crate::syntax::{
    Effect, Expr, Field, Ident, Item, Let, Model, Observe, Operation, Operator, Param, Statement,
    Value,
};

mod expression;
mod unit;

const HELP: &str = "mend the expression or a unit in square brackets; what converts one unit into another is a `param` or a column with a unit of its own";

/// The mistakes of units in every statement.
pub(crate) fn mistakes(model: &Model) -> Vec<Mistake> {
    let mut units = Units::of(model);
    let mut mistakes = vec![];
    for statement in &model.statements {
        let item = &statement.item;
        let head = format!("{} {}", item.keyword(), item.name());
        let mut say = Say { head: &head, mistakes: &mut mistakes };
        let declared = item.unit().and_then(parse);
        match item {
            Item::Param(p) => prior_of(p, &units, &mut say),
            Item::Column(c) => {
                if let Some(prior) = &c.prior {
                    say.check(&prior.expr, like(&c.name, declared), &units);
                }
            }
            Item::Hyper(h) => {
                let units = units.within(&h.params);
                h.params.iter().for_each(|p| prior_of(p, &units, &mut say));
            }
            Item::Field(f) => field(f, model, &units, &mut say),
            Item::Let(l) => {
                let known = let_statement(l, declared, &units, &mut say);
                units.names.insert(l.name.to_string(), declared.or(known.unit()));
            }
            Item::Observe(o) => observe(o, declared, &units, &mut say),
            Item::Effect(e) => effect(e, declared, &units, &mut say),
            Item::Density(d) => drop(say.check(&d.expr, None, &units)),
        }
    }
    mistakes
}

/// A distribution in the unit of what it describes.
fn prior_of(param: &Param, units: &Units, say: &mut Say<'_>) {
    let unit = param.unit.as_ref().and_then(parse);
    say.check(&param.prior.expr, like(&param.name, unit), units);
}

/// Mean, amplitudes and kernels, and the priors of the hyperparameters.
fn field(field: &Field, model: &Model, units: &Units, say: &mut Say<'_>) {
    let of_block = field.block.as_ref().and_then(|block| model.hyper(&block.name));
    let units = units.within(of_block.map_or(&[], |block| &block.params)).within(&field.params);
    say.check(&field.value, wanted(field.unit.as_ref().and_then(parse), "as declared"), &units);
    field.params.iter().for_each(|p| prior_of(p, &units, say));
}

/// An expression, or each column times its coefficient.
fn let_statement(l: &Let, declared: Option<Unit>, units: &Units, say: &mut Say<'_>) -> Known {
    let wanted = wanted(declared, "as declared");
    let (columns, beta) = match &l.value {
        Value::Expr(e) => return say.check(e, wanted, units),
        Value::Linear { columns, beta } => (columns, beta),
        Value::Operator(o) => return operator(o, wanted, units, say),
    };
    let mut known = Known::Nothing;
    for column in columns {
        let coefficient = Known::of(units.name(&beta.to_string()));
        let product = coefficient.times(Known::of(units.column(&column.to_string())), 1);
        let text = || format!("{beta} * {}.{column}", l.row);
        known = say.result(product.wanted(wanted.as_ref(), column.span(), text));
    }
    known
}

/// A time per mm of way, or anything per mm; or anything, whose gradient is per mm. Then a ratio, an angle, and a time.
fn operator(o: &Operator, result: Option<Wanted>, units: &Units, say: &mut Say<'_>) -> Known {
    let mm = Unit::parse("mm").unwrap_or_else(Unit::one);
    let power = if o.operation == Operation::Gradient { -1 } else { 1 };
    for (_, later) in &o.further {
        say.check(later, result.clone(), units);
    }
    if o.operation == Operation::Own {
        for e in &o.operands {
            say.check(e, None, units);
        }
        return Known::Nothing;
    }
    let first = result.map(|own| Wanted { unit: own.unit.times(mm, -power), ..own });
    let further = [
        wanted(Some(Unit::one()), "as a ratio of velocities"),
        wanted(Unit::parse("rad"), "as an angle"),
        wanted(Unit::parse("ms"), "as the thickness of a front"),
    ];
    let all = std::iter::once(first).chain(further);
    let known: Vec<Known> =
        o.operands.iter().zip(all).map(|(e, wanted)| say.check(e, wanted, units)).collect();
    known.into_iter().next().map_or(Known::Nothing, |first| first.times(Known::Unit(mm), power))
}

/// The likelihood is of the unit of the measurement, and so is what the measurement is computed from.
fn observe(o: &Observe, declared: Option<Unit>, units: &Units, say: &mut Say<'_>) {
    if let Some(from) = &o.from {
        say.check(from, wanted(declared, "as declared"), units);
    }
    say.check(&o.likelihood, wanted(declared, "like the measurement"), units);
}

/// An effect is added to its targets.
fn effect(e: &Effect, declared: Option<Unit>, units: &Units, say: &mut Say<'_>) {
    let wanted = wanted(declared, "like the effect");
    for target in &e.on {
        let known = Known::of(units.name(&target.to_string()));
        say.result(known.wanted(wanted.as_ref(), target.span(), || target.to_string()));
    }
    say.check(&e.prior.expr, None, units);
}

fn parse(unit: &syntax::Unit) -> Option<Unit> {
    Unit::parse(&unit.text)
}

fn wanted(unit: Option<Unit>, why: &str) -> Option<Wanted> {
    unit.map(|unit| Wanted { unit, why: why.into() })
}

fn like(name: &Ident, unit: Option<Unit>) -> Option<Wanted> {
    wanted(unit, &format!("like `{name}`"))
}

/// Where the mistakes of a statement go.
struct Say<'a> {
    /// Its keyword and name.
    head: &'a str,
    mistakes: &'a mut Vec<Mistake>,
}

impl Say<'_> {
    #[allow(clippy::needless_pass_by_value, reason = "it is made for each call")]
    fn check(&mut self, e: &Expr, wanted: Option<Wanted>, units: &Units) -> Known {
        self.result(check(e, wanted.as_ref(), units))
    }

    fn result(&mut self, result: Result<Known, Mismatch>) -> Known {
        result.unwrap_or_else(|Mismatch { expression, span, expected, got }| {
            let message = format!("{}: `{expression}`: expected {expected}, got {got}", self.head);
            self.mistakes.push(Mistake::at(span, message, HELP));
            Known::Nothing
        })
    }
}

/// The units of a model's names.
#[derive(Clone)]
struct Units {
    /// Of parameters, fields, `let`s and, within a field or a block, of its hyperparameters.
    names: BTreeMap<String, Option<Unit>>,
    columns: BTreeMap<String, Option<Unit>>,
}

impl Units {
    fn of(model: &Model) -> Self {
        let (mut names, mut columns) = (BTreeMap::new(), BTreeMap::new());
        for Statement { item, .. } in &model.statements {
            let (name, unit) = (item.name().to_string(), item.unit().and_then(parse));
            match item {
                Item::Column(_) => drop(columns.insert(name, unit)),
                Item::Param(_) | Item::Field(_) | Item::Let(_) => drop(names.insert(name, unit)),
                _ => {}
            }
        }
        Self { names, columns }
    }

    /// The same where these hyperparameters are in sight too.
    fn within(&self, params: &[Param]) -> Self {
        let mut units = self.clone();
        for p in params {
            units.names.insert(p.name.to_string(), p.unit.as_ref().and_then(parse));
        }
        units
    }
}

impl Names for Units {
    fn name(&self, name: &str) -> Option<Unit> {
        *self.names.get(name)?
    }

    fn column(&self, name: &str) -> Option<Unit> {
        *self.columns.get(name)?
    }
}
