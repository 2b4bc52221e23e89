//! First arrival of activation over a surface, with an exact adjoint.
//!
//! ```text
//! ∇Tᵀ M⁻¹ ∇T = 1,   T = onset at the sources,   M = s² (f fᵀ + r² g gᵀ)
//! ```
//! with `s` the slowness along the fibres `f`, and `r s` that across them, `g`.  A front that has a thickness is slower
//! where it spreads (`bend.rs`, and along lines from a source `rays.rs`).  Arrivals are at the vertices; the medium is constant in a triangle.  A vertex is reached from its neighbours at the least over all triangles at it
//! (`step.rs`), and near a source along straight lines alone (`rays.rs`).  Arrivals are the fixed point of this
//! (`march.rs`, `policy.rs`).  They are continuous in medium and onsets, but that where fronts from two sources meet they may jump
//! by less than the error of the method.
//!
//! The error is of first order in the edges, and none in a constant medium on a flat surface.
//!
//! Knows nothing of electrophysiology: what is slow, and where fibres run, is given.

#[cfg(test)]
mod accuracy_tests;
mod bend;
mod derivative;
#[cfg(test)]
mod derivative_tests;
mod front;
mod geometry;
mod march;
mod metric;
mod order;
mod orientation;
mod policy;
mod queue;
mod rays;
mod step;
#[cfg(test)]
mod tests;
mod way;

pub use front::Front;

use super::ManifoldError;
use crate::mesh::TriMesh;
use bend::{Bend, Patches};
use geometry::Geometry;
use march::March;
use metric::{measure, slow_down};
use std::sync::Arc;

/// How often [`Eikonal::settled`] takes the mean of a front's slowing and of that by its own shape. Times are nearer to the
/// simulator's with three rounds than with two, and farther off again with four.
const ROUNDS: usize = 3;

/// First arrivals on one surface.
///
/// Fibres are one direction per triangle, or, without, the direction of the third axis (z) in the surface, of the
/// first where the surface is normal to z.
#[derive(Clone, Debug)]
pub struct Eikonal {
    geometry: Arc<Geometry>,
    patches: Patches,
}

/// What the tissue is like at every vertex; a triangle takes the means of its corners.
#[derive(Clone, Copy, Debug, Default)]
pub struct Medium<'a> {
    /// ms/mm along the fibres, > 0 (n_vertices)
    pub slowness: &'a [f64],
    /// Velocity along the fibres over that across, > 0 (n_vertices); 1 everywhere if absent.
    pub ratio: Option<&'a [f64]>,
    /// Angle by which fibres are turned from those of the mesh, about the outward normal, rad (n_vertices); 0 if
    /// absent.
    pub angle: Option<&'a [f64]>,
    /// How thick fronts are, as a time: diffusivity over squared velocity, ms, ≥ 0 (n_vertices); 0 if absent.
    pub thickness: Option<&'a [f64]>,
}

/// Adjoints of a medium and of onsets; what is found is added.
#[derive(Debug)]
pub struct MediumBar<'a> {
    /// (n_vertices)
    pub slowness: &'a mut [f64],
    /// (n_vertices)
    pub ratio: Option<&'a mut [f64]>,
    /// (n_vertices)
    pub angle: Option<&'a mut [f64]>,
    /// (n_vertices)
    pub thickness: Option<&'a mut [f64]>,
    /// One per source.
    pub onsets: &'a mut [f64],
}

impl MediumBar<'_> {
    /// Adds adjoints of slowness, ratio and angle at three vertices.
    fn add(&mut self, corners: [usize; 3], of: [f64; 3]) {
        for v in corners {
            self.slowness[v] += of[0];
            if let Some(ratio) = &mut self.ratio {
                ratio[v] += of[1];
            }
            if let Some(angle) = &mut self.angle {
                angle[v] += of[2];
            }
        }
    }
}

