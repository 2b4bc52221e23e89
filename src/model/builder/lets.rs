//! What is reported of a `let`: once every `observe` is laid out, where the scalars of its values live.

use std::collections::BTreeSet;

use super::{Builder, Source};
use crate::model::error::ModelError;
use crate::model::lets::{LetValues, Local, Values};
use crate::model::maps::MapFn;
use crate::model::scope::Scope;
use crate::model::units::Decl;
use crate::table::Measurements;

/// A `let` as declared.
pub(super) struct Declared {
    decl: Decl,
    /// Names that its expression mentions, each with whether it does and how many scalars it has.
    names: Vec<(&'static str, bool, usize)>,
    differs: Differs,
    /// The expression; none of a linear predictor.
    make: Option<fn() -> Box<dyn MapFn>>,
}

/// What the values of a `let` differ by.
#[derive(Clone, Debug, PartialEq)]
enum Differs {
    /// Nothing: it is one number.
    Not,
    /// A place alone: the maps of a run have it.
    Place,
    /// The label of each row of the table, by number.
    Label(Vec<usize>),
    Row,
}

impl Differs {
    /// What an expression of both differs by.
    fn and(self, other: Self) -> Self {
        match (self, other) {
            (Self::Not, other) | (other, Self::Not) => other,
            (one, other) if one == other => one,
            _ => Self::Row,
        }
    }
}

/// A row of an `observe`: which, and which of its own.
type Row = (&'static str, usize, usize);

impl Builder<'_> {
    /// Most values of a `let` that are reported: beyond it they are predictors by the thousand, of
    /// which the replicated measurements tell enough.
    const MOST: usize = 200;

    pub(super) fn declare_let(
        &mut self,
        decl: Decl,
        scope: &Scope,
        reads_row: bool,
        make: fn() -> Box<dyn MapFn>,
    ) {
        let mut differs = if reads_row { Differs::Row } else { Differs::Not };
        let mut names = vec![];
        for (i, name) in scope.names.iter().enumerate() {
            names.push((*name, scope.mentions(i), scope.lens[i]));
            if scope.mentions(i) {
                differs = differs.and(self.differs(name));
            }
        }
        self.lets.push(Declared { decl, names, differs, make: Some(make) });
    }

    pub(super) fn declare_linear(&mut self, decl: Decl) {
        self.lets.push(Declared { decl, names: vec![], differs: Differs::Row, make: None });
    }

    fn differs(&self, name: &str) -> Differs {
        match self.source(name) {
            Source::Scalars(_) => Differs::Not,
            Source::Each { index, .. } => Differs::Label(index.clone()),
            Source::Field(_) => Differs::Place,
            Source::Linear { .. } => Differs::Row,
            Source::Let => {
                let declared = self.lets.iter().rev().find(|l| l.decl.name == name);
                declared.map_or(Differs::Row, |l| l.differs.clone())
            }
        }
    }

    /// Lays out the values of every `let` that no map shows.
    ///
    /// # Errors
    /// A cell that the expression needs and the table lacks.
    pub(super) fn lay_out_lets(&mut self) -> Result<(), ModelError> {
        let Some(data) = self.data else { return Ok(()) };
        for declared in std::mem::take(&mut self.lets) {
            let rows = self.rows_of(&declared);
            if !rows.is_empty() && rows.len() <= Self::MOST {
                let values = self.values_of(declared, &rows, data)?;
                self.model.lets.push(values);
            }
        }
        Ok(())
    }

    /// A row of an `observe` that depends on the `let` for each of its values; none where a map shows it.
    fn rows_of(&self, declared: &Declared) -> Vec<Row> {
        let has_maps = !self.model.fields.is_empty();
        let acted = self.acts(declared.decl.name);
        let mut seen = BTreeSet::new();
        let key = |row: usize| match &declared.differs {
            Differs::Label(index) if !acted => index[row],
            Differs::Not if !acted => 0,
            _ => row,
        };
        if declared.differs == Differs::Place || declared.differs == Differs::Not && has_maps {
            return vec![];
        }
        let mut rows = vec![];
        for observe in &self.model.observes {
            if self.seen.contains(&(declared.decl.name, observe.name)) {
                let own = observe.rows.iter().enumerate();
                rows.extend(own.map(|(i, row)| (observe.name, i, *row)));
            }
        }
        rows.sort_by_key(|(_, _, row)| *row);
        rows.retain(|(_, _, row)| seen.insert(key(*row)));
        rows
    }

    fn values_of(
        &self,
        declared: Declared,
        rows: &[Row],
        data: &Measurements,
    ) -> Result<LetValues, ModelError> {
        let Declared { decl, names, differs, make } = declared;
        let who = format!("let {}", decl.name);
        let is_one = differs == Differs::Not && rows.len() == 1;
        let labels = if is_one { vec![] } else { self.labels_of(&names, rows, data) };
        let of = match make {
            None => {
                Values::Linear(rows.iter().map(|row| self.scalar_of(decl.name, 0, *row)).collect())
            }
            Some(make) => {
                let mut at = make();
                let (mut scalars, mut offset) = (vec![], vec![]);
                for row in rows {
                    at.read(&mut |name| Ok(data.number(row.2, name, &who)?))?;
                    offset.push(self.offset(decl.name, *row));
                    for (name, is_mentioned, len) in &names {
                        let zero = |_| [0, 0];
                        let place = |e| self.scalar_of(name, e, *row);
                        let one = |e| if *is_mentioned { place(e) } else { zero(e) };
                        scalars.extend((0..*len).map(one));
                    }
                }
                Values::Expression { at, scalars, offset }
            }
        };
        Ok(LetValues { name: decl.name, unit: decl.unit.into(), labels, len: rows.len(), of })
    }

    /// Where scalar `e` behind `name` lives for this row.
    fn scalar_of(&self, name: &'static str, e: usize, row: Row) -> Local {
        let value = match self.source(name) {
            Source::Scalars(v) => v + e,
            Source::Each { v, index } => v + index[row.2],
            Source::Field(field) => self.probe(*field, row.2),
            Source::Linear { .. } => {
                self.predictors.get(&(row.0, name)).map_or(0, |start| start + row.1)
            }
            Source::Let => 0,
        };
        [value as u32, self.offset(name, row)]
    }

    /// The offset that effects have added to `name` in this row.
    fn offset(&self, name: &'static str, (observe, i, _): Row) -> u32 {
        self.hooks.get(&(observe, name)).map_or(0, |at| at + i) as u32
    }

    /// Labels of a parameter that the `let` mentions, if they tell the rows apart; else their lines.
    fn labels_of(
        &self,
        names: &[(&'static str, bool, usize)],
        rows: &[Row],
        data: &Measurements,
    ) -> Vec<String> {
        for (name, ..) in names.iter().filter(|(_, is_mentioned, _)| *is_mentioned) {
            let Source::Each { index, .. } = self.source(name) else { continue };
            let distinct: BTreeSet<usize> = rows.iter().map(|row| index[row.2]).collect();
            let parameter = self.model.parameters.iter().find(|p| p.name == *name);
            if let (true, Some(parameter)) = (distinct.len() == rows.len(), parameter) {
                return rows.iter().map(|row| parameter.labels[index[row.2]].clone()).collect();
            }
        }
        rows.iter().map(|row| format!("line {}", data.line(row.2))).collect()
    }
}
