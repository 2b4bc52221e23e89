//! Derivatives against differences, and the adjoint against the directional derivative.

use super::super::test_meshes::icosphere;
use super::tests::{Case, crumpled, scatter};
use super::*;

/// A change of everything, or of one thing.
struct Change {
    slowness: Vec<f64>,
    ratio: Vec<f64>,
    angle: Vec<f64>,
    thickness: Vec<f64>,
    onsets: Vec<f64>,
}

const CHANGES: [&str; 6] = ["slowness", "ratio", "angle", "thickness", "onsets", "everything"];

impl Change {
    fn new(case: &Case, which: usize) -> Self {
        let (n, n_sources) = (case.eikonal.n_vertices(), case.sources.len());
        let of = |k: usize, n: usize| {
            let size = if which == k || which == 5 { 1.0 } else { 0.0 };
            scatter(11 + k as u64, n).iter().map(|x| size * (x - 0.3)).collect()
        };
        Self {
            slowness: of(0, n),
            ratio: of(1, n),
            angle: of(2, n),
            thickness: of(3, n),
            onsets: of(4, n_sources),
        }
    }

    fn medium(&self) -> Medium<'_> {
        Medium {
            slowness: &self.slowness,
            ratio: Some(&self.ratio),
            angle: Some(&self.angle),
            thickness: Some(&self.thickness),
        }
    }
}

