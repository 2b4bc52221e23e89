//! What a page holds of its maps: as exact as it says, and small.

use super::viewer::{FLAT, broken, html_on, told};
use super::{arrays, mesh};
use eplat::mesh::{Axes, TriMesh};
use serde_json::Value;
use std::f64::consts::TAU;

/// Every corner of the mesh is found again, with the value of every array, to half a step.
#[test]
fn what_the_browser_unpacks_is_off_by_half_a_step_at_most() {
    let mesh = mesh();
    let mut all = arrays(&mesh);
    all.truncate(2);
    all.push(("constant".into(), vec![3.25; mesh.n_vertices()]));
    all.push(("empty".into(), vec![f64::NAN; mesh.n_vertices()]));
    let html = html_on(&mesh, Axes::Unknown, &all);
    let decode = include_str!("../../src/report/viewer/decode.js");
    let worst = |decode: &str| {
        let body = format!(
            "{decode}
             const {{ vertices, triangles, arrays }} = await decode(JSON.parse(one('#data').textContent));
             return {{ vertices: [...vertices], triangles: [...triangles],
               arrays: arrays.map(({{ values }}) => [...values]) }};"
        );
        told(&html, &body, FLAT).map(|told| off(&told, &mesh, &all))
    };
    let Some([place, value]) = worst(decode) else { return };
    // half a step, and what is lost by a number of 32 bits
    assert!(place < 0.5 + 1e-2, "{place} steps of a coordinate");
    assert!(value < 0.5 + 1e-1, "{value} steps of a value");
    let [place, _] = worst(&broken(decode, "w * data.step", "w * 1.0001 * data.step")).unwrap();
    assert!(place > 1.0, "{place}");
    let [_, value] = worst(&broken(decode, "/ 65534", "/ 65530")).unwrap();
    assert!(value > 1.0, "{value}");
}

/// The largest errors of a coordinate and of a value, in steps.
fn off(told: &Value, mesh: &TriMesh, arrays: &[(String, Vec<f64>)]) -> [f64; 2] {
    let numbers = |value: &Value| -> Vec<f64> {
        value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap_or(f64::NAN)).collect()
    };
    let (vertices, n) = (mesh.vertices(), mesh.n_vertices());
    let unpacked = numbers(&told["vertices"]);
    let unpacked = unpacked.as_chunks::<3>().0;
    assert_eq!(unpacked.len(), n);
    let apart = |a: [f64; 3], b: [f64; 3]| (0..3).map(|k| (a[k] - b[k]).abs()).fold(0.0, f64::max);
    let source: Vec<usize> = unpacked
        .iter()
        .map(|&at| {
            let apart = |v: &usize| apart(at, vertices[*v]);
            (0..n).min_by(|a, b| apart(a).total_cmp(&apart(b))).unwrap()
        })
        .collect();
    let sorted = |mut triangles: Vec<[u32; 3]>| {
        for t in &mut triangles {
            let first = (0..3).min_by_key(|&k| t[k]).unwrap();
            t.rotate_left(first);
        }
        triangles.sort_unstable();
        triangles
    };
    let corners = numbers(&told["triangles"]);
    let corner = |x: f64| source[x as usize] as u32;
    let triangles = corners.as_chunks::<3>().0.iter().map(|t| t.map(corner)).collect();
    assert_eq!(sorted(triangles), sorted(mesh.triangles().to_vec()), "other triangles");

    let [low, high] = mesh.bounding_box();
    let step = (0..3).map(|k| high[k] - low[k]).fold(0.0, f64::max) / 65535.0;
    let places = unpacked.iter().zip(&source).map(|(&at, &v)| apart(at, vertices[v]) / step);
    let mut worst = 0.0_f64;
    for (values, (name, truth)) in told["arrays"].as_array().unwrap().iter().zip(arrays) {
        let finite = || truth.iter().copied().filter(|x| x.is_finite());
        let range = finite().fold(f64::MIN, f64::max) - finite().fold(f64::MAX, f64::min);
        for (value, &v) in numbers(values).into_iter().zip(&source) {
            assert_eq!(value.is_finite(), truth[v].is_finite(), "{name}");
            let steps = (value - truth[v]).abs() / if range > 0.0 { range / 65534.0 } else { 1e-6 };
            worst = worst.max(steps);
        }
    }
    [places.fold(0.0, f64::max), worst]
}

/// As many arrays as a run on two protocols with a known truth has, each with wavelengths down to 39 mm.
#[test]
fn a_page_of_120_000_vertices_is_below_5_mb() {
    let (around, along) = (400_u32, 300_u32);
    let shake = |i: u32, k: f64| 0.06 * ((f64::from(i) + k) * 12.9898).sin();
    let vertex = |i: u32| {
        let (a, h) = (TAU * f64::from(i % around) / f64::from(around), f64::from(i / around) / 3.0);
        let (a, h) = (a + shake(i, 0.3) / 15.0, h + shake(i, 0.7));
        [15.0 * a.cos() + 0.002 * h * h, 15.0 * a.sin(), h]
    };
    let vertices: Vec<[f64; 3]> = (0..around * along).map(vertex).collect();
    let square = |j: u32, i: u32| {
        let [a, b] = [i, (i + 1) % around].map(|i| j * around + i);
        let [d, e] = [a + around, b + around];
        // no rule in the diagonals
        if (i * i + 7 * j * j + i * j) % 5 < 2 {
            [[a, b, d], [b, e, d]]
        } else {
            [[a, b, e], [a, e, d]]
        }
    };
    let triangles = (0..along - 1).flat_map(|j| (0..around).flat_map(move |i| square(j, i)));
    let mesh = TriMesh::new(vertices, triangles.collect()).unwrap();
    let value = |k: f64, [x, y, z]: [f64; 3]| -> f64 {
        (0..6)
            .map(f64::from)
            .map(|m| ((x * m.sin() + y * m.cos()) / 7.0 + z * (m + k).sin() / 7.0 + k * m).sin())
            .sum()
    };
    let field = |k: u32| {
        let values = mesh.vertices().iter().map(|&at| value(f64::from(k), at)).collect();
        (format!("field{k}"), values)
    };
    let arrays: Vec<_> = (0..19).map(field).collect();
    assert_eq!(mesh.n_vertices(), 120_000);
    let size = html_on(&mesh, Axes::Unknown, &arrays).len();
    assert!(size < 5_000_000, "{size} bytes");
    // the page as it was: numbers of 32 bits in base64
    let plain = 4 * (3 * mesh.n_triangles() + (3 + 19) * mesh.n_vertices()) / 3 * 4;
    assert!(plain > 3 * size, "{plain} bytes of 32-bit numbers, {size} packed");
}
