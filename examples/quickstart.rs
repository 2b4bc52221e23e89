//! Shows  how to use eplat as a library: declare a model, measure a known truth on a surface, fit the
//!        model, compare the fitted map with the truth, and write all that the program writes.
//! Run    cargo run --release --example quickstart
//! Expect a table of four parameters with R̂ near 1, an RMSE well below the truth's spread, and the
//!        files in out/quickstart, in about a second. Open out/quickstart/report.html in a browser.

use std::error::Error;
use std::io::{Write, stdout};
use std::path::Path;

use eplat::prelude::*;
use eplat::run::{DataSource, Design, Inputs, MeshSource, Problem, Settings};

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

fn main() -> Result<(), Box<dyn Error>> {
    run(&mut stdout().lock(), Path::new("out/quickstart"))
}

/// The whole example, printed to `out`, with its files in `folder`.
pub(crate) fn run(out: &mut dyn Write, folder: &Path) -> Result<(), Box<dyn Error>> {
    // A coarse left atrium, so that this is quick, and brackets of a known truth at twenty sites. Your
    // own would be MeshSource::File { path, reading, whole } and DataSource::File(path).
    let inputs = Inputs {
        mesh: MeshSource::Embedded { edge: 2.5 },
        data: DataSource::Synthetic(Design { n_sites: 20, ..Design::default() }),
        ..Inputs::default()
    };
    let settings = Settings { draws: 2000, ..Settings::default() };
    let fit = Problem::load(&ErpMap, &inputs)?.fit(&settings)?;

    // All that the end of `eplat run` says, and all files that it leaves.
    let results = fit.write(folder)?;
    writeln!(out, "{}", results.text())?;

    // The field at every vertex, beside the truth.
    let erp = &fit.maps()[0];
    if let (Some(truth), Some(error)) = (&erp.truth, erp.rmse()) {
        let mean = truth.iter().sum::<f64>() / truth.len() as f64;
        let variance = truth.iter().map(|t| (t - mean).powi(2)).sum::<f64>() / truth.len() as f64;
        let (name, unit, spread) = (&erp.name, &erp.unit, variance.sqrt());
        writeln!(
            out,
            "{name}: off by {error:.1} {unit} over the surface, the truth's sd is {spread:.1} {unit}"
        )?;
    }
    writeln!(out, "Files in {}: {}", folder.display(), results.files.join(", "))?;
    Ok(())
}
