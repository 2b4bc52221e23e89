//! `let name(row) = eikonal(…; row.source);` and its like: operators over the whole surface.

use std::collections::BTreeMap;

use super::{Builder, Linear, Source as BuilderSource};
use crate::manifold::Gradient;
use crate::model::error::ModelError;
use crate::model::everywhere::Where;
use crate::model::expression::AnyOperand;
use crate::model::functions::Decl;
use crate::model::laid_out::Model;
use crate::model::late::Steepness;
use crate::model::map::Source as MapSource;
use crate::model::operator::{Along, Arrival, Everywhere, Operator, Slope, Source};
use crate::model::over::{Operand, Over};
use crate::table::{Fineness, Ground, Measurements, SOURCE, Triangulation};

/// Which operator.
#[derive(Clone, Copy, Debug)]
pub enum Operation {
    /// `eikonal(SLOWNESS, RATIO, ANGLE, THICKNESS; row.source)`
    Eikonal,
    /// `path(EXPR; row.source)`
    Path,
    /// `gradient(EXPR)`
    Gradient,
    /// `function(EXPR, …; numbers)`, a function of the model file.
    Own(fn(&Everywhere<'_>) -> Box<dyn Operator>),
}

impl Operation {
    fn is_eikonal(self) -> bool {
        matches!(self, Self::Eikonal)
    }
}

/// An operator as declared.
pub(super) struct Declared {
    operation: Operation,
    unit: String,
    /// Where the numbers of each operand live, and the operand.
    operands: Vec<(Vec<Where>, AnyOperand)>,
    further: &'static [FurtherSource],
    /// Which of the builder's `over` it is, by the cells that the operands read of a row: each combination is an
    /// operator of its own.
    over: BTreeMap<Vec<u64>, usize>,
}

/// An operator of whose rows not all are known yet.
pub(super) struct Waiting {
    operation: Operation,
    unit: String,
    operands: Vec<Operand>,
    /// The place of each single number that it depends on.
    numbers: Vec<usize>,
    rows: Vec<Row>,
    /// Of the maps: one for each activation.
    names: Vec<(Vec<Source>, String)>,
}

/// A row of an operator.
struct Row {
    /// Number of the row in the table.
    of_table: usize,
    /// Place of its number.
    at: usize,
    sources: Vec<Source>,
}

/// A column with a vertex at which activation starts too, and the parameter that tells by how much later.
type FurtherSource = (&'static str, &'static str);

impl Builder<'_> {
    /// `let name(row) [unit] = OPERATION(operands; row.source, row.source2 + later(row));`
    ///
    /// # Errors
    /// No column `source`, where activation must start; a ratio on a mesh without fibres, where no angle says how they
    /// run; no surface.
    pub fn operator(
        &mut self,
        decl: Decl,
        name: &'static str,
        operation: Operation,
        operands: Vec<AnyOperand>,
        further: &'static [FurtherSource],
    ) -> Result<(), ModelError> {
        let unit: String = decl.unit.clone().into();
        let operator = Linear::Operator(self.operators.len());
        match operation {
            Operation::Gradient => {
                self.linear_let_of_place(decl, name, operator);
                self.steepness(name, &unit, &operands)?;
            }
            Operation::Own(_) => {
                self.linear_let(decl, name, operator);
                self.require_ground(name)?;
            }
            Operation::Eikonal | Operation::Path => {
                self.linear_let(decl, name, operator);
                self.require_sources(name, operation, operands.len(), further)?;
            }
        }
        for (_, later) in further {
            if let BuilderSource::Scalars { v, .. } = *self.source(later) {
                *self.mentions.entry(v).or_default() += 1;
            }
        }
        if self.data.is_some() {
            let operands = operands.into_iter().map(|of| (self.places(&of), of)).collect();
            let over = BTreeMap::new();
            let declared = Declared { operation, unit, operands, further, over };
            self.operators.push(declared);
        }
        Ok(())
    }

    fn require_ground(&self, name: &str) -> Result<(), ModelError> {
        let is_lacking = self.data.is_some_and(|data| data.ground().is_none());
        if is_lacking { Err(ModelError::NoMesh { name: name.into() }) } else { Ok(()) }
    }

    fn require_sources(
        &self,
        name: &str,
        operation: Operation,
        n_operands: usize,
        further: &[FurtherSource],
    ) -> Result<(), ModelError> {
        let Some(data) = self.data else { return Ok(()) };
        let lacks = |column: &str| ModelError::NoSource {
            name: name.into(),
            file: data.file().into(),
            column: column.into(),
        };
        let Some(ground) = data.ground().filter(|ground| ground.has_sources()) else {
            return Err(lacks(SOURCE));
        };
        if let Some((column, _)) = further.iter().find(|(column, _)| !data.has(column)) {
            return Err(lacks(column));
        }
        let has_only_ratio = operation.is_eikonal() && n_operands == 2;
        if has_only_ratio && !ground.has_fibres() {
            return Err(ModelError::NoFibres { name: name.into() });
        }
        Ok(())
    }

    /// The map of a gradient, unless it depends on columns.
    fn steepness(
        &mut self,
        name: &'static str,
        unit: &str,
        operands: &[AnyOperand],
    ) -> Result<(), ModelError> {
        self.require_ground(name)?;
        let Some(ground) = self.data.and_then(Measurements::ground) else { return Ok(()) };
        let Some(of) = operands.iter().find(|of| of.columns.is_empty()) else { return Ok(()) };
        let mut sources = vec![];
        for number in of.mentions.numbers {
            match self.source(number) {
                BuilderSource::Scalars { v, len } => {
                    sources.extend((*v..v + len).map(MapSource::Value));
                }
                BuilderSource::Field { field, .. } => sources.push(MapSource::Field(*field)),
                _ => unreachable!("the language refuses what has no value at every place"),
            }
        }
        let (gradient, math) = (ground.gradient(), (of.make)());
        let steepness = Steepness { name, unit: unit.into(), sources, math, gradient };
        self.model.late_maps.steepness.push(steepness);
        Ok(())
    }

    /// Where the numbers of an operand live. Those that differ from place to place are fields.
    fn places(&mut self, operand: &AnyOperand) -> Vec<Where> {
        let mut from = vec![];
        for number in operand.mentions.numbers {
            match *self.source(number) {
                BuilderSource::Scalars { v, len } => {
                    from.extend((v..v + len).map(|v| Where::Same(v as u32)));
                }
                BuilderSource::Field { field, .. } => {
                    from.push(Where::Each(self.model.fields[field].op.theta as u32));
                }
                _ => unreachable!("the language refuses what has no value at every place"),
            }
        }
        for at in from.iter().filter_map(|at| if let Where::Same(v) = at { Some(v) } else { None })
        {
            *self.mentions.entry(*at as usize).or_default() += 1;
        }
        from
    }

    /// Lays out an operator's numbers at these rows. Returns the place of the first.
    ///
    /// # Errors
    /// A cell that an operand needs and the table lacks.
    pub(super) fn operator_at(
        &mut self,
        name: &str,
        number: usize,
        rows: &[usize],
    ) -> Result<usize, ModelError> {
        let out = self.values(rows.len());
        let Some((data, ground)) = self.data.and_then(|data| Some((data, data.ground()?))) else {
            return Ok(out);
        };
        let on = ground.triangulation(self.model.fineness())?;
        let who = format!("let {name}");
        for (i, row) in rows.iter().enumerate() {
            let places = self.sources_of(number, *row, on);
            let mut label = self.label_of(number, *row, data);
            let mut cells = vec![];
            let mut cell = |column: &str| -> Result<f64, ModelError> {
                let cell = data.number(*row, column, &who)?;
                cells.push(cell.to_bits());
                label = format!("{label},{cell}");
                Ok(cell)
            };
            let mut operands = vec![];
            for (from, of) in &self.operators[number].operands {
                let mut math = (of.make)();
                math.read(of.columns, &mut cell)?;
                operands.push(Operand { from: from.clone(), math });
            }
            let over = &mut self.over;
            let Declared { operation, unit, over: own, .. } = &mut self.operators[number];
            let at = *own.entry(cells).or_insert_with(|| {
                let (operation, unit) = (*operation, unit.clone());
                let (numbers, rows, names) = (vec![], vec![], vec![]);
                over.push(Waiting { operation, unit, operands, numbers, rows, names });
                over.len() - 1
            });
            let Waiting { operation, numbers, rows, names, .. } = &mut over[at];
            let mut number = |place: usize| {
                numbers.iter().position(|own| *own == place).unwrap_or_else(|| {
                    numbers.push(place);
                    numbers.len() - 1
                })
            };
            let sources: Vec<Source> = places
                .into_iter()
                .map(|(vertex, place)| (vertex, place.map(&mut number)))
                .collect();
            if operation.is_eikonal() && !names.iter().any(|(of, _)| *of == sources) {
                names.push((sources.clone(), format!("{name}[{label}]")));
            }
            rows.push(Row { of_table: *row, at: out + i, sources });
        }
        Ok(out)
    }

    /// The vertices at which the activation of a row starts, and of all but the first the place of the number that
    /// tells by how much later.
    fn sources_of(&self, number: usize, row: usize, on: &Triangulation) -> Vec<Source> {
        let at = |column: &str| on.source(column).and_then(|of_rows| of_rows[row]);
        let first = at(SOURCE).map(|vertex| (vertex, None));
        let further = self.operators[number].further.iter().filter_map(|(column, later)| {
            let place = self.value_at(self.source(later), row);
            at(column).map(|vertex| (vertex, Some(place)))
        });
        first.into_iter().chain(further).collect()
    }

    /// What tells the activation of a row from others: the cells of its sources, and labels of what is later.
    fn label_of(&self, number: usize, row: usize, data: &Measurements) -> String {
        let cell = |column: &str| data.cell(row, column).filter(|cell| !cell.is_empty());
        let mut label = cell(SOURCE).unwrap_or("").to_owned();
        for (column, later) in self.operators[number].further {
            let Some(vertex) = cell(column) else { continue };
            label = format!("{label}+{vertex}");
            if let BuilderSource::Each { labels, .. } = self.source(later)
                && labels.column != *column
            {
                label = format!("{label}:{}", labels.names[labels.of_row[row]]);
            }
        }
        label
    }

    /// Makes the operators, all of whose rows are now known.
    ///
    /// # Errors
    /// What the surface's triangulation, or the way to a row, is refused for.
    pub(super) fn lay_out_operators(&mut self) -> Result<(), ModelError> {
        let Some(ground) = self.data.and_then(|data| data.ground()) else { return Ok(()) };
        for (kept, waiting) in std::mem::take(&mut self.over).into_iter().enumerate() {
            let Waiting { operation, unit, operands, numbers, rows, names } = waiting;
            let on = ground.triangulation(self.model.fineness())?;
            self.model.triangulation = Some(on.clone());
            let over = Over {
                operator: made(operation, &rows, ground, on)?,
                operands,
                numbers,
                n: on.mesh.n_vertices(),
                places: on.places.clone(),
                rows: rows.iter().map(|row| row.at).collect(),
                names: names.into_iter().map(|(_, name)| name).collect(),
                unit,
                work: self.n_work,
                kept,
            };
            self.n_work += over.n_work();
            self.model.over.push(over);
        }
        Ok(())
    }
}

impl Model {
    /// How fine the triangulation is to be on which its operators are computed.
    pub(super) fn fineness(&self) -> Fineness {
        let is_enough = self.syntax().is_ok_and(|tree| tree.has_arrivals_alone());
        if is_enough { Fineness::Arrivals } else { Fineness::Any }
    }
}

fn made(
    operation: Operation,
    rows: &[Row],
    ground: &Ground,
    on: &Triangulation,
) -> Result<Box<dyn Operator>, ModelError> {
    let at = |row: &Row| on.at[row.of_table];
    Ok(match operation {
        Operation::Eikonal => {
            let rows = rows.iter().map(|row| (row.sources.clone(), at(row))).collect();
            Box::new(Arrival::new(on.eikonal.clone(), on.finer.clone(), rows))
        }
        Operation::Path => {
            let of_table: Vec<usize> = rows.iter().map(|row| row.of_table).collect();
            let weights = ground.path_weights(on, &of_table)?;
            Box::new(Along { weights })
        }
        Operation::Gradient => {
            let gradient = Gradient::new(&on.mesh);
            Box::new(Slope { gradient, rows: rows.iter().map(at).collect() })
        }
        Operation::Own(make) => {
            let at: Vec<u32> = rows.iter().map(at).collect();
            let of_source = |row: &Row| on.source(SOURCE).and_then(|all| all[row.of_table]);
            let source: Vec<Option<u32>> = rows.iter().map(of_source).collect();
            make(&Everywhere { mesh: &on.mesh, at: &at, source: &source })
        }
    })
}
