//! A map of arrival times whose activation started at one more place than the table says: the verdict names it.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests")]

#[path = "support/program.rs"]
mod program;

use eplat::manifold::{Eikonal, Front, Medium};
use eplat::mesh::Surface;
use program::{Workplace, text};
use rand::{RngExt as _, SeedableRng as _};
use rand_distr::{Distribution as _, Normal};

const FIRST: u32 = 5;

/// Arrivals in tissue whose velocity varies smoothly, from these places (vertex, onset), with 1 ms of noise, at `n` vertices.
fn table(surface: &Surface, places: &[(u32, f64)], n: usize, seed: u64) -> String {
    let mesh = &surface.mesh;
    let wave = |p: &[f64; 3]| 1.3 + 0.25 * (0.07 * p[0] + 0.05 * p[1] + 0.06 * p[2]).sin();
    let slowness: Vec<f64> = mesh.vertices().iter().map(wave).collect();
    let mut front = Front::default();
    let medium = Medium { slowness: &slowness, ..Medium::default() };
    Eikonal::new(mesh, None).unwrap().forward(&medium, places, &mut front);
    let mut rng = rand::rngs::StdRng::seed_from_u64(seed);
    let noise = Normal::new(0.0, 1.0).unwrap();
    let mut row = |_| {
        let vertex = rng.random_range(0..mesh.n_vertices());
        let value = 30.0 + front.arrival[vertex] + noise.sample(&mut rng);
        format!("lat,{vertex},{FIRST},{value}\n")
    };
    "protocol,vertex,source,value\n".to_owned() + &(0..n).map(&mut row).collect::<String>()
}

/// What the verdict says of further places.
fn said(surface: &Surface, table: String) -> Vec<String> {
    let place = Workplace::new();
    surface.write_maps(&place.path("atrium.vtp"), &[]).unwrap();
    place.file("lat.csv", table);
    let run = place.eplat(
        "run lat_velocity --mesh atrium.vtp --units mm --data lat.csv --chains 2 --warmup 150 --draws 150 --out run",
    );
    assert!(place.path("run/run.json").exists(), "{}", text(&run.stderr));
    let all = text(&run.stdout);
    let is_it = |line: &&str| line.contains("a front that starts at vertex");
    all.lines().filter(is_it).map(str::to_owned).collect()
}

#[test]
fn a_further_place_at_which_activation_starts_is_named() {
    let surface = Surface::left_atrium(3.0);
    let second = surface.mesh.n_vertices() as u32 - 9;
    let alone = said(&surface, table(&surface, &[(FIRST, 0.0)], 120, 1));
    assert!(alone.is_empty(), "{alone:?}");
    // the table's place is one of two, or is wrong
    for (places, later) in
        [(&[(FIRST, 0.0), (second, 20.0)][..], Some(20.0)), (&[(second, 0.0)], None)]
    {
        let found = said(&surface, table(&surface, places, 120, 1));
        let [line] = &found[..] else { panic!("{found:?}") };
        let number = |after: &str| -> f64 {
            let rest = line.split_once(after).unwrap().1;
            rest.split([',', ' ']).next().unwrap().parse().unwrap()
        };
        let point = |v: u32| nalgebra::Vector3::from(surface.mesh.vertices()[v as usize]);
        let vertex = number("starts at vertex ") as u32;
        let off = (point(vertex) - point(second)).norm();
        let at = number(&format!("vertex {vertex}, "));
        println!("{off:.1} mm from where it was, {at} ms later");
        // velocities have made up for some of it
        assert!(off < 15.0 && later.is_none_or(|later| (at - later).abs() < 15.0), "{line}");
    }
}
