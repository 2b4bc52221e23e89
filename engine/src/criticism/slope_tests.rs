//! The gradient against central differences of the evidence, of a model that is linear in nothing.

use super::super::engine::{Outer, TriedTerm};
use super::*;
use crate::manifold::Basis;
use crate::model::Model;
use crate::prelude::*;
use crate::table::Measurements;

model! {
    /// Brackets of a product of fields, numbers with a noise of their own, and offsets of labels with a learnt spread.
    model Bent;
    param spread ~ LogNormal(0.0, 0.5);
    param offset(label) ~ Normal(0.0, spread);
    param noise ~ LogNormal(0.0, 0.5);
    field f(x) = m + alpha * gp(Rbf(rho), K = 6) where {
        m ~ Normal(10.0, 4.0);
        alpha ~ InvGamma(3.0, 6.0);
        rho [mm] ~ LogNormal(3.5, 0.5);
    }
    field g(x) within 0.0..8.0 = m + alpha * gp(Matern32(rho), K = 6) where {
        m ~ Normal(3.0, 2.0);
        alpha ~ InvGamma(3.0, 2.0);
        rho [mm] ~ LogNormal(3.5, 0.5);
    }
    let shown(row) = f(row) * (g(row) * 0.2 + 1) + offset(row);
    let level(row) = g(row) * g(row);
    observe a(row): Bracket ~ TopHat(shown(row));
    observe b(row): Bracket ~ Interval(shown(row), noise);
    observe c(row): Number ~ Normal(level(row), noise * 0.5);
}

/// Six made-up modes at 12 vertices.
fn basis() -> Basis {
    let entry =
        |i: usize| if i.is_multiple_of(6) { 0.01 } else { ((i * 37 % 29) as f64 - 14.0) / 900.0 };
    Basis {
        eigenvalues: (0..6).map(|k| 4e-4 * f64::from(k)).collect(),
        eigenfunctions: (0..72).map(entry).collect(),
    }
}

fn table() -> Measurements {
    let cells = (0..24).map(|i: usize| {
        let x =
            15.0 + (5.0 * (i as f64 * 2.3).sin()).round() + 10.0 * ((i % 12) as f64 * 0.7).cos();
        let ends = |x: f64, width: f64| [x.floor().to_string(), (x.floor() + width).to_string()];
        let [protocol, lower, upper, value] = match i % 3 {
            0 => {
                let [l, u] = ends(x, 4.0);
                ["a".into(), l, u, String::new()]
            }
            1 => {
                let [l, _] = ends(x, 5.0);
                ["b".into(), l, String::new(), String::new()]
            }
            _ => ["c".into(), String::new(), String::new(), (0.6 * x).to_string()],
        };
        let label = ["A", "B", "C"][i / 3 % 3].to_owned();
        vec![protocol, (i % 12).to_string(), lower, upper, value, label]
    });
    let header = ["protocol", "vertex", "lower", "upper", "value", "label"].map(String::from);
    let mut table = Measurements::from_cells("made up", header.to_vec(), cells.collect()).unwrap();
    table.place_at_indices(12).unwrap();
    table
}

fn engine() -> Engine {
    let (table, on) = (table(), ["shown", "shown", "level"].map(String::from));
    let all = ["shown", "level", "f", "g"].map(String::from);
    let model = Model::with_offsets(&Bent, Some(&basis()), &table, &all).unwrap();
    let sites: Vec<usize> = (0..24).map(|i| i % 12).collect();
    let unit = (0..24).flat_map(|i| [f64::from(u8::from(i < 12)), f64::from(u8::from(i >= 12))]);
    let dose = (0..24).map(|i: u32| f64::from(i * 7 % 5) - 2.0).collect();
    let terms = vec![
        TriedTerm { on: vec!["shown".into()], design: unit.collect(), n: 2, sd: None },
        TriedTerm { on: vec!["g".into()], design: dose, n: 1, sd: Some(0.3) },
    ];
    Engine::new(model, &on, &sites, &[], terms)
}

fn moved(outer: &Outer, i: usize, by: f64) -> Outer {
    let mut outer = outer.clone();
    match i {
        0 => outer.ln_site += by,
        1 => outer.ln_noise += by,
        2 => outer.ln_unit = outer.ln_unit.map(|unit| unit + by),
        _ => outer.other[i - 3] += by,
    }
    outer
}

#[test]
fn the_gradient_is_that_of_central_differences() {
    const STEP: f64 = 1e-2;
    let engine = engine();
    let initial = engine.model.initial();
    for outliers in [None, Some((0.1, 6.0))] {
        let other: Vec<f64> = engine.split.other.iter().map(|u| initial[*u] + 0.1).collect();
        let outer = Outer {
            other,
            ln_site: 0.1,
            ln_noise: 0.3,
            ln_unit: Some(0.2),
            outliers,
            scatter: vec![],
        };
        let fit = engine.fit(&outer, &[0, 1], None).unwrap();
        let pieces = Pieces::new(&engine, &fit);
        let has_positive_part = |r: &usize| {
            let n = engine.rows[*r].n;
            let hessian = DMatrix::from_row_slice(n, n, &pieces.hessian(*r));
            let values = hessian.symmetric_eigenvalues();
            values.max() > 1e-3 * values.amax()
        };
        let clipped = (0..engine.rows.len()).filter(has_positive_part).count();
        assert!((2..23).contains(&clipped), "{clipped} rows with a positive part");
        let slope = engine.slope(&fit);
        let exact = [vec![slope.ln_site, slope.ln_noise, slope.ln_unit], slope.other].concat();
        for (i, exact) in exact.iter().enumerate() {
            let at = |by: f64| {
                engine.fit(&moved(&outer, i, by), &[0, 1], Some(&fit)).unwrap().ln_evidence
            };
            // of fourth order: what is left is how well the mode is known, some 1e-6, by the step
            let difference =
                (8.0 * (at(STEP) - at(-STEP)) - at(2.0 * STEP) + at(-2.0 * STEP)) / (12.0 * STEP);
            assert!(
                (exact - difference).abs() < 1e-3 * (1.0 + difference.abs()),
                "{i}: {exact} {difference}"
            );
        }
    }
}
