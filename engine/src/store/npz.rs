//! `NumPy`'s `.npz`: arrays by name, in a zip archive. Knows nothing of what they mean.

use std::fs::File;
use std::io::{self, BufReader, Read as _, Seek, Write};
use std::path::Path;

use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipArchive, ZipWriter};

use super::npy::{self, Element, Npy};

/// Ending of an array's name in the archive.
const ENDING: &str = ".npy";
/// What honest arrays inflate to at most, in multiples of their file.
pub(crate) const MOST_INFLATED: u64 = 32;
/// What any file may inflate to.
const SMALL: u64 = 1 << 20;
/// Numbers in an array from which on its file needs 64-bit sizes.
const LARGE: usize = 1 << 28;

/// Whether arrays are deflated. Mantissas do not get smaller by it, coordinates and counts do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Packing {
    /// As they are, like `numpy.savez`.
    Stored,
    /// Like `numpy.savez_compressed`.
    Deflated,
}

/// An archive that is being written.
#[derive(Debug)]
pub struct NpzWriter<W: Write + Seek> {
    zip: ZipWriter<W>,
    packing: CompressionMethod,
}

impl<W: Write + Seek> NpzWriter<W> {
    /// An empty archive.
    pub fn new(writer: W, packing: Packing) -> Self {
        let packing = match packing {
            Packing::Stored => CompressionMethod::Stored,
            Packing::Deflated => CompressionMethod::Deflated,
        };
        Self { zip: ZipWriter::new(writer), packing }
    }

    /// Appends an array: `values` row after row in this `shape`.
    ///
    /// # Errors
    /// What the writer says; a second array of this name.
    pub fn array<T: Element>(&mut self, name: &str, shape: &[u64], values: &[T]) -> io::Result<()> {
        // the same arrays are the same bytes at any time of day
        let options = SimpleFileOptions::default()
            .last_modified_time(DateTime::default())
            .compression_method(self.packing)
            .large_file(values.len() > LARGE);
        self.zip.start_file(format!("{name}{ENDING}"), options)?;
        npy::write(&mut self.zip, shape, values)
    }

    /// Ends the archive.
    ///
    /// # Errors
    /// What the writer says.
    pub fn finish(self) -> io::Result<()> {
        self.zip.finish()?.flush()
    }
}

/// An archive that is read.
#[derive(Debug)]
pub struct NpzReader {
    zip: ZipArchive<BufReader<File>>,
    /// Bytes that arrays which are not read yet may have: a few bytes of an archive can inflate to any size.
    budget: u64,
}

impl NpzReader {
    /// Opens a file.
    ///
    /// # Errors
    /// There is no such file, or it is no archive.
    pub fn open(path: &Path) -> io::Result<Self> {
        let file = File::open(path)?;
        let budget = SMALL.max(MOST_INFLATED.saturating_mul(file.metadata()?.len()));
        let damaged = |error| format!("no .npz archive, or a damaged one ({error})");
        let zip = ZipArchive::new(BufReader::new(file));
        Ok(Self { zip: zip.map_err(|error| io::Error::other(damaged(error)))?, budget })
    }

    /// Names of the arrays, sorted.
    ///
    /// # Errors
    /// A name that is no text.
    pub fn names(&self) -> io::Result<Vec<String>> {
        let mut names = vec![];
        for file in self.zip.file_names() {
            names.extend(array_name(&file?).map(String::from));
        }
        names.sort();
        Ok(names)
    }

    /// The array of this name, of any numbers.
    ///
    /// # Errors
    /// No such array, or one of something else; a damaged archive, or one that inflates to more than honest arrays do.
    pub fn array(&mut self, name: &str) -> io::Result<Npy> {
        let mut bytes = vec![];
        // to the end, because only there the archive checks their sum
        let file = self.zip.by_name(&format!("{name}{ENDING}"))?;
        file.take(self.budget + 1).read_to_end(&mut bytes)?;
        let left = self.budget.checked_sub(bytes.len() as u64);
        self.budget = left.ok_or_else(|| {
            io::Error::other("the archive inflates to more than an honest file does")
        })?;
        let array = npy::parse(&bytes).map_err(io::Error::other)?;
        array.ok_or_else(|| io::Error::other("expected numbers, got another type"))
    }
}

/// The name of the array in this file of an archive, if it is one.
pub fn array_name(file: &str) -> Option<&str> {
    file.strip_suffix(ENDING)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::write_file;

    /// Zeros deflate to a thousandth: of 32 MB of them are left 32 kB.
    #[test]
    fn an_archive_that_inflates_without_end_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("zeros.npz");
        let read = |n: u64, name: &str| {
            let zeros = vec![0.0; n as usize];
            write_file(&path, |file| {
                let mut archive = NpzWriter::new(file, Packing::Deflated);
                archive.array("a", &[n], &zeros)?;
                archive.array("b", &[n], &zeros)?;
                archive.finish()
            })
            .unwrap();
            let mut archive = NpzReader::open(&path).unwrap();
            let first = archive.array("a").map(|array| array.values.len());
            if name == "a" { first } else { archive.array(name).map(|array| array.values.len()) }
        };
        let said = read(4_000_000, "a").unwrap_err().to_string();
        assert_eq!(said, "the archive inflates to more than an honest file does");
        // what is small is read, but not again and again
        assert_eq!(read(100_000, "a").unwrap(), 100_000);
        assert!(read(100_000, "b").is_err());
    }
}
