//! `observe` and `density` statements: reads the rows, and finds where in the value vector each row's
//! scalars live.

use std::marker::PhantomData;

use super::{Builder, Source};
use crate::likelihood::Observation;
use crate::model::density::{Density, DensityAt, DensityFn};
use crate::model::equations::tidy;
use crate::model::error::ModelError;
use crate::model::linear::Linear;
use crate::model::model::Observe;
use crate::model::rows::{Columns, Place, RowFn, Rows};
use crate::model::scope::Scope;
use crate::model::units::Decl;
use crate::model::uses::reads;
use crate::table::Measurements;

/// A likelihood with outliers, as it is written.
pub fn outlying(likelihood: &str, share: f64, sd: f64) -> String {
    format!("Outliers({}, {share:?}, {sd:?})", likelihood.trim())
}

impl Builder<'_> {
    /// `observe name(row): Y [unit] ~ likelihood;`
    ///
    /// # Errors
    /// No row of it, a missing column, a cell that does not fit.
    pub fn observe<F: RowFn + 'static, const N: usize, const W: usize>(
        &mut self,
        _: F,
        decl: Decl,
        scope: &Scope,
    ) -> Result<(), ModelError> {
        self.state("observe", self.with_outliers(decl), None);
        let read = match (self.data, F::FROM) {
            (Some(data), Some(text)) => compute_rows::<F>(data, decl, text)?,
            (Some(data), None) => read_rows::<F::Y>(data, decl.name)?,
            (None, _) => Read { rows: vec![], y: vec![], cells: vec![] },
        };
        let Read { rows, y, cells } = read;
        let who = format!("observe {}", decl.name);
        let mut columns = vec![];
        for &row in &rows {
            let Some(data) = self.data else { break };
            columns.push(F::Columns::read(&mut |name| data.number(row, name, &who))?);
        }
        let place = self.place(decl.name, &rows, scope, W)?;
        self.model.observes.push(Observe {
            name: decl.name,
            unit: decl.unit.into(),
            columns: F::Y::COLUMNS,
            cells,
            rows,
            op: Box::new(Rows::<F, N, W> {
                columns,
                y,
                place,
                outliers: self.outliers.map(|(share, sd)| (share, sd * sd)),
            }),
        });
        Ok(())
    }

    /// An `observe` as it reads with the outliers that are added.
    fn with_outliers(&self, decl: Decl) -> Decl {
        let Some((share, sd)) = self.outliers else { return decl };
        let Some((what, likelihood)) = decl.text.split_once('~') else { return decl };
        let text = format!("{what}~ {}", outlying(likelihood, share, sd));
        // as long as the program, as the words of a model file
        Decl { text: Box::leak(text.into_boxed_str()), ..decl }
    }

    /// `density name = expr;`, or `density name(data) = expr;` with the table's columns under that name.
    ///
    /// # Errors
    /// No row of it, a missing column, a cell that does not fit.
    pub fn density<F: DensityFn + 'static, const N: usize, const W: usize>(
        &mut self,
        _: F,
        decl: Decl,
        scope: &Scope,
        data: Option<&'static str>,
    ) -> Result<(), ModelError> {
        self.state("density", decl, None);
        let local = self.local::<N, W>(scope);
        let (rows, cells) = match (self.data, data) {
            (Some(table), Some(data)) => read_columns::<F::Columns>(table, decl, data)?,
            _ => (vec![], vec![]),
        };
        let op = DensityAt::<F, N, W> { local, cells, n_rows: rows.len(), f: PhantomData };
        self.model.densities.push(Density::new(decl.name, data.is_some(), rows, op));
        Ok(())
    }

    /// For each row, where in `v` each scalar that the likelihood mentions lives.
    fn place(
        &mut self,
        observe: &'static str,
        rows: &[usize],
        scope: &Scope,
        w: usize,
    ) -> Result<Place, ModelError> {
        let n = rows.len();
        let mut place = Place { index: vec![0; n * w], hook: vec![], lets: vec![None; scope.lets] };
        let (mut used, mut hooked) = (0, vec![]);
        for (i, &name) in scope.names.iter().enumerate() {
            if !scope.mentions(i) {
                continue;
            }
            if i >= scope.first_let() {
                self.seen.insert((name, observe));
                if self.acts(name) {
                    place.lets[i - scope.first_let()] = Some(self.hook(observe, name, n));
                }
                continue;
            }
            let source = self.source(name).clone();
            let predictor = self.predictor(name, &source, rows)?;
            if matches!(source, Source::Linear { .. }) {
                self.predictors.insert((observe, name), predictor);
                self.seen.insert((name, observe));
            }
            for e in 0..scope.lens[i] {
                let j = used;
                used += 1;
                if matches!(source, Source::Field(_) | Source::Linear { .. }) && self.acts(name) {
                    hooked.push((j, self.hook(observe, name, n)));
                }
                for (r, &row) in rows.iter().enumerate() {
                    place.index[r * w + j] = match &source {
                        Source::Scalars(v) => v + e,
                        Source::Each { v, index } => v + index[row],
                        Source::Field(field) => self.probe(*field, row),
                        Source::Linear { .. } => predictor + r,
                        Source::Let => unreachable!("lets come last in a scope"),
                    } as u32;
                }
            }
        }
        if !hooked.is_empty() {
            // an offset on a field's value needs no derivative of its own: it is the field's
            place.hook = vec![0; n * w];
        }
        for (j, at) in hooked {
            for r in 0..n {
                place.hook[r * w + j] = (at + r) as u32;
            }
        }
        Ok(place)
    }

    /// The value of field number `field` at the probe of `row`.
    pub(super) fn probe(&self, field: usize, row: usize) -> usize {
        let vertex = self.data.and_then(|d| d.vertex(row)).unwrap_or(0);
        let probe = self.probes.binary_search(&vertex).unwrap_or(0);
        self.model.fields[field].op.theta + probe
    }

    /// Lays out a linear predictor's values for these rows; 0 for any other source.
    fn predictor(
        &mut self,
        name: &str,
        source: &Source,
        rows: &[usize],
    ) -> Result<usize, ModelError> {
        let Source::Linear { beta, columns } = source else { return Ok(0) };
        let wrong = |expected, got| ModelError::Coefficients {
            name: name.into(),
            beta: (*beta).into(),
            expected,
            got,
        };
        let declared = self.names.iter().rev().find(|(n, _)| n == beta);
        let Some((_, Source::Scalars(v))) = declared else { return Err(wrong(columns.len(), 0)) };
        let v = *v;
        let n_beta = self.model.parameters.iter().find(|p| p.name == *beta).map_or(0, |p| p.len);
        let out = self.values(rows.len());
        let alone = if columns.len() == 1 { n_beta } else { 1 };
        let names: Vec<String> = columns.iter().flat_map(|c| self.numbered(c, alone)).collect();
        let linear = self.design(rows, &names, v, vec![out], false)?;
        if linear.n != n_beta {
            return Err(wrong(linear.n, n_beta));
        }
        self.model.linear.push(linear);
        Ok(out)
    }

    /// A column, or all the numbered columns x1, x2, … of the table; the `expected` ones of these if it
    /// has neither.
    fn numbered(&self, name: &str, expected: usize) -> Vec<String> {
        let numbers = |n: usize| (1..=n).map(|i| format!("{name}{i}"));
        match self.data {
            Some(data) if data.has(name) => vec![name.into()],
            Some(data) if data.has(&format!("{name}1")) => {
                numbers(data.columns().len()).take_while(|n| data.has(n)).collect()
            }
            _ if expected > 1 => numbers(expected).collect(),
            _ => vec![name.into()],
        }
    }

    /// Design of the columns `names` at these rows.
    pub(super) fn design(
        &self,
        rows: &[usize],
        names: &[String],
        beta: usize,
        out: Vec<usize>,
        add: bool,
    ) -> Result<Linear, ModelError> {
        let Some(data) = self.data else {
            return Ok(Linear { beta, n: names.len(), z: vec![], out, rows: 0, add });
        };
        let mut z = Vec::with_capacity(rows.len() * names.len());
        for &row in rows {
            for name in names {
                z.push(data.number(row, name, "a linear predictor")?);
            }
        }
        Ok(Linear { beta, n: names.len(), z, out, rows: rows.len(), add })
    }

    pub(super) fn acts(&self, name: &str) -> bool {
        self.effects.iter().any(|e| e.on.iter().any(|on| on == name))
            || self.offsets_on.iter().any(|on| on == name)
    }

    fn hook(&mut self, observe: &'static str, name: &'static str, n: usize) -> usize {
        let at = self.values(n);
        self.model.offsets.push(at..at + n);
        self.hooks.insert((observe, name), at);
        at
    }
}

