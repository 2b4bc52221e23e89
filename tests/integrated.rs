//! The integrated sampler against NUTS: every reported number; and which models it is for.
#![allow(clippy::unwrap_used, reason = "a test")]

#[path = "models/normal_fields.rs"]
mod models;
#[path = "support/posterior.rs"]
mod posterior;
mod support;

use eplat::infer::{Settings, Silent, jittered_starts};
use eplat::model::{Declare, Model, Sampler};
use posterior::{Column, all, columns, largest_z};

/// Two-sided 0.1 % over the hundred or so comparisons of two posteriors.
const LARGEST_Z: f64 = 4.5;

fn model(declared: &dyn Declare, protocols: &[&str]) -> Model {
    let basis = support::basis(60, 24);
    let rows = support::numbers_on(&basis, protocols);
    Model::new(declared, Some(&basis), &rows).unwrap()
}

fn sample(sampler: Sampler, model: &Model) -> Vec<Column> {
    let settings = Settings::default();
    let starts = jittered_starts(model, &model.initial(), settings.chains, settings.seed).unwrap();
    let columns = columns(model, &all(sampler.sample(model, &starts, &settings, &Silent).unwrap()));
    for column in &columns {
        let r_hat = column.summary().r_hat;
        assert!(
            r_hat.is_nan() || r_hat < 1.02,
            "{}, {}: R-hat {r_hat}",
            sampler.name(),
            column.name
        );
    }
    columns
}

#[test]
fn one_noise_agrees_with_nuts_and_a_twin_does_not() {
    let one = model(&models::one_noise::OneNoise, &["direct"]);
    assert_eq!(Sampler::of(&one), Sampler::Integrated);
    let nuts = sample(Sampler::Nuts, &one);
    let (z, what) = largest_z(&sample(Sampler::Integrated, &one), &nuts);
    assert!(z < LARGEST_Z, "{what}");
    let twin = model(&models::twin::Twin, &["direct"]);
    let (z, what) = largest_z(&sample(Sampler::Integrated, &twin), &nuts);
    assert!(z > 2.0 * LARGEST_Z, "a noise that is a fifth larger goes unseen: {what}");
}

#[test]
fn two_fields_and_a_noise_of_each_catheter_agree_with_nuts() {
    let model = model(&models::two_fields::TwoFields, &["direct", "mixed"]);
    assert_eq!(Sampler::of(&model), Sampler::Integrated);
    let [integrated, nuts] = [Sampler::Integrated, Sampler::Nuts].map(|s| sample(s, &model));
    let (z, what) = largest_z(&integrated, &nuts);
    assert!(z < LARGEST_Z, "{what}");
}

#[test]
fn parameters_and_effects_beside_a_field_agree_with_nuts_and_a_twin_does_not() {
    let sums = model(&models::sums::Sums, &["direct", "mixed"]);
    assert_eq!(Sampler::of(&sums), Sampler::Integrated);
    let nuts = sample(Sampler::Nuts, &sums);
    let (z, what) = largest_z(&sample(Sampler::Integrated, &sums), &nuts);
    assert!(z < LARGEST_Z, "{what}");
    let twin = model(&models::sums_twin::SumsTwin, &["direct", "mixed"]);
    let (z, what) = largest_z(&sample(Sampler::Integrated, &twin), &nuts);
    assert!(z > 2.0 * LARGEST_Z, "a prior twice as wide goes unseen: {what}");
}

#[test]
fn what_is_not_linear_in_the_fields_is_left_to_others() {
    let model = model(&models::product::Product, &["direct"]);
    assert!(!Sampler::Integrated.takes(&model));
    assert_eq!(Sampler::of(&model), Sampler::Blocked);
}
