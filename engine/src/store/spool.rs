//! Rows of numbers, written one after the other, read by column or by blocks of rows: in memory, or, a block whenever
//! one is full, on disk.
//!
//! ```text
//! file    a head · blocks of some thousand rows, each column by column, so that what is read lies together
//! last    the rows of the block that is not full yet, in memory, row by row; without a disk, all rows
//! ```
//! Knows nothing of what the numbers are.

use std::borrow::Cow;
use std::fs::File;
use std::io::{self, Read as _, Seek as _, SeekFrom, Write as _};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use flate2::Crc;
use serde::{Deserialize, Serialize};

/// Bytes of a number.
const NUMBER: usize = size_of::<f64>();
/// Numbers of a block, about: 2 MB.
const BLOCK: usize = 1 << 18;

/// Rows of numbers. What is serialised of them are those that are not in the file, and the sums of those that are.
#[derive(Debug, Default, Serialize, Deserialize)]
pub struct Spool {
    width: usize,
    /// CRC-32 of each block in the file.
    sums: Vec<u32>,
    last: Vec<f64>,
    #[serde(skip)]
    place: Place,
    /// Made when the first block is full.
    #[serde(skip)]
    file: Option<Mutex<File>>,
}

/// Where full blocks go.
#[derive(Debug, Default)]
enum Place {
    #[default]
    Memory,
    /// A file without a name, which goes with the process, on the disk of this folder.
    Folder(PathBuf),
    /// This file, which begins with these bytes.
    File(PathBuf, &'static [u8]),
}

impl Place {
    fn head(&self) -> &'static [u8] {
        if let Self::File(_, head) = self { head } else { &[] }
    }

    /// The file; its blocks, if there are any, are left as they are.
    fn open(&self) -> io::Result<Option<Mutex<File>>> {
        let file = match self {
            Self::Memory => return Ok(None),
            Self::Folder(folder) => tempfile::tempfile_in(folder)?,
            Self::File(path, head) => {
                let mut options = File::options();
                let mut file =
                    options.read(true).write(true).create(true).truncate(false).open(path)?;
                file.write_all(head)?;
                file
            }
        };
        Ok(Some(Mutex::new(file)))
    }
}

impl Spool {
    /// An empty one of rows of `width` numbers, with full blocks on the disk of `folder` if there is one. Without it there
    /// is room for `n_rows` at once.
    pub fn new(width: usize, n_rows: usize, folder: Option<&Path>) -> Self {
        let mut last = vec![];
        if folder.is_none() {
            // where there is no room for all of them, it is taken as they come
            let _ = last.try_reserve_exact(n_rows.saturating_mul(width));
        }
        let place = folder.map_or(Place::Memory, |folder| Place::Folder(folder.to_owned()));
        Self { width, last, place, ..Self::default() }
    }

    /// An empty one with full blocks in the file `path`, after `head`; they stay there.
    pub(super) fn kept(width: usize, path: PathBuf, head: &'static [u8]) -> Self {
        Self { width, place: Place::File(path, head), ..Self::default() }
    }

    /// Takes up the rows of one that was serialised. `false` if that cannot have been this one, or if its blocks are not
    /// in the file.
    ///
    /// # Errors
    /// From the operating system.
    pub(crate) fn take_up(&mut self, other: Self) -> io::Result<bool> {
        let (numbers, fits) = (self.numbers_of_block(), other.is_kept(self.width));
        let Self { sums, last, .. } = other;
        if !fits || !sums.is_empty() && !self.has_file()? {
            return Ok(false);
        }
        for (block, sum) in sums.iter().enumerate() {
            let bytes = match self.bytes(block * numbers, numbers) {
                Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => return Ok(false),
                bytes => bytes?,
            };
            if checksum(&bytes) != *sum {
                return Ok(false);
            }
        }
        (self.sums, self.last) = (sums, last);
        Ok(true)
    }

    /// Whether this can be what was serialised of rows of so many numbers with full blocks in a file.
    pub(crate) fn is_kept(&self, width: usize) -> bool {
        let n = self.last.len();
        self.width == width && n < self.numbers_of_block() && n.is_multiple_of(width)
    }

    fn has_file(&mut self) -> io::Result<bool> {
        if self.file.is_none() {
            self.file = self.place.open()?;
        }
        Ok(self.file.is_some())
    }

    /// Rows of a block.
    pub fn rows_of_block(width: usize) -> usize {
        (BLOCK / width.max(1)).max(1)
    }

    /// Numbers that are in memory at most, where blocks go to the disk.
    pub fn numbers_in_memory(width: usize) -> usize {
        2 * width * Self::rows_of_block(width)
    }

