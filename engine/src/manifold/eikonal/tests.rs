//! Surfaces and media for the tests, and what every front keeps to.

use super::super::test_meshes::{icosphere, rectangle};
use super::way::NONE;
use super::*;

/// Numbers in (0, 1) without order.
pub(super) fn scatter(seed: u64, n: usize) -> Vec<f64> {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    let next = |_| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    (0..n + 8).map(next).skip(8).collect()
}

/// A sheet of `n` by `n` squares, halved, with the inner vertices moved by up to the part `by` of an edge, and then
/// all sheared.
pub(super) fn crumpled(n: u32, edge: f64, by: f64, shear: f64) -> TriMesh {
    let flat = rectangle(n, n, edge);
    let moves = scatter(7, 2 * flat.n_vertices());
    let inner = |x: f64| x > 1e-9 && x < f64::from(n) * edge - 1e-9;
    let place = |(v, p): (usize, &[f64; 3])| {
        let by = if inner(p[0]) && inner(p[1]) { by * edge } else { 0.0 };
        let [x, y] = [0, 1].map(|k| p[k] + 2.0 * by * (moves[2 * v + k] - 0.5));
        [x + shear * y, y, 0.0]
    };
    let vertices = flat.vertices().iter().enumerate().map(place).collect();
    TriMesh::new(vertices, flat.triangles().to_vec()).unwrap()
}

/// A medium and sources on a surface.
pub(super) struct Case {
    pub(super) eikonal: Eikonal,
    pub(super) slowness: Vec<f64>,
    pub(super) ratio: Vec<f64>,
    pub(super) angle: Vec<f64>,
    pub(super) thickness: Option<Vec<f64>>,
    pub(super) sources: Vec<(u32, f64)>,
}

impl Case {
    /// Slowness, ratio (about `ratio`) and angle that wave over the surface.
    pub(super) fn waving(mesh: &TriMesh, ratio: f64, sources: &[(u32, f64)]) -> Self {
        let wave = |k: f64, size: f64| {
            let phase = move |p: &[f64; 3]| k * p[0] + 0.7 * k * p[1] + 0.1 * p[2] + k;
            mesh.vertices().iter().map(move |p| size * phase(p).sin())
        };
        Self {
            eikonal: Eikonal::new(mesh, None).unwrap(),
            slowness: wave(0.31, 0.2).map(|x| 1.4 * x.exp()).collect(),
            ratio: wave(0.23, 0.2).map(|x| ratio * x.exp()).collect(),
            angle: wave(0.17, 0.8).collect(),
            thickness: None,
            sources: sources.to_vec(),
        }
    }

    /// The same medium everywhere, with fibres at `angle` to the first axis.
    pub(super) fn constant(mesh: &TriMesh, ratio: f64, angle: f64, sources: &[u32]) -> Self {
        let n = mesh.n_vertices();
        let along = vec![[angle.cos(), angle.sin(), 0.0]; mesh.n_triangles()];
        Self {
            eikonal: Eikonal::new(mesh, Some(&along)).unwrap(),
            slowness: vec![1.3; n],
            ratio: vec![ratio; n],
            angle: vec![0.0; n],
            thickness: None,
            sources: sources.iter().map(|&v| (v, 2.0)).collect(),
        }
    }

    pub(super) fn medium(&self) -> Medium<'_> {
        Medium {
            slowness: &self.slowness,
            ratio: Some(&self.ratio),
            angle: Some(&self.angle),
            thickness: self.thickness.as_deref(),
        }
    }

    pub(super) fn front(&self) -> Front {
        let mut front = Front::default();
        self.eikonal.forward(&self.medium(), &self.sources, &mut front);
        front
    }
}

/// Adjoints of slowness and onsets alone.
fn of_slowness<'a>(slowness: &'a mut [f64], onsets: &'a mut [f64]) -> MediumBar<'a> {
    MediumBar { slowness, ratio: None, angle: None, thickness: None, onsets }
}

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|x| x.to_bits()).collect()
}

#[test]
fn bits_are_the_same_again_and_in_memory_used_before() {
    let sources = [(104, 0.0), (519, 1.3), (0, 4.0)];
    let case = Case::waving(&crumpled(24, 0.8, 0.3, 0.5), 3.0, &sources);
    let first = case.front();
    let sphere = Case::waving(&icosphere(3, 9.0), 1.0, &[(5, -3.0)]);
    let mut used = sphere.front();
    case.eikonal.forward(&case.medium(), &case.sources, &mut used);
    assert_eq!(bits(&first.arrival), bits(&used.arrival));
    let adjoint = |front: &Front| {
        let n = case.eikonal.n_vertices();
        let (mut slowness, mut onsets) = (vec![0.0; n], [0.0; 3]);
        let mut into = of_slowness(&mut slowness, &mut onsets);
        case.eikonal.backward(&case.medium(), front, &scatter(5, n), &mut into);
        (bits(&slowness), bits(&onsets))
    };
    assert_eq!(adjoint(&first), adjoint(&used));
}

/// Of several activations the medium is measured once, for the first. The third case has memory of fronts with a thickness, and
/// none.
#[test]
fn activations_side_by_side_are_as_each_alone() {
    let mut case = Case::waving(&crumpled(24, 0.8, 0.3, 0.5), 2.5, &[(104, 0.0)]);
    let activations = [vec![(104, 0.0)], vec![(519, 1.3), (0, 4.0)], vec![(300, -2.0)]];
    let mut fronts = [(); 3].map(|()| Front::default());
    for thickness in [None, Some(0.4), None] {
        case.thickness = thickness.map(|x| vec![x; case.eikonal.n_vertices()]);
        case.eikonal.forward_each(&case.medium(), &activations, &mut fronts);
        for (sources, front) in activations.iter().zip(&fronts) {
            let mut alone = Front::default();
            case.eikonal.forward(&case.medium(), sources, &mut alone);
            assert_eq!(bits(&alone.arrival), bits(&front.arrival));
        }
    }
}

