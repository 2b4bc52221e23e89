//! Eigenvalues of a clinical left-atrium shell against an independent assembly and solver.
//!
//! The reference was made by `tests/python/eigen_reference.py` (gradient-based assembly, scipy
//! 1.18.1 eigsh, shift-invert) on `openep_la/la_lat.vtk` (openep-py, GPL-3.0), which is not part of
//! the repository: without it the test says so and returns.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a test")]

#[path = "support/skipped.rs"]
mod skipped;

use eplat::manifold::{
    Basis, Eikonal, Front, Geodesic, Laplacian, Medium, MediumBar, eigenpairs, maximin,
    random_maximin,
};
use eplat::mesh::TriMesh;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// mm⁻²; the first is 0.
#[rustfmt::skip]
const REFERENCE: [f64; 32] = [
    0.0,
    9.028_408_086_834_3e-4, 1.227_477_902_184_0e-3, 1.363_113_290_638_3e-3,
    2.246_040_972_203_2e-3, 3.017_270_011_689_8e-3, 3.237_170_506_149_4e-3,
    4.364_184_261_914_1e-3, 4.627_237_612_621_2e-3, 4.740_004_547_857_6e-3,
    5.418_538_894_378_1e-3, 5.990_371_040_653_2e-3, 7.204_215_932_595_6e-3,
    7.499_216_411_163_8e-3, 7.866_641_129_291_3e-3, 8.747_956_792_332_2e-3,
    9.380_725_754_895_2e-3, 1.015_867_470_968_9e-2, 1.023_429_204_335_2e-2,
    1.073_518_983_552_6e-2, 1.150_872_222_922_9e-2, 1.245_568_428_632_9e-2,
    1.302_022_433_519_0e-2, 1.314_328_893_660_0e-2, 1.414_029_016_909_5e-2,
    1.482_947_990_652_1e-2, 1.574_810_865_242_2e-2, 1.608_820_034_548_0e-2,
    1.650_871_286_297_4e-2, 1.713_097_052_818_3e-2, 1.822_438_797_349_5e-2,
    1.867_257_809_054_8e-2,
];

/// mm², by the same script.
const REFERENCE_AREA: f64 = 17_525.705_908_402_1;

#[test]
fn eigenvalues_agree_with_scipy_to_1e_8() {
    let Some(path) = reference_file("openep_la/la_lat.vtk") else { return };
    let mesh = largest_piece(&read_binary_polydata(&path));
    let area = Laplacian::new(&mesh).area();
    assert!((area / REFERENCE_AREA - 1.0).abs() < 1e-12, "area {area} mm²");
    let start = Instant::now();
    let basis = eigenpairs(&mesh, REFERENCE.len()).unwrap();
    println!("{} vertices, 32 modes: {:.3} s", mesh.n_vertices(), start.elapsed().as_secs_f64());
    let worst = worst_relative_difference(&basis);
    println!("largest relative difference from scipy: {worst:.1e}");
    assert!(worst < 1e-8, "{worst:e}");
}

#[test]
fn a_basis_of_the_shell_in_the_wrong_unit_does_not_fit() {
    let Some(path) = reference_file("openep_la/la_lat.vtk") else { return };
    let mesh = largest_piece(&read_binary_polydata(&path));
    let basis = eigenpairs(&mesh, 4).unwrap();
    assert!(basis.require_fit(&mesh).is_ok());
    let vertices = mesh.vertices().iter().map(|v| v.map(|x| x / 10.0)).collect();
    let in_cm = TriMesh::new(vertices, mesh.triangles().to_vec()).unwrap();
    let message = basis.require_fit(&in_cm).unwrap_err().to_string();
    assert!(message.contains("same units"), "{message}");
}

#[test]
fn ten_sites_keep_their_distance_and_beat_the_papers_random_draws() {
    let Some(path) = reference_file("openep_la/la_lat.vtk") else { return };
    let mesh = largest_piece(&read_binary_polydata(&path));
    let start = Instant::now();
    let sites = maximin(&mesh, 10, 6.0, 1).unwrap();
    let seconds = start.elapsed().as_secs_f64();
    let ours = smallest_distance(&mesh, &sites);
    let paper = smallest_distance(&mesh, &random_maximin(&mesh, 10, 6.0, 1).unwrap());
    println!("10 sites: {ours:.1} mm in {seconds:.3} s; best of 100,000 draws: {paper:.1} mm");
    assert!(ours > 25.0 && ours > 1.2 * paper, "{ours} mm against {paper} mm");
}

/// Times: `cargo test --release --test manifold_clinical_shell arrivals -- --nocapture`.
#[test]
fn arrivals_have_the_derivatives_that_differences_say() {
    let both = [(100, 0.0), (3000, 5.0)];
    for sources in [&both[..1], &both[1..], &both] {
        for ratio in [1.0, 2.0, 3.0] {
            println!("{} sources, ratio {ratio}", sources.len());
            derivatives_agree(ratio, sources);
        }
    }
}