    fn numbers_of_block(&self) -> usize {
        self.width * Self::rows_of_block(self.width)
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
        let is_full = self.width > 0 && self.last.len() >= self.numbers_of_block();
        if is_full && self.has_file()? { self.write_block() } else { Ok(()) }
    }

    /// Writes the block that is full.
    fn write_block(&mut self) -> io::Result<()> {
        let block = Self::rows_of_block(self.width);
        let mut bytes = Vec::with_capacity(self.last.len() * NUMBER);
        for at in 0..self.last.len() {
            bytes.extend(self.last[at % block * self.width + at / block].to_le_bytes());
        }
        let at = self.place_of(self.sums.len() * self.last.len());
        if let Some(file) = &mut self.file {
            let file = file.get_mut().unwrap_or_else(PoisonError::into_inner);
            file.seek(at)?;
            file.write_all(&bytes)?;
        }
        self.sums.push(checksum(&bytes));
        self.last.clear();
        Ok(())
    }

    /// Waits until what is in the file is on the disk.
    ///
    /// # Errors
    /// From the operating system.
    pub(crate) fn sync(&self) -> io::Result<()> {
        let Some(file) = &self.file else { return Ok(()) };
        file.lock().unwrap_or_else(PoisonError::into_inner).sync_data()
    }

    /// Number of rows.
    pub fn n_rows(&self) -> usize {
        self.n_written() + self.last.len() / self.width.max(1)
    }

    /// Numbers of a row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Number of rows in the file.
    fn n_written(&self) -> usize {
        self.sums.len() * Self::rows_of_block(self.width)
    }

    /// These columns of the rows from `row` to the end of its block, row by row; nothing after the last row.
    ///
    /// # Errors
    /// From the operating system.
    pub fn rows(&self, row: usize, columns: Range<usize>) -> io::Result<Cow<'_, [f64]>> {
        let (block, width, n_written) =
            (Self::rows_of_block(self.width), self.width, self.n_written());
        let skipped = row % block;
        if row >= n_written {
            let from = (row - n_written) * width;
            let rows = &self.last[from..(from + (block - skipped) * width).min(self.last.len())];
            if columns == (0..width) {
                return Ok(Cow::Borrowed(rows));
            }
            let rows = rows.chunks_exact(width.max(1));
            return Ok(rows.flat_map(|row| &row[columns.clone()]).copied().collect());
        }
        let bytes =
            self.bytes((row - skipped) * width + columns.start * block, columns.len() * block)?;
        let numbers = bytes.as_chunks().0;
        let one = |r: usize| (0..columns.len()).map(move |c| c * block + r);
        Ok((skipped..block).flat_map(one).map(|at| f64::from_le_bytes(numbers[at])).collect())
    }

    /// Adds all numbers of a column to `out`.
    ///
    /// # Errors
    /// From the operating system.
    pub fn column(&self, column: usize, out: &mut Vec<f64>) -> io::Result<()> {
        for row in (0..self.n_rows()).step_by(Self::rows_of_block(self.width)) {
            out.extend_from_slice(&self.rows(row, column..column + 1)?);
        }
        Ok(())
    }

    /// Gives `take` every `step`-th row, with its number.
    ///
    /// # Errors
    /// From the operating system, and from `take`.
    pub fn each<E: From<io::Error>>(
        &self,
        step: usize,
        mut take: impl FnMut(usize, &[f64]) -> Result<(), E>,
    ) -> Result<(), E> {
        let (mut from, mut rows) = (0, self.rows(0, 0..self.width)?);
        for row in (0..self.n_rows()).step_by(step) {
            if (row - from) * self.width >= rows.len() {
                (from, rows) = (row, self.rows(row, 0..self.width)?);
            }
            take(row, &rows[(row - from) * self.width..][..self.width])?;
        }
        Ok(())
    }

    /// So many numbers of the file, from number `at` on.
    fn bytes(&self, at: usize, n: usize) -> io::Result<Vec<u8>> {
        let mut bytes = vec![0; n * NUMBER];
        let Some(file) = &self.file else { return Err(io::ErrorKind::UnexpectedEof.into()) };
        let mut file = file.lock().unwrap_or_else(PoisonError::into_inner);
        file.seek(self.place_of(at))?;
        file.read_exact(&mut bytes)?;
        Ok(bytes)
    }

    /// Of number `at` in the file.
    fn place_of(&self, at: usize) -> SeekFrom {
        SeekFrom::Start((self.place.head().len() + at * NUMBER) as u64)
    }
}

