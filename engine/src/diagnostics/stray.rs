//! Which stretch of which chain makes R̂ large.

use std::ops::Range;

/// A stretch of one chain whose draws lie elsewhere than the rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Stray {
    /// Chain, from 0.
    pub chain: usize,
    /// Its draws, from 0.
    pub draws: Range<usize>,
    /// Mean of these draws.
    pub mean: f64,
    /// Mean of all other draws of all chains.
    pub rest_mean: f64,
    /// Standard deviation of all other draws.
    pub rest_sd: f64,
}

/// The stretch that adds most to the variance between stretches: n (mean of its n draws − mean of
/// all)². A stretch is a chain, or a half, quarter … sixteenth of one; it may begin at any multiple
/// of half of its own length.
///
/// `None` if the draws do not vary, are not finite, or are fewer than 32 in a chain.
pub fn stray(chains: &[&[f64]]) -> Option<Stray> {
    const HALVINGS: u32 = 4;
    let all = || chains.iter().flat_map(|chain| chain.iter().copied());
    let (n, total) = (all().count() as f64, all().sum::<f64>());
    let weight = |draws: &[f64]| {
        let mean = draws.iter().sum::<f64>() / draws.len() as f64;
        draws.len() as f64 * (mean - total / n).powi(2)
    };
    let mut worst: Option<(f64, usize, Range<usize>)> = None;
    for (c, chain) in chains.iter().enumerate() {
        for length in (0..=HALVINGS).map(|k| chain.len() >> k).filter(|length| *length > 1) {
            for from in (0..=chain.len() - length).step_by(length / 2) {
                let weight = weight(&chain[from..from + length]);
                if worst.as_ref().is_none_or(|(most, ..)| weight > *most) {
                    worst = Some((weight, c, from..from + length));
                }
            }
        }
    }
    let (weight, chain, draws) = worst?;
    let there = &chains[chain][draws.clone()];
    let (count, sum) = (there.len() as f64, there.iter().sum::<f64>());
    let squares: f64 = all().map(|x| x * x).sum::<f64>() - there.iter().map(|x| x * x).sum::<f64>();
    let rest_mean = (total - sum) / (n - count);
    let rest_sd = (squares / (n - count) - rest_mean * rest_mean).sqrt();
    let is_known = chains.iter().all(|chain| chain.len() >= 32) && weight > 0.0 && rest_sd > 0.0;
    is_known.then_some(Stray { chain, draws, mean: sum / count, rest_mean, rest_sd })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;

    #[test]
    fn a_visit_to_a_second_mode_is_found_where_it_is() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut chains: Vec<Vec<f64>> =
            (0..4).map(|_| (0..1000).map(|_| rng.sample(StandardNormal)).collect()).collect();
        chains[2][400..600].iter_mut().for_each(|x| *x += 4.0);
        let slices: Vec<&[f64]> = chains.iter().map(Vec::as_slice).collect();
        let found = stray(&slices).unwrap();
        assert_eq!(found.chain, 2);
        // a stretch of this length lies within 63 draws of the visit
        assert!(found.draws.start.abs_diff(400) < 130 && found.draws.end.abs_diff(600) < 130);
        // half the visit or more: nearer to it than to the rest, whose mean has an error of .016
        assert!(found.mean > 3.0 && found.rest_mean.abs() < 0.15, "{found:?}");
    }

    #[test]
    fn a_chain_of_its_own_is_found_whole() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let mut chains: Vec<Vec<f64>> =
            (0..3).map(|_| (0..400).map(|_| rng.sample(StandardNormal)).collect()).collect();
        chains[1].iter_mut().for_each(|x| *x += 2.0);
        let slices: Vec<&[f64]> = chains.iter().map(Vec::as_slice).collect();
        let found = stray(&slices).unwrap();
        assert_eq!((found.chain, found.draws), (1, 0..400));
        // Monte Carlo error of the mean of 400 draws: .05
        assert!((found.mean - 2.0).abs() < 0.25);
    }

    #[test]
    fn draws_that_do_not_vary_have_none() {
        assert_eq!(stray(&[&[1.0; 40], &[1.0; 40]]), None);
        assert_eq!(stray(&[&[f64::NAN; 40]]), None);
        assert_eq!(stray(&[&[1.0, 2.0]]), None);
        assert_eq!(stray(&[]), None);
    }
}
