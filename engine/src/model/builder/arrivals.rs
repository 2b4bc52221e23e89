//! `let name(row) = eikonal(…; row.source);`: arrival times over the whole surface.

use std::collections::BTreeMap;

use super::{Builder, Linear, Source};
use crate::model::arrival::{Arrival, OPERANDS, Operand};
use crate::model::error::ModelError;
use crate::model::everywhere::Where;
use crate::model::expression::AnyOperand;
use crate::model::functions::Decl;
use crate::table::SOURCE;

/// An `eikonal` statement.
pub(super) struct Declared {
    unit: String,
    /// Where the numbers of each operand live, and the operand.
    operands: [Option<(Vec<Where>, AnyOperand)>; OPERANDS],
    /// Number of the model's arrivals, by the cells that the operands read of a row: each combination is an activation
    /// of its own.
    arrivals: BTreeMap<Vec<u64>, usize>,
}

impl Builder<'_> {
    /// `let name(row) [unit] = eikonal(slowness, ratio, angle, thickness; row.source);`
    ///
    /// # Errors
    /// No column `source`; a ratio on a mesh without fibres, where no angle says how they run.
    pub fn eikonal(
        &mut self,
        decl: Decl,
        name: &'static str,
        operands: [Option<AnyOperand>; OPERANDS],
    ) -> Result<(), ModelError> {
        let unit = decl.unit.clone().into();
        self.linear_let(decl, name, Linear::Arrival(self.eikonals.len()));
        let Some(data) = self.data else { return Ok(()) };
        let Some(waves) = data.waves() else {
            return Err(ModelError::NoSource { name: name.into(), file: data.file().into() });
        };
        let [_, ratio, angle, _] = &operands;
        if ratio.is_some() && angle.is_none() && !waves.has_fibres {
            return Err(ModelError::NoFibres { name: name.into() });
        }
        let operands = operands.map(|operand| operand.map(|of| (self.places(&of), of)));
        self.eikonals.push(Declared { unit, operands, arrivals: BTreeMap::new() });
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

    /// Lays out the arrivals at these rows. Returns the place of the first.
    ///
    /// # Errors
    /// A cell that an operand needs and the table lacks.
    pub(super) fn arrivals_at(
        &mut self,
        name: &str,
        eikonal: usize,
        rows: &[usize],
    ) -> Result<usize, ModelError> {
        let out = self.values(rows.len());
        let Some((data, waves)) = self.data.and_then(|data| Some((data, data.waves()?))) else {
            return Ok(out);
        };
        let who = format!("let {name}");
        for (i, row) in rows.iter().enumerate() {
            let label = data.column(SOURCE).map_or("", |column| column.text(*row));
            let mut label = format!("{name}[{label}");
            let mut cells = vec![];
            let mut cell = |column: &str| -> Result<f64, ModelError> {
                let cell = data.number(*row, column, &who)?;
                cells.push(cell.to_bits());
                label = format!("{label},{cell}");
                Ok(cell)
            };
            let mut operands = [const { None }; OPERANDS];
            for (operand, declared) in operands.iter_mut().zip(&self.eikonals[eikonal].operands) {
                let Some((from, of)) = declared else { continue };
                let mut math = (of.make)();
                math.read(of.columns, &mut cell)?;
                *operand = Some(Operand { from: from.clone(), math });
            }
            let arrivals = &mut self.model.arrivals;
            let Declared { unit, arrivals: own, .. } = &mut self.eikonals[eikonal];
            let arrival = *own.entry(cells).or_insert_with(|| {
                let arrival = Arrival {
                    solver: waves.solver.clone(),
                    places: waves.places.clone(),
                    operands,
                    sources: vec![],
                    names: vec![],
                    unit: unit.clone(),
                    work: self.n_work,
                    front: 0,
                };
                self.n_work += arrival.n_work();
                arrivals.push(arrival);
                arrivals.len() - 1
            });
            let Arrival { sources, names, .. } = &mut arrivals[arrival];
            let (source, at) = (waves.source[*row], (waves.at[*row], out + i));
            if let Some((_, own)) = sources.iter_mut().find(|(own, _)| *own == source) {
                own.push(at);
            } else {
                sources.push((source, vec![at]));
                names.push(label + "]");
            }
        }
        Ok(out)
    }

    /// Gives every source of every arrival a front on the tape.
    pub(super) fn lay_out_fronts(&mut self) {
        let mut front = 0;
        for arrival in &mut self.model.arrivals {
            arrival.front = front;
            front += arrival.sources.len();
        }
        self.model.n_fronts = front;
    }
}
