//! How vertices are reached, and the number of what is not there.

/// No triangle, no vertex.
pub(super) const NONE: u32 = u32::MAX;

/// How a vertex is reached.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) enum Way {
    /// It is not.
    #[default]
    Never,
    /// Along this straight line from a source, or it is the source.
    Ray(u32),
    /// Along a side of `triangle`, to its corner `to` from the end number `end` of the side opposite that.
    Along { triangle: u32, to: u8, end: u8 },
    /// Across the side opposite the corner `to`, with a round or a plane front.
    Across { triangle: u32, to: u8, is_round: bool },
}
