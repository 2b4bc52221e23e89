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

    /// Whether the numbers of a row are more than those that carry derivatives in any case.
    pub(super) fn has_added(&self) -> bool {
        self.error.is_some() || self.lets.iter().any(Option::is_some)
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
        (0..self.n_numbers()).map(|slot| self.number(v, i, slot)).collect()
    }

    /// Where in `v` a number of row `i` lives, if anywhere, and the offset that is added to it.
    fn of_number(&self, i: usize, slot: usize) -> [Option<usize>; 2] {
        let w = self.width;
        if slot < w {
            let at = i * w + slot;
            return [Some(self.index[at] as usize), self.hook.get(at).map(|at| *at as usize)];
        }
        let at = match (self.lets.get(slot - w), self.error) {
            (Some(at), _) => at.map(|at| at + i),
            (None, error) if slot == self.error_slot() => error.map(|error| error.sd),
            (None, error) => error.and_then(|error| error.scatter).map(|at| at + i),
        };
        [at, None]
    }

    /// A number of row `i`.
    pub(super) fn number(&self, v: &[f64], i: usize, slot: usize) -> f64 {
        self.of_number(i, slot).into_iter().flatten().map(|at| v[at]).sum()
    }

    /// Adds a derivative in a number of row `i` to the adjoint.
    pub(super) fn add_slope(&self, g: &mut [f64], i: usize, slot: usize, slope: f64) {
        self.of_number(i, slot).into_iter().flatten().for_each(|at| g[at] += slope);
    }
}
