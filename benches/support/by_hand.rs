//! The ERP model's log density and gradient written by hand, for scale: two fields, two cubics and the
//! top-hat's recurrence in one function, as one would write them for this model alone.
//!
//! Up to a constant, and over the same unknowns as the declared model: per field m, ln alpha, ln rho,
//! and η without its constant mode.

use eplat::field::{Kernel as _, Rbf, authors};
use eplat::manifold::Basis;
use eplat::surrogate::cubic::Cubic;
use eplat::table::Measurements;

/// Lower ends of the brackets and the surrogate behind them.
type Protocol = (Vec<f64>, Cubic);

#[derive(Debug)]
pub(crate) struct ByHand {
    n: usize,
    k: usize,
    /// Eigenfunctions at the sites, row-major (n, k), without the constant one.
    phi: Vec<f64>,
    eigenvalues: Vec<f64>,
    protocols: [Protocol; 2],
    /// `e^(−i²/2)`
    gauss: [f64; 9],
    amplitude: f64,
    /// Derivative of θ's weights in η, and the weights.
    w: [Vec<f64>; 2],
    weights: Vec<f64>,
    theta: [Vec<f64>; 2],
    theta_bar: [Vec<f64>; 2],
}

impl ByHand {
    pub(crate) fn new(
        basis: &Basis,
        data: &Measurements,
        n_modes: usize,
        cubics: [Cubic; 2],
    ) -> Self {
        let (sites, k) = (data.vertices(), n_modes - 1);
        let n = sites.len();
        let lower = |protocol: &str| -> Vec<f64> {
            let mut at = vec![f64::NAN; n];
            for row in data.rows_of(protocol) {
                let site = sites.binary_search(&data.vertex(row).unwrap()).unwrap();
                at[site] = data.number(row, "lower", "the bench").unwrap();
            }
            at
        };
        let [s2, s3] = cubics;
        ByHand {
            n,
            k,
            phi: sites.iter().flat_map(|v| basis.at(*v as usize)[1..n_modes].to_vec()).collect(),
            eigenvalues: basis.eigenvalues[1..n_modes].to_vec(),
            protocols: [(lower("s1s2"), s2), (lower("s1s2s3"), s3)],
            gauss: std::array::from_fn(|i| (-0.5 * (i * i) as f64).exp()),
            amplitude: authors(Rbf(1.0f64)).sqrt_density(0.0),
            w: [vec![0.0; k], vec![0.0; k]],
            weights: vec![0.0; k],
            theta: [vec![0.0; n], vec![0.0; n]],
            theta_bar: [vec![0.0; n], vec![0.0; n]],
        }
    }

    pub(crate) fn ln_density(&mut self, u: &[f64], gradient: &mut [f64]) -> f64 {
        let mut lp = 0.0;
        for (f, u) in u.chunks_exact(self.k + 3).enumerate() {
            lp += self.forward(f, u);
        }
        for i in 0..self.n {
            lp += self.site(i);
        }
        for (f, (u, g)) in
            u.chunks_exact(self.k + 3).zip(gradient.chunks_exact_mut(self.k + 3)).enumerate()
        {
            lp += self.backward(f, u, g);
        }
        lp
    }

    /// θ = m + Φ w,   w = α c ρ exp(−ρ² λ/4) η
    fn forward(&mut self, f: usize, u: &[f64]) -> f64 {
        let (alpha, rho, eta) = (u[1].exp(), u[2].exp(), &u[3..]);
        let (scale, mut squares) = (alpha * self.amplitude * rho, 0.0);
        let w = &mut self.w[f];
        for j in 0..self.k {
            w[j] = scale * (-0.25 * rho * rho * self.eigenvalues[j]).exp();
            self.weights[j] = w[j] * eta[j];
            squares += eta[j] * eta[j];
        }
        for (theta, row) in self.theta[f].iter_mut().zip(self.phi.chunks_exact(self.k)) {
            let products = row.iter().zip(&self.weights).map(|(phi, w)| phi * w);
            *theta = u[0] + products.sum::<f64>();
        }
        -0.5 * squares
    }

    /// Log likelihood of a site's brackets; its slopes in both fields.
    fn site(&mut self, i: usize) -> f64 {
        let (t, a) = (self.theta[0][i], self.theta[1][i]);
        let (mut lp, mut dt, mut da) = (0.0, 0.0, 0.0);
        for (lower, cubic) in &self.protocols {
            let [_, c1, c2, c3, c4, c5, c6, c7, c8, c9] = cubic.0;
            let value = cubic.eval(t, a);
            let by_t = c1 + t * (2.0 * c3 + 3.0 * t * c6) + a * (c5 + 2.0 * t * c8 + a * c9);
            let by_a = c2 + a * (2.0 * c4 + 3.0 * a * c7) + t * (c5 + t * c8 + 2.0 * a * c9);
            let (l, slope) = top_hat(value - lower[i], &self.gauss);
            lp += l;
            dt += slope * by_t;
            da += slope * by_a;
        }
        self.theta_bar[0][i] = dt;
        self.theta_bar[1][i] = da;
        lp
    }

    fn backward(&mut self, f: usize, u: &[f64], g: &mut [f64]) -> f64 {
        let (rho, eta) = (u[2].exp(), &u[3..]);
        let (head, q) = g.split_at_mut(3);
        q.fill(0.0);
        head[0] = self.theta_bar[f].iter().sum();
        for (bar, row) in self.theta_bar[f].iter().zip(self.phi.chunks_exact(self.k)) {
            for j in 0..self.k {
                q[j] += bar * row[j];
            }
        }
        let (mut by_alpha, mut by_rho) = (0.0, 0.0);
        for j in 0..self.k {
            let bar = q[j] * self.w[f][j];
            by_alpha += bar * eta[j];
            by_rho += bar * eta[j] * (1.0 - 0.5 * rho * rho * self.eigenvalues[j]);
            q[j] = bar - eta[j];
        }
        // InvGamma(1, 5) and InvGamma(1.01, 64) of the logarithms
        let (alpha_term, rho_term) = (5.0 * (-u[1]).exp(), 64.0 / rho);
        head[1] = by_alpha - 1.0 + alpha_term;
        head[2] = by_rho - 1.01 + rho_term;
        -u[1] - alpha_term - 1.01 * u[2] - rho_term
    }
}

/// `ln Σᵢ e^(−(d − i + ½)²/2)`, i = 1 … 10, and its slope, by the recurrence from the nearest centre.
fn top_hat(d: f64, gauss: &[f64; 9]) -> (f64, f64) {
    let x = d - 0.5;
    let j = x.round().clamp(0.0, 9.0);
    let z = x - j;
    let up = z.exp();
    let down = 1.0 / up;
    let (mut total, mut slope) = (1.0, 0.0);
    let mut t = 1.0;
    for (i, gauss) in gauss.iter().enumerate().take((9 - j as usize).min(8) + 1).skip(1) {
        t *= up;
        total += t * gauss;
        slope += i as f64 * t * gauss;
    }
    t = 1.0;
    for (i, gauss) in gauss.iter().enumerate().take((j as usize).min(8) + 1).skip(1) {
        t *= down;
        total += t * gauss;
        slope -= i as f64 * t * gauss;
    }
    (-0.5 * z * z + total.ln(), slope / total - z)
}
