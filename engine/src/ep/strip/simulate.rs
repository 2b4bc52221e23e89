//! Many strips, eight at a time.

use rayon::prelude::*;
use thiserror::Error;

use super::fem::Matrices;
use super::lanes::LANES;
use super::search::Pacer;
use super::{Grid, GridError, StripOutcome};
use crate::ep::cell::Tissue;
use crate::ep::protocol::{Protocol, ProtocolError};

/// A strip, or its pacing, that is impossible.
#[derive(Debug, Clone, PartialEq, Error)]
#[error(transparent)]
pub enum StripError {
    /// The pacing.
    Protocol(#[from] ProtocolError),
    /// The strip.
    Grid(#[from] GridError),
}

/// Runs `protocol` on a strip of each of `tissues`; `progress` is told how many are done.
///
/// Outcomes are in the order of `tissues` and bit-identical for any number of threads and any grouping.
///
/// # Errors
/// A protocol that cannot be paced, or an impossible strip.
pub fn simulate_strips(
    tissues: &[Tissue],
    grid: &Grid,
    protocol: &Protocol,
    progress: &(dyn Fn(usize) + Sync),
) -> Result<Vec<StripOutcome>, StripError> {
    protocol.validate()?;
    grid.validate()?;
    let run = match grid.n_across {
        1 => batches::<1>,
        3 => batches::<3>,
        5 => batches::<4>,
        7 => batches::<5>,
        _ => batches::<6>,
    };
    Ok(run(tissues, grid, protocol, progress))
}

/// All tissues, [`LANES`] at a time; `B` is the matrices' half-bandwidth.
fn batches<const B: usize>(
    tissues: &[Tissue],
    grid: &Grid,
    protocol: &Protocol,
    progress: &(dyn Fn(usize) + Sync),
) -> Vec<StripOutcome> {
    let matrices = Matrices::<B>::assemble(grid);
    // Strips that rest and recover together leave few of a batch's lanes waiting.
    let mut order: Vec<usize> = (0..tissues.len()).collect();
    order.sort_by(|&a, &b| {
        tissues[a].parameters().apd_max.total_cmp(&tissues[b].parameters().apd_max)
    });
    let run = |batch: &[usize]| {
        // A last, incomplete batch is filled up with its final set.
        let lanes = std::array::from_fn(|k| tissues[batch[k.min(batch.len() - 1)]]);
        let outcomes = Pacer::new(grid, protocol, &matrices, &lanes).run();
        progress(batch.len());
        batch.iter().copied().zip(outcomes).collect()
    };
    let batches: Vec<Vec<_>> = order.par_chunks(LANES).map(run).collect();
    let mut numbered = batches.concat();
    numbered.sort_by_key(|(i, _)| *i);
    numbered.into_iter().map(|(_, outcome)| outcome).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ep::Parameters;
    use crate::ep::strip::Absence;

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
            pool.install(|| simulate_strips(tissues, &Grid::default(), &quick(), &|_| ())).unwrap()
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
            let tissues = &tissues()[4..5];
            simulate_strips(tissues, &Grid::default(), protocol, &|_| ()).unwrap()[0].erp_s2
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
    fn what_cannot_be_paced_or_simulated_is_refused() {
        let refused = |grid: &Grid, protocol: &Protocol| {
            simulate_strips(&tissues(), grid, protocol, &|_| ()).unwrap_err()
        };
        let (grid, protocol) = (Grid::default(), Protocol { shortest: 0, ..quick() });
        assert!(matches!(refused(&grid, &protocol), StripError::Protocol(_)));
        let wide = Grid { n_across: 4, ..grid };
        assert_eq!(refused(&wide, &quick()), GridError::Across { n_across: 4 }.into());
        let uneven = Grid { dt: 0.3, ..Grid::default() };
        assert!(matches!(
            refused(&uneven, &quick()),
            StripError::Grid(GridError::Resolution { .. })
        ));
        let short = Grid { n_along: 20, ..Grid::default() };
        assert!(matches!(refused(&short, &quick()), StripError::Grid(GridError::Length { .. })));
    }

    #[test]
    fn a_wider_strip_of_uniform_tissue_does_as_the_reference() {
        let run = |n_across| {
            let grid = Grid { n_across, ..Grid::default() };
            simulate_strips(&tissues()[4..5], &grid, &quick(), &|_| ()).unwrap().remove(0)
        };
        let (reference, wide, cable) = (run(3), run(7), run(1));
        assert_eq!(reference.erp_s2, wide.erp_s2);
        let cv = |outcome: &StripOutcome| outcome.s1.unwrap().cv;
        assert!((cv(&wide) - cv(&reference)).abs() < 5e-4);
        // over 300 sets the largest difference is 0.011
        assert!((cv(&cable) - cv(&reference)).abs() < 0.012);
        assert!(cable.erp_s2.unwrap().abs_diff(reference.erp_s2.unwrap()) <= 2);
    }

    #[test]
    fn a_restitution_curve_has_the_beats_of_the_protocol() {
        let protocol = Protocol { restitution: vec![200, 300, 450, 600], ..quick() };
        let run = |protocol| {
            let tissues = &tissues()[1..2];
            simulate_strips(tissues, &Grid::default(), protocol, &|_| ()).unwrap().remove(0)
        };
        let outcome = run(&protocol);
        let at: Vec<u32> = outcome.restitution.iter().map(|(s2, _)| *s2).collect();
        assert_eq!(at, protocol.restitution);
        // the beat at 300 ms is the conditioning S2 of S1S2S3
        assert_eq!(outcome.restitution[1].1, outcome.s2);
        let [shorter, longer] = [1, 2].map(|i| outcome.restitution[i].1.unwrap());
        assert!(shorter.cv < longer.cv && shorter.apd90 < longer.apd90);
        assert_eq!(run(&quick()).erp_s3, outcome.erp_s3);
    }
}
