//! Functions that priors and likelihoods are written with.

use crate::num::{LN_SQRT_2PI, Real};

/// `1/(1 + e^(−u))` without overflow.
#[inline]
pub fn logistic<D: Real>(u: D) -> D {
    if u.re() >= 0.0 {
        ((-u).exp() + 1.0).recip()
    } else {
        let e = u.exp();
        e / (e + 1.0)
    }
}

/// `ln logistic(u) = −ln(1 + e^(−u))` without overflow.
#[inline]
pub fn ln_logistic<D: Real>(u: D) -> D {
    if u.re() >= 0.0 { -(-u).exp().ln_1p() } else { u - u.exp().ln_1p() }
}

/// `ln Γ(a)` for `a > 0`, by Stirling's series after a shift to `a ≥ 12`; absolute error below 1e-14.
pub fn ln_gamma<D: Real>(a: D) -> D {
    let (mut z, mut shift) = (a, D::from(1.0));
    while z.re() < 12.0 {
        shift *= z;
        z += 1.0;
    }
    let r = z.recip();
    let r2 = r * r;
    let series =
        r2 * (r2 * (r2 * (r2 * (1.0 / 1188.0) - 1.0 / 1680.0) + 1.0 / 1260.0) - 1.0 / 360.0);
    (z - 0.5) * z.ln() - z + LN_SQRT_2PI + r * (series + 1.0 / 12.0) - shift.ln()
}
