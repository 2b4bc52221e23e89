//! The surface against the strip, f32 against f64, and what is refused.

use super::*;
use crate::ep::{Grid, Parameters, Precision, Protocol, simulate_strips};
use crate::store::test_forgeries::{changes_length, forgeries};

const TYPICAL: [f64; 5] = [0.7, 0.05, 10.0, 120.0, 200.0];

/// A rectangle of `n_along` × `n_across` nodes, cut as the strip is.
fn rectangle(n_along: usize, n_across: usize, spacing: f64) -> TriMesh {
    let node = |i: usize, j: usize| (j * n_across + i) as u32;
    let point = |k: usize| [(k / n_across) as f64 * spacing, (k % n_across) as f64 * spacing, 0.0];
    let mut triangles = vec![];
    for j in 0..n_along - 1 {
        for i in 0..n_across - 1 {
            let (p, q, r, t) = (node(i, j), node(i + 1, j), node(i, j + 1), node(i + 1, j + 1));
            let even = (i + j) % 2 == 0;
            triangles.extend(if even { [[p, t, q], [p, r, t]] } else { [[p, r, q], [q, r, t]] });
        }
    }
    TriMesh::new((0..n_along * n_across).map(point).collect(), triangles).unwrap()
}

fn paced_once(vertices: Vec<u32>, end: f64) -> Pacing {
    Pacing { vertices, times: vec![0.0], strength: 1.0, end, measured: 0 }
}

fn paced<F: Precision>(
    substrate: &Substrate<'_>,
    pacing: &Pacing,
    dt: f64,
) -> Result<BeatMap, SurfaceError> {
    let mut simulation = Simulation::<F>::new(substrate, pacing, dt)?;
    while !simulation.is_done() {
        simulation.step()?;
    }
    Ok(simulation.beat())
}

fn beat<F: Precision>(mesh: &TriMesh, pacing: &Pacing, dt: f64) -> BeatMap {
    let tissue = vec![Parameters::from_array(TYPICAL).tissue(); mesh.n_vertices()];
    paced::<F>(&Substrate { mesh, tissue: &tissue, fibres: None }, pacing, dt).unwrap()
}

/// CV (m/s) and mean APD90 (ms) over the nodes less than 3 mm from the middle of a rectangle.
fn middle(mesh: &TriMesh, beat: &BeatMap) -> [f64; 2] {
    let centre = mesh.bounding_box()[1][0] / 2.0;
    let (mut n, mut x1, mut t1, mut xx, mut xt, mut apd) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for (v, p) in mesh.vertices().iter().enumerate() {
        let (x, t) = (p[0] - centre, beat.lat[v]);
        if x.abs() < 3.0 - 1e-9 {
            n += 1.0;
            x1 += x;
            t1 += t;
            xx += x * x;
            xt += x * t;
            apd += beat.apd90[v];
        }
    }
    [(n * xx - x1 * x1) / (n * xt - x1 * t1), apd / n]
}

/// On the strip's own mesh the two solvers differ by the tolerance of the iterative one, and the gradual gate.
#[test]
fn the_strip_solver_is_reproduced_on_its_own_mesh() {
    let mesh = rectangle(81, 3, 0.3);
    let [cv, apd90] = middle(&mesh, &beat::<f64>(&mesh, &paced_once((0..6).collect(), 600.0), 0.1));
    let tissue = Parameters::from_array(TYPICAL).tissue();
    let protocol = Protocol { n_beats: 1, ..Protocol::default() };
    let strip = simulate_strips(&[tissue], &Grid::default(), &protocol, &|_| ()).unwrap();
    let expected = strip[0].s1.unwrap();
    println!("CV {cv} {}, APD90 {apd90} {}", expected.cv, expected.apd90 + 0.1);
    assert!((cv / expected.cv - 1.0).abs() < 1e-4);
    // the strip's figure is a step shorter than its crossings
    assert!((apd90 - 0.1 - expected.apd90).abs() < 0.01);
}

