//! A strip of tissue paced from one end: CV, APD90 and the effective refractory periods.
//!
//! 24.0 × 0.6 mm unless told otherwise, 81 × 3 nodes, P1 elements with consistent mass, no-flux
//! boundary, split time steps; set up like the reference simulations (openCARP) on which the ERP
//! surrogates rest.
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
use record::MIDDLE_HALF_WIDTH;
use search::Pacer;

/// Size of the strip, and its resolution in space and time.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    /// Nodes along the strip.
    pub n_along: usize,
    /// Nodes across it: 1 (a cable), or an odd number up to 9.
    pub n_across: usize,
    /// Distance of neighbouring nodes, mm.
    pub spacing: f64,
    /// Diffusion time step, ms; a whole number of them make 1 ms.
    pub dt: f64,
}

impl Default for Grid {
    fn default() -> Self {
        Self { n_along: 81, n_across: 3, spacing: 0.3, dt: 0.1 }
    }
}

/// A strip that cannot be simulated.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum GridError {
    /// Not a cable, and no odd number of columns up to 9.
    #[error(
        "a strip of {n_across} nodes across cannot be simulated\n\
         help: give a width of 2, 4, 6 or 8 times the spacing, or 0 for a cable"
    )]
    Across {
        /// Nodes across.
        n_across: usize,
    },
    /// Too short to measure in its middle.
    #[error(
        "a strip of {length} mm is too short: CV and APD are measured within {MIDDLE_HALF_WIDTH} mm of its middle, \
         away from its ends\nhelp: give a length of at least {SHORTEST_STRIP} mm"
    )]
    Length {
        /// Length, mm.
        length: f64,
    },
    /// A length or width that is no whole number of spacings.
    #[error(
        "--{name} {extent} is no multiple of the spacing {spacing}\n\
         help: nodes lie a spacing apart; give a multiple, or another --spacing"
    )]
    Extent {
        /// `length` or `width`.
        name: &'static str,
        /// What it was to be, mm.
        extent: f64,
        /// Spacing, mm.
        spacing: f64,
    },
    /// A time step of which no whole number makes 1 ms, or spacing that is no positive number.
    #[error(
        "a spacing of {spacing} mm with time steps of {dt} ms cannot be simulated\n\
         help: give a positive spacing, and a time step of which a whole number (at least 2) makes 1 ms"
    )]
    Resolution {
        /// Spacing, mm.
        spacing: f64,
        /// Time step, ms.
        dt: f64,
    },
}

/// A strip, or its pacing, that is impossible.
#[derive(Debug, Clone, PartialEq, Error)]
#[error(transparent)]
pub enum StripError {
    /// The pacing.
    Protocol(#[from] ProtocolError),
    /// The strip.
    Grid(#[from] GridError),
}

/// Shortest strip, mm: its middle, and 1.5 mm on either side.
const SHORTEST_STRIP: f64 = 9.0;

/// How much of the strip's start a stimulus excites, mm.
const STIMULATED: f64 = 0.3;

/// How long a nominal 1 ms stimulus acts in the reference simulations, ms.
const PULSE: f64 = 0.9;

impl Grid {
    /// A strip of this length and width (mm; a width of 0 makes a cable).
    ///
    /// # Errors
    /// [`GridError::Extent`]. What else may be wrong is found by [`Grid::validate`].
    pub fn of_size([length, width]: [f64; 2], spacing: f64, dt: f64) -> Result<Self, GridError> {
        let nodes = |name, extent: f64| {
            let n = extent / spacing;
            if !(n >= 0.0 && (n - n.round()).abs() < 1e-6) {
                return Err(GridError::Extent { name, extent, spacing });
            }
            Ok(n.round() as usize + 1)
        };
        Ok(Self {
            n_along: nodes("length", length)?,
            n_across: nodes("width", width)?,
            spacing,
            dt,
        })
    }

    /// Length of the strip, mm.
    pub fn length(&self) -> f64 {
        (self.n_along - 1) as f64 * self.spacing
    }

    /// Checks that such a strip can be simulated.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn validate(&self) -> Result<(), GridError> {
        let &Self { n_across, spacing, dt, .. } = self;
        let per_ms = 1.0 / dt;
        if !(spacing > 0.0 && per_ms >= 2.0 && (per_ms - per_ms.round()).abs() < 1e-9 * per_ms) {
            return Err(GridError::Resolution { spacing, dt });
        }
        if !(n_across < 10 && n_across % 2 == 1) {
            return Err(GridError::Across { n_across });
        }
        if self.length() < SHORTEST_STRIP - 1e-9 {
            return Err(GridError::Length { length: self.length() });
        }
        Ok(())
    }

    /// Columns of unknowns: the strip is folded about its middle column.
    fn columns(&self) -> usize {
        self.n_across.div_ceil(2)
    }

    fn stimulated_rows(&self) -> usize {
        (STIMULATED / self.spacing).round() as usize + 1
    }

    fn steps_per_ms(&self) -> usize {
        (1.0 / self.dt).round() as usize
    }

    fn pulse_steps(&self) -> usize {
        (PULSE / self.dt).round() as usize
    }
}

/// What one conditioning beat did in the middle of the strip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Beat {
    /// Conduction velocity, m/s (= mm/ms).
    pub cv: f64,
    /// Action potential duration at 20 % recovery, ms; absent where V did not rise above 0.8.
    pub apd20: Option<f64>,
    /// At 30 % recovery, ms.
    pub apd30: Option<f64>,
    /// At 50 % recovery, ms.
    pub apd50: Option<f64>,
    /// At 90 % recovery, ms.
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
#[derive(Debug, Clone, PartialEq)]
pub struct StripOutcome {
    /// The last S1 beat.
    pub s1: Result<Beat, Absence>,
    /// ERP under S1S2, ms.
    pub erp_s2: Result<u32, Absence>,
    /// The conditioning S2 beat of S1S2S3.
    pub s2: Result<Beat, Absence>,
    /// ERP under S1S2S3, ms.
    pub erp_s3: Result<u32, Absence>,
    /// The S2 beats of the protocol's restitution curve: interval (ms) and what they did.
    pub restitution: Vec<(u32, Result<Beat, Absence>)>,
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
