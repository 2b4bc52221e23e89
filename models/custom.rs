//! A prior, a kernel, a likelihood, the form of an effect and a surrogate of one's own: each one trait or a
//! plain function.
//!
//! `eplat run models/custom.rs --mesh SHELL.vtk --units mm --data FILE.csv`, with the columns `vertex`, `protocol`
//! (`arrival` or `offset_seen`), `value` (ms) and `hour`.
use eplat::prelude::*;

model! {
    /// A delay that levels off, seen through noise with heavier tails than a normal's.
    model Custom;

    param offset [ms] ~ Gumbel(1.0, 2.0);
    param noise  [ms] ~ Gamma(4.0, 2.0);

    field delay(x) [ms] = m + alpha * gp(Matern72(rho), K = 24) where {
        m     [ms] ~ Normal(20.0, 5.0);
        alpha [ms] ~ HalfNormal(5.0);
        rho   [mm] ~ InvGamma(5.0, 200.0);
    }
    effect clock on delay [ms] = Periodic(row.hour, 24.0) ~ Normal(0.0, 2.0);
    observe arrival(x): Number [ms] ~ LogisticNoise(saturating(delay(x)) + offset, noise);
    observe offset_seen(row): Number [ms] ~ LogisticNoise(offset, noise);
}

/// A surrogate, linear well below 200 ms: any function of numbers with derivatives.
fn saturating<T: Real>(x: Num<T>) -> Num<T> {
    200.0 * (x / 200.0).tanh()
}

/// A prior. Gumbel distribution: `−(z + e^(−z)) − ln scale`, `z = (x − mode)/scale`.
struct Gumbel<D> {
    mode: D,
    scale: D,
}

#[allow(non_snake_case)]
fn Gumbel<D: Real>(mode: impl Argument<D>, scale: impl Argument<D>) -> Gumbel<D> {
    Gumbel { mode: mode.number(), scale: scale.number() }
}

impl<D: Real> Dist<D> for Gumbel<D> {
    fn ln_kernel(&self, u: D, _: D) -> D {
        let z = (u - self.mode) / self.scale;
        -z - (-z).exp()
    }
    fn ln_norm(&self) -> D {
        -self.scale.ln()
    }
    fn centre(&self) -> f64 {
        self.mode.re()
    }
    fn sample(&self, rng: &mut dyn Rng) -> Option<f64> {
        Some(
            self.mode.re()
                - self.scale.re() * (-rng.sample::<f64, _>(rand_distr::Open01).ln()).ln(),
        )
    }
}

/// A kernel. Matérn, ν = 7/2: `S(w) = 14π κ⁷ (κ² + w²)^−9/2`, `κ² = 7/ℓ²`, ℓ in mm.
struct Matern72<D>(D);

impl<D: Real> Kernel<D> for Matern72<D> {
    fn sqrt_density(&self, w: f64) -> D {
        let kappa2 = (self.0 * self.0).recip() * 7.0;
        let s = kappa2 + w * w;
        (kappa2.powf(3.5) * s.powf(-4.5) * (14.0 * std::f64::consts::PI)).sqrt()
    }
}

/// The form of an effect: a cosine and a sine of a column over a period, each with a coefficient.
#[derive(Debug)]
struct Periodic(&'static str, f64);

impl EffectForm for Periodic {
    fn design(&self, table: &Measurements) -> (Vec<f64>, usize) {
        let angle = std::f64::consts::TAU / self.1;
        forms::of_number(table, self.0, 2, |x| [(angle * x).cos(), (angle * x).sin()])
    }
    fn column(&self) -> Option<&str> {
        Some(self.0)
    }
}

/// A likelihood. Logistic distribution about `f`: `z − 2 ln(1 + e^z) − ln scale`, `z = (y − f)/scale`.
struct LogisticNoise<D> {
    f: D,
    scale: D,
}

#[allow(non_snake_case)]
fn LogisticNoise<D: Real>(f: impl Argument<D>, scale: impl Argument<D>) -> LogisticNoise<D> {
    LogisticNoise { f: f.number(), scale: scale.number() }
}

impl<D: Real> Likelihood<D, Number> for LogisticNoise<D> {
    fn ln_likelihood(&self, y: &Number) -> D {
        let z = (-self.f + *y) / self.scale;
        ln_logistic(z) + ln_logistic(-z) - self.scale.ln()
    }
    fn simulate(&self, _: &Number, rng: &mut dyn Rng) -> Number {
        let p: f64 = rng.sample(rand_distr::Open01);
        self.f.re() + self.scale.re() * (p / (1.0 - p)).ln()
    }
}
