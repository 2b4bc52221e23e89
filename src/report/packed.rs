//! A surface and the values on it, packed small for the viewer of `report.html`; `viewer/decode.js` unpacks it.
//!
//! - **Whole numbers.** Coordinates count steps of one length, 65,535 of which are the longest side of the
//!   box around the surface. A value is 0 where there is none, else 1 to 65,535 from the smallest to the
//!   largest. So a value is off by at most 1/131,068 of its range, where a scale of 256 colours shows
//!   1/255 of it, and a coordinate of an atrium 80 mm wide by 0.0006 mm.
//! - **A walk.** From one triangle on, the walk goes across edges, depth first, and numbers the vertices as
//!   it meets them. Each edge of the triangles that were met takes one number: 0 if no new triangle lies
//!   beyond, 1 if its third corner is a new vertex, else how far back the number of that corner is. A
//!   piece that cannot be reached begins with three corners.
//! - **Guesses.** A new vertex is guessed from the triangle that the walk came from: its coordinates as
//!   the fourth corner of a parallelogram, its values as those of the plane through the three known ones.
//!   What is kept is how far the guess is off: small numbers, of which first all low and then all high
//!   bytes are deflated.

use std::io::{self, Write as _};
use std::path::Path;

use base64::{Engine as _, engine::general_purpose::STANDARD as BASE64};
use flate2::{Compression, write::DeflateEncoder};
use serde_json::{Value, json};

use super::text::shown;
use super::{PointData, ReportError, Surface};
use crate::mesh::Axes;

/// Steps of a coordinate, and the largest code of a value.
const LARGEST: f64 = 65535.0;
/// Weights of a plane beyond this are those of a thin triangle.
const SOUND: f64 = 4.0;

/// All that the viewer of the page at `path` shows, as JSON with bytes in base64.
///
/// # Errors
/// [`ReportError::PointData`] if an array has not one value per vertex; [`ReportError::Write`].
pub(super) fn packed(path: &Path, surface: &Surface<'_>) -> Result<Value, ReportError> {
    let mesh = surface.mesh;
    let walk = Walk::over(mesh.triangles(), mesh.n_vertices());
    let [low, high] = mesh.bounding_box();
    let longest = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max);
    let step = longest / LARGEST;
    let whole: Vec<[u16; 3]> =
        walk.order.iter().map(|&v| whole(mesh.vertices()[v], low, step)).collect();
    let coordinates: Vec<u8> = (0..3).flat_map(|axis| walk.coordinates(&whole, axis)).collect();
    let planes = walk.planes(&whole);
    let mut arrays = Vec::new();
    for PointData { name, unit, values } in surface.point_data {
        if values.len() != mesh.n_vertices() {
            let (expected, got) = (mesh.n_vertices(), values.len());
            return Err(ReportError::PointData { name: (*name).to_owned(), expected, got });
        }
        let range = range(values);
        let codes: Vec<u16> = walk.order.iter().map(|&v| code(values[v], range)).collect();
        arrays.push(json!({
            "name": name, "unit": shown(unit), "range": range,
            "values": deflated(&walk.values(&codes, &planes)).map_err(ReportError::write(path))?,
        }));
    }
    let micrometres = |x: f64| (1e3 * x).round() / 1e3;
    let sites: Vec<[f64; 3]> = surface.sites.iter().map(|at| at.map(micrometres)).collect();
    Ok(json!({
        "axes": match surface.axes { Axes::Patient => "patient", Axes::Unknown => "unknown" },
        "n_vertices": mesh.n_vertices(), "n_triangles": mesh.n_triangles(),
        "corner": low, "step": step,
        "walk": deflated(&walk.codes).map_err(ReportError::write(path))?,
        "coordinates": deflated(&coordinates).map_err(ReportError::write(path))?,
        "arrays": arrays, "sites": sites,
    }))
}

/// Steps from the corner of the box.
fn whole(at: [f64; 3], corner: [f64; 3], step: f64) -> [u16; 3] {
    std::array::from_fn(|axis| ((at[axis] - corner[axis]) / step).round() as u16)
}

/// The smallest and the largest finite value, if there is any.
fn range(values: &[f64]) -> Option<[f64; 2]> {
    let finite = || values.iter().copied().filter(|v| v.is_finite());
    let [low, high] = [finite().reduce(f64::min)?, finite().reduce(f64::max)?];
    Some([low, high])
}

/// The code of a value; 0 is none.
fn code(value: f64, range: Option<[f64; 2]>) -> u16 {
    match range {
        Some([low, high]) if value.is_finite() && high > low => {
            1 + ((value - low) / (high - low) * (LARGEST - 1.0)).round() as u16
        }
        _ => u16::from(value.is_finite()),
    }
}

fn deflated(bytes: &[u8]) -> io::Result<String> {
    let mut encoder = DeflateEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(bytes)?;
    Ok(BASE64.encode(encoder.finish()?))
}

/// The order in which the vertices were met, from which three each is guessed, and the walk itself.
struct Walk {
    order: Vec<usize>,
    guesses: Vec<[usize; 3]>,
    codes: Vec<u8>,
}

/// What the walk knows while it goes on.
struct Walker<'a> {
    triangles: &'a [[u32; 3]],
    /// Every side as its triangle runs, sorted: from, to, triangle.
    sides: Vec<[u32; 3]>,
    /// New numbers of the vertices that were met.
    numbers: Vec<Option<usize>>,
    walk: Walk,
}

