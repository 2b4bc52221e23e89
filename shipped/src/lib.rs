//! The models that ship: the files of the folder `models`, compiled.
//!
//! A crate of its own, so that it is compiled beside the program's commands and in one codegen unit, which
//! inlines the arithmetic of dual numbers.

#![recursion_limit = "512"]

// models name the whole, of which they need this part alone
extern crate eplat_engine as eplat;

use eplat_engine::model::Compiled;

#[path = "../../models/apd_restitution.rs"]
mod apd_restitution;
#[path = "../../models/conduction_erp.rs"]
mod conduction_erp;
#[path = "../../models/custom.rs"]
mod custom;
#[path = "../../models/cv_restitution.rs"]
mod cv_restitution;
#[path = "../../models/eight_schools.rs"]
mod eight_schools;
#[path = "../../models/erp.rs"]
mod erp;
#[path = "../../models/erp_emulated.rs"]
mod erp_emulated;
#[path = "../../models/erp_exact.rs"]
mod erp_exact;
#[path = "../../models/erp_multiscale.rs"]
mod erp_multiscale;
#[path = "../../models/erp_population.rs"]
mod erp_population;
#[path = "../../models/erp_robust.rs"]
mod erp_robust;
#[path = "../../models/garch.rs"]
mod garch;
#[path = "../../models/joint.rs"]
mod joint;
#[path = "../../models/lat.rs"]
mod lat;
#[path = "../../models/lat_fibres.rs"]
mod lat_fibres;
#[path = "../../models/lat_local.rs"]
mod lat_local;
#[path = "../../models/lat_rates.rs"]
mod lat_rates;
#[path = "../../models/lat_velocity.rs"]
mod lat_velocity;
#[path = "../../models/normal.rs"]
mod normal;
#[path = "../../models/one_compartment.rs"]
mod one_compartment;
#[path = "../../models/recovery.rs"]
mod recovery;
#[path = "../../models/regression.rs"]
mod regression;
#[path = "../../models/restitution.rs"]
mod restitution;
#[path = "../../models/voltage.rs"]
mod voltage;

/// The model in a file of the folder `models`, with its text.
macro_rules! shipped {
    ($file:literal, $model:expr) => {
        Compiled {
            file: $file,
            source: include_str!(concat!("../../models/", $file)),
            model: $model,
        }
    };
}

/// All of them, by the names of their files.
pub const MODELS: &[Compiled] = &[
    shipped!("apd_restitution.rs", &apd_restitution::ApdRestitution),
    shipped!("conduction_erp.rs", &conduction_erp::ConductionErp),
    shipped!("custom.rs", &custom::Custom),
    shipped!("cv_restitution.rs", &cv_restitution::CvRestitution),
    shipped!("eight_schools.rs", &eight_schools::EightSchools),
    shipped!("erp.rs", &erp::Erp),
    shipped!("erp_emulated.rs", &erp_emulated::ErpEmulated),
    shipped!("erp_exact.rs", &erp_exact::ErpExact),
    shipped!("erp_multiscale.rs", &erp_multiscale::ErpMultiscale),
    shipped!("erp_population.rs", &erp_population::ErpPopulation),
    shipped!("erp_robust.rs", &erp_robust::ErpRobust),
    shipped!("garch.rs", &garch::Garch),
    shipped!("joint.rs", &joint::Joint),
    shipped!("lat.rs", &lat::Lat),
    shipped!("lat_fibres.rs", &lat_fibres::LatFibres),
    shipped!("lat_local.rs", &lat_local::LatLocal),
    shipped!("lat_rates.rs", &lat_rates::LatRates),
    shipped!("lat_velocity.rs", &lat_velocity::LatVelocity),
    shipped!("normal.rs", &normal::MeanAndSpread),
    shipped!("one_compartment.rs", &one_compartment::OneCompartment),
    shipped!("recovery.rs", &recovery::Recovery),
    shipped!("regression.rs", &regression::Regression),
    shipped!("restitution.rs", &restitution::Restitution),
    shipped!("voltage.rs", &voltage::Voltage),
];
