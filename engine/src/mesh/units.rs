//! The unit a mesh file's coordinates are in: few files say it, so it is given or guessed.

use super::MeshError;
use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;

/// How far across the surface of an atrium is, mm. A tenfold larger one would not fit, so at most one
/// unit makes a shape an atrium.
const ATRIUM: RangeInclusive<f64> = 30.0..=150.0;

/// A unit of length.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Units {
    /// Millimetres.
    Mm,
    /// Centimetres.
    Cm,
    /// Micrometres (openCARP's unit).
    Um,
    /// Metres.
    M,
}

impl Units {
    /// All units.
    pub const ALL: [Self; 4] = [Self::Mm, Self::Cm, Self::Um, Self::M];

    /// Millimetres in one of this unit.
    pub fn in_mm(self) -> f64 {
        match self {
            Self::Mm => 1.0,
            Self::Cm => 10.0,
            Self::Um => 1e-3,
            Self::M => 1e3,
        }
    }

    /// The unit in which something `across` long is as large as an atrium, 30 to 150 mm.
    pub(super) fn of_an_atrium(across: f64) -> Option<Self> {
        Self::ALL.into_iter().find(|units| ATRIUM.contains(&(across * units.in_mm())))
    }

    /// The unit named in a comment of a file, as `lengths in mm` or `surface in mm`.
    pub(super) fn in_comment(text: &str) -> Option<Self> {
        let mut words = text.split_whitespace();
        while let Some(word) = words.next() {
            if matches!(word, "lengths" | "surface") && words.next() == Some("in") {
                return words.next()?.parse().ok();
            }
        }
        None
    }
}

/// How the unit of a file is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Known {
    /// The user said it.
    Given,
    /// The file says it, or its format has no other.
    Told,
    /// The surface is as large as an atrium in this unit.
    Guessed,
}

impl Known {
    /// What follows "read as mm" in a note.
    pub(super) fn because(self) -> &'static str {
        match self {
            Self::Given => "",
            Self::Told => ", as the file or its format says (another: --units)",
            Self::Guessed => ", guessed from its size (another: --units)",
        }
    }
}

impl fmt::Display for Units {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Mm => "mm",
            Self::Cm => "cm",
            Self::Um => "um",
            Self::M => "m",
        })
    }
}

impl FromStr for Units {
    type Err = MeshError;

    fn from_str(name: &str) -> Result<Self, MeshError> {
        Self::ALL
            .into_iter()
            .find(|units| units.to_string() == name)
            .ok_or_else(|| MeshError::UnknownUnits { name: name.into() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_round_trip() {
        for units in Units::ALL {
            assert_eq!(units.to_string().parse::<Units>().unwrap(), units);
        }
    }

    #[test]
    fn an_unknown_unit_names_the_known_ones() {
        let text = "inch".parse::<Units>().unwrap_err().to_string();
        assert_eq!(
            text,
            "unknown unit \"inch\", expected one of mm, cm, um, m\n\
             help: say --units mm for a mesh in millimetres"
        );
    }

    #[test]
    fn an_atrium_is_known_by_its_size_in_every_unit() {
        for units in Units::ALL {
            for mm in [30.0, 78.0, 120.0, 150.0] {
                assert_eq!(
                    Units::of_an_atrium(mm / units.in_mm() * 1.000_001),
                    Some(units).filter(|_| mm < 150.0)
                );
            }
        }
        assert_eq!(Units::of_an_atrium(20.0), None);
        assert_eq!(Units::of_an_atrium(f64::NAN), None);
    }

    #[test]
    fn a_comment_tells_the_unit() {
        assert_eq!(Units::in_comment("eplat: lengths in mm"), Some(Units::Mm));
        assert_eq!(Units::in_comment("surface in cm "), Some(Units::Cm));
        assert_eq!(Units::in_comment("vtk output"), None);
        assert_eq!(Units::in_comment("lengths in inches"), None);
    }
}
