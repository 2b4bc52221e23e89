//! `param` statements, hyperparameters and columns with a prior.

use std::sync::Arc;

use super::{Builder, Labels, Len, Source};
use crate::dist::{Sequence, Support, Vector};
use crate::model::error::ModelError;
use crate::model::expression::{AnyPrior, Names, prior};
use crate::model::functions::{Decl, PriorFn, VectorFn};
use crate::model::laid_out::PriorEntry;
use crate::model::parameter::{ImputedOp, Known, PriorOp, SequenceFn, SequenceOp, support_of};
use crate::model::reported::{Kind, Parameter, Position};
use crate::model::scope::Local;
use crate::num::Num;

impl Builder<'_> {
    /// Begins the block `name`. The parameters up to [`Builder::end_block`] belong to it.
    pub fn block(&mut self, name: &'static str) {
        self.prefix = Some(name);
    }

    /// The block ends.
    pub fn end_block(&mut self) {
        self.prefix = None;
    }

    /// `param name(len) [unit] ~ prior;`, or a hyperparameter of a field or block.
    ///
    /// # Errors
    /// A label column that the data lack.
    #[expect(clippy::needless_pass_by_value, reason = "the expansion makes one for each statement")]
    pub fn param(&mut self, decl: Decl, len: Len, prior: &AnyPrior) -> Result<(), ModelError> {
        if let (Len::Each(column), Some(_)) = (len, &self.field) {
            return self.param_of_each_field(&decl, column, prior);
        }
        self.laid_out(&decl, len, prior, (prior.make)())
    }

    /// As [`Builder::param`], for the coefficients of an effect. They are sampled as deviations if
    /// their prior is normal with an sd of its own. Returns whether they are.
    pub(super) fn coefficients(
        &mut self,
        decl: &Decl,
        len: Len,
        prior: &AnyPrior,
    ) -> Result<bool, ModelError> {
        let mut op = (prior.make)();
        let deviates = matches!(len, Len::Many(n) if self.deviates(n));
        let are_deviations = deviates && op.take_deviations();
        self.laid_out(decl, len, prior, op)?;
        Ok(are_deviations)
    }

    fn laid_out(
        &mut self,
        decl: &Decl,
        len: Len,
        prior: &AnyPrior,
        mut op: Box<dyn PriorOp>,
    ) -> Result<(), ModelError> {
        let at = self.local(prior.mentions, 0);
        let mentions = at.iter().map(|at| *at as usize).collect();
        let (u, v, n) = self.lay_out(decl, len, mentions, op.support(), op.is_flat())?;
        op.put(&at, u, v, n);
        self.model.priors.push(op);
        Ok(())
    }

    /// `name(label) [unit] ~ prior;` in a field that there is for each label. It becomes a
    /// parameter of each of these fields, as if it were written out, so that a sampler may treat it
    /// as part of its field.
    fn param_of_each_field(
        &mut self,
        decl: &Decl,
        column: &'static str,
        prior: &AnyPrior,
    ) -> Result<(), ModelError> {
        let labels = self.labels(column, &format!("param {}", decl.name))?;
        let first = self.n_v;
        for label in 0..labels.names.len().max(1) {
            let own = labels.names.get(label);
            let name = own.map_or(decl.name.to_string(), |own| format!("{}[{own}]", decl.name));
            let decl = Decl { name: name.into(), ..decl.clone() };
            self.param(decl, Len::One, prior)?;
        }
        self.names.push((self.full_name(&decl.name), Source::Each { v: first, labels }));
        Ok(())
    }

    /// The first unknown and the first value of a parameter, and how many numbers it has.
    fn lay_out(
        &mut self,
        decl: &Decl,
        len: Len,
        mentions: Vec<usize>,
        support: Support,
        is_flat: bool,
    ) -> Result<(usize, usize, usize), ModelError> {
        let labels = match len {
            Len::Each(column) => Some(self.labels(column, &format!("param {}", decl.name))?),
            _ => None,
        };
        let n = match (len, &labels) {
            (Len::Many(n), _) => n,
            (_, Some(labels)) => labels.names.len(),
            _ => 1,
        };
        let (u, v) = (self.unknowns(n), self.values(n));
        if is_flat {
            self.flat.extend((0..n).map(|i| (v + i, u + i)));
        }
        let kind = if matches!(len, Len::One) { Kind::Scalar } else { Kind::Vector };
        let names = labels.as_ref().map(|labels| labels.names.clone()).unwrap_or_default();
        let source = match labels {
            Some(labels) => Source::Each { v, labels },
            None => Source::Scalars { v, len: n },
        };
        self.names.push((self.full_name(&decl.name), source));
        self.push_parameter(decl, n, kind, names, support, v);
        if let Some(parameter) = self.model.parameters.last_mut() {
            parameter.is_flat = is_flat;
        }
        self.model.prior_entries.push(PriorEntry { u: u..u + n, v, len: n, mentions });
        Ok((u, v, n))
    }

    /// The labels of a column; none without data.
    pub(super) fn labels(
        &self,
        column: &'static str,
        who: &str,
    ) -> Result<Arc<Labels>, ModelError> {
        let (names, of_row) = match self.data {
            Some(data) => data.labels(column, who)?,
            None => (vec![], vec![]),
        };
        Ok(Arc::new(Labels { column, names, of_row }))
    }

    /// `sigma`, or `field.sigma` of a hyperparameter.
    fn full_name(&self, name: &str) -> String {
        self.prefix.map_or_else(|| name.to_owned(), |prefix| format!("{prefix}.{name}"))
    }

    pub(super) fn push_parameter(
        &mut self,
        decl: &Decl,
        len: usize,
        kind: Kind,
        labels: Vec<String>,
        support: Support,
        v: usize,
    ) {
        self.model.parameters.push(Parameter {
            name: self.full_name(&decl.name),
            unit: decl.unit.clone().into(),
            len,
            kind,
            labels,
            prior: decl.text.clone().into(),
            is_flat: false,
            support,
            position: Position::Values(v),
        });
    }

    /// `param name(n) [unit] ~ prior;`. The prior is that of each number, or of the whole vector.
    /// M1 is N + 1, M2 is N + 2.
    ///
    /// # Errors
    /// A prior of the whole vector that has another length, or that is no density.
    pub fn vector<F: VectorFn<N>, const N: usize, const M1: usize, const M2: usize>(
        &mut self,
        decl: Decl,
        n: usize,
        mentions: Names,
        f: F,
    ) -> Result<(), ModelError> {
        if is_whole(&f.prior([Num(1.0); N])) {
            self.sequence::<Known<F>, N, M2>(decl, n, mentions, Known(f))
        } else {
            self.param(decl, Len::Many(n), &prior::<_, N, M1>(mentions, Known(f)))
        }
    }

    /// A vector with a prior of all of its numbers.
    pub(in crate::model) fn sequence<F: SequenceFn<N>, const N: usize, const M: usize>(
        &mut self,
        decl: Decl,
        n: usize,
        mentions: Names,
        f: F,
    ) -> Result<(), ModelError> {
        let local = Local::<N>::new(&self.local(mentions, 0));
        let prior = f.sequence([Num(1.0); N]);
        let (parameter, expected) = (decl.name.clone().into(), prior.length(n));
        if n < expected && expected == 2 {
            return Err(ModelError::TooShort { parameter, len: n });
        }
        if n != expected {
            return Err(ModelError::Length { parameter, len: n, expected });
        }
        if mentions.is_empty() && !prior.ln_norm(n).0.is_finite() {
            return Err(ModelError::NoDensity { parameter, prior: decl.text.into() });
        }
        let (n_unknowns, n_carry) = (prior.n_unknowns(n), prior.n_carry(n).max(1));
        let support = prior.support();
        drop(prior);
        let (u, v) = (self.unknowns(n_unknowns), self.values(n));
        let mentions = local.places();
        let entry = PriorEntry { u: u..u + n_unknowns, v, len: n, mentions };
        self.model.prior_entries.push(entry);
        let work = self.n_work;
        self.n_work += (n + 1) * n_carry;
        self.push_parameter(&decl, n, Kind::Vector, vec![], support, v);
        self.names.push((decl.name.clone().into(), Source::Scalars { v, len: n }));
        let op = SequenceOp::<F, N, M> { local, u, v, work, n, n_carry, f };
        self.model.priors.push(Box::new(op));
        Ok(())
    }

    /// `column name [unit] ~ prior;`: every empty cell is an unknown. M is N + 1.
    ///
    /// # Errors
    /// No such column, a cell that is no number, a prior whose bounds are unknown.
    pub fn imputed<F: PriorFn<N>, const N: usize, const M: usize>(
        &mut self,
        decl: Decl,
        mentions: Names,
        f: F,
    ) -> Result<(), ModelError> {
        let local = Local::<N>::new(&self.local(mentions, 0));
        let support = support_of(&f);
        if support == Support::Between {
            return Err(ModelError::ImputedBounds { column: decl.name.into() });
        }
        let (mut cells, mut lines) = (vec![], vec![]);
        if let Some(data) = self.data {
            for row in 0..data.len() {
                let who = format!("column {}", decl.name);
                cells.push(data.number_or_empty(row, &decl.name, &who)?);
                lines.push(format!("line {}", data.line(row)));
            }
        }
        let v = self.values(cells.len());
        let is_missing = |i: &usize| cells[*i].is_nan();
        let missing: Vec<usize> = (0..cells.len()).filter(is_missing).collect();
        let seen: Vec<(usize, f64)> =
            (0..cells.len()).filter(|i| !is_missing(i)).map(|i| (i, cells[i])).collect();
        self.model.constants.extend(seen.iter().map(|(i, x)| (v + i, *x)));
        let u = self.unknowns(missing.len());
        let labels = missing.iter().map(|i| lines[*i].clone()).collect();
        self.push_parameter(&decl, missing.len(), Kind::Vector, labels, support, v);
        if let Some(parameter) = self.model.parameters.last_mut() {
            parameter.position = Position::Cells { v, rows: missing.clone() };
        }
        let n = missing.len();
        let entry = PriorEntry { u: u..u + n, v, len: cells.len(), mentions: local.places() };
        self.model.prior_entries.push(entry);
        self.names.push((decl.name.clone().into(), Source::Cells { v }));
        let op = ImputedOp::<F, N, M> { local, u, v, missing, seen, f };
        self.model.priors.push(Box::new(op));
        Ok(())
    }
}

/// Whether a prior is one of the whole vector.
fn is_whole<T: Vector<Num<f64>>>(_: &T) -> bool {
    T::IS_WHOLE
}
