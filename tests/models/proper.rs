//! Models whose priors are proper and usable: draws from them look like measurements could.
use eplat::prelude::*;

/// The ERP model; its prior sets fields of about ±3 and ±15 ms around means of about 12 and 195 ms.
pub(crate) mod erp {
    use super::*;
    model! {
        model ErpProper;
        field tau_out(x) [ms] = m + alpha * gp(authors(Rbf(rho)), K = 24) where {
            m     [ms] ~ Normal(12.0, 2.0);
            alpha [ms] ~ LogNormal(0.3, 0.4);
            rho   [mm] ~ InvGamma(5.0, 150.0);
        }
        field apd_max(x) [ms] = m + alpha * gp(authors(Rbf(rho)), K = 24) where {
            m     [ms] ~ Normal(195.0, 10.0);
            alpha [ms] ~ LogNormal(1.9, 0.4);
            rho   [mm] ~ InvGamma(5.0, 150.0);
        }
        let erp_s2(x) [ms] = surrogate::erp_s2(tau_out(x), apd_max(x));
        let erp_s3(x) [ms] = surrogate::erp_s3(tau_out(x), apd_max(x));
        observe s1s2(x): Bracket [ms] ~ TopHat(erp_s2(x));
        observe s1s2s3(x): Bracket [ms] ~ TopHat(erp_s3(x));
    }
}

/// The broken twin: amplitudes and lengthscales a fifth larger.
pub(crate) mod erp_larger {
    use super::*;
    model! {
        model ErpLarger;
        field tau_out(x) [ms] = m + alpha * gp(authors(Rbf(rho)), K = 24) where {
            m     [ms] ~ Normal(12.0, 2.0);
            alpha [ms] ~ LogNormal(0.48, 0.4);
            rho   [mm] ~ InvGamma(5.0, 180.0);
        }
        field apd_max(x) [ms] = m + alpha * gp(authors(Rbf(rho)), K = 24) where {
            m     [ms] ~ Normal(195.0, 10.0);
            alpha [ms] ~ LogNormal(2.08, 0.4);
            rho   [mm] ~ InvGamma(5.0, 180.0);
        }
        let erp_s2(x) [ms] = surrogate::erp_s2(tau_out(x), apd_max(x));
        let erp_s3(x) [ms] = surrogate::erp_s3(tau_out(x), apd_max(x));
        observe s1s2(x): Bracket [ms] ~ TopHat(erp_s2(x));
        observe s1s2s3(x): Bracket [ms] ~ TopHat(erp_s3(x));
    }
}

/// The density of `models/erp_robust.rs`. ERP_S2 has no range here, so that every draw has a value to be ranked.
pub(crate) mod robust {
    use super::*;
    model! {
        model Robust;
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
        let erp_s2(x) [ms] = surrogate::erp_s2(tau_out(x), apd_max(x));
        let erp_s3(x) [ms] = surrogate::erp_s3(tau_out(x), apd_max(x));
        param discrepancy [ms] ~ HalfNormal(2.0);
        observe s1s2(x):   Bracket [ms] ~ Widened(Widened(TopHat(erp_s2(x)), 0.5), discrepancy);
        observe s1s2s3(x): Bracket [ms] ~ Widened(Widened(TopHat(erp_s3(x)), 1.0), discrepancy);
    }
}

/// A field seen through noise; small, so that hundreds of fits take seconds.
pub(crate) mod field {
    use super::*;
    model! {
        model FieldProper;
        param noise [ms] ~ LogNormal(0.0, 0.4);
        field f(x) [ms] = m + alpha * gp(Matern52(rho), K = 8) where {
            m     [ms] ~ Normal(10.0, 3.0);
            alpha [ms] ~ LogNormal(1.0, 0.4);
            rho   [mm] ~ InvGamma(5.0, 150.0);
        }
        let square(x) = f(x).powi(2);
        observe y(x): Number [ms] ~ Normal(f(x), noise);
    }
}

