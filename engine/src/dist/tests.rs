//! The table of priors: each has mass 1, a right derivative and draws of its own moments.

use super::*;
use crate::num::{Dual, derivatives, variable};

/// ∫ p(constrain(u)) |dx/du| du = 1, and the derivative in `u` against a difference.
pub(super) fn check<A: Dist<f64>, B: Dist<Dual<1>>>(name: &str, plain: &A, dual: &B) {
    let h = 1e-3;
    let ln_p = |u: f64| plain.ln_kernel(u, plain.constrain(u)) + plain.ln_norm();
    let mass: f64 = (-60_000..60_000).map(|i| ln_p(f64::from(i) * h).exp() * h).sum();
    assert!((mass - 1.0).abs() < 1e-6, "{name}: mass {mass}");
    for u in [-2.1, -0.3, 0.4, 1.7] {
        let x = variable::<1>(u, 0);
        let by_dual = derivatives(&dual.ln_kernel(x, dual.constrain(x)))[0];
        let difference = (ln_p(u + 1e-5) - ln_p(u - 1e-5)) / 2e-5;
        assert!((by_dual - difference).abs() < 1e-7 * (1.0 + difference.abs()), "{name} at {u}");
        let back = plain.unconstrain(plain.constrain(u));
        assert!((back - u).abs() < 1e-12, "{name}: {back} against {u}");
    }
    let centre = plain.unconstrain(plain.centre());
    assert!(ln_p(centre).is_finite(), "{name}: centre out of support");
    for power in [1, 2] {
        let of = |k: i32| {
            let point = |i: i32| f64::from(i) * h;
            (-60_000..60_000).map(|i| ln_p(point(i)).exp() * h * point(i).powi(k)).sum::<f64>()
        };
        let (mean, sd) = (of(power), (of(2 * power) - of(power).powi(2)).sqrt());
        let drawn = sampled_moment(plain, power);
        let z = (drawn - mean) / (sd / f64::from(DRAWS).sqrt());
        assert!(z.abs() < 4.5, "{name}: power {power}: sampled {drawn}, expected {mean}");
    }
}

const DRAWS: u32 = 20_000;

/// Mean of a power of `u` over draws of x.
fn sampled_moment(prior: &impl Dist<f64>, power: i32) -> f64 {
    let mut rng: rand_chacha::ChaCha8Rng = rand::SeedableRng::from_seed([3; 32]);
    let mut u = || prior.unconstrain(prior.sample(&mut rng).unwrap()).powi(power);
    (0..DRAWS).map(|_| u()).sum::<f64>() / f64::from(DRAWS)
}

#[test]
fn an_improper_prior_and_impossible_parameters_have_no_draws() {
    let mut rng: rand_chacha::ChaCha8Rng = rand::SeedableRng::from_seed([3; 32]);
    assert!(Dist::<f64>::sample(&Flat, &mut rng).is_none());
    // half of the draws within one scale of the middle, 4.5 standard errors
    let cauchy = Cauchy::<f64>(1.0, 2.0);
    let near = (0..DRAWS).filter(|_| (cauchy.sample(&mut rng).unwrap() - 1.0).abs() < 2.0).count();
    let half = 0.5 * f64::from(DRAWS);
    assert!((near as f64 - half).abs() < 4.5 * (0.5 * half).sqrt(), "{near}");
    assert!(Gamma::<f64>(-1.0, 1.0).sample(&mut rng).is_none());
}

macro_rules! families {
    ($($name:ident: $T:ident($($a:literal),*);)*) => {$(
        #[test]
        fn $name() {
            check(stringify!($T), &$T::<f64>($($a),*), &$T::<Dual<1>>($($a),*));
        }
    )*};
}
families! {
    normal: Normal(0.7, 1.3);
    half_normal: HalfNormal(2.0);
    half_cauchy: HalfCauchy(1.7);
    gamma: Gamma(2.5, 0.7);
    inv_gamma: InvGamma(3.0, 5.0);
    uniform: Uniform(-2.0, 5.0);
    student_t: StudentT(7.0, 0.3, 1.2);
    beta: Beta(2.0, 3.5);
    exponential: Exponential(0.5);
    log_normal: LogNormal(0.2, 0.6);
    half_student_t: HalfStudentT(7.0, 1.2);
    laplace: Laplace(0.5, 0.8);
}

#[test]
fn density_values_known_in_closed_form() {
    // InvGamma(1, 5) at x = 5: 5 · 5⁻² · e⁻¹; the kernel carries the Jacobian ln x as well.
    let d = InvGamma::<f64>(1.0, 5.0);
    let ln_p = d.ln_kernel(5f64.ln(), 5.0) + d.ln_norm() - 5f64.ln();
    assert!((ln_p - (0.2f64.ln() - 1.0)).abs() < 1e-14);
    // Cauchy: 1/(2π scale) one scale from the middle
    let ln_p = RealLine::ln_density(&Cauchy::<f64>(1.0, 2.0), 3.0);
    assert!((ln_p + (4.0 * std::f64::consts::PI).ln()).abs() < 1e-14);
    // Γ(1/2) = √π, Γ(5) = 24
    assert!((ln_gamma(0.5f64) - std::f64::consts::PI.sqrt().ln()).abs() < 1e-14);
    assert!((ln_gamma(5.0f64) - 24f64.ln()).abs() < 1e-13);
    assert!((ln_gamma(1e-3f64) - libm::lgamma(1e-3)).abs() < 1e-13);
}
