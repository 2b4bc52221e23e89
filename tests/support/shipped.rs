//! The models that ship, as they are compiled into the program.

use eplat::model::Declare;

/// The model in a file of the folder `models`, by the name of the file without `.rs`.
pub(crate) fn shipped(name: &str) -> &'static dyn Declare {
    let named = eplat_models::MODELS.iter().find(|own| own.file == format!("{name}.rs"));
    named.unwrap_or_else(|| panic!("no models/{name}.rs")).model
}
