//! `draws.csv`: one line per draw, one column per scalar parameter, every digit.

use std::borrow::Cow;
use std::io;
use std::path::Path;

use super::{Group, ReportError, Values, Variable};
use crate::store::write_file;

/// Writes the `posterior` group as a table with the columns `chain`, `draw` and one per scalar.
///
/// Elements of arrays are named `name[i]` or `name[i,j]`, by label where the dimension has text labels.  Floats are
/// the shortest decimals that read back to the same bits; NaN is `NaN`.
///
/// # Errors
/// [`ReportError::NotDraws`] if a variable does not begin with the same dimensions `chain` and `draw`;
/// [`ReportError::Write`].
pub fn write_draws(path: &Path, posterior: &Group) -> Result<(), ReportError> {
    let variables: Vec<&Variable> =
        posterior.variables.iter().filter(|variable| !variable.is_coordinate()).collect();
    let (n_chains, n_draws) = n_chains_and_draws(&variables)?;
    write_file(path, |file| {
        let mut table = csv::Writer::from_writer(file);
        let header = ["chain", "draw"].map(str::to_owned).into_iter();
        table.write_record(header.chain(variables.iter().flat_map(|v| columns(posterior, v))))?;
        let mut readers: Vec<Reader<'_>> = variables.iter().map(|v| Reader::new(v)).collect();
        for row in 0..n_chains * n_draws {
            let mut line = [row / n_draws, row % n_draws].map(|index| index.to_string()).to_vec();
            readers.iter_mut().try_for_each(|reader| reader.cells(row, &mut line))?;
            table.write_record(line)?;
        }
        table.flush()
    })
    .map_err(ReportError::write(path))
}

fn n_chains_and_draws(variables: &[&Variable]) -> Result<(usize, usize), ReportError> {
    let mut lengths = None;
    for variable in variables {
        let got = match variable.dims.as_slice() {
            [(chain, n), (draw, m), ..] if chain == "chain" && draw == "draw" => Some((*n, *m)),
            _ => None,
        };
        let n_values: usize = variable.dims.iter().map(|(_, length)| length).product();
        let agrees = got.is_some() && (lengths.is_none() || lengths == got);
        if !agrees || n_values != variable.values.len() {
            let (variable, dims) = (variable.name.clone(), variable.dims.clone());
            return Err(ReportError::NotDraws { variable, dims });
        }
        lengths = got;
    }
    Ok(lengths.unwrap_or((0, 0)))
}

/// Column names of one variable: the index of each element over the dimensions after chain and draw.
fn columns(group: &Group, variable: &Variable) -> Vec<String> {
    let element = &variable.dims[2..];
    let mut indices = vec![String::new()];
    for (dim, length) in element {
        let extend = |start: &String| -> Vec<String> {
            let comma = if start.is_empty() { "" } else { "," };
            (0..*length).map(|i| format!("{start}{comma}{}", group.label(dim, i))).collect()
        };
        indices = indices.iter().flat_map(extend).collect();
    }
    let name = |index: String| format!("{}[{index}]", variable.name);
    if element.is_empty() {
        vec![variable.name.clone()]
    } else {
        indices.into_iter().map(name).collect()
    }
}

/// A variable that is read draw by draw.
struct Reader<'v> {
    variable: &'v Variable,
    /// Elements of a draw.
    width: usize,
    /// What was read at once of a variable that is kept elsewhere, from draw `first` on.
    read: Cow<'v, [f64]>,
    first: usize,
}

impl<'v> Reader<'v> {
    fn new(variable: &'v Variable) -> Self {
        let width = variable.dims[2..].iter().map(|(_, length)| length).product();
        Self { variable, width, read: Cow::default(), first: 0 }
    }

    /// Adds the elements in draw `row`, as text; draws are asked for in order.
    fn cells(&mut self, row: usize, line: &mut Vec<String>) -> io::Result<()> {
        let range = row * self.width..(row + 1) * self.width;
        // `{:?}` and not `{}`: both round-trip, but this one writes 1e-300 with an exponent.
        let float = |v: &f64| format!("{v:?}");
        match &self.variable.values {
            Values::Float(values) => line.extend(values[range].iter().map(float)),
            Values::Columns(columns) => {
                if range.end > self.first * self.width + self.read.len() {
                    (self.read, self.first) = (columns.rows_from(row)?, row);
                }
                let own = (row - self.first) * self.width;
                line.extend(self.read[own..own + self.width].iter().map(float));
            }
            Values::Int(values) => line.extend(values[range].iter().map(ToString::to_string)),
            Values::Bool(values) => {
                line.extend(values[range].iter().map(|&v| u8::from(v).to_string()));
            }
            Values::Text(values) => line.extend_from_slice(&values[range]),
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(group: &Group) -> Result<String, ReportError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("draws.csv");
        write_draws(&path, group)?;
        Ok(std::fs::read_to_string(path).unwrap())
    }

    fn posterior() -> Group {
        let shape = [("chain", 2), ("draw", 2)];
        let vector = [("chain", 2), ("draw", 2), ("site", 2)];
        let sites = vec!["A".to_owned(), "B, left".to_owned()];
        let rho = vec![0.1, 1.0 / 3.0, f64::MIN_POSITIVE, f64::NAN];
        let variables = vec![
            Variable::new("rho", "mm", &shape, rho),
            Variable::new("erp", "ms", &vector, (0..8).map(f64::from).collect::<Vec<_>>()),
            Variable::new("site", "", &[("site", 2)], sites),
        ];
        Group { name: "posterior".to_owned(), variables }
    }

    #[test]
    fn draws_read_back_to_the_same_bits() {
        let text = written(&posterior()).unwrap();
        let mut table = csv::Reader::from_reader(text.as_bytes());
        assert_eq!(
            table.headers().unwrap(),
            vec!["chain", "draw", "rho", "erp[A]", "erp[B, left]"]
        );
        let rows: Vec<Vec<f64>> = table
            .records()
            .map(|row| row.unwrap().iter().map(|cell| cell.parse().unwrap()).collect())
            .collect();
        let places: Vec<[f64; 2]> = rows.iter().map(|row| [row[0], row[1]]).collect();
        assert_eq!(places, [[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]]);
        assert_eq!(rows[1][2].to_bits(), (1.0_f64 / 3.0).to_bits());
        assert_eq!(rows[2][2].to_bits(), f64::MIN_POSITIVE.to_bits());
        assert!(rows[3][2].is_nan());
        assert_eq!(rows[3][3..], [6.0, 7.0]);
    }

    #[test]
    fn a_variable_without_chain_and_draw_is_refused() {
        let mut group = posterior();
        group.variables.push(Variable::new("x", "", &[("draw", 4)], vec![0.0; 4]));
        insta::assert_snapshot!(written(&group).unwrap_err(), @r#"
        variable x has dimensions [("draw", 4)]
        help: draws need the dimensions chain and draw first, of the same lengths for every variable
        "#);
    }

    #[test]
    fn a_variable_with_fewer_values_than_its_shape_is_refused() {
        let mut group = posterior();
        group.variables[0].values = vec![1.0].into();
        assert!(matches!(written(&group), Err(ReportError::NotDraws { .. })));
    }
}
