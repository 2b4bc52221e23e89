//! Functions and numbers of the file's own, and everything that an expression may call.

use eplat::prelude::*;

const HALF: f64 = 0.5;

fn saturating<T: Real>(x: Num<T>, most: f64) -> Num<T> {
    let share = x / most;
    most * share.tanh() * HALF
}

fn squared<D: Real>(x: D) -> D {
    x * x + 0.25
}

model! {
    model Called;
    column dose;
    column seen(2);
    param a ~ TruncatedNormal(0.5, 1.0, 0.1, 3.0);
    param b ~ Normal(squared(a), 2.0 * a + 1);
    param w(2) ~ Normal(b, exp(a));
    param cut(3) ~ Ordered(StudentT(4.0, a, 1.0));
    param zero(3) ~ SumToZero(a);
    field f(x) within -3.0..4.0 = (m + a) + alpha * gp(authors(Matern12(2.0 * rho)), K = 8) + gp(Rbf(20), K = 4) where {
        m ~ Normal(0.0, 1.0);
        alpha ~ HalfStudentT(3.0, a);
        rho [mm] ~ LogNormal(3.0, 0.5);
    }
    let curve(row) = saturating(f(row), 2.0) + squared(row.dose) * -w[1].powi(2) + pow(a, 2.5) - pow(2, b / 10);
    let rest(row) = max(curve(row), 0.1) + min(w[0], row.seen[1]) + ln_sum_exp(&[a, b]) + ln_gamma(a) + logistic(b)
        + ln(a) * log10(1.0 + row.dose) + sqrt(abs(b) + 1.0) + cos(row.seen[0]) * sin(b) + (a / 3.0).atan() + 1;
    observe near(row): Number ~ Outliers(Widened(Normal(rest(row), a), 0.5), 0.1, 4.0);
    observe far(row): Number ~ Mixture(logistic(b), Normal(rest(row), 1), StudentT(3, cut[0] - zero[1], a));
    observe low(row): Number ~ Censored(Normal(curve(row), a), 0.5);
    observe ratio(row): Number from (row.dose / (1.0 + row.seen[0])) ~ Laplace(cut[2], a);
}
