//! `field_draws.npz`: draws of whole fields, a few numbers each.
//!
//! ```text
//! eigenfunctions (vertex, K)      NAME (draw, 1 + K), one for each field
//! NAME at a vertex = NAME[draw, 0] + eigenfunctions[vertex] · NAME[draw, 1:]
//! ```
//! Of a field `within LOW..HIGH` this is the sum x, and there is an array `NAME.within` (1, 2) of the ends:
//! the field is LOW + s ln((1 + e^((x − LOW)/s)) / (1 + e^((x − HIGH)/s))) with s = (HIGH − LOW)/20.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::{self, Seek, Write};
use std::path::Path;

use super::ReportError;
use crate::num::Within;
use crate::store::npy::Npy;
use crate::store::{NpzReader, NpzWriter, Packing, write_file};

const EIGENFUNCTIONS: &str = "eigenfunctions";

/// Draws of every field of a model, on one surface.
#[derive(Clone, Debug, PartialEq)]
pub struct FieldDraws<'b> {
    /// Number of modes K.
    pub n_modes: usize,
    /// (vertex, K), row-major.
    pub eigenfunctions: Cow<'b, [f64]>,
    /// By field (draw, 1 + K), row-major: mean, and weights of the eigenfunctions.
    pub coefficients: BTreeMap<String, Vec<f64>>,
    /// By field, of those whose sum is bent into an interval.
    pub within: BTreeMap<String, Within>,
}

/// Suffix of the array of an interval's ends.
const WITHIN: &str = ".within";

