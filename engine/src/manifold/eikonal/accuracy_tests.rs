//! Arrivals against exact ones: flat sheets, plane and point sources, fibres at angles to the grid, wide angles,
//! slowness that varies, spheres.

use super::super::test_meshes::icosphere;
use super::tests::{Case, crumpled};
use super::*;

/// Largest and root-mean-square difference.
fn errors(arrival: &[f64], exact: &[f64]) -> [f64; 2] {
    let gaps = || arrival.iter().zip(exact).map(|(a, b)| (a - b).abs());
    let squares: f64 = gaps().map(|gap| gap * gap).sum();
    [gaps().fold(0.0, f64::max), (squares / exact.len() as f64).sqrt()]
}

/// A point along the fibres and, times the ratio, across them.
fn stretched(p: [f64; 3], ratio: f64, angle: f64) -> [f64; 2] {
    let (sin, cos) = angle.sin_cos();
    [cos * p[0] + sin * p[1], ratio * (cos * p[1] - sin * p[0])]
}

fn distance(p: [f64; 2], q: [f64; 2]) -> f64 {
    (p[0] - q[0]).hypot(p[1] - q[1])
}

/// Fibres and angles (rad) at which they lie to the grid.
const FIBRES: [(f64, f64); 5] = [(1.0, 0.0), (2.0, 0.4), (3.0, 0.785), (4.0, 0.0), (4.0, 1.2)];

#[test]
fn a_point_in_a_constant_medium_is_exact_on_a_flat_sheet() {
    for (by, shear) in [(0.0, 0.0), (0.3, 0.0), (0.3, 1.0)] {
        for (ratio, angle) in FIBRES {
            let mesh = crumpled(36, 0.5, by, shear);
            let source = 18 * 37 + 15;
            let case = Case::constant(&mesh, ratio, angle, &[source]);
            let place = |p: [f64; 3]| stretched(p, ratio, angle);
            let from = place(mesh.vertices()[source as usize]);
            let exact: Vec<f64> =
                mesh.vertices().iter().map(|&p| 2.0 + 1.3 * distance(place(p), from)).collect();
            let [largest, _] = errors(&case.front().arrival, &exact);
            // in the plane of times this one has angles of 170°, and more than one fixed point
            let bound = if shear > 0.0 && angle > 1.0 { 0.02 } else { 1e-10 };
            assert!(largest < bound, "moved {by}, sheared {shear}, {ratio} at {angle}: {largest}");
            // the broken twin: the same but for the ratio
            if ratio > 1.0 {
                let dropped = Case { ratio: vec![1.0; exact.len()], ..case };
                assert!(errors(&dropped.front().arrival, &exact)[0] > 1.0);
            }
        }
    }
}

#[test]
fn a_line_in_a_constant_medium_is_exact_on_a_flat_sheet() {
    for (ratio, angle) in FIBRES {
        let n = 30;
        let mesh = crumpled(n, 0.5, 0.3, 0.0);
        let line: Vec<u32> = (0..=n).map(|j| j * (n + 1)).collect();
        let case = Case::constant(&mesh, ratio, angle, &line);
        let place = |p: [f64; 3]| stretched(p, ratio, angle);
        let ends = [line[0], line[n as usize]].map(|v| place(mesh.vertices()[v as usize]));
        let along = [ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]];
        let length2 = along[0] * along[0] + along[1] * along[1];
        let from = ends[0];
        let exact = |p: &[f64; 3]| {
            let p = place(*p);
            let share = ((p[0] - from[0]) * along[0] + (p[1] - from[1]) * along[1]) / length2;
            // what comes round the ends is not plane
            let foot = [from[0] + share * along[0], from[1] + share * along[1]];
            (0.3..0.7).contains(&share).then(|| 2.0 + 1.3 * distance(p, foot))
        };
        let front = case.front();
        let known = mesh.vertices().iter().map(exact).zip(&front.arrival);
        let (exact, found): (Vec<f64>, Vec<f64>) =
            known.filter_map(|(exact, found)| Some((exact?, *found))).unzip();
        let [largest, _] = errors(&found, &exact);
        // and what comes round them seeps some way in, where fibres lie at an angle to the line
        let bound = if along[0].abs() < 1e-9 { 1e-10 } else { 0.03 };
        assert!(exact.len() > 100 && largest < bound, "{ratio} at {angle}: {largest}");
    }
}