/// Irregular triangles on a bent sheet, where no two elements are alike.
#[test]
fn an_irregular_bent_sheet_agrees_with_a_strip_as_fine() {
    let spacing = 0.2;
    let flat = rectangle(91, 11, spacing);
    let bent = |(v, p): (usize, &[f64; 3])| {
        let at_rim = v % 11 == 0 || v % 11 == 10 || !(22..90 * 11).contains(&v);
        let jitter = if at_rim { 0.0 } else { 0.2 * spacing * (7.3 * v as f64).sin() };
        let (x, radius) = (p[0] + jitter, 20.0);
        // lengths along a cylinder are those of the sheet
        [x, radius * ((p[1] + jitter) / radius).sin(), radius * ((p[1] + jitter) / radius).cos()]
    };
    let vertices = flat.vertices().iter().enumerate().map(bent).collect();
    let mesh = TriMesh::new(vertices, flat.triangles().to_vec()).unwrap();
    let [cv, apd90] =
        middle(&mesh, &beat::<f32>(&mesh, &paced_once((0..33).collect(), 400.0), 0.1));
    let grid = Grid { n_along: 91, n_across: 3, spacing, dt: 0.1 };
    let tissue = Parameters::from_array(TYPICAL).tissue();
    let protocol = Protocol { n_beats: 1, ..Protocol::default() };
    let strip = simulate_strips(&[tissue], &grid, &protocol, &|_| ()).unwrap();
    let expected = strip[0].s1.unwrap();
    println!("CV {cv} {}, APD90 {apd90} {}", expected.cv, expected.apd90 + 0.1);
    assert!((cv / expected.cv - 1.0).abs() < 0.01);
    assert!((apd90 - 0.1 - expected.apd90).abs() < 0.2);
}

#[test]
fn single_precision_agrees_with_double_and_threads_change_no_bit() {
    let mesh = rectangle(61, 41, 0.4);
    let pacing = paced_once(vec![0, 1, 2, 41, 42, 82], 400.0);
    let double = beat::<f64>(&mesh, &pacing, 0.1);
    let single = beat::<f32>(&mesh, &pacing, 0.1);
    let worst =
        |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    let (lat, apd) = (worst(&single.lat, &double.lat), worst(&single.apd90, &double.apd90));
    println!("f32 against f64: LAT {lat:.4}, APD90 {apd:.4} ms");
    assert!(double.apd90.iter().all(|x| x.is_finite()), "every vertex beats");
    assert!(lat < 0.01 && apd < 0.01);
    for n in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
        assert_eq!(pool.install(|| beat::<f32>(&mesh, &pacing, 0.1)), single);
    }
}

/// A plane wave knows only the conductivity along its way: D with fibres along it, D/R² across.
#[test]
fn a_plane_wave_has_the_speed_of_its_direction() {
    let mesh = rectangle(81, 3, 0.3);
    let pacing = paced_once((0..6).collect(), 120.0);
    let cv = |cv_max: f64, fibre: Option<[f64; 3]>| {
        let parameters = Parameters { cv_max, ..Parameters::from_array(TYPICAL) };
        let tissue = vec![parameters.tissue(); mesh.n_vertices()];
        let signs = (0..mesh.n_vertices()).map(|v| if v % 3 == 0 { -1.0 } else { 1.0 });
        let given = fibre.map(|f| signs.map(|s| f.map(|x| s * x)).collect::<Vec<_>>());
        let fibres = given.map(|given| Fibres::new(&mesh, &given, 2.0).unwrap());
        let substrate = Substrate { mesh: &mesh, tissue: &tissue, fibres: fibres.as_ref() };
        middle(&mesh, &paced::<f64>(&substrate, &pacing, 0.1).unwrap())[0]
    };
    let (x, y) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]);
    let [along, across, oblique] = [x, y, [0.6, 0.8, 0.0]].map(|fibre| cv(0.8, Some(fibre)));
    let (fast, slow) = (cv(0.8, None), cv(0.4, None));
    println!("CV along {along} {fast}, across {across} {slow}, at 53° {oblique} m/s");
    // the diagonals of the squares ripple the front, which the other conductivity then evens out: 0.6 %
    assert!((along / fast - 1.0).abs() < 1e-2 && (across / slow - 1.0).abs() < 1e-2);
    // edges of 0.3 mm slow the slower wave more
    assert!((along / across - 2.0).abs() < 0.15);
    // no-flux edges turn the front, so that √(D_xx) is only near: 0.8 √(0.36 + 0.64/4)
    assert!((across..along).contains(&oblique) && (oblique / 0.577 - 1.0).abs() < 0.1);
}

