//! The transition leaves its target invariant: replicas start from exact draws, make a few
//! transitions, and must still be exact draws.  They are independent, so standard errors are exact.

use super::super::density::LogDensity;
use super::super::hamiltonian::Metric;
use super::super::test_densities::{banana, normal};
use super::super::tree::{Direction, Trajectory};
use super::*;
use crate::num::vector::{axpy, dots_with_sum};
use rand::SeedableRng;

/// What a broken twin does wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fault {
    None,
    /// The last half-kick of the leapfrog is dropped.
    HalfKick,
    /// The newer half of a tree always wins.
    AlwaysAccept,
    /// Weights ignore the potential energy.
    NoPotential,
}

/// The real flow with one fault.
struct Twin<'a>(Flow<Box<dyn Evaluator + 'a>>, Fault);

impl Trajectory for Twin<'_> {
    type Edge = PhasePoint;
    type Proposal = Proposal;
    type Span = Span;

    fn step(&mut self, edge: &mut PhasePoint, direction: Direction) -> Result<f64, Stop> {
        let before = edge.ln_density;
        let ln_weight = self.0.step(edge, direction)?;
        match self.1 {
            Fault::HalfKick => {
                let mut undone = PhasePoint::new(edge.position.len());
                undone.copy_from(edge);
                let sign = if direction == Direction::Forward { -0.5 } else { 0.5 };
                // Metrics here are the identity: the force is the gradient.
                axpy(sign * self.0.step_size, &undone.gradient, &mut edge.momentum);
                Ok(self.0.energy - edge.energy())
            }
            Fault::NoPotential => Ok(ln_weight - edge.ln_density + before),
            Fault::None | Fault::AlwaysAccept => Ok(ln_weight),
        }
    }

    fn leaf(&mut self, edge: &PhasePoint, proposal: &mut Proposal, span: &mut Span) {
        self.0.leaf(edge, proposal, span);
    }

    fn choose(&mut self, current: &mut Proposal, other: &mut Proposal, probability: f64) {
        let probability = if self.1 == Fault::AlwaysAccept { 1.0 } else { probability };
        self.0.choose(current, other, probability);
    }

    fn join(&mut self, span: &mut Span, next: &Span) -> bool {
        self.0.join(span, next)
    }

    fn reverse(&mut self, span: &mut Span) {
        self.0.reverse(span);
    }
}

fn flow(density: &dyn LogDensity, seed: u64) -> Flow<Box<dyn Evaluator + '_>> {
    let metric = Metric::diagonal(vec![1.0; density.dim()]);
    let hamiltonian = Hamiltonian::new(density.evaluator(), metric);
    let rng = ChaCha8Rng::seed_from_u64(seed);
    Flow::new(hamiltonian, density.dim(), rng)
}

/// Largest |mean − expected| in standard errors, over the banana's moments after a few transitions.
fn worst_z(fault: Fault, step_size: f64) -> f64 {
    let density = banana();
    let mut twin = Twin(flow(&density, 42), fault);
    let mut workspace = Workspace::new(6, || Subtree::new(Proposal::new(2), Span::new(2)));
    let mut edges = [PhasePoint::new(2), PhasePoint::new(2)];
    worst_z_of(|point| {
        twin.0.hamiltonian.evaluate(point);
        let rng = &mut twin.0.rng;
        point.momentum.fill_with(|| rng.sample(StandardNormal));
        let directions = rng.next_u32();
        twin.0.begin(step_size, point.energy());
        for edge in &mut edges {
            edge.copy_from(point);
        }
        tree::transition(&mut twin, &mut edges, &mut workspace, directions, 6);
        point.position.copy_from_slice(&workspace.chosen().position);
    })
}

/// The same of trajectories of fixed length; `accepts` says what becomes of their ends.
fn worst_z_static(step_size: f64, accepts: bool) -> f64 {
    let density = banana();
    let mut kernel = Kernel {
        point: PhasePoint::new(2),
        edges: [PhasePoint::new(2), PhasePoint::new(2)],
        workspace: Workspace::new(6, || Subtree::new(Proposal::new(2), Span::new(2))),
        flow: flow(&density, 43),
        max_depth: 6,
    };
    worst_z_of(|point| {
        kernel.point.position.copy_from_slice(&point.position);
        kernel.evaluate();
        let transition = kernel.static_transition(step_size, 1.6);
        // the end of a trajectory that is refused is left in the first edge
        let refused = transition.accept > 0.0 && kernel.point.position == point.position;
        let end = if refused && !accepts { &kernel.edges[0] } else { &kernel.point };
        point.position.copy_from_slice(&end.position);
    })
}