/// Σ weight · arrival with everything moved by `h` along a change.
fn moved(case: &Case, change: &Change, h: f64, weights: &[f64]) -> f64 {
    let add = |x: &[f64], d: &[f64]| x.iter().zip(d).map(|(x, d)| x + h * d).collect::<Vec<_>>();
    let onsets: Vec<f64> = case.sources.iter().map(|s| s.1).collect();
    let [slowness, ratio, angle, onsets] = [
        add(&case.slowness, &change.slowness),
        add(&case.ratio, &change.ratio),
        add(&case.angle, &change.angle),
        add(&onsets, &change.onsets),
    ];
    let thickness = case.thickness.as_ref().map(|thickness| add(thickness, &change.thickness));
    let medium = Medium {
        slowness: &slowness,
        ratio: Some(&ratio),
        angle: Some(&angle),
        thickness: thickness.as_deref(),
    };
    let sources: Vec<_> = case.sources.iter().map(|s| s.0).zip(onsets).collect();
    let mut front = Front::default();
    case.eikonal.forward(&medium, &sources, &mut front);
    dot(&front.arrival, weights)
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Adjoints of slowness, ratio, angle, thickness and onsets.
fn adjoints(case: &Case, front: &Front, bar: &[f64]) -> [Vec<f64>; 5] {
    let n = case.eikonal.n_vertices();
    let mut bars = [n, n, n, n, case.sources.len()].map(|n| vec![0.0; n]);
    let [slowness, ratio, angle, thickness, onsets] = &mut bars;
    let mut into = MediumBar {
        slowness,
        ratio: Some(ratio),
        angle: Some(angle),
        thickness: Some(thickness),
        onsets,
    };
    case.eikonal.backward(&case.medium(), front, bar, &mut into);
    bars
}

/// By differences, by `push` and by `backward`, for each of [`CHANGES`].
fn three_ways(case: &Case) -> [[f64; 3]; 6] {
    let n = case.eikonal.n_vertices();
    let front = case.front();
    let weights: Vec<f64> = scatter(3, n).iter().map(|w| w - 0.4).collect();
    let bars = adjoints(case, &front, &weights);
    std::array::from_fn(|which| {
        let change = Change::new(case, which);
        let h = 1e-6;
        let difference =
            (moved(case, &change, h, &weights) - moved(case, &change, -h, &weights)) / (2.0 * h);
        let mut out = vec![0.0; n];
        let (medium, along) = (case.medium(), change.medium());
        case.eikonal.push(&medium, &front, &along, &change.onsets, &mut out);
        let pulled = dot(&bars[0], &change.slowness)
            + dot(&bars[1], &change.ratio)
            + dot(&bars[2], &change.angle)
            + dot(&bars[3], &change.thickness)
            + dot(&bars[4], &change.onsets);
        [difference, dot(&out, &weights), pulled]
    })
}

/// Cases with one to three sources, from right angles to 150°; fibres and none.
fn cases() -> Vec<(String, Case)> {
    let mut cases = vec![];
    let sources = [(79, 0.0), (519, 1.3), (0, 4.0)];
    for (by, shear, ratio) in
        [(0.0, 0.0, 1.0), (0.3, 0.0, 1.0), (0.3, 1.0, 1.0), (0.3, 0.0, 2.5), (0.3, 1.0, 4.0)]
    {
        for n_sources in [1, 3] {
            let case = Case::waving(&crumpled(24, 0.8, by, shear), ratio, &sources[..n_sources]);
            cases.push((format!("moved {by}, sheared {shear}, ratio {ratio}"), case));
        }
    }
    let line: Vec<(u32, f64)> = (0..9).map(|k| (300 + k, 0.1 * f64::from(k))).collect();
    cases.push(("line".into(), Case::waving(&crumpled(24, 0.8, 0.3, 0.0), 2.0, &line)));
    for ratio in [3.0, 12.0] {
        let sphere = Case::waving(&icosphere(4, 20.0), ratio, &[(5, 0.0), (100, 2.0)]);
        cases.push((format!("sphere, ratio {ratio}"), sphere));
    }
    cases
}

/// The same, each with fronts that have a thickness.
fn bent(mut cases: Vec<(String, Case)>) -> Vec<(String, Case)> {
    for (name, case) in &mut cases {
        *name += ", bent";
        let n = case.eikonal.n_vertices();
        case.thickness = Some(scatter(9, n).iter().map(|x| 0.2 + 0.2 * x).collect());
    }
    cases
}

#[test]
fn derivatives_agree_with_differences() {
    for (name, case) in cases().into_iter().chain(bent(cases())) {
        let size: f64 = case.front().arrival.iter().sum();
        for (what, [difference, pushed, pulled]) in CHANGES.iter().zip(three_ways(&case)) {
            println!("{name}, {what}: {difference:.6} {pushed:.6} {pulled:.6}");
            let bound = 1e-6 * difference.abs() + 1e-9 * size;
            assert!((difference - pushed).abs() < bound, "{name}, {what}");
            assert!((pushed - pulled).abs() < 1e-12 * size, "{name}, {what}");
        }
    }
}

#[test]
fn a_gradient_without_the_ratio_disagrees() {
    // the broken twin: what differences by everything see, but for the term of the ratio
    let (_, case) = cases().swap_remove(6);
    let [_, ratio, _, _, _, everything] = three_ways(&case);
    assert!((everything[0] - (everything[2] - ratio[2])).abs() > 1e-3 * everything[0].abs());
}

#[test]
fn vertices_reached_from_each_other_have_derivatives_too() {
    let (name, case) = cases().swap_remove(9);
    let front = case.front();
    let largest = front.order.groups.iter().map(|g| g[1] - g[0]).max();
    println!("{name}: {} groups, the largest {largest:?}", front.order.groups.len());
    assert!(largest > Some(2), "no group to try");
    // one vertex of each group: by differences, and by the adjoint
    for group in &front.order.groups {
        let v = front.order.vertices[group[0] as usize] as usize;
        let mut only = vec![0.0; case.eikonal.n_vertices()];
        only[v] = 1.0;
        let change = Change::new(&case, 0);
        let h = 1e-6;
        let difference =
            (moved(&case, &change, h, &only) - moved(&case, &change, -h, &only)) / (2.0 * h);
        let pulled = dot(&adjoints(&case, &front, &only)[0], &change.slowness);
        assert!((difference - pulled).abs() < 1e-5 * pulled.abs(), "{v}: {difference} {pulled}");
    }
}

#[test]
fn adjoints_are_added_and_the_ratio_counts_where_it_is_1() {
    let mesh = crumpled(12, 1.0, 0.3, 0.0);
    let case = Case::waving(&mesh, 1.0, &[(20, 0.0)]);
    let n = mesh.n_vertices();
    let isotropic = Medium { slowness: &case.slowness, ..Medium::default() };
    let mut front = Front::default();
    case.eikonal.forward(&isotropic, &case.sources, &mut front);
    let (mut slowness, mut ratio, mut onsets) = (vec![1.0; n], vec![0.0; n], [1.0]);
    let mut once = vec![0.0; n];
    for slowness in [&mut slowness, &mut once] {
        let ratio = Some(&mut ratio[..]);
        let mut into =
            MediumBar { slowness, ratio, angle: None, thickness: None, onsets: &mut onsets };
        case.eikonal.backward(&isotropic, &front, &vec![1.0; n], &mut into);
    }
    assert!(slowness.iter().zip(&once).all(|(a, b)| (a - 1.0 - b).abs() < 1e-10));
    assert!((onsets[0] - 1.0 - 2.0 * n as f64).abs() < 1e-9);
    let turned = |r: f64| {
        let ratio = vec![r; n];
        let medium = Medium { ratio: Some(&ratio), ..isotropic };
        let mut front = Front::default();
        case.eikonal.forward(&medium, &case.sources, &mut front);
        front.arrival.iter().sum::<f64>()
    };
    let difference = (turned(1.0 + 1e-6) - turned(1.0 - 1e-6)) / 2e-6;
    let found = 0.5 * ratio.iter().sum::<f64>();
    assert!((difference - found).abs() < 1e-6 * found, "{difference} {found}");
}

/// A change leaves the derivatives with the front, for what is asked next; another forward pass must not find them there.
#[test]
fn kept_derivatives_are_those_of_the_front() {
    for (name, mut case) in bent(cases()) {
        let n = case.eikonal.n_vertices();
        let bar = scatter(5, n);
        let mut front = case.front();
        let before = adjoints(&case, &front, &bar);
        let change = Change::new(&case, 0);
        let mut out = vec![0.0; n];
        case.eikonal.push(&case.medium(), &front, &change.medium(), &change.onsets, &mut out);
        assert_eq!(before, adjoints(&case, &front, &bar), "{name}");
        case.slowness.iter_mut().zip(scatter(6, n)).for_each(|(s, x)| *s *= 1.0 + 0.2 * x);
        case.eikonal.forward(&case.medium(), &case.sources, &mut front);
        assert_eq!(adjoints(&case, &case.front(), &bar), adjoints(&case, &front, &bar), "{name}");
    }
}
