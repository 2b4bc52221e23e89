//! Right-hand sides of `effect` statements: designs from the columns of a table.

use crate::field::{Kernel as _, Matern32};
use crate::table::{Measurements, Probes};

/// How an effect depends on a row: the right-hand side of an `effect` statement.
#[derive(Clone, Debug, PartialEq)]
pub enum Form {
    /// `scaled(row.c, centre, scale)`: (c − centre)/scale, 0 where the cell is empty.
    Scaled {
        /// Column.
        column: String,
        /// Subtracted.
        centre: f64,
        /// Divided by.
        scale: f64,
    },
    /// `smooth(row.c, low, high, n)`: Legendre polynomials of degree k = 1 to n, each over k, on `[low, high]`.
    Smooth {
        /// Column.
        column: String,
        /// Where the polynomials' argument is −1.
        low: f64,
        /// Where it is 1.
        high: f64,
        /// Highest degree.
        degree: usize,
    },
    /// `group(row.c)`: one coefficient per label.
    Group {
        /// Column.
        column: String,
    },
    /// `family(row.c)`: one coefficient per label without its trailing digits (PV1, PV2, … are PV).
    Family {
        /// Column.
        column: String,
    },
    /// `above(row.c, threshold)`: 1 beyond the threshold.
    Above {
        /// Column.
        column: String,
        /// Threshold.
        threshold: f64,
    },
    /// `logistic(row.c, centre, scale)`: from 0 to 1 around the centre, 1/(1 + exp(−(c − centre)/scale)).
    Logistic {
        /// Column.
        column: String,
        /// Where it is ½.
        centre: f64,
        /// Greater than 0; it is 0.12 and 0.88 two scales from the centre.
        scale: f64,
    },
    /// `all(row)`: every row.
    All,
    /// `surface(row, n, lengthscale)`: a field at the row's place, Matérn-3/2 of that lengthscale in mm, in the
    /// surface's first n modes.
    Surface {
        /// Number of modes.
        modes: usize,
        /// mm
        lengthscale: f64,
    },
    /// `path(row, n, lengthscale)`: the same field's integral along the geodesic path from the vertex in column
    /// `source`.
    Path {
        /// Number of modes.
        modes: usize,
        /// mm
        lengthscale: f64,
    },
}

impl Form {
    /// The form `name(row.COLUMN, …, NUMBER, …)`; the language has checked that there is one with these arguments.
    pub fn new(name: &str, columns: &[&str], numbers: &[f64]) -> Self {
        let column = columns.first().map_or(String::new(), ToString::to_string);
        let number = |i: usize| numbers.get(i).copied().unwrap_or(f64::NAN);
        let (modes, lengthscale) = (number(0) as usize, number(1));
        match name {
            "scaled" => Self::Scaled { column, centre: number(0), scale: number(1) },
            "smooth" => {
                let (low, high, degree) = (number(0), number(1), number(2) as usize);
                Self::Smooth { column, low, high, degree }
            }
            "group" => Self::Group { column },
            "family" => Self::Family { column },
            "above" => Self::Above { column, threshold: number(0) },
            "logistic" => Self::Logistic { column, centre: number(0), scale: number(1) },
            "surface" => Self::Surface { modes, lengthscale },
            "path" => Self::Path { modes, lengthscale },
            _ => Self::All,
        }
    }

    /// The column that it reads.
    pub fn column(&self) -> Option<&str> {
        match self {
            Self::Scaled { column, .. }
            | Self::Smooth { column, .. }
            | Self::Group { column }
            | Self::Family { column }
            | Self::Above { column, .. }
            | Self::Logistic { column, .. } => Some(column),
            Self::All | Self::Surface { .. } | Self::Path { .. } => None,
        }
    }

    /// The number of modes of the surface that it needs.
    pub fn n_modes(&self) -> usize {
        match self {
            Self::Surface { modes, .. } | Self::Path { modes, .. } => *modes,
            _ => 0,
        }
    }

    /// As it is written in a model file, with `row` for the row.
    pub fn text(&self) -> String {
        match self {
            Self::Scaled { column, centre, scale } => {
                format!("scaled(row.{column}, {centre:?}, {scale:?})")
            }
            Self::Smooth { column, low, high, degree } => {
                format!("smooth(row.{column}, {low:?}, {high:?}, {degree})")
            }
            Self::Group { column } => format!("group(row.{column})"),
            Self::Family { column } => format!("family(row.{column})"),
            Self::Above { column, threshold } => format!("above(row.{column}, {threshold:?})"),
            Self::Logistic { column, centre, scale } => {
                format!("logistic(row.{column}, {centre:?}, {scale:?})")
            }
            Self::All => "all(row)".into(),
            Self::Surface { modes, lengthscale } => {
                format!("surface(row, {modes}, {lengthscale:?})")
            }
            Self::Path { modes, lengthscale } => format!("path(row, {modes}, {lengthscale:?})"),
        }
    }

