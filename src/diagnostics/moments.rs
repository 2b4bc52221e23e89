//! Means and standard deviations of maps over draws, one draw after the other.

use serde::{Deserialize, Serialize};

/// Sums over draws (Welford), by vertex; a vertex without a value in a draw is left out of that draw.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Moments {
    n: Vec<f64>,
    mean: Vec<f64>,
    squares: Vec<f64>,
}

impl Moments {
    /// Of no draw yet.
    pub fn new(n_vertices: usize) -> Self {
        let zeros = || vec![0.0; n_vertices];
        Self { n: zeros(), mean: zeros(), squares: zeros() }
    }

    /// Takes the values (n_vertices) of a draw; NaN where there is none.
    pub fn add(&mut self, values: impl Iterator<Item = f64>) {
        for (v, x) in values.enumerate().filter(|(_, x)| x.is_finite()) {
            self.n[v] += 1.0;
            let d = x - self.mean[v];
            self.mean[v] += d / self.n[v];
            self.squares[v] += d * (x - self.mean[v]);
        }
    }

    /// How many draws have a value, at each vertex.
    pub fn counts(&self) -> &[f64] {
        &self.n
    }

    /// Means (n_vertices); NaN where no draw has a value.
    pub fn means(&self) -> Vec<f64> {
        let mean = |(mean, n): (&f64, &f64)| if *n > 0.0 { *mean } else { f64::NAN };
        self.mean.iter().zip(&self.n).map(mean).collect()
    }

    /// Standard deviations (n_vertices); NaN where fewer than two draws have a value.
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
