//! Rows that are left out, against exact figures.

use super::latent::{Latent, LatentGaussian, Layout};
use super::left_out::{Points, WithoutRows, with_numbers};
use super::mixture::{Mixture, Tails};
use super::test_sums::{
    Exact, LARGEST_Z, LATENT, PLACES, SD, SHARES, Sums, exact, exact_with, factor, layout, z,
};
use super::told::RowWithout;
use crate::infer::density::{Evaluator, LogDensity};
use nalgebra::{DMatrix, DVector};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// Draws of the coefficients of a group, from its posterior.
fn drawn(with: &Exact, rank: usize, rng: &mut ChaCha8Rng) -> Vec<f64> {
    let standard = DVector::from_fn(LATENT, |_, _| rng.sample(StandardNormal));
    let theta = &with.mean + &with.factor * standard;
    let of = |field: usize| {
        let l = factor(field, if field == 0 { rank } else { PLACES });
        whitened(&l, &theta.as_slice()[field * PLACES..][..PLACES])
    };
    (0..2).flat_map(of).collect()
}

/// Draws of `SumsAlone`.
fn draws_of(density: &SumsAlone, rng: &mut ChaCha8Rng) -> Vec<Vec<f64>> {
    let with = exact(density.rank);
    let mut draw = || {
        let of_group = |_| drawn(&with, density.rank, rng);
        let mut position: Vec<f64> = (0..density.layout.groups.len()).flat_map(of_group).collect();
        position.extend(density.layout.outer.iter().map(|_| rng.sample::<f64, _>(StandardNormal)));
        position
    };
    (0..4000).map(|_| draw()).collect()
}

/// Calls `check` with what it is about, the posterior without a row, the row at all points, and the place.
fn each_row(
    told: &WithoutRows,
    group: usize,
    rank: usize,
    mut check: impl FnMut(&str, &Exact, &[&RowWithout], usize),
) {
    for place in 0..PLACES {
        for (row, share) in SHARES.iter().enumerate() {
            let mut sd = [SD; PLACES];
            sd[place] /= (1.0 - share).sqrt();
            let at: Vec<&RowWithout> =
                told.rows.iter().map(|places| &places[group * PLACES + place][row]).collect();
            let about = format!("rank {rank}, group {group}, place {place}, row {row}");
            check(&about, &exact_with(rank, sd), &at, place);
        }
    }
}

/// That the mean of weights is 1, and with them the mean of the values at the place what it should be.
fn assert_exact(about: &str, weights: &[f64], without: &Exact, at: &[&RowWithout], place: usize) {
    assert!(z(weights).abs() < LARGEST_Z, "{about}: {}", z(weights));
    for field in 0..2 {
        let mean = without.mean[field * PLACES + place];
        let pairs = at.iter().zip(weights);
        let moment: Vec<f64> = pairs.map(|(row, w)| 1.0 + w * (row.theta[field] - mean)).collect();
        assert!(z(&moment).abs() < LARGEST_Z, "{about}: {}", z(&moment));
    }
}

/// Of draws of the posterior the mean of Z₋ᵢ/Z is exact, and so is the mean of the values at the place with these
/// weights, whichever row is left out. Plain weights 1/Lᵢ have heavy tails here.
#[test]
fn rows_are_predicted_from_the_others() {
    for (n, rank) in [(2, PLACES), (64, PLACES), (16, 2), (16, 1)] {
        let density = SumsAlone { layout: layout(), rank };
        let draws = draws_of(&density, &mut ChaCha8Rng::seed_from_u64(11));
        let told = with_numbers(&density, &draws, &density.places(), [n; 2], 5);
        let with = exact(rank);
        each_row(&told, 0, rank, |about, without, at, place| {
            let ratio = without.ln_evidence - with.ln_evidence;
            let weights: Vec<f64> = at.iter().map(|row| (row.ln_weight - ratio).exp()).collect();
            assert_exact(about, &weights, without, at, place);
            let plain: Vec<f64> = at.iter().map(|row| row.ln_weight.exp()).collect();
            assert!(z(&plain).abs() > LARGEST_Z, "the ratio is not 1");
        });
    }
}

/// At points of a mixture the mean of p Ẑ₋ᵢ/q is ∫ p Z₋ᵢ, also where another group adds to it.
#[test]
fn rows_are_predicted_at_points_of_a_mixture() {
    for (n, rank, n_groups) in [(2, PLACES, 1), (16, 2, 1), (16, PLACES, 2)] {
        let one = layout();
        let density = SumsAlone {
            layout: Layout {
                groups: one.groups.iter().cycle().take(n_groups).cloned().collect(),
                outer: vec![n_groups * LATENT],
                ..one
            },
            rank,
        };
        let draws = draws_of(&density, &mut ChaCha8Rng::seed_from_u64(12));
        let told = with_numbers(&density, &draws, &density.places(), [n; 2], 5);
        let of_others = (n_groups - 1) as f64 * exact(rank).ln_evidence;
        // p is not normalised
        let ln_norm = 0.5 * std::f64::consts::TAU.ln();
        for group in 0..n_groups {
            each_row(&told, group, rank, |about, without, at, place| {
                let exact = without.ln_evidence + of_others + ln_norm;
                let weights: Vec<f64> =
                    at.iter().map(|row| (row.ln_weight - exact).exp()).collect();
                assert_exact(about, &weights, without, at, place);
                let squares = told.outer.iter().zip(&weights).map(|(h, w)| w * h[0] * h[0]);
                let squares: Vec<f64> = squares.collect();
                assert!(z(&squares).abs() < LARGEST_Z, "{about}: {}", z(&squares));
                let without_density: Vec<f64> =
                    told.outer.iter().map(|h| (-0.5 * h[0] * h[0] - ln_norm).exp()).collect();
                assert!(z(&without_density).abs() > LARGEST_Z, "a forgotten q goes unseen");
            });
        }
    }
}

