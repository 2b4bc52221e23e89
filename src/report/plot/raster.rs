//! A surface as pixels: what of it is in front, how it is shaded, and whether a place is hidden.

use nalgebra::Vector3;
use rayon::prelude::*;

use super::palette::{Colour, VOID, mixed};
use super::picture::PER_UNIT;
use super::png::Image;
use super::view::Frame;
use crate::mesh::TriMesh;

/// Samples along each side of a pixel; their mean makes edges smooth.
const SAMPLES: usize = 2;
/// How bright a wall is that is seen edge-on; one that faces the viewer has the colour of the bar.
const EDGE_ON: f64 = 0.72;
/// Share of grey in what is seen of the inside, through an opening.
const INSIDE: f64 = 0.6;
const INSIDE_GREY: Colour = [205, 205, 205];
/// A place this deep below what is in front of it, as a share of the picture's width, is hidden.
const BEHIND: f64 = 0.012;
/// No triangle.
const NONE: u32 = u32::MAX;

/// A surface with the directions of its vertices.
#[derive(Debug)]
pub(super) struct Shape<'m> {
    pub(super) mesh: &'m TriMesh,
    /// Unit vectors, outwards on a surface that is all but closed.
    normals: Vec<Vector3<f64>>,
    /// A sheet has no inside.
    is_sheet: bool,
}

impl<'m> Shape<'m> {
    pub(super) fn new(mesh: &'m TriMesh) -> Self {
        let at = |v: u32| Vector3::from(mesh.vertices()[v as usize]);
        let centre = mesh.vertices().iter().copied().map(Vector3::from).sum::<Vector3<f64>>()
            / mesh.n_vertices() as f64;
        let mut normals = vec![Vector3::zeros(); mesh.n_vertices()];
        let (mut volume, mut area) = (0.0, 0.0);
        for triangle in mesh.triangles() {
            let [a, b, c] = triangle.map(at);
            let normal = (b - a).cross(&(c - a));
            volume += normal.dot(&(a - centre)) / 6.0;
            area += 0.5 * normal.norm();
            for vertex in triangle {
                normals[*vertex as usize] += normal;
            }
        }
        let outwards = if volume < 0.0 { -1.0 } else { 1.0 };
        for normal in &mut normals {
            *normal *= outwards / normal.norm().max(f64::MIN_POSITIVE);
        }
        // a sphere has 36π V² = A³; a tenth of that is far from any chamber
        let roundness = 36.0 * std::f64::consts::PI * volume * volume / area.powi(3);
        Self { mesh, normals, is_sheet: roundness < 0.02 }
    }
}

/// The value of an array (n_vertices) at a place on the surface.
pub(super) type At<'a> = dyn Fn(&[f64]) -> f64 + 'a;

/// A surface in a view: for each sample the triangle in front, where on it, and how near.
#[derive(Debug)]
pub(super) struct Seen<'s> {
    shape: &'s Shape<'s>,
    frame: Frame,
    /// Samples from left to right, and from top to bottom.
    size: [usize; 2],
    triangle: Vec<u32>,
    weights: Vec<[f32; 2]>,
    nearness: Vec<f32>,
}

impl<'s> Seen<'s> {
    pub(super) fn new(shape: &'s Shape<'s>, frame: Frame) -> Self {
        let size = frame.size.map(|units| (units * PER_UNIT).round() as usize * SAMPLES);
        let n = size[0] * size[1];
        let mut seen = Self {
            shape,
            size,
            triangle: vec![NONE; n],
            weights: vec![[0.0; 2]; n],
            nearness: vec![f32::NEG_INFINITY; n],
            frame,
        };
        let places: Vec<[f64; 3]> =
            shape.mesh.vertices().iter().map(|v| seen.frame.project(*v)).collect();
        for (number, triangle) in shape.mesh.triangles().iter().enumerate() {
            seen.cover(number as u32, triangle.map(|v| places[v as usize]));
        }
        seen
    }

    /// Samples per unit.
    fn density() -> f64 {
        PER_UNIT * SAMPLES as f64
    }

    fn cover(&mut self, number: u32, corners: [[f64; 3]; 3]) {
        let [a, b, c] = corners.map(|[x, y, z]| [x * Self::density(), y * Self::density(), z]);
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        if area == 0.0 {
            return; // edge-on
        }
        let range = |k: usize| {
            let (low, high) = (a[k].min(b[k]).min(c[k]), a[k].max(b[k]).max(c[k]));
            (low - 0.5).ceil().max(0.0) as usize
                ..((high + 0.5).floor().max(0.0) as usize).min(self.size[k])
        };
        for row in range(1) {
            for column in range(0) {
                let (x, y) = (column as f64 + 0.5, row as f64 + 0.5);
                let side = |p: [f64; 3], q: [f64; 3]| {
                    ((p[0] - x) * (q[1] - y) - (p[1] - y) * (q[0] - x)) / area
                };
                let (u, v) = (side(b, c), side(c, a));
                let w = 1.0 - u - v;
                if u < 0.0 || v < 0.0 || w < 0.0 {
                    continue;
                }
                let (at, near) =
                    (row * self.size[0] + column, (u * a[2] + v * b[2] + w * c[2]) as f32);
                if near > self.nearness[at] {
                    self.nearness[at] = near;
                    self.triangle[at] = number;
                    self.weights[at] = [u as f32, v as f32];
                }
            }
        }
    }

