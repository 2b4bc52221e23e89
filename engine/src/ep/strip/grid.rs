//! The nodes of a strip.

use thiserror::Error;

/// CV and APD are taken over the nodes closer than this to the strip's middle, mm.
pub(super) const MIDDLE_HALF_WIDTH: f64 = 3.0;

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
    pub(super) fn columns(&self) -> usize {
        self.n_across.div_ceil(2)
    }

    pub(super) fn stimulated_rows(&self) -> usize {
        (STIMULATED / self.spacing).round() as usize + 1
    }

    pub(super) fn steps_per_ms(&self) -> usize {
        (1.0 / self.dt).round() as usize
    }

    pub(super) fn pulse_steps(&self) -> usize {
        (PULSE / self.dt).round() as usize
    }
}
