//! Texts and numbers as they stand in pages and pictures.

/// Text as it may stand in a page.
pub(super) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// A unit as it is shown: nothing for a number without one.
pub(crate) fn shown(unit: &str) -> &str {
    if unit == "1" { "" } else { unit }
}

/// A unit after a number, with its space.
pub(crate) fn after_number(unit: &str) -> String {
    match shown(unit) {
        "" => String::new(),
        unit => format!(" {unit}"),
    }
}

/// Three significant digits.
pub(super) fn tick(value: f64) -> String {
    let magnitude = if value == 0.0 { 0.0 } else { value.abs().log10().floor() };
    if (-3.0..5.0).contains(&magnitude) {
        let decimals = (2.0 - magnitude).max(0.0) as usize;
        format!("{value:.decimals$}").replace('-', "−")
    } else {
        format!("{value:.2e}").replace('-', "−")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_have_three_digits() {
        let ticks = [0.0, -1.234, 56.78, 12345.6, 1.5e-7, 0.004_321].map(tick);
        assert_eq!(ticks, ["0.00", "−1.23", "56.8", "12346", "1.50e−7", "0.00432"]);
    }
}
