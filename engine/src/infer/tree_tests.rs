//! Exact tests of the tree code on a ring of integers: all 2^depth directions are enumerated and a
//! proposal is a probability distribution, so that nothing is random and nothing is approximate.

use super::*;
use std::collections::BTreeMap;

const N: i64 = 7;
const DEPTH: u32 = 5;

/// Points are integers, weighted periodically modulo `N`.
#[derive(Debug)]
struct Ring {
    /// ln weight at each residue; −∞ marks a point that diverges.
    ln_weight: Vec<f64>,
    start: i64,
    /// Whether lo..=hi turns.
    turning: fn(i64, i64) -> bool,
    visited: Vec<i64>,
    // Broken twins of the interface's contract.
    ignore_turns_inside: bool,
    always_accept: bool,
}

type Distribution = BTreeMap<i64, f64>;

impl Trajectory for Ring {
    type Edge = i64;
    type Proposal = Distribution;
    /// First and last point in order of travel.
    type Span = (i64, i64);

    fn step(&mut self, edge: &mut i64, direction: Direction) -> Result<f64, Stop> {
        *edge += if direction == Direction::Forward { 1 } else { -1 };
        self.visited.push(*edge);
        let at = |i: i64| self.ln_weight[i.rem_euclid(N) as usize];
        let ln_weight = at(*edge) - at(self.start);
        if ln_weight.is_finite() { Ok(ln_weight) } else { Err(Stop::Divergence) }
    }

    fn leaf(&mut self, edge: &i64, proposal: &mut Distribution, span: &mut (i64, i64)) {
        *proposal = BTreeMap::from([(*edge, 1.0)]);
        *span = (*edge, *edge);
    }

    fn choose(&mut self, current: &mut Distribution, other: &mut Distribution, probability: f64) {
        assert!((0.0..=1.0).contains(&probability));
        let probability = if self.always_accept { 1.0 } else { probability };
        for p in current.values_mut() {
            *p *= 1.0 - probability;
        }
        for (i, p) in &*other {
            *current.entry(*i).or_insert(0.0) += probability * p;
        }
    }

    fn join(&mut self, span: &mut (i64, i64), next: &(i64, i64)) -> bool {
        assert_eq!((next.0 - span.1).abs(), 1, "next must follow in order of travel");
        span.1 = next.1;
        let (low, high) = (span.0.min(span.1), span.0.max(span.1));
        let inside = !(low..=high).contains(&self.start);
        !(inside && self.ignore_turns_inside) && (self.turning)(low, high)
    }

    fn reverse(&mut self, span: &mut (i64, i64)) {
        *span = (span.1, span.0);
    }
}

fn ring(start: i64, turning: fn(i64, i64) -> bool) -> Ring {
    let ln_weight = (0..N).map(|i| ((i * i) as f64).sin()).collect();
    let visited = Vec::new();
    Ring { ln_weight, start, turning, visited, ignore_turns_inside: false, always_accept: false }
}

fn run(ring: &mut Ring, directions: u32, max_depth: u32) -> (Distribution, u32, Stop) {
    let mut workspace = Workspace::new(max_depth, || Subtree::new(BTreeMap::new(), (0, 0)));
    let mut edges = [ring.start, ring.start];
    let (depth, stop) = transition(ring, &mut edges, &mut workspace, directions, max_depth);
    (workspace.chosen().clone(), depth, stop)
}

/// Largest |π K − π| over the ring, with K averaged over all directions.
fn imbalance(change: impl Fn(&mut Ring), turning: fn(i64, i64) -> bool) -> f64 {
    let mut after = vec![0.0; N as usize];
    let mut weights = vec![0.0; N as usize];
    for start in 0..N {
        for directions in 0..1 << DEPTH {
            let mut ring = ring(start, turning);
            change(&mut ring);
            let weight = ring.ln_weight[start as usize].exp();
            if weight == 0.0 {
                continue;
            }
            weights[start as usize] = weight;
            for (i, p) in run(&mut ring, directions, DEPTH).0 {
                after[i.rem_euclid(N) as usize] += weight * p / f64::from(1 << DEPTH);
            }
        }
    }
    after.iter().zip(&weights).map(|(a, w)| (a - w).abs()).fold(0.0, f64::max)
}

fn never(_: i64, _: i64) -> bool {
    false
}

