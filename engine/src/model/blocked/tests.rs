use super::models_of_tests::{Counts, Known, Patients, basis, patients, places, rows};
use super::*;
use crate::diagnostics::{mcse_mean, mcse_sd, mean_and_sd};
use crate::infer::{Blocked, Chain, ChainError, MarkovChain, Silent, jittered_starts};
use crate::infer::{Design, Evaluator, Latent, LatentGaussian, Layout, LogDensity};
use crate::model::Declare;
use crate::prelude::*;
use nalgebra::{DMatrix, DVector};
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;

fn model(declared: &dyn Declare, protocol: &str, n_rows: usize) -> Model {
    Model::new(declared, Some(&basis(12)), &rows(protocol, n_rows)).unwrap()
}

/// What a twin gets wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fault {
    None,
    /// What the sites do not see is drawn once and for all.
    Unseen,
    /// Fields a tenth wider than their prior.
    Design,
    /// Means twice as wide as their prior.
    Mean,
    /// Hyperparameters without their prior.
    Prior,
    /// Hyperparameters moved by half of the log likelihood.
    Likelihood,
    /// Hyperparameters and coefficients moved together as if nothing had been measured.
    Particles,
}

struct Twin<'m>(Blocks<'m>, Fault);
struct TwinLatent<'m>(Box<dyn Latent + 'm>, Fault);

impl LogDensity for Twin<'_> {
    fn dim(&self) -> usize {
        self.0.dim()
    }
    fn evaluator(&self) -> Box<dyn Evaluator + '_> {
        self.0.evaluator()
    }
}

impl LatentGaussian for Twin<'_> {
    fn layout(&self) -> &Layout {
        self.0.layout()
    }
    fn latent(&self) -> Box<dyn Latent + '_> {
        Box::new(TwinLatent(self.0.latent(), self.1))
    }
    fn prior_outer(&self, n: usize, rng: &mut ChaCha8Rng) -> Option<Vec<Vec<f64>>> {
        self.0.prior_outer(n, rng)
    }
}

impl Latent for TwinLatent<'_> {
    fn coefficients(&mut self, position: &[f64], out: &mut [f64]) {
        self.0.coefficients(position, out);
    }
    fn join(&mut self, outer: &[f64], block: &[f64], rng: &mut dyn Rng, at: &mut [f64]) -> f64 {
        let mut same = ChaCha8Rng::seed_from_u64(1);
        let rng: &mut dyn Rng = if self.1 == Fault::Unseen { &mut same } else { rng };
        self.0.join(outer, block, rng, at)
    }
    fn set_outer(&mut self, outer: &[f64], designs: &mut [Design]) -> f64 {
        let ln_prior = self.0.set_outer(outer, designs);
        let design = &mut designs[0];
        if self.1 == Fault::Design {
            for (rows, scale) in design.rows.iter_mut().zip(&mut design.scale) {
                let width = scale.len();
                rows.chunks_exact_mut(width)
                    .for_each(|row| row[..width - 1].iter_mut().for_each(|x| *x *= 1.1));
                scale[..width - 1].iter_mut().for_each(|x| *x *= 1.1);
            }
        }
        if self.1 == Fault::Mean {
            for (rows, scale) in design.rows.iter_mut().zip(&mut design.scale) {
                let last = scale.len() - 1;
                rows.chunks_exact_mut(last + 1).for_each(|row| row[last] *= 2.0);
                scale[last] *= 2.0;
            }
        }
        if self.1 == Fault::Prior { 0.0 * ln_prior } else { ln_prior }
    }
    fn ln_likelihood(&mut self, theta: &[f64]) -> f64 {
        let share = if self.1 == Fault::Likelihood { 0.5 } else { 1.0 };
        share * self.0.ln_likelihood(theta)
    }
    fn ln_likelihoods(&mut self, at: [usize; 2], theta: &[f64], out: &mut [f64]) {
        self.0.ln_likelihoods(at, theta, out);
        if self.1 == Fault::Particles {
            out.fill(0.0);
        }
    }
    fn ln_of_rows(&mut self, at: [usize; 2], theta: &[f64]) -> Vec<Vec<f64>> {
        self.0.ln_of_rows(at, theta)
    }
    fn slope(&mut self, theta: &[f64], theta_bar: &mut [f64]) -> f64 {
        self.0.slope(theta, theta_bar)
    }
    fn slopes(
        &mut self,
        outer: &[f64],
        theta: &[f64],
        theta_bar: &mut [f64],
        outer_bar: &mut [f64],
    ) -> f64 {
        self.0.slopes(outer, theta, theta_bar, outer_bar)
    }
}

