use super::super::density::Evaluator;
use super::super::progress::{ChainProgress, Phase, Silent};
use super::super::test_densities::{FnDensity, funnel, normal};
use super::super::{Chain, ChainFailure, MarkovChain};
use super::*;
use std::sync::atomic::{AtomicUsize, Ordering::SeqCst};
use std::sync::{Mutex, RwLock};
use std::thread::sleep;
use std::time::Duration;

fn settings() -> Settings {
    Settings { chains: 3, warmup: 200, draws: 100, seed: 11, ..Settings::default() }
}

#[test]
fn bad_settings_are_named_with_a_remedy() {
    let density = normal(vec![1.0; 2]);
    let text = |settings: Settings, starts: &[Vec<f64>]| {
        let error = sample(&density, starts, &settings, &Silent).unwrap_err().to_string();
        assert!(error.lines().last().unwrap().starts_with("help: "), "{error}");
        error
    };
    let base = Settings::default;
    assert!(text(Settings { chains: 0, ..base() }, &[]).contains("`chains`"));
    assert!(text(Settings { draws: 0, ..base() }, &[]).contains("`draws`"));
    assert!(text(Settings { warmup: 3, ..base() }, &[]).contains("`warmup`"));
    for target in [0.0, 1.0, -0.5, f64::NAN] {
        let target_accept = Some(target);
        assert!(text(Settings { target_accept, ..base() }, &[]).contains("between 0 and 1"));
    }
    assert!(text(Settings { max_depth: 0, ..base() }, &[]).contains("`max_depth`"));
    assert!(text(base(), &[vec![0.0; 2]]).contains("expected 4"));
    let starts = [vec![0.0; 2], vec![0.0; 2], vec![0.0; 3], vec![0.0; 2]];
    assert!(text(base(), &starts).contains("chain 3"));
    let empty = normal(Vec::new());
    let error = sample(&empty, &[], &base(), &Silent).unwrap_err();
    assert!(matches!(error, InferError::NoUnknowns));
}

#[test]
fn a_chain_that_is_stepped_draws_what_a_run_draws() {
    let settings = Settings { chains: 1, ..settings() };
    let density = funnel(5);
    let run = sample(&density, &[vec![0.1; 5]], &settings, &Silent).unwrap().remove(0).unwrap();
    let mut chain = Nuts::new(&density, &[0.1; 5], &settings).unwrap();
    let mut n = 0;
    while chain.adapt().unwrap().is_some() {
        n += 1;
    }
    assert!(n <= settings.warmup && chain.phase() == Phase::Sampling);
    for i in 0..settings.draws {
        let draw = chain.draw().unwrap();
        assert_eq!((draw.position, draw.ln_density), (&*run.draw(i).unwrap(), run.ln_density[i]));
        assert_eq!(draw.divergence.is_some(), run.diverging[i]);
    }
    assert_eq!(chain.n_evaluations(), [run.n_grad_warmup, run.n_grad_sampling]);
    assert!(chain.step_size().to_bits() == run.step_size.to_bits());
}

#[test]
fn draws_are_bit_identical_for_any_number_of_threads() {
    let starts = vec![vec![0.1; 5]; 3];
    let run = |threads| {
        let settings = Settings { threads, ..settings() };
        let chains = sample(&funnel(5), &starts, &settings, &Silent).unwrap();
        chains.into_iter().map(|chain| format!("{:?}", chain.unwrap().draws)).collect::<Vec<_>>()
    };
    let one = run(1);
    assert_eq!(one, run(3));
    assert!(one[0] != one[1]);
}

#[test]
fn a_thread_of_another_pool_ends_one_fit_before_it_begins_the_next() {
    let settings = Settings { threads: 1, ..settings() };
    let (under_way, most) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let fit = |_| {
        most.fetch_max(under_way.fetch_add(1, SeqCst) + 1, SeqCst);
        settings.on_threads(|| sleep(Duration::from_millis(2))).unwrap();
        under_way.fetch_sub(1, SeqCst);
    };
    let study = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    study.install(|| (0..8).into_par_iter().for_each(fit));
    assert_eq!(most.into_inner(), 1);
}