fn worst_z_of(mut transition: impl FnMut(&mut PhasePoint)) -> f64 {
    const REPLICAS: usize = 40_000;
    const TRANSITIONS: usize = 4;
    let mut rng = ChaCha8Rng::seed_from_u64(41);
    let mut point = PhasePoint::new(2);
    // x, y, x², y², xy, x²y and their expectations.
    let expected = [0.0, 0.0, 1.0, 2.25, 0.0, 2.0];
    let mut sums = [[0.0; 2]; 6];
    for _ in 0..REPLICAS {
        let [a, b]: [f64; 2] = std::array::from_fn(|_| rng.sample(StandardNormal));
        point.position.copy_from_slice(&[a, a * a - 1.0 + 0.5 * b]);
        for _ in 0..TRANSITIONS {
            transition(&mut point);
        }
        let (x, y) = (point.position[0], point.position[1]);
        for (sum, value) in sums.iter_mut().zip([x, y, x * x, y * y, x * y, x * x * y]) {
            sum[0] += value;
            sum[1] += value * value;
        }
    }
    let n = REPLICAS as f64;
    let z = sums.iter().zip(expected).map(|([sum, squares], expected)| {
        let mean = sum / n;
        (mean - expected).abs() / ((squares / n - mean * mean) / n).sqrt()
    });
    z.fold(0.0, f64::max)
}

/// √(2 ln(6/0.001)): six moments, 0.1 % in all.
const LIMIT: f64 = 4.17;

#[test]
fn transitions_leave_the_banana_invariant() {
    // the second step is too long in the banana's arms, and halved there
    for step_size in [0.45, 1.3] {
        let z = worst_z(Fault::None, step_size);
        assert!(z < LIMIT, "{step_size} {z}");
    }
}

#[test]
fn trajectories_of_fixed_length_leave_it_invariant_and_a_twin_that_refuses_none_does_not() {
    for step_size in [0.45, 1.3] {
        let z = worst_z_static(step_size, true);
        assert!(z < LIMIT, "{step_size} {z}");
    }
    let z = worst_z_static(1.3, false);
    assert!(z > 1.5 * LIMIT, "{z}");
}

#[test]
fn broken_twins_do_not() {
    for fault in [Fault::HalfKick, Fault::AlwaysAccept, Fault::NoPotential] {
        let z = worst_z(fault, 0.45);
        assert!(z > 1.5 * LIMIT, "{fault:?} {z}");
    }
}

/// Where steps are tiny, trajectories of fixed length end before they have gone far.
#[test]
fn a_trajectory_of_fixed_length_takes_no_more_steps_than_it_may() {
    let density = normal(vec![1.0; 3]);
    let steps = |step_size: f64, max_depth: u32| {
        let metric = Metric::diagonal(vec![1.0; 3]);
        let hamiltonian = Hamiltonian::new(density.evaluator(), metric);
        let rng = ChaCha8Rng::seed_from_u64(3);
        let mut kernel = Kernel::new(hamiltonian, &[0.5; 3], max_depth, rng);
        let of_each =
            (0..20).map(|_| kernel.static_transition(step_size, QUARTER_PERIOD).n_leapfrog);
        of_each.fold((u32::MAX, 0), |(least, most), n| (least.min(n), most.max(n)))
    };
    let (least, most) = steps(0.1, 10);
    assert!((8..16).contains(&least) && (17..=24).contains(&most), "{least} {most}");
    assert_eq!(steps(1e-4, 10), (128, 128));
    assert_eq!(steps(1e-4, 4), (16, 16));
}

