//! Which draws tell of two regimes, and of which.

use super::stand_in::Sample;
use super::swaps::Swap;
use super::{BlockLayout, Group, Layout, Shape};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

const PLACES: usize = 3;
const DRAWS: usize = 400;

/// Two blocks at three places.
fn layout() -> Layout {
    let block =
        || BlockLayout { n_coefficients: PLACES, mean_precision: None, shape: Shape::Triangular };
    let group = Group { n_seen: PLACES, blocks: vec![block(), block()] };
    Layout { groups: vec![group], free_precision: vec![], outer: vec![], hyper: vec![] }
}

/// Draws whose values are normal, with these added `(block, place)` in one draw of ten.
fn draws(shift: [f64; 2 * PLACES], mut number: impl FnMut(&mut ChaCha8Rng) -> f64) -> Vec<Sample> {
    let rng = &mut ChaCha8Rng::seed_from_u64(1);
    let draw = |i: usize| {
        let there = f64::from(i.is_multiple_of(10));
        let theta = shift.iter().map(|shift| number(rng) + there * shift).collect();
        Sample { theta, slope: vec![0.0; 2 * PLACES] }
    };
    (0..DRAWS).map(draw).collect()
}

fn normal(rng: &mut ChaCha8Rng) -> f64 {
    rng.sample(StandardNormal)
}

const REGION: [f64; 2 * PLACES] = [9.0, 7.0, 0.0, -8.0, -4.0, 0.5];

#[test]
fn places_that_change_together_are_one_swap() {
    let swaps = Swap::of(&draws(REGION, normal), &[], &layout());
    let [swap] = &swaps[..] else { panic!("{swaps:?}") };
    assert_eq!(swap.places, [0, 1]);
    // 40 draws are in the smaller cluster: each mean is off by 0.17 (one sd)
    for (found, shift) in swap.shift.iter().zip([9.0, 7.0, -8.0, -4.0]) {
        assert!((found - shift).abs() < 0.7, "{swap:?}");
    }
}

#[test]
fn one_regime_of_any_usual_shape_has_no_swap() {
    let uniform = |rng: &mut ChaCha8Rng| rng.random::<f64>();
    let exponential = |rng: &mut ChaCha8Rng| -rng.random::<f64>().ln();
    let none = [0.0; 2 * PLACES];
    for samples in [draws(none, normal), draws(none, uniform), draws(none, exponential)] {
        let swaps = Swap::of(&samples, &[], &layout());
        assert!(swaps.is_empty(), "{swaps:?}");
    }
    // values that never change, as those of a place without measurements may
    assert!(Swap::of(&draws(none, |_| 1.0), &[], &layout()).is_empty());
    assert!(Swap::of(&[], &[], &layout()).is_empty());
}

#[test]
fn an_earlier_swap_stays_until_one_of_its_region_is_found() {
    let layout = layout();
    let earlier = Swap::of(&draws(REGION, normal), &[], &layout);
    let of_other_place = [0.0, 0.0, 9.0, 0.0, 0.0, 9.0];
    let both = Swap::of(&draws(of_other_place, normal), &earlier, &layout);
    assert_eq!(
        both.iter().map(|swap| swap.places.clone()).collect::<Vec<_>>(),
        [vec![2], vec![0, 1]]
    );
    let mut larger = REGION;
    larger[0] = 12.0;
    let anew = Swap::of(&draws(larger, normal), &both, &layout);
    assert_eq!(anew.len(), 2, "{anew:?}");
    assert!(anew.iter().all(|swap| swap.places != [0, 1] || swap.shift[0] > 11.0), "{anew:?}");
    assert!(anew.iter().all(|swap| swap.fits(&layout)));
}