#[test]
fn one_failing_chain_leaves_the_others() {
    let starts = vec![vec![0.1; 2], vec![f64::INFINITY, 0.0], vec![0.2; 2]];
    let chains = sample(&normal(vec![1.0; 2]), &starts, &settings(), &Silent).unwrap();
    assert!(chains[0].is_ok() && chains[2].is_ok());
    let error = chains[1].as_ref().unwrap_err();
    assert_eq!((error.chain, error.seed, error.failure.clone()), (1, 11, ChainFailure::NoSupport));
    assert!(error.to_string().starts_with("chain 2 (seed 11), warm-up iteration 0: "));
}

#[test]
fn a_start_that_cannot_move_fails_for_want_of_a_step_size() {
    // Finite at the start only.
    let f = |q: &[f64], g: &mut [f64]| {
        g[0] = 1.0;
        if q[0].abs() > 0.0 { f64::NEG_INFINITY } else { 0.0 }
    };
    let density = FnDensity { dim: 1, f };
    let settings = Settings { chains: 1, ..settings() };
    let chains = sample(&density, &[vec![0.0]], &settings, &Silent).unwrap();
    assert_eq!(chains[0].as_ref().unwrap_err().failure, ChainFailure::NoStepSize);
}

#[test]
fn divergences_are_kept_with_both_ends() {
    // A normal cut off at −0.5: trajectories run into the wall.
    let wall = FnDensity {
        dim: 2,
        f: |q: &[f64], g: &mut [f64]| {
            g[0] = -q[0];
            g[1] = -q[1];
            if q[0] < -0.5 { f64::NEG_INFINITY } else { -0.5 * (q[0] * q[0] + q[1] * q[1]) }
        },
    };
    let starts = vec![vec![0.1; 2]; 3];
    let chains = sample(&wall, &starts, &settings(), &Silent).unwrap();
    let mut n = 0;
    for chain in chains.into_iter().map(Result::unwrap) {
        assert_eq!(chain.divergences.len(), chain.diverging.iter().filter(|d| **d).count());
        for divergence in &chain.divergences {
            let i = divergence.iteration;
            assert!(chain.diverging[i]);
            assert!(i == 0 || divergence.start == *chain.draw(i - 1).unwrap());
            assert!(divergence.start[0] >= -0.5 && divergence.end[0] < -0.5);
        }
        n += chain.divergences.len();
    }
    assert!(n > 10, "the wall must be seen: {n}");
}

#[derive(Default)]
struct Recorder {
    seen: Mutex<Vec<ChainProgress>>,
    stop_at_end_of_warmup: bool,
}

impl Progress for Recorder {
    fn report(&self, progress: &ChainProgress) {
        self.seen.lock().unwrap().push(*progress);
    }
    fn should_stop(&self) -> bool {
        self.stop_at_end_of_warmup && !self.seen.lock().unwrap().is_empty()
    }
}

#[test]
fn progress_is_reported_per_chain_and_can_stop_the_run() {
    let density = normal(vec![1.0; 2]);
    let starts = vec![vec![0.1; 2]; 3];
    let recorder = Recorder::default();
    sample(&density, &starts, &settings(), &recorder).unwrap();
    for chain in 0..3 {
        let seen = recorder.seen.lock().unwrap();
        let of_chain: Vec<_> = seen.iter().filter(|p| p.chain == chain).collect();
        let last = of_chain.last().unwrap();
        assert_eq!((last.iteration, last.total, last.phase), (300, 300, Phase::Sampling));
        assert!(of_chain.iter().any(|p| p.phase == Phase::Warmup));
    }
    let stopper = Recorder { stop_at_end_of_warmup: true, ..Recorder::default() };
    let settings = Settings { threads: 1, ..settings() };
    let chains = sample(&density, &starts, &settings, &stopper).unwrap();
    for chain in chains {
        assert_eq!(chain.unwrap_err().failure, ChainFailure::Stopped);
    }
}

/// Has enough at so many draws; keeps when it was asked.
struct EnoughAt {
    n: usize,
    asked: Mutex<Vec<usize>>,
}

impl Progress for EnoughAt {
    fn report(&self, _: &ChainProgress) {}
    fn is_enough(&self, chains: &[&Chain]) -> bool {
        assert!(chains.iter().all(|chain| chain.n_draws() == chains[0].n_draws()));
        self.asked.lock().unwrap().push(chains[0].n_draws());
        chains[0].n_draws() >= self.n
    }
}