/// A row that is not where the first mixture is becomes one of which points tell much. Its weights have the mean 1 over both
/// mixtures, and not by the density of the first alone.
#[test]
fn further_points_are_for_rows_of_which_the_first_tell_little() {
    let rng = &mut ChaCha8Rng::seed_from_u64(13);
    let tails = vec![Tails::of(vec![-2.0, -1.0, 0.0, 1.0, 2.0])];
    let about = |centre: f64, rng: &mut ChaCha8Rng| {
        let points: Vec<Vec<f64>> =
            (0..500).map(|_| vec![centre + rng.sample::<f64, _>(StandardNormal)]).collect();
        Mixture::fit(&points, &[1.0; 500], (0.1, &tails), rng).unwrap()
    };
    // two places; the posteriors without their rows are normal, about 0 and about 6
    let ln_p = |h: f64, centre: f64| -0.5 * ((h - centre).powi(2) + std::f64::consts::TAU.ln());
    let told = |outer: &[Vec<f64>], places: &[usize]| -> Vec<Vec<Vec<RowWithout>>> {
        let row = |h: f64, place: usize| RowWithout {
            ln_density: 0.0,
            ln_weight: ln_p(h, [0.0, 6.0][place]),
            theta: vec![],
        };
        let at = |h: &Vec<f64>| places.iter().map(|place| vec![row(h[0], *place)]).collect();
        outer.iter().map(at).collect()
    };
    let mut points = Points::new(5000, 2);
    let first = about(0.0, rng);
    let outer = first.draws(5000, rng);
    let rows = told(&outer, &[0, 1]);
    points.add(first.clone(), outer, (&[0, 1], rows));
    let (poor, weights) = points.poor(&[0, 1]);
    assert_eq!(poor, [1]);
    let second = Mixture::fit(&points.outer, &weights, (0.1, &tails), rng).unwrap();
    let outer = second.draws(5000, rng);
    let rows = told(&outer, &[1]);
    points.add(second, outer, (&[1], rows));
    assert!(points.poor(&[1]).0.is_empty());
    let by_the_first: Vec<f64> = points.outer.iter().map(|h| first.ln_density(h)).collect();
    let told = points.weighted();
    let mean_of_two = |ln: &dyn Fn(usize) -> f64| {
        let one = |i: usize| ln(i).exp() + ln(i + 5000).exp();
        z(&(0..5000).map(one).collect::<Vec<f64>>())
    };
    let own = mean_of_two(&|i| told.rows[i][1][0].ln_weight);
    assert!(own.abs() < LARGEST_Z, "{own}");
    let twin = mean_of_two(&|i| ln_p(told.outer[i][0], 6.0) - by_the_first[i]);
    assert!(twin.abs() > LARGEST_Z, "a forgotten mixture goes unseen: {twin}");
    let of_the_first: Vec<f64> =
        told.rows[..5000].iter().map(|rows| rows[0][0].ln_weight.exp()).collect();
    assert!(z(&of_the_first).abs() < LARGEST_Z);
    assert!(told.rows[5000..].iter().all(|rows| rows[0].is_empty()));
}

/// w with L w = θ.
fn whitened(l: &DMatrix<f64>, theta: &[f64]) -> Vec<f64> {
    let mut w: Vec<f64> = vec![];
    for i in 0..PLACES {
        let left = theta[i] - (0..i).map(|j| l[(i, j)] * w[j]).sum::<f64>();
        w.push(if l[(i, i)] > 1e-9 { left / l[(i, i)] } else { 0.0 });
    }
    w
}

/// [`Sums`] as a density, with any outer unknowns after the coefficients.
struct SumsAlone {
    layout: Layout,
    rank: usize,
}

impl LogDensity for SumsAlone {
    fn dim(&self) -> usize {
        self.layout.groups.len() * LATENT + self.layout.outer.len()
    }
    fn evaluator(&self) -> Box<dyn Evaluator + '_> {
        unreachable!("not asked for")
    }
}

impl LatentGaussian for SumsAlone {
    fn layout(&self) -> &Layout {
        &self.layout
    }
    fn latent(&self) -> Box<dyn Latent + '_> {
        Box::new(Sums { rank: self.rank })
    }
    fn prior_outer(&self, n: usize, rng: &mut ChaCha8Rng) -> Option<Vec<Vec<f64>>> {
        let mut one = || self.layout.outer.iter().map(|_| rng.sample(StandardNormal)).collect();
        Some((0..n).map(|_| one()).collect())
    }
}

impl SumsAlone {
    fn places(&self) -> Vec<[usize; 2]> {
        let of_group = |group| (0..PLACES).map(move |place| [group, place]);
        (0..self.layout.groups.len()).flat_map(of_group).collect()
    }
}
