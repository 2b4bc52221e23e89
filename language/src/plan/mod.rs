//! What a model asks of whoever lays it out: one call for each statement, each expression with the names that it
//! mentions. The macro writes these calls as Rust, and the library makes them itself of a model file that it
//! reads while it runs.

#![allow(
    missing_debug_implementations,
    reason = "syn's expressions have none without a feature that costs seconds to build"
)]

use proc_macro2::TokenStream;
use syn::Path;

use crate::names::columns_of;
use crate::print::print;
use crate::syntax::{
    self, Column, Density, Effect, Expr, Hyper, Ident, Item, Model, Operation, Over, Param, Range,
    Unit,
};
use crate::vocabulary::{Class, find};

mod fields;
mod rows;
mod scope;

use scope::{Kind, Scope};

/// The calls that a model stands for.
pub struct Plan<'m> {
    /// The numeric columns that it reads, but for those with a prior.
    pub columns: Vec<&'m Column>,
    /// In order. Measurements come last, when every effect is known.
    pub calls: Vec<Call<'m>>,
}

/// One call.
pub enum Call<'m> {
    /// A parameter or a hyperparameter.
    Param(Parameter<'m>),
    /// A column with a prior.
    Imputed {
        /// Its name, unit and prior.
        declared: Declared<'m>,
        /// Of each of its cells.
        prior: Function,
    },
    /// A block of hyperparameters that fields share.
    Block {
        /// Its name.
        name: &'m Ident,
        /// They.
        params: Vec<Parameter<'m>>,
    },
    /// A field.
    Field(Box<Field<'m>>),
    /// `let NAME(row) = linear(row.a, row.b; beta);`
    Linear {
        /// Its name and unit.
        declared: Declared<'m>,
        /// The columns.
        columns: &'m [Ident],
        /// The coefficients.
        beta: &'m Ident,
    },
    /// A `let` that is a linear predictor.
    Predictor(Declared<'m>, Function),
    /// A linear predictor that is a part of the expression of the next call.
    Part(Ident, Function),
    /// Any other `let`.
    Value {
        /// Its name, unit and value.
        declared: Declared<'m>,
        /// Where its values are expected.
        range: Option<Range>,
        /// The value.
        value: Function,
    },
    /// A `let` that is an operator over the whole surface.
    Operator(Box<Operator<'m>>),
    /// An effect.
    Effect {
        /// Its name, unit and prior.
        declared: Declared<'m>,
        /// It.
        effect: &'m Effect,
        /// The prior of its coefficients.
        prior: Prior,
    },
    /// A log density that is written out.
    Density {
        /// Its name.
        name: &'m Ident,
        /// What it calls the table, and the columns that it reads of it.
        table: Option<(&'m Ident, Vec<String>)>,
        /// It, or its terms.
        value: Function,
    },
    /// Measurements.
    Observe(Box<Observe<'m>>),
}

/// What a statement declares, for tables and messages.
pub struct Declared<'m> {
    /// Its name.
    pub name: &'m Ident,
    /// Its unit.
    pub unit: Option<&'m Unit>,
    /// Its prior, its likelihood or its value, as written.
    pub text: String,
}

/// A parameter or a hyperparameter.
pub struct Parameter<'m> {
    /// Its name, unit and prior.
    pub declared: Declared<'m>,
    /// What it varies over.
    pub over: &'m Over,
    /// Its prior.
    pub prior: Prior,
}

/// A prior.
pub struct Prior {
    /// It, as a function of what it mentions.
    pub of: Function,
    /// Whether it is a word that ships, with plain numbers.
    pub is_plain: bool,
}

/// A field.
pub struct Field<'m> {
    /// Its name, unit and right-hand side.
    pub declared: Declared<'m>,
    /// It.
    pub field: &'m syntax::Field,
    /// Hyperparameters of its own.
    pub params: Vec<Parameter<'m>>,
    /// Its mean.
    pub mean: Function,
    /// The hyperparameter that is the mean, if the mean is nothing else.
    pub lone_mean: Option<String>,
    /// Its Gaussian processes.
    pub terms: Vec<Term>,
}

/// A Gaussian process.
pub struct Term {
    /// Its amplitude.
    pub amplitude: Function,
    /// How many modes it has.
    pub modes: usize,
    /// Its kernel.
    pub kernel: Function,
}

/// A `let` that is an operator over the whole surface.
pub struct Operator<'m> {
    /// Its name, unit and value.
    pub declared: Declared<'m>,
    /// Which.
    pub operation: Operation,
    /// Of one of the file's own: the function that makes it, and its numbers.
    pub own: Option<&'m (Path, Vec<Expr>)>,
    /// Its operands, each with the columns that it reads.
    pub operands: Vec<(Function, Vec<String>)>,
    /// Columns with further sources, and the parameter that tells by how much later each is.
    pub further: Vec<(&'m Ident, &'m Ident)>,
}

/// Measurements.
pub struct Observe<'m> {
    /// Their name, unit and likelihood.
    pub declared: Declared<'m>,
    /// They.
    pub observe: &'m syntax::Observe,
    /// The columns that a measurement is computed from.
    pub from: Vec<String>,
    /// The likelihood.
    pub likelihood: Function,
}

/// An expression as a function of the numbers that it mentions.
pub struct Function {
    /// The numbers, in the order of its arguments.
    pub numbers: Vec<Number>,
    /// The `let`s through which it mentions them, in order of declaration; behind the numbers it has an argument for
    /// the offset of each.
    pub lets: Vec<Through>,
    /// What it calls its row.
    pub row: Option<Ident>,
    /// Whether it reads a column of its row.
    pub reads_row: bool,
    /// The expression; values of the row stand in it as plain names.
    pub value: TokenStream,
}