fn checksum(bytes: &[u8]) -> u32 {
    let mut crc = Crc::new();
    crc.update(bytes);
    crc.sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 1000;

    fn number(row: usize, column: usize) -> f64 {
        1.0 / (1 + row * WIDTH + column) as f64
    }

    fn row(row: usize) -> Vec<f64> {
        (0..WIDTH).map(|column| number(row, column)).collect()
    }

    /// Two full blocks and a part of one, in memory and on disk.
    #[test]
    fn rows_and_columns_read_back_to_the_last_bit() {
        let folder = tempfile::tempdir().unwrap();
        let block = Spool::rows_of_block(WIDTH);
        let n = 2 * block + 7;
        for place in [None, Some(folder.path())] {
            let mut spool = Spool::new(WIDTH, n, place);
            (0..n).for_each(|i| spool.push(&row(i)).unwrap());
            assert_eq!((spool.n_rows(), spool.sums.is_empty()), (n, place.is_none()));
            for column in [0, 17, WIDTH - 1] {
                let mut read = vec![];
                spool.column(column, &mut read).unwrap();
                assert_eq!(read, (0..n).map(|row| number(row, column)).collect::<Vec<f64>>());
            }
            for (from, to) in
                [(0, block), (block + 3, 2 * block), (2 * block, n), (n - 1, n), (n, n)]
            {
                let read = spool.rows(from, 5..8).unwrap();
                let expected =
                    (from..to).flat_map(|row| (5..8).map(move |column| number(row, column)));
                assert_eq!(read, expected.collect::<Vec<f64>>(), "{from}");
                let read = spool.rows(from, 0..WIDTH).unwrap();
                assert_eq!(read, (from..to).flat_map(row).collect::<Vec<f64>>(), "{from}");
            }
            for step in [1, 3, block, 2 * n] {
                let mut seen = vec![];
                let take = |i: usize, read: &[f64]| {
                    assert_eq!(read, row(i));
                    seen.push(i);
                    io::Result::Ok(())
                };
                spool.each(step, take).unwrap();
                assert_eq!(seen, (0..n).step_by(step).collect::<Vec<_>>());
            }
        }
        // it has no name
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn rows_without_numbers_are_none() {
        let folder = tempfile::tempdir().unwrap();
        for place in [None, Some(folder.path())] {
            let mut spool = Spool::new(0, 1, place);
            spool.push(&[]).unwrap();
            assert!(spool.rows(0, 0..0).unwrap().is_empty());
        }
    }

    /// What was written after it was serialised is written again, and what is not in the file is found.
    #[test]
    fn a_file_is_gone_on_with_from_where_it_was_serialised() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rows");
        let empty = || Spool::kept(WIDTH, path.clone(), b"head");
        let block = Spool::rows_of_block(WIDTH);
        let mut spool = empty();
        (0..block + 5).for_each(|i| spool.push(&row(i)).unwrap());
        let kept = serde_json::to_string(&spool).unwrap();
        let other = || serde_json::from_str::<Spool>(&kept).unwrap();
        (block + 5..2 * block).for_each(|_| spool.push(&[7.0; WIDTH]).unwrap());
        assert!(std::fs::read(&path).unwrap().starts_with(b"head"));

        let mut again = empty();
        assert!(again.take_up(other()).unwrap());
        (block + 5..=2 * block).for_each(|i| again.push(&row(i)).unwrap());
        let right = |i: usize, read: &[f64]| {
            assert_eq!(read, row(i));
            io::Result::Ok(())
        };
        again.each(1, right).unwrap();
        assert_eq!(again.n_rows(), 2 * block + 1);

        // rows of another width, and more of them than are kept in memory, of which the file says nothing
        let of = |width, n| {
            let last = vec![1.0; n];
            Spool { width, last, ..Spool::default() }
        };
        for (width, n) in [(WIDTH + 1, WIDTH + 1), (WIDTH, WIDTH + 1), (WIDTH, block * WIDTH)] {
            assert!(!empty().take_up(of(width, n)).unwrap(), "{n} numbers in rows of {width}");
        }
        assert!(empty().take_up(of(WIDTH, 2 * WIDTH)).unwrap());

        let refused = || !empty().take_up(other()).unwrap();
        assert!(!Spool::new(WIDTH, 0, None).take_up(other()).unwrap());
        assert!(!Spool::kept(WIDTH + 1, path.clone(), b"head").take_up(other()).unwrap());
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() / 2 - 8]).unwrap();
        assert!(refused());
        let mut changed = bytes;
        changed[100] ^= 1;
        std::fs::write(&path, &changed).unwrap();
        assert!(refused());
        std::fs::remove_file(&path).unwrap();
        assert!(refused());
    }
}