/// Steps that count lead back to where they began, however often they were halved. Those that are
/// refused as leading one way do not.
#[test]
fn every_step_is_undone_by_the_step_back() {
    let density = banana();
    let mut flow = flow(&density, 8);
    let (mut halved, mut one_way) = (0, 0);
    for _ in 0..20_000 {
        let mut begun = PhasePoint::new(2);
        let rng = &mut flow.rng;
        begun.position.fill_with(|| 3.0 * rng.sample::<f64, _>(StandardNormal));
        begun.momentum.fill_with(|| rng.sample(StandardNormal));
        flow.hamiltonian.evaluate(&mut begun);
        let mut edge = begun.clone();
        flow.begin(0.9, begun.energy());
        let there = flow.step(&mut edge, Direction::Forward);
        let n = flow.n;
        let back = flow.step(&mut edge, Direction::Backward);
        let pairs = edge.position.iter().zip(&begun.position);
        let off = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        match there {
            Ok(_) => {
                assert!(back.is_ok() && off < 1e-9, "{off}");
                halved += u32::from(n > 1);
            }
            Err(Stop::OneWay) => {
                assert!(off > 1e-6, "{off}");
                one_way += 1;
            }
            Err(_) => {}
        }
    }
    assert!(halved > 500 && one_way > 50, "{halved} {one_way}");
}

#[test]
fn joining_turns_alike_in_both_orders_of_travel() {
    let density = normal(vec![1.0; 3]);
    let mut flow = flow(&density, 7);
    let mut n_turning = 0;
    for _ in 0..1000 {
        let mut momentum = || -> Vec<f64> {
            let rng = &mut flow.rng;
            (0..3).map(|_| rng.sample::<f64, _>(StandardNormal) + 0.7).collect()
        };
        let mut span = || Span { first: momentum(), last: momentum(), sum: momentum() };
        let reversed = |span: &Span| Span {
            first: span.last.clone(),
            last: span.first.clone(),
            sum: span.sum.clone(),
        };
        let (mut a, b) = (span(), span());
        let (mut b_back, a_back) = (reversed(&b), reversed(&a));
        let turning = flow.join(&mut a, &b);
        assert_eq!(turning, flow.join(&mut b_back, &a_back));
        n_turning += u32::from(turning);
    }
    assert!((100..900).contains(&n_turning), "{n_turning}");
}

#[test]
fn extra_checks_catch_a_turn_that_the_ends_miss() {
    // Both ends and the whole agree, but the junction goes against its own half.
    let density = normal(vec![1.0; 2]);
    let mut flow = flow(&density, 7);
    let mut span = Span { first: vec![1.0, 0.0], last: vec![-1.0, 0.1], sum: vec![0.5, 0.0] };
    let next = Span { first: vec![1.0, 0.0], last: vec![1.0, 0.0], sum: vec![2.0, 0.0] };
    let ends = dots_with_sum(&span.first, &next.last, &span.sum, &next.sum);
    assert!(ends[0] > 0.0 && ends[1] > 0.0);
    assert!(flow.join(&mut span, &next));
}

#[test]
#[ignore = "timing, 2 s: cargo test --release --lib overhead -- --ignored --nocapture"]
fn overhead_per_leapfrog_beyond_the_density() {
    use std::time::Instant;
    let density = normal(vec![1.0; 52]);
    let metric = Metric::diagonal(vec![1.0; 52]);
    let hamiltonian = Hamiltonian::new(density.evaluator(), metric);
    let mut nuts = Kernel::new(hamiltonian, &[0.1; 52], 10, ChaCha8Rng::seed_from_u64(1));
    let begun = Instant::now();
    let leapfrogs: u64 = (0..10_000).map(|_| u64::from(nuts.transition(0.05).n_leapfrog)).sum();
    let in_all = begun.elapsed().as_secs_f64() / leapfrogs as f64;
    let mut evaluator = std::hint::black_box(density.evaluator());
    let (mut position, mut gradient) = (vec![0.1; 52], vec![0.0; 52]);
    let begun = Instant::now();
    let mut sum = 0.0;
    for i in 0..leapfrogs {
        position[0] = i as f64;
        sum += evaluator.ln_density(&position, &mut gradient);
    }
    let of_density = begun.elapsed().as_secs_f64() / leapfrogs as f64;
    println!(
        "{leapfrogs} leapfrogs: {:.0} ns each, {:.0} of them the density ({sum:.1e})",
        1e9 * in_all,
        1e9 * of_density
    );
}