/// Errors on a sheet of 20 mm, over which the velocity grows linearly, from 1.5 to 2.9 mm/ms without fibres:
///
/// ```text
/// v = v₀ + g·x:   T = arcosh(1 + g² |x − x₀|² / (2 v(x) v(x₀))) / |g|      in the stretched plane
/// ```
fn of_gradient(n: u32, shear: f64, ratio: f64, angle: f64) -> [f64; 2] {
    let mesh = crumpled(n, 20.0 / f64::from(n), 0.3, shear);
    let source = (n / 2) * (n + 1) + n / 3;
    let mut case = Case::constant(&mesh, ratio, angle, &[source]);
    let places: Vec<[f64; 2]> =
        mesh.vertices().iter().map(|&p| stretched(p, ratio, angle)).collect();
    let g = 1.0 / 20.0 / ratio;
    let velocity = |p: &[f64; 2]| 1.5 + g * (0.8 * p[0] + 0.6 * p[1]) / (1.0 + shear);
    let g = g / (1.0 + shear);
    case.slowness = places.iter().map(|p| 1.0 / velocity(p)).collect();
    let from = places[source as usize];
    let exact = |p: &[f64; 2]| {
        let d = distance(*p, from);
        2.0 + (1.0 + 0.5 * g * g * d * d / (velocity(p) * velocity(&from))).acosh() / g
    };
    let exact: Vec<f64> = places.iter().map(exact).collect();
    errors(&case.front().arrival, &exact)
}

fn of_sphere(level: usize) -> [f64; 2] {
    let mesh = icosphere(level, 20.0);
    let n = mesh.n_vertices();
    let eikonal = Eikonal::new(&mesh, None).unwrap();
    let medium = Medium { slowness: &vec![1.0; n], ..Medium::default() };
    let mut front = Front::default();
    eikonal.forward(&medium, &[(0, 0.0)], &mut front);
    let from = mesh.vertices()[0];
    let cosine = |p: &[f64; 3]| (p[0] * from[0] + p[1] * from[1] + p[2] * from[2]) / 400.0;
    let exact: Vec<f64> =
        mesh.vertices().iter().map(|p| 20.0 * cosine(p).clamp(-1.0, 1.0).acos()).collect();
    errors(&front.arrival, &exact)
}

/// Prints errors on meshes of which each has edges half as long as the one before, and the order of the rms.
fn row(name: &str, errors: &[[f64; 2]]) -> f64 {
    let last = errors.len() - 1;
    let order = (errors[last - 1][1] / errors[last][1]).log2();
    let text: Vec<String> =
        errors.iter().map(|[largest, rms]| format!("{largest:.4} {rms:.4}")).collect();
    println!("{name:44} {}   order {order:.2}", text.join("   "));
    order
}

#[test]
fn arrivals_converge_where_the_medium_varies_and_on_a_sphere() {
    println!("largest and rms error, ms");
    for (shear, ratio, angle) in
        [(0.0, 1.0, 0.0), (0.0, 2.0, 0.4), (0.0, 4.0, 0.785), (1.0, 1.0, 0.0), (1.0, 3.0, 0.4)]
    {
        let found = [20, 40, 80].map(|n| of_gradient(n, shear, ratio, angle));
        let order = row(&format!("gradient, sheared {shear}, {ratio} at {angle}"), &found);
        assert!(found[2][1] < 0.03 && order > 0.8, "{found:?}");
    }
    let found = [3, 4, 5].map(of_sphere);
    let order = row("sphere of 20 mm", &found);
    assert!(found[2][1] < 0.1 && order > 0.8, "{found:?}");
}

/// Of the fronts below, ms.
const THICKNESS: f64 = 0.3;

