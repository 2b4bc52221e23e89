//! `observe` and `density` statements. Reads the rows, and finds where in the value vector the
//! scalars of each row live.

use std::borrow::Cow;

use super::{Builder, Computed, Linear as Declared, Place, Source};
use crate::model::density::Density;
use crate::model::error::ModelError;
use crate::model::expression::{AnyDensity, AnyPredictor, AnyRows};
use crate::model::functions::Decl;
use crate::model::laid_out::Observe;
use crate::model::linear::Linear;
use crate::model::predictor::Predictor;
use crate::model::row_math::RowMath;
use crate::model::row_place;
use crate::model::rows::Rows;
use crate::table::Measurements;

impl Builder<'_> {
    /// `observe name(row): Y [unit] from (…) ~ likelihood;`
    ///
    /// # Errors
    /// No row of it, a missing column, a cell that does not fit.
    pub fn observe(
        &mut self,
        decl: Decl,
        name: &'static str,
        mentions: Place,
        from: Option<Computed>,
        AnyRows(mut math, width): AnyRows,
    ) -> Result<(), ModelError> {
        let unit = decl.unit.into();
        let Read { rows, cells } = match (self.data, from) {
            (Some(data), Some(from)) => compute_rows(&mut *math, data, name, from)?,
            (Some(data), None) => read_rows(&mut *math, data, name)?,
            (None, _) => Read { rows: vec![], cells: vec![] },
        };
        let place = self.place(name, &rows, mentions, width)?;
        let outliers = self.outliers.map(|(share, sd)| (share, sd * sd));
        self.declare_row_errors();
        let error = self.row_errors.iter().find(|(observe, ..)| observe == name).cloned();
        let error = error.map(|(_, sd, scatter)| row_place::Error {
            sd,
            scatter: scatter.map(|scatter| self.hook(name, scatter, rows.len())),
        });
        let place = row_place::Place { error, ..place };
        let (columns, op) = (math.cells(), Rows { place, outliers, math });
        self.model.observes.push(Observe { name, unit, columns, cells, rows, op });
        Ok(())
    }

    /// `density name = expr;`, or `density name(data) = expr;` with the columns that it `reads` of the table.
    ///
    /// # Errors
    /// No row of it, a missing column, a cell that does not fit.
    pub fn density(
        &mut self,
        name: &'static str,
        reads: Option<&[&str]>,
        of: &AnyDensity,
    ) -> Result<(), ModelError> {
        let mut op = (of.at)(&self.local(of.mentions, 0));
        let mut rows = vec![];
        if let (Some(table), Some(columns)) = (self.data, reads) {
            let cells;
            (rows, cells) = read_columns(&op.columns(), table, name, columns)?;
            op.read(cells, rows.len());
        }
        self.model.densities.push(Density::new(name, reads.is_some(), rows, op));
        Ok(())
    }

    /// For each row, the places in `v` of the numbers that the likelihood mentions.
    fn place(
        &mut self,
        observe: &'static str,
        rows: &[usize],
        mentions: Place,
        w: usize,
    ) -> Result<row_place::Place, ModelError> {
        let n = rows.len();
        let (mut index, mut hooked, mut j) = (vec![0; n * w], vec![], 0);
        for &name in mentions.numbers {
            let source = self.source(name).clone();
            let predictor = self.predicted(name, &source, rows)?;
            if matches!(source, Source::Linear(_)) {
                self.predictors.insert((observe, name), predictor);
                self.seen.insert((name, observe));
            }
            for e in 0..if let Source::Scalars { len, .. } = source { len } else { 1 } {
                if matches!(source, Source::Field { .. } | Source::Linear(_)) && self.acts(name) {
                    hooked.push((j, self.hook(observe, name, n)));
                }
                for (r, &row) in rows.iter().enumerate() {
                    index[r * w + j] = match &source {
                        Source::Linear(_) => predictor + r,
                        source => self.value_at(source, row) + e,
                    } as u32;
                }
                j += 1;
            }
        }
        let mut lets = vec![];
        for &name in mentions.lets {
            self.seen.insert((name, observe));
            lets.push(self.acts(name).then(|| self.hook(observe, name, n)));
        }
        // an offset on a field's value needs no derivative of its own: it is the field's
        let mut hook = vec![0; if hooked.is_empty() { 0 } else { n * w }];
        for (j, at) in hooked {
            (0..n).for_each(|r| hook[r * w + j] = (at + r) as u32);
        }
        Ok(row_place::Place { width: w, index, hook, lets, error: None, left_out: None })
    }

    /// The place of the value of a name that a row of the table sees; if there are several values,
    /// of the first.
    pub(super) fn value_at(&self, source: &Source, row: usize) -> usize {
        match source {
            Source::Scalars { v, .. } => *v,
            Source::Each { v, labels } => v + labels.of_row[row],
            Source::Cells { v } => v + row,
            Source::Field { field, labels } => {
                self.probe(field + labels.as_ref().map_or(0, |labels| labels.of_row[row]), row)
            }
            Source::Linear(_) | Source::Let => 0,
        }
    }

    /// The value of field number `field` at the probe of `row`.
    pub(super) fn probe(&self, field: usize, row: usize) -> usize {
        let vertex = self.data.and_then(|d| d.vertex(row)).unwrap_or(0);
        let field = &self.model.fields[field];
        field.op.theta + field.probes.binary_search(&vertex).unwrap_or(0)
    }

    /// Lays out a linear predictor's values for these rows; 0 for any other source.
    fn predicted(
        &mut self,
        name: &str,
        source: &Source,
        rows: &[usize],
    ) -> Result<usize, ModelError> {
        let (beta, columns) = match source {
            Source::Linear(Declared::Columns { beta, columns }) => (beta, columns),
            Source::Linear(Declared::Written { numbers, factors }) => {
                return self.written(name, numbers, &factors.clone(), rows);
            }
            Source::Linear(Declared::Operator(number)) => {
                return self.operator_at(name, *number, rows);
            }
            _ => return Ok(0),
        };
        let wrong = |expected, got| ModelError::Coefficients {
            name: name.into(),
            beta: (*beta).into(),
            expected,
            got,
        };
        let declared = self.names.iter().rev().find(|(n, _)| n == beta);
        let Some((_, Source::Scalars { v, len: n_beta })) = declared else {
            return Err(wrong(columns.len(), 0));
        };
        let (v, n_beta) = (*v, *n_beta);
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

    /// Lays out the values of a linear predictor that is written out.
    fn written(
        &mut self,
        name: &str,
        numbers: &[&str],
        AnyPredictor(factors): &AnyPredictor,
        rows: &[usize],
    ) -> Result<usize, ModelError> {
        let Some(data) = self.data else { return Ok(0) };
        let from = self.local(numbers, 0);
        let of_row = |row: &usize| {
            factors(&mut |column| Ok(data.number(*row, column, &format!("let {name}"))?))
        };
        let of_rows = rows.iter().map(of_row).collect::<Result<Vec<_>, _>>()?;
        self.values(from.len());
        let out = self.values(rows.len());
        self.model.predictors.push(Predictor::new(from, &of_rows, out));
        Ok(out)
    }

    /// The column `x`, or all the numbered columns x1, x2, … of the table. If it has neither, the
    /// `expected` ones of these.
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

    fn hook(
        &mut self,
        observe: &'static str,
        name: impl Into<Cow<'static, str>>,
        n: usize,
    ) -> usize {
        let at = self.values(n);
        self.model.offsets.push(at..at + n);
        self.hooks.insert((observe, name.into()), at);
        at
    }
}