    /// Whether nothing of the surface is in front of a place on it, in units with its nearness.
    pub(super) fn is_visible(&self, [x, y, near]: [f64; 3]) -> bool {
        let [column, row] = [x, y].map(|place| (place * Self::density()).floor());
        if column < 0.0 || row < 0.0 {
            return false;
        }
        let [column, row] = [column as usize, row as usize];
        column < self.size[0]
            && row < self.size[1]
            && near
                > f64::from(self.nearness[row * self.size[0] + column])
                    - BEHIND * self.frame.size[0]
    }

    /// Whether the outside of the surface at a vertex is turned to the viewer, and nothing is in front of it.
    pub(super) fn shows(&self, vertex: u32) -> bool {
        let faces = self.frame.facing(&self.shape.normals[vertex as usize]) > 0.0;
        (faces || self.shape.is_sheet)
            && self.is_visible(self.frame.project(self.shape.mesh.vertices()[vertex as usize]))
    }

    pub(super) fn mesh(&self) -> &TriMesh {
        self.shape.mesh
    }

    pub(super) fn frame(&self) -> &Frame {
        &self.frame
    }

    /// The pixels; `colour` is told how to read arrays (n_vertices) at a place.
    pub(super) fn image(&self, colour: &(dyn Fn(&At<'_>) -> Colour + Sync)) -> Image {
        const N: usize = SAMPLES * SAMPLES;
        let [width, height] = self.size.map(|n| n / SAMPLES);
        let pixel = |at: usize| {
            let (column, row) = (SAMPLES * (at % width), SAMPLES * (at / width));
            let mut sum = [N as u32 / 2; 3]; // to round, not to cut
            for k in 0..N {
                let (x, y) = (column + k % SAMPLES, row + k / SAMPLES);
                let sample = self.sample(y * self.size[0] + x, colour);
                for (sum, own) in sum.iter_mut().zip(sample) {
                    *sum += u32::from(own);
                }
            }
            let mean = |k: usize| (sum[k] / N as u32) as u8;
            [mean(0), mean(1), mean(2)]
        };
        Image { width, height, pixels: (0..width * height).into_par_iter().map(pixel).collect() }
    }

    fn sample(&self, at: usize, colour: &dyn Fn(&At<'_>) -> Colour) -> Colour {
        if self.triangle[at] == NONE {
            return [255; 3];
        }
        let [a, b, c] = self.shape.mesh.triangles()[self.triangle[at] as usize];
        let corners = [a as usize, b as usize, c as usize];
        let [u, v] = self.weights[at];
        let (u, v) = (f64::from(u), f64::from(v));
        let weights = [u, v, 1.0 - u - v];
        // loops: `map` and sums of vectors are not inlined in this crate
        let mut normal = [0.0; 3];
        for (corner, weight) in corners.iter().zip(weights) {
            let of_corner: &[f64; 3] = self.shape.normals[*corner].as_ref();
            for (sum, x) in normal.iter_mut().zip(of_corner) {
                *sum += weight * x;
            }
        }
        let [x, y, z] = normal;
        let length = (x * x + y * y + z * z).sqrt().max(f64::MIN_POSITIVE);
        let facing = self.frame.facing(&normal.into()) / length;
        let flat = colour(&|values: &[f64]| interpolated(values, corners, weights));
        if facing < 0.0 && !self.shape.is_sheet {
            return mixed(flat, INSIDE_GREY, INSIDE);
        }
        mixed([0; 3], flat, EDGE_ON + (1.0 - EDGE_ON) * facing.abs().min(1.0).sqrt())
    }
}

/// Linear in a triangle; where a corner has no value, that of the nearest corner.
fn interpolated(values: &[f64], corners: [usize; 3], weights: [f64; 3]) -> f64 {
    let at = |v: usize| values.get(v).copied().unwrap_or(f64::NAN);
    let ([a, b, c], [u, v, w]) = (corners, weights);
    let value = u * at(a) + v * at(b) + w * at(c);
    if value.is_finite() {
        return value;
    }
    let nearest = (0..3).max_by(|a, b| weights[*a].total_cmp(&weights[*b])).unwrap_or(0);
    at(corners[nearest])
}

/// A bar of colours, from the top share 1 to the bottom 0; across it shares from 0 to 1, too.
pub(super) fn bar(size: [f64; 2], colour: &dyn Fn(f64, f64) -> Colour) -> Image {
    let [width, height] = size.map(|units| (units * PER_UNIT).round() as usize);
    let share = |at: usize, n: usize| (at as f64 + 0.5) / n as f64;
    let rows = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let pixels = rows.map(|(x, y)| colour(1.0 - share(y, height), share(x, width)));
    Image { width, height, pixels: pixels.collect() }
}

/// Grey without a value.
pub(super) fn faded(colour: Colour, share: f64) -> Colour {
    if share.is_nan() { VOID } else { mixed(colour, VOID, share.clamp(0.0, 1.0)) }
}