/// Largest and rms error of what fronts with a thickness are later by, in ms. It is θ ln J, with J what a piece of
/// the front has grown to since it was as small as it can be: 1 + τ/θ after a time τ, or as much as fronts of `way` (ms)
/// have grown to on a flat surface. None where that is not known.
fn late(mut case: Case, way: impl Fn(usize) -> Option<f64>) -> [f64; 2] {
    let plain = case.front().arrival;
    case.thickness = Some(vec![THICKNESS; plain.len()]);
    let bent = case.front().arrival;
    let growth = |way: f64| THICKNESS * (way / THICKNESS).ln_1p();
    let known = |v: usize| Some((bent[v] - plain[v], growth(way(v)?)));
    let (found, exact): (Vec<f64>, Vec<f64>) = (0..plain.len()).filter_map(known).unzip();
    errors(&found, &exact)
}

#[test]
fn fronts_that_spread_are_late_and_those_that_gather_make_it_up() {
    println!("largest and rms error, ms");
    for (by, ratio, angle) in [(0.0, 1.0, 0.0), (0.3, 1.0, 0.0), (0.3, 2.5, 0.4)] {
        let found = [20, 40, 80].map(|n| {
            let mesh = crumpled(n, 30.0 / f64::from(n), by, 0.0);
            let source = (n / 2) * (n + 1) + n / 3;
            let from = mesh.vertices()[source as usize];
            let place =
                |p: [f64; 3]| distance(stretched(p, ratio, angle), stretched(from, ratio, angle));
            // where the way there is not along the border
            let exact = |v: usize| {
                let p = mesh.vertices()[v];
                let is_inside = p[..2].iter().all(|x| (4.0..26.0).contains(x));
                let is_far = (0..2).map(|k| (p[k] - from[k]).powi(2)).sum::<f64>() > 16.0;
                (is_inside && is_far).then(|| 1.3 * place(p))
            };
            late(Case::constant(&mesh, ratio, angle, &[source]), exact)
        });
        row(&format!("flat, moved {by}, {ratio} at {angle}"), &found);
        // Of 1.3 ms. The mean over a vertex's triangles reaches farther across fibres, in time, than along them, and that
        // is most of the error where a front is small.
        let bound = if ratio > 1.0 { 0.15 } else { 0.05 };
        assert!(found.iter().all(|[_, rms]| *rms < bound), "{found:?}");
    }
    // the way round a sphere of 20 mm, at the angle from the source: fronts are largest at the equator
    let angle = |mesh: &TriMesh, v: usize| {
        let (p, from) = (mesh.vertices()[v], mesh.vertices()[0]);
        let cosine = (0..3).map(|k| p[k] * from[k]).sum::<f64>() / 400.0;
        let angle = cosine.clamp(-1.0, 1.0).acos();
        (0.2..2.8).contains(&angle).then_some(angle)
    };
    let found = [3, 4, 5].map(|level| {
        let mesh = icosphere(level, 20.0);
        late(Case::constant(&mesh, 1.0, 0.0, &[0]), |v| angle(&mesh, v).map(|a| 26.0 * a.sin()))
    });
    row("sphere of 20 mm", &found);
    assert!(found.iter().all(|[largest, rms]| *rms < 0.05 && *largest < 0.2), "{found:?}");
    // the broken twin: as if they grew all the way
    let mesh = icosphere(5, 20.0);
    let twin = late(Case::constant(&mesh, 1.0, 0.0, &[0]), |v| angle(&mesh, v).map(|a| 26.0 * a));
    assert!(twin[1] > 0.1, "{twin:?}");
}

#[test]
fn fronts_that_keep_their_shape_settle_where_they_were() {
    let mesh = icosphere(4, 20.0);
    let mut case = Case::constant(&mesh, 1.0, 0.0, &[0]);
    let settled =
        |case: &Case| case.eikonal.settled(&case.medium(), &case.sources, &mut Front::default());
    assert_eq!(settled(&case), case.front().arrival, "without a thickness");
    case.thickness = Some(vec![THICKNESS; mesh.n_vertices()]);
    let round = errors(&settled(&case), &case.front().arrival);
    // where slowness waves, a thick front has another shape, and moves
    let waving = Case { thickness: case.thickness, ..Case::waving(&mesh, 2.0, &[(0, 2.0)]) };
    let bent = errors(&settled(&waving), &waving.front().arrival);
    println!("largest and rms move, ms: round {round:.3?}, bent {bent:.3?}");
    assert!(round[1] < 0.01 && bent[1] > 0.015, "{round:?} {bent:?}");
}
