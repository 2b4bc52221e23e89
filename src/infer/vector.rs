//! The few vector operations of the sampler's hot loop, in a fixed order of summation.

const LANES: usize = 4;

/// Σ aᵢ bᵢ in four interleaved partial sums: vectorised, and the same on every machine.
#[inline]
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let (a, a_rest) = a.as_chunks::<LANES>();
    let (b, b_rest) = b.as_chunks::<LANES>();
    let mut partial = [0.0; LANES];
    for (a, b) in a.iter().zip(b) {
        for lane in 0..LANES {
            partial[lane] += a[lane] * b[lane];
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    total(partial) + rest
}

/// The two products Σ aᵢ cᵢ and Σ bᵢ cᵢ with c = x + y, in one pass.
#[inline]
pub(super) fn dots_with_sum(a: &[f64], b: &[f64], x: &[f64], y: &[f64]) -> [f64; 2] {
    let (a, a_rest) = a.as_chunks::<LANES>();
    let (b, b_rest) = b.as_chunks::<LANES>();
    let (x, x_rest) = x.as_chunks::<LANES>();
    let (y, y_rest) = y.as_chunks::<LANES>();
    let mut partial = [[0.0; LANES]; 2];
    for (((a, b), x), y) in a.iter().zip(b).zip(x).zip(y) {
        for lane in 0..LANES {
            let c = x[lane] + y[lane];
            partial[0][lane] += a[lane] * c;
            partial[1][lane] += b[lane] * c;
        }
    }
    let mut rest = [0.0; 2];
    for (((a, b), x), y) in a_rest.iter().zip(b_rest).zip(x_rest).zip(y_rest) {
        rest[0] += a * (x + y);
        rest[1] += b * (x + y);
    }
    [total(partial[0]) + rest[0], total(partial[1]) + rest[1]]
}

fn total(partial: [f64; LANES]) -> f64 {
    (partial[0] + partial[1]) + (partial[2] + partial[3])
}

/// y += c x
#[inline]
pub(super) fn add_scaled(y: &mut [f64], c: f64, x: &[f64]) {
    for (y, x) in y.iter_mut().zip(x) {
        *y += c * x;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_agree_with_plain_sums_at_every_length() {
        for n in 0..13 {
            let vector = |k: u32| -> Vec<f64> { (0..n).map(|i| f64::from(i * i + k)).collect() };
            let (a, b, x, y) = (vector(1), vector(2), vector(3), vector(5));
            let plain = |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(a, b)| a * b).sum() };
            let sum: Vec<f64> = x.iter().zip(&y).map(|(x, y)| x + y).collect();
            // Whole numbers: every sum is exact.
            assert!((dot(&a, &b) - plain(&a, &b)).abs() < 0.5);
            let [by_a, by_b] = dots_with_sum(&a, &b, &x, &y);
            assert!((by_a - plain(&a, &sum)).abs() < 0.5 && (by_b - plain(&b, &sum)).abs() < 0.5);
        }
    }
}