/// Numbers that an expression mentions.
pub struct Number {
    /// As it stands there.
    pub word: String,
    /// As whoever lays the model out knows it: `tau_out.m` of the hyperparameter m.
    pub full: String,
    /// How many, if it is a vector.
    pub len: Option<usize>,
}

/// A `let` that an expression mentions.
pub struct Through {
    /// Its name.
    pub word: String,
    /// What it calls its row.
    pub row: Ident,
    /// Its value; values of the row stand in it as plain names.
    pub value: TokenStream,
}

impl Function {
    /// How many numbers it mentions.
    pub fn width(&self) -> usize {
        self.numbers.iter().map(|number| number.len.unwrap_or(1)).sum()
    }
}

impl Model {
    /// The calls that the model stands for.
    pub fn plan(&self) -> Plan<'_> {
        let columns = self.items().filter_map(|item| match item {
            Item::Column(column) if column.prior.is_none() => Some(column),
            _ => None,
        });
        let columns: Vec<&Column> = columns.collect();
        let mut planner = Planner {
            model: self,
            columns: columns.iter().map(|column| column.name.to_string()).collect(),
            scope: Scope::default(),
            blocks: vec![],
            calls: vec![],
        };
        // measurements come last, when every effect is known
        let mut later = vec![];
        for item in self.items() {
            match item {
                Item::Observe(observe) => later.push((observe, planner.scope.clone())),
                item => planner.item(item),
            }
        }
        for (observe, scope) in later {
            planner.scope = scope;
            planner.observe(observe);
        }
        Plan { columns, calls: planner.calls }
    }
}

/// What has been read so far.
struct Planner<'m> {
    model: &'m Model,
    scope: Scope,
    /// Hyperparameter blocks, with what fields that share a block see.
    blocks: Vec<(&'m Hyper, Scope)>,
    /// Names of the numeric columns.
    columns: Vec<String>,
    calls: Vec<Call<'m>>,
}

fn declared<'m>(name: &'m Ident, unit: Option<&'m Unit>, text: String) -> Declared<'m> {
    Declared { name, unit, text }
}

impl<'m> Planner<'m> {
    fn item(&mut self, item: &'m Item) {
        match item {
            Item::Param(param) => {
                let call = parameter(param, &self.scope);
                self.calls.push(Call::Param(call));
                self.scope.declare(&param.name, param.name.to_string(), kind_of(param));
            }
            Item::Column(column) => self.column(column),
            Item::Hyper(hyper) => self.hyper(hyper),
            Item::Field(field) => self.field(field),
            Item::Let(declared) => self.let_statement(declared),
            Item::Effect(effect) => self.effect(effect),
            Item::Density(density) => self.density(density),
            Item::Observe(_) => {}
        }
    }

    fn column(&mut self, column: &'m Column) {
        let Some(of) = &column.prior else { return };
        let declared = declared(&column.name, column.unit.as_ref(), print(&of.expr));
        self.calls.push(Call::Imputed { declared, prior: self.scope.function(&of.expr) });
        self.scope.declare(&column.name, column.name.to_string(), Kind::Cells);
    }

    fn effect(&mut self, effect: &'m Effect) {
        let declared = declared(&effect.name, effect.unit.as_ref(), print(&effect.prior.expr));
        let prior = prior(&effect.prior, &self.scope);
        self.calls.push(Call::Effect { declared, effect, prior });
    }

    fn density(&mut self, density: &'m Density) {
        let table = density.data.as_ref();
        let table = table.map(|table| (table, self.columns_read(&density.expr, table)));
        let value = self.scope.function(&density.expr);
        self.calls.push(Call::Density { name: &density.name, table, value });
    }

    /// The columns that `e` reads of the row or table that it calls `of`: all where it hands on the whole.
    fn columns_read(&self, e: &Expr, of: &Ident) -> Vec<String> {
        self.words_or_all(columns_of(e, of))
    }

    fn words_or_all(&self, columns: Option<Vec<Ident>>) -> Vec<String> {
        let words = |columns: Vec<Ident>| columns.iter().map(ToString::to_string).collect();
        columns.map_or_else(|| self.columns.clone(), words)
    }
}

/// A parameter whose prior sees `scope`.
fn parameter<'m>(param: &'m Param, scope: &Scope) -> Parameter<'m> {
    let declared = declared(&param.name, param.unit.as_ref(), print(&param.prior.expr));
    Parameter { declared, over: &param.over, prior: prior(&param.prior, scope) }
}

fn prior(prior: &syntax::Prior, scope: &Scope) -> Prior {
    let of = scope.function(&prior.expr);
    let word = match &prior.expr {
        Expr::Call(call) => &*call.func,
        e => e,
    };
    let word = if let Expr::Path(path) = word { path.path.get_ident() } else { None };
    let word = word.and_then(|word| find(&word.to_string()));
    let is_prior = word.is_some_and(|word| word.classes.contains(&Class::Prior));
    Prior { is_plain: is_prior && of.width() == 0, of }
}

/// What the name of a parameter stands for.
fn kind_of(param: &Param) -> Kind {
    match &param.over {
        Over::One => Kind::Numbers(None),
        Over::Many(n) => Kind::Numbers(Some(*n)),
        Over::Each(_) => Kind::Row,
    }
}
