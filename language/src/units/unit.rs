//! A unit of measurement as powers of base units and a scale.

use std::fmt;

/// Base units, and units that are a power of one or a multiple: `(name, base, power, scale)`.
const NAMES: &[(&str, usize, i32, f64)] = &[
    ("ms", 0, 1, 1.0),
    ("s", 0, 1, 1e3),
    ("min", 0, 1, 6e4),
    ("Hz", 0, -1, 1e-3),
    ("mm", 1, 1, 1.0),
    ("cm", 1, 1, 10.0),
    ("m", 1, 1, 1e3),
    ("mV", 2, 1, 1.0),
    ("mA", 3, 1, 1.0),
    ("g", 4, 1, 1.0),
    ("deg", 5, 1, 1.0),
    ("rad", 5, 1, 180.0 / std::f64::consts::PI),
    ("degC", 6, 1, 1.0),
];

const N_BASES: usize = 7;

/// Powers of the base units, and how many of their product one of it is: m/s = mm/ms, but s ≠ ms.
#[derive(Clone, Copy, Debug)]
pub(super) struct Unit {
    powers: [i32; N_BASES],
    /// Unknown after a product with a plain number, which may have converted it.
    scale: Option<f64>,
}

impl Unit {
    /// The unit written in square brackets; `None` where nothing is written.
    pub(super) fn parse(text: &str) -> Option<Self> {
        let (above, below) = text.split_once('/').unwrap_or((text, "1"));
        Some(factor(above.trim())?.times(factor(below.trim())?, -1))
    }

    /// `self · other^power`.
    pub(super) fn times(self, other: Self, power: i32) -> Self {
        Self {
            powers: std::array::from_fn(|i| self.powers[i] + power * other.powers[i]),
            scale: self.scale.zip(other.scale).map(|(a, b)| a * b.powi(power)),
        }
    }

    /// `1`.
    pub(super) fn one() -> Self {
        Self { powers: [0; N_BASES], scale: Some(1.0) }
    }

    /// `self^power`.
    pub(super) fn powi(self, power: i32) -> Self {
        Self::one().times(self, power)
    }

    /// The square root, where the powers are even.
    pub(super) fn sqrt(self) -> Option<Self> {
        let is_even = self.powers.iter().all(|p| p % 2 == 0);
        is_even
            .then(|| Self { powers: self.powers.map(|p| p / 2), scale: self.scale.map(f64::sqrt) })
    }

    /// Whether it is a power of nothing.
    pub(super) fn is_dimensionless(self) -> bool {
        self.powers == [0; N_BASES]
    }

    /// The same after a product with a plain number.
    pub(super) fn rescaled(self) -> Self {
        Self { scale: None, ..self }
    }

    /// Whether the two may be the same.
    pub(super) fn agrees(self, other: Self) -> bool {
        let differ = |(a, b): (f64, f64)| (a / b - 1.0).abs() > 1e-9;
        self.powers == other.powers && !self.scale.zip(other.scale).is_some_and(differ)
    }
}

/// One side of a slash: `ms`, `mm2`, `ohm`, `1`.
fn factor(text: &str) -> Option<Unit> {
    let (name, power) = match text.strip_suffix('2') {
        Some(name) => (name, 2),
        None => (text, 1),
    };
    let unit = match name {
        "1" => Unit::one(),
        "%" => Unit::one().rescaled(),
        "ohm" => factor("mV")?.times(factor("mA")?, -1),
        _ => {
            let &(_, base, power, scale) = NAMES.iter().find(|(n, ..)| *n == name)?;
            let powers = std::array::from_fn(|i| if i == base { power } else { 0 });
            Unit { powers, scale: Some(scale) }
        }
    };
    Some(unit.powi(power))
}

impl fmt::Display for Unit {
    /// As it would be declared, `[m/s]`, or as a product of base units.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = NAMES.iter().map(|(name, ..)| *name);
        let simple = ["1", "ohm", "m/s", "ms2", "mm2", "1/ms", "1/mm"].into_iter().chain(names);
        if let Some(name) =
            simple.into_iter().find(|n| Self::parse(n).is_some_and(|u| u.agrees(*self)))
        {
            return write!(f, "[{name}]");
        }
        let side = |sign: i32| {
            let bases = NAMES.iter().filter(|(.., power, scale)| *power == 1 && *scale <= 1.0);
            let factors = bases.filter_map(|&(name, base, ..)| match sign * self.powers[base] {
                p if p <= 0 => None,
                1 => Some(name.into()),
                p => Some(format!("{name}{p}")),
            });
            factors.collect::<Vec<String>>().join("·")
        };
        let scale = self
            .scale
            .filter(|s| (s - 1.0).abs() > 1e-9)
            .map_or(String::new(), |s| format!("{s} "));
        let (above, below) = (side(1), side(-1));
        let above = if above.is_empty() { "1".into() } else { above };
        let below = if below.is_empty() { below } else { format!("/{below}") };
        write!(f, "[{scale}{above}{below}]")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_unit_of_the_language_is_understood_and_told_apart() {
        let names = "1 ms ms2 s min mm mm2 cm m Hz mV mA g ohm deg degC m/s mm2/ms 1/ms ms/mm";
        let units: Vec<Unit> = names.split(' ').map(|n| Unit::parse(n).unwrap()).collect();
        for (i, a) in units.iter().enumerate() {
            for (j, b) in units.iter().enumerate() {
                assert_eq!(a.agrees(*b), i == j, "{a} {b}");
            }
        }
        assert!(Unit::parse("%").unwrap().agrees(Unit::one()));
        assert!(Unit::parse("Hz").unwrap().agrees(Unit::parse("1/s").unwrap()));
        assert!(Unit::parse("").is_none() && Unit::parse("furlong").is_none());
    }
}
