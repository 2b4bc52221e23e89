//! `models/joint.rs` with fewer kinds of measurement: what each adds.

use eplat::prelude::*;

/// The fields and predictions of `models/joint.rs` with its `observe`s of ERP and, if it is described, of APD90.
macro_rules! joint {
    ($M:ident $($apd:literal)?) => {
        model! {
            model $M;
            column s2_ms [ms];
            field cv_max(x) [m/s] in 0.3..1.5 = m + alpha * gp(Rbf(rho), K = 16) where {
                m ~ Normal(0.8, 0.3); alpha ~ LogNormal(-2.8, 0.8); rho ~ LogNormal(3.9, 0.5);
            }
            field ln_tau_in(x) [1] in -4.6..-1.2 = m + alpha * gp(Rbf(rho), K = 16) where {
                m ~ Normal(-2.5, 0.7); alpha ~ LogNormal(-1.7, 0.8); rho ~ LogNormal(3.9, 0.5);
            }
            field tau_out(x) [ms] in 1.0..30.0 = m + alpha * gp(Rbf(rho), K = 16) where {
                m ~ Normal(15.0, 7.0); alpha ~ LogNormal(1.4, 0.8); rho ~ LogNormal(3.9, 0.5);
            }
            field tau_open(x) [ms] in 65.0..215.0 = m + alpha * gp(Rbf(rho), K = 16) where {
                m ~ Normal(130.0, 30.0); alpha ~ LogNormal(2.2, 0.8); rho ~ LogNormal(3.9, 0.5);
            }
            field apd_max(x) [ms] in 120.0..270.0 = m + alpha * gp(Rbf(rho), K = 16) where {
                m ~ Normal(195.0, 40.0); alpha ~ LogNormal(2.9, 0.8); rho ~ LogNormal(3.9, 0.5);
            }
            param apd_noise ~ HalfNormal(10.0);
            param cv_noise ~ HalfNormal(0.1);
            let tau_in(x) = exp(ln_tau_in(x));
            let erp_s2(x) = surrogate::five::erp_s2(cv_max(x), tau_in(x), tau_out(x), tau_open(x), apd_max(x));
            let erp_s3(x) = surrogate::five::erp_s3(cv_max(x), tau_in(x), tau_out(x), tau_open(x), erp_s2(x));
            let sd_s2(x) = surrogate::five::erp_s2_sd(cv_max(x), tau_in(x), tau_out(x), tau_open(x), apd_max(x));
            let sd_s3(x) = surrogate::five::erp_s3_sd(cv_max(x), tau_in(x), tau_out(x), tau_open(x), erp_s2(x));
            let r(x) = surrogate::five::unrecovered(erp_s2(x), tau_open(x), x.s2_ms);
            let apd90(x) = surrogate::five::apd90(cv_max(x), tau_in(x), tau_out(x), apd_max(x), r(x));
            let sd_apd(x) = surrogate::five::apd90_sd(cv_max(x), tau_in(x), tau_out(x), apd_max(x), r(x));
            observe s1s2(x): Bracket [ms] ~ Widened(TopHat(erp_s2(x)), sd_s2(x));
            observe s1s2s3(x): Bracket [ms] ~ Widened(TopHat(erp_s3(x)), sd_s3(x));
            $(#[doc = $apd] observe apd(x): Number [ms] ~ Widened(Normal(apd90(x), apd_noise), sd_apd(x));)?
        }
    };
}

joint! { Erp }
joint! { ErpApd "APD90 of a beat." }