impl FieldDraws<'_> {
    /// The file in an output folder.
    pub const FILE: &'static str = "field_draws.npz";

    /// Number of vertices.
    pub fn n_vertices(&self) -> usize {
        self.eigenfunctions.len() / self.n_modes.max(1)
    }

    /// Number of draws.
    pub fn n_draws(&self) -> usize {
        self.coefficients.values().next().map_or(0, |c| c.len() / (1 + self.n_modes))
    }

    /// The field `name` at every vertex in one draw; `None` if there is no such field or draw.
    pub fn at_vertices(&self, name: &str, draw: usize) -> Option<Vec<f64>> {
        let (mean, weights) =
            self.coefficients.get(name)?.chunks_exact(1 + self.n_modes).nth(draw)?.split_first()?;
        let within = self.within.get(name);
        let value = |modes: &[f64]| {
            let sum = mean + modes.iter().zip(weights).map(|(m, w)| m * w).sum::<f64>();
            within.map_or(sum, |within| within.value(sum))
        };
        Some(self.eigenfunctions.chunks_exact(self.n_modes.max(1)).map(value).collect())
    }

    /// Writes the file.
    ///
    /// # Errors
    /// [`ReportError::Write`].
    pub fn write(&self, path: &Path) -> Result<(), ReportError> {
        write_file(path, |file| self.write_arrays(file)).map_err(ReportError::write(path))
    }

    fn write_arrays(&self, writer: impl Write + Seek) -> io::Result<()> {
        let mut archive = NpzWriter::new(writer, Packing::Stored);
        let eigenfunctions = (EIGENFUNCTIONS, self.n_modes, &*self.eigenfunctions);
        let fields = self.coefficients.iter().map(|(n, c)| (n.as_str(), 1 + self.n_modes, &**c));
        let ends = |(name, within): (&String, &Within)| {
            (format!("{name}{WITHIN}"), vec![within.low, within.high])
        };
        let ends: Vec<(String, Vec<f64>)> = self.within.iter().map(ends).collect();
        let ends = ends.iter().map(|(name, ends)| (name.as_str(), 2, &**ends));
        for (name, width, values) in std::iter::once(eigenfunctions).chain(fields).chain(ends) {
            let shape = [(values.len() / width.max(1)) as u64, width as u64];
            archive.array(name, &shape, values)?;
        }
        archive.finish()
    }

    /// Reads what [`FieldDraws::write`] wrote.
    ///
    /// # Errors
    /// [`ReportError::Read`], [`ReportError::Malformed`].
    pub fn read(path: &Path) -> Result<FieldDraws<'static>, ReportError> {
        let mut archive = NpzReader::open(path).map_err(ReportError::read(path))?;
        let names = archive.names().map_err(ReportError::read(path))?;
        let mut matrix = |name: &str| -> io::Result<(usize, Vec<f64>)> {
            let Npy { shape, values } = archive.array(name)?;
            match shape[..] {
                [_, width] if values.iter().all(|x| x.is_finite()) => Ok((width, values)),
                [_, _] => Err(io::Error::other("expected finite numbers, got NaN or an infinity")),
                _ => Err(io::Error::other(format!("expected 2 dimensions, got {shape:?}"))),
            }
        };
        let malformed = |name: &str, reason: &dyn std::fmt::Display| ReportError::Malformed {
            path: path.to_owned(),
            reason: format!("array {name}: {reason}"),
        };
        let (n_modes, eigenfunctions) =
            matrix(EIGENFUNCTIONS).map_err(|e| malformed(EIGENFUNCTIONS, &e))?;
        let mut coefficients: BTreeMap<String, Vec<f64>> = BTreeMap::new();
        let mut bounds = BTreeMap::new();
        for name in names.into_iter().filter(|name| name != EIGENFUNCTIONS) {
            let (width, values) = matrix(&name).map_err(|e| malformed(&name, &e))?;
            if let (Some(field), [low, high]) = (name.strip_suffix(WITHIN), &values[..]) {
                bounds.insert(field.to_owned(), Within { low: *low, high: *high });
                continue;
            }
            let n = coefficients.values().next().map_or(values.len(), Vec::len);
            if width != 1 + n_modes || values.len() != n {
                let got = format!("{} values in rows of {width}", values.len());
                return Err(malformed(
                    &name,
                    &format_args!("expected {n} in rows of {}, got {got}", 1 + n_modes),
                ));
            }
            coefficients.insert(name, values);
        }
        let eigenfunctions = Cow::from(eigenfunctions);
        Ok(FieldDraws { n_modes, eigenfunctions, coefficients, within: bounds })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn small() -> FieldDraws<'static> {
        FieldDraws {
            n_modes: 2,
            eigenfunctions: vec![1.0, 0.0, 0.5, -1.0, 0.0, 2.0].into(),
            coefficients: BTreeMap::from([(
                "tau_out".into(),
                vec![10.0, 1.0, 2.0, 20.0, 0.0, 0.25],
            )]),
            within: BTreeMap::new(),
        }
    }

    #[test]
    fn draws_read_back_the_same_and_make_fields() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("field_draws.npz");
        small().write(&path).unwrap();
        let back = FieldDraws::read(&path).unwrap();
        assert_eq!(back, small());
        assert_eq!((back.n_vertices(), back.n_draws()), (3, 2));
        assert_eq!(back.at_vertices("tau_out", 0).unwrap(), [11.0, 8.5, 14.0]);
        assert_eq!(back.at_vertices("tau_out", 1).unwrap(), [20.0, 19.75, 20.5]);
        assert!(
            back.at_vertices("apd_max", 0).is_none() && back.at_vertices("tau_out", 2).is_none()
        );
    }

    #[test]
    fn a_field_within_an_interval_is_bent_into_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("field_draws.npz");
        let within = Within { low: 0.0, high: 12.0 };
        let draws = FieldDraws { within: BTreeMap::from([("tau_out".into(), within)]), ..small() };
        draws.write(&path).unwrap();
        let back = FieldDraws::read(&path).unwrap();
        assert_eq!(back, draws);
        let expected = [11.0, 8.5, 14.0].map(|x| within.value(x));
        assert_eq!(back.at_vertices("tau_out", 0).unwrap(), expected);
    }

    #[test]
    fn arrays_that_do_not_fit_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("field_draws.npz");
        let mut wrong = small();
        wrong.coefficients.insert("x".into(), vec![0.0; 3]);
        wrong.write(&path).unwrap();
        let said = FieldDraws::read(&path).unwrap_err().to_string();
        assert!(said.contains("array x: expected 6 in rows of 3, got 3"), "{said}");
        std::fs::write(&path, b"PK").unwrap();
        assert!(FieldDraws::read(&path).is_err());
    }
}