impl Eikonal {
    /// Prepares a surface.  `fibres` are one vector per triangle; their lengths and signs mean nothing, and only
    /// their part in the surface counts.
    ///
    /// # Errors
    /// [`ManifoldError::FibreCount`] and [`ManifoldError::NoFibre`].
    pub fn new(mesh: &TriMesh, fibres: Option<&[[f64; 3]]>) -> Result<Self, ManifoldError> {
        let geometry = Geometry::new(mesh, fibres)?;
        let patches = Patches::new(&geometry);
        Ok(Self { geometry: geometry.into(), patches })
    }

    /// Number of vertices of the surface.
    pub fn n_vertices(&self) -> usize {
        self.geometry.n_vertices()
    }

    /// First arrivals from `sources`, which are (vertex, onset in ms), into `front`.
    ///
    /// # Panics
    /// When the medium is not of the surface's vertices, or a source is none of them.
    pub fn forward(&self, medium: &Medium<'_>, sources: &[(u32, f64)], front: &mut Front) {
        self.forward_each(medium, &[sources], std::slice::from_mut(front));
    }

    /// The same for several activations of one medium, which is measured once, with one of `fronts` for each.
    ///
    /// # Panics
    /// As [`Self::forward`].
    pub fn forward_each<S: AsRef<[(u32, f64)]>>(
        &self,
        medium: &Medium<'_>,
        activations: &[S],
        fronts: &mut [Front],
    ) {
        self.require(medium);
        for front in &mut *fronts {
            front.plain = medium.thickness.map(|_| front.plain.take().unwrap_or_default());
        }
        if let Some((first, others)) = fronts.split_first_mut() {
            let first = first.without_thickness();
            measure(&self.geometry, medium, &mut first.tissue, &mut first.timed);
            for front in others {
                let front = front.without_thickness();
                front.tissue.clone_from(&first.tissue);
                front.timed.clone_from(&first.timed);
            }
        }
        for (sources, front) in activations.iter().zip(fronts) {
            self.march(sources.as_ref(), front.without_thickness());
            let (Some(thickness), Some(plain)) = (medium.thickness, front.plain.take()) else {
                continue;
            };
            front.slowing = self.bend(&plain, &plain.arrival, thickness).slowing();
            front.thickness.clear();
            front.thickness.extend(self.geometry.triangles.iter().map(|t| t.mean(thickness)));
            self.march_slowed(medium, sources.as_ref(), plain, front);
        }
    }

    /// Arrivals (n_vertices) of fronts whose slowing is that of their own shape, about: [`Self::forward`] takes that of fronts
    /// that bend at no cost. No derivatives follow, so `front` has no arrivals then.
    ///
    /// # Panics
    /// As [`Self::forward`].
    pub fn settled(
        &self,
        medium: &Medium<'_>,
        sources: &[(u32, f64)],
        front: &mut Front,
    ) -> Vec<f64> {
        self.forward(medium, sources, front);
        for _ in 0..ROUNDS {
            let Some((thickness, plain)) = medium.thickness.zip(front.plain.take()) else { break };
            let own = self.bend(&plain, &front.arrival, thickness).slowing();
            front.slowing.iter_mut().zip(own).for_each(|(last, own)| *last = 0.5 * (*last + own));
            self.march_slowed(medium, sources, plain, front);
        }
        std::mem::take(&mut front.arrival)
    }

    /// A front that is slower by its parts than `plain`.
    fn march_slowed(
        &self,
        medium: &Medium<'_>,
        sources: &[(u32, f64)],
        plain: Box<Front>,
        front: &mut Front,
    ) {
        let slowness = slower(medium.slowness, &front.slowing);
        front.tissue.clone_from(&plain.tissue);
        front.timed.clone_from(&plain.timed);
        front.rays = Arc::clone(&plain.rays);
        slow_down(&self.geometry, &slowness, &mut front.tissue, &mut front.timed);
        front.plain = Some(plain);
        self.march(sources, front);
    }

    fn march(&self, sources: &[(u32, f64)], front: &mut Front) {
        front.linear.take();
        March::new(&self.geometry, sources, front).run();
        front.sort(&self.geometry);
    }

