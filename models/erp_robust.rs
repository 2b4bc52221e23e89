//! ERP calibration whose intervals hold what they say. `erp.rs` is the paper's model; `docs/robust.md`
//! compares the two.
use eplat::prelude::*;

model! {
    /// tau_out and APD_max stay within their physical ranges and may change from site to site. The likelihood allows
    /// for the surrogate's errors and for a discrepancy of each ERP, whose size is learnt.
    model ErpRobust;

    field tau_out(x) [ms] within 1.0..30.0 = m + alpha * gp(Matern52(rho), K = 128) where {
        m     [ms] ~ Normal(15.0, 10.0);
        alpha [ms] ~ LogNormal(2.2, 0.5);
        rho   [mm] ~ LogNormal(3.9, 0.5);
    }
    field apd_max(x) [ms] within 120.0..270.0 = m + alpha * gp(Matern52(rho), K = 128) where {
        m     [ms] ~ Normal(195.0, 50.0);
        alpha [ms] ~ LogNormal(3.9, 0.5);
        rho   [mm] ~ LogNormal(3.9, 0.5);
    }

    /// Beyond 280 ms the tissue would not follow the pacing, and the ERP_S3 surrogate is void.
    let erp_s2(x) [ms] in 0.0..280.0 = surrogate::erp_s2(tau_out(x), apd_max(x));
    let erp_s3(x) [ms] = surrogate::erp_s3(tau_out(x), apd_max(x));

    /// What a measured ERP has of its own: contact, fibres, an error of place.
    param discrepancy [ms] ~ HalfNormal(2.0);

    /// 0.5 and 1 ms are the surrogate's errors: conduction, rounding, and the form of the cubic.
    observe s1s2(x):   Bracket [ms] ~ Widened(Widened(TopHat(erp_s2(x)), 0.5), discrepancy);
    observe s1s2s3(x): Bracket [ms] ~ Widened(Widened(TopHat(erp_s3(x)), 1.0), discrepancy);
}