fn settings(draws: usize) -> Settings {
    Settings { chains: 4, draws, warmup: 300, target_accept: Some(0.8), ..Settings::default() }
}

fn blocked(model: &Model, fault: Fault, draws: usize) -> Vec<Chain> {
    chains_of(model, Blocks::new(model), fault, draws)
}

fn chains_of(model: &Model, blocks: Blocks<'_>, fault: Fault, draws: usize) -> Vec<Chain> {
    twin_chains(model, blocks, fault, draws).unwrap_or_else(|e| panic!("{e}"))
}

fn twin_chains(
    model: &Model,
    blocks: Blocks<'_>,
    fault: Fault,
    draws: usize,
) -> Result<Vec<Chain>, ChainError> {
    let settings = settings(draws);
    let starts = jittered_starts(model, &model.initial(), 4, 1).unwrap();
    let twin = Twin(blocks, fault);
    sample_blocked(&twin, &starts, &settings, &Silent).unwrap().into_iter().collect()
}

#[test]
fn a_blocked_chain_that_is_stepped_draws_what_a_run_of_one_draws() {
    let model = Model::new(&Counts, Some(&basis(12)), &rows("beats", 6)).unwrap();
    let blocks = Blocks::new(&model);
    let settings = Settings { chains: 1, warmup: 60, draws: 30, ..Settings::default() };
    let starts = jittered_starts(&model, &model.initial(), 1, 1).unwrap();
    let run = sample_blocked(&blocks, &starts, &settings, &Silent).unwrap().remove(0).unwrap();
    let mut chain = Blocked::new(&blocks, &starts[0], &settings).unwrap();
    assert_eq!(std::iter::from_fn(|| chain.adapt().unwrap()).count(), 60);
    for i in 0..30 {
        let draw = chain.draw().unwrap();
        assert_eq!((draw.position, draw.ln_density), (&*run.draw(i).unwrap(), run.ln_density[i]));
    }
    assert_eq!(chain.n_evaluations(), [run.n_grad_warmup, run.n_grad_sampling]);
}

/// Draws of unknown `i`, chain by chain.
fn unknown(chains: &[Chain], i: usize) -> Vec<Vec<f64>> {
    chains.iter().map(|c| (0..c.n_draws()).map(|d| c.draw(d).unwrap()[i]).collect()).collect()
}

/// Means and standard deviations with their Monte Carlo errors.
fn moments(chains: &[Vec<f64>]) -> [(f64, f64); 2] {
    let slices: Vec<&[f64]> = chains.iter().map(Vec::as_slice).collect();
    let (mean, sd) = mean_and_sd(&slices);
    [(mean, mcse_mean(&slices)), (sd, mcse_sd(&slices))]
}

/// Two-sided 0.1 % over about a hundred comparisons.
const LARGEST_Z: f64 = 4.5;

