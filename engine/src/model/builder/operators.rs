//! `let name(row) = eikonal(…; row.source);` and its like: operators over the whole surface.

use std::collections::BTreeMap;

use super::{Builder, Linear, Source};
use crate::manifold::Gradient;
use crate::model::error::ModelError;
use crate::model::everywhere::Where;
use crate::model::expression::AnyOperand;
use crate::model::functions::Decl;
use crate::model::late_maps::Steepness;
use crate::model::map::Source as MapSource;
use crate::model::operator::{Along, Arrival, Operator, Slope};
use crate::model::over::{Operand, Over};
use crate::table::{Ground, SOURCE, Triangulation};

/// Which operator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Operation {
    /// `eikonal(SLOWNESS, RATIO, ANGLE, THICKNESS; row.source)`
    Eikonal,
    /// `path(EXPR; row.source)`
    Path,
    /// `gradient(EXPR)`
    Gradient,
}

/// An operator as declared.
pub(super) struct Declared {
    operation: Operation,
    unit: String,
    /// Where the numbers of each operand live, and the operand.
    operands: Vec<(Vec<Where>, AnyOperand)>,
    /// Which of the builder's `over` it is, by the cells that the operands read of a row: each combination is an
    /// operator of its own.
    over: BTreeMap<Vec<u64>, usize>,
}

/// An operator of whose rows not all are known yet.
pub(super) struct Waiting {
    operation: Operation,
    unit: String,
    operands: Vec<Operand>,
    /// Row of the table, and the place of its number.
    rows: Vec<(usize, usize)>,
    /// Of the maps: one for each source.
    names: Vec<(u32, String)>,
}

impl Builder<'_> {
    /// `let name(row) [unit] = OPERATION(operands; row.source);`
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
    ) -> Result<(), ModelError> {
        let unit: String = decl.unit.clone().into();
        let operator = Linear::Operator(self.operators.len());
        if operation == Operation::Gradient {
            self.linear_let_of_place(decl, name, operator);
            self.steepness(name, &unit, &operands)?;
        } else {
            self.linear_let(decl, name, operator);
            self.require_source(name, operation, operands.len())?;
        }
        if self.data.is_some() {
            let operands = operands.into_iter().map(|of| (self.places(&of), of)).collect();
            let declared = Declared { operation, unit, operands, over: BTreeMap::new() };
            self.operators.push(declared);
        }
        Ok(())
    }

    fn require_source(
        &self,
        name: &str,
        operation: Operation,
        n_operands: usize,
    ) -> Result<(), ModelError> {
        let Some(data) = self.data else { return Ok(()) };
        let Some(ground) = data.ground().filter(|ground| ground.has_sources()) else {
            return Err(ModelError::NoSource { name: name.into(), file: data.file().into() });
        };
        let has_only_ratio = operation == Operation::Eikonal && n_operands == 2;
        if has_only_ratio && !ground.triangulation()?.has_fibres {
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
        let Some(data) = self.data else { return Ok(()) };
        let Some(ground) = data.ground() else {
            return Err(ModelError::NoMesh { name: name.into() });
        };
        let Some(of) = operands.iter().find(|of| of.columns.is_empty()) else { return Ok(()) };
        let mut sources = vec![];
        for number in of.mentions.numbers {
            match self.source(number) {
                Source::Scalars { v, len } => sources.extend((*v..v + len).map(MapSource::Value)),
                Source::Field { field, .. } => sources.push(MapSource::Field(*field)),
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
                Source::Scalars { v, len } => {
                    from.extend((v..v + len).map(|v| Where::Same(v as u32)));
                }
                Source::Field { field, .. } => {
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
        let sources = &ground.triangulation()?.source;
        let who = format!("let {name}");
        for (i, row) in rows.iter().enumerate() {
            let mut label = data.column(SOURCE).map_or("", |column| column.text(*row)).to_owned();
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
                over.push(Waiting { operation, unit, operands, rows: vec![], names: vec![] });
                over.len() - 1
            });
            let Waiting { operation, rows, names, .. } = &mut over[at];
            rows.push((*row, out + i));
            if *operation == Operation::Eikonal && !names.iter().any(|(of, _)| *of == sources[*row])
            {
                names.push((sources[*row], format!("{name}[{label}]")));
            }
        }
        Ok(out)
    }

    /// Makes the operators, all of whose rows are now known.
    ///
    /// # Errors
    /// What the surface's triangulation, or the way to a row, is refused for.
    pub(super) fn lay_out_operators(&mut self) -> Result<(), ModelError> {
        let Some(ground) = self.data.and_then(|data| data.ground()) else { return Ok(()) };
        for (kept, waiting) in std::mem::take(&mut self.over).into_iter().enumerate() {
            let Waiting { operation, unit, operands, rows, names } = waiting;
            let on = ground.triangulation()?;
            let (of_table, rows): (Vec<usize>, Vec<usize>) = rows.into_iter().unzip();
            let over = Over {
                operator: made(operation, &of_table, ground, on)?,
                operands,
                n: on.mesh.n_vertices(),
                places: on.places.clone(),
                rows,
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

fn made(
    operation: Operation,
    rows: &[usize],
    ground: &Ground,
    on: &Triangulation,
) -> Result<Box<dyn Operator>, ModelError> {
    let at = |row: &usize| on.at[*row];
    Ok(match operation {
        Operation::Eikonal => {
            let rows: Vec<_> = rows.iter().map(|row| (on.source[*row], at(row))).collect();
            Box::new(Arrival::new(on.eikonal.clone(), &rows))
        }
        Operation::Path => {
            let weights = ground.path_weights(rows)?;
            Box::new(Along { weights })
        }
        Operation::Gradient => {
            let gradient = Gradient::new(&on.mesh);
            Box::new(Slope { gradient, rows: rows.iter().map(at).collect() })
        }
    })
}
