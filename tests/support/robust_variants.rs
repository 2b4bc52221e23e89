//! `models/erp_robust.rs` with another kernel or another number of modes, for the coverage study.
use crate::shipped::shipped;
use eplat::model::Declare;

macro_rules! variant {
    ($module:ident, $name:ident, $kernel:ident, $k:literal) => {
        mod $module {
            use eplat::prelude::*;
            model! {
                model $name;
                field tau_out(x) [ms] within 1.0..30.0 = m + alpha * gp($kernel(rho), K = $k) where {
                    m     [ms] ~ Normal(15.0, 10.0);
                    alpha [ms] ~ LogNormal(2.2, 0.5);
                    rho   [mm] ~ LogNormal(3.9, 0.5);
                }
                field apd_max(x) [ms] within 120.0..270.0 = m + alpha * gp($kernel(rho), K = $k) where {
                    m     [ms] ~ Normal(195.0, 50.0);
                    alpha [ms] ~ LogNormal(3.9, 0.5);
                    rho   [mm] ~ LogNormal(3.9, 0.5);
                }
                let erp_s2(x) [ms] in 0.0..280.0 = surrogate::erp_s2(tau_out(x), apd_max(x));
                let erp_s3(x) [ms] = surrogate::erp_s3(tau_out(x), apd_max(x));
                param discrepancy [ms] ~ HalfNormal(2.0);
                observe s1s2(x):   Bracket [ms] ~ Widened(Widened(TopHat(erp_s2(x)), 0.5), discrepancy);
                observe s1s2s3(x): Bracket [ms] ~ Widened(Widened(TopHat(erp_s3(x)), 1.0), discrepancy);
            }
        }
    };
}
variant!(rough, Rough, Matern32, 128);
variant!(k24, K24, Matern52, 24);
variant!(k96, K96, Matern52, 96);
variant!(k256, K256, Matern52, 256);

/// The paper's model, the robust one, and its variants.
pub(crate) fn all() -> Vec<&'static dyn Declare> {
    let erp = ["erp", "erp_robust"].map(shipped);
    let variants: [&dyn Declare; 4] = [&rough::Rough, &k24::K24, &k96::K96, &k256::K256];
    [erp.as_slice(), &variants].concat()
}
