//! The syntax tree of a model. Every name and expression keeps its place in the text.

#![allow(
    missing_debug_implementations,
    reason = "syn's expressions have none without a feature that costs seconds to build"
)]

use proc_macro2::Span;
pub use syn::{Expr, Ident};

pub use crate::operator::{Operation, Operator};

use crate::print::print;

/// `model NAME; statement; …`
pub struct Model {
    /// The doc comment above `model`, a line each.
    pub docs: Vec<String>,
    /// `NAME`.
    pub name: Ident,
    /// The statements in their order.
    pub statements: Vec<Statement>,
}

/// One statement.
pub struct Statement {
    /// The doc comment above it, a line each.
    pub docs: Vec<String>,
    /// What it declares.
    pub item: Item,
}

/// What a statement declares.
pub enum Item {
    /// `param NAME(over) [unit] ~ PRIOR;`
    Param(Param),
    /// `column NAME(3) [unit];`
    Column(Column),
    /// `hyper NAME { … }`
    Hyper(Hyper),
    /// `field NAME(x) [unit] in LOW..HIGH = MEAN + AMPLITUDE * gp(KERNEL, K = 24) where { … }`
    Field(Field),
    /// `let NAME(row) [unit] in LOW..HIGH = EXPR;`
    Let(Let),
    /// `observe NAME(row): KIND [unit] from (EXPR) ~ LIKELIHOOD;`
    Observe(Observe),
    /// `effect NAME on TARGET, TARGET [unit] = FORM ~ PRIOR;`
    Effect(Effect),
    /// `density NAME(data) = EXPR;`
    Density(Density),
}

/// `[ms]`
#[derive(Clone)]
pub struct Unit {
    /// What stands between the brackets, without blanks.
    pub text: String,
    /// Where.
    pub span: Span,
}

/// `in LOW..HIGH`: where values are expected.
#[derive(Clone, Copy)]
pub struct Range {
    /// LOW.
    pub low: f64,
    /// HIGH.
    pub high: f64,
}

/// What a parameter varies over.
#[derive(Clone)]
pub enum Over {
    /// Nothing: it is one number.
    One,
    /// `(3)`: so many numbers.
    Many(usize),
    /// `(operator)`: one number for each label of that column.
    Each(Ident),
}

/// A parameter, or a hyperparameter of a field.
#[derive(Clone)]
pub struct Param {
    /// Its name.
    pub name: Ident,
    /// What it varies over.
    pub over: Over,
    /// Its unit.
    pub unit: Option<Unit>,
    /// Its prior.
    pub prior: Prior,
}

/// `~ PRIOR`
#[derive(Clone)]
pub struct Prior {
    /// Whether it is one of a whole vector: `~ Dirichlet(2.0)`.
    pub is_joint: bool,
    /// The distribution.
    pub expr: Expr,
}

/// A numeric column of the table.
pub struct Column {
    /// Its name; of several columns, that before their numbers.
    pub name: Ident,
    /// How many columns, NAME1, NAME2, …; `None` for a single one without a number.
    pub len: Option<usize>,
    /// Its unit.
    pub unit: Option<Unit>,
    /// The prior of its cells, of which the empty ones are then unknowns.
    pub prior: Option<Prior>,
}

/// Hyperparameters that fields take by name.
pub struct Hyper {
    /// The block's name.
    pub name: Ident,
    /// Its parameters.
    pub params: Vec<Param>,
}

/// A Gaussian-process field on the surface.
pub struct Field {
    /// Its name.
    pub name: Ident,
    /// The name of the place, `x`.
    pub place: Ident,
    /// The column whose every label has a field of its own.
    pub label: Option<Ident>,
    /// Its unit.
    pub unit: Option<Unit>,
    /// Where its values are expected.
    pub range: Option<Range>,
    /// Whether its values are bent into the range: `within LOW..HIGH`.
    pub is_within: bool,
    /// Its mean; `None` for zero.
    pub mean: Option<Expr>,
    /// Its Gaussian processes.
    pub terms: Vec<Term>,
    /// The whole right-hand side, as written.
    pub value: Expr,
    /// The block of hyperparameters that it takes.
    pub block: Option<Block>,
    /// Its own hyperparameters.
    pub params: Vec<Param>,
}

/// `where NAME` or `where shared NAME`
pub struct Block {
    /// Whether the field has the block's own values; otherwise it has values of its own with the same priors.
    pub is_shared: bool,
    /// The block.
    pub name: Ident,
}

/// `AMPLITUDE * gp(KERNEL, K = 24)`
pub struct Term {
    /// The amplitude; `None` for one.
    pub amplitude: Option<Expr>,
    /// The kernel.
    pub kernel: Expr,
    /// Number of modes.
    pub modes: usize,
}

/// A quantity of a row.
pub struct Let {
    /// Its name.
    pub name: Ident,
    /// The name of the row.
    pub row: Ident,
    /// Its unit.
    pub unit: Option<Unit>,
    /// Where its values are expected.
    pub range: Option<Range>,
    /// Its value.
    pub value: Value,
}

/// The value of a `let`.
pub enum Value {
    /// Any expression.
    Expr(Expr),
    /// `linear(row.a, row.b; beta)`: columns times coefficients.
    Linear {
        /// The columns.
        columns: Vec<Ident>,
        /// The vector of coefficients.
        beta: Ident,
    },
    /// `eikonal(SLOWNESS; row.source)`, `path(EXPR; row.source)` or `gradient(EXPR)`.
    Operator(Box<Operator>),
}