#[test]
fn a_run_ends_after_the_first_round_with_enough_draws() {
    let (density, starts) = (funnel(5), vec![vec![0.1; 5]; 3]);
    let draws_of = |chain: ChainResult| {
        let chain = chain.unwrap();
        (0..chain.n_draws()).map(|i| chain.draw(i).unwrap().into_owned()).collect::<Vec<_>>()
    };
    let whole = sample(&density, &starts, &settings(), &Silent).unwrap();
    let whole: Vec<_> = whole.into_iter().map(draws_of).collect();
    let cases = [
        (25, 60, 75, vec![25, 50, 75]),
        (25, 100, 100, vec![25, 50, 75]),
        (30, 1000, 100, vec![30, 60, 90]),
        (200, 0, 100, vec![]),
    ];
    for (round, n, drawn, expected) in cases {
        let watch = EnoughAt { n, asked: Mutex::default() };
        let settings = Settings { enough_after: Some(round), ..settings() };
        let chains = sample(&density, &starts, &settings, &watch).unwrap();
        for (chain, whole) in chains.into_iter().map(draws_of).zip(&whole) {
            assert_eq!(chain, whole[..drawn]);
        }
        assert_eq!(watch.asked.into_inner().unwrap(), expected);
    }
    // nobody is asked where nobody says so
    let watch = EnoughAt { n: 0, asked: Mutex::default() };
    sample(&density, &starts, &settings(), &watch).unwrap();
    assert!(watch.asked.into_inner().unwrap().is_empty());
}

#[test]
fn counters_add_up_and_adaptation_reaches_its_targets() {
    let sd = vec![1e-3, 1.0, 1e3];
    let density = normal(sd.clone());
    let settings = Settings { warmup: 500, draws: 500, ..settings() };
    let starts = vec![vec![1e-3; 3]; 3];
    for chain in sample(&density, &starts, &settings, &Silent).unwrap() {
        let chain = chain.unwrap();
        let leapfrogs: u64 = chain.n_leapfrog.iter().map(|&n| u64::from(n)).sum();
        assert_eq!(chain.n_grad_sampling, leapfrogs);
        assert_eq!([chain.draws.n_rows(), chain.draws.width()], [500, 3]);
        let accept = chain.accept.iter().sum::<f64>() / 500.0;
        assert!((accept - 0.8).abs() < 0.03, "{accept}");
    }
}

/// A standard normal about 0, and about 3 once it is told of draws. It keeps what it was told.
#[derive(Default)]
struct Nearing {
    told: RwLock<Vec<Vec<Vec<f64>>>>,
}

struct About(f64);

impl LogDensity for Nearing {
    fn dim(&self) -> usize {
        1
    }
    fn evaluator(&self) -> Box<dyn Evaluator + '_> {
        Box::new(About(if self.told.read().unwrap().is_empty() { 0.0 } else { 3.0 }))
    }
    fn draw_near(&self, draws: &[Vec<f64>]) -> bool {
        self.told.write().unwrap().push(draws.to_vec());
        true
    }
}

impl Evaluator for About {
    fn ln_density(&mut self, q: &[f64], g: &mut [f64]) -> f64 {
        g[0] = self.0 - q[0];
        -0.5 * g[0] * g[0]
    }
}

#[test]
fn a_density_is_told_twice_where_the_chains_are_and_they_go_on_under_what_it_becomes() {
    let density = Nearing::default();
    let chains = sample(&density, &[vec![0.0], vec![0.1], vec![-0.1]], &settings(), &Silent);
    let told = density.told.into_inner().unwrap();
    assert_eq!(told.iter().map(Vec::len).collect::<Vec<_>>(), [12, 12]);
    let mean = |draws: &[Vec<f64>]| draws.iter().flatten().sum::<f64>() / draws.len() as f64;
    // twelve draws, nearly independent: four standard errors are 1.2
    assert!(mean(&told[0]).abs() < 1.2 && (mean(&told[1]) - 3.0).abs() < 1.2, "{told:?}");
    for chain in chains.unwrap() {
        let chain = chain.unwrap();
        let draws: Vec<Vec<f64>> = (0..100).map(|i| chain.draw(i).unwrap().into_owned()).collect();
        assert!((mean(&draws) - 3.0).abs() < 0.6, "{}", mean(&draws));
        // what is kept with a draw is of the same density
        for (draw, ln_density) in draws.iter().zip(&chain.ln_density) {
            assert!((-0.5 * (draw[0] - 3.0).powi(2) - ln_density).abs() < 1e-12);
        }
    }
}
