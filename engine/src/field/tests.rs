//! Kernels against closed forms: unit variance, and densities of products by other ways.

use std::f64::consts::{PI, TAU};

use super::*;
use crate::num::{Dual, derivatives, variable};

/// In two dimensions the variance is `(1/2π) ∫ S(w) w dw`: 1 of a kernel, 2 of a sum of two.
#[test]
fn every_kernel_has_unit_variance() {
    let l = 20.0;
    let kernels: [(&str, &dyn Kernel<f64>, f64); 8] = [
        ("rbf", &Rbf(l), 1.0),
        ("1/2", &Matern12(l), 1.0 - 1.0 / (40.0 * l)), // the tail beyond w = 40 is cut
        ("3/2", &Matern32(l), 1.0),
        ("5/2", &Matern52(l), 1.0),
        ("sum", &(Rbf(l) + Matern32(3.0 * l)), 2.0),
        ("product in closed form", &(Rbf(l) * Rbf(2.0 * l)), 1.0),
        ("product", &(Rbf(l) * Matern52(2.0 * l)), 1.0),
        ("product of a sum", &((Rbf(l) + Matern52(l)) * Matern32(l)), 2.0),
    ];
    for (name, kernel, expected) in kernels {
        // a product's quadrature is slow: fewer points, as far as it reaches
        let (n, h) = if name.starts_with("product") { (20_000, 2e-4) } else { (400_000, 1e-4) };
        let variance: f64 = (0..n)
            .map(|i| {
                let w = (f64::from(i) + 0.5) * h;
                kernel.sqrt_density(w).powi(2) * w * h / TAU
            })
            .sum();
        assert!((variance - expected).abs() < 2e-5, "{name}: {variance}");
    }
}

/// `S(w)` of a product, and its largest relative error where it is above `floor` of S(0).
fn worst(product: &impl Kernel<f64>, floor: f64, expected: impl Fn(f64) -> f64) -> f64 {
    let at_zero = expected(0.0);
    let points = (0..60).map(|i| 0.01 * f64::from(i));
    let errors = points.filter(|w| expected(*w) > floor * at_zero).map(|w| {
        let got = product.sqrt_density(w).powi(2);
        (got / expected(w) - 1.0).abs()
    });
    errors.fold(0.0, f64::max)
}

/// A squared exponential that does not say so: its products go by quadrature.
#[derive(Clone, Copy, Debug)]
struct Unsaid(f64);

impl Kernel<f64> for Unsaid {
    fn sqrt_density(&self, w: f64) -> f64 {
        Rbf(self.0).sqrt_density(w)
    }
}

impl Covariance<f64> for Unsaid {
    fn covariance(&self, r: f64) -> f64 {
        Rbf(self.0).covariance(r)
    }
}

#[test]
fn a_product_of_squared_exponentials_is_one() {
    let (a, b) = (20.0f64, 35.0f64);
    let l = (a.powi(-2) + b.powi(-2)).powf(-0.5);
    let expected = |w: f64| TAU * l * l * (-0.5 * l * l * w * w).exp();
    assert!(worst(&(Rbf(a) * Rbf(b)), 1e-300, expected) < 1e-12);
    let error = worst(&(Rbf(a) * Unsaid(b)), 1e-7, expected);
    assert!(error < 1e-7, "{error}");
    // a broken twin: the wider of the two alone
    assert!(worst(&Rbf(b), 1e-7, expected) > 0.1);
}

/// Legendre's polynomial of degree `m`.
fn legendre(m: u32, x: f64) -> f64 {
    let step = |(before, now): (f64, f64), k: u32| {
        let k = f64::from(k);
        (now, ((2.0 * k + 1.0) * x * now - k * before) / (k + 1.0))
    };
    if m == 0 { 1.0 } else { (1..m).fold((1.0, x), step).1 }
}

/// `∫ rᵐ e^(−κr) J₀(wr) dr = m! (κ² + w²)^(−(m+1)/2) P_m(κ/√(κ² + w²))`: Matérn kernels of half-integer
/// order are polynomials times exponentials.
#[test]
fn products_of_matern_kernels_agree_with_their_closed_form() {
    let (a, b) = (25.0f64, 60.0f64);
    let [k, l] = [3f64.sqrt() / a, 5f64.sqrt() / b];
    // r (1 + k r) (1 + l r + l² r²/3)
    let c = [1.0, k + l, k * l + l * l / 3.0, k * l * l / 3.0];
    let expected = |w: f64| {
        let s = (k + l).hypot(w);
        let term = |m: u32| {
            let factorial = f64::from((1..=m).product::<u32>());
            factorial * s.powi(-(m as i32) - 1) * legendre(m, (k + l) / s)
        };
        TAU * (1..=4).map(|m| c[m as usize - 1] * term(m)).sum::<f64>()
    };
    let error = worst(&(Matern32(a) * Matern52(b)), 1e-9, expected);
    assert!(error < 1e-8, "{error}");
    let expected = |w: f64| {
        let kappa = 1.0 / a + 1.0 / b;
        TAU * kappa * (kappa * kappa + w * w).powf(-1.5)
    };
    let error = worst(&(Matern12(a) * Matern12(b)), 1e-9, expected);
    assert!(error < 1e-8, "{error}");
}

