//! A table of typed columns.

use std::path::Path;

use super::cells::Cells;
use super::column::TypedColumn;
use super::columns::{Columns, EXPORTED, PATH, PROTOCOL, Role, SITE, SOURCE};
use super::error::{DataError, edit_distance};

/// A table: one row per measurement, columns by name, each parsed once.
#[derive(Clone, Debug, Default)]
pub struct Table {
    file: String,
    /// Line of each row in the file, from 1.
    lines: Vec<u64>,
    columns: Vec<TypedColumn>,
    /// The columns' names, in order.
    header: Vec<String>,
    roles: Columns,
    /// Sentences on how the file was read.
    notes: Vec<String>,
}

impl Table {
    /// From the texts of the cells, (rows, columns); `lines` are where the rows stand in `file`.
    ///
    /// # Errors
    /// No rows.
    pub(super) fn new(
        file: String,
        header: Vec<String>,
        lines: Vec<u64>,
        cells: &Cells,
    ) -> Result<Self, DataError> {
        if cells.n_rows() == 0 {
            return Err(DataError::Empty { file });
        }
        let column = |(k, name): (usize, &String)| {
            TypedColumn::parse(name, (0..cells.n_rows()).map(|row| cells.get(row, k)))
        };
        let columns = header.iter().enumerate().map(column).collect();
        Ok(Self { file, lines, columns, header, ..Self::default() })
    }

    /// The same with sentences on how its file was read.
    pub(super) fn with_notes(self, notes: Vec<String>) -> Self {
        Self { notes, ..self }
    }

