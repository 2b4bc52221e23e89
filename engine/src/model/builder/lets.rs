//! What is reported of a `let`. It is laid out after every `observe`, when it is known where the
//! numbers behind its values are.

use std::collections::BTreeSet;
use std::sync::Arc;

use super::{Builder, Labels, Linear, Place, Source};
use crate::model::error::ModelError;
use crate::model::expression::{AnyLet, AnyPredictor};
use crate::model::functions::Decl;
use crate::model::late::{LateLet, LateSource};
use crate::model::lets::{LetValues, Local, Values};
use crate::model::map::{Map, Source as MapSource};
use crate::table::Measurements;

/// A `let` as declared.
pub(super) struct Declared {
    name: &'static str,
    unit: String,
    /// What its expression mentions.
    mentions: Place,
    differs: Differs,
    /// The expression; `None` for a linear predictor.
    make: Option<AnyLet>,
}

/// What makes the values of a `let` differ from each other.
#[derive(Clone, Debug, PartialEq)]
enum Differs {
    /// Nothing: it has one value.
    Not,
    /// The place alone. The maps of a run show such a `let`.
    Place,
    /// A label. Holds the number of the label of each row of the table.
    Label(Vec<usize>),
    Row,
}

impl Differs {
    /// What makes an expression differ that depends on both.
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
    /// A `let` with more values than this is not reported. Such a `let` is a predictor with
    /// thousands of values, of which the replicated measurements tell enough.
    const MOST: usize = 200;

    /// `let name(row) [unit] in range = expr;`
    pub fn value(
        &mut self,
        decl: Decl,
        name: &'static str,
        range: Option<(f64, f64)>,
        mentions: Place,
        make: AnyLet,
    ) {
        let unit: String = decl.unit.into();
        self.maps_of(name, &unit, range, mentions, &make);
        let mut differs = if mentions.reads_row { Differs::Row } else { Differs::Not };
        for of in mentions.numbers.iter().chain(mentions.lets) {
            differs = differs.and(self.differs(of));
        }
        self.lets.push(Declared { name, unit, mentions, differs, make: Some(make) });
        self.names.push((name.into(), Source::Let));
    }