/// At five slownesses.
fn derivatives_agree(ratio: f64, sources: &[(u32, f64)]) {
    let Some(path) = reference_file("openep_la/la_lat.vtk") else { return };
    let mesh = largest_piece(&read_binary_polydata(&path));
    let eikonal = Eikonal::new(&mesh, None).unwrap();
    let wave = |k: f64| {
        let at = move |p: &[f64; 3]| (k * p[0] + 0.7 * k * p[1] + 0.5 * k * p[2]).sin();
        mesh.vertices().iter().map(at).collect::<Vec<f64>>()
    };
    let n = mesh.n_vertices();
    let bar = vec![1.0 / n as f64; n];
    let change: Vec<f64> = wave(0.04).iter().map(|x| 1.0 + x).collect();
    for moved in 0..5 {
        let along = |h: f64| -> Vec<f64> {
            let slowness = wave(0.03).into_iter().map(|x| 1.4 * (0.3 * x).exp());
            slowness.zip(&change).map(|(s, d)| s + h * d).collect()
        };
        let here = 1e-4 * f64::from(moved);
        let ratios: Vec<f64> = wave(0.05).iter().map(|x| ratio * (0.2 * x).exp()).collect();
        let slowness = along(here);
        let medium = Medium { slowness: &slowness, ratio: Some(&ratios), ..Medium::default() };
        let mut front = Front::default();
        let mut mean = |slowness: &[f64]| {
            let start = Instant::now();
            eikonal.forward(&Medium { slowness, ..medium }, sources, &mut front);
            (front.arrival.iter().sum::<f64>() / n as f64, start.elapsed())
        };
        let difference = (mean(&along(here + 1e-6)).0 - mean(&along(here - 1e-6)).0) / 2e-6;
        let forward = (0..5).map(|_| mean(&slowness).1).min().unwrap();
        let (mut of, mut of_ratio, mut onsets) =
            (bar.clone(), bar.clone(), vec![0.0; sources.len()]);
        let backward = (0..5).map(|_| {
            of.fill(0.0);
            let (slowness, ratio) = (&mut of[..], Some(&mut of_ratio[..]));
            let mut into =
                MediumBar { slowness, ratio, angle: None, thickness: None, onsets: &mut onsets };
            let start = Instant::now();
            eikonal.backward(&medium, &front, &bar, &mut into);
            start.elapsed()
        });
        let backward = backward.min().unwrap();
        let found: f64 = of.iter().zip(&change).map(|(g, d)| g * d).sum();
        let error = (difference / found - 1.0).abs();
        println!("  forward {forward:.2?}, backward {backward:.2?}, off by {error:.1e}");
        assert!(error < 1e-6, "ratio {ratio}, point {moved}: {difference} {found}");
    }
}

/// Smallest geodesic distance between two sites, mm.
fn smallest_distance(mesh: &TriMesh, sites: &[u32]) -> f64 {
    let geodesic = Geodesic::new(mesh).unwrap();
    let from_each = sites.iter().map(|&site| (site, geodesic.distance(&[site])));
    from_each
        .flat_map(|(site, distance)| {
            let others = sites.iter().filter(move |&&other| other != site);
            others.map(move |&other| distance[other as usize])
        })
        .fold(f64::INFINITY, f64::min)
}

fn worst_relative_difference(basis: &Basis) -> f64 {
    let pairs = basis.eigenvalues.iter().zip(REFERENCE).skip(1);
    pairs.map(|(ours, theirs)| (ours / theirs - 1.0).abs()).fold(0.0, f64::max)
}

/// A file of the reference data, `$EPLAT_SHARED` or `../shared` beside the checkout.
fn reference_file(name: &str) -> Option<PathBuf> {
    let shared = std::env::var_os("EPLAT_SHARED")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared"), PathBuf::from);
    let path = shared.join("data").join(name);
    if !path.exists() {
        skipped::skipped("reference data not found");
        return None;
    }
    Some(path)
}

/// Just enough of legacy VTK 5.1 (big-endian) for this one file, so that a fault in the library's
/// reader cannot hide here.
fn read_binary_polydata(path: &Path) -> TriMesh {
    let bytes = std::fs::read(path).unwrap();
    let numbers = |header: &str| {
        let at = bytes.windows(header.len()).position(|w| w == header.as_bytes()).unwrap();
        bytes[at + header.len()..].chunks_exact(8).map(|c| <[u8; 8]>::try_from(c).unwrap())
    };
    let coordinates: Vec<f64> =
        numbers("POINTS 8848 double\n").take(3 * 8848).map(f64::from_be_bytes).collect();
    let corners: Vec<u32> = numbers("CONNECTIVITY vtktypeint64\n")
        .take(3 * 16942)
        .map(|c| u32::try_from(i64::from_be_bytes(c)).unwrap())
        .collect();
    let (vertices, _) = coordinates.as_chunks();
    let (triangles, _) = corners.as_chunks();
    TriMesh::new(vertices.to_vec(), triangles.to_vec()).unwrap()
}

/// The piece with most vertices: labels spread along triangles until none changes.
fn largest_piece(mesh: &TriMesh) -> TriMesh {
    let mut label: Vec<usize> = (0..mesh.n_vertices()).collect();
    let mut changed = true;
    while changed {
        changed = false;
        for triangle in mesh.triangles() {
            let corners = triangle.map(|v| v as usize);
            let smallest = corners.iter().map(|&v| label[v]).min().unwrap();
            for v in corners {
                changed |= label[v] != smallest;
                label[v] = smallest;
            }
        }
    }
    let mut count = vec![0; label.len()];
    for &l in &label {
        count[l] += 1;
    }
    let kept = (0..count.len()).max_by_key(|&l| count[l]).unwrap();
    let mut renumbered = vec![0_u32; label.len()];
    let mut vertices = vec![];
    for v in (0..label.len()).filter(|&v| label[v] == kept) {
        renumbered[v] = vertices.len() as u32;
        vertices.push(mesh.vertices()[v]);
    }
    let inside = mesh.triangles().iter().filter(|t| label[t[0] as usize] == kept);
    let triangles = inside.map(|t| t.map(|v| renumbered[v as usize])).collect();
    TriMesh::new(vertices, triangles).unwrap()
}