    /// Of a front with these arrivals, in the medium of `plain`.
    fn bend<'a>(&'a self, plain: &'a Front, arrival: &'a [f64], thickness: &'a [f64]) -> Bend<'a> {
        let Self { geometry, patches } = self;
        Bend { geometry, patches, tissue: &plain.tissue, thickness, arrival }
    }

    /// Adds to `into` the adjoint of the medium and the onsets, for the adjoint `bar` of the arrivals
    /// (n_vertices) of the last `forward` into `front`, with the same `medium`.  Vertices never reached are left
    /// out.
    ///
    /// # Panics
    /// When a length is not that of the surface or of the sources.
    pub fn backward(
        &self,
        medium: &Medium<'_>,
        front: &Front,
        bar: &[f64],
        into: &mut MediumBar<'_>,
    ) {
        self.require(medium);
        assert_eq!(bar.len(), self.n_vertices(), "an adjoint of each arrival");
        let Some((thickness, plain)) = medium.thickness.zip(front.plain.as_deref()) else {
            derivative::backward(&self.geometry, front, bar, into);
            return;
        };
        let n = self.n_vertices();
        let (mut slowness, mut arrival) = (vec![0.0; n], vec![0.0; n]);
        let mut bent = MediumBar {
            slowness: &mut slowness,
            ratio: into.ratio.as_deref_mut(),
            angle: into.angle.as_deref_mut(),
            thickness: None,
            onsets: into.onsets,
        };
        let total = derivative::backward(&self.geometry, front, bar, &mut bent);
        derivative::backward_lines(&self.geometry, front, &total, into);
        for (v, bar) in slowness.iter_mut().enumerate() {
            into.slowness[v] += *bar * (1.0 + front.slowing[v]);
            *bar *= medium.slowness[v];
        }
        self.bend(plain, &plain.arrival, thickness).pull(
            &front.slowing,
            &slowness,
            into,
            &mut arrival,
        );
        derivative::backward(&self.geometry, plain, &arrival, into);
    }

    /// Change of the arrivals (n_vertices), into `out`, for a small `change` of the medium and `onset_change` of the
    /// onsets, about the last `forward` into `front`, with the same `medium`.
    ///
    /// # Panics
    /// When a length is not that of the surface or of the sources.
    pub fn push(
        &self,
        medium: &Medium<'_>,
        front: &Front,
        change: &Medium<'_>,
        onset_change: &[f64],
        out: &mut [f64],
    ) {
        self.require(medium);
        self.require(change);
        assert_eq!(out.len(), self.n_vertices(), "a change of each arrival");
        let Some((thickness, plain)) = medium.thickness.zip(front.plain.as_deref()) else {
            derivative::push(&self.geometry, front, [change; 2], onset_change, out);
            return;
        };
        derivative::push(&self.geometry, plain, [change; 2], onset_change, out);
        let slowing = self.bend(plain, &plain.arrival, thickness).push(&front.slowing, change, out);
        let mut slowness = slower(change.slowness, &front.slowing);
        for (v, slower) in slowness.iter_mut().enumerate() {
            *slower += medium.slowness[v] * slowing[v];
        }
        let slowed = Medium { slowness: &slowness, ..*change };
        derivative::push(&self.geometry, front, [&slowed, change], onset_change, out);
    }

    fn require(&self, medium: &Medium<'_>) {
        let n = self.n_vertices();
        let of = |values: Option<&[f64]>| values.is_none_or(|values| values.len() == n);
        let fits = medium.slowness.len() == n
            && [medium.ratio, medium.angle, medium.thickness].into_iter().all(of);
        assert!(fits, "a medium of the surface's {n} vertices");
    }
}

/// Slowness where it is larger by these parts.
fn slower(slowness: &[f64], slowing: &[f64]) -> Vec<f64> {
    slowness.iter().zip(slowing).map(|(s, part)| s * (1.0 + part)).collect()
}
