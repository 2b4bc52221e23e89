//! Generated: the ERP polynomials that the models use.  Do not edit; make it again with
//!
//! ```text
//! eplat surrogate design --n 100 --seed 1 --out design.csv
//! eplat surrogate run --design design.csv --out engine/src/surrogate/erp_design.csv
//! eplat surrogate fit --table engine/src/surrogate/erp_design.csv --out engine/src/surrogate/erp_cubic.rs
//! ```

#![allow(clippy::unreadable_literal, reason = "generated")]

use super::cubic::Cubic;

/// ERP_S2 in ms.  63 points, residual RMSE 0.460 and max 1.00, leave-one-out 0.544 ms.
#[rustfmt::skip]
pub(super) const ERP_S2: Cubic = Cubic([
    1.999156350327102e1, // 1
    1.9957410603836738e0, // t
    9.667656886450956e-1, // a
    -2.20921514592529e-2, // t2
    2.5198668225687214e-4, // a2
    7.680643970209497e-3, // ta
    6.312678593824009e-4, // t3
    -8.857149757998965e-7, // a3
    -1.3235820578678077e-4, // t2a
    -2.445714497441818e-6, // ta2
]);

/// ERP_S3 in ms.  63 points, residual RMSE 1.313 and max 3.99, leave-one-out 1.640 ms.
#[rustfmt::skip]
pub(super) const ERP_S3: Cubic = Cubic([
    2.1991160605652766e2, // 1
    -4.623402491722461e0, // t
    -2.625609321759116e0, // a
    1.3062108001546655e-2, // t2
    2.133782139121963e-2, // a2
    9.286308555518569e-2, // ta
    2.339179420793969e-3, // t3
    -4.80255116090395e-5, // a3
    -9.92622174956326e-4, // t2a
    -2.161724846568808e-4, // ta2
]);