#[test]
fn a_front_keeps_no_lines_of_another_surface_or_of_other_sources() {
    let of =
        |by: f64, source: u32| Case::waving(&crumpled(20, 1.0, by, 0.5), 2.0, &[(source, 0.0)]);
    let mut front = Front::default();
    for case in [of(0.3, 210), of(0.1, 210), of(0.1, 150)] {
        case.eikonal.forward(&case.medium(), &case.sources, &mut front);
        assert_eq!(bits(&front.arrival), bits(&case.front().arrival));
    }
}

#[test]
fn every_vertex_is_reached_when_the_ways_to_it_say() {
    // the fixed point: no way through any triangle is earlier, and one is as early
    let (sheet, sphere) = (crumpled(20, 1.0, 0.3, 0.5), icosphere(3, 15.0));
    for (mesh, ratio) in
        [(&sheet, 2.5), (&sphere, 1.0), (&sheet, 10.0), (&sphere, 10.0), (&sphere, 40.0)]
    {
        let case = Case::waving(mesh, ratio, &[(30, 0.0), (300, 1.0)]);
        let mut front = case.front();
        let all_plane = front.own.iter().all(|source| *source == NONE);
        assert_eq!(all_plane, ratio > 5.0, "the ratio of {ratio} is for another way to settle");
        let settled = front.arrival.clone();
        // once more from the arrivals found
        for v in 0..mesh.n_vertices() as u32 {
            let now = settled[v as usize];
            let best = March::again(&case.eikonal.geometry, &mut front, v);
            assert!((best - now).abs() <= 1e-12 * now.abs(), "{v}: {now} {best}");
        }
    }
}

#[test]
fn the_way_that_triangles_run_round_does_not_matter() {
    let mesh = icosphere(3, 15.0);
    let mut turned = mesh.triangles().to_vec();
    for t in turned.iter_mut().step_by(3) {
        t.swap(0, 1);
    }
    for t in &mut turned {
        t.rotate_left(1);
    }
    let turned = TriMesh::new(mesh.vertices().to_vec(), turned).unwrap();
    let [one, two] = [&mesh, &turned].map(|mesh| Case::waving(mesh, 3.0, &[(7, 0.0)]).front());
    for (a, b) in one.arrival.iter().zip(&two.arrival) {
        assert!((a - b).abs() < 1e-9, "{a} {b}");
    }
    // about normals that point in, the same angles turn the other way
    let mut case = Case::waving(&mesh, 3.0, &[(7, 0.0)]);
    case.angle.iter_mut().for_each(|angle| *angle = -*angle);
    let gaps = case.front().arrival.into_iter().zip(&one.arrival).map(|(a, b)| (a - b).abs());
    assert!(gaps.fold(0.0, f64::max) > 1.0);
}

#[test]
fn what_no_source_leads_to_is_never_reached_and_has_no_adjoint() {
    let (one, two) = (icosphere(1, 5.0), icosphere(1, 6.0));
    let n = one.n_vertices();
    let vertices = [one.vertices(), two.vertices()].concat();
    let beside = two.triangles().iter().map(|t| t.map(|v| v + n as u32));
    let triangles = one.triangles().iter().copied().chain(beside).collect();
    let mesh = TriMesh::new(vertices, triangles).unwrap();
    let case = Case::waving(&mesh, 2.0, &[(3, 0.0)]);
    let front = case.front();
    assert!(front.arrival[..n].iter().all(|t| t.is_finite()));
    assert!(front.arrival[n..].iter().all(|t| *t == f64::INFINITY));
    let (mut slowness, mut onsets) = (vec![0.0; 2 * n], [0.0]);
    let mut into = of_slowness(&mut slowness, &mut onsets);
    case.eikonal.backward(&case.medium(), &front, &vec![1.0; 2 * n], &mut into);
    assert!(slowness[n..].iter().all(|x| *x == 0.0) && slowness.iter().all(|x| x.is_finite()));
    let mut empty = Front::default();
    case.eikonal.forward(&case.medium(), &[], &mut empty);
    assert!(empty.arrival.iter().all(|t| *t == f64::INFINITY));
}

#[test]
fn a_source_that_is_reached_before_its_onset_is_none() {
    let mesh = crumpled(16, 1.0, 0.2, 0.0);
    let alone = Case::waving(&mesh, 2.0, &[(40, 0.0)]).front();
    let late = Case::waving(&mesh, 2.0, &[(40, 0.0), (200, 500.0)]).front();
    assert_eq!(bits(&alone.arrival), bits(&late.arrival));
}

#[test]
fn fibres_that_are_none_are_named() {
    let mesh = rectangle(1, 1, 1.0);
    let said = |fibres: &[[f64; 3]]| Eikonal::new(&mesh, Some(fibres)).unwrap_err().to_string();
    assert!(said(&[[1.0, 0.0, 0.0]]).contains("2 triangles, but there are 1"));
    for none in [[0.0, 0.0, 1.0], [0.0; 3], [f64::NAN, 1.0, 0.0]] {
        let message = said(&[[1.0, 0.0, 3.0], none]);
        assert!(message.contains("fibre of triangle 1 is"), "{message}");
        assert!(message.contains("\nhelp: give every triangle"), "{message}");
    }
}
