//! `NumPy`'s `.npz`: arrays by name, in a zip archive. Knows nothing of what they mean.

use std::fs::File;
use std::io::{self, BufReader, Read as _, Seek, Write};
use std::path::Path;

use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipArchive, ZipWriter};

use super::npy::{self, Element, Npy};

/// Ending of an array's name in the archive.
const ENDING: &str = ".npy";
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
pub struct NpzReader(ZipArchive<BufReader<File>>);

impl NpzReader {
    /// Opens a file.
    ///
    /// # Errors
    /// There is no such file, or it is no archive.
    pub fn open(path: &Path) -> io::Result<Self> {
        let file = BufReader::new(File::open(path)?);
        let damaged = |error| format!("no .npz archive, or a damaged one ({error})");
        Ok(Self(ZipArchive::new(file).map_err(|error| io::Error::other(damaged(error)))?))
    }

    /// Names of the arrays, sorted.
    ///
    /// # Errors
    /// A name that is no text.
    pub fn names(&self) -> io::Result<Vec<String>> {
        let mut names = vec![];
        for file in self.0.file_names() {
            names.extend(array_name(&file?).map(String::from));
        }
        names.sort();
        Ok(names)
    }

    /// The array of this name, of any numbers.
    ///
    /// # Errors
    /// No such array, or one of something else; a damaged archive.
    pub fn array(&mut self, name: &str) -> io::Result<Npy> {
        let mut bytes = vec![];
        // to the end, because only there the archive checks their sum
        self.0.by_name(&format!("{name}{ENDING}"))?.read_to_end(&mut bytes)?;
        let array = npy::parse(&bytes).map_err(io::Error::other)?;
        array.ok_or_else(|| io::Error::other("expected numbers, got another type"))
    }
}

/// The name of the array in this file of an archive, if it is one.
pub fn array_name(file: &str) -> Option<&str> {
    file.strip_suffix(ENDING)
}
