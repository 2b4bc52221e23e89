//! The kernels that ship, each by its spectral density and its covariance.

use std::f64::consts::PI;

use super::{Covariance, Kernel, Product, Sum};
use crate::num::{Argument, Real, exp};

/// A kernel of one lengthscale: the type, the function that makes it, and its operators `+` and `*`.
macro_rules! kernels {
    ($($(#[$doc:meta])* $K:ident;)*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug)]
        pub struct $K<D> {
            /// ℓ, mm.
            pub lengthscale: D,
        }

        $(#[$doc])*
        ///
        /// Takes the lengthscale ℓ in mm: a number or a parameter.
        #[allow(non_snake_case)]
        #[inline(always)]
        pub fn $K<D: Real>(lengthscale: impl Argument<D>) -> $K<D> {
            $K { lengthscale: lengthscale.number() }
        }

        impl<D: Real, K: Kernel<D>> std::ops::Add<K> for $K<D> {
            type Output = Sum<D, Self, K>;
            #[inline(always)]
            fn add(self, other: K) -> Self::Output {
                Sum::new(self, other)
            }
        }

        impl<D: Real, K: Covariance<D>> std::ops::Mul<K> for $K<D> {
            type Output = Product<D, Self, K>;
            #[inline(always)]
            fn mul(self, other: K) -> Self::Output {
                Product::new(self, other)
            }
        }
    )*};
}

kernels! {
    /// Squared exponential kernel: `S(w) = 2π ℓ² exp(−ℓ² w²/2)`, `k(r) = exp(−r²/(2ℓ²))`.
    Rbf;
    /// Matérn kernel, ν = ½: `S(w) = 4πν κ^(2ν) (κ² + w²)^−(ν+1)`, `κ² = 2ν/ℓ²`; `k(r) = e^(−κr)`.
    Matern12;
    /// Matérn kernel, ν = 3/2: `S(w) = 4πν κ^(2ν) (κ² + w²)^−(ν+1)`, `κ² = 2ν/ℓ²`;
    /// `k(r) = (1 + κr) e^(−κr)`.
    Matern32;
    /// Matérn kernel, ν = 5/2: `S(w) = 4πν κ^(2ν) (κ² + w²)^−(ν+1)`, `κ² = 2ν/ℓ²`;
    /// `k(r) = (1 + κr + κ²r²/3) e^(−κr)`.
    Matern52;
}

impl<D: Real> Kernel<D> for Rbf<D> {
    #[inline(always)]
    fn sqrt_density(&self, w: f64) -> D {
        let l = self.lengthscale;
        l * (2.0 * PI).sqrt() * exp(l * l * (-0.25 * w * w))
    }
}

impl<D: Real> Covariance<D> for Rbf<D> {
    fn covariance(&self, r: f64) -> D {
        let z = self.lengthscale.recip() * r;
        exp(z * z * -0.5)
    }
    fn squared_exponential(&self) -> Option<D> {
        Some(self.lengthscale)
    }
}

impl<D: Real> Kernel<D> for Matern12<D> {
    #[inline(always)]
    fn sqrt_density(&self, w: f64) -> D {
        let kappa2 = (self.lengthscale * self.lengthscale).recip();
        let s = kappa2 + w * w;
        (kappa2.sqrt() * (2.0 * PI) / (s * s.sqrt())).sqrt()
    }
}

impl<D: Real> Covariance<D> for Matern12<D> {
    fn covariance(&self, r: f64) -> D {
        exp(self.lengthscale.recip() * -r)
    }
}

impl<D: Real> Kernel<D> for Matern32<D> {
    #[inline(always)]
    fn sqrt_density(&self, w: f64) -> D {
        let kappa2 = (self.lengthscale * self.lengthscale).recip() * 3.0;
        let s = kappa2 + w * w;
        (kappa2 * kappa2.sqrt() * (6.0 * PI) / (s * s * s.sqrt())).sqrt()
    }
}

impl<D: Real> Covariance<D> for Matern32<D> {
    fn covariance(&self, r: f64) -> D {
        let z = self.lengthscale.recip() * (3f64.sqrt() * r);
        (z + 1.0) * exp(-z)
    }
}

impl<D: Real> Kernel<D> for Matern52<D> {
    #[inline(always)]
    fn sqrt_density(&self, w: f64) -> D {
        let kappa2 = (self.lengthscale * self.lengthscale).recip() * 5.0;
        let s = kappa2 + w * w;
        (kappa2 * kappa2 * kappa2.sqrt() * (10.0 * PI) / (s * s * s * s.sqrt())).sqrt()
    }
}

impl<D: Real> Covariance<D> for Matern52<D> {
    fn covariance(&self, r: f64) -> D {
        let z = self.lengthscale.recip() * (5f64.sqrt() * r);
        (z * z * (1.0 / 3.0) + z + 1.0) * exp(-z)
    }
}
