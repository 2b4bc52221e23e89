//! `let name(row) = eikonal(…; row.source);`: arrival times over the whole surface.

use std::collections::BTreeMap;

use super::{Builder, Linear, Source};
use crate::model::arrival::{Arrival, Operand, PIECES};
use crate::model::error::ModelError;
use crate::model::everywhere::Where;
use crate::model::expression::AnyOperand;
use crate::model::functions::Decl;
use crate::table::Measurements;

impl Builder<'_> {
    /// `let name(row) [unit] = eikonal(slowness, ratio, angle; row.source);`
    ///
    /// # Errors
    /// No column `source`; a ratio on a mesh without fibres, where no angle says how they run.
    pub fn eikonal(
        &mut self,
        decl: Decl,
        name: &'static str,
        operands: [Option<AnyOperand>; 3],
    ) -> Result<(), ModelError> {
        let arrival = self.model.arrivals.len();
        self.linear_let(decl, name, Linear::Arrival(arrival));
        let Some(data) = self.data else { return Ok(()) };
        let Some(waves) = data.waves() else {
            return Err(ModelError::NoSource { name: name.into(), file: data.file().into() });
        };
        let [_, ratio, angle] = &operands;
        if ratio.is_some() && angle.is_none() && !waves.has_fibres {
            return Err(ModelError::NoFibres { name: name.into() });
        }
        let operands = operands.map(|operand| operand.map(|of| self.operand(of)));
        let work = self.n_work;
        self.n_work += PIECES * waves.solver.n_vertices();
        let solver = waves.solver.clone();
        self.model.arrivals.push(Arrival { solver, operands, sources: vec![], work, front: 0 });
        Ok(())
    }

    /// Where the numbers of an operand live. Those that differ from place to place are fields.
    fn operand(&mut self, AnyOperand { mentions, make }: AnyOperand) -> Operand {
        let mut from = vec![];
        for number in mentions.numbers {
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
        Operand { from, math: make() }
    }

    /// Lays out the arrivals at these rows. Returns the place of the first.
    pub(super) fn arrivals_at(&mut self, arrival: usize, rows: &[usize]) -> usize {
        let out = self.values(rows.len());
        let Some(waves) = self.data.and_then(Measurements::waves) else { return out };
        let mut of_source: BTreeMap<u32, Vec<(u32, usize)>> = BTreeMap::new();
        for (i, row) in rows.iter().enumerate() {
            of_source.entry(waves.source[*row]).or_default().push((waves.at[*row], out + i));
        }
        let sources = &mut self.model.arrivals[arrival].sources;
        for (source, rows) in of_source {
            match sources.iter_mut().find(|(own, _)| *own == source) {
                Some((_, own)) => own.extend(rows),
                None => sources.push((source, rows)),
            }
        }
        out
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