/// Irregular: depends on length and place, also turns short spans here and there.
fn irregular(low: i64, high: i64) -> bool {
    let (length, place) = (high - low + 1, low.rem_euclid(N));
    length >= 16
        || (length == 2 && place == 3)
        || (length == 4 && place % 3 == 1)
        || (length == 8 && place % 2 == 0)
}

#[test]
fn the_transition_leaves_the_weights_invariant() {
    for turning in [never, irregular] {
        assert!(imbalance(|_| (), turning) < 1e-13);
        assert!(imbalance(|ring| ring.ln_weight[2] = f64::NEG_INFINITY, turning) < 1e-13);
    }
}

#[test]
fn broken_twins_do_not() {
    assert!(imbalance(|ring| ring.ignore_turns_inside = true, irregular) > 1e-3);
    assert!(imbalance(|ring| ring.always_accept = true, never) > 1e-3);
}

#[test]
fn every_choice_of_directions_visits_its_own_block_once() {
    for directions in 0..1 << DEPTH {
        let mut ring = ring(0, never);
        let (distribution, depth, stop) = run(&mut ring, directions, DEPTH);
        assert_eq!((depth, stop), (DEPTH, Stop::MaxDepth));
        // The bits that are 0 say how many points lie behind the start.
        let low = -i64::from(!directions & ((1 << DEPTH) - 1));
        ring.visited.push(0);
        ring.visited.sort_unstable();
        assert_eq!(ring.visited, (low..low + (1 << DEPTH)).collect::<Vec<_>>());
        assert!((distribution.values().sum::<f64>() - 1.0).abs() < 1e-14);
        assert!(distribution.keys().all(|i| ring.visited.contains(i)));
    }
}

#[test]
fn a_turn_inside_a_new_half_discards_it_and_a_turn_of_the_whole_keeps_it() {
    let mut inside = ring(0, |low, high| (low, high) == (2, 3));
    let (distribution, depth, stop) = run(&mut inside, 0b1111, 4);
    assert_eq!((depth, stop), (1, Stop::Turning));
    assert_eq!(distribution.keys().copied().collect::<Vec<_>>(), [0, 1]);
    assert_eq!(inside.visited, [1, 2, 3]);

    let mut whole = ring(0, |low, high| (low, high) == (0, 3));
    let (distribution, depth, stop) = run(&mut whole, 0b1111, 4);
    assert_eq!((depth, stop), (2, Stop::Turning));
    assert_eq!(distribution.keys().copied().collect::<Vec<_>>(), [0, 1, 2, 3]);
}

#[test]
fn a_divergence_stops_at_once_and_discards_its_half() {
    let mut ring = ring(0, never);
    ring.ln_weight[5] = f64::NEG_INFINITY;
    let (distribution, depth, stop) = run(&mut ring, 0b1111, 4);
    assert_eq!((depth, stop), (2, Stop::Divergence));
    assert_eq!(ring.visited, [1, 2, 3, 4, 5]);
    assert!(distribution.keys().all(|&i| i < 4));
}

#[test]
fn the_probabilities_of_one_doubling_are_the_textbook_ones() {
    // From 0 forwards over 1, then over {2, 3}: biased between halves, multinomial within one.
    let mut ring = ring(0, never);
    let w: Vec<f64> = ring.ln_weight[..4].iter().map(|l| l.exp()).collect();
    let (p, _, _) = run(&mut ring, 0b11, 2);
    let first = (w[1] / w[0]).min(1.0);
    let second = ((w[2] + w[3]) / (w[0] + w[1])).min(1.0);
    let want = [
        (1.0 - first) * (1.0 - second),
        first * (1.0 - second),
        second * w[2] / (w[2] + w[3]),
        second * w[3] / (w[2] + w[3]),
    ];
    for (i, want) in want.iter().enumerate() {
        assert!((p[&(i as i64)] - want).abs() < 1e-14);
    }
}

#[test]
fn ln_add_exp_survives_extremes() {
    assert!((ln_add_exp(0.0, 0.0) - 2f64.ln()).abs() < 1e-15);
    assert!((ln_add_exp(900.0, -900.0) - 900.0).abs() < 1e-12);
    assert!((ln_add_exp(f64::NEG_INFINITY, 3.0) - 3.0).abs() < 1e-15);
    assert!(ln_add_exp(f64::NEG_INFINITY, f64::NEG_INFINITY).is_infinite());
}
