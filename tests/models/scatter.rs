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

    /// Why rows.
    param row_error [ms] ~ HalfNormal(10.0);

    /// Added by `eplat loop`: ln of a factor of that error, by which scatter goes with a column.
    let ln_scatter(row) = 0.0;

    observe s1s2(x): Bracket [ms] ~ Widened(Interval(erp(x), noise), row_error * exp(ln_scatter(x)));
    observe direct(x): Number [ms] ~ Widened(Normal(late(x) * 0.5 + noise, noise), row_error * exp(ln_scatter(x)));

    /// Why sites.
    param catheter_sd [ms] ~ HalfNormal(10.0);

    effect catheter_difference on erp, late [ms] = group(row.catheter) ~ Normal(0.0, catheter_sd);

    /// Why scatter.
    effect hetero_catheter on ln_scatter = group(row.catheter) ~ Normal(0.0, 1.0);
}
