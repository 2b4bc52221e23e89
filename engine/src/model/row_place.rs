//! Where the numbers of the rows of an `observe` statement live.

/// Where the scalars of every row live in `v`.
#[derive(Debug)]
pub(super) struct Place {
    /// W: how many scalars of a row carry a derivative.
    pub(super) width: usize,
    /// (rows, W): where each of these lives.
    pub(super) index: Vec<u32>,
    /// (rows, W): the offset that is added to each. Empty if no effect acts on a field here.
    pub(super) hook: Vec<u32>,
    /// First offset of each `let` in sight on which an effect acts.
    pub(super) lets: Vec<Option<usize>>,
    /// A further error of every row, where one was added to the model.
    pub(super) error: Option<Error>,
    /// A row that is left out of the density.
    pub(super) left_out: Option<usize>,
}

/// Where the further error of the rows lives in `v`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Error {
    /// Its sd.
    pub(super) sd: usize,
    /// The first of the values that are, for each row, ln of a factor of the sd.
    pub(super) scatter: Option<usize>,
}

/// How many numbers of a row belong to its further error: the sd, and ln of its factor.
pub(super) const ERROR: usize = 2;

impl Place {
    /// See [`Rows::locals`](super::rows::Rows::locals).
    pub(super) fn locals(&self, i: usize) -> Vec<(usize, usize)> {
        let w = self.width;
        let hook = |j: usize| self.hook.get(i * w + j).map_or(0, |at| *at as usize);
        let value = |j: usize| (self.index[i * w + j] as usize, hook(j));
        let lets = self.lets.iter().flatten().map(|at| (at + i, 0));
        let error = self.error.iter().flat_map(|e| [Some(e.sd), e.scatter.map(|at| at + i)]);
        (0..w).map(value).chain(lets).chain(error.flatten().map(|at| (at, 0))).collect()
    }

    /// For each of [`Place::locals`], which of the numbers of a row it is. The offset of a `let`
    /// that nobody sets is not among them.
    pub(super) fn slots(&self) -> Vec<usize> {
        let lets = self.lets.iter().enumerate().filter(|(_, at)| at.is_some());
        let error = self.error.iter().flat_map(|e| [true, e.scatter.is_some()]).enumerate();
        let error = error.filter(|(_, is)| *is).map(|(k, _)| self.error_slot() + k);
        (0..self.width).chain(lets.map(|(j, _)| self.width + j)).chain(error).collect()
    }

    /// Which of the numbers of a row is the sd of its further error. The last one, which follows,
    /// is ln of a factor of it. Both are 0 if there is no such error.
    pub(super) fn error_slot(&self) -> usize {
        self.width + self.lets.len()
    }

    /// How many numbers a row has.
    pub(super) fn n_numbers(&self) -> usize {
        self.error_slot() + ERROR
    }

    /// The numbers of a row from those of [`Place::locals`].
    pub(super) fn numbers(&self, locals: &[f64]) -> Vec<f64> {
        let mut numbers = vec![0.0; self.n_numbers()];
        self.slots().into_iter().zip(locals).for_each(|(slot, x)| numbers[slot] = *x);
        numbers
    }

    /// The numbers of row `i`.
    pub(super) fn numbers_at(&self, v: &[f64], i: usize) -> Vec<f64> {
        let mut numbers = vec![0.0; self.n_numbers()];
        self.fill(v, i, &mut numbers);
        numbers
    }

    /// As [`Place::numbers_at`], but writes into `numbers`.
    pub(super) fn fill(&self, v: &[f64], i: usize, numbers: &mut [f64]) {
        let (own, lets) = numbers.split_at_mut(self.width);
        for (x, at) in own.iter_mut().zip(&self.index[i * self.width..]) {
            *x = v[*at as usize];
        }
        for (x, at) in own.iter_mut().zip(self.hook.get(i * self.width..).unwrap_or_default()) {
            *x += v[*at as usize];
        }
        for (x, at) in lets.iter_mut().zip(&self.lets) {
            *x = at.map_or(0.0, |at| v[at + i]);
        }
        let slot = self.error_slot();
        numbers[slot] = self.error.map_or(0.0, |error| v[error.sd]);
        numbers[slot + 1] = self.error.and_then(|e| e.scatter).map_or(0.0, |at| v[at + i]);
    }
}
