//! Every vector prior: mass and moments against closed forms, derivatives, draws, and a twin that is
//! seen to fail.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::dist::{Normal, StudentT};
use crate::num::{Dual, derivatives, variable};

/// The numbers and the log density of their unknowns.
fn run<D: Real>(prior: &impl Sequence<D>, n: usize, u: &[D]) -> (Vec<D>, D) {
    let mut carry = vec![D::from(prior.begin()); prior.n_carry(n)];
    let (mut x, mut ln_p) = (vec![], prior.ln_norm(n));
    for (i, u) in u.iter().enumerate() {
        let step = prior.step(i, n, *u, &mut carry);
        ln_p += step.ln_kernel;
        x.push(step.x);
    }
    x.resize(n, carry[0]);
    (x, ln_p)
}

/// The integral over two unknowns of the density times `f`.
fn integral(prior: &impl Sequence<f64>, n: usize, f: impl Fn(&[f64]) -> f64) -> f64 {
    let (h, half) = (0.05, 500);
    let mut sum = 0.0;
    for i in -half..half {
        for j in -half..half {
            let (x, ln_p) = run(prior, n, &[h * f64::from(i), h * f64::from(j)]);
            sum += f(&x) * ln_p.exp() * h * h;
        }
    }
    sum
}

/// One concentration for all.
fn one(concentration: f64) -> Dirichlet<f64, 1> {
    Dirichlet(concentration)
}

#[test]
fn proportions_have_the_dirichlets_mass_and_moments() {
    let prior = one(2.5);
    assert!((integral(&prior, 3, |_| 1.0) - 1.0).abs() < 1e-8);
    // E xᵢ = 1/n, Var xᵢ = (n − 1)/(n² (na + 1)), Cov = −1/(n² (na + 1))
    for i in 0..3 {
        assert!((integral(&prior, 3, |x| x[i]) - 1.0 / 3.0).abs() < 1e-8, "{i}");
        let square = integral(&prior, 3, |x| x[i] * x[i]) - 1.0 / 9.0;
        assert!((square - 2.0 / (9.0 * 8.5)).abs() < 1e-8, "{i}: {square}");
    }
    let product = integral(&prior, 3, |x| x[0] * x[2]) - 1.0 / 9.0;
    assert!((product + 1.0 / (9.0 * 8.5)).abs() < 1e-8, "{product}");
}

#[test]
fn proportions_may_each_have_a_concentration() {
    // E xᵢ = aᵢ/a, Var xᵢ = E xᵢ (1 − E xᵢ)/(a + 1), a = Σ aᵢ
    let a = [2.0, 4.5, 1.5];
    let prior: Dirichlet<f64, 3> = Dirichlet(a);
    assert!((integral(&prior, 3, |_| 1.0) - 1.0).abs() < 1e-8);
    for i in 0..3 {
        let mean = a[i] / 8.0;
        assert!((integral(&prior, 3, |x| x[i]) - mean).abs() < 1e-8, "{i}");
        let variance = integral(&prior, 3, |x| x[i] * x[i]) - mean * mean;
        assert!((variance - mean * (1.0 - mean) / 9.0).abs() < 1e-8, "{i}: {variance}");
    }
}

#[test]
fn ordered_numbers_have_the_moments_of_order_statistics() {
    // E min, E max of two standard normals = ∓1/√π; each of a half-and-half mixture has variance 1
    let prior = Ordered(Normal::<f64>(0.0, 1.0));
    let minimum = integral(&prior, 2, |x| x[0]);
    let maximum = integral(&prior, 2, |x| x[1]);
    let expected = std::f64::consts::PI.sqrt().recip();
    assert!((integral(&prior, 2, |_| 1.0) - 1.0).abs() < 1e-8);
    assert!((minimum + expected).abs() < 1e-8 && (maximum - expected).abs() < 1e-8);
    assert!((integral(&prior, 2, |x| x[0] * x[0]) - 1.0).abs() < 1e-8);
    // a broken twin: the Jacobian x₁ − x₀ = e^(u₁) left out
    let twin = integral(&prior, 2, |x| 1.0 / (x[1] - x[0]).max(1e-300));
    assert!((twin - 1.0).abs() > 0.1, "{twin}");
}

const COVARIANCE: [[f64; 2]; 2] = [[4.0, -1.2], [-1.2, 1.5]];

