//! A model file that is read while the program runs, and evaluated without a compiler.
//!
//! Its calls of the builder are those that the macro writes for the same text, and its expressions compute the same
//! numbers in the same order, so that its results are the same to the bit. What a compiler alone understands, a
//! function of the file's own for instance, is refused: see [`Beyond`].

use std::marker::PhantomData;
use std::rc::Rc;
use std::sync::Arc;

use eplat_language::File;

use super::builder::{Builder, Computed, Range};
use super::declare::Declare;
use super::error::ModelError;
use super::expression::{AnyLet, AnyOperand, AnyPredictor, AnyRows};
use super::row_math::{RowMath, RowsOf};
use crate::likelihood::{Bracket, Count, Number};

mod calls;
mod distributions;
mod expression;
mod file;
mod functions;
mod kernels;
mod likelihoods;
mod priors;
mod program;
mod read;
mod rows;
#[cfg(test)]
mod tests;

pub use expression::Beyond;
use likelihoods::Kind;
use priors::WIDEST;
use read::{Call, Calls, Field, Observe, Param};
use rows::{Columns, LetOf, LikelihoodOf, OperandOf};

/// A model that is evaluated as it is written.
pub struct Interpreted {
    name: &'static str,
    source: String,
    columns: Arc<Columns>,
    calls: Vec<Call>,
}

impl std::fmt::Debug for Interpreted {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Interpreted").field("name", &self.name).finish_non_exhaustive()
    }
}

impl Interpreted {
    /// The model of a file in which [`File::check`] found no mistake.
    ///
    /// # Errors
    /// The first thing that only a compiler understands.
    pub fn of(file: &File) -> Result<Self, Beyond> {
        let around = file::around(file)?;
        let plan = file.model.plan();
        let columns = plan.columns.iter().map(|column| {
            let name = column.name.to_string();
            let numbered = |n: usize| (1..=n).map(|i| format!("{name}{i}")).collect();
            let own = column.len.map_or_else(|| vec![name.clone()], numbered);
            (kept(&name), own)
        });
        let columns = Arc::new(columns.collect());
        let calls = Calls { columns: &columns, around: &around }.read(&plan)?;
        let name = kept(&file.model.name.to_string());
        Ok(Self { name, source: file.between_brackets(), columns, calls })
    }
}

/// A word that the builder keeps: models live as long as their process.
fn kept(word: &str) -> &'static str {
    String::leak(word.into())
}

fn kept_all(words: impl Iterator<Item = String>) -> &'static [&'static str] {
    Vec::leak(words.map(|word| kept(&word)).collect())
}

impl Declare for Interpreted {
    fn name(&self) -> &'static str {
        self.name
    }

    fn source(&self) -> String {
        self.source.clone()
    }

    fn declare(&self, b: &mut Builder<'_>) -> Result<(), ModelError> {
        self.calls.iter().try_for_each(|call| self.call(call, b))
    }
}

impl Interpreted {
    fn call(&self, call: &Call, b: &mut Builder<'_>) -> Result<(), ModelError> {
        match call {
            Call::Param(own) => return param(own, b),
            Call::Imputed(decl, prior) => {
                let (decl, prior) = (decl.clone(), prior.clone());
                return b.imputed::<_, WIDEST, { WIDEST + 1 }>(decl, prior.mentions, prior);
            }
            Call::Block(name, params) => {
                b.block(name);
                params.iter().try_for_each(|own| param(own, b))?;
                b.end_block();
            }
            Call::Field(own) => return field(own, b),
            Call::Linear { decl, name, columns, beta } => {
                b.linear(decl.clone(), name, columns, beta);
            }
            Call::Predictor(decl, name, place, value) => {
                b.predictor(decl.clone(), name, *place, predictor(value));
            }
            Call::Part(name, place, value) => b.part(name, *place, predictor(value)),
            Call::Value(decl, name, range, place, value) => {
                let value = value.clone();
                let any = AnyLet(Rc::new(move || Box::new(LetOf::new(value.clone()))));
                b.value(decl.clone(), name, *range, *place, any);
            }
            Call::Operator(own) => {
                let operands = own.operands.iter().map(|(mentions, columns, value)| {
                    let value = value.clone();
                    let make = Box::new(move || Box::new(OperandOf::new(value.clone())) as _);
                    AnyOperand { mentions: *mentions, columns, make }
                });
                let operands = operands.collect();
                return b.operator(
                    own.decl.clone(),
                    own.name,
                    own.operation,
                    operands,
                    own.further,
                );
            }
            Call::LinearEffect { decl, on, columns, prior } => {
                let (on, columns) = (words(on), words(columns));
                return b.linear_effect(decl.clone(), &on, &columns, &prior.object());
            }
            Call::Effect { decl, on, form, prior } => {
                return b.effect(decl.clone(), &words(on), form.clone(), &prior.object());
            }
            Call::Observe(own) => {
                let rows = self.rows(own);
                let from = own.from.map(|(text, columns, _)| Computed { text, columns });
                return b.observe(own.decl.clone(), own.name, own.place, from, rows);
            }
        }
        Ok(())
    }

    fn rows(&self, own: &Observe) -> AnyRows {
        let math = match own.kind.as_str() {
            "Bracket" => self.likelihood::<Bracket>(own),
            "Count" => self.likelihood::<Count>(own),
            _ => self.likelihood::<Number>(own),
        };
        AnyRows(math, own.width)
    }

    fn likelihood<Y: Kind>(&self, own: &Observe) -> Box<dyn RowMath> {
        Box::new(RowsOf::new(LikelihoodOf::<Y> {
            program: own.program.clone(),
            written: own.written.clone(),
            width: own.width,
            computed: own.from.map(|(_, _, at)| at),
            columns: self.columns.clone(),
            rows: vec![],
            y: PhantomData,
        }))
    }
}

fn words(own: &[String]) -> Vec<&str> {
    own.iter().map(String::as_str).collect()
}

fn predictor(value: &Arc<rows::RowValue>) -> AnyPredictor {
    let value = value.clone();
    AnyPredictor(Rc::new(move |cell: super::map::ReadCell<'_>| value.factors(cell)))
}

fn param(own: &Param, b: &mut Builder<'_>) -> Result<(), ModelError> {
    match own {
        Param::Numbers(decl, len, prior) => b.param(decl.clone(), *len, &prior.object()),
        Param::Vector(decl, n, prior) => {
            let (decl, prior) = (decl.clone(), prior.clone());
            b.sequence::<_, WIDEST, { WIDEST + 2 }>(decl, *n, prior.mentions, prior)
        }
    }
}

fn field(own: &Field, b: &mut Builder<'_>) -> Result<(), ModelError> {
    let range = Range { ends: own.range, is_within: own.is_within };
    b.field(own.decl.clone(), range, own.label, own.name)?;
    own.params.iter().try_for_each(|own| param(own, b))?;
    let mean = b.scalar(&own.mean.object());
    let terms = own.terms.iter().map(|(amplitude, k, kernel)| {
        let amplitude = b.scalar(&amplitude.object());
        b.term(amplitude, *k, &kernel.object())
    });
    let terms = terms.collect();
    b.end_field(own.lone_mean.as_deref(), mean, terms)
}
