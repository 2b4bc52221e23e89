//! Forms of effects: right-hand sides of `effect` statements, one file each.
//!
//! A form implements [`EffectForm`]. In a model it is written as a call of the function that makes it,
//! with columns and then numbers: `scaled(row.force_g, 15.0, 7.25)` calls
//! `scaled("force_g", 15.0, 7.25)`. The forms that ship are the functions of this module; any other
//! name is a function in scope of the model file.

mod above;
mod all;
mod family;
mod form;
mod group;
mod logistic;
mod path;
mod saturating;
mod scaled;
mod scaled_by;
mod smooth;
mod surface;

pub use above::{Above, above};
pub use all::all;
pub use family::{families, family};
pub use form::{EffectForm, Extent, Form, of_labels, of_number};
pub use group::group;
pub use logistic::logistic;
pub use path::path;
pub use saturating::saturating;
pub use scaled::scaled;
pub use scaled_by::scaled_by;
pub use smooth::smooth;
pub use surface::surface;
