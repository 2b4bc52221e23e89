//! Candidates.
use eplat::model::Declare;
use crate::erp;

// as the issue: link and kernel alone
mod link52 {
    use eplat::prelude::*;
    model! {
        model Link52;
        field tau_out(x) [ms] within 1.0..30.0 = m + alpha * gp(Matern52(rho), K = 96) where {
            m     [ms] ~ Normal(15.0, 10.0);
            alpha [ms] ~ HalfNormal(10.0);
            rho   [mm] ~ InvGamma(1.01, 64.0);
        }
        field apd_max(x) [ms] within 120.0..270.0 = m + alpha * gp(Matern52(rho), K = 96) where {
            m     [ms] ~ Normal(195.0, 50.0);
            alpha [ms] ~ HalfNormal(50.0);
            rho   [mm] ~ InvGamma(1.01, 64.0);
        }
        let erp_s2(x) [ms] in 0.0..280.0 = surrogate::erp_s2(tau_out(x), apd_max(x));
        let erp_s3(x) [ms] = surrogate::erp_s3(tau_out(x), apd_max(x));
        observe s1s2(x):   Bracket [ms] ~ TopHat(erp_s2(x));
        observe s1s2s3(x): Bracket [ms] ~ TopHat(erp_s3(x));
    }
}
mod link52rho {
    use eplat::prelude::*;
    model! {
        model Link52Rho;
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
        let erp_s2(x) [ms] in 0.0..280.0 = surrogate::erp_s2(tau_out(x), apd_max(x));
        let erp_s3(x) [ms] = surrogate::erp_s3(tau_out(x), apd_max(x));
        observe s1s2(x):   Bracket [ms] ~ TopHat(erp_s2(x));
        observe s1s2s3(x): Bracket [ms] ~ TopHat(erp_s3(x));
    }
}
mod link32 {
    use eplat::prelude::*;
    model! {
        model Link32;
        field tau_out(x) [ms] within 1.0..30.0 = m + alpha * gp(Matern32(rho), K = 128) where {
            m     [ms] ~ Normal(15.0, 10.0);
            alpha [ms] ~ LogNormal(2.2, 0.5);
            rho   [mm] ~ LogNormal(3.9, 0.5);
        }
        field apd_max(x) [ms] within 120.0..270.0 = m + alpha * gp(Matern32(rho), K = 128) where {
            m     [ms] ~ Normal(195.0, 50.0);
            alpha [ms] ~ LogNormal(3.9, 0.5);
            rho   [mm] ~ LogNormal(3.9, 0.5);
        }
        let erp_s2(x) [ms] in 0.0..280.0 = surrogate::erp_s2(tau_out(x), apd_max(x));
        let erp_s3(x) [ms] = surrogate::erp_s3(tau_out(x), apd_max(x));
        observe s1s2(x):   Bracket [ms] ~ TopHat(erp_s2(x));
        observe s1s2s3(x): Bracket [ms] ~ TopHat(erp_s3(x));
    }
}

pub(crate) fn all() -> Vec<&'static dyn Declare> {
    vec![&erp::Erp, &link52::Link52, &link52rho::Link52Rho, &link32::Link32]
}
