//! Looks for regimes of the latent values that no chain has met.
//!
//! A *scout* begins at a draw of the stand-in's posterior with a small share of its information. That is far from where
//! the chains are, and much too improbable. Some transitions at the hyperparameters of a chain then lead it to the
//! next regime. Most scouts come to where the chains are already; what the others have found becomes a swap
//! ([`swaps`](super::swaps)).

use super::chain::Fixed;
use super::groups::Whitening;
use super::meeting::{Link, Shared};
use super::stand_in::{Sample, StandIn};
use crate::infer::kernel::QUARTER_PERIOD;
use crate::infer::stages::WarmUp;
use crate::random::Part;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use rayon::prelude::*;
use std::sync::Arc;

/// From which meeting on scouts are sent. The stand-ins before know little.
const FIRST_MEETING: usize = 4;
/// Shares of the stand-in's information that they begin with, and the most scouts of a chain that begin so. Those that
/// begin farther off take more and shorter steps, and are sent at the first meeting alone.
const STARTS: [(f64, usize); 2] = [(0.02, 12), (1e-4, 6)];
/// At most one of these for so many transitions of the round.
const TRANSITIONS_EACH: usize = 8;
/// Transitions of a scout.
const TRANSITIONS: usize = 10;
/// A scout is lost whose ln density is lower than that of its chain by more than this. The ln density of a chain varies by the
/// root of half of the number of unknowns.
const LOST: f64 = 20.0;

/// What the scouts of all chains have found at the end of a round, whose links these are; `None` where it is too early for
/// any.
pub(super) fn scouts(
    fixed: Fixed<'_>,
    shared: &Arc<Shared>,
    links: &[Link],
    (round, next): (&WarmUp, &WarmUp),
) -> Option<Vec<Sample>> {
    let starts = match next.n_meetings() {
        ..FIRST_MEETING => return None,
        FIRST_MEETING => &STARTS[..],
        _ => &STARTS[..1],
    };
    let mut rng = fixed.stream(Part::Scout, next);
    let mut begun = vec![];
    for &(share, most) in starts {
        let vague = Arc::new(shared.stand_in.times(share));
        let n = (round.length() / TRANSITIONS_EACH).min(most);
        let begin = |link| (vague.clone(), n, link, ChaCha8Rng::from_rng(&mut rng));
        begun.extend(links.iter().map(begin));
    }
    let found: Vec<Option<Vec<Sample>>> = begun
        .into_par_iter()
        .map(|(vague, n, link, mut rng)| of_chain(fixed, (shared, &vague), link, n, &mut rng))
        .collect();
    Some(found.into_iter().flatten().flatten().collect())
}

/// What `n` scouts find at a chain's hyperparameters; `None` where they cannot begin.
fn of_chain(
    fixed: Fixed<'_>,
    (shared, vague): (&Arc<Shared>, &StandIn),
    link: &Link,
    n: usize,
    rng: &mut ChaCha8Rng,
) -> Option<Vec<Sample>> {
    let layout = fixed.density.layout();
    let mut start = Whitening::new(layout);
    fixed.density.latent().set_outer(&link.outer, &mut start.designs);
    if !start.prepare(vague) {
        return None;
    }
    let conditional = fixed.conditional(shared, &link.outer)?;
    let position = conditional.position(&link.coefficients);
    let mut kernel = fixed.kernel(conditional, &link.scale, &position, ChaCha8Rng::from_rng(rng));
    let least = kernel.point.ln_density - LOST;
    let mut w = vec![0.0; layout.n_coefficients()];
    let mut scout = |_| {
        let z: Vec<f64> = w.iter().map(|_| rng.sample(StandardNormal)).collect();
        start.coefficients(&z, &mut w);
        let (conditional, point) = kernel.parts();
        point.position = conditional.position(&w);
        kernel.evaluate();
        for _ in 0..TRANSITIONS {
            kernel.static_transition(link.step_size, QUARTER_PERIOD);
        }
        let (conditional, point) = kernel.parts();
        (point.ln_density > least).then(|| conditional.sample(&point.position))
    };
    Some((0..n).filter_map(&mut scout).collect())
}
