//! NUTS trees on an abstract trajectory: doubling, multinomial choice of the next point, U-turn and
//! divergence stops.
//!
//! Knows nothing of Hamiltonians, gradients or random generators. A [`Trajectory`] moves, weighs,
//! chooses and judges turns. So the tests can run the very same code on integers, where every
//! transition probability is exact.
//!
//! # Source
//! Betancourt 2017, "A conceptual introduction to Hamiltonian Monte Carlo", appendix A; the two
//! extra turn checks across a join are Stan's (since 2.21).

use std::mem;

/// Which way along the trajectory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Direction {
    Backward,
    Forward,
}

/// A path of weighted points that can be walked both ways from a start.
///
/// A *span* is what is remembered of a run of consecutive points. It is enough to tell whether the
/// run turns back on itself. Spans are kept in order of travel.
pub(super) trait Trajectory {
    /// The outermost point reached in one direction.
    type Edge;
    /// A candidate for the next draw.
    type Proposal;
    /// The memory of consecutive points.
    type Span;

    /// Moves `edge` one point outwards. Returns its ln weight relative to the start.
    ///
    /// # Errors
    /// [`Stop::Divergence`]; [`Stop::OneWay`].
    fn step(&mut self, edge: &mut Self::Edge, direction: Direction) -> Result<f64, Stop>;
    /// Writes `edge` as a proposal and as a span of one point.
    fn leaf(&mut self, edge: &Self::Edge, proposal: &mut Self::Proposal, span: &mut Self::Span);
    /// Replaces `current` by `other` with this probability (at most 1). What `other` holds
    /// afterwards means nothing.
    fn choose(
        &mut self,
        current: &mut Self::Proposal,
        other: &mut Self::Proposal,
        probability: f64,
    );
    /// Appends `next`, which follows `span` in order of travel. Returns whether the whole turns, or
    /// either junction.
    fn join(&mut self, span: &mut Self::Span, next: &Self::Span) -> bool;
    /// Reverses the order of travel of `span`.
    fn reverse(&mut self, span: &mut Self::Span);
}

/// A complete subtree: one proposal for all its points, their total ln weight, their span.
pub(super) struct Subtree<T: Trajectory> {
    pub(super) proposal: T::Proposal,
    pub(super) span: T::Span,
    ln_weight: f64,
}

impl<T: Trajectory> Subtree<T> {
    pub(super) fn new(proposal: T::Proposal, span: T::Span) -> Self {
        Self { proposal, span, ln_weight: 0.0 }
    }
}

/// Memory for one tree, used again for every draw: first the whole tree, then one subtree for each
/// depth.
pub(super) struct Workspace<T: Trajectory> {
    tree: Subtree<T>,
    subtrees: Vec<Subtree<T>>,
}

impl<T: Trajectory> Workspace<T> {
    /// Memory for trees up to `max_depth`; `blank` makes an empty subtree.
    pub(super) fn new(max_depth: u32, blank: impl Fn() -> Subtree<T>) -> Self {
        Self { tree: blank(), subtrees: (0..=max_depth).map(|_| blank()).collect() }
    }

    /// The draw chosen by the last [`transition`].
    pub(super) fn chosen(&self) -> &T::Proposal {
        &self.tree.proposal
    }
}

/// Why a tree stopped growing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stop {
    Turning,
    Divergence,
    /// The way back from the next point would not lead here.
    OneWay,
    MaxDepth,
}

/// One NUTS transition from the point at which both `edges` (backward, forward) start.
///
/// Bit `d` of `directions` says which way doubling `d` goes (1 = forward).  Returns the number of
/// completed doublings and why it stopped; the draw is [`Workspace::chosen`].
pub(super) fn transition<T: Trajectory>(
    trajectory: &mut T,
    edges: &mut [T::Edge; 2],
    workspace: &mut Workspace<T>,
    directions: u32,
    max_depth: u32,
) -> (u32, Stop) {
    let Workspace { tree, subtrees } = workspace;
    let Some((new, scratch)) = subtrees.split_first_mut() else { return (0, Stop::MaxDepth) };
    trajectory.leaf(&edges[1], &mut tree.proposal, &mut tree.span);
    tree.ln_weight = 0.0;
    let mut travel = Direction::Forward;
    for depth in 0..max_depth {
        let forward = (directions >> depth) & 1 == 1;
        let direction = if forward { Direction::Forward } else { Direction::Backward };
        if direction != travel {
            trajectory.reverse(&mut tree.span);
            travel = direction;
        }
        let edge = &mut edges[usize::from(forward)];
        if let Err(stop) = build(trajectory, edge, direction, depth, new, scratch) {
            return (depth, stop);
        }
        // Biased progressive: the new half is preferred, which makes larger moves.
        let probability = (new.ln_weight - tree.ln_weight).exp().min(1.0);
        trajectory.choose(&mut tree.proposal, &mut new.proposal, probability);
        tree.ln_weight = ln_add_exp(tree.ln_weight, new.ln_weight);
        if trajectory.join(&mut tree.span, &new.span) {
            return (depth + 1, Stop::Turning);
        }
    }
    (max_depth, Stop::MaxDepth)
}

/// Builds the next 2^depth points beyond `edge` into `out`; `Err` if any part turns or diverges.
fn build<T: Trajectory>(
    trajectory: &mut T,
    edge: &mut T::Edge,
    direction: Direction,
    depth: u32,
    out: &mut Subtree<T>,
    scratch: &mut [Subtree<T>],
) -> Result<(), Stop> {
    if depth == 0 {
        out.ln_weight = trajectory.step(edge, direction)?;
        trajectory.leaf(edge, &mut out.proposal, &mut out.span);
        return Ok(());
    }
    let Some((second, rest)) = scratch.split_first_mut() else { return Err(Stop::MaxDepth) };
    build(trajectory, edge, direction, depth - 1, out, rest)?;
    build(trajectory, edge, direction, depth - 1, second, rest)?;
    // Within a subtree every point keeps its multinomial weight.
    let ln_weight = ln_add_exp(out.ln_weight, second.ln_weight);
    let probability = (second.ln_weight - ln_weight).exp().min(1.0);
    trajectory.choose(&mut out.proposal, &mut second.proposal, probability);
    out.ln_weight = ln_weight;
    if trajectory.join(&mut out.span, &second.span) { Err(Stop::Turning) } else { Ok(()) }
}

/// ln(eᵃ + eᵇ) for finite or −∞ arguments.
fn ln_add_exp(a: f64, b: f64) -> f64 {
    let (mut low, mut high) = (a, b);
    if low > high {
        mem::swap(&mut low, &mut high);
    }
    if high == f64::NEG_INFINITY { high } else { high + (low - high).exp().ln_1p() }
}

#[cfg(test)]
#[path = "tree_tests.rs"]
mod tests;