/// The rows of an `observe` statement that hold a measurement.
struct Read<Y> {
    rows: Vec<usize>,
    y: Vec<Y>,
    /// Columns of the table that measurements are read or computed from.
    cells: Vec<String>,
}

fn read_rows<Y: Observation>(data: &Measurements, observe: &str) -> Result<Read<Y>, ModelError> {
    let (names, cells) = read_cells(data, observe, Y::COLUMNS)?;
    let (mut rows, mut y) = (vec![], vec![]);
    for (row, cells) in cells {
        let wrong =
            |problem| data.cell_error(row, &names.join(", "), problem, "mend the row or drop it");
        if let Some(measurement) = Y::read(&cells).map_err(wrong)? {
            rows.push(row);
            y.push(measurement);
        }
    }
    if rows.is_empty() {
        return Err(no_rows(data, "observe", observe));
    }
    Ok(Read { rows, y, cells: names })
}

/// As [`read_rows`], each measurement computed by `from (text)`; a row in which one of the columns that it
/// reads is empty holds none.
fn compute_rows<F: RowFn>(
    data: &Measurements,
    decl: Decl,
    text: &str,
) -> Result<Read<F::Y>, ModelError> {
    let who = format!("observe {}", decl.name);
    let columns = F::Columns::names().into_iter();
    let own = columns.filter(|(column, _)| reads(text, decl.over, column));
    let cells: Vec<String> = own.flat_map(|(_, names)| names).collect();
    let (mut rows, mut y) = (vec![], vec![]);
    for row in data.rows_of(decl.name) {
        let mut is_measured = true;
        for name in &cells {
            is_measured &= !data.number_or_empty(row, name, &who)?.is_nan();
        }
        if !is_measured {
            continue;
        }
        let row_columns = F::Columns::read(&mut |name| data.number(row, name, &who))?;
        let Some(measurement) = F::measured(&row_columns) else { continue };
        if let Some(cell) = measurement.cells().into_iter().find(|cell| !cell.is_finite()) {
            let problem = format!("expected a finite number, got {} = {cell}", tidy(text));
            let error = data.cell_error(row, &cells.join(", "), problem, "mend the row or drop it");
            return Err(error.into());
        }
        rows.push(row);
        y.push(measurement);
    }
    if rows.is_empty() {
        return Err(no_rows(data, "observe", decl.name));
    }
    Ok(Read { rows, y, cells })
}

