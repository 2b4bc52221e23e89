//! Tables of measurements: one row each, columns by name.
//!
//! A [`Table`] holds columns whose cells were parsed once ([`TypedColumn`]) and knows what they mean
//! ([`Columns`]). [`Measurements`] are a table whose rows have a place on a surface ([`Placement`]) and,
//! for effects that are fields, the surface's modes there ([`Probes`]).

mod cells;
mod column;
mod columns;
mod error;
mod finer;
mod ground;
mod habits;
mod measurements;
mod placement;
mod probes;
mod read;
mod sheet;
mod text;
mod typed;

pub use column::{Content, TypedColumn};
pub use columns::{Columns, EXPORTED, MEASURED, PATH, PROTOCOL, Role, SITE, SOURCE, VERTEX};
pub use error::{DataError, near};
pub use finer::Finer;
pub use ground::{Fineness, Ground, Triangulation};
pub use measurements::Measurements;
pub use placement::Placement;
pub use probes::{FIELD_MODES, ProbeError, Probes};
pub use sheet::{as_cell, csv_line, from_cell};
pub use text::decode;
pub use typed::Table;