/// The rows of an `observe` statement that hold a measurement.
struct Read {
    rows: Vec<usize>,
    /// Columns of the table that measurements are read or computed from.
    cells: Vec<String>,
}

/// Gives the likelihood the measurements and the columns of these rows.
fn read_rows(
    math: &mut dyn RowMath,
    data: &Measurements,
    observe: &str,
) -> Result<Read, ModelError> {
    let (names, cells) = read_cells(data, observe, math.cells())?;
    let mut rows = vec![];
    for (row, cells) in cells {
        let wrong =
            |problem| data.cell_error(row, &names.join(", "), problem, "mend the row or drop it");
        if math.take(&cells).map_err(wrong)? {
            rows.push(row);
        }
    }
    if rows.is_empty() {
        return Err(no_rows(data, "observe", observe));
    }
    let who = format!("observe {observe}");
    for &row in &rows {
        math.read(&mut |column| Ok(data.number(row, column, &who)?))?;
    }
    Ok(Read { rows, cells: names })
}

/// As [`read_rows`], but each measurement is computed by `from (text)`. A row holds no measurement
/// if one of the columns that this reads is empty.
fn compute_rows(
    math: &mut dyn RowMath,
    data: &Measurements,
    observe: &str,
    from: Computed,
) -> Result<Read, ModelError> {
    let who = format!("observe {observe}");
    let columns = math.columns().into_iter();
    let own = columns.filter(|(column, _)| from.columns.contains(column));
    let cells: Vec<String> = own.flat_map(|(_, names)| names).collect();
    let mut rows = vec![];
    for row in data.rows_of(observe) {
        let mut is_measured = true;
        for name in &cells {
            is_measured &= !data.number_or_empty(row, name, &who)?.is_nan();
        }
        if !is_measured {
            continue;
        }
        math.read(&mut |name| Ok(data.number(row, name, &who)?))?;
        let measured = math.compute().into_iter().flatten();
        if let Some(cell) = measured.into_iter().find(|cell| !cell.is_finite()) {
            let problem = format!("expected a finite number, got {} = {cell}", from.text);
            let error = data.cell_error(row, &cells.join(", "), problem, "mend the row or drop it");
            return Err(error.into());
        }
        rows.push(row);
    }
    if rows.is_empty() {
        return Err(no_rows(data, "observe", observe));
    }
    Ok(Read { rows, cells })
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

/// The rows of a `density` statement, and their cells of each column that it `reads`. The other
/// columns have no cells.
fn read_columns(
    all: &[(&'static str, Vec<String>)],
    table: &Measurements,
    density: &str,
    reads: &[&str],
) -> Result<(Vec<usize>, Vec<Vec<f64>>), ModelError> {
    let who = format!("density {density}");
    let rows = table.rows_of(density);
    if rows.is_empty() {
        return Err(no_rows(table, "density", density));
    }
    let mut cells = vec![];
    for (column, names) in all {
        let mut of_column = vec![];
        for &row in rows.iter().filter(|_| reads.contains(column)) {
            for name in names {
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
