//! Rows of numbers on disk, for which there is no room in memory: written one after the other, read by column or by
//! blocks of rows.
//!
//! ```text
//! file    blocks of some thousand rows, each column by column, so that what is read lies together
//! last    the rows of the block that is not full yet, in memory, row by row
//! ```
//! Knows nothing of what the numbers are.

use std::fs::File;
use std::io::{self, Read as _, Seek as _, SeekFrom, Write as _};
use std::ops::Range;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// Bytes of a number.
const NUMBER: usize = size_of::<f64>();
/// Numbers of a block, about: 2 MB.
const BLOCK: usize = 1 << 18;

/// Rows of numbers in a file that has no name and goes with the process.
#[derive(Debug)]
pub struct Spool {
    width: usize,
    /// Rows in the file.
    n_written: usize,
    file: Mutex<File>,
    last: Vec<f64>,
}

impl Spool {
    /// An empty one, of rows of `width` numbers, on the disk of `folder`.
    ///
    /// # Errors
    /// From the operating system.
    pub fn create(folder: &Path, width: usize) -> io::Result<Self> {
        let file = Mutex::new(tempfile::tempfile_in(folder)?);
        Ok(Self { width, n_written: 0, file, last: vec![] })
    }

    /// Rows of a block.
    pub fn rows_of_block(width: usize) -> usize {
        (BLOCK / width.max(1)).max(1)
    }

    /// Numbers that are in memory at most.
    pub fn numbers_in_memory(width: usize) -> usize {
        2 * width * Self::rows_of_block(width)
    }

    /// Adds a row (width).
    ///
    /// # Errors
    /// From the operating system: no room on the disk.
    ///
    /// # Panics
    /// If the row has another width.
    pub fn push(&mut self, row: &[f64]) -> io::Result<()> {
        assert_eq!(row.len(), self.width, "a row");
        self.last.extend_from_slice(row);
        let block = Self::rows_of_block(self.width);
        if self.last.len() < (block * self.width).max(1) {
            return Ok(());
        }
        let number = |at: usize| self.last[at % block * self.width + at / block];
        let bytes: Vec<u8> = (0..self.last.len()).flat_map(|at| number(at).to_le_bytes()).collect();
        let file = self.file.get_mut().unwrap_or_else(PoisonError::into_inner);
        file.seek(SeekFrom::End(0))?;
        file.write_all(&bytes)?;
        self.n_written += block;
        self.last.clear();
        Ok(())
    }

    /// Number of rows.
    pub fn n_rows(&self) -> usize {
        self.n_written + self.last.len() / self.width.max(1)
    }

    /// These columns of the rows from `row` to the end of its block, row by row; nothing after the last row.
    ///
    /// # Errors
    /// From the operating system.
    pub fn rows(&self, row: usize, columns: Range<usize>) -> io::Result<Vec<f64>> {
        let block = Self::rows_of_block(self.width);
        if row >= self.n_written {
            let rows = self.last.chunks_exact(self.width.max(1)).skip(row - self.n_written);
            return Ok(rows.flat_map(|row| &row[columns.clone()]).copied().collect());
        }
        let skipped = row % block;
        let read =
            self.read((row - skipped) * self.width + columns.start * block, columns.len() * block)?;
        let one = |r: usize| (0..columns.len()).map(move |c| c * block + r);
        Ok((skipped..block).flat_map(one).map(|at| read[at]).collect())
    }

    /// Adds all numbers of a column to `out`.
    ///
    /// # Errors
    /// From the operating system.
    pub fn column(&self, column: usize, out: &mut Vec<f64>) -> io::Result<()> {
        for row in (0..self.n_rows()).step_by(Self::rows_of_block(self.width)) {
            out.extend(self.rows(row, column..column + 1)?);
        }
        Ok(())
    }

    /// So many numbers of the file, from number `at` on.
    fn read(&self, at: usize, n: usize) -> io::Result<Vec<f64>> {
        let mut bytes = vec![0; n * NUMBER];
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.seek(SeekFrom::Start((at * NUMBER) as u64))?;
        file.read_exact(&mut bytes)?;
        drop(file);
        Ok(bytes.as_chunks().0.iter().map(|eight| f64::from_le_bytes(*eight)).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two full blocks and a part of one.
    #[test]
    fn rows_and_columns_read_back_to_the_last_bit() {
        let folder = tempfile::tempdir().unwrap();
        let width = 1000;
        let block = Spool::rows_of_block(width);
        let n = 2 * block + 7;
        let mut spool = Spool::create(folder.path(), width).unwrap();
        let number = |row: usize, column: usize| 1.0 / (1 + row * width + column) as f64;
        for row in 0..n {
            let numbers: Vec<f64> = (0..width).map(|column| number(row, column)).collect();
            spool.push(&numbers).unwrap();
        }
        assert_eq!(spool.n_rows(), n);
        for column in [0, 17, width - 1] {
            let mut read = vec![];
            spool.column(column, &mut read).unwrap();
            assert_eq!(read, (0..n).map(|row| number(row, column)).collect::<Vec<f64>>());
        }
        for (from, to) in [(0, block), (block + 3, 2 * block), (2 * block, n), (n - 1, n), (n, n)] {
            let read = spool.rows(from, 5..8).unwrap();
            let expected = (from..to).flat_map(|row| (5..8).map(move |column| number(row, column)));
            assert_eq!(read, expected.collect::<Vec<f64>>(), "{from}");
        }
        // it has no name
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn rows_without_numbers_are_none() {
        let folder = tempfile::tempdir().unwrap();
        let mut spool = Spool::create(folder.path(), 0).unwrap();
        spool.push(&[]).unwrap();
        assert!(spool.rows(0, 0..0).unwrap().is_empty());
    }
}
