//! Decimation: the surface stays where it is, its topology, sites and fields too.

#![allow(clippy::unwrap_used, clippy::print_stdout, clippy::float_cmp, reason = "tests")]

#[path = "support/skipped.rs"]
mod skipped;

use eplat::manifold::eigenpairs;
use eplat::mesh::{self, Array, Surface};
use std::path::{Path, PathBuf};

fn shared(file: &str) -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared");
    let path = std::env::var_os("EPLAT_SHARED").map_or_else(beside, PathBuf::from).join("data");
    let path = path.join(file);
    if path.exists() {
        return Some(path);
    }
    skipped::skipped(&format!("reference data not found ({file})"));
    None
}

/// The atrium with a smooth field, half as many times as many vertices again as are left.
fn atrium() -> Surface {
    let mut surface = Surface::left_atrium(0.7);
    let smooth = |p: &[f64; 3]| (p[0] / 15.0).sin() + (p[1] / 20.0).cos();
    let values: Vec<f64> = surface.mesh.vertices().iter().map(smooth).collect();
    surface.point_data.insert("smooth".into(), values.into());
    let numbers = (0..surface.mesh.n_triangles()).map(|t| t as f64).collect();
    surface.cell_data.insert("number".into(), Array::new(1, numbers));
    surface
}

#[test]
fn the_surface_its_openings_and_its_modes_stay() {
    let fine = atrium();
    let n = fine.mesh.n_vertices();
    let coarse = fine.clone().decimated(5000).unwrap();
    println!("{n} vertices: {}", coarse.notes.join("\n"));
    assert_eq!(coarse.mesh.n_vertices(), 5000);
    assert_eq!(coarse.mesh.euler_characteristic(), fine.mesh.euler_characteristic());
    assert_eq!(coarse.mesh.boundary_loops().len(), 5);
    assert!((coarse.mesh.area() / fine.mesh.area() - 1.0).abs() < 5e-3);
    println!("smallest angle {:.1}°", coarse.mesh.min_angle());
    assert!(coarse.mesh.min_angle() > 8.0, "{}", coarse.mesh.min_angle());
    let [mean, most] = coarse.fine().unwrap().distances;
    assert!(mean < 0.04 && most < 0.5, "{mean} {most}");
    let [a, b] = [&fine, &coarse].map(|surface| eigenpairs(&surface.mesh, 24).unwrap().eigenvalues);
    let off = a.iter().zip(&b).skip(1).map(|(a, b)| (b / a - 1.0).abs()).fold(0.0, f64::max);
    println!("eigenvalues are off by at most {:.2} %", 100.0 * off);
    assert!(off < 0.02, "{off}");
}

#[test]
fn vertices_that_must_stay_stay() {
    let fine = atrium().mesh;
    let stay: Vec<u32> = (0..fine.n_vertices() as u32).step_by(37).collect();
    let coarse = fine.coarsened(2000, &stay).unwrap();
    assert_eq!(coarse.mesh.n_vertices(), 2000);
    assert!(stay.iter().all(|v| coarse.vertices.binary_search(v).is_ok()));
    for (new, old) in coarse.vertices.iter().enumerate() {
        assert_eq!(coarse.mesh.vertices()[new], fine.vertices()[*old as usize]);
    }
    let none = fine.coarsened(2000, &[]).unwrap();
    assert!(!stay.iter().all(|v| none.vertices.binary_search(v).is_ok()), "the twin");
}

#[test]
fn fields_and_sites_find_their_way_there_and_back() {
    let fine = atrium();
    let coarse = fine.clone().decimated(5000).unwrap();
    let there = coarse.point_data["smooth"].values();
    let back = coarse.fine().unwrap().carry(there);
    let worst = back
        .iter()
        .zip(fine.point_data["smooth"].values())
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f64::max);
    // Regions stay labels: most vertices have their own, none has one between two.
    let regions = coarse.fine().unwrap().carry(coarse.point_data["region"].values());
    let pairs = regions.iter().zip(fine.point_data["region"].values());
    let n_same = pairs.filter(|(a, b)| a.total_cmp(b).is_eq()).count();
    assert!(n_same as f64 > 0.95 * regions.len() as f64, "{n_same} of {}", regions.len());
    assert!(regions.iter().all(|region| region.fract() == 0.0));
    println!("a smooth field of ±2 is off by at most {worst:.4}");
    assert!(worst < 0.05, "{worst}");
    let distance =
        |a: [f64; 3], b: [f64; 3]| (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt();
    let longest = 2.5 * coarse.mesh.mean_edge_length();
    for (v, p) in fine.mesh.vertices().iter().enumerate() {
        let here = coarse.vertex_of_source(v).unwrap();
        assert!(distance(*p, coarse.mesh.vertices()[here as usize]) < longest, "vertex {v}");
    }
    for (v, source) in coarse.source_vertex.iter().enumerate() {
        assert!(
            distance(coarse.mesh.vertices()[v], fine.mesh.vertices()[*source as usize]) < 1e-12
        );
    }
    // A triangle has the data of one that lies on it.
    let middle = |surface: &Surface, t: usize| {
        let corners = surface.mesh.triangles()[t].map(|v| surface.mesh.vertices()[v as usize]);
        std::array::from_fn(|k| corners.iter().map(|p| p[k]).sum::<f64>() / 3.0)
    };
    for (t, number) in coarse.cell_data["number"].values().iter().enumerate() {
        let apart = distance(middle(&coarse, t), middle(&fine, *number as usize));
        assert!(apart < longest, "triangle {t}: {apart}");
    }
}

#[test]
fn a_clinical_atrium_keeps_its_shape_and_arrival_times() {
    let Some(path) = shared("opencarp_atrium/la_endo_1.pts") else { return };
    let begun = std::time::Instant::now();
    let fine = mesh::read(&path, None).unwrap();
    let read = begun.elapsed().as_secs_f64();
    let coarse = fine.clone().decimated(20_000).unwrap();
    println!(
        "read in {read:.2} s, {:.2} s in all: {}",
        begun.elapsed().as_secs_f64(),
        coarse.notes.join("\n")
    );
    assert_eq!(coarse.mesh.n_vertices(), 20_000);
    assert_eq!(coarse.mesh.euler_characteristic(), fine.mesh.euler_characteristic());
    assert!((coarse.mesh.area() / fine.mesh.area() - 1.0).abs() < 0.01);
    let tags = |surface: &Surface| {
        let mut tags = surface.cell_data["region"].values().to_vec();
        tags.sort_by(f64::total_cmp);
        tags.dedup();
        tags
    };
    assert_eq!(tags(&coarse), tags(&fine));
}
