//! Single and double precision.

use num_traits::Float;
use serde::{Serialize, de::DeserializeOwned};

/// f32 or f64.
pub trait Precision:
    Float + Send + Sync + std::fmt::Debug + Serialize + DeserializeOwned + 'static
{
    /// Error of V, of order 1, to which a diffusion step is solved: rms over the surface; single vertices, where a
    /// front passes, have a hundred times as much.
    const TOLERANCE: f64;
    /// The number nearest to `x`.
    fn of(x: f64) -> Self;
    /// The same number in double precision.
    fn f64(self) -> f64;
}

impl Precision for f32 {
    const TOLERANCE: f64 = 1e-7;
    #[inline(always)]
    fn of(x: f64) -> f32 {
        x as f32
    }
    #[inline(always)]
    fn f64(self) -> f64 {
        f64::from(self)
    }
}

impl Precision for f64 {
    const TOLERANCE: f64 = 1e-8;
    #[inline(always)]
    fn of(x: f64) -> f64 {
        x
    }
    #[inline(always)]
    fn f64(self) -> f64 {
        self
    }
}