#[test]
fn normal_numbers_have_their_means_and_covariance() {
    let prior = MultivariateNormal::<f64, _, _, _>([0.7, -0.3], COVARIANCE);
    assert!((integral(&prior, 2, |_| 1.0) - 1.0).abs() < 1e-8);
    let about = |x: &[f64], i: usize| x[i] - [0.7, -0.3][i];
    for (i, j) in [(0, 0), (0, 1), (1, 1)] {
        let product = integral(&prior, 2, |x| about(x, i) * about(x, j));
        assert!((product - COVARIANCE[i][j]).abs() < 1e-8, "{i} {j}: {product}");
    }
    assert!(integral(&prior, 2, |x| about(x, 0)).abs() < 1e-8);
    // a broken twin: the first of the factor's diagonal left out of the normaliser
    let twin = integral(&prior, 2, |_| prior_factor()[0][0]);
    assert!((twin - 1.0).abs() > 0.1, "{twin}");
}

fn prior_factor() -> CholeskyFactor<f64, 2> {
    cholesky(COVARIANCE)
}

#[test]
fn the_same_covariance_by_scales_and_a_correlation_is_the_same_prior() {
    let by_matrix = MultivariateNormal::<f64, _, _, _>(0.4, COVARIANCE);
    let r = COVARIANCE[0][1] / (COVARIANCE[0][0] * COVARIANCE[1][1]).sqrt();
    let factor = correlation_cholesky([r]).scaled([2.0, 1.5f64.sqrt()]);
    let by_scales = MultivariateNormal::<f64, _, _, _>(0.4, factor);
    let (u, ln) = ([0.3, -1.1], |p: f64| p);
    let (a, b) = (ln(run(&by_matrix, 2, &u).1), ln(run(&by_scales, 2, &u).1));
    assert!((a - b).abs() < 1e-13, "{a} {b}");
    // three numbers, by hand: −½ xᵀ C⁻¹ x − ½ ln det C − 3 ln √(2π), C = [[2,1,0],[1,2,0],[0,0,4]], x = 1
    let prior = MultivariateNormal::<f64, _, _, _>(
        0.0,
        [[2.0, 1.0, 0.0], [1.0, 2.0, 0.0], [0.0, 0.0, 4.0]],
    );
    let expected = -0.5 * (2.0 / 3.0 + 0.25) - 0.5 * 12f64.ln() - 1.5 * std::f64::consts::TAU.ln();
    let got = run(&prior, 3, &[1.0; 3]).1;
    assert!((got - expected).abs() < 1e-13, "{got} {expected}");
}

/// LKJ(1) of N = 2 is uniform on (−1, 1); of N = 3 every correlation is Beta(1.5, 1.5) there.
#[test]
fn correlations_have_the_marginals_of_lkj() {
    for eta in [1.0, 2.5] {
        let prior = LkjCholesky::<f64>(eta);
        // N = 2: (1 − r²)^(η−1), of variance 1/(2η + 1)
        let h = 0.01;
        let of = |f: &dyn Fn(f64) -> f64| -> f64 {
            let at = |i: i32| run(&prior, 1, &[h * f64::from(i)]);
            let term = |(x, ln_p): (Vec<f64>, f64)| f(x[0]) * ln_p.exp() * h;
            (-6000..6000).map(|i| term(at(i))).sum()
        };
        assert!((of(&|_| 1.0) - 1.0).abs() < 1e-9, "{eta}");
        assert!((of(&|r| r * r) - 1.0 / (2.0 * eta + 1.0)).abs() < 1e-9, "{eta}");
        let below = of(&|r| f64::from(u8::from(r < 0.3)));
        assert!(eta > 1.0 || (below - 0.65).abs() < 0.005, "{below}");
        // a broken twin: the normaliser of another eta
        let twin = of(&|_| (LkjCholesky::<f64>(eta + 1.0).ln_norm(1) - prior.ln_norm(1)).exp());
        assert!((twin - 1.0).abs() > 0.1, "{twin}");
    }
}

