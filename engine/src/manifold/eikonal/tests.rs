//! Derivatives against differences, and each other; bits; what is refused.

use super::super::test_meshes::{icosphere, rectangle};
use super::*;

/// Numbers in (0, 1) without order.
fn scatter(seed: u64, n: usize) -> Vec<f64> {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    let next = |_| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    (0..n + 8).map(next).skip(8).collect()
}

/// A sheet whose inner vertices are moved by up to the part `by` of an edge, and then all sheared.
fn crumpled(n: u32, edge: f64, by: f64, shear: f64) -> TriMesh {
    let flat = rectangle(n, n, edge);
    let moves = scatter(7, 2 * flat.n_vertices());
    let side = f64::from(n) * edge;
    let place = |(v, p): (usize, &[f64; 3])| {
        let inner = |x: f64| x > 1e-9 && x < side - 1e-9;
        let is_inner = inner(p[0]) && inner(p[1]);
        let by = if is_inner { by * edge } else { 0.0 };
        let [x, y] = [0, 1].map(|k| p[k] + 2.0 * by * (moves[2 * v + k] - 0.5));
        [x + shear * y, y, 0.0]
    };
    let vertices = flat.vertices().iter().enumerate().map(place).collect();
    TriMesh::new(vertices, flat.triangles().to_vec()).unwrap()
}

/// Smooth slowness, ratio and angle, and sources, on a mesh.
struct Case {
    eikonal: Eikonal,
    slowness: Vec<f64>,
    ratio: Vec<f64>,
    angle: Vec<f64>,
    sources: Vec<(u32, f64)>,
}

impl Case {
    fn new(mesh: &TriMesh, strength: f64, sources: &[(u32, f64)]) -> Self {
        let wave = |k: f64| {
            mesh.vertices()
                .iter()
                .map(move |p| (k * p[0] + 0.7 * k * p[1] + p[2] * 0.1 + k).sin())
                .collect::<Vec<_>>()
        };
        let slowness = wave(0.31).iter().map(|x| 1.4 * (0.2 * x).exp()).collect();
        let ratio = wave(0.23).iter().map(|x| strength * (0.2 * x).exp()).collect();
        let angle = wave(0.17).iter().map(|x| 0.8 * x).collect();
        Self {
            eikonal: Eikonal::new(mesh, None).unwrap(),
            slowness,
            ratio,
            angle,
            sources: sources.to_vec(),
        }
    }

    fn medium(&self) -> Medium<'_> {
        Medium { slowness: &self.slowness, ratio: Some(&self.ratio), angle: Some(&self.angle) }
    }

    fn front(&self) -> Front {
        let mut front = Front::default();
        self.eikonal.forward(&self.medium(), &self.sources, &mut front);
        front
    }

    /// Σ weight · arrival with everything moved by `h` along a change.
    fn moved(&self, change: &Change, h: f64, weights: &[f64]) -> f64 {
        let add =
            |x: &[f64], d: &[f64]| x.iter().zip(d).map(|(x, d)| x + h * d).collect::<Vec<_>>();
        let (s, r, a) = (
            add(&self.slowness, &change.slowness),
            add(&self.ratio, &change.ratio),
            add(&self.angle, &change.angle),
        );
        let medium = Medium { slowness: &s, ratio: Some(&r), angle: Some(&a) };
        let sources: Vec<_> =
            self.sources.iter().zip(&change.onsets).map(|((v, t), d)| (*v, t + h * d)).collect();
        let mut front = Front::default();
        self.eikonal.forward(&medium, &sources, &mut front);
        front.arrival.iter().zip(weights).map(|(t, w)| t * w).sum()
    }
}

struct Change {
    slowness: Vec<f64>,
    ratio: Vec<f64>,
    angle: Vec<f64>,
    onsets: Vec<f64>,
}

impl Change {
    fn new(n: usize, n_sources: usize, which: usize) -> Self {
        let of = |k: usize, n: usize| {
            if which == k || which == 4 {
                scatter(11 + k as u64, n).iter().map(|x| x - 0.3).collect()
            } else {
                vec![0.0; n]
            }
        };
        Self { slowness: of(0, n), ratio: of(1, n), angle: of(2, n), onsets: of(3, n_sources) }
    }
}