/// Measurements of one kind.
pub struct Observe {
    /// Its name, which is that of the protocol whose rows it takes.
    pub name: Ident,
    /// The name of the row.
    pub row: Ident,
    /// `Bracket`, `Number`, `Count`, or a type of the user's.
    pub kind: Ident,
    /// Unit of the measurement.
    pub unit: Option<Unit>,
    /// What computes the measurement from columns.
    pub from: Option<Expr>,
    /// The likelihood.
    pub likelihood: Expr,
}

/// An additive offset of the quantities that it names.
pub struct Effect {
    /// Its name.
    pub name: Ident,
    /// The fields and `let`s that it acts on.
    pub on: Vec<Ident>,
    /// Their unit.
    pub unit: Option<Unit>,
    /// How it depends on a row.
    pub form: Form,
    /// The prior of its coefficients.
    pub prior: Prior,
}

/// `scaled(row.force_g, 15.0, 5.0)`
pub struct Form {
    /// The function that makes it: a form that ships, or one in scope of the file.
    pub name: syn::Path,
    /// The name of the row.
    pub row: Option<Ident>,
    /// The columns among its arguments.
    pub columns: Vec<Ident>,
    /// The other arguments.
    pub numbers: Vec<Expr>,
}

/// A log density written out.
pub struct Density {
    /// Its name.
    pub name: Ident,
    /// The name of the table, if it reads the table.
    pub data: Option<Ident>,
    /// The log density.
    pub expr: Expr,
}

impl Effect {
    /// What it acts on, as it is written.
    pub fn on(&self) -> String {
        let on: Vec<String> = self.on.iter().map(ToString::to_string).collect();
        on.join(", ")
    }

    /// The statement, as a person would write it.
    pub fn text(&self) -> String {
        let Self { name, form, prior, .. } = self;
        let unit = self.unit.as_ref().map_or(String::new(), |unit| format!(" [{}]", unit.text));
        format!("effect {name} on {}{unit} = {} ~ {};", self.on(), form.text(), print(&prior.expr))
    }
}

impl Form {
    /// The call, as a person would write it.
    pub fn text(&self) -> String {
        let row = self.row.as_ref().map_or(String::new(), ToString::to_string);
        let column = |column: &Ident| format!("{row}.{column}");
        let mut arguments: Vec<String> = self.columns.iter().map(column).collect();
        if arguments.is_empty() {
            arguments.extend(self.row.as_ref().map(ToString::to_string));
        }
        arguments.extend(self.numbers.iter().map(print));
        format!("{}({})", print(&self.name), arguments.join(", "))
    }
}

impl Let {
    /// The expressions in its value.
    pub fn exprs(&self) -> Vec<&Expr> {
        match &self.value {
            Value::Expr(e) => vec![e],
            Value::Linear { .. } => vec![],
            Value::Operator(o) => o.exprs().collect(),
        }
    }
}

impl Model {
    /// What the statements declare, in order.
    pub fn items(&self) -> impl Iterator<Item = &Item> {
        self.statements.iter().map(|statement| &statement.item)
    }

    /// The block of hyperparameters of this name.
    pub fn hyper(&self, name: &Ident) -> Option<&Hyper> {
        self.statements.iter().find_map(|statement| match &statement.item {
            Item::Hyper(hyper) if hyper.name == *name => Some(hyper),
            _ => None,
        })
    }

    /// The `observe` statements, in order.
    pub fn observes(&self) -> impl Iterator<Item = &Observe> {
        self.statements.iter().filter_map(|statement| match &statement.item {
            Item::Observe(observe) => Some(observe),
            _ => None,
        })
    }

    /// The statement that declares a field or a `let` of this name.
    pub fn value(&self, name: &Ident) -> Option<&Item> {
        let is_value = |item: &&Item| matches!(item, Item::Field(_) | Item::Let(_));
        let mut items = self.items().filter(is_value);
        items.find(|item| item.name() == name)
    }
}

impl Item {
    /// The word that begins such a statement.
    pub fn keyword(&self) -> &'static str {
        match self {
            Self::Param(_) => "param",
            Self::Column(_) => "column",
            Self::Hyper(_) => "hyper",
            Self::Field(_) => "field",
            Self::Let(_) => "let",
            Self::Observe(_) => "observe",
            Self::Effect(_) => "effect",
            Self::Density(_) => "density",
        }
    }

    /// The declared name.
    pub fn name(&self) -> &Ident {
        match self {
            Self::Param(p) => &p.name,
            Self::Column(c) => &c.name,
            Self::Hyper(h) => &h.name,
            Self::Field(f) => &f.name,
            Self::Let(l) => &l.name,
            Self::Observe(o) => &o.name,
            Self::Effect(e) => &e.name,
            Self::Density(d) => &d.name,
        }
    }

    /// The declared unit.
    pub fn unit(&self) -> Option<&Unit> {
        match self {
            Self::Param(p) => p.unit.as_ref(),
            Self::Column(c) => c.unit.as_ref(),
            Self::Field(f) => f.unit.as_ref(),
            Self::Let(l) => l.unit.as_ref(),
            Self::Observe(o) => o.unit.as_ref(),
            Self::Effect(e) => e.unit.as_ref(),
            Self::Hyper(_) | Self::Density(_) => None,
        }
    }
}
