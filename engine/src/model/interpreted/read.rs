//! From the plan of a model to the calls of the builder.

use std::sync::Arc;

use eplat_language::plan::{self, Function, Plan};
use eplat_language::print;
use eplat_language::syntax::{self, Expr, Over, Range};

use super::expression::{Around, Beyond, Read, Reader, beyond, expression};
use super::kernels::{Covariance, Quantity, Shape};
use super::likelihoods::Written;
use super::priors::{Family, Prior, WIDEST, Whole};
use super::program::Program;
use super::rows::{Columns, RowValue};
use super::{kept, kept_all};
use crate::model::builder::{Len, Operation, Place};
use crate::model::forms::{self, Form};
use crate::model::functions::Decl;

/// A statement of the model, read.
pub(super) enum Call {
    Param(Param),
    Imputed(Decl, Prior<Family>),
    Block(&'static str, Vec<Param>),
    Field(Box<Field>),
    Linear { decl: Decl, name: &'static str, columns: &'static [&'static str], beta: &'static str },
    Predictor(Decl, &'static str, Place, Arc<RowValue>),
    Part(&'static str, Place, Arc<RowValue>),
    Value(Decl, &'static str, Option<(f64, f64)>, Place, Arc<RowValue>),
    Operator(Box<Operator>),
    LinearEffect { decl: Decl, on: Vec<String>, columns: Vec<String>, prior: Prior<Family> },
    Effect { decl: Decl, on: Vec<String>, form: Form, prior: Prior<Family> },
    Observe(Box<Observe>),
}

/// A parameter: numbers, or a vector whose numbers depend on each other.
pub(super) enum Param {
    Numbers(Decl, Len, Prior<Family>),
    Vector(Decl, usize, Prior<Whole>),
}

pub(super) struct Field {
    pub(super) decl: Decl,
    pub(super) range: Option<(f64, f64)>,
    pub(super) is_within: bool,
    pub(super) label: Option<&'static str>,
    pub(super) name: &'static str,
    pub(super) params: Vec<Param>,
    pub(super) mean: Quantity,
    pub(super) terms: Vec<(Quantity, usize, Covariance)>,
    pub(super) lone_mean: Option<String>,
}

pub(super) struct Operator {
    pub(super) decl: Decl,
    pub(super) name: &'static str,
    pub(super) operation: Operation,
    pub(super) operands: Vec<(Place, &'static [&'static str], Arc<RowValue>)>,
    pub(super) further: &'static [(&'static str, &'static str)],
}

pub(super) struct Observe {
    pub(super) decl: Decl,
    pub(super) name: &'static str,
    pub(super) place: Place,
    pub(super) kind: String,
    pub(super) program: Program,
    pub(super) written: Written,
    pub(super) width: usize,
    /// The expression of a measurement that is computed, its columns, and where its value stands.
    pub(super) from: Option<(&'static str, &'static [&'static str], u32)>,
}

/// Reads the calls of a plan.
pub(super) struct Calls<'a> {
    pub(super) columns: &'a Arc<Columns>,
    pub(super) around: &'a Around,
}

impl Calls<'_> {
    pub(super) fn read(&self, plan: &Plan<'_>) -> Read<Vec<Call>> {
        plan.calls.iter().map(|call| self.call(call)).collect()
    }

    fn reader(&self, of: &Function) -> Read<Reader<'_>> {
        Reader::new(of, self.columns, self.around)
    }

    fn call(&self, call: &plan::Call<'_>) -> Read<Call> {
        Ok(match call {
            plan::Call::Param(param) => Call::Param(self.param(param)?),
            plan::Call::Imputed { declared, prior } => {
                Call::Imputed(decl(declared), self.numbers(prior)?)
            }
            plan::Call::Block { name, params } => {
                Call::Block(kept(&name.to_string()), self.params(params)?)
            }
            plan::Call::Field(field) => Call::Field(Box::new(self.field(field)?)),
            plan::Call::Linear { declared, columns, beta } => Call::Linear {
                decl: decl(declared),
                name: name(declared),
                columns: kept_all(columns.iter().map(ToString::to_string)),
                beta: kept(&beta.to_string()),
            },
            plan::Call::Predictor(declared, value) => {
                let (place, value) = self.row_value(value)?;
                Call::Predictor(decl(declared), name(declared), place, value)
            }
            plan::Call::Part(name, value) => {
                let (place, value) = self.row_value(value)?;
                Call::Part(kept(&name.to_string()), place, value)
            }
            plan::Call::Value { declared, range, value } => {
                let (place, value) = self.row_value(value)?;
                Call::Value(decl(declared), name(declared), range.map(ends), place, value)
            }
            plan::Call::Operator(operator) => Call::Operator(Box::new(self.operator(operator)?)),
            plan::Call::Effect { declared, effect, prior } => {
                let (decl, prior) = (decl(declared), self.numbers(&prior.of)?);
                let on = effect.on.iter().map(ToString::to_string).collect();
                if effect.form.name.is_ident("linear") {
                    let columns = effect.form.columns.iter().map(ToString::to_string).collect();
                    Call::LinearEffect { decl, on, columns, prior }
                } else {
                    Call::Effect { decl, on, form: form(&effect.form)?, prior }
                }
            }
            plan::Call::Density { value, .. } => return beyond(&value.value),
            plan::Call::Observe(observe) => Call::Observe(Box::new(self.observe(observe)?)),
        })
    }

    fn params(&self, params: &[plan::Parameter<'_>]) -> Read<Vec<Param>> {
        params.iter().map(|param| self.param(param)).collect()
    }

    fn param(
        &self,
        plan::Parameter { declared, over, prior }: &plan::Parameter<'_>,
    ) -> Read<Param> {
        let decl = decl(declared);
        let len = match over {
            Over::One => Len::One,
            Over::Each(column) => Len::Each(kept(&column.to_string())),
            Over::Many(n) => {
                return match self.numbers(&prior.of) {
                    Ok(numbers) => Ok(Param::Numbers(decl, Len::Many(*n), numbers)),
                    Err(_) => Ok(Param::Vector(decl, *n, self.vector(&prior.of)?)),
                };
            }
        };
        Ok(Param::Numbers(decl, len, self.numbers(&prior.of)?))
    }

    /// A prior of numbers.
    fn numbers(&self, of: &Function) -> Read<Prior<Family>> {
        self.prior(of, &expression(of)?, Family::of)
    }

    /// A prior of a vector.
    fn vector(&self, of: &Function) -> Read<Prior<Whole>> {
        let e = expression(of)?;
        if let Expr::Call(call) = &e
            && print(&call.func) == "Ordered"
            && let Some(inner) = call.args.first()
        {
            return self.prior(of, inner, |name| match Family::of(name)? {
                (family, n) if family.is_on_the_real_line() => Some((Whole::Ordered(family), n)),
                _ => None,
            });
        }
        self.prior(of, &e, |name| match name {
            "Dirichlet" => Some((Whole::Dirichlet, 1)),
            "LkjCholesky" => Some((Whole::LkjCholesky, 1)),
            "SumToZero" => Some((Whole::SumToZero, 1)),
            _ => None,
        })
    }

    /// A prior `e` that is a call of a word, or the word alone.
    fn prior<F>(
        &self,
        of: &Function,
        e: &Expr,
        family: impl Fn(&str) -> Option<(F, usize)>,
    ) -> Read<Prior<F>> {
        let (word, arguments) = match e {
            Expr::Call(call) => (&*call.func, call.args.iter().collect()),
            e => (e, vec![]),
        };
        let Some((family, n)) = family(&print(word)) else { return beyond(e) };
        let mut reader = self.reader(of)?;
        let arguments = arguments.into_iter().map(|e| reader.value(e)).collect::<Read<Vec<_>>>()?;
        let program = reader.program();
        if n != arguments.len() || program.n > WIDEST {
            return beyond(e);
        }
        let plain = program.plain(&[]).into();
        let mentions = kept_all(of.numbers.iter().map(|number| number.full.clone()));
        Ok(Prior { mentions, family, program: Arc::new(program), plain, arguments })
    }

    /// An expression of parameters.
    fn quantity(&self, of: &Function, e: &Expr) -> Read<Quantity> {
        let mut reader = self.reader(of)?;
        let value = reader.value(e)?;
        let program = reader.program();
        if program.n > WIDEST {
            return beyond(e);
        }
        let plain = program.plain(&[]).into();
        let mentions = kept_all(of.numbers.iter().map(|number| number.full.clone()));
        Ok(Quantity { mentions, program: Arc::new(program), plain, value })
    }

    fn kernel(&self, of: &Function, e: &Expr, of_authors: bool) -> Read<Covariance> {
        let Expr::Call(call) = e else { return beyond(e) };
        let Some(argument) = call.args.first() else { return beyond(e) };
        let word = print(&call.func);
        if word == "authors" && !of_authors {
            return self.kernel(of, argument, true);
        }
        let Some(shape) = Shape::of(&word) else { return beyond(e) };
        Ok(Covariance { shape, of_authors, lengthscale: self.quantity(of, argument)? })
    }

    fn field(&self, of: &plan::Field<'_>) -> Read<Field> {
        let quantity = |of: &Function| self.quantity(of, &expression(of)?);
        let terms = of.terms.iter().map(|term| {
            let kernel = self.kernel(&term.kernel, &expression(&term.kernel)?, false)?;
            Ok((quantity(&term.amplitude)?, term.modes, kernel))
        });
        Ok(Field {
            decl: decl(&of.declared),
            range: of.field.range.map(ends),
            is_within: of.field.is_within,
            label: of.field.label.as_ref().map(|label| kept(&label.to_string())),
            name: name(&of.declared),
            params: self.params(&of.params)?,
            mean: quantity(&of.mean)?,
            terms: terms.collect::<Read<_>>()?,
            lone_mean: of.lone_mean.clone(),
        })
    }

    /// An expression of a row, with what it mentions.
    fn row_value(&self, of: &Function) -> Read<(Place, Arc<RowValue>)> {
        let mut reader = self.reader(of)?;
        let value = reader.whole(of)?;
        let program = reader.program();
        let columns = self.columns.clone();
        Ok((place(of), Arc::new(RowValue { program, value, columns })))
    }

    fn operator(&self, of: &plan::Operator<'_>) -> Read<Operator> {
        let operation = match (of.operation, of.own) {
            (syntax::Operation::Eikonal, None) => Operation::Eikonal,
            (syntax::Operation::Path, None) => Operation::Path,
            (syntax::Operation::Gradient, None) => Operation::Gradient,
            _ => return Err(Beyond(of.declared.text.clone())),
        };
        let operands = of.operands.iter().map(|(of, columns)| {
            let (place, value) = self.row_value(of)?;
            Ok((place, kept_all(columns.iter().cloned()), value))
        });
        let further = of
            .further
            .iter()
            .map(|(column, later)| (kept(&column.to_string()), kept(&later.to_string())));
        Ok(Operator {
            decl: decl(&of.declared),
            name: name(&of.declared),
            operation,
            operands: operands.collect::<Read<_>>()?,
            further: Vec::leak(further.collect()),
        })
    }

    fn observe(&self, of: &plan::Observe<'_>) -> Read<Observe> {
        let kind = of.observe.kind.to_string();
        let mut reader = self.reader(&of.likelihood)?;
        let written = reader.likelihood(&kind, &expression(&of.likelihood)?)?;
        let from = match &of.observe.from {
            None => None,
            Some(e) => {
                reader.of_row(&of.observe.row);
                let Some(at) = reader.plain(e)?.filter(|_| kind == "Number") else {
                    return beyond(e);
                };
                Some((kept(&print(e)), kept_all(of.from.iter().cloned()), at))
            }
        };
        Ok(Observe {
            decl: decl(&of.declared),
            name: name(&of.declared),
            place: place(&of.likelihood),
            kind,
            program: reader.program(),
            written,
            width: of.likelihood.width(),
            from,
        })
    }
}

fn decl(plan::Declared { name, unit, text }: &plan::Declared<'_>) -> Decl {
    let unit = unit.map_or(String::new(), |unit| unit.text.clone());
    Decl { name: name.to_string().into(), unit: unit.into(), text: text.clone().into() }
}

fn name(declared: &plan::Declared<'_>) -> &'static str {
    kept(&declared.name.to_string())
}

fn ends(Range { low, high }: Range) -> (f64, f64) {
    (low, high)
}

fn place(of: &Function) -> Place {
    Place {
        numbers: kept_all(of.numbers.iter().map(|number| number.full.clone())),
        lets: kept_all(of.lets.iter().map(|through| through.word.clone())),
        reads_row: of.reads_row,
    }
}

/// A form of an effect that ships, with its columns and numbers.
fn form(of: &syntax::Form) -> Read<Form> {
    let columns: Vec<String> = of.columns.iter().map(ToString::to_string).collect();
    let columns: Vec<&str> = columns.iter().map(String::as_str).collect();
    let numbers = of.numbers.iter().map(written).collect::<Read<Vec<f64>>>()?;
    let text = of.text();
    Ok(match (print(&of.name).as_str(), &columns[..], &numbers[..]) {
        ("scaled", [a], [centre, scale]) => forms::scaled(a, *centre, *scale),
        ("scaled_by", [a, b], [centre, scale]) => forms::scaled_by(a, b, *centre, *scale),
        ("saturating", [a], [centre]) => forms::saturating(a, *centre),
        ("smooth", [a], [low, high, degree]) => forms::smooth(a, *low, *high, *degree),
        ("above", [a], [threshold]) => forms::above(a, *threshold),
        ("logistic", [a], [centre, scale]) => forms::logistic(a, *centre, *scale),
        ("group", [a], []) => forms::group(a),
        ("family", [a], []) => forms::family(a),
        ("all", [], []) => forms::all(),
        ("surface", [], [modes, lengthscale]) => forms::surface(*modes, *lengthscale),
        ("path", [], [modes, lengthscale]) => forms::path(*modes, *lengthscale),
        _ => return Err(Beyond(text)),
    })
}

/// A number that is written out.
fn written(e: &Expr) -> Read<f64> {
    print(e).parse().or_else(|_| beyond(e))
}
