//! Activation by the surface simulator, on sheets and on an atrium with fibres.
#![allow(dead_code, clippy::unwrap_used, reason = "tests; each uses a part of it")]

use eplat::ep::Parameters;
use eplat::ep::surface::{Fibres, Pacing, Simulation, Substrate};
use eplat::mesh::{TriMesh, halfway};

const DT: f64 = 0.1;
/// With this `tau_in` fronts are so thick that edges of 0.4 mm resolve them also across fibres. At 0.05 ms the
/// simulator's own anisotropy depends on the mesh, and its times on the atrium differ by 7 ms from those that CV on
/// sheets foretells.
pub(crate) const TAU_IN: f64 = 0.15;

/// Activation times after one stimulus at `paced`, ms. `cv` is `CV_max` along fibres at every vertex, mm/ms.
pub(crate) fn activation(
    mesh: &TriMesh,
    (fibres, ratio): (&[[f64; 3]], f64),
    cv: &[f64],
    paced: Vec<u32>,
    end: f64,
) -> Vec<f64> {
    let tissue = |cv: &f64| Parameters::from_array([*cv, TAU_IN, 10.0, 120.0, 200.0]).tissue();
    let tissue: Vec<_> = cv.iter().map(tissue).collect();
    let fibres = Fibres::new(mesh, fibres, ratio).unwrap();
    let substrate = Substrate { mesh, tissue: &tissue, fibres: Some(&fibres) };
    let pacing = Pacing { vertices: paced, times: vec![0.0], strength: 1.0, end, measured: 0 };
    let mut simulation = Simulation::<f32>::new(&substrate, &pacing, DT).unwrap();
    rayon::scope(|_| {
        while !simulation.is_done() {
            simulation.step().unwrap();
        }
    });
    simulation.beat().lat
}

/// CV of a plane front along a sheet with such edges, mm/ms.
pub(crate) fn velocity(edge: f64, fibre: [f64; 3], (cv, ratio): (f64, f64)) -> f64 {
    let (n, length) = ((18.0 / edge).round() as u32, 18.0);
    let edge = length / f64::from(n);
    let nodes = (0..=n).flat_map(|i| (0..3).map(move |j| (i, j)));
    let vertices = nodes.map(|(i, j)| [f64::from(i) * edge, f64::from(j) * edge, 0.0]).collect();
    let cut = |(i, j): (u32, u32)| {
        let [p, q, r, s] = [3 * i + j, 3 * i + j + 1, 3 * i + j + 3, 3 * i + j + 4];
        if (i + j) % 2 == 0 { [[p, s, q], [p, r, s]] } else { [[p, r, q], [q, r, s]] }
    };
    let triangles = (0..n).flat_map(|i| (0..2).map(move |j| (i, j))).flat_map(cut).collect();
    let mesh = TriMesh::new(vertices, triangles).unwrap();
    let paced = (0..mesh.n_vertices() as u32).filter(|v| mesh.vertices()[*v as usize][0] < 1.3);
    let n_vertices = mesh.n_vertices();
    let fibres = vec![fibre; n_vertices];
    let lat = activation(&mesh, (&fibres, ratio), &vec![cv; n_vertices], paced.collect(), 60.0);
    let (a, b) = (n / 3, 2 * n / 3);
    f64::from(b - a) * edge / (lat[3 * b as usize] - lat[3 * a as usize])
}

/// Fibres of triangles, from those of vertices.
pub(crate) fn per_triangle(mesh: &TriMesh, fibres: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let of = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| fibres[v as usize]);
        halfway(halfway(a, b), c)
    };
    mesh.triangles().iter().map(of).collect()
}

/// Directions round the third axis.
pub(crate) fn round(mesh: &TriMesh) -> Vec<[f64; 3]> {
    let middle = mesh.bounding_box();
    let middle: [f64; 3] = std::array::from_fn(|k| 0.5 * (middle[0][k] + middle[1][k]));
    let at = |p: &[f64; 3]| {
        let d: [f64; 3] = std::array::from_fn(|k| p[k] - middle[k]);
        [-d[1], d[0], 0.0]
    };
    mesh.vertices().iter().map(at).collect()
}

/// Unit normal of each vertex.
pub(crate) fn normals(mesh: &TriMesh) -> Vec<[f64; 3]> {
    let mut normals = vec![[0.0; 3]; mesh.n_vertices()];
    for t in mesh.triangles() {
        let [a, b, c] = t.map(|v| mesh.vertices()[v as usize]);
        let [u, w]: [[f64; 3]; 2] = [b, c].map(|p| std::array::from_fn(|k| p[k] - a[k]));
        let normal =
            [u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2], u[0] * w[1] - u[1] * w[0]];
        for &v in t {
            (0..3).for_each(|k| normals[v as usize][k] += normal[k]);
        }
    }
    normals.iter().map(|n| unit(*n)).collect()
}

pub(crate) fn unit(v: [f64; 3]) -> [f64; 3] {
    let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
    v.map(|x| x / length)
}

/// The part of each direction in the surface.
pub(crate) fn in_surface(directions: &[[f64; 3]], normals: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let of = |(d, n): (&[f64; 3], &[f64; 3])| {
        let out: f64 = d.iter().zip(n).map(|(d, n)| d * n).sum();
        unit(std::array::from_fn(|k| d[k] - out * n[k]))
    };
    directions.iter().zip(normals).map(of).collect()
}