/// Mean and covariance of a normal density, from its gradient.
fn exact(model: &Model) -> (DVector<f64>, DMatrix<f64>) {
    let n = model.dim();
    let mut evaluator = model.evaluator();
    let mut gradient = |u: &[f64]| {
        let mut g = vec![0.0; n];
        evaluator.ln_density(u, &mut g);
        DVector::from_vec(g)
    };
    let at_zero = gradient(&vec![0.0; n]);
    let mut precision = DMatrix::zeros(n, n);
    for i in 0..n {
        let mut u = vec![0.0; n];
        u[i] = 1.0;
        precision.set_column(i, &(&at_zero - gradient(&u)));
    }
    let covariance = precision.try_inverse().unwrap();
    (&covariance * at_zero, covariance)
}

/// Largest |z| of the draws against the exact normal posterior.
fn against_exact(n_rows: usize, fault: Fault) -> f64 {
    let model = model(&Known, "direct", n_rows);
    let chains = blocked(&model, fault, 2000);
    let (mean, covariance) = exact(&model);
    let z = |i: usize| {
        let [(m, m_error), (s, s_error)] = moments(&unknown(&chains, i));
        let sd = covariance[(i, i)].sqrt();
        ((m - mean[i]) / m_error).abs().max(((s - sd) / s_error).abs())
    };
    (0..model.dim()).map(z).fold(0.0, f64::max)
}

#[test]
fn a_normal_posterior_is_met_with_fewer_sites_than_modes_and_with_more() {
    for n_rows in [5, 30] {
        let z = against_exact(n_rows, Fault::None);
        assert!(z < LARGEST_Z, "{n_rows} rows: z = {z}");
    }
}

#[test]
fn a_twin_that_does_not_draw_what_is_unseen_is_found_out() {
    assert!(against_exact(5, Fault::Unseen) > LARGEST_Z);
}

#[test]
fn a_twin_with_too_wide_a_prior_is_found_out() {
    assert!(against_exact(5, Fault::Design) > LARGEST_Z);
    assert!(against_exact(30, Fault::Design) > LARGEST_Z);
}

/// Largest |z| of the blocked sampler's draws against those of NUTS, and where.
fn against_nuts(model: &Model, fault: Fault) -> (f64, String) {
    let settings =
        Settings { chains: 4, draws: 3000, target_accept: Some(0.9), ..Settings::default() };
    let starts = jittered_starts(model, &model.initial(), 4, 3).unwrap();
    let nuts = infer::sample(model, &starts, &settings, &Silent).unwrap();
    let nuts: Vec<Chain> =
        nuts.into_iter().map(|chain| chain.unwrap_or_else(|e| panic!("{e}"))).collect();
    match twin_chains(model, Blocks::new(model), fault, 6000) {
        Ok(chains) => worst_z(model, &chains, &nuts),
        // without its prior a twin may wander off to where nothing is finite
        Err(error) => (f64::INFINITY, error.to_string()),
    }
}

fn worst_z(model: &Model, chains: &[Chain], others: &[Chain]) -> (f64, String) {
    let mut worst = (0.0, String::new());
    for (i, name) in model.unknown_names().into_iter().enumerate() {
        let pairs = moments(&unknown(chains, i)).into_iter().zip(moments(&unknown(others, i)));
        for ((a, a_error), (b, b_error)) in pairs {
            let z = ((a - b) / a_error.hypot(b_error)).abs();
            if z > worst.0 {
                worst = (z, format!("{name}: {a} against {b}, z = {z:.2}"));
            }
        }
    }
    worst
}

#[test]
fn skew_likelihoods_agree_with_nuts_with_fewer_sites_than_modes_and_with_more() {
    for n_rows in [8, 40] {
        let (z, what) = against_nuts(&model(&Counts, "beats", n_rows), Fault::None);
        assert!(z < LARGEST_Z, "{n_rows} rows: {what}");
    }
}

#[test]
fn coefficients_per_site_and_per_mode_agree() {
    for n_rows in [8, 40] {
        let model = model(&Counts, "beats", n_rows);
        let of =
            |per_site| chains_of(&model, Blocks::shaped(&model, &|_| per_site), Fault::None, 5000);
        let (z, what) = worst_z(&model, &of(true), &of(false));
        assert!(z < LARGEST_Z, "{n_rows} rows: {what}");
    }
}

