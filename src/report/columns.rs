//! Numbers of which every draw has a row, in memory or on disk, and columns of them.
//!
//! Knows nothing of what the numbers are.

use std::io;
use std::path::Path;
use std::sync::Arc;

use crate::store::Spool;

/// A row of numbers for each draw of each chain.
#[derive(Debug)]
pub(super) struct Table {
    width: usize,
    n_draws: usize,
    place: Place,
}

#[derive(Debug)]
enum Place {
    /// (chain, draw, width)
    Memory(Arc<Vec<f64>>),
    /// One for each chain.
    Disk(Vec<Spool>),
}

/// Where the rows of one chain are written, from its first draw to its last.
#[derive(Debug)]
pub(super) enum Sink<'t> {
    /// What is left of its part (draw, width).
    Memory(&'t mut [f64]),
    Disk(Spool),
}

impl Sink<'_> {
    /// Adds the row of the next draw.
    ///
    /// # Errors
    /// From the disk.
    pub(super) fn push(&mut self, row: &[f64]) -> io::Result<()> {
        match self {
            Self::Memory(part) => {
                let (own, rest) = std::mem::take(part).split_at_mut(row.len());
                own.copy_from_slice(row);
                *part = rest;
                Ok(())
            }
            Self::Disk(spool) => spool.push(row),
        }
    }
}

impl Table {
    /// Numbers in memory (chain, draw, width).
    pub(super) fn of(values: Arc<Vec<f64>>, width: usize, n_draws: usize) -> Self {
        Self { width, n_draws, place: Place::Memory(values) }
    }

    /// What `fill` writes, which is given a place for each chain and gives it back; on the disk of `folder` if there is
    /// one.
    ///
    /// # Errors
    /// From the disk.
    pub(super) fn filled(
        [n_chains, n_draws, width]: [usize; 3],
        folder: Option<&Path>,
        fill: impl for<'t> FnOnce(Vec<Sink<'t>>) -> io::Result<Vec<Sink<'t>>>,
    ) -> io::Result<Self> {
        let place = if let Some(folder) = folder {
            let spool = |_| Spool::create(folder, width).map(Sink::Disk);
            let sinks = (0..n_chains).map(spool).collect::<io::Result<Vec<Sink<'_>>>>()?;
            let spool = |sink| match sink {
                Sink::Disk(spool) => Some(spool),
                Sink::Memory(_) => None,
            };
            Place::Disk(fill(sinks)?.into_iter().filter_map(spool).collect())
        } else {
            let mut values = vec![0.0; n_chains * n_draws * width];
            fill(parts(&mut values, n_chains).into_iter().map(Sink::Memory).collect())?;
            Place::Memory(Arc::new(values))
        };
        Ok(Self { width, n_draws, place })
    }
}

/// `n` equal parts.
pub(super) fn parts(values: &mut [f64], n: usize) -> Vec<&mut [f64]> {
    let length = values.len() / n.max(1);
    let mut rest = values;
    let mut part = |_| {
        let (own, others) = std::mem::take(&mut rest).split_at_mut(length);
        rest = others;
        own
    };
    (0..n).map(&mut part).collect()
}

/// Some of the numbers that there are for each draw: (chain, draw, column).
#[derive(Clone, Debug)]
pub struct Columns {
    table: Arc<Table>,
    from: usize,
    len: usize,
}

impl Columns {
    /// Columns `from..from + len`.
    pub(super) fn new(table: &Arc<Table>, from: usize, len: usize) -> Self {
        Self { table: Arc::clone(table), from, len }
    }

    /// Number of columns.
    pub(super) fn width(&self) -> usize {
        self.len
    }

    /// Number of numbers.
    pub fn len(&self) -> usize {
        let rows = match &self.table.place {
            Place::Memory(values) => values.len() / self.table.width.max(1),
            Place::Disk(spools) => spools.iter().map(Spool::n_rows).sum(),
        };
        rows * self.len
    }

