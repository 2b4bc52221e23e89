//! The unit a mesh file's coordinates are in: files do not say, so the user must.

use super::MeshError;
use std::fmt;
use std::str::FromStr;

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
}