#[test]
fn deviations_of_places_are_in_the_block_and_agree_with_nuts() {
    for n in [8, 30] {
        let model = places(n);
        let blocks = Blocks::new(&model);
        assert_eq!((blocks.places.len(), blocks.layout.groups[0].blocks.len()), (1, 2));
        let (z, what) = against_nuts(&model, Fault::None);
        assert!(z < LARGEST_Z, "{n} places: {what}");
    }
    let (z, what) = against_nuts(&places(30), Fault::Design);
    assert!(z > LARGEST_Z, "{what}");
}

#[test]
fn fields_of_each_label_are_groups_and_agree_with_nuts() {
    let model = patients(38);
    let sizes: Vec<usize> = Blocks::new(&model).layout.groups.iter().map(|g| g.n_seen).collect();
    assert_eq!(sizes, [30, 5, 3]);
    let (z, what) = against_nuts(&model, Fault::None);
    assert!(z < LARGEST_Z, "{what}");
    // the means of one group alone are too wide
    let (z, what) = against_nuts(&model, Fault::Mean);
    assert!(z > LARGEST_Z, "{what}");
}

/// The largest group has the rows of one patient: 12 modes at 30 sites and as many of the other field.
#[test]
fn groups_that_are_too_large_are_sampled_by_nuts_unless_the_blocked_sampler_is_asked_for() {
    let model = patients(38);
    assert_eq!(
        [24, 23].map(|most| Sampler::up_to(&model, most)),
        [Sampler::Blocked, Sampler::Nuts]
    );
    assert!(Sampler::Blocked.takes(&model));
    let unseen = Model::outline(&Patients).unwrap();
    assert!(!Sampler::Blocked.takes(&unseen) && Sampler::Nuts.takes(&unseen));
    assert_eq!(Sampler::of(&unseen), Sampler::Nuts);
}

#[test]
fn twins_that_miss_a_prior_or_the_likelihood_are_found_out() {
    for (n_rows, fault) in
        [(8, Fault::Mean), (8, Fault::Particles), (40, Fault::Prior), (60, Fault::Likelihood)]
    {
        let (z, what) = against_nuts(&model(&Counts, "beats", n_rows), fault);
        assert!(z > LARGEST_Z, "{fault:?}: {what}");
    }
}

#[test]
fn small_groups_agree_with_nuts() {
    let (z, what) = against_nuts(&patients(18), Fault::None);
    assert!(z < LARGEST_Z, "{what}");
    let (z, what) = against_nuts(&patients(18), Fault::Particles);
    assert!(z > LARGEST_Z, "{what}");
}

#[test]
fn draws_are_bit_identical_for_any_number_of_threads() {
    let model = model(&Counts, "beats", 8);
    let starts = jittered_starts(&model, &model.initial(), 4, 1).unwrap();
    let run = |threads| {
        let settings = Settings { threads, warmup: 100, ..settings(50) };
        let chains = Sampler::Blocked.sample(&model, &starts, &settings, &Silent).unwrap();
        chains.into_iter().map(|chain| format!("{:?}", chain.unwrap().draws)).collect::<Vec<_>>()
    };
    let one = run(1);
    assert_eq!(one, run(3));
    assert!(one[0] != one[1]);
}

#[test]
fn the_log_density_recorded_is_the_models_own() {
    let model = model(&Counts, "beats", 8);
    let chain = &blocked(&model, Fault::None, 20)[0];
    let mut evaluator = model.evaluator();
    for i in 0..20 {
        let value = evaluator.ln_density(&chain.draw(i).unwrap(), &mut vec![0.0; model.dim()]);
        assert!((value - chain.ln_density[i]).abs() < 1e-12 * value.abs());
    }
}
