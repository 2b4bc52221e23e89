//! Gaussian-process fields on a surface through its Laplace–Beltrami eigenfunctions (GPMI).
//!
//! ```text
//! θ(x) = mean + amplitude · Σ_k η_k √S(√λ_k) φ_k(x),   η_k ~ Normal(0, 1)
//! ```
//! S is the spectral density of a stationary kernel in two dimensions. Its argument is the angular
//! frequency w = √λ; its lengthscale ℓ is in mm. So the standard deviation of the field is near
//! `amplitude`.
//!
//! Knows nothing of meshes, only of a [`Basis`].
//!
//! # Source
//! Coveney et al. 2020, "Gaussian process manifold interpolation"; Solin and Särkkä 2020

use crate::manifold::Basis;
use crate::num::Real;

mod kernels;
mod product;
mod sum;
#[cfg(test)]
mod tests;

pub use kernels::{Matern12, Matern32, Matern52, Rbf};
pub use product::Product;
pub use sum::Sum;

/// The spectral density of a stationary kernel in two dimensions, of unit variance if not a sum.
///
/// Kernels add and multiply: `Rbf(a) + Matern32(b)`, `Rbf(a) * Matern52(b)`. A user's own kernel has no
/// operators, and stands on the right of one that ships.
#[diagnostic::on_unimplemented(
    message = "`{Self}` is not a GP kernel",
    label = "expected Rbf(lengthscale), Matern32(lengthscale), Matern52(lengthscale), a sum or product of these, or authors(kernel)"
)]
pub trait Kernel<D: Real> {
    /// `√S(w)`, mm, at the angular frequency `w` in mm⁻¹.
    fn sqrt_density(&self, w: f64) -> D;
}

/// A kernel that says its covariance, and so can be multiplied: `Rbf(a) * Matern52(b)`.
#[diagnostic::on_unimplemented(
    message = "the GP kernel `{Self}` cannot be multiplied: it does not say its covariance",
    label = "expected Rbf, Matern12, Matern32, Matern52, or a kernel of your own with `impl Covariance`"
)]
pub trait Covariance<D: Real>: Kernel<D> {
    /// `k(r)` at the distance `r` in mm: smooth for r > 0, and gone beyond some distance.
    fn covariance(&self, r: f64) -> D;
    /// The lengthscale ℓ, if `k(r) = exp(−r²/(2ℓ²))`: products of these are one in closed form.
    fn squared_exponential(&self) -> Option<D> {
        None
    }
}

/// A kernel in the amplitude units of the paper's authors: see [`authors`].
#[derive(Clone, Copy, Debug)]
pub struct Authors<T>(T);

/// A kernel whose amplitude is in the units of the paper's code.
///
/// There the field is `α Σ η_k √S φ_k` with lengths in units of h, a third of the mean edge of a
/// mesh of 5,000 vertices, frequency in cycles, and S divided by φ₀. Carried over exactly,
/// `ℓ = 2π h ρ` (so that ρ = 10, 20, 40 are about 32, 64, 128 mm) and the field's standard
/// deviation is `α (area/h²)^¼ / 2π`. With n equilateral triangles' worth of edges
/// `area/h² = 9 n √3/2`: 38,971 at n = 5,000, whatever the atrium, so the factor is 2.236.
///
/// Differs from the paper: its text divides the amplitude by φ₀ instead (a field 31 α wide); this
/// is what its code does.
pub fn authors<T>(kernel: T) -> Authors<T> {
    Authors(kernel)
}

/// `(9 · 5000 · √3/2)^¼ / 2π`
const AUTHORS_AMPLITUDE: f64 = 2.236_175_670_256_598_5;

impl<D: Real, T: Kernel<D>> Kernel<D> for Authors<T> {
    #[inline(always)]
    fn sqrt_density(&self, w: f64) -> D {
        self.0.sqrt_density(w) * AUTHORS_AMPLITUDE
    }
}

/// A field of unit amplitude and zero mean at every vertex, from its coefficients η (n_modes).
pub fn unit_field(basis: &Basis, kernel: &impl Kernel<f64>, eta: &[f64]) -> Vec<f64> {
    let weights: Vec<f64> = basis
        .eigenvalues
        .iter()
        .zip(eta)
        .map(|(lambda, eta)| eta * kernel.sqrt_density(lambda.max(0.0).sqrt()))
        .collect();
    (0..basis.n_vertices())
        .map(|vertex| weights.iter().zip(basis.at(vertex)).map(|(w, phi)| w * phi).sum())
        .collect()
}