    /// The labels behind its coefficients, if these belong to labels.
    pub fn labels(&self, table: &Measurements) -> Vec<String> {
        match self {
            Self::Group { column } => table.distinct(column),
            Self::Family { column } => families(table, column),
            _ => vec![],
        }
    }

    /// The design, row-major (rows of the table, n), and n. Labels of `Group` are in order of appearance
    /// in the table; an empty cell contributes nothing.
    pub fn design(&self, table: &Measurements) -> (Vec<f64>, usize) {
        let number = |row: usize, column: &str| -> Option<f64> {
            table.column(column)?.number(row).filter(|x| x.is_finite())
        };
        let rows = 0..table.len();
        match self {
            Self::All => (vec![1.0; table.len()], 1),
            Self::Surface { modes, lengthscale } | Self::Path { modes, lengthscale } => {
                let along = matches!(self, Self::Path { .. });
                let design = table.probes().map(|p| of_modes(p, *modes, *lengthscale, along));
                (design.unwrap_or_default(), *modes)
            }
            Self::Scaled { column, centre, scale } => {
                let z = |row| number(row, column).map_or(0.0, |x| (x - centre) / scale);
                (rows.map(z).collect(), 1)
            }
            Self::Above { column, threshold } => {
                let z =
                    |row| number(row, column).map_or(0.0, |x| f64::from(u8::from(x > *threshold)));
                (rows.map(z).collect(), 1)
            }
            Self::Logistic { column, centre, scale } => {
                let z = |x: f64| 1.0 / (1.0 + (-(x - centre) / scale).exp());
                (rows.map(|row| number(row, column).map_or(0.0, z)).collect(), 1)
            }
            Self::Smooth { column, low, high, degree } => {
                let z = |row| match number(row, column) {
                    Some(x) => legendre((2.0 * x - low - high) / (high - low), *degree),
                    None => vec![0.0; *degree],
                };
                (rows.flat_map(z).collect(), *degree)
            }
            Self::Group { column } => one_each(table, &table.distinct(column), |row| {
                table.cell(row, column).unwrap_or_default()
            }),
            Self::Family { column } => one_each(table, &families(table, column), |row| {
                family(table.cell(row, column).unwrap_or_default())
            }),
        }
    }
}

/// Design of a field of unit amplitude (Matérn-3/2, lengthscale in mm), row-major (rows, `n`): its value at
/// each row or, `along` the paths, its integral.
fn of_modes(probes: &Probes, n: usize, lengthscale: f64, along: bool) -> Vec<f64> {
    let kernel = Matern32(lengthscale);
    let root: Vec<f64> =
        probes.frequencies().iter().take(n).map(|w| kernel.sqrt_density(*w)).collect();
    let rows = probes.modes(along).chunks_exact(probes.n_modes().max(1));
    rows.flat_map(|row| row.iter().zip(&root).map(|(phi, root)| phi * root)).collect()
}

/// A column for each label.
fn one_each<'t>(
    table: &Measurements,
    labels: &[String],
    label: impl Fn(usize) -> &'t str,
) -> (Vec<f64>, usize) {
    let mut z = vec![0.0; table.len() * labels.len()];
    for row in 0..table.len() {
        if let Some(own) = labels.iter().position(|l| l == label(row)) {
            z[row * labels.len() + own] = 1.0;
        }
    }
    (z, labels.len())
}

/// A label without its trailing digits.
fn family(label: &str) -> &str {
    label.trim_end_matches(|c: char| c.is_ascii_digit())
}

/// Labels of a column without their trailing digits, in order of appearance.
pub fn families(table: &Measurements, column: &str) -> Vec<String> {
    let mut all: Vec<String> = vec![];
    for label in table.distinct(column) {
        if !all.iter().any(|f| f == family(&label)) {
            all.push(family(&label).into());
        }
    }
    all
}

/// Legendre polynomials of degree 1 to n, each over its degree.
fn legendre(x: f64, n: usize) -> Vec<f64> {
    let mut p = vec![1.0, x];
    for k in 2..=n {
        let k1 = k as f64;
        p.push(((2.0 * k1 - 1.0) * x * p[k - 1] - (k1 - 1.0) * p[k - 2]) / k1);
    }
    // higher degrees are worth less: what is smooth is simple
    (1..=n).map(|k| p[k] / k as f64).collect()
}
