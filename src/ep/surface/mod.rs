//! Paced tissue on a triangle mesh: activation, recovery and voltage of a whole atrium.
//!
//! The monodomain equation with the modified Mitchell–Schaeffer cell at every vertex, P1 elements with
//! consistent mass, no-flux boundary; the same split step as the strip's.
//!
//! # Source
//! Coveney et al. 2022, Methods, "Electrophysiology model"; solver: see `solver.rs`.

mod operators;
mod record;
mod solver;

use thiserror::Error;

use super::cell::Tissue;
use super::precision::Precision;
use crate::mesh::TriMesh;
pub use record::BeatMap;
use record::Recorder;
use solver::{BLOCK, Solver};

/// How long a stimulus acts, ms: the strip's.
const PULSE: f64 = 0.9;

/// Where and when a surface is paced.
#[derive(Debug, Clone, PartialEq)]
pub struct Pacing {
    /// Vertices that are stimulated.
    pub vertices: Vec<u32>,
    /// When stimuli begin, ms, in order.
    pub times: Vec<f64>,
    /// What a stimulus adds to V, 1/ms.
    pub strength: f64,
    /// When the simulation ends, ms.
    pub end: f64,
    /// Which stimulus' beat is measured, from 0; until the next stimulus.
    pub measured: usize,
}

/// A surface that cannot be paced so.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum PacingError {
    /// No vertex, no stimulus, or a number that makes no sense.
    #[error("{what}\nhelp: {help}")]
    Impossible {
        /// What is wrong.
        what: String,
        /// What to do.
        help: &'static str,
    },
    /// A step whose diffusion has no solution: V has run away.
    #[error(
        "V ran away at {time:.1} ms in steps of {dt} ms\nhelp: give a shorter time step; tau_in asks for the shortest"
    )]
    Unstable {
        /// When, ms.
        time: f64,
        /// Time step, ms.
        dt: f64,
    },
    /// Not a parameter set for each vertex.
    #[error(
        "the mesh has {vertices} vertices, but there are parameters for {got}\nhelp: give one set for each vertex"
    )]
    Parameters {
        /// Vertices of the mesh.
        vertices: usize,
        /// Parameter sets.
        got: usize,
    },
}

impl Pacing {
    /// Checks that a mesh of `n_vertices` can be paced so in steps of `dt` ms.
    ///
    /// # Errors
    /// What makes no sense.
    pub fn validate(&self, n_vertices: usize, dt: f64) -> Result<(), PacingError> {
        let wrong = |what: String, help| Err(PacingError::Impossible { what, help });
        if !(dt > 0.0 && dt <= 0.5) {
            return wrong(format!("a time step of {dt} ms"), "give one above 0 and up to 0.5 ms");
        }
        if self.vertices.is_empty() {
            return wrong("no vertex is stimulated".into(), "give a vertex, or a larger radius");
        }
        if let Some(v) = self.vertices.iter().find(|v| **v as usize >= n_vertices) {
            let what = format!("vertex {v} is not on the mesh, which has {n_vertices}");
            return wrong(what, "vertices are counted from 0");
        }
        let ordered = self.times.windows(2).all(|t| t[0] + PULSE < t[1]);
        let within = self.times.iter().all(|t| (0.0..self.end).contains(t));
        if self.times.is_empty() || !ordered || !within || !self.end.is_finite() {
            let what = format!("stimuli at {:?} ms do not fit before {} ms", self.times, self.end);
            return wrong(what, "give at least one, in order, a ms apart, before the end");
        }
        if self.measured >= self.times.len() {
            let (beat, n) = (self.measured + 1, self.times.len());
            return wrong(format!("there is no beat {beat} among {n}"), "measure one of them");
        }
        if !(self.strength.is_finite() && self.strength > 0.0) {
            let what = format!("a stimulus of {} per ms excites nothing", self.strength);
            return wrong(what, "give a strength above 0");
        }
        Ok(())
    }
}

/// What an observer sees after a step.
#[derive(Debug)]
pub struct Moment<'a, F> {
    /// Steps done, and how many there will be.
    pub steps: [u64; 2],
    /// Time, ms.
    pub time: f64,
    solver: &'a Solver<F>,
}

impl<F: Precision> Moment<'_, F> {
    /// V at every vertex.
    pub fn voltage(&self) -> Vec<f64> {
        by_vertex(&self.solver.operators.vertex, self.solver.v.iter().map(|v| v.f64()))
    }

    /// Share of the vertices that are not at rest.
    pub fn awake(&self) -> f64 {
        let awake = self.solver.awake.iter().filter(|awake| **awake).count();
        (awake * BLOCK).min(self.solver.v.len()) as f64 / self.solver.v.len() as f64
    }

    /// Iterations of the linear solver so far.
    pub fn n_iterations(&self) -> u64 {
        self.solver.n_iterations
    }
}

fn by_vertex(vertex: &[u32], values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut out = vec![f64::NAN; vertex.len()];
    for (v, x) in vertex.iter().zip(values) {
        out[*v as usize] = x;
    }
    out
}

