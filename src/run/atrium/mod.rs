//! Simulations of a paced atrium: from parameter fields on a surface to maps of activation and recovery,
//! once or for each of several draws of a posterior.
//!
//! [`Atrium::new`] prepares a simulation; [`Atrium::simulate`] does it in memory, and
//! [`Atrium::simulate_into`] with an output folder, from which an interrupted simulation goes on to the same
//! numbers. [`Vulnerability`] does S1S2 at many sites. The equations are those of [`ep::surface`](crate::ep::surface).
//!
//! ```no_run
//! use eplat::mesh::Units;
//! use eplat::run::atrium::{Atrium, AtriumSettings, Ground, PacingSettings, Watch};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let pacing = PacingSettings { pace: vec![0], beats: 1, ..PacingSettings::default() };
//! let settings = AtriumSettings { pacing, ..AtriumSettings::default() };
//! let ground = Ground::read("out/erp/fields.vtp".as_ref(), Units::Mm)?;
//! if let Some(beat) = Atrium::new(ground, &settings)?.simulate(Watch::default())? {
//!     let (name, values) = &beat.maps[5];
//!     println!("{name} at the first vertex: {} ms", values[0]);
//! }
//! # Ok(())
//! # }
//! ```

mod compare;
mod drive;
mod ensemble;
mod error;
mod folder;
mod ground;
mod once;
mod opencarp;
mod pacing;
mod posterior;
mod record;
mod series;
mod settings;
mod setup;
mod tissue;
mod vulnerability;

pub use compare::{Map, MapDifference};
pub use drive::{Event, Watch};
pub use error::AtriumError;
pub use folder::{Begin, Ended, Resume};
pub use ground::Ground;
pub use once::Beat;
pub use opencarp::{Exported, export_opencarp};
pub use record::{AtriumRecord, Summary};
pub use settings::{AtriumSettings, Numerics, PacingSettings, Source, TissueSettings};
pub use setup::{Atrium, Warning};
pub use vulnerability::{
    Outcome, Response, S1S2Settings, SiteSummary, Vulnerability, VulnerabilityEnded,
    VulnerabilityRecord,
};
