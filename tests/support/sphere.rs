//! A small closed surface, on which a beat is soon simulated.
#![allow(dead_code, clippy::unwrap_used, reason = "tests; each uses a part of it")]

use std::f64::consts::PI;
use std::path::Path;

use eplat::mesh::{Encoding, TriMesh, write_vtk};

/// A sphere of 8 mm radius: no opening, 482 vertices, an atrium of a second.
pub(crate) fn sphere() -> TriMesh {
    const N: u32 = 16;
    let (around, radius) = (2 * N, 8.0);
    let mut vertices = vec![[0.0, 0.0, radius]];
    for ring in 1..N {
        let polar = PI * f64::from(ring) / f64::from(N);
        for i in 0..around {
            let azimuth = 2.0 * PI * f64::from(i) / f64::from(around);
            let (r, z) = (radius * polar.sin(), radius * polar.cos());
            vertices.push([r * azimuth.cos(), r * azimuth.sin(), z]);
        }
    }
    vertices.push([0.0, 0.0, -radius]);
    let at = |ring: u32, i: u32| 1 + (ring - 1) * around + i % around;
    let south = vertices.len() as u32 - 1;
    let mut triangles = vec![];
    for i in 0..around {
        triangles.push([0, at(1, i), at(1, i + 1)]);
        triangles.push([south, at(N - 1, i + 1), at(N - 1, i)]);
        for ring in 1..N - 1 {
            let [a, b] = [at(ring, i), at(ring, i + 1)];
            let [c, d] = [at(ring + 1, i), at(ring + 1, i + 1)];
            triangles.extend([[a, c, b], [b, c, d]]);
        }
    }
    TriMesh::new(vertices, triangles).unwrap()
}

/// Writes it as a file (.vtk).
pub(crate) fn write(path: &Path) {
    write_vtk(path, &sphere(), &[], Encoding::Binary).unwrap();
}