/// Paces `mesh`, with `tissue` at each vertex, in steps of `dt` ms; the measured beat at each vertex.
///
/// `observe` is told of every step. Bit-identical for any number of threads.
///
/// # Errors
/// Pacing that makes no sense on this mesh, or steps in which V runs away.
pub fn simulate_surface<F: Precision>(
    mesh: &TriMesh,
    tissue: &[Tissue],
    pacing: &Pacing,
    dt: f64,
    observe: &mut dyn FnMut(&Moment<F>),
) -> Result<BeatMap, PacingError> {
    pacing.validate(mesh.n_vertices(), dt)?;
    if tissue.len() != mesh.n_vertices() {
        return Err(PacingError::Parameters { vertices: mesh.n_vertices(), got: tissue.len() });
    }
    let mut solver = Solver::<F>::new(mesh, tissue, dt);
    let chosen = |(_, v): &(usize, &u32)| pacing.vertices.contains(v);
    let vertices = solver.operators.vertex.iter().enumerate();
    let rows: Vec<u32> = vertices.filter(chosen).map(|(row, _)| row as u32).collect();
    let step_of = |time: f64| (time / dt).round() as u64;
    let starts: Vec<u64> = pacing.times.iter().map(|t| step_of(*t)).collect();
    let n_steps = step_of(pacing.end);
    let last = starts.get(pacing.measured + 1).copied().unwrap_or(n_steps);
    let mut recorder = Recorder::new(mesh.n_vertices());
    for step in 0..n_steps {
        let is_on = starts.iter().any(|s| (*s..*s + step_of(PULSE)).contains(&step));
        let stimulus = is_on.then_some((F::of(pacing.strength * dt), &rows[..]));
        let is_measured = (starts[pacing.measured]..last).contains(&step);
        if is_measured {
            recorder.before(&solver);
        }
        if !solver.step(stimulus) {
            return Err(PacingError::Unstable { time: step as f64 * dt, dt });
        }
        if is_measured {
            recorder.after(&solver, (step - starts[pacing.measured]) as f64, dt);
        }
        let time = (step + 1) as f64 * dt;
        observe(&Moment { steps: [step + 1, n_steps], time, solver: &solver });
    }
    Ok(recorder.map(&solver.operators.vertex))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ep::{Grid, Parameters, Protocol, simulate_strips};

    const TYPICAL: [f64; 5] = [0.7, 0.05, 10.0, 120.0, 200.0];

    /// A rectangle of `n_along` × `n_across` nodes, cut as the strip is.
    fn rectangle(n_along: usize, n_across: usize, spacing: f64) -> TriMesh {
        let node = |i: usize, j: usize| (j * n_across + i) as u32;
        let point =
            |k: usize| [(k / n_across) as f64 * spacing, (k % n_across) as f64 * spacing, 0.0];
        let mut triangles = vec![];
        for j in 0..n_along - 1 {
            for i in 0..n_across - 1 {
                let (p, q, r, t) = (node(i, j), node(i + 1, j), node(i, j + 1), node(i + 1, j + 1));
                let even = (i + j) % 2 == 0;
                triangles.extend(if even {
                    [[p, t, q], [p, r, t]]
                } else {
                    [[p, r, q], [q, r, t]]
                });
            }
        }
        TriMesh::new((0..n_along * n_across).map(point).collect(), triangles).unwrap()
    }

    fn paced_once(vertices: Vec<u32>, end: f64) -> Pacing {
        Pacing { vertices, times: vec![0.0], strength: 1.0, end, measured: 0 }
    }

    fn beat<F: Precision>(mesh: &TriMesh, pacing: &Pacing, dt: f64) -> BeatMap {
        let tissue = vec![Parameters::from_array(TYPICAL).tissue(); mesh.n_vertices()];
        simulate_surface::<F>(mesh, &tissue, pacing, dt, &mut |_| ()).unwrap()
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

    /// On the strip's own mesh the two solvers differ by the tolerance of the iterative one.
    #[test]
    fn the_strip_solver_is_reproduced_on_its_own_mesh() {
        let mesh = rectangle(81, 3, 0.3);
        let [cv, apd90] =
            middle(&mesh, &beat::<f64>(&mesh, &paced_once((0..6).collect(), 600.0), 0.1));
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
            [
                x,
                radius * ((p[1] + jitter) / radius).sin(),
                radius * ((p[1] + jitter) / radius).cos(),
            ]
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

    #[test]
    fn steps_too_long_for_the_cell_are_an_error() {
        let mesh = rectangle(20, 5, 0.4);
        let tissue = vec![Parameters::from_array([0.7, 0.01, 10.0, 120.0, 200.0]).tissue(); 100];
        let pacing = paced_once((0..10).collect(), 50.0);
        let error = simulate_surface::<f64>(&mesh, &tissue, &pacing, 0.5, &mut |_| ()).unwrap_err();
        assert!(matches!(error, PacingError::Unstable { .. }), "{error}");
    }

    #[test]
    fn impossible_pacing_is_refused() {
        let mesh = rectangle(5, 5, 0.4);
        let good = paced_once(vec![0], 5.0);
        let refused = |pacing: &Pacing| {
            let tissue = vec![Parameters::from_array(TYPICAL).tissue(); 25];
            let run = simulate_surface::<f64>(&mesh, &tissue, pacing, 0.1, &mut |_| ());
            run.err().map(|error| error.to_string())
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
}
