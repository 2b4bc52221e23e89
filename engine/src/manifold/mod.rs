//! The Laplace–Beltrami operator of a surface: eigenpairs, distances and measurement sites.
//!
//! Lengths are millimetres; knows nothing of probability or electrophysiology.

mod basis;
mod cached;
mod cholesky;
mod distance;
mod eigen;
mod eikonal;
mod error;
mod gradient;
mod harmonic;
mod interpolate;
mod lanczos;
mod laplacian;
mod npz;
mod path;
mod sites;
#[cfg(test)]
mod test_meshes;

pub use basis::Basis;
pub use cached::{eigenpairs_are_cached, eigenpairs_cached};
pub use distance::{Geodesic, biharmonic};
pub use eigen::eigenpairs;
pub use eikonal::{Eikonal, Front, Medium, MediumBar};
pub use error::ManifoldError;
pub use gradient::Gradient;
pub use harmonic::harmonic;
pub use interpolate::interpolate_biharmonic;
pub use laplacian::{Csr, Laplacian};
pub use path::{Paths, integrate_along_paths};
pub use sites::{maximin, nearest_vertex, random_maximin};
#[cfg(test)]
pub(crate) use test_meshes::made_up;
