//! `smooth(row.c, low, high, n)`

use super::form::{EffectForm, Extent, Form, of_number};
use crate::table::Measurements;

#[derive(Debug)]
struct Smooth {
    column: String,
    low: f64,
    high: f64,
    degree: usize,
}

/// Legendre polynomials of degree k = 1 to `degree`, each divided by k. Their argument goes from −1
/// at `low` to 1 at `high`.
pub fn smooth(column: &str, low: f64, high: f64, degree: f64) -> Form {
    Smooth { column: column.into(), low, high, degree: degree as usize }.into()
}

impl EffectForm for Smooth {
    fn written(&self, number: fn(f64) -> String) -> String {
        let Self { column, low, high, degree } = self;
        format!("smooth({}, {}, {}, {degree})", Form::row(column), number(*low), number(*high))
    }
    fn design(&self, table: &Measurements) -> (Vec<f64>, usize) {
        let Self { low, high, degree, .. } = *self;
        let argument = |x: f64| (2.0 * x - low - high) / (high - low);
        of_number(table, &self.column, degree, |x| legendre(argument(x), degree))
    }
    fn column(&self) -> Option<&str> {
        Some(&self.column)
    }
    fn extent(&self) -> Extent {
        Extent::Range(format!("from end to end of its curve in {}", self.column))
    }
}

/// Legendre polynomials of degree 1 to n, each divided by its degree.
fn legendre(x: f64, n: usize) -> Vec<f64> {
    let mut p = vec![1.0, x];
    for k in 2..=n {
        let k1 = k as f64;
        p.push(((2.0 * k1 - 1.0) * x * p[k - 1] - (k1 - 1.0) * p[k - 2]) / k1);
    }
    // higher degrees are worth less: what is smooth is simple
    (1..=n).map(|k| p[k] / k as f64).collect()
}