    /// Whether there is no number.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Column `i` of these in every draw, of all chains.
    ///
    /// # Errors
    /// From the disk.
    pub fn column(&self, i: usize) -> io::Result<Vec<f64>> {
        let Table { width, place, .. } = &*self.table;
        match place {
            Place::Memory(values) => {
                Ok(values.iter().skip(self.from + i).step_by((*width).max(1)).copied().collect())
            }
            Place::Disk(spools) => {
                let mut column = vec![];
                for spool in spools {
                    spool.column(self.from + i, &mut column)?;
                }
                Ok(column)
            }
        }
    }

    /// All numbers (chain, draw, column).
    ///
    /// # Errors
    /// From the disk.
    pub fn all(&self) -> io::Result<Vec<f64>> {
        let mut all = Vec::with_capacity(self.len());
        while all.len() < self.len() {
            all.extend(self.rows_from(all.len() / self.len)?);
        }
        Ok(all)
    }

    /// The numbers of draw `row`, counted over all chains, and of as many after it as are read at once (draw, column):
    /// at most to the end of its chain.
    ///
    /// # Errors
    /// From the disk.
    pub(super) fn rows_from(&self, row: usize) -> io::Result<Vec<f64>> {
        let Table { width, n_draws, place } = &*self.table;
        let columns = self.from..self.from + self.len;
        let (chain, draw) = (row / n_draws, row % n_draws);
        match place {
            Place::Memory(values) => {
                let block = Spool::rows_of_block(*width);
                let end = row - draw + (draw / block * block + block).min(*n_draws);
                let rows = values[row * width..end * width].chunks_exact((*width).max(1));
                Ok(rows.flat_map(|row| &row[columns.clone()]).copied().collect())
            }
            Place::Disk(spools) => spools[chain].rows(draw, columns),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made(folder: Option<&Path>, [n_chains, n_draws, width]: [usize; 3]) -> Arc<Table> {
        let number =
            |chain: usize, draw: usize, i: usize| ((chain * n_draws + draw) * width + i) as f64;
        let table = Table::filled([n_chains, n_draws, width], folder, |mut sinks| {
            for (chain, sink) in sinks.iter_mut().enumerate() {
                for draw in 0..n_draws {
                    sink.push(&(0..width).map(|i| number(chain, draw, i)).collect::<Vec<f64>>())?;
                }
            }
            Ok(sinks)
        });
        Arc::new(table.unwrap())
    }

    /// Blocks of 262 rows, the last of which is not full.
    #[test]
    fn memory_and_disk_are_read_alike() {
        let folder = tempfile::tempdir().unwrap();
        let shape = [2, 600, 1000];
        let [memory, disk] = [None, Some(folder.path())].map(|place| made(place, shape));
        for (from, len) in [(0, 1), (3, 2), (0, 1000), (999, 1)] {
            let [memory, disk] = [&memory, &disk].map(|table| Columns::new(table, from, len));
            assert_eq!((memory.len(), disk.len()), (1200 * len, 1200 * len));
            let all = memory.all().unwrap();
            assert_eq!(all[..len], (from..from + len).map(|i| i as f64).collect::<Vec<f64>>());
            assert_eq!(disk.all().unwrap(), all);
            let column = memory.column(len - 1).unwrap();
            assert_eq!(
                column,
                all.iter().skip(len - 1).step_by(len).copied().collect::<Vec<f64>>()
            );
            assert_eq!(disk.column(len - 1).unwrap(), column);
            // the same numbers at once
            for row in [0, 5, 262, 599, 600, 1199] {
                assert_eq!(disk.rows_from(row).unwrap(), memory.rows_from(row).unwrap(), "{row}");
            }
        }
    }

    #[test]
    fn no_columns_are_no_numbers() {
        let none = Columns::new(&made(None, [2, 5, 3]), 1, 0);
        assert!(none.is_empty() && none.all().unwrap().is_empty());
    }
}
