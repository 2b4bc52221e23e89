//! Sums of products over slices, in an order that depends on nothing but their length: the same bits
//! on every machine.

use pulp::Arch;

use super::lanes;

/// Partial sums of [`dots_with_sum`].
const LANES: usize = 4;

/// Σ aᵢ bᵢ in `L` interleaved partial sums (1, 2, 4 or 8): the more of them, the wider the vector
/// registers that serve.
#[inline]
pub fn dot<const L: usize>(a: &[f64], b: &[f64]) -> f64 {
    let (a, a_rest) = a.as_chunks::<L>();
    let (b, b_rest) = b.as_chunks::<L>();
    let mut partial = [0.0; L];
    for (a, b) in a.iter().zip(b) {
        for lane in 0..L {
            partial[lane] += a[lane] * b[lane];
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    total(partial) + rest
}

/// The two products Σ aᵢ cᵢ and Σ bᵢ cᵢ with c = x + y, in one pass.
#[inline]
pub fn dots_with_sum(a: &[f64], b: &[f64], x: &[f64], y: &[f64]) -> [f64; 2] {
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

/// Writes `e^(x − most)` and returns `most`, the largest of x. Results below e⁻⁷⁰⁸ are that. NaN where every x is −∞.
pub fn exp_of_less(x: &[f64], out: &mut Vec<f64>) -> f64 {
    let most = x.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    out.resize(x.len(), 0.0);
    let set = |(out, x): (&mut f64, &f64)| *out = lanes::exp(x - most);
    Arch::new().dispatch(|| out.iter_mut().zip(x).for_each(set));
    most
}

/// `y += a ln x` for positive x.
pub fn add_ln(a: f64, x: &[f64], y: &mut [f64]) {
    let add = |(y, x): (&mut f64, &f64)| *y += a * lanes::ln(*x);
    Arch::new().dispatch(|| y.iter_mut().zip(x).for_each(add));
}

/// Halves are added until four are left, which are added in pairs.
#[inline]
fn total<const L: usize>(mut partial: [f64; L]) -> f64 {
    let mut n = L;
    while n > 4 {
        n /= 2;
        for lane in 0..n {
            partial[lane] += partial[lane + n];
        }
    }
    match partial[..n] {
        [a, b, c, d] => (a + b) + (c + d),
        [a, b] => a + b,
        _ => partial[0],
    }
}

/// y += a x
#[inline(always)]
pub fn axpy(a: f64, x: &[f64], y: &mut [f64]) {
    for (y, x) in y.iter_mut().zip(x) {
        *y += a * x;
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
            let all = [dot::<1>(&a, &b), dot::<2>(&a, &b), dot::<4>(&a, &b), dot::<8>(&a, &b)];
            assert!(all.iter().all(|dot| (dot - plain(&a, &b)).abs() < 0.5));
            let [by_a, by_b] = dots_with_sum(&a, &b, &x, &y);
            assert!((by_a - plain(&a, &sum)).abs() < 0.5 && (by_b - plain(&b, &sum)).abs() < 0.5);
        }
    }
}
