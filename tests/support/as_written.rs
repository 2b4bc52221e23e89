//! Models that are evaluated as they are written, beside the compiled ones.
#![allow(dead_code, reason = "each test uses a part of it")]

use eplat::infer::LogDensity as _;
use eplat::manifold::Basis;
use eplat::model::{Declare, Interpreted, Model};
use eplat::table::Measurements;
use eplat_language::File;

/// That density, gradient and Hessian of two models are the same to the bit.
pub(crate) fn same(one: &Model, other: &Model, u: &[f64]) {
    assert_eq!(one.unknown_names(), other.unknown_names());
    let bits = |x: &[f64]| x.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    let of = |model: &Model| {
        let (mut evaluator, mut gradient) = (model.evaluator(), vec![0.0; u.len()]);
        let lp = evaluator.ln_density(u, &mut gradient);
        let mut all = vec![bits(&[lp]), bits(&gradient)];
        evaluator.hessian(u, &mut |_, column| all.push(bits(column)));
        all
    };
    assert!(of(one) == of(other), "{}", one.name);
}

/// That a model is the same if it is read from its text.
pub(crate) fn same_as_written(model: &dyn Declare, basis: &Basis, data: &Measurements, u: &[f64]) {
    let source = format!("use eplat::prelude::*;\nmodel! {{ {} }}\n", model.source());
    let file = File::read(&source).unwrap_or_else(|mistake| panic!("{}", mistake.message));
    let written = Interpreted::of(&file).unwrap_or_else(|beyond| panic!("{beyond:?}"));
    let of = |model: &dyn Declare| Model::new(model, Some(basis), data).unwrap();
    same(&of(model), &of(&written), u);
}
