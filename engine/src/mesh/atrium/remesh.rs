//! Isotropic remeshing on a shape: split long edges, collapse short ones, flip towards regular
//! valence and Delaunay, relax along the surface, and start over.
//!
//! # Source
//! Botsch and Kobbelt 2004, A remeshing approach to multiresolution modeling, §4.

use super::super::connectivity::Connectivity;
use super::polygonise::Soup;
use super::shape::Shape;
use crate::mesh::area_vector;
use nalgebra::Vector3;
use rayon::prelude::*;

type Point = Vector3<f64>;

/// A face may turn by at most this much (cosine) when its vertices are joined or its edge flipped.
const MAX_TURN: f64 = 0.3;
/// Flipping must not make an angle below this one smaller still (cosine of 20°).
const COS_POOR_ANGLE: f64 = 0.94;

/// A surface under change that stays on its shape.
pub(super) struct Remesher<'a> {
    shape: &'a Shape,
    surface: Connectivity,
    positions: Vec<Point>,
    /// The cut whose rim a vertex lies on and may not leave.
    rim: Vec<Option<usize>>,
}

impl<'a> Remesher<'a> {
    pub(super) fn new(shape: &'a Shape, soup: Soup) -> Self {
        let surface = Connectivity::new(soup.positions.len(), &soup.triangles);
        let mut remesher = Self { shape, surface, positions: soup.positions, rim: soup.rim };
        remesher.project(4);
        remesher
    }

    /// One round towards edges of `edge` mm.
    pub(super) fn pass(&mut self, edge: f64) {
        self.split(4.0 / 3.0 * edge);
        self.collapse(0.8 * edge, 4.0 / 3.0 * edge);
        self.flip();
        self.relax(0.9);
    }

    /// Improves the shape of the triangles without changing their number.
    pub(super) fn smooth(&mut self) {
        self.flip();
        self.relax(0.6);
    }

    /// Puts every vertex on the surface, and those of the rims on their planes too.
    pub(super) fn project(&mut self, n_steps: usize) {
        let (shape, rim) = (self.shape, &self.rim);
        self.positions
            .par_iter_mut()
            .zip(rim)
            .for_each(|(p, &cut)| *p = shape.project(*p, cut, n_steps));
    }

    /// The vertices in use, in the order in which the triangles name them, and the triangles.
    pub(super) fn finish(self) -> (Vec<Point>, Vec<[u32; 3]>) {
        let mut new_index = vec![None; self.positions.len()];
        let mut positions = Vec::new();
        let mut triangles = Vec::new();
        for triangle in self.surface.triangles() {
            triangles.push(triangle.map(|v| {
                *new_index[v as usize].get_or_insert_with(|| {
                    positions.push(self.positions[v as usize]);
                    positions.len() as u32 - 1
                })
            }));
        }
        (positions, triangles)
    }

    fn at(&self, v: u32) -> Point {
        self.positions[v as usize]
    }

    fn on_rim(&self, v: u32) -> bool {
        self.rim[v as usize].is_some()
    }

    fn length(&self, [a, b]: [u32; 2]) -> f64 {
        (self.at(b) - self.at(a)).norm()
    }

    /// The edges whose length passes `test`, shortest first.
    fn edges_by_length(&self, test: impl Fn(f64) -> bool) -> Vec<(f64, [u32; 2])> {
        let edges = self.surface.edges().into_iter().map(|edge| (self.length(edge), edge));
        let mut edges: Vec<_> = edges.filter(|(length, _)| test(*length)).collect();
        edges.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        edges
    }

    fn split(&mut self, longest: f64) {
        for (_, [a, b]) in self.edges_by_length(|length| length > longest).into_iter().rev() {
            let cut = if self.surface.is_border(a, b) { self.rim[a as usize] } else { None };
            let middle = (self.at(a) + self.at(b)) / 2.0;
            self.surface.split(a, b);
            self.positions.push(self.shape.project(middle, cut, 2));
            self.rim.push(cut);
        }
    }

    fn collapse(&mut self, shortest: f64, longest: f64) {
        for (_, [a, b]) in self.edges_by_length(|length| length < shortest) {
            // A rim vertex stays; an edge between two of them goes only if it lies on the rim.
            let [from, into] = if self.on_rim(a) && !self.on_rim(b) { [b, a] } else { [a, b] };
            let both_alike = self.on_rim(from) == self.on_rim(into);
            let target =
                if both_alike { (self.at(from) + self.at(into)) / 2.0 } else { self.at(into) };
            if self.may_collapse(from, into) && self.keeps_shape([from, into], &target, longest) {
                self.surface.collapse(from, into);
                self.positions[into as usize] = target;
            }
        }
    }

    fn may_collapse(&self, a: u32, b: u32) -> bool {
        if self.on_rim(a) && self.on_rim(b) {
            let [Some(across), None] = self.surface.opposite(a, b) else { return false };
            if self.on_rim(across) {
                return false;
            }
        }
        self.surface.may_collapse(a, b, |v| if self.on_rim(v) { 1 } else { 3 })
    }

