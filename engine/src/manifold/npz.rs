//! A basis as an `.npz` file: arrays `eigenvalues (K)` and `eigenfunctions (n_vertices, K)`.
//!
//! Knows nothing of meshes.

use super::{Basis, ManifoldError};
use crate::store::npy::Npy;
use crate::store::{NpzReader, NpzWriter, Packing, advice, write_file};
use std::io::{self, Seek, Write};
use std::path::Path;

impl Basis {
    /// Reads `eigenvalues (K)` and `eigenfunctions (n_vertices, K)`: numbers of any type, C or Fortran
    /// order, as NumPy's `savez` and [`Basis::write_npz`] write them.
    ///
    /// # Errors
    /// [`ManifoldError::File`] when the file cannot be read, [`ManifoldError::Array`] when an array
    /// is absent, of another type or shape, not finite, or the eigenvalues do not ascend from 0.
    pub fn read_npz(path: &Path) -> Result<Self, ManifoldError> {
        let mut archive = NpzReader::open(path).map_err(|error| unreadable(path, &error))?;
        let eigenvalues = array(&mut archive, path, "eigenvalues", 1)?;
        let eigenfunctions = array(&mut archive, path, "eigenfunctions", 2)?;
        let n_modes = eigenvalues.values.len();
        if n_modes == 0 {
            return Err(wrong(path, "eigenvalues", "at least 1 value", "0"));
        }
        if eigenfunctions.shape[1] != n_modes || eigenfunctions.shape[0] == 0 {
            let expected = format!("shape (n_vertices, {n_modes})");
            let got = format!("({}, {})", eigenfunctions.shape[0], eigenfunctions.shape[1]);
            return Err(wrong(path, "eigenfunctions", expected, got));
        }
        check_spectrum(path, &eigenvalues.values)?;
        Ok(Self { eigenvalues: eigenvalues.values, eigenfunctions: eigenfunctions.values })
    }

    /// Writes both arrays as float64 in C order; the file appears whole or not at all.
    ///
    /// # Errors
    /// [`ManifoldError::File`] when the folder or the file cannot be written.
    pub fn write_npz(&self, path: &Path) -> Result<(), ManifoldError> {
        self.try_write(path).map_err(|error| ManifoldError::File {
            action: "write",
            path: path.to_owned(),
            reason: error.to_string(),
            help: advice(&error),
        })
    }

    fn try_write(&self, path: &Path) -> io::Result<()> {
        write_file(path, |file| self.write_arrays(file))
    }

    fn write_arrays(&self, writer: impl Write + Seek) -> io::Result<()> {
        let mut archive = NpzWriter::new(writer, Packing::Stored);
        let (n_vertices, n_modes) = (self.n_vertices() as u64, self.n_modes() as u64);
        let arrays: [(&str, &[u64], &[f64]); 2] = [
            ("eigenvalues", &[n_modes], &self.eigenvalues),
            ("eigenfunctions", &[n_vertices, n_modes], &self.eigenfunctions),
        ];
        for (name, shape, values) in arrays {
            archive.array(name, shape, values)?;
        }
        archive.finish()
    }
}

/// An array of the file with so many dimensions, all numbers finite.
fn array(
    archive: &mut NpzReader,
    path: &Path,
    name: &'static str,
    n_dimensions: usize,
) -> Result<Npy, ManifoldError> {
    let broken = |error: io::Error| unreadable(path, &error);
    let found = archive.names().map_err(broken)?;
    if !found.iter().any(|other| other == name) {
        let got = format!("no such array (the file has: {})", found.join(", "));
        return Err(wrong(path, name, "an array", got));
    }
    let array = archive.array(name).map_err(broken)?;
    if array.shape.len() != n_dimensions {
        let expected = format!("{n_dimensions} dimension(s)");
        return Err(wrong(path, name, expected, format!("shape {:?}", array.shape)));
    }
    if let Some(bad) = array.values.iter().position(|v| !v.is_finite()) {
        let got = format!("{} at position {bad}", array.values[bad]);
        return Err(wrong(path, name, "finite numbers", got));
    }
    Ok(array)
}

