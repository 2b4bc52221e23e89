//! Draws of a model against moments known from elsewhere.

use eplat::diagnostics::{mcse_sd, summarise};
use eplat::infer::{Settings, Silent, jittered_starts, sample};
use eplat::manifold::Basis;
use eplat::model::{Declare, Model};
use eplat::report::Posterior;
use eplat::table::Measurements;

/// The draws of every number of the parameters, chain by chain.
pub(crate) fn draws(
    model: &dyn Declare,
    basis: Option<&Basis>,
    data: &Measurements,
    n: usize,
) -> Vec<Vec<Vec<f64>>> {
    let model = Model::new(model, basis, data).unwrap();
    let settings = Settings { draws: n, ..Settings::default() };
    let starts = jittered_starts(&model, &model.initial(), settings.chains, settings.seed).unwrap();
    let chains: Vec<_> = sample(&model, &starts, &settings, &Silent).unwrap();
    let chains: Vec<_> = chains.into_iter().map(Result::unwrap).collect();
    let posterior = Posterior::new(&model, data, &chains, settings.seed, None).unwrap();
    let mut draws: Vec<Vec<Vec<f64>>> = vec![];
    let is_parameter = |name: &str| model.parameters.iter().any(|p| p.name == name);
    for variable in posterior.posterior.variables.iter().filter(|v| is_parameter(&v.name)) {
        let Some(values) = variable.values.floats().unwrap() else { continue };
        let width = values.len() / (settings.chains * n);
        let of_chain =
            |c: usize, k: usize| (0..n).map(|i| values[(c * n + i) * width + k]).collect();
        draws.extend((0..width).map(|k| (0..settings.chains).map(|c| of_chain(c, k)).collect()));
    }
    draws
}

/// Worst disagreement with the exact means and standard deviations, in Monte Carlo standard errors of
/// these very draws.
pub(crate) fn worst_error(draws: &[Vec<Vec<f64>>], mean: &[f64], sd: &[f64]) -> f64 {
    assert_eq!(draws.len(), mean.len());
    let errors = draws.iter().zip(mean.iter().zip(sd)).map(|(chains, (mean, sd))| {
        let chains: Vec<&[f64]> = chains.iter().map(Vec::as_slice).collect();
        let summary = summarise(&chains);
        let of_mean = (summary.mean - mean).abs() / summary.mcse;
        of_mean.max((summary.sd - sd).abs() / mcse_sd(&chains))
    });
    errors.fold(0.0, |worst, error| if error <= worst { worst } else { error })
}

/// Means and standard deviations of what `point` makes of the midpoints of a product grid, `cells` in
/// each direction of `sides`, with its log weights; a point without a weight has none.
pub(crate) fn grid_moments(
    sides: &[(f64, f64)],
    cells: usize,
    point: impl Fn(&[f64]) -> (Vec<f64>, f64),
) -> (Vec<f64>, Vec<f64>) {
    let n = cells.pow(sides.len() as u32);
    let at = |mut i: usize| {
        let mut x = vec![];
        for (low, high) in sides {
            x.push(low + (high - low) * ((i % cells) as f64 + 0.5) / cells as f64);
            i /= cells;
        }
        point(&x)
    };
    let points: Vec<(Vec<f64>, f64)> =
        (0..n).map(at).filter(|(_, ln_p)| ln_p.is_finite()).collect();
    let top = points.iter().map(|(_, ln_p)| *ln_p).fold(f64::NEG_INFINITY, f64::max);
    let width = points[0].0.len();
    let moment = |power: i32| -> Vec<f64> {
        let mut sums = vec![0.0; width];
        let mut total = 0.0;
        for (values, ln_p) in &points {
            let weight = (ln_p - top).exp();
            total += weight;
            sums.iter_mut().zip(values).for_each(|(s, x)| *s += weight * x.powi(power));
        }
        sums.iter().map(|s| s / total).collect()
    };
    let (mean, square) = (moment(1), moment(2));
    let sd = square.iter().zip(&mean).map(|(s, m)| (s - m * m).sqrt()).collect();
    (mean, sd)
}