/// The broken twin: noise a fifth larger.
pub(crate) mod field_noisier {
    use super::*;
    model! {
        model FieldNoisier;
        param noise [ms] ~ LogNormal(0.0, 0.4);
        field f(x) [ms] = m + alpha * gp(Matern52(rho), K = 8) where {
            m     [ms] ~ Normal(10.0, 3.0);
            alpha [ms] ~ LogNormal(1.0, 0.4);
            rho   [mm] ~ InvGamma(5.0, 150.0);
        }
        let square(x) = f(x).powi(2);
        observe y(x): Number [ms] ~ Normal(f(x), noise * 1.2);
    }
}

/// Arrival times over tissue with fibres all round one axis.
pub(crate) mod lat {
    use super::*;
    model! {
        model LatProper;
        field velocity(x) [m/s] within 0.1..1.5 = m + alpha * gp(Matern52(rho), K = 12) where {
            m     [m/s] ~ Normal(0.8, 0.15);
            alpha [m/s] ~ LogNormal(-1.5, 0.4);
            rho   [mm]  ~ LogNormal(3.4, 0.3);
        }
        param ratio ~ LogNormal(0.5, 0.2);
        param angle [rad] ~ Normal(0.0, 0.3);
        param onset(source) [ms] ~ Normal(0.0, 20.0);
        param noise [ms] ~ LogNormal(0.7, 0.4);
        let slowness(x) [ms/mm] = 1.0 / velocity(x);
        let arrival(row) [ms] = eikonal(slowness(row), ratio, angle; row.source);
        observe lat(row): Number [ms] ~ Normal(onset(row) + arrival(row), noise);
    }
}

/// The broken twin: activation takes a fifth longer.
pub(crate) mod lat_slower {
    use super::*;
    model! {
        model LatSlower;
        field velocity(x) [m/s] within 0.1..1.5 = m + alpha * gp(Matern52(rho), K = 12) where {
            m     [m/s] ~ Normal(0.8, 0.15);
            alpha [m/s] ~ LogNormal(-1.5, 0.4);
            rho   [mm]  ~ LogNormal(3.4, 0.3);
        }
        param ratio ~ LogNormal(0.5, 0.2);
        param angle [rad] ~ Normal(0.0, 0.3);
        param onset(source) [ms] ~ Normal(0.0, 20.0);
        param noise [ms] ~ LogNormal(0.7, 0.4);
        let slowness(x) [ms/mm] = 1.0 / velocity(x);
        let arrival(row) [ms] = eikonal(slowness(row), ratio, angle; row.source);
        observe lat(row): Number [ms] ~ Normal(onset(row) + 1.2 * arrival(row), noise);
    }
}

/// Arrival times of fronts with a thickness, which start at two places in half of the rows.
pub(crate) mod lat_thick {
    use super::*;
    model! {
        model LatThick;
        field velocity(x) [m/s] within 0.1..1.5 = m + alpha * gp(Matern52(rho), K = 12) where {
            m     [m/s] ~ Normal(0.8, 0.15);
            alpha [m/s] ~ LogNormal(-1.5, 0.4);
            rho   [mm]  ~ LogNormal(3.4, 0.3);
        }
        param thickness [ms] ~ LogNormal(-1.2, 0.7);
        param onset(source) [ms] ~ Normal(0.0, 20.0);
        param later [ms] ~ Normal(0.0, 15.0);
        param noise [ms] ~ LogNormal(0.7, 0.4);
        let slowness(x) [ms/mm] = 1.0 / velocity(x);
        let arrival(row) [ms] = eikonal(slowness(row), 1.0, 0.0, thickness; row.source, row.source2 + later);
        observe lat(row): Number [ms] ~ Normal(onset(row) + arrival(row), noise);
    }
}

/// The broken twin: fronts are twice as thick.
pub(crate) mod lat_thicker {
    use super::*;
    model! {
        model LatThicker;
        field velocity(x) [m/s] within 0.1..1.5 = m + alpha * gp(Matern52(rho), K = 12) where {
            m     [m/s] ~ Normal(0.8, 0.15);
            alpha [m/s] ~ LogNormal(-1.5, 0.4);
            rho   [mm]  ~ LogNormal(3.4, 0.3);
        }
        param thickness [ms] ~ LogNormal(-0.5, 0.7);
        param onset(source) [ms] ~ Normal(0.0, 20.0);
        param later [ms] ~ Normal(0.0, 15.0);
        param noise [ms] ~ LogNormal(0.7, 0.4);
        let slowness(x) [ms/mm] = 1.0 / velocity(x);
        let arrival(row) [ms] = eikonal(slowness(row), 1.0, 0.0, thickness; row.source, row.source2 + later);
        observe lat(row): Number [ms] ~ Normal(onset(row) + arrival(row), noise);
    }
}

