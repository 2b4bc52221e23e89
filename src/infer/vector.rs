//! The few vector operations of the sampler's hot loop, in a fixed order of summation.

const LANES: usize = 4;

/// Σ aᵢ bᵢ in four interleaved partial sums: vectorised, and the same on every machine.
#[inline]
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    dot_sum(a, b, b, 0.0)
}

/// Σ aᵢ (bᵢ + c·dᵢ)
#[inline]
pub(super) fn dot_sum(a: &[f64], b: &[f64], d: &[f64], c: f64) -> f64 {
    let n = a.len();
    let (b, d) = (&b[..n], &d[..n]);
    let mut partial = [0.0; LANES];
    let whole = n - n % LANES;
    for start in (0..whole).step_by(LANES) {
        let (a, b, d) =
            (&a[start..start + LANES], &b[start..start + LANES], &d[start..start + LANES]);
        for lane in 0..LANES {
            partial[lane] += a[lane] * (b[lane] + c * d[lane]);
        }
    }
    let tail: f64 = (whole..n).map(|i| a[i] * (b[i] + c * d[i])).sum();
    (partial[0] + partial[1]) + (partial[2] + partial[3]) + tail
}

/// y += c x
#[inline]
pub(super) fn add_scaled(y: &mut [f64], c: f64, x: &[f64]) {
    for (y, x) in y.iter_mut().zip(x) {
        *y += c * x;
    }
}
