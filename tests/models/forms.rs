//! A model that effects are added to; `forms.rs` is what it becomes.
use eplat::prelude::*;

model! {
    /// A field and what is seen of it, in two ways.
    model Plain;
    param noise [ms] ~ HalfNormal(5.0);
    field erp(x) [ms] in 150.0..300.0 = m + alpha * gp(Matern32(rho), K = 12) where {
        m     [ms] ~ Normal(200.0, 20.0);
        alpha [ms] ~ HalfNormal(20.0);
        rho   [mm] ~ InvGamma(2.0, 40.0);
    }
    let late(x) [ms] = erp(x) * 1.2 + noise;
    observe s1s2(x): Bracket [ms] ~ Interval(erp(x), noise);
    observe direct(x): Number [ms] ~ Normal(late(x) * 0.5 + noise, noise);

    /// Added.
    effect force on erp [ms] = scaled(row.force_g, 1.5, 0.75) ~ Normal(0.0, 10.0);

    /// Added.
    effect curve on late [ms] = smooth(row.force_g, 0.0, 3.0, 3) ~ Normal(0.0, 10.0);

    /// Added.
    effect catheter on erp, late [ms] = group(row.catheter) ~ Normal(0.0, 10.0);

    /// Added.
    effect kind on late [ms] = family(row.catheter) ~ Normal(0.0, 10.0);

    /// Added.
    effect local on erp, late [ms] = scaled_by(row.force_g, row.catheter, 1.5, 0.75) ~ Normal(0.0, 10.0);

    /// Added.
    effect force_curve on late [ms] = saturating(row.force_g, 1.4) ~ Normal(0.0, 10.0);

    /// Added.
    effect patch on erp [ms] = above(row.dist_mm, 12.0) ~ Normal(0.0, 10.0);

    /// Added.
    effect edge on erp [ms] = logistic(row.dist_mm, 15.0, 2.5) ~ Normal(0.0, 10.0);

    /// Added.
    effect shift on late [ms] = all(row) ~ Normal(0.0, 10.0);
}
