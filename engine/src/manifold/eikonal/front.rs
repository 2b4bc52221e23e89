//! What a front leaves: arrivals, and how each came about.

use super::derivative::Linear;
use super::geometry::Geometry;
use super::metric::{Timed, Tissue};
use super::order::Order;
use super::queue::Queue;
use super::rays::Rays;
use super::way::{NONE, Way};
use std::sync::{Arc, OnceLock};

/// Arrival times, and how each came about; memory is reused between calls.
#[derive(Clone, Debug, Default)]
pub struct Front {
    /// First arrival of activation at each vertex, ms (n_vertices); infinite where no source leads.
    pub arrival: Vec<f64>,
    pub(super) ways: Vec<Way>,
    /// How each vertex is reached, (n_vertices).
    pub(super) reached: Vec<Reached>,
    /// Onset of each source, ms.
    pub(super) births: Vec<f64>,
    pub(super) tissue: Vec<Tissue>,
    pub(super) timed: Vec<Timed>,
    /// Lines from its sources, kept until it begins at others.
    pub(super) rays: Arc<Rays>,
    /// Those of `rays`; all [`NONE`] where every front is taken to be plane.
    pub(super) own: Vec<u32>,
    pub(super) queue: Queue,
    pub(super) order: Order,
    /// Where fronts have a thickness: what they would be without.
    pub(super) plain: Option<Box<Self>>,
    /// By how much each vertex is slower than without, as a part (n_vertices).
    pub(super) slowing: Vec<f64>,
    /// How thick fronts are in each triangle, ms.
    pub(super) thickness: Vec<f64>,
    /// Its derivatives, once a change was asked for.
    pub(super) linear: OnceLock<Linear>,
}

/// How a vertex is reached, as far as is known.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reached {
    /// ms; infinite before it is reached.
    pub(super) arrival: f64,
    /// The source that the front was born at; [`NONE`] if it is one of neighbours.
    pub(super) origin: u32,
    /// How often it was taken up.
    pub(super) turns: u8,
    /// How often its origin was another.
    pub(super) moves: u8,
    /// Whether those reached from it may now be reached later.
    pub(super) has_changed: bool,
}

impl Reached {
    pub(super) const NOT: Self =
        Self { arrival: f64::INFINITY, origin: NONE, turns: 0, moves: 0, has_changed: false };
}

impl Front {
    /// What it would be if fronts had no thickness: itself, where they have none.
    pub(super) fn without_thickness(&mut self) -> &mut Self {
        if self.plain.is_none() { self } else { self.plain.get_or_insert_default() }
    }

    /// For lines from this source, if fronts have a thickness: the medium in which they would have none, and the
    /// thickness of each triangle. No line of a source with neighbours is like that: its front is not born at a point.
    pub(super) fn plain_medium(&self, source: u32) -> Option<(&[Tissue], &[f64])> {
        let plain = self.plain.as_ref().filter(|_| self.own[source as usize] != NONE)?;
        Some((&plain.tissue, &self.thickness))
    }

    /// Puts the vertices in the order of their dependence.
    pub(super) fn sort(&mut self, geometry: &Geometry) {
        let ways = &self.ways;
        self.order.find(geometry.n_vertices(), |v| geometry.parents(ways[v as usize]));
    }
}