#[test]
fn what_goes_on_from_a_state_ends_in_the_same_bits() {
    let mesh = rectangle(61, 41, 0.4);
    let tissue = vec![Parameters::from_array(TYPICAL).tissue(); mesh.n_vertices()];
    let substrate = Substrate { mesh: &mesh, tissue: &tissue, fibres: None };
    let pacing = Pacing {
        times: vec![0.0, 320.0],
        measured: 1,
        ..paced_once(vec![0, 1, 2, 41, 42, 82], 700.0)
    };
    let whole = paced::<f32>(&substrate, &pacing, 0.1).unwrap();
    assert!(whole.apd90.iter().all(|x| x.is_finite()), "every vertex beats");
    let mut simulation = Simulation::<f32>::new(&substrate, &pacing, 0.1).unwrap();
    // while a front runs and others sleep, in the plateau, and in the measured beat
    for time in [15.0, 150.0, 350.0, 560.0] {
        while simulation.time() < time {
            simulation.step().unwrap();
        }
        let kept = postcard::to_stdvec(&simulation.state()).unwrap();
        simulation = Simulation::new(&substrate, &pacing, 0.1).unwrap();
        simulation.restore(postcard::from_bytes(&kept).unwrap()).unwrap();
    }
    while !simulation.is_done() {
        simulation.step().unwrap();
    }
    assert_eq!(simulation.beat(), whole);
    let mut n_refused = 0;
    // JSON has no NaN, as rows without a vertex have it
    let state = serde_json::to_string(&simulation.state()).unwrap().replace("null", "0.0");
    forgeries(&serde_json::from_str(&state).unwrap(), "", &mut |what, forged| {
        let Ok(forged) = serde_json::from_value(forged) else { return };
        let mut simulation = Simulation::<f32>::new(&substrate, &pacing, 0.1).unwrap();
        if simulation.restore(forged).is_ok() {
            assert!(!changes_length(what), "{what}");
            // with numbers that are wrong it may diverge
            let _ = (0..3).try_for_each(|_| simulation.step());
        } else {
            n_refused += 1;
        }
    });
    assert!(n_refused > 15, "{n_refused}");
    let other = rectangle(20, 5, 0.4);
    let small = Substrate { mesh: &other, tissue: &tissue[..100], fibres: None };
    let mut small = Simulation::<f32>::new(&small, &paced_once(vec![0], 9.0), 0.1).unwrap();
    assert_eq!(small.restore(simulation.state()), Err(SurfaceError::State));
}

/// Activations after a premature S2 that goes on from `state`.
fn branched(simulation: &mut Simulation<f32>, state: State<f32>, pacing: &Pacing) -> Waves {
    simulation.branch(state, pacing).unwrap();
    while simulation.time() < pacing.times[pacing.measured] - 0.05 {
        simulation.step().unwrap();
    }
    simulation.watch_waves();
    while !simulation.is_done() {
        simulation.step().unwrap();
    }
    simulation.waves().unwrap()
}

