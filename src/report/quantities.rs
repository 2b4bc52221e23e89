//! Parameters, and `let`s that are no maps, as variables and in summaries.

use std::io;
use std::sync::Arc;

use rayon::prelude::*;

use super::text::after_number;
use super::{Columns, Group, MAX_R_HAT, Row, Values, Variable};
use crate::diagnostics::{Stray, stray, summarise};
use crate::model::{Kind, LetValues, Model, Parameter};
use crate::store::Spool;

/// A parameter, or a `let` that is no map.
struct Quantity<'m> {
    name: &'m str,
    unit: &'m str,
    len: usize,
    labels: &'m [String],
    is_vector: bool,
}

impl<'m> Quantity<'m> {
    fn of_parameter(p: &'m Parameter) -> Self {
        let is_vector = p.kind != Kind::Scalar;
        Self { name: &p.name, unit: &p.unit, len: p.len, labels: &p.labels, is_vector }
    }

    fn of_let(l: &'m LetValues) -> Self {
        let is_vector = !l.labels.is_empty();
        Self { name: l.name, unit: &l.unit, len: l.len, labels: &l.labels, is_vector }
    }

    /// Name of its `i`-th number.
    fn element(&self, i: usize) -> String {
        match (self.is_vector, self.labels.get(i)) {
            (false, _) => self.name.to_owned(),
            (true, Some(label)) => format!("{}[{label}]", self.name),
            (true, None) => format!("{}[{i}]", self.name),
        }
    }
}

/// All of a model.
pub(super) struct Quantities<'m>(Vec<Quantity<'m>>);

impl<'m> Quantities<'m> {
    pub(super) fn of(model: &'m Model) -> Self {
        let parameters = model.parameters.iter().map(Quantity::of_parameter);
        Self(parameters.chain(model.lets.iter().map(Quantity::of_let)).collect())
    }

    /// Numbers of all together.
    pub(super) fn width(&self) -> usize {
        self.0.iter().map(|q| q.len).sum()
    }

    /// Each as a variable (chain, draw, …), with its labels.
    pub(super) fn variables(
        &self,
        reported: &Arc<Vec<Spool>>,
        [chains, draws]: [usize; 2],
    ) -> Group {
        let mut from = 0;
        let mut variables = vec![];
        for q in &self.0 {
            let values = Columns::new(reported, from, q.len);
            from += q.len;
            let dim = format!("{}_dim", q.name);
            let mut dims = vec![("chain", chains), ("draw", draws)];
            if q.is_vector {
                dims.push((&dim, q.len));
            }
            variables.push(Variable::new(q.name, q.unit, &dims, values));
            if !q.labels.is_empty() {
                variables.push(Variable::new(&dim, "", &[(&dim, q.len)], q.labels.to_vec()));
            }
        }
        Group { name: "posterior".into(), variables }
    }

    /// All summaries, at least `at_once` of them by one thread, and where the chains disagree on the worst of them.
    ///
    /// # Errors
    /// From the disk that the draws are on.
    pub(super) fn summaries(
        &self,
        posterior: &Group,
        draws: usize,
        at_once: usize,
    ) -> io::Result<(Vec<Row>, Option<String>)> {
        let mut jobs = vec![];
        for q in &self.0 {
            let variable = posterior.variables.iter().find(|v| v.name == q.name);
            let Some(Values::Columns(columns)) = variable.map(|v| &v.values) else { continue };
            jobs.extend((0..q.len).map(|i| (q, i, columns)));
        }
        let row = |(q, i, columns): &(&Quantity<'_>, usize, &Columns)| {
            let column = columns.column(*i)?;
            let chains: Vec<&[f64]> = column.chunks_exact(draws.max(1)).collect();
            let summary = summarise(&chains);
            let row = Row { name: q.element(*i), unit: q.unit.to_owned(), summary };
            let strays = (row.summary.r_hat > MAX_R_HAT).then(|| strays(&row, &chains)).flatten();
            Ok((row, strays))
        };
        let made: io::Result<Vec<_>> = jobs.par_iter().with_min_len(at_once).map(row).collect();
        let (rows, strays): (Vec<Row>, Vec<Option<String>>) = made?.into_iter().unzip();
        let worst = rows.iter().zip(strays).filter(|(row, _)| !row.summary.r_hat.is_nan());
        let worst = worst.max_by(|(a, _), (b, _)| a.summary.r_hat.total_cmp(&b.summary.r_hat));
        let strays = worst.and_then(|(_, strays)| strays);
        Ok((rows, strays))
    }
}

/// Where the chains disagree on one quantity, in words.
fn strays(row: &Row, chains: &[&[f64]]) -> Option<String> {
    let Stray { chain, draws, mean, rest_mean, rest_sd } = stray(chains)?;
    let unit = after_number(&row.unit);
    Some(format!(
        "chain {} in its draws {} to {}, where {} is {mean:.3}{unit}, elsewhere {rest_mean:.3} ± {rest_sd:.3}",
        chain + 1,
        draws.start + 1,
        draws.end,
        row.name
    ))
}
