//! A small sheet of tissue as a run would leave it.
#![allow(dead_code, clippy::unwrap_used, reason = "tests; each uses a part of it")]

use std::path::Path;

use eplat::mesh::{TriMesh, write_vtp};

/// Vertices of the sheet.
pub(crate) const N: usize = 130;

/// 12 × 9 mm with 1 mm edges, vertex 10 i + j at (i, j).
pub(crate) fn mesh() -> TriMesh {
    let node = |i: u32, j: u32| 10 * i + j;
    let vertices: Vec<[f64; 3]> =
        (0..N as u32).map(|v| [f64::from(v / 10), f64::from(v % 10), 0.0]).collect();
    let square = |(i, j): (u32, u32)| {
        let [a, b, c, d] = [node(i, j), node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)];
        [[a, b, c], [a, c, d]]
    };
    let squares = (0..12).flat_map(|i| (0..9).map(move |j| (i, j)));
    TriMesh::new(vertices, squares.flat_map(square).collect()).unwrap()
}

/// APD_max rises along it, `region` is 1 on its first column, `fib` runs along y, and `up` out of it.
pub(crate) fn write(path: &Path) {
    let mesh = mesh();
    let of = |f: fn(&[f64; 3]) -> f64| mesh.vertices().iter().map(f).collect::<Vec<f64>>();
    let (apd_max, region) = (of(|p| 150.0 + 5.0 * p[0]), of(|p| f64::from(u8::from(p[0] < 0.5))));
    let (ones, zeros) = ([1.0; N], [0.0; N]);
    let data: [(&str, &[f64]); 9] = [
        ("tau_out_mean", &[8.0; N]),
        ("apd_max_mean", &apd_max),
        ("region", &region),
        ("fib_0", &zeros),
        ("fib_1", &ones),
        ("fib_2", &zeros),
        ("up_0", &zeros),
        ("up_1", &zeros),
        ("up_2", &ones),
    ];
    write_vtp(path, &mesh, &data).unwrap();
}