    /// Whether both ends of an edge may move to `target`: no edge gets too long, no face turns over.
    fn keeps_shape(&self, ends: [u32; 2], target: &Point, longest: f64) -> bool {
        ends.into_iter().all(|end| {
            let others = self.surface.around(end).filter(|t| !ends.iter().all(|v| t.contains(v)));
            others.into_iter().all(|triangle| {
                let before = triangle.map(|v| self.at(v));
                let after = triangle.map(|v| if v == end { *target } else { self.at(v) });
                let fits = after.iter().all(|p| (p - target).norm() <= longest);
                let (old, new) = (area_vector(before), area_vector(after));
                // A sliver has no direction to keep.
                let is_sliver = old.norm() < 1e-9;
                fits && new.norm() > 1e-12
                    && (is_sliver || old.dot(&new) > MAX_TURN * old.norm() * new.norm())
            })
        })
    }

    fn flip(&mut self) {
        for [a, b] in self.surface.edges() {
            if let Some(triangles) = self.surface.flipped(a, b)
                && self.gains_by_flip(a, b, triangles)
            {
                self.surface.replace(a, b, triangles);
            }
        }
    }

    /// Whether to flip: valence becomes more regular, or the edge is far from Delaunay; and no face
    /// turns over or becomes thin.
    fn gains_by_flip(&self, a: u32, b: u32, new: [[u32; 3]; 2]) -> bool {
        let [Some(c), Some(d)] = self.surface.opposite(a, b) else { return false };
        let excess = |v: u32| {
            let n = self.surface.n_around(v) as i64;
            if self.on_rim(v) { n - 3 } else { n - 6 }
        };
        let cost = |change: i64| {
            let ends = (excess(a) - change).pow(2) + (excess(b) - change).pow(2);
            ends + (excess(c) + change).pow(2) + (excess(d) + change).pow(2)
        };
        let (before, after) = (cost(0), cost(1));
        // The sum of the cotangents opposite an edge is negative where it is not Delaunay.
        let delaunay_now = self.cotangent(c, a, b) + self.cotangent(d, a, b);
        let delaunay_then = self.cotangent(a, c, d) + self.cotangent(b, c, d);
        let more_regular = after < before && delaunay_then > -0.4;
        let much_better = delaunay_now < -0.26 && after <= before + 2;
        (more_regular || much_better) && self.may_flip([[a, b, c], [a, b, d]], new)
    }

    fn may_flip(&self, old: [[u32; 3]; 2], new: [[u32; 3]; 2]) -> bool {
        let normal = |t: [u32; 3]| area_vector(t.map(|v| self.at(v)));
        let new_normals = new.map(normal);
        let mean = new_normals[0] + new_normals[1];
        let keeps_side =
            new_normals.iter().all(|n| n.dot(&mean) > MAX_TURN * n.norm() * mean.norm());
        let largest_cosine = |triangles: [[u32; 3]; 2]| {
            triangles.into_iter().map(|t| self.largest_cosine(t)).fold(-1.0, f64::max)
        };
        let then = largest_cosine(new);
        keeps_side && (then < COS_POOR_ANGLE || then <= largest_cosine(old))
    }

    /// Cotangent of the angle at `corner`.
    fn cotangent(&self, corner: u32, a: u32, b: u32) -> f64 {
        let (u, w) = (self.at(a) - self.at(corner), self.at(b) - self.at(corner));
        u.dot(&w) / u.cross(&w).norm().max(1e-12)
    }

    /// Cosine of the smallest angle of a triangle.
    fn largest_cosine(&self, triangle: [u32; 3]) -> f64 {
        let p = triangle.map(|v| self.at(v));
        (0..3).fold(-1.0, |largest, k| {
            let (u, w) = (p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]);
            largest.max(u.dot(&w) / (u.norm() * w.norm()).max(1e-12))
        })
    }

    /// Moves every vertex by `step` of the way to the middle of its surroundings, along the surface.
    fn relax(&mut self, step: f64) {
        let moved = (0..self.positions.len() as u32).into_par_iter().map(|v| {
            let p = self.at(v);
            let middle = if self.on_rim(v) { self.middle_on_rim(v) } else { self.centroid(v) };
            middle.map_or(p, |middle| {
                self.shape.project(p.lerp(&middle, step), self.rim[v as usize], 1)
            })
        });
        self.positions = moved.collect();
    }

    /// Area-weighted mean of the centres of the triangles at `v`.
    fn centroid(&self, v: u32) -> Option<Point> {
        let (mut sum, mut weight) = (Point::zeros(), 0.0);
        for triangle in self.surface.around(v) {
            let corners = triangle.map(|v| self.at(v));
            let area = area_vector(corners).norm();
            sum += corners.iter().sum::<Point>() * (area / 3.0);
            weight += area;
        }
        (weight > 0.0).then(|| sum / weight)
    }

    /// Mean of the two neighbours along the rim.
    fn middle_on_rim(&self, v: u32) -> Option<Point> {
        let mut along = self.surface.neighbours(v);
        along.retain(|&w| self.surface.is_border(v, w));
        match along[..] {
            [a, b] => Some((self.at(a) + self.at(b)) / 2.0),
            _ => None,
        }
    }
}
