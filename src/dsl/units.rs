//! A statement's name, unit and text, and the units a model file may declare.

/// A statement's name, unit and text, for tables and for `eplat show`.
#[derive(Clone, Copy, Debug)]
pub struct Decl {
    /// Declared name.
    pub name: &'static str,
    /// Declared unit, empty if none.
    pub unit: &'static str,
    /// The rest of the statement, as the compiler prints its tokens.
    pub text: &'static str,
    /// The doc comment above the statement.
    pub doc: &'static str,
}

/// Units that a model file may declare.
pub(super) const UNITS: &[&str] = &[
    "1", "ms", "s", "min", "mm", "cm", "m", "mm/ms", "m/s", "ms/mm", "mm2/ms", "Hz", "mV", "mA",
    "g", "ohm", "degC", "deg", "%",
];

impl Decl {
    /// Evaluated at compile time, so that a misspelt unit is a compile error.
    pub const fn new(
        name: &'static str,
        unit: &'static str,
        text: &'static str,
        doc: &'static str,
    ) -> Self {
        assert!(
            unit.is_empty() || is_known(unit),
            "unknown unit: expected one of 1, ms, s, min, mm, cm, m, mm/ms, m/s, ms/mm, mm2/ms, Hz, mV, mA, g, ohm, degC, deg, %"
        );
        Self { name, unit, text, doc }
    }

    /// The unit without the blanks that the compiler prints between its tokens.
    pub(super) fn unit(&self) -> String {
        self.unit.replace(' ', "")
    }
}

const fn is_known(unit: &str) -> bool {
    let mut i = 0;
    while i < UNITS.len() {
        if same_but_for_blanks(unit.as_bytes(), UNITS[i].as_bytes()) {
            return true;
        }
        i += 1;
    }
    false
}

const fn same_but_for_blanks(printed: &[u8], unit: &[u8]) -> bool {
    let (mut i, mut j) = (0, 0);
    while i < printed.len() {
        if printed[i] != b' ' {
            if j == unit.len() || printed[i] != unit[j] {
                return false;
            }
            j += 1;
        }
        i += 1;
    }
    j == unit.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_compared_without_blanks() {
        assert!(is_known("m / s") && is_known("ms") && is_known("%"));
        assert!(!is_known("msec") && !is_known("m /") && !is_known("mm / s"));
    }
}