    /// `let name(row) = linear(row.a, row.b; beta);`
    pub fn linear(
        &mut self,
        decl: Decl,
        name: &'static str,
        columns: &[&'static str],
        beta: &'static str,
    ) {
        let columns = columns.to_vec();
        self.linear_let(decl, name, Linear::Columns { beta, columns });
    }

    /// `let name(row) = a + b * row.dose;`, a linear predictor that is written out.
    pub fn predictor(
        &mut self,
        decl: Decl,
        name: &'static str,
        mentions: Place,
        factors: AnyPredictor,
    ) {
        self.linear_let(decl, name, Linear::Written { numbers: mentions.numbers, factors });
    }

    /// A linear predictor that is a part of the expression of another statement.
    pub fn part(&mut self, name: &'static str, mentions: Place, factors: AnyPredictor) {
        let linear = Linear::Written { numbers: mentions.numbers, factors };
        self.names.push((name.into(), Source::Linear(linear)));
    }

    pub(super) fn linear_let(&mut self, decl: Decl, name: &'static str, linear: Linear) {
        self.let_without_value(decl, name, Differs::Row, linear);
    }

    /// A gradient, which a map shows.
    pub(super) fn linear_let_of_place(&mut self, decl: Decl, name: &'static str, linear: Linear) {
        self.let_without_value(decl, name, Differs::Place, linear);
    }

    fn let_without_value(
        &mut self,
        decl: Decl,
        name: &'static str,
        differs: Differs,
        linear: Linear,
    ) {
        let mentions = Place { numbers: &[], lets: &[], reads_row: differs == Differs::Row };
        let unit = decl.unit.into();
        self.lets.push(Declared { name, unit, mentions, differs, make: None });
        self.names.push((name.into(), Source::Linear(linear)));
    }

    /// The value of a field that is bent into its range. It is laid out as a `let` of the field's
    /// sum, but reported by the field's own map.
    pub(super) fn link(&mut self, name: &'static str) {
        let mentions = Place { numbers: &[], lets: &[], reads_row: false };
        let differs = Differs::Place;
        let link = Declared { name, unit: String::new(), mentions, differs, make: None };
        self.lets.push(link);
        self.names.push((name.into(), Source::Let));
    }

    /// Whether this is the `let` of a field that is bent into its range.
    fn is_link(&self, name: &str) -> bool {
        let is_it =
            |l: &Declared| l.name == name && l.make.is_none() && l.differs == Differs::Place;
        self.lets.iter().any(is_it)
    }

    /// The map over the vertices of a `let` that depends on parameters and fields alone. There is
    /// one map, or one for each label of the fields that it depends on.
    fn maps_of(
        &mut self,
        name: &'static str,
        unit: &str,
        range: Option<(f64, f64)>,
        mentions: Place,
        AnyLet(make): &AnyLet,
    ) {
        let late = &self.model.late_maps;
        let is_map_too = |name: &&str| {
            self.is_link(name)
                || self.model.maps.iter().any(|m| m.of == *name)
                || late.lets.iter().any(|own| own.name == *name)
        };
        if mentions.reads_row || !mentions.lets.iter().all(is_map_too) {
            return;
        }
        if mentions.numbers.iter().any(|number| self.steepness_of(number).is_some()) {
            return self.late_map_of(name, unit, range, mentions, &AnyLet(make.clone()));
        }
        let mut labels: Option<&Arc<Labels>> = None;
        for number in mentions.numbers {
            match self.source(number) {
                Source::Scalars { .. } | Source::Field { labels: None, .. } => {}
                Source::Field { labels: Some(own), .. }
                    if labels.is_none_or(|labels| labels.column == own.column) =>
                {
                    labels = Some(own);
                }
                _ => return,
            }
        }
        let n_maps = labels.map_or(1, |labels| labels.names.len().max(1));
        let mut maps = vec![];
        for label in 0..n_maps {
            let own = labels.and_then(|labels| labels.names.get(label));
            let mut sources = vec![];
            for number in mentions.numbers {
                match self.source(number) {
                    Source::Scalars { v, len } => {
                        sources.extend((*v..v + len).map(MapSource::Value));
                    }
                    Source::Field { field, labels } => {
                        let own = labels.as_ref().map_or(0, |_| label);
                        sources.push(MapSource::Field(field + own));
                    }
                    _ => {}
                }
            }
            sources.extend(mentions.lets.iter().map(|_| MapSource::Value(0)));
            maps.push(Map {
                of: name,
                name: own.map_or_else(|| name.into(), |own| format!("{name}[{own}]")),
                unit: unit.into(),
                range,
                label: labels.map(|_| label),
                sources,
                at: make(),
            });
        }
        self.model.maps.extend(maps);
    }

    /// The number of the gradient of this name.
    fn steepness_of(&self, name: &str) -> Option<usize> {
        self.model.late_maps.steepness.iter().position(|own| own.name == name)
    }

    /// The map of a `let` that mentions a gradient.
    fn late_map_of(
        &mut self,
        name: &'static str,
        unit: &str,
        range: Option<(f64, f64)>,
        mentions: Place,
        AnyLet(make): &AnyLet,
    ) {
        let mut sources = vec![];
        for number in mentions.numbers {
            match self.source(number) {
                Source::Scalars { v, len } => {
                    let own = (*v..v + len).map(MapSource::Value);
                    sources.extend(own.map(LateSource::Early));
                }
                Source::Field { field, labels: None } => {
                    sources.push(LateSource::Early(MapSource::Field(*field)));
                }
                _ => match self.steepness_of(number) {
                    Some(own) => sources.push(LateSource::Steepness(own)),
                    None => return,
                },
            }
        }
        let offsets = mentions.lets.iter().map(|_| LateSource::Early(MapSource::Value(0)));
        sources.extend(offsets);
        let own = LateLet { name, unit: unit.into(), range, sources, at: make() };
        self.model.late_maps.lets.push(own);
    }

    fn differs(&self, name: &str) -> Differs {
        match self.source(name) {
            Source::Scalars { .. } => Differs::Not,
            Source::Each { labels, .. } => Differs::Label(labels.of_row.clone()),
            Source::Field { .. } => Differs::Place,
            Source::Linear(_) if self.steepness_of(name).is_some() => Differs::Place,
            Source::Linear(_) | Source::Cells { .. } => Differs::Row,
            Source::Let => {
                let declared = self.lets.iter().rev().find(|l| l.name == name);
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

    /// For each value of the `let`, a row of an `observe` that depends on it. Empty where a map
    /// shows the `let`.
    fn rows_of(&self, declared: &Declared) -> Vec<Row> {
        let has_maps = !self.model.fields.is_empty();
        let acted = self.acts(declared.name);
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
            if self.seen.contains(&(declared.name, observe.name)) {
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
        let Declared { name, unit, mentions, differs, make } = declared;
        let who = format!("let {name}");
        let is_one = differs == Differs::Not && rows.len() == 1;
        let labels = if is_one { vec![] } else { self.labels_of(mentions.numbers, rows, data) };
        let of = match make {
            None => {
                Values::Linear(rows.iter().flat_map(|row| self.scalars_of(name, *row)).collect())
            }
            Some(AnyLet(make)) => {
                let mut at = make();
                let (mut scalars, mut offset) = (vec![], vec![]);
                for row in rows {
                    at.read(&mut |column| Ok(data.number(row.2, column, &who)?))?;
                    offset.push(self.offset(name, *row));
                    for of in mentions.numbers.iter().chain(mentions.lets) {
                        scalars.extend(self.scalars_of(of, *row));
                    }
                }
                Values::Expression { at, scalars, offset }
            }
        };
        Ok(LetValues { name, unit, labels, len: rows.len(), of })
    }

    /// Where the numbers behind `name` live for this row.
    fn scalars_of(&self, name: &'static str, row: Row) -> Vec<Local> {
        let source = self.source(name);
        let (value, len) = match source {
            Source::Scalars { v, len } => (*v, *len),
            Source::Linear(_) => {
                (self.predictors.get(&(row.0, name)).map_or(0, |start| start + row.1), 1)
            }
            source => (self.value_at(source, row.2), 1),
        };
        let offset = self.offset(name, row);
        (value..value + len).map(|value| [value as u32, offset]).collect()
    }

    /// The offset that effects have added to `name` in this row.
    fn offset(&self, name: &'static str, (observe, i, _): Row) -> u32 {
        self.hooks.get(&(observe, name.into())).map_or(0, |at| at + i) as u32
    }

    /// Names of the rows: the labels of a parameter that the `let` mentions, if these tell the rows
    /// apart; else the lines of the rows.
    fn labels_of(&self, names: &[&'static str], rows: &[Row], data: &Measurements) -> Vec<String> {
        for name in names {
            let Source::Each { labels, .. } = self.source(name) else { continue };
            let distinct: BTreeSet<usize> = rows.iter().map(|row| labels.of_row[row.2]).collect();
            if distinct.len() == rows.len() {
                let label = |row: &Row| labels.names[labels.of_row[row.2]].clone();
                return rows.iter().map(label).collect();
            }
        }
        rows.iter().map(|row| format!("line {}", data.line(row.2))).collect()
    }
}