/// ERP, APD and CV together, as in `models/joint.rs`, with priors that stay well within the emulators' ranges.
pub(crate) mod joint {
    use super::*;
    model! {
        model JointProper;
        column s2_ms [ms];
        field cv_max(x) [m/s] = m + alpha * gp(Rbf(rho), K = 8) where {
            m     [m/s] ~ Normal(0.8, 0.08);
            alpha [m/s] ~ LogNormal(-2.8, 0.4);
            rho   [mm]  ~ InvGamma(5.0, 150.0);
        }
        field ln_tau_in(x) [1] = m + alpha * gp(Rbf(rho), K = 8) where {
            m     [1]  ~ Normal(-2.6, 0.2);
            alpha [1]  ~ LogNormal(-1.6, 0.4);
            rho   [mm] ~ InvGamma(5.0, 150.0);
        }
        field tau_out(x) [ms] = m + alpha * gp(Rbf(rho), K = 8) where {
            m     [ms] ~ Normal(12.0, 1.5);
            alpha [ms] ~ LogNormal(0.3, 0.4);
            rho   [mm] ~ InvGamma(5.0, 150.0);
        }
        field tau_open(x) [ms] = m + alpha * gp(Rbf(rho), K = 8) where {
            m     [ms] ~ Normal(125.0, 10.0);
            alpha [ms] ~ LogNormal(1.9, 0.4);
            rho   [mm] ~ InvGamma(5.0, 150.0);
        }
        field apd_max(x) [ms] = m + alpha * gp(Rbf(rho), K = 8) where {
            m     [ms] ~ Normal(185.0, 10.0);
            alpha [ms] ~ LogNormal(1.9, 0.4);
            rho   [mm] ~ InvGamma(5.0, 150.0);
        }
        param apd_noise [ms]  ~ LogNormal(1.0, 0.4);
        param cv_noise  [m/s] ~ LogNormal(-3.5, 0.4);

        let tau_in(x) [ms] = exp(ln_tau_in(x));
        let erp_s2(x) [ms] = surrogate::five::erp_s2(cv_max(x), tau_in(x), tau_out(x), tau_open(x), apd_max(x));
        let erp_s3(x) [ms] = surrogate::five::erp_s3(cv_max(x), tau_in(x), tau_out(x), tau_open(x), erp_s2(x));
        let sd_s2(x)  [ms] = surrogate::five::erp_s2_sd(cv_max(x), tau_in(x), tau_out(x), tau_open(x), apd_max(x));
        let sd_s3(x)  [ms] = surrogate::five::erp_s3_sd(cv_max(x), tau_in(x), tau_out(x), tau_open(x), erp_s2(x));
        let r(x)      [1]   = surrogate::five::unrecovered(erp_s2(x), tau_open(x), x.s2_ms);
        let apd90(x)  [ms]  = surrogate::five::apd90(cv_max(x), tau_in(x), tau_out(x), apd_max(x), r(x));
        let sd_apd(x) [ms]  = surrogate::five::apd90_sd(cv_max(x), tau_in(x), tau_out(x), apd_max(x), r(x));
        let cv(x)     [m/s] = surrogate::five::cv(cv_max(x), tau_in(x), tau_out(x), tau_open(x), r(x));
        let sd_cv(x)  [m/s] = surrogate::five::cv_sd(cv_max(x), tau_in(x), tau_out(x), tau_open(x), r(x));

        observe s1s2(x):   Bracket [ms] ~ Widened(TopHat(erp_s2(x)), sd_s2(x));
        observe s1s2s3(x): Bracket [ms] ~ Widened(TopHat(erp_s3(x)), sd_s3(x));
        observe apd(x):    Number [ms]  ~ Widened(Normal(apd90(x), apd_noise), sd_apd(x));
        observe speed(x):  Number [m/s] ~ Widened(Normal(cv(x), cv_noise), sd_cv(x));
    }
}
