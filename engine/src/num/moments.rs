//! Running means and variances of several quantities at once.

use serde::{Deserialize, Serialize};

/// Running sums over draws of several quantities (Welford); a quantity without a finite value in a
/// draw is left out of that draw.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Moments {
    n: Vec<f64>,
    mean: Vec<f64>,
    squares: Vec<f64>,
}

impl Moments {
    /// Of no draw yet.
    pub fn new(n_quantities: usize) -> Self {
        let zeros = || vec![0.0; n_quantities];
        Self { n: zeros(), mean: zeros(), squares: zeros() }
    }

    /// Whether there are moments of so many quantities.
    pub fn has(&self, n_quantities: usize) -> bool {
        [&self.n, &self.mean, &self.squares].iter().all(|of_each| of_each.len() == n_quantities)
    }

    /// Forgets all draws.
    pub fn clear(&mut self) {
        *self = Self::new(self.n.len());
    }

    /// Takes the values of a draw, one per quantity; NaN where there is none.
    pub fn add(&mut self, values: impl Iterator<Item = f64>) {
        for (i, x) in values.enumerate().filter(|(_, x)| x.is_finite()) {
            self.n[i] += 1.0;
            let change = x - self.mean[i];
            self.mean[i] += change / self.n[i];
            self.squares[i] += change * (x - self.mean[i]);
        }
    }

    /// How many draws have a value, of each quantity.
    pub fn counts(&self) -> &[f64] {
        &self.n
    }

    /// Sums of squared deviations from the means.
    pub fn squares(&self) -> &[f64] {
        &self.squares
    }

    /// Means; NaN where no draw has a value.
    pub fn means(&self) -> Vec<f64> {
        let mean = |(mean, n): (&f64, &f64)| if *n > 0.0 { *mean } else { f64::NAN };
        self.mean.iter().zip(&self.n).map(mean).collect()
    }

    /// Standard deviations; NaN where fewer than two draws have a value.
    pub fn sds(&self) -> Vec<f64> {
        let sd = |(s, n): (&f64, &f64)| if *n > 1.0 { (s / (n - 1.0)).sqrt() } else { f64::NAN };
        self.squares.iter().zip(&self.n).map(sd).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_are_those_of_the_values_there_are() {
        let mut moments = Moments::new(3);
        for values in [[1.0, f64::NAN, 2.0], [4.0, f64::NAN, f64::NAN], [7.0, f64::NAN, 4.0]] {
            moments.add(values.into_iter());
        }
        let (means, sds) = (moments.means(), moments.sds());
        assert_eq!(moments.counts(), [3.0, 0.0, 2.0]);
        assert!(means[1].is_nan() && sds[1].is_nan());
        assert!((means[0] - 4.0).abs() < 1e-15 && (means[2] - 3.0).abs() < 1e-15);
        assert!((sds[0] - 3.0).abs() < 1e-15 && (sds[2] - 2.0_f64.sqrt()).abs() < 1e-15);
    }
}