    /// Sentences for the user on how its file was read, where that was a choice.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.lines.len()
    }

    /// Whether there are no rows.
    pub fn is_empty(&self) -> bool {
        self.lines.is_empty()
    }

    /// File name, for messages.
    pub fn file(&self) -> &str {
        &self.file
    }

    /// File name without the folders above it, for what is passed on to others.
    pub fn file_name(&self) -> String {
        let path = Path::new(&self.file);
        path.file_name().unwrap_or(path.as_os_str()).display().to_string()
    }

    /// Line of a row in its file, from 1.
    pub fn line(&self, row: usize) -> u64 {
        self.lines[row]
    }

    /// The names of the columns, in order.
    pub fn columns(&self) -> &[String] {
        &self.header
    }

    /// A column by its name in the header; or else by its name in a model file, upper and lower case
    /// alike, where that is one column's alone and no other meaning goes with it.
    pub fn column(&self, name: &str) -> Option<&TypedColumn> {
        let own = self.columns.iter().find(|column| column.name() == name);
        own.or_else(|| {
            let is_named = |column: &&TypedColumn| column.read_as().eq_ignore_ascii_case(name);
            let mut all = self.columns.iter().filter(is_named);
            let (first, second) = (all.next()?, all.next());
            (second.is_none() && self.role(name) != Role::Structural).then_some(first)
        })
    }

    /// Whether the table has this column.
    pub fn has(&self, name: &str) -> bool {
        self.column(name).is_some()
    }

    /// A cell as text; `None` if there is no such column.
    pub fn cell(&self, row: usize, name: &str) -> Option<&str> {
        self.column(name).map(|column| column.text(row))
    }

    /// The texts of a row, in the order of the columns.
    pub fn cells(&self, row: usize) -> Vec<&str> {
        self.columns.iter().map(|column| column.text(row)).collect()
    }

    /// The distinct labels of a column in order of appearance, empty cells left out; none if there is no
    /// such column.
    pub fn distinct(&self, name: &str) -> Vec<String> {
        self.column(name).map(TypedColumn::labels).unwrap_or_default()
    }

    /// What a column means.
    pub fn role(&self, name: &str) -> Role {
        self.roles.role(name)
    }

    /// Says what the columns mean.
    ///
    /// # Errors
    /// A role for a column that the table lacks.
    pub fn set_roles(&mut self, roles: Columns) -> Result<(), DataError> {
        if let Some(name) = roles.given().find(|name| !self.header.iter().any(|h| h == name)) {
            let guess = match self.nearest(name) {
                Some(near) => format!("\nhelp: did you mean `{near}`?"),
                None => "\nhelp: name one of these columns".into(),
            };
            return Err(self.lacks(name, "--column", guess));
        }
        self.roles = roles;
        Ok(())
    }

    /// Puts numbers in the place of a column, NaN for an empty cell, or adds the column: how simulated
    /// measurements take the place of those that were made.
    pub fn set_numbers(&mut self, name: &str, values: &[f64]) {
        let column = TypedColumn::of_numbers(name, values);
        if let Some(own) = self.columns.iter_mut().find(|own| own.name() == name) {
            *own = column;
        } else {
            self.header.push(name.into());
            self.columns.push(column);
        }
    }

    /// Rows that an `observe` statement takes: those whose `protocol` is its name, upper and lower case
    /// alike, or all of them if there is no such column.
    pub fn rows_of(&self, observe: &str) -> Vec<usize> {
        let Some(protocol) = self.column(PROTOCOL) else { return (0..self.len()).collect() };
        (0..self.len()).filter(|&row| protocol.text(row).eq_ignore_ascii_case(observe)).collect()
    }

    /// Drops the rows of an [`EXPORTED`] quantity that none of `observes` reads, and gives its name and
    /// their number: a table of a mapping system's export holds voltages and times together, and a model
    /// reads what it is about.
    pub fn drop_unread(&mut self, observes: &[&str]) -> Vec<(String, usize)> {
        let Some(protocol) = self.column(PROTOCOL) else { return vec![] };
        let is = |a: &str, b: &&str| a.eq_ignore_ascii_case(b);
        let is_unread = |cell: &str| {
            EXPORTED.iter().any(|known| is(cell, known)) && !observes.iter().any(|o| is(cell, o))
        };
        let mut dropped: Vec<(String, usize)> = vec![];
        let mut kept = vec![];
        for row in 0..self.len() {
            let cell = protocol.text(row);
            if !is_unread(cell) {
                kept.push(row);
            } else if let Some(own) = dropped.iter_mut().find(|(name, _)| name == cell) {
                own.1 += 1;
            } else {
                dropped.push((cell.to_owned(), 1));
            }
        }
        if kept.is_empty() {
            return vec![]; // the table is about something else, which the caller says
        }
        if !dropped.is_empty() {
            self.lines = kept.iter().map(|row| self.lines[*row]).collect();
            for column in &mut self.columns {
                let cells = kept.iter().map(|row| column.text(*row));
                *column = TypedColumn::parse(column.name(), cells);
            }
        }
        dropped
    }

    /// Complains about the first row whose `protocol` is none of `observes`.
    ///
    /// # Errors
    /// That row.
    pub fn check_protocols(&self, observes: &[&str]) -> Result<(), DataError> {
        let Some(protocol) = self.column(PROTOCOL) else { return Ok(()) };
        let known = |cell: &str| observes.iter().any(|o| o.eq_ignore_ascii_case(cell));
        let Some(row) = (0..self.len()).find(|&row| !known(protocol.text(row))) else {
            return Ok(());
        };
        let problem = format!("`{}` is not observed by the model", protocol.text(row));
        let help = format!(
            "the model observes {}; drop these rows or add an `observe` statement",
            observes.join(", ")
        );
        Err(self.cell_error(row, PROTOCOL, problem, &help))
    }

    /// A row in words: its site, if there is such a column, else its line.
    pub fn place(&self, row: usize) -> String {
        match self.column(SITE) {
            Some(column) => format!("at site {}", column.text(row)),
            None => format!("in line {}", self.lines[row]),
        }
    }

    /// Complains unless there is such a column (`who` asks for it).
    ///
    /// # Errors
    /// No such column.
    pub fn require(&self, name: &str, who: &str) -> Result<&TypedColumn, DataError> {
        self.column(name).ok_or_else(|| self.no_column(name, who))
    }

    /// A cell as a number; NaN if it is empty.
    ///
    /// # Errors
    /// No such column (`who` asks for it), or not a number.
    pub fn number_or_empty(&self, row: usize, name: &str, who: &str) -> Result<f64, DataError> {
        let column = self.require(name, who)?;
        column.number(row).ok_or_else(|| {
            let problem = format!("expected a number, got `{}`", column.text(row));
            let help = "numbers are written 12.5 or 1.25e1; leave a missing value empty";
            self.cell_error(row, name, problem, help)
        })
    }

    /// A cell as a number that must be there.
    ///
    /// # Errors
    /// No such column, not a number, or empty.
    pub fn number(&self, row: usize, name: &str, who: &str) -> Result<f64, DataError> {
        let x = self.number_or_empty(row, name, who)?;
        if x.is_nan() {
            let problem = format!("expected a number, which {who} needs, got an empty cell");
            return Err(self.cell_error(row, name, problem, "fill in the value or drop the row"));
        }
        Ok(x)
    }

    /// A column as labels: the distinct ones in order of appearance, and each row's index among them.
    ///
    /// # Errors
    /// No such column, or an empty cell.
    pub fn labels(&self, name: &str, who: &str) -> Result<(Vec<String>, Vec<usize>), DataError> {
        let column = self.require(name, who)?;
        if let Some(row) = column.first_empty() {
            let problem = format!("expected a label, which {who} needs, got an empty cell");
            return Err(self.cell_error(row, name, problem, "fill in the label or drop the row"));
        }
        Ok((column.labels(), column.groups().collect()))
    }

    /// An error at a cell.
    pub fn cell_error(&self, row: usize, column: &str, problem: String, help: &str) -> DataError {
        DataError::Cell {
            file: self.file.clone(),
            line: self.lines[row],
            column: column.into(),
            problem,
            help: help.into(),
        }
    }

    /// The error of a column that is not there, with its nearest neighbour.
    pub(super) fn no_column(&self, column: &str, who: &str) -> DataError {
        let guess = match self.nearest(column) {
            Some(near) => format!("\nhelp: rename `{near}` to `{column}`?"),
            None if column == PATH => format!(
                "\nhelp: name the surface with --mesh: on it paths are measured from the vertex in the column `{SOURCE}`; or add the column"
            ),
            None => format!("\nhelp: add a column `{column}` to the header and to every row"),
        };
        self.lacks(column, who, guess)
    }

    /// The column whose name differs in at most two letters.
    fn nearest(&self, name: &str) -> Option<&String> {
        let near = self.header.iter().map(|h| (edit_distance(h, name), h)).min()?;
        (near.0 <= 2).then_some(near.1)
    }

    fn lacks(&self, column: &str, who: &str, guess: String) -> DataError {
        DataError::NoColumn {
            file: self.file.clone(),
            column: column.into(),
            who: who.into(),
            available: self.header.join(", "),
            guess,
        }
    }

    /// This table, then the rows of another: columns that it lacks are empty there. Where a column of
    /// `lent` is empty or missing in the other, the first row here of the same protocol lends its cell.
    pub(super) fn followed_by(&self, other: &Self, lent: &[&str]) -> Self {
        let lender = |row: usize| {
            let protocol = other.cell(row, PROTOCOL);
            (0..self.len()).find(|r| self.cell(*r, PROTOCOL) == protocol).unwrap_or(0)
        };
        let lenders: Vec<usize> = (0..other.len()).map(lender).collect();
        let column = |column: &TypedColumn| {
            let name = column.name();
            let appended = lenders.iter().enumerate().map(|(row, lender)| {
                let own = other.cell(row, name).unwrap_or_default();
                let is_lent =
                    own.is_empty() && lent.contains(&column.read_as()) && !other.is_open(row, name);
                if is_lent { column.text(*lender) } else { own }
            });
            let own = (0..self.len()).map(|row| column.text(row));
            TypedColumn::parse(name, own.chain(appended))
        };
        Self {
            lines: [&self.lines[..], &other.lines].concat(),
            columns: self.columns.iter().map(column).collect(),
            ..self.clone()
        }
    }

    /// Whether an empty cell is the open end of a bracket: the other end is there.
    fn is_open(&self, row: usize, name: &str) -> bool {
        let is_there = |end: &str| self.cell(row, end).is_some_and(|cell| !cell.is_empty());
        ["lower", "upper"].contains(&name) && (is_there("lower") || is_there("upper"))
    }
}
