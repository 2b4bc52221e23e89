//! Whether a model's block is the model itself in other coordinates.

use super::blocks::Blocks;
use super::free_priors;
use super::models_of_tests::{Beside, Counts, apart, basis, measured, patients, places, rows};
use crate::infer::{Design, LatentGaussian as _, LogDensity as _};
use crate::model::Model;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

/// Also of groups, deviations of places, and rows that see no field.
#[test]
fn log_likelihoods_of_places_sum_to_that_of_all_rows() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let counts = Model::new(&Counts, Some(&basis(12)), &rows("beats", 8)).unwrap();
    let models = [counts, places(8), patients(18), measured(), apart()];
    for model in &models {
        let blocks = Blocks::new(model);
        let (layout, mut latent) = (blocks.layout(), blocks.latent());
        let mut designs: Vec<Design> = layout.groups.iter().map(Design::new).collect();
        latent.set_outer(&blocks.prior_outer(1, &mut rng).unwrap()[0], &mut designs);
        let theta: Vec<f64> = (0..layout.n_latent()).map(|_| rng.random_range(-1.0..1.0)).collect();
        let all = latent.ln_likelihood(&theta);
        // what was set before at other places does not matter
        latent.ln_likelihood(&vec![3.0; theta.len()]);
        let (mut first, mut sum) = (0, 0.0);
        for (number, group) in layout.groups.iter().enumerate() {
            for place in 0..group.n_seen {
                let at = |f: usize| first + f * group.n_seen + place;
                let mut own: Vec<f64> = (0..group.blocks.len()).map(|f| theta[at(f)]).collect();
                // five particles, more than are computed at once, the last of them this one
                let others = [0.1, 0.2, 0.3, 0.4].map(|d| own.iter().map(move |x| x + d).collect());
                own.splice(0..0, others.into_iter().flat_map(|theta: Vec<f64>| theta));
                let mut values = [0.0; 5];
                latent.ln_likelihoods([number, place], &own, &mut values);
                sum += values[4];
            }
            first += group.n_latent();
        }
        assert!((sum - all).abs() < 1e-10 * all.abs(), "{sum} instead of {all}");
    }
}

#[test]
fn free_values_and_their_coefficients_are_two_forms_of_the_same() {
    let model = Model::new(&Beside, Some(&basis(12)), &rows("direct", 30)).unwrap();
    let blocks = Blocks::integrated(&model, &free_priors(&model).unwrap());
    let layout = blocks.layout();
    assert_eq!(
        (layout.outer.len(), &layout.free_precision[..]),
        (1, &[0.0, 1.0, 1.0, 1.0, 1.0][..])
    );
    let mut latent = blocks.latent();
    let position: Vec<f64> = (0..model.dim()).map(|i| 0.3 + (i as f64).sin()).collect();
    let mut coefficients = vec![0.0; layout.n_coefficients()];
    latent.coefficients(&position, &mut coefficients);
    let outer: Vec<f64> = layout.outer.iter().map(|u| position[*u]).collect();
    let (mut again, mut rng) = (vec![0.0; model.dim()], ChaCha8Rng::seed_from_u64(1));
    let ln_density = latent.join(&outer, &coefficients, &mut rng, &mut again);
    for (a, b) in again.iter().zip(&position) {
        assert!((a - b).abs() < 1e-12, "{a} instead of {b}");
    }
    let mut gradient = vec![0.0; model.dim()];
    let direct = model.evaluator().ln_density(&position, &mut gradient);
    assert!((ln_density - direct).abs() < 1e-9, "{ln_density} instead of {direct}");
}