/// The density of a product is the convolution of the densities: `(1/2π)² ∫∫ S₁(|w − p|) S₂(p) d²p`.
#[test]
fn a_product_agrees_with_the_convolution_of_the_densities() {
    let (rbf, matern) = (Rbf::<f64>(30.0), Matern32::<f64>(20.0));
    let expected = |w: f64| {
        let (n, angles, end) = (800, 200, 9.0 / 30.0);
        let h = end / f64::from(n);
        let ring = |p: f64| {
            let at = |j: i32| {
                let angle = TAU * f64::from(j) / f64::from(angles);
                let distance = (w * w + p * p - 2.0 * w * p * angle.cos()).max(0.0).sqrt();
                matern.sqrt_density(distance).powi(2)
            };
            (0..angles).map(at).sum::<f64>() / f64::from(angles) * rbf.sqrt_density(p).powi(2) * p
        };
        let simpson = |i: i32| ring(h * f64::from(i)) * if i % 2 == 1 { 4.0 } else { 2.0 };
        (1..n).map(simpson).sum::<f64>() * h / (3.0 * TAU)
    };
    let product = rbf * matern;
    for w in [0.0, 0.01, 0.05, 0.1, 0.2, 0.4] {
        let (got, expected) = (product.sqrt_density(w).powi(2), expected(w));
        assert!((got / expected - 1.0).abs() < 1e-6, "{w}: {got} {expected}");
    }
    // a broken twin: the sum instead
    assert!(((rbf + matern).sqrt_density(0.05).powi(2) / expected(0.05) - 1.0).abs() > 0.1);
}

#[test]
fn densities_of_a_sum_add() {
    let sum = Rbf::<f64>(20.0) + Matern32::<f64>(50.0) + Matern52::<f64>(5.0);
    for w in [0.0, 0.03, 0.3, 30.0] {
        let parts: [&dyn Kernel<f64>; 3] = [&Rbf(20.0), &Matern32(50.0), &Matern52(5.0)];
        let expected: f64 = parts.iter().map(|part| part.sqrt_density(w).powi(2)).sum();
        assert!((sum.sqrt_density(w).powi(2) / expected - 1.0).abs() < 1e-14, "{w}");
    }
}

#[test]
fn derivatives_in_the_lengthscales_match_differences() {
    fn kernels<D: Real>(a: D, b: D, w: f64) -> [D; 4] {
        [
            (Rbf(a) + Matern32(b)).sqrt_density(w),
            (Rbf(a) * Rbf(b)).sqrt_density(w),
            (Rbf(a) * Matern52(b)).sqrt_density(w),
            ((Matern12(a) + Rbf(b)) * Matern32(b)).sqrt_density(w),
        ]
    }
    for w in [0.0, 0.05, 0.2] {
        let dual: [Dual<2>; 4] = kernels(variable(20.0, 0), variable(35.0, 1), w);
        for (i, dual) in dual.iter().enumerate() {
            let by_a = (kernels(20.001, 35.0, w)[i] - kernels(19.999, 35.0, w)[i]) / 0.002;
            let by_b = (kernels(20.0, 35.001, w)[i] - kernels(20.0, 34.999, w)[i]) / 0.002;
            let [da, db] = derivatives(dual);
            let scale = 1.0 + dual.re.abs();
            assert!((da - by_a).abs() < 1e-7 * scale, "{i} at {w}: {da} {by_a}");
            assert!((db - by_b).abs() < 1e-7 * scale, "{i} at {w}: {db} {by_b}");
        }
    }
}

#[test]
fn the_authors_amplitude_is_the_constant_of_its_formula() {
    let formula = (9.0 * 5000.0 * 3f64.sqrt() / 2.0).powf(0.25) / (2.0 * PI);
    assert!((AUTHORS_AMPLITUDE - formula).abs() < 1e-6, "{formula}");
}