/// A row of the table, and its cells.
type RowCells = (usize, Vec<f64>);

/// The names of the `columns` of an `observe` statement, and their cells in each of its rows.
fn read_cells(
    data: &Measurements,
    observe: &str,
    columns: &[&'static str],
) -> Result<(Vec<String>, Vec<RowCells>), ModelError> {
    let who = format!("observe {observe}");
    // a single value may stand in a column of the statement's own name
    let names = match columns {
        ["value"] if data.has(observe) => &[observe],
        names => names,
    };
    let mut cells = vec![];
    for row in data.rows_of(observe) {
        let of_row = names.iter().map(|name| data.number_or_empty(row, name, &who));
        cells.push((row, of_row.collect::<Result<_, _>>()?));
    }
    Ok((names.iter().map(ToString::to_string).collect(), cells))
}

/// The rows of a `density` statement, and their cells of each column that `text` reads through the name
/// `data`; nothing of the others.
fn read_columns<C: Columns>(
    table: &Measurements,
    decl: Decl,
    data: &str,
) -> Result<(Vec<usize>, Vec<Vec<f64>>), ModelError> {
    let who = format!("density {}", decl.name);
    let rows = table.rows_of(decl.name);
    if rows.is_empty() {
        return Err(no_rows(table, "density", decl.name));
    }
    let mut cells = vec![];
    for (column, names) in C::names() {
        let mut of_column = vec![];
        for &row in rows.iter().filter(|_| reads(decl.text, data, column)) {
            for name in &names {
                of_column.push(table.number(row, name, &who)?);
            }
        }
        cells.push(of_column);
    }
    Ok((rows, cells))
}

fn no_rows(data: &Measurements, keyword: &'static str, name: &str) -> ModelError {
    ModelError::NoRows { keyword, name: name.into(), file: data.file().into() }
}