fn compare(name: &str, case: &Case) {
    let n = case.eikonal.n_vertices();
    let front = case.front();
    let groups: Vec<u32> = front.order.groups.iter().map(|g| g[1] - g[0]).collect();
    println!(
        "{name}: {n} vertices, {} groups, largest {}",
        groups.len(),
        groups.iter().max().unwrap_or(&0)
    );
    let weights: Vec<f64> = scatter(3, n).iter().map(|w| w - 0.4).collect();
    let mut bars = [vec![0.0; n], vec![0.0; n], vec![0.0; n], vec![0.0; case.sources.len()]];
    let [s, r, a, o] = &mut bars;
    let mut into = MediumBar { slowness: s, ratio: Some(r), angle: Some(a), onsets: o };
    case.eikonal.backward(&case.medium(), &front, &weights, &mut into);
    for which in 0..5 {
        let change = Change::new(n, case.sources.len(), which);
        let h = 1e-6;
        let difference =
            (case.moved(&change, h, &weights) - case.moved(&change, -h, &weights)) / (2.0 * h);
        let mut out = vec![0.0; n];
        let d = Medium {
            slowness: &change.slowness,
            ratio: Some(&change.ratio),
            angle: Some(&change.angle),
        };
        case.eikonal.push(&case.medium(), &front, &d, &change.onsets, &mut out);
        let pushed: f64 = out.iter().zip(&weights).map(|(x, w)| x * w).sum();
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let pulled = dot(&bars[0], &change.slowness)
            + dot(&bars[1], &change.ratio)
            + dot(&bars[2], &change.angle)
            + dot(&bars[3], &change.onsets);
        println!(
            "  {which}: {difference:.9} {pushed:.9} {pulled:.9}  rel {:.1e} {:.1e}",
            pushed / difference - 1.0,
            pushed / pulled - 1.0
        );
    }
}

#[test]
fn gradients() {
    let n = 24;
    for (by, shear, strength) in
        [(0.0, 0.0, 1.0), (0.3, 0.0, 1.0), (0.3, 1.0, 1.0), (0.3, 0.0, 2.5), (0.3, 1.0, 4.0)]
    {
        let mesh = crumpled(n, 0.8, by, shear);
        let case = Case::new(&mesh, strength, &[(3 * 25 + 4, 0.0), (20 * 25 + 19, 1.3), (0, 4.0)]);
        compare(&format!("{by} {shear} {strength}"), &case);
    }
    let mesh = icosphere(4, 20.0);
    compare("sphere", &Case::new(&mesh, 3.0, &[(5, 0.0), (100, 2.0)]));
}

/// (largest, rms) error of arrivals against exact ones.
fn errors(arrival: &[f64], exact: &[f64]) -> [f64; 2] {
    let largest = arrival.iter().zip(exact).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    let sum: f64 = arrival.iter().zip(exact).map(|(a, b)| (a - b).powi(2)).sum();
    [largest, (sum / exact.len() as f64).sqrt()]
}

#[test]
fn table() {
    for (by, shear) in [(0.0, 0.0), (0.3, 0.0), (0.3, 1.0), (0.3, 2.0)] {
        for (ratio, angle) in [
            (1.0, 0.0_f64),
            (2.0, 0.0),
            (2.0, 0.4),
            (4.0, 0.0),
            (4.0, 0.4),
            (4.0, 0.785),
            (4.0, 1.2),
        ] {
            print!("jitter {by} shear {shear} ratio {ratio} angle {angle}: ");
            for n in [20_u32, 40, 80, 160] {
                let mesh = crumpled(n, 20.0 / f64::from(n), by, shear);
                let nv = mesh.n_vertices();
                let x: Vec<[f64; 3]> = vec![[angle.cos(), angle.sin(), 0.0]; mesh.n_triangles()];
                let eikonal = Eikonal::new(&mesh, Some(&x)).unwrap();
                let (s, r) = (vec![1.0; nv], vec![ratio; nv]);
                let medium = Medium { slowness: &s, ratio: Some(&r), angle: None };
                let source = (n / 2) * (n + 1) + n / 2;
                let at = mesh.vertices()[source as usize];
                let exact: Vec<f64> = mesh
                    .vertices()
                    .iter()
                    .map(|p| {
                        let d = [p[0] - at[0], p[1] - at[1]];
                        (angle.cos() * d[0] + angle.sin() * d[1])
                            .hypot(ratio * (angle.cos() * d[1] - angle.sin() * d[0]))
                    })
                    .collect();
                let mut front = Front::default();
                eikonal.forward(&medium, &[(source, 0.0)], &mut front);
                let start = std::time::Instant::now();
                eikonal.forward(&medium, &[(source, 0.0)], &mut front);
                let ms = 1e3 * start.elapsed().as_secs_f64();
                let e = errors(&front.arrival, &exact);
                print!(" {:.1e} {:.1e} ({} {ms:.1} ms)", e[0], e[1], front.order.groups.len());
            }
            println!();
        }
    }
    for level in 3..7 {
        let mesh = icosphere(level, 20.0);
        let eikonal = Eikonal::new(&mesh, None).unwrap();
        let s = vec![1.0; mesh.n_vertices()];
        let medium = Medium { slowness: &s, ratio: None, angle: None };
        let mut front = Front::default();
        eikonal.forward(&medium, &[(0, 0.0)], &mut front);
        let o = mesh.vertices()[0];
        let exact: Vec<f64> = mesh
            .vertices()
            .iter()
            .map(|p| {
                20.0 * ((p[0] * o[0] + p[1] * o[1] + p[2] * o[2]) / 400.0).clamp(-1.0, 1.0).acos()
            })
            .collect();
        println!("sphere {} {:?}", mesh.n_vertices(), errors(&front.arrival, &exact));
    }
}