#[test]
fn an_s2_from_a_kept_state_is_the_one_of_a_whole_train() {
    let mesh = rectangle(41, 21, 0.5);
    let tissue = vec![Parameters::from_array(TYPICAL).tissue(); mesh.n_vertices()];
    let substrate = Substrate { mesh: &mesh, tissue: &tissue, fibres: None };
    let s1 = paced_once(vec![0, 1, 21], 400.0);
    let mut simulation = Simulation::<f32>::new(&substrate, &s1, 0.1).unwrap();
    let at_rest = simulation.state();
    simulation.watch_waves();
    let mut states = vec![];
    for interval in [290.0, 320.0] {
        while simulation.time() < interval - 0.05 {
            simulation.step().unwrap();
        }
        states.push((interval, simulation.state()));
    }
    while !simulation.is_done() {
        simulation.step().unwrap();
    }
    let train = simulation.waves().unwrap();
    assert_eq!(train.first, simulation.beat().lat);
    assert!(train.counts.iter().all(|n| *n == 1));
    for (interval, state) in states {
        let s1s2 =
            Pacing { times: vec![0.0, interval], end: interval + 60.0, measured: 1, ..s1.clone() };
        let whole = paced::<f32>(&substrate, &s1s2, 0.1).unwrap();
        let waves = branched(&mut simulation, state, &s1s2);
        assert_eq!(waves.first, whole.lat);
        assert!(waves.counts.iter().all(|n| *n == 1), "captured and conducted");
        // a broken twin: S2 alone, without the S1 that slows it
        let alone = Pacing { times: vec![interval], measured: 0, ..s1s2.clone() };
        assert_ne!(branched(&mut simulation, at_rest.clone(), &alone).first, whole.lat);
        // a state after S2 has begun
        let late = simulation.state();
        assert_eq!(simulation.branch(late, &s1s2), Err(SurfaceError::State));
    }
    // neither an S2 in the plateau nor its stimulus are activations elsewhere
    let refractory = Pacing { times: vec![0.0, 100.0], end: 160.0, measured: 1, ..s1 };
    let waves = branched(&mut simulation, at_rest, &refractory);
    assert!(waves.counts[3..20].iter().all(|n| *n == 0), "{:?}", &waves.counts[..21]);
}

#[test]
fn steps_too_long_for_the_cell_are_an_error() {
    let mesh = rectangle(20, 5, 0.4);
    let tissue = vec![Parameters::from_array([0.7, 0.01, 10.0, 120.0, 200.0]).tissue(); 100];
    let pacing = paced_once((0..10).collect(), 50.0);
    let substrate = Substrate { mesh: &mesh, tissue: &tissue, fibres: None };
    let error = paced::<f64>(&substrate, &pacing, 0.5).unwrap_err();
    assert!(matches!(error, SurfaceError::Unstable { .. }), "{error}");
}

#[test]
fn impossible_pacing_is_refused() {
    let mesh = rectangle(5, 5, 0.4);
    let good = paced_once(vec![0], 5.0);
    let refused = |pacing: &Pacing| {
        let tissue = vec![Parameters::from_array(TYPICAL).tissue(); 25];
        let substrate = Substrate { mesh: &mesh, tissue: &tissue, fibres: None };
        paced::<f64>(&substrate, pacing, 0.1).err().map(|error| error.to_string())
    };
    assert_eq!(refused(&good), None);
    let bad = [
        (Pacing { vertices: vec![], ..good.clone() }, "no vertex is stimulated"),
        (Pacing { vertices: vec![25], ..good.clone() }, "vertex 25 is not on the mesh"),
        (Pacing { times: vec![3.0, 2.0], ..good.clone() }, "do not fit"),
        (Pacing { times: vec![], ..good.clone() }, "do not fit"),
        (Pacing { measured: 1, ..good.clone() }, "there is no beat 2 among 1"),
        (Pacing { strength: f64::NAN, ..good.clone() }, "excites nothing"),
    ];
    for (pacing, what) in bad {
        assert!(refused(&pacing).unwrap().contains(what), "{what}");
    }
}