/// Eigenvalues ascend, and the first is 0 to rounding (of a float32, at worst).
fn check_spectrum(path: &Path, eigenvalues: &[f64]) -> Result<(), ManifoldError> {
    let [first, .., last] = eigenvalues else { return Ok(()) };
    if first.abs() > 1e-5 * last.abs() {
        let got = format!("a first of {first:e} and a last of {last:e}");
        return Err(wrong(path, "eigenvalues", "the first to be 0 (the constant mode)", got));
    }
    if let Some(k) = (1..eigenvalues.len()).find(|&k| eigenvalues[k] < eigenvalues[k - 1]) {
        let got = format!("{:e} after {:e} at mode {k}", eigenvalues[k], eigenvalues[k - 1]);
        return Err(wrong(path, "eigenvalues", "ascending order", got));
    }
    Ok(())
}

fn unreadable(path: &Path, error: &io::Error) -> ManifoldError {
    ManifoldError::File {
        action: "read",
        path: path.to_owned(),
        reason: error.to_string(),
        help: "give an .npz file with arrays `eigenvalues` and `eigenfunctions`; eplat mesh basis writes one",
    }
}

fn wrong(
    path: &Path,
    array: &'static str,
    expected: impl Into<String>,
    got: impl Into<String>,
) -> ManifoldError {
    ManifoldError::Array {
        path: path.to_owned(),
        array,
        expected: expected.into(),
        got: got.into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use base64::{Engine, engine::general_purpose::STANDARD};
    use std::fs;
    use tempfile::{TempDir, tempdir};

    /// Written by NumPy 2.5.5: `savez_compressed(file, eigenvalues=array([0, 0.25], '<f4'),
    /// eigenfunctions=asfortranarray(array([[1, 2], [3, 4], [5, 6.5]], '<f4')))`.
    const BY_NUMPY: &str = "\
        UEsDBC0AAAAIAAAAIQBlNVRW//////////8PABQAZWlnZW52YWx1ZXMubnB5AQAQAIgAAAAAAAAASQAA\
        AAAAAACb7BfqGxDJyFDGUK2eklqcXKRupaBuk2airqOgnpZfVFKUmBefX5SSChJ3S8wpTgWKF2ckFqQC\
        +RpGOpo6CrUKFAAuBjBosAMAUEsDBC0AAAAIAAAAIQDkLnj///////////8SABQAZWlnZW5mdW5jdGlv\
        bnMubnB5AQAQAJgAAAAAAAAAWQAAAAAAAACb7BfqGxDJyFDGUK2eklqcXKRupaBuk2airqOgnpZfVFKU\
        mBefX5SSChIPKSpNBQoXZyQWpAK5GsY6CkaaOgq1CuQDLgaGBnsGBgcHBoYFQMwAxA1AfMEBAFBLAQIt\
        Ay0AAAAIAAAAIQBlNVRWSQAAAIgAAAAPAAAAAAAAAAAAAACAAQAAAABlaWdlbnZhbHVlcy5ucHlQSwEC\
        LQMtAAAACAAAACEA5C54/1kAAACYAAAAEgAAAAAAAAAAAAAAgAGKAAAAZWlnZW5mdW5jdGlvbnMubnB5\
        UEsFBgAAAAACAAIAfQAAACcBAAAAAA==";

    fn small() -> Basis {
        Basis {
            eigenvalues: vec![0.0, 0.25, 1.0 / 3.0],
            eigenfunctions: vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0],
        }
    }

    /// Writes arrays of any shape, the way a user might get them wrong, and reads them back.
    fn read_arrays(arrays: &[(&str, &[u64], &[f64])]) -> Result<Basis, ManifoldError> {
        let folder = tempdir().unwrap();
        let path = folder.path().join("basis.npz");
        let mut archive = NpzWriter::new(fs::File::create(&path).unwrap(), Packing::Deflated);
        for (name, shape, values) in arrays {
            archive.array(name, shape, values).unwrap();
        }
        archive.finish().unwrap();
        Basis::read_npz(&path)
    }

    fn in_folder(name: &str) -> (TempDir, std::path::PathBuf) {
        let folder = tempdir().unwrap();
        let path = folder.path().join(name);
        (folder, path)
    }

    #[test]
    fn what_is_written_is_read_back_bit_for_bit() {
        let (_folder, path) = in_folder("basis.npz");
        small().write_npz(&path).unwrap();
        small().write_npz(&path).unwrap();
        let back = Basis::read_npz(&path).unwrap();
        assert!(back.eigenvalues == small().eigenvalues);
        assert!(back.eigenfunctions == small().eigenfunctions);
        assert_eq!((back.n_vertices(), back.n_modes()), (2, 3));
        assert_eq!(
            fs::read_dir(path.parent().unwrap()).unwrap().count(),
            1,
            "a temporary file is left"
        );
    }

    #[test]
    fn a_compressed_fortran_order_float32_file_of_numpy_is_read() {
        let (_folder, path) = in_folder("numpy.npz");
        fs::write(&path, STANDARD.decode(BY_NUMPY).unwrap()).unwrap();
        let basis = Basis::read_npz(&path).unwrap();
        assert!(basis.eigenvalues == [0.0, 0.25]);
        assert!(basis.eigenfunctions == [1.0, 2.0, 3.0, 4.0, 5.0, 6.5]);
    }

    #[test]
    fn errors_name_the_array_what_was_expected_and_what_was_found() {
        let values: (&str, &[u64], &[f64]) = ("eigenvalues", &[2], &[0.0, 1.0]);
        let functions: (&str, &[u64], &[f64]) = ("eigenfunctions", &[3, 2], &[1.0; 6]);
        assert!(read_arrays(&[values, functions]).is_ok());
        let message = |arrays: &[_]| read_arrays(arrays).unwrap_err().to_string();
        let cases = [
            (
                message(&[values]),
                "`eigenfunctions`: expected an array, got no such array (the file has: eigenvalues)",
            ),
            (
                message(&[values, ("eigenfunctions", &[2, 3], &[1.0; 6])]),
                "expected shape (n_vertices, 2), got (2, 3)",
            ),
            (
                message(&[values, ("eigenfunctions", &[6], &[1.0; 6])]),
                "expected 2 dimension(s), got shape [6]",
            ),
            (
                message(&[values, ("eigenfunctions", &[1, 2], &[1.0, f64::NAN])]),
                "expected finite numbers, got NaN at position 1",
            ),
            (message(&[("eigenvalues", &[2], &[1.0, 0.0]), functions]), "the first to be 0"),
            (
                message(&[
                    ("eigenvalues", &[3], &[0.0, 2.0, 1.0]),
                    ("eigenfunctions", &[1, 3], &[1.0; 3]),
                ]),
                "ascending order",
            ),
            (message(&[("eigenvalues", &[0], &[]), functions]), "at least 1 value"),
        ];
        for (message, expected) in cases {
            assert!(message.contains(expected) && message.contains("help:"), "{message}");
        }
    }

    #[test]
    fn files_that_are_absent_or_damaged_are_errors() {
        let (_folder, path) = in_folder("basis.npz");
        let error = Basis::read_npz(&path).unwrap_err();
        assert!(matches!(error, ManifoldError::File { action: "read", .. }), "{error}");
        small().write_npz(&path).unwrap();
        let whole = fs::read(&path).unwrap();
        for length in 0..whole.len() {
            fs::write(&path, &whole[..length]).unwrap();
            assert!(Basis::read_npz(&path).is_err(), "cut to {length} bytes");
        }
        // One flipped bit of a value is caught by the archive's checksum.
        let value = whole.windows(8).position(|w| w == 5.0_f64.to_le_bytes()).unwrap();
        let mut flipped = whole;
        flipped[value + 3] ^= 1;
        fs::write(&path, &flipped).unwrap();
        assert!(Basis::read_npz(&path).is_err());
    }

    #[test]
    fn a_folder_that_is_not_there_is_an_error_and_leaves_nothing() {
        let (folder, _) = in_folder("");
        let error = small().write_npz(&folder.path().join("absent/basis.npz")).unwrap_err();
        assert!(matches!(error, ManifoldError::File { action: "write", .. }), "{error}");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