/// R's density by its definition, `det(R)^(η−1)`, integrated over the three correlations of N = 3,
/// against that of the unknowns: the Jacobian of r with respect to u included.
#[test]
fn lkj_is_a_power_of_the_determinant() {
    let at = |eta: f64, u: [f64; 3]| {
        let d: [Dual<3>; 3] = std::array::from_fn(|i| variable(u[i], i));
        let (l, ln_p) = run(&LkjCholesky::<Dual<3>>(eta), 3, &d);
        let l = correlation_cholesky([l[0], l[1], l[2]]);
        let r = [l.product(1, 0), l.product(2, 0), l.product(2, 1)];
        let jacobian = nalgebra::Matrix3::from_fn(|i, j| derivatives(&r[i])[j]).determinant();
        let determinant = (0..3).map(|i| l[i][i].re.powi(2)).product::<f64>();
        // constant in u, if ln p(u) = (η − 1) ln det R + ln |dr/du| + constant
        ln_p.re - (eta - 1.0) * determinant.ln() - jacobian.abs().ln()
    };
    for eta in [0.8, 1.0, 3.0] {
        let constant = at(eta, [0.0; 3]);
        for u in [[0.4, -0.9, 1.3], [2.0, 2.0, -1.0], [-0.2, 3.0, 0.1]] {
            let here = at(eta, u);
            assert!((here - constant).abs() < 1e-12, "{eta} {u:?}: {here} {constant}");
        }
        // volume of the correlation matrices of three: π²/2
        let volume = std::f64::consts::PI.powi(2) / 2.0;
        assert!((at(1.0, [0.0; 3]) + volume.ln()).abs() < 1e-12);
    }
}

#[test]
fn numbers_that_sum_to_zero_have_a_singular_covariance() {
    let (prior, sd) = (SumToZero::<f64>(1.7), 1.7);
    assert!((integral(&prior, 3, |_| 1.0) - 1.0).abs() < 1e-8);
    for (i, j) in [(0, 0), (0, 1), (1, 1), (1, 2), (2, 2)] {
        let product = integral(&prior, 3, |x| x[i] * x[j]);
        let expected = sd * sd * (f64::from(u8::from(i == j)) - 1.0 / 3.0);
        assert!((product - expected).abs() < 1e-8, "{i} {j}: {product} {expected}");
    }
    let u = [0.3, -1.2, 2.0, 0.1];
    let (x, _) = run(&prior, 5, &u);
    let squares = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>();
    assert!(x.iter().sum::<f64>().abs() < 1e-15 && (squares(&x) - squares(&u)).abs() < 1e-14);
    // a broken twin: as many factors 1/sd as numbers
    let twin = integral(&prior, 3, |_| 1.0 / (sd * std::f64::consts::TAU.sqrt()));
    assert!((twin - 1.0).abs() > 0.1, "{twin}");
}

#[test]
fn unknowns_come_back_from_the_numbers() {
    fn check(prior: &impl Sequence<f64>, u: &[f64], n: usize) {
        let (x, _) = run(prior, n, u);
        let mut carry = vec![prior.begin(); prior.n_carry(n)];
        for (i, u) in u.iter().enumerate() {
            let back = prior.unconstrain(i, n, x[i], &carry);
            assert!((back - u).abs() < 1e-12, "{i}: {back} against {u}");
            prior.step(i, n, *u, &mut carry);
        }
        assert_eq!(prior.length(n), n);
    }
    check(&one(0.7), &[0.3, -1.2, 2.0], 4);
    check(&Ordered(StudentT::<f64>(4.0, 1.0, 2.0)), &[0.3, -1.2, 2.0, 0.1], 4);
    check(&MultivariateNormal::<f64, _, _, _>(0.5, COVARIANCE), &[0.3, -1.2], 2);
    check(&LkjCholesky::<f64>(1.5), &[0.3, -1.2, 2.0, 0.1, 0.9, -3.0], 6);
    check(&SumToZero::<f64>(2.0), &[0.3, -1.2, 2.0], 4);
    let (x, _) = run(&one(0.7), 4, &[0.0; 3]);
    assert!(x.iter().all(|x| (x - 0.25).abs() < 1e-15), "{x:?}");
}

