//! Probabilities that a map is above or below a level: `erp_s2 > 250`.

use thiserror::Error;

use crate::table::near;

/// An event at every vertex: a map lies above, or below, a level.
#[derive(Clone, Debug, PartialEq)]
pub struct Exceedance {
    /// Name of a field or derived quantity.
    pub map: String,
    /// Whether the map is to lie above the level; otherwise below.
    pub is_above: bool,
    /// The level, in the map's unit.
    pub level: f64,
}

/// Why a text is no event on the maps of a model.
#[derive(Debug, Error)]
pub enum ExceedanceError {
    /// Not `NAME > NUMBER` or `NAME < NUMBER`.
    #[error(
        "`{text}` is no event at a vertex\nhelp: write a map's name, > or <, and a number in the map's unit, for instance 'erp_s2 > 250'"
    )]
    Malformed {
        /// What was written.
        text: String,
    },
    /// The model has no such map.
    #[error("`{text}`: the model has no map `{name}`\nhelp: {help}")]
    NoMap {
        /// What was written.
        text: String,
        /// The name in it.
        name: String,
        /// The nearest name, and all of them.
        help: String,
    },
}

impl Exceedance {
    /// Reads `NAME > NUMBER` or `NAME < NUMBER`, where NAME is one of `maps`.
    ///
    /// # Errors
    /// [`ExceedanceError`].
    pub fn read(text: &str, maps: &[&str]) -> Result<Self, ExceedanceError> {
        let malformed = || ExceedanceError::Malformed { text: text.to_owned() };
        let sign = text.find(['<', '>']).ok_or_else(malformed)?;
        let (name, level) = (text[..sign].trim(), text[sign + 1..].trim());
        let level: f64 = level.parse().map_err(|_| malformed())?;
        if name.is_empty() || !level.is_finite() {
            return Err(malformed());
        }
        if !maps.contains(&name) {
            let help = match near(name, maps) {
                _ if maps.is_empty() => "a model without a field has no map".to_owned(),
                Some(near) => format!("did you mean `{near}`? It has {}", maps.join(", ")),
                None => format!("it has {}", maps.join(", ")),
            };
            return Err(ExceedanceError::NoMap { text: text.to_owned(), name: name.into(), help });
        }
        Ok(Self { map: name.to_owned(), is_above: text[sign..].starts_with('>'), level })
    }

    /// Name of the map of its probability: `P_erp_s2_gt_250`.
    pub fn name(&self) -> String {
        format!("P_{}_{}_{}", self.map, if self.is_above { "gt" } else { "lt" }, self.level)
    }

    /// The share of `values` for which the event holds; NaN if there are no values.
    pub(super) fn share(&self, values: &[f64]) -> f64 {
        let holds = |x: &&f64| if self.is_above { **x > self.level } else { **x < self.level };
        values.iter().filter(holds).count() as f64 / values.len() as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_are_read_and_wrong_ones_are_answered() {
        let maps = ["tau_out", "erp_s2"];
        let read = |text| Exceedance::read(text, &maps).map_err(|e| e.to_string());
        let above = read(" erp_s2 >250 ").unwrap();
        assert_eq!((above.name().as_str(), above.is_above), ("P_erp_s2_gt_250", true));
        assert_eq!(read("tau_out < 0.5").unwrap().name(), "P_tau_out_lt_0.5");
        assert!(
            read("erp_s3 > 250")
                .unwrap_err()
                .contains("did you mean `erp_s2`? It has tau_out, erp_s2")
        );
        assert!(read("voltage > 1").unwrap_err().contains("it has tau_out, erp_s2"));
        for text in ["erp_s2", "erp_s2 > high", "> 3", "erp_s2 > inf"] {
            assert!(read(text).unwrap_err().contains("help: write a map's name"), "{text}");
        }
    }

    #[test]
    fn the_share_is_of_the_values_there_are() {
        let share = |text, values: &[f64]| Exceedance::read(text, &["x"]).unwrap().share(values);
        assert!((share("x > 2", &[1.0, 2.0, 3.0, 4.0]) - 0.5).abs() < 1e-15);
        assert!((share("x < 2", &[1.0, 2.0, 3.0, 4.0]) - 0.25).abs() < 1e-15);
        assert!(share("x < 2", &[]).is_nan());
    }
}
