//! What a chain goes on from between two transitions.

use super::hamiltonian::Metric;
use serde::{Deserialize, Serialize};

/// The state of a chain between two transitions, without its density. Everything else in a
/// [`Kernel`](super::kernel::Kernel) is scratch memory.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct KernelState {
    pub(super) position: Vec<f64>,
    pub(super) gradient: Vec<f64>,
    pub(super) ln_density: f64,
    pub(super) metric: Metric,
    /// How many words were drawn from the random stream.
    pub(super) word: u128,
    /// Evaluations of the density so far.
    pub(super) n_evaluations: u64,
}

impl KernelState {
    /// Whether it is a state in `dim` coordinates.
    pub(super) fn fits(&self, dim: usize) -> bool {
        [self.position.len(), self.gradient.len()] == [dim; 2] && self.metric.fits(dim)
    }
}