impl Walk {
    fn over(triangles: &[[u32; 3]], n_vertices: usize) -> Self {
        let side = |(t, corners): (usize, &[u32; 3])| {
            let [a, b, c] = *corners;
            [[a, b, t as u32], [b, c, t as u32], [c, a, t as u32]]
        };
        let mut sides: Vec<[u32; 3]> = triangles.iter().enumerate().flat_map(side).collect();
        sides.sort_unstable();
        let walk = Self { order: vec![], guesses: vec![], codes: vec![] };
        let mut walker = Walker { triangles, sides, numbers: vec![None; n_vertices], walk };
        walker.go();
        walker.walk
    }

    /// How far the guess of each coordinate along an axis is off.
    fn coordinates(&self, whole: &[[u16; 3]], axis: usize) -> Vec<u8> {
        let guess = |i: usize| {
            let [a, b, opposite] = self.guesses[i].map(|g| f64::from(whole[g][axis]));
            a + b - opposite
        };
        offsets(whole.iter().map(|at| at[axis]), guess)
    }

    /// How far the guess of each value is off.
    fn values(&self, codes: &[u16], planes: &[[f64; 3]]) -> Vec<u8> {
        let guess = |i: usize| {
            let [a, b, c] = self.guesses[i].map(|g| f64::from(codes[g]));
            planes[i][0] * a + planes[i][1] * b + planes[i][2] * c
        };
        offsets(codes.iter().copied(), guess)
    }

    /// Weights of the plane through the three known vertices, at each vertex. The browser computes the same
    /// to the bit: the same operations in the same order.
    fn planes(&self, whole: &[[u16; 3]]) -> Vec<[f64; 3]> {
        let plane = |(i, guesses): (usize, &[usize; 3])| {
            let [a, b, c] = guesses.map(|g| whole[g].map(f64::from));
            let at = whole[i].map(f64::from);
            let [mut uu, mut uw, mut ww, mut pu, mut pw] = [0.0; 5];
            for axis in 0..3 {
                let (u, w, p) = (b[axis] - a[axis], c[axis] - a[axis], at[axis] - a[axis]);
                uu += u * u;
                uw += u * w;
                ww += w * w;
                pu += p * u;
                pw += p * w;
            }
            let determinant = uu * ww - uw * uw;
            let s: f64 = (ww * pu - uw * pw) / determinant;
            let t: f64 = (uu * pw - uw * pu) / determinant;
            let is_sound = s.abs() < SOUND && t.abs() < SOUND;
            if is_sound { [1.0 - s - t, s, t] } else { [1.0, 1.0, -1.0] }
        };
        self.guesses.iter().enumerate().map(plane).collect()
    }
}

/// Differences of numbers and their guesses, the sign in the lowest bit: all low bytes, then all high bytes.
/// The guess of the first number is 0.
fn offsets(numbers: impl Iterator<Item = u16>, guess: impl Fn(usize) -> f64) -> Vec<u8> {
    let zigzag = |(i, number): (usize, u16)| {
        let guess = if i == 0 { 0.0 } else { (guess(i) + 0.5).floor().clamp(0.0, LARGEST) };
        let off = number.wrapping_sub(guess as u16) as i16;
        ((off << 1) ^ (off >> 15)) as u16
    };
    let zigzags: Vec<u16> = numbers.enumerate().map(zigzag).collect();
    let low = zigzags.iter().map(|z| z.to_le_bytes()[0]);
    low.chain(zigzags.iter().map(|z| z.to_le_bytes()[1])).collect()
}

impl Walker<'_> {
    fn go(&mut self) {
        let mut is_met = vec![false; self.triangles.len()];
        let mut left = self.triangles.len();
        let mut gates: Vec<[u32; 3]> = Vec::new();
        for first in 0..self.triangles.len() {
            if is_met[first] {
                continue;
            }
            is_met[first] = true;
            left -= 1;
            let [a, b, c] = self.triangles[first];
            for corner in [a, b, c] {
                let last = self.walk.order.len().saturating_sub(1);
                self.write(corner, 0, [last; 3]);
            }
            gates.extend([[a, b, c], [b, c, a], [c, a, b]]);
            // the reader stops at the last triangle, and takes no more numbers
            while left > 0
                && let Some([a, b, opposite]) = gates.pop()
            {
                let Some(beyond) = self.across(a, b).filter(|t| !is_met[*t]) else {
                    self.walk.codes.push(0);
                    continue;
                };
                is_met[beyond] = true;
                left -= 1;
                let [p, q, r] = self.triangles[beyond];
                let c = if p != a && p != b {
                    p
                } else if q != a && q != b {
                    q
                } else {
                    r
                };
                let known = [a, b, opposite].map(|v| self.numbers[v as usize].unwrap_or_default());
                self.write(c, 1, known);
                gates.extend([[a, c, b], [c, b, a]]);
            }
        }
    }

    /// The triangle with the side from `b` to `a`.
    fn across(&self, a: u32, b: u32) -> Option<usize> {
        let at = self.sides.partition_point(|side| [side[0], side[1]] < [b, a]);
        self.sides.get(at).filter(|side| [side[0], side[1]] == [b, a]).map(|side| side[2] as usize)
    }

    /// Writes `new` and numbers the vertex if it is met for the first time, else how far back it is.
    fn write(&mut self, vertex: u32, new: usize, guess: [usize; 3]) {
        let met = self.walk.order.len();
        if let Some(number) = self.numbers[vertex as usize] {
            let mut code = met - number + new;
            while code > 127 {
                self.walk.codes.push((code & 127) as u8 | 128);
                code >>= 7;
            }
            self.walk.codes.push(code as u8);
            return;
        }
        self.walk.codes.push(new as u8);
        self.numbers[vertex as usize] = Some(met);
        self.walk.order.push(vertex as usize);
        self.walk.guesses.push(guess);
    }
}
