//! Generated: the ERP polynomials that the models use.  Do not edit; make it again with
//!
//! ```text
//! eplat surrogate design --n 100 --seed 1 --out design.csv
//! eplat surrogate run --design design.csv --out src/surrogate/erp_design.csv
//! eplat surrogate fit --table src/surrogate/erp_design.csv --out src/surrogate/erp_cubic.rs
//! ```

#![allow(clippy::unreadable_literal, reason = "generated")]

use super::cubic::Cubic;

/// ERP_S2 in ms.  63 points, residual RMSE 0.460 and max 1.00, leave-one-out 0.544 ms.
#[rustfmt::skip]
pub(super) const ERP_S2: Cubic = Cubic([
    1.9991563503274666e1, // 1
    1.9957410603835075e0, // t
    9.667656886450479e-1, // a
    -2.2092151459249774e-2, // t2
    2.5198668225708324e-4, // a2
    7.68064397021072e-3, // ta
    6.312678593823766e-4, // t3
    -8.857149758002072e-7, // a3
    -1.3235820578679031e-4, // t2a
    -2.4457144974441897e-6, // ta2
]);

/// ERP_S3 in ms.  63 points, residual RMSE 1.313 and max 3.99, leave-one-out 1.640 ms.
#[rustfmt::skip]
pub(super) const ERP_S3: Cubic = Cubic([
    2.1991160605654818e2, // 1
    -4.623402491723311e0, // t
    -2.625609321759402e0, // a
    1.3062108001561037e-2, // t2
    2.1337821391220955e-2, // a2
    9.286308555519306e-2, // ta
    2.339179420793872e-3, // t3
    -4.8025511609041564e-5, // a3
    -9.926221749563845e-4, // t2a
    -2.1617248465689683e-4, // ta2
]);
