//! Shows  the loop as a library: measurements depend on contact force, the model does not say so; what it
//!        leaves over is searched for its cause, and the model with it is written as a model file.
//! Run    `cargo run --release --example close_the_loop`
//! Expect an effect of `force_g` (as a line or a curve) and none of `wall_mm`, the error at sites left out
//!        falling from about 11 ms to about 6, and the effect in a model file, in a few seconds.

use std::error::Error;
use std::io::{Write, stdout};

use std::ops::ControlFlow;

use eplat::criticism::{
    Criticism, Findings, Left, SearchSettings, Subject, criticise, leave_sites_out, rewrite,
};
use eplat::experiment::{Design, experiment};
use eplat::manifold::eigenpairs;
use eplat::mesh::left_atrium;
use eplat::model::AddedEffect;
use eplat::prelude::*;
use eplat::table::Measurements;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

model! {
    /// The refractory period as one field; nothing is said of how it was measured.
    model ErpMap;

    field erp(x) [ms] in 200.0..280.0 = m + alpha * gp(Matern52(rho), K = 16) where {
        m     [ms] ~ Normal(230.0, 30.0);
        alpha [ms] ~ HalfNormal(20.0);
        rho   [mm] ~ InvGamma(3.0, 150.0);
    }

    observe s1s2(x): Bracket [ms] ~ Interval(erp(x), 2.0);
}

/// Edge length of the atrium, mm: coarse, so that this is quick.
const EDGE: f64 = 3.0;
/// Change of what is measured per sd of contact force, ms.
const FORCE: f64 = -8.0;

fn main() -> Result<(), Box<dyn Error>> {
    run(&mut stdout().lock())
}

/// The whole example, printed to `out`.
pub(crate) fn run(out: &mut dyn Write) -> Result<(), Box<dyn Error>> {
    let mesh = left_atrium(EDGE).mesh;
    let basis = eigenpairs(&mesh, 64)?;
    let design = Design { n_sites: 40, ..Design::default() };
    let made = experiment(&ErpMap, &mesh, &basis, &design)?;
    let mut table = with_force(&made.measurements)?;
    table.place_at_indices(mesh.n_vertices())?;

    // The search: every column of the table, against the same search on data simulated without effects.
    let case = Subject { model: &ErpMap, basis: Some(&basis), table: &table };
    let settings = SearchSettings { nulls: 39, ..SearchSettings::default() };
    let outcome = criticise(&case, &settings, &|_| ControlFlow::Continue(()))?;
    for record in &outcome.rounds[0].tried {
        let name = outcome.candidates[record.candidate].cause.to_string();
        writeln!(out, "{name:8} log Bayes factor {:6.1}: {}", record.log_bf, record.judgement)?;
    }

    // Before and after: each site predicted from the others.
    let after = leave_sites_out(&outcome.engine, &outcome.last, settings.seed);
    let (before, after) =
        (rms_error(&outcome, &outcome.rounds[0].left), rms_error(&outcome, &after));
    writeln!(out, "error at sites left out: {before:.1} ms before, {after:.1} ms after\n")?;

    // The model file with what was found.
    let found = |candidate: &usize| {
        let c = &outcome.candidates[*candidate];
        let (name, on, form) = (c.cause.to_string(), c.on.clone(), c.form.clone()?);
        Some((AddedEffect { name, on, unit: "ms".into(), form, sd: c.sd }, "Found.".to_owned()))
    };
    let effects: Vec<(AddedEffect, String)> = outcome.found().iter().filter_map(found).collect();
    let model = "model! {\n    model ErpMap;\n    // … as above …\n}\n";
    let findings =
        Findings { effects, outliers: outcome.last.outer.outliers, ..Findings::default() };
    writeln!(out, "{}", rewrite(model, &findings).unwrap_or_default())?;
    Ok(())
}

/// The brackets of `table` as they are read at a contact force that differs from site to site, beside a
/// second column that does nothing.
fn with_force(table: &Measurements) -> Result<Measurements, Box<dyn Error>> {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut cells = vec![];
    for row in 0..table.len() {
        let (force, wall): (f64, f64) = (rng.sample(StandardNormal), rng.sample(StandardNormal));
        let lower: f64 = table.cell(row, "lower").unwrap_or_default().parse()?;
        let lower = 10.0 * ((lower + FORCE * force) / 10.0).round();
        let vertex = table.cell(row, "vertex").unwrap_or_default().to_owned();
        let numbers = [lower, lower + 10.0, 15.0 + 5.0 * force, 2.0 + 0.5 * wall];
        cells.push([&[vertex][..], &numbers.map(|x| x.to_string())].concat());
    }
    let header = ["vertex", "lower", "upper", "force_g", "wall_mm"];
    Ok(Measurements::from_cells("made", header.map(String::from).to_vec(), cells)?)
}

/// Root mean squared difference of the middle of each bracket and what the other sites predict, ms.
fn rms_error(outcome: &Criticism, left: &Left) -> f64 {
    let error = |(row, predicted): (usize, &f64)| (outcome.engine.middle(row) - predicted).powi(2);
    let squares = left.predicted.iter().enumerate().map(error);
    (squares.sum::<f64>() / left.predicted.len() as f64).sqrt()
}
