//! A strip of tissue paced from one end: CV, APD90 and the effective refractory periods.
//!
//! 24.0 × 0.6 mm, 81 × 3 nodes, P1 elements with consistent mass, no-flux boundary, split time
//! steps; set up like the reference simulations (openCARP) on which the ERP surrogates rest.
//! Many parameter sets are run eight at a time as vector lanes, the batches in parallel; the
//! outcome of a set depends on nothing but the set.
//!
//! # Source
//! Coveney et al. 2022, Methods, "surrogate simulation"; details found by comparison with the
//! authors' published tables.

mod fem;
mod lanes;
mod record;
mod search;
mod tissue;

use rayon::prelude::*;
use thiserror::Error;

use super::cell::Tissue;
use super::protocol::{Protocol, ProtocolError};
use fem::Matrices;
use lanes::LANES;
use search::Pacer;

/// Resolution of the strip in space and time.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    /// Nodes along the strip.
    pub n_along: usize,
    /// Distance of neighbouring nodes, mm.
    pub spacing: f64,
    /// Diffusion time step, ms; a whole number of them make 1 ms.
    pub dt: f64,
}

impl Default for Grid {
    fn default() -> Self {
        Self { n_along: 81, spacing: 0.3, dt: 0.1 }
    }
}

impl Grid {
    /// Length of the strip, mm.
    pub fn length(&self) -> f64 {
        (self.n_along - 1) as f64 * self.spacing
    }

    fn steps_per_ms(&self) -> usize {
        (1.0 / self.dt).round() as usize
    }

    /// A nominal 1 ms stimulus acts for one step less than 1 ms in the reference simulations.
    fn pulse_steps(&self) -> usize {
        self.steps_per_ms() - 1
    }
}

/// What one conditioning beat did in the middle of the strip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Beat {
    /// Conduction velocity, m/s (= mm/ms).
    pub cv: f64,
    /// Action potential duration at 90 % recovery, ms.
    pub apd90: f64,
}

/// Why a quantity has no value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum Absence {
    /// A conditioning stimulus did not activate every node.
    #[error("the conditioning stimulus did not activate the whole strip")]
    NoActivation,
    /// A conditioned beat did not recover everywhere within S1.
    #[error("the conditioned beat did not recover within S1")]
    NoRecovery,
    /// The shortest interval already captures.
    #[error("the shortest interval already captures")]
    AlwaysCaptures,
    /// The longest interval still fails.
    #[error("the longest interval still fails")]
    NeverCaptures,
}

/// Everything one parameter set yields; an ERP is the largest whole interval (ms) that fails.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StripOutcome {
    /// The last S1 beat.
    pub s1: Result<Beat, Absence>,
    /// ERP under S1S2, ms.
    pub erp_s2: Result<u32, Absence>,
    /// The conditioning S2 beat of S1S2S3.
    pub s2: Result<Beat, Absence>,
    /// ERP under S1S2S3, ms.
    pub erp_s3: Result<u32, Absence>,
}

/// Runs `protocol` on one default strip for each of `tissues`; `progress` is told how many are done.
///
/// Outcomes are in the order of `tissues` and bit-identical for any number of threads and any grouping.
///
/// # Errors
/// A protocol that cannot be paced.
pub fn simulate_strips(
    tissues: &[Tissue],
    protocol: &Protocol,
    progress: &(dyn Fn(usize) + Sync),
) -> Result<Vec<StripOutcome>, ProtocolError> {
    protocol.validate()?;
    let grid = Grid::default();
    let matrices = Matrices::assemble(grid.n_along);
    let batches: Vec<_> = tissues
        .par_chunks(LANES)
        .map(|batch| {
            // A last, incomplete batch is filled up with its final set.
            let lanes = std::array::from_fn(|k| batch[k.min(batch.len() - 1)]);
            let outcomes = Pacer::new(&grid, protocol, &matrices, &lanes).run();
            progress(batch.len());
            outcomes[..batch.len()].to_vec()
        })
        .collect();
    Ok(batches.concat())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ep::Parameters;

    /// One conditioning beat instead of eight: the same code in a fraction of the time.
    fn quick() -> Protocol {
        Protocol { n_beats: 1, ..Protocol::default() }
    }

    fn tissues() -> Vec<Tissue> {
        let tissue = |i: u32| {
            let x = f64::from(i) / 10.0;
            Parameters::from_array([0.4 + x, 0.05, 2.0 + 20.0 * x, 120.0, 130.0 + 130.0 * x])
                .tissue()
        };
        (0..11).map(tissue).collect()
    }

    #[test]
    fn outcomes_depend_neither_on_threads_nor_on_neighbours() {
        let mut tissues = tissues();
        let run = |tissues: &[Tissue], n_threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
            pool.install(|| simulate_strips(tissues, &quick(), &|_| ())).unwrap()
        };
        let one = run(&tissues, 1);
        assert_eq!(one, run(&tissues, 3));
        tissues.reverse();
        let mut reversed = run(&tissues, 2);
        reversed.reverse();
        assert_eq!(one, reversed);
        assert!(one.iter().any(|outcome| outcome.erp_s3.is_ok()));
        assert!(one.iter().any(|outcome| outcome.erp_s3 == Err(Absence::NoActivation)));
    }

    #[test]
    fn an_erp_is_the_last_interval_that_fails() {
        let erp = |protocol: &Protocol| {
            let outcome = simulate_strips(&tissues()[4..5], protocol, &|_| ()).unwrap()[0];
            outcome.erp_s2
        };
        let found = erp(&quick()).unwrap();
        // Searches that just contain it, or just miss it on either side.
        assert_eq!(erp(&Protocol { shortest: found, longest: found + 1, ..quick() }), Ok(found));
        let late = Protocol { shortest: found + 1, longest: found + 20, ..quick() };
        assert_eq!(erp(&late), Err(Absence::AlwaysCaptures));
        let early = Protocol { shortest: found - 20, longest: found, ..quick() };
        assert_eq!(erp(&early), Err(Absence::NeverCaptures));
        let weak = Protocol { conditioning_strength: 0.05, ..quick() };
        assert_eq!(erp(&weak), Err(Absence::NoActivation));
    }

    #[test]
    fn a_protocol_that_cannot_be_paced_is_refused() {
        let protocol = Protocol { shortest: 0, ..quick() };
        assert!(simulate_strips(&tissues(), &protocol, &|_| ()).is_err());
    }
}
