//! A field within its range is the `let` of its sum that one could write by hand: in the log density, its
//! derivatives and the maps. Its truth is the field's, not the sum's.

#![allow(clippy::unwrap_used, reason = "tests")]

mod support;
#[path = "models/within.rs"]
mod within;

use eplat::experiment::Laboratory;
use eplat::infer::LogDensity as _;
use eplat::manifold::Basis;
use eplat::model::{Declare, Maps, Model};
use eplat::table::Measurements;
use rand::RngExt as _;
use support::{basis, rng, table};
use within::{by_hand::ByHand, linked::Linked};

fn rows() -> Measurements {
    let line = |i: usize| {
        let (protocol, value) = [("direct", 380 + i), ("flat", i % 5)][i % 2];
        format!("{protocol},{},{value},{}.5,{}", 5 * i, i % 3, ["ann", "bob"][i % 3 % 2])
    };
    let lines: Vec<String> = (0..24).map(line).collect();
    let mut rows = table("protocol,vertex,value,force_g,patient", &lines);
    rows.place_at_indices(200).unwrap();
    rows
}

/// The models on the same rows, and unknowns at which some sums lie beyond their range.
fn pair(basis: &Basis) -> ([Model; 2], Vec<f64>) {
    let both = [&Linked as &dyn Declare, &ByHand];
    let models = both.map(|model| Model::new(model, Some(basis), &rows()).unwrap());
    let (mut u, mut rng) = (models[0].initial(), rng(5));
    for u in &mut u {
        *u += rng.random_range(-1.5..1.5);
    }
    (models, u)
}

/// Value, gradient and Hessian, one after the other.
fn all_derivatives(model: &Model, u: &[f64]) -> Vec<f64> {
    let mut gradient = vec![0.0; u.len()];
    let mut evaluator = model.evaluator();
    let mut all = vec![evaluator.ln_density(u, &mut gradient)];
    all.extend(&gradient);
    evaluator.hessian(u, &mut |_, column| all.extend_from_slice(column));
    all
}

#[test]
fn log_density_gradient_and_hessian_are_those_of_the_let_by_hand() {
    let (models, u) = pair(&basis(200, 12));
    let [linked, by_hand] = models.each_ref().map(|model| all_derivatives(model, &u));
    assert!(linked[0].is_finite());
    for (i, (a, b)) in linked.iter().zip(&by_hand).enumerate() {
        assert!((a - b).abs() <= 1e-9 * (1.0 + b.abs()), "{i}: {a} {b}");
    }
}

#[test]
fn maps_show_the_field_and_not_its_sum() {
    let basis = basis(200, 12);
    let (models, u) = pair(&basis);
    let [linked, by_hand] = models.each_ref().map(|model| {
        let maps = Maps::new(model, &basis);
        let names: Vec<String> = maps.names().iter().map(|map| map.name.to_owned()).collect();
        let values = maps.draws_at(std::slice::from_ref(&u), &(0..200).collect::<Vec<_>>());
        (names, values)
    });
    for name in ["level", "own[ann]", "own[bob]", "product[ann]", "product[bob]"] {
        let [(a, of_a), (b, of_b)] = [&linked, &by_hand]
            .map(|(names, values)| (names.iter().position(|own| own == name).unwrap(), values));
        for (x, y) in of_a.iter().zip(of_b) {
            assert!((x[a][0] - y[b][0]).abs() < 1e-9, "{name}: {} {}", x[a][0], y[b][0]);
        }
    }
    assert_eq!(linked.0.len(), 5, "the sums are no maps: {:?}", linked.0);
    let sums = by_hand.1.iter().filter(|maps| !(-4.0..=6.0).contains(&maps[0][0])).count();
    assert!(sums > 5, "no sum lies beyond its range, so nothing was bent: {sums}");
}

#[test]
fn a_truth_is_one_of_the_field() {
    let basis = basis(200, 12);
    let outline = Model::outline(&Linked).unwrap();
    let maps = Maps::new(&outline, &basis);
    let mut tape = outline.tape();
    outline.forward(&mut tape, &outline.initial());
    // the ends themselves, too: a truth that is stretched onto its range reaches them
    let level: Vec<f64> = (0..200).map(|i| -4.0 + 10.0 * f64::from(i) / 199.0).collect();
    let own = vec![200.0; 200];
    let derived = maps.derived_fields(&tape, &[level.clone(), own]);
    for (product, level) in derived[0].iter().zip(level) {
        assert!((product - 400.0 - level * level / 200.0).abs() < 1e-6, "{product} {level}");
    }
    assert!(Laboratory::new(&Linked, &basis).is_ok());
}
