//! From values to colours, by palettes in which equal steps look equal.
//!
//! # Source
//! Viridis and magma: matplotlib, CC0. The ends of the diverging one: Okabe and Ito, distinguishable without
//! red–green vision.

/// Red, green, blue.
pub(crate) type Colour = [u8; 3];

/// What a palette is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Palette {
    /// Values: dark blue through green to yellow.
    Values,
    /// Uncertainty and shares: black through red to light yellow.
    Spread,
    /// Differences: blue below zero, orange above.
    Difference,
}

/// Of a vertex without a value.
pub(super) const VOID: Colour = [176, 176, 176];

const VIRIDIS: [u32; 17] = [
    0x440154, 0x48186a, 0x472d7b, 0x424086, 0x3b528b, 0x33638d, 0x2c728e, 0x26828e, 0x21918c,
    0x1fa088, 0x28ae80, 0x3fbc73, 0x5ec962, 0x84d44b, 0xaddc30, 0xd8e219, 0xfde725,
];
const MAGMA: [u32; 17] = [
    0x000004, 0x0a0822, 0x1d1147, 0x36106b, 0x51127c, 0x6a1c81, 0x832681, 0x9c2e7f, 0xb73779,
    0xd0416f, 0xe75263, 0xf56b5c, 0xfc8961, 0xfea772, 0xfec488, 0xfde2a3, 0xfcfdbf,
];
const BLUE_TO_ORANGE: [u32; 3] = [0x0072b2, 0xfafaf7, 0xd55e00];

impl Palette {
    /// Colour at this share of the range; that of the nearer end beyond it, grey without a value.
    pub(crate) fn colour(self, share: f64) -> Colour {
        let stops: &[u32] = match self {
            Self::Values => &VIRIDIS,
            Self::Spread => &MAGMA,
            Self::Difference => &BLUE_TO_ORANGE,
        };
        if share.is_nan() {
            return VOID;
        }
        let at = share.clamp(0.0, 1.0) * (stops.len() - 1) as f64;
        let below = (at as usize).min(stops.len() - 2);
        mixed(channels(stops[below]), channels(stops[below + 1]), at - below as f64)
    }
}

fn channels(colour: u32) -> Colour {
    let [_, r, g, b] = colour.to_be_bytes();
    [r, g, b]
}

/// `from`, and this share of the way to `to`.
pub(super) fn mixed(from: Colour, to: Colour, share: f64) -> Colour {
    // Each by itself, for each of millions of samples: `from_fn` is not inlined in this crate. A half more, to round:
    // `f64::round` is a call of the C library.
    let one = |from: u8, to: u8| {
        let (from, to) = (f64::from(from), f64::from(to));
        (from + share * (to - from) + 0.5) as u8
    };
    [one(from[0], to[0]), one(from[1], to[1]), one(from[2], to[2])]
}

/// As SVG writes it.
pub(super) fn hex([r, g, b]: Colour) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn palettes_have_their_ends_and_middles() {
        assert_eq!(hex(Palette::Values.colour(0.0)), "#440154");
        assert_eq!(hex(Palette::Values.colour(0.5)), "#21918c");
        assert_eq!(hex(Palette::Spread.colour(7.0)), "#fcfdbf");
        assert_eq!(hex(Palette::Difference.colour(0.5)), "#fafaf7");
        assert_eq!(Palette::Values.colour(f64::NAN), VOID);
    }

    #[test]
    fn lightness_rises_along_sequential_palettes() {
        for palette in [Palette::Values, Palette::Spread] {
            // relative luminance, without gamma: enough for the order
            let light = |i: u32| {
                let [r, g, b] = palette.colour(f64::from(i) / 16.0).map(f64::from);
                0.2126 * r + 0.7152 * g + 0.0722 * b
            };
            assert!((1..=16).all(|i| light(i) > light(i - 1)), "{palette:?}");
        }
    }
}
