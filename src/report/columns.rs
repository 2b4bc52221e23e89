//! Columns of numbers of which every draw has a row, in memory or on disk.
//!
//! Knows nothing of what the numbers are.

use std::borrow::Cow;
use std::io;
use std::sync::Arc;

use crate::store::Spool;

/// Some of the numbers that there are for each draw: (chain, draw, column).
#[derive(Clone, Debug)]
pub struct Columns {
    /// A row for each draw, of each chain, of as many draws.
    chains: Arc<Vec<Spool>>,
    from: usize,
    len: usize,
}

impl Columns {
    /// Columns `from..from + len` of all.
    pub(super) fn new(chains: &Arc<Vec<Spool>>, from: usize, len: usize) -> Self {
        Self { chains: Arc::clone(chains), from, len }
    }

    /// Number of columns.
    pub(crate) fn width(&self) -> usize {
        self.len
    }

    /// Number of draws, of all chains.
    pub(super) fn n_draws(&self) -> usize {
        self.chains.iter().map(Spool::n_rows).sum()
    }

    /// Number of numbers.
    pub fn len(&self) -> usize {
        self.n_draws() * self.len
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
        let mut column = Vec::with_capacity(self.n_draws());
        self.chains.iter().try_for_each(|chain| chain.column(self.from + i, &mut column))?;
        Ok(column)
    }

    /// All numbers (chain, draw, column).
    ///
    /// # Errors
    /// From the disk.
    pub fn all(&self) -> io::Result<Vec<f64>> {
        let mut all = Vec::with_capacity(self.len());
        while all.len() < self.len() {
            all.extend_from_slice(&self.rows_from(all.len() / self.len)?);
        }
        Ok(all)
    }

    /// The numbers of draw `row`, counted over all chains, and of as many after it as are read at once (draw, column):
    /// at most to the end of its chain.
    ///
    /// # Errors
    /// From the disk.
    pub(super) fn rows_from(&self, row: usize) -> io::Result<Cow<'_, [f64]>> {
        let n = self.chains[0].n_rows();
        self.chains[row / n].rows(row % n, self.from..self.from + self.len)
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn made(folder: Option<&Path>, [n_chains, n_draws, width]: [usize; 3]) -> Arc<Vec<Spool>> {
        let number =
            |chain: usize, draw: usize, i: usize| ((chain * n_draws + draw) * width + i) as f64;
        let chain = |chain| {
            let mut spool = Spool::new(width, n_draws, folder);
            for draw in 0..n_draws {
                let row: Vec<f64> = (0..width).map(|i| number(chain, draw, i)).collect();
                spool.push(&row).unwrap();
            }
            spool
        };
        Arc::new((0..n_chains).map(chain).collect())
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
