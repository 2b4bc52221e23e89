//! Shows  how to use eplat as a library: declare a model, lay it out on a surface and measurements,
//!        sample it, and compare the fitted map with the known truth.
//! Run    cargo run --release --example quickstart
//! Expect a table of four parameters with R̂ near 1, and an RMSE well below the truth's spread, in
//!        about a second.

use std::error::Error;
use std::io::{Write, stdout};

use eplat::infer::{self, Chain, Settings, Silent, jittered_starts};
use eplat::manifold::eigenpairs;
use eplat::mesh::left_atrium;
use eplat::model::{Maps, Model};
use eplat::prelude::*;
use eplat::report::{Posterior, console_table};
use eplat::experiment::{Design, experiment};

model! {
    /// The refractory period itself as one field, without cell parameters behind it.
    model ErpMap;

    field erp(x) [ms] in 180.0..280.0 = m + alpha * gp(Matern52(rho), K = 32) where {
        m     [ms] ~ Flat;
        alpha [ms] ~ HalfNormal(30.0);
        rho   [mm] ~ InvGamma(3.0, 150.0);
    }

    observe s1s2(x): Bracket [ms] ~ Interval(erp(x), 2.0);
}

/// Edge length of the atrium, mm: coarse, so that this is quick.
const EDGE: f64 = 2.5;

/// Modes of the truth; the model itself uses the first 32.
const MODES: usize = 128;

fn main() -> Result<(), Box<dyn Error>> {
    run(&mut stdout().lock())
}

/// The whole example, printed to `out`.
pub(crate) fn run(out: &mut dyn Write) -> Result<(), Box<dyn Error>> {
    // A surface, the eigenfunctions that fields are made of, and measurements of a known truth.
    let mesh = left_atrium(EDGE).mesh;
    let basis = eigenpairs(&mesh, MODES)?;
    let design = Design { n_sites: 20, ..Design::default() };
    let made = experiment(&ErpMap, &mesh, &basis, &design)?;

    // A model with its data is a log density; NUTS knows nothing else of it.
    let model = Model::new(&ErpMap, Some(&basis), &made.measurements)?;
    let settings = Settings { chains: 4, warmup: 1000, draws: 2000, ..Settings::default() };
    let starts = jittered_starts(&model, &model.initial(), settings.chains, settings.seed)?;
    let chains: Vec<Chain> = infer::sample(&model, &starts, &settings, &Silent)?
        .into_iter()
        .collect::<Result<_, _>>()?;

    // Parameters with their diagnostics, and the field at every vertex beside the truth.
    let posterior = Posterior::new(&model, &made.measurements, &chains, settings.seed);
    writeln!(out, "{}", console_table(&posterior.rows, false))?;
    let draws: Vec<&[f64]> =
        chains.iter().flat_map(|c| (0..c.n_draws()).map(|i| c.draw(i))).collect();
    let (maps, _) = Maps::new(&model, &basis).summarise(&draws);
    let (fitted, (name, truth)) = (&maps[0].mean, &made.truth[0]);
    let mean = truth.iter().sum::<f64>() / truth.len() as f64;
    let spread = rms(truth.iter().map(|t| t - mean));
    let error = rms(fitted.iter().zip(truth).map(|(f, t)| f - t));
    writeln!(out, "{name}: RMSE {error:.1} ms over the surface, the truth's sd is {spread:.1} ms")?;
    Ok(())
}

fn rms(errors: impl ExactSizeIterator<Item = f64>) -> f64 {
    let n = errors.len() as f64;
    (errors.map(|e| e * e).sum::<f64>() / n).sqrt()
}