/// Derivatives of log density plus a sum of the numbers, in the unknowns and in the prior's parameter.
#[test]
fn derivatives_match_differences() {
    /// Makes a prior of numbers of either kind from one parameter.
    macro_rules! check {
        ($name:literal, $n:literal, $u:expr, |$p:ident| $prior:expr) => {{
            const W: usize = 8;
            fn at<D: Real>($p: D, u: &[D]) -> D {
                let (x, ln_p) = run(&$prior, $n, u);
                x.iter().enumerate().fold(ln_p, |sum, (i, x)| sum + *x * (i as f64 - 0.6))
            }
            let point: Vec<f64> = [&[1.3], &$u[..]].concat();
            let dual: Vec<Dual<W>> = (0..point.len()).map(|i| variable(point[i], i)).collect();
            let by_dual = derivatives(&at(dual[0], &dual[1..]));
            for i in 0..point.len() {
                let shifted = |e: f64| {
                    let mut point = point.clone();
                    point[i] += e;
                    at(point[0], &point[1..])
                };
                let difference = (shifted(1e-5) - shifted(-1e-5)) / 2e-5;
                let error = (by_dual[i] - difference).abs();
                assert!(error < 1e-7, "{} {i}: {} {difference}", $name, by_dual[i]);
            }
        }};
    }
    check!("Dirichlet", 3, [0.4, -0.9], |p| Dirichlet(p));
    check!("Ordered", 3, [0.4, -0.9, 0.2], |p| Ordered(Normal(p, 2.0)));
    check!("LkjCholesky", 3, [0.4, -0.9, 0.2], |p| LkjCholesky(p));
    check!("SumToZero", 4, [0.4, -0.9, 0.2], |p| SumToZero(p));
    check!("MultivariateNormal", 3, [0.4, -0.9, 0.2], |p| {
        let factor = correlation_cholesky([p * 0.3, D::from(0.2), p * -0.4]).scaled(p);
        MultivariateNormal(p, factor)
    });
}

const DRAWS: u32 = 20_000;

/// Checks that the mean of `f` over draws is `expected`: 4.5 standard errors.
fn assert_mean(
    name: &str,
    prior: &impl Sequence<f64>,
    n: usize,
    expected: f64,
    f: impl Fn(&[f64]) -> f64,
) {
    let mut rng = ChaCha8Rng::from_seed([5; 32]);
    let draws: Vec<f64> = (0..DRAWS).map(|_| f(&prior.sample(n, &mut rng).unwrap())).collect();
    let count = f64::from(DRAWS);
    let mean = draws.iter().sum::<f64>() / count;
    let variance = draws.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / count;
    let z = (mean - expected) / (variance / count).sqrt();
    assert!(z.abs() < 4.5, "{name}: {mean} against {expected}, z {z}");
}

#[test]
fn draws_have_the_moments_of_the_density() {
    let normal = MultivariateNormal::<f64, _, _, _>([0.7, -0.3], COVARIANCE);
    assert_mean("mean", &normal, 2, -0.3, |x| x[1]);
    assert_mean("covariance", &normal, 2, -1.2, |x| (x[0] - 0.7) * (x[1] + 0.3));
    assert_mean("variance", &normal, 2, 1.5, |x| (x[1] + 0.3).powi(2));
    // of N = 4 every correlation, also those that are products of rows, has variance 1/(N − 1 + 2η)
    let product = |x: &[f64], i, j| {
        let l: CholeskyFactor<f64, 4> = correlation_cholesky(<[f64; 6]>::try_from(x).unwrap());
        l.product(i, j)
    };
    let lkj = LkjCholesky::<f64>(1.5);
    for (i, j) in [(1, 0), (2, 1), (3, 0), (3, 2)] {
        assert_mean("correlation", &lkj, 6, 0.0, |x| product(x, i, j));
        assert_mean("its square", &lkj, 6, 1.0 / 6.0, |x| product(x, i, j).powi(2));
    }
    let zero = SumToZero::<f64>(2.0);
    assert_mean("variance", &zero, 4, 3.0, |x| x[3] * x[3]);
    assert_mean("covariance", &zero, 4, -1.0, |x| x[0] * x[3]);
    // Dirichlet, E x₁² = a(a + 1)/(A (A + 1)); ordered, E max of two = 1/√π
    assert_mean("share", &one(2.5), 3, 2.5 * 3.5 / (7.5 * 8.5), |x| x[1] * x[1]);
    let ordered = Ordered(Normal::<f64>(0.0, 1.0));
    assert_mean("maximum", &ordered, 2, std::f64::consts::PI.sqrt().recip(), |x| x[1]);
}

#[test]
fn what_is_no_covariance_has_neither_density_nor_draws() {
    let prior = MultivariateNormal::<f64, _, _, _>(0.0, [[1.0, 2.0], [2.0, 1.0]]);
    assert!(run(&prior, 2, &[0.1, 0.2]).1.is_nan());
    assert!(prior.sample(2, &mut ChaCha8Rng::from_seed([5; 32])).is_none());
}
