//! The models that ship, as they are compiled into the program.

use eplat::model::Declare;

/// The model in a file of the folder `models`, by its name without the ending.
pub(crate) fn shipped(file: &str) -> &'static dyn Declare {
    let named = eplat_models::MODELS.iter().find(|own| own.file == format!("{file}.rs"));
    named.unwrap_or_else(|| panic!("no models/{file}.rs")).model
}
