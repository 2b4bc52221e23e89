//! Pacing protocols: when stimuli are given, how strong they are, where an ERP is sought.
//!
//! Knows times and strengths only; it knows nothing of cells or meshes.

use thiserror::Error;

/// S1S2 and S1S2S3 pacing as the reference simulations use it.
///
/// Whole milliseconds, because an ERP is an integer interval.  A stimulus adds `strength · dt` to V
/// in every time step of its duration.
#[derive(Debug, Clone, PartialEq)]
pub struct Protocol {
    /// Interval of the S1 train, and the time a beat has to activate and repolarise the tissue, ms.
    pub s1: u32,
    /// Interval of the conditioning S2 of S1S2S3, ms.
    pub s2: u32,
    /// Beats of the S1 train.
    pub n_beats: u32,
    /// Strength of every conditioning stimulus, 1/ms.
    pub conditioning_strength: f64,
    /// Strength of the test stimulus whose ERP is sought, 1/ms.
    pub test_strength: f64,
    /// Shortest interval an ERP may have, ms.
    pub shortest: u32,
    /// Longest interval that is tried, ms.
    pub longest: u32,
    /// Intervals of the S2 beats, of conditioning strength, that make a restitution curve, ms.
    pub restitution: Vec<u32>,
}

impl Default for Protocol {
    fn default() -> Self {
        Self {
            s1: 600,
            s2: 300,
            n_beats: 8,
            conditioning_strength: 1.0,
            test_strength: 2.0,
            shortest: 50,
            longest: 500,
            restitution: vec![],
        }
    }
}

/// A protocol that cannot be paced.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ProtocolError {
    /// Without an S1 beat there is nothing to test.
    #[error("the S1 train has no beats\nhelp: give at least one beat; the reference has 8")]
    NoBeats,
    /// `0 < shortest < longest` and `0 < s2 < s1` do not hold.
    #[error(
        "the intervals do not nest: search {shortest} to {longest} ms, S2 {s2} ms, S1 {s1} ms\n\
         help: the search needs a shortest interval above 0 and below its longest, and S2 must be shorter than S1"
    )]
    Intervals {
        /// Shortest interval of the search, ms.
        shortest: u32,
        /// Longest interval of the search, ms.
        longest: u32,
        /// Conditioning S2, ms.
        s2: u32,
        /// S1, ms.
        s1: u32,
    },
    /// A stimulus that is no number, or does nothing.
    #[error(
        "a stimulus of {0} per ms excites nothing\nhelp: give strengths above 0; the reference paces with 1 and tests with 2"
    )]
    Strength(f64),
}

impl Protocol {
    /// Checks that the protocol can be paced.
    ///
    /// # Errors
    /// No beats, intervals that do not nest, or a stimulus that does nothing.
    pub fn validate(&self) -> Result<(), ProtocolError> {
        let &Self { s1, s2, shortest, longest, .. } = self;
        if self.n_beats == 0 {
            return Err(ProtocolError::NoBeats);
        }
        if !(0 < shortest && shortest < longest && 0 < s2 && s2 < s1) {
            return Err(ProtocolError::Intervals { shortest, longest, s2, s1 });
        }
        let strengths = [self.conditioning_strength, self.test_strength];
        match strengths.into_iter().find(|s| !(s.is_finite() && *s > 0.0)) {
            Some(strength) => Err(ProtocolError::Strength(strength)),
            None => Ok(()),
        }
    }

    /// The longest interval after a conditioning stimulus at which another may follow, ms.
    pub(super) fn last_interval(&self) -> u32 {
        self.restitution.iter().copied().fold(self.longest.max(self.s2), u32::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_can_be_paced_and_intervals_must_nest() {
        assert_eq!(Protocol::default().validate(), Ok(()));
        let short = Protocol { s1: 250, ..Protocol::default() };
        assert!(matches!(short.validate(), Err(ProtocolError::Intervals { s1: 250, .. })));
        let none = Protocol { n_beats: 0, ..Protocol::default() };
        assert_eq!(none.validate(), Err(ProtocolError::NoBeats));
    }
}
