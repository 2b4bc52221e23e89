//! Runs that are interrupted anywhere go on to the same draws, to the bit.
#![allow(clippy::unwrap_used, reason = "a test")]

#[path = "models/language.rs"]
#[allow(dead_code, reason = "one of its models is sampled here")]
mod language;
#[path = "models/normal_fields.rs"]
#[allow(dead_code, reason = "one of its models is sampled here")]
mod normal_fields;
#[path = "support/posterior.rs"]
mod posterior;
mod support;

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use eplat::experiment::thinned;
use eplat::infer::{
    Chain, ChainFailure, ChainProgress, ChainResult, LogDensity as _, MetricKind, Progress,
    Settings, Silent, jittered_starts,
};
use eplat::model::{Model, Sampler};
use eplat::store::{Checkpoint, CheckpointError, Identity, Spool};
use eplat::table::Measurements;
use posterior::shipped::shipped;
use posterior::{all, erp_experiment};

fn settings() -> Settings {
    Settings { chains: 3, warmup: 60, draws: 40, threads: 2, ..Settings::default() }
}

fn identity() -> Identity {
    BTreeMap::from([("seed".into(), "1".into())])
}

/// Stops all chains when a transition has been asked for this many times.
struct Cut {
    checkpoint: Checkpoint,
    left: AtomicUsize,
}

impl Progress for Cut {
    fn report(&self, _: &ChainProgress) {}
    fn should_stop(&self) -> bool {
        let ask = |n: usize| n.checked_sub(1);
        self.left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, ask).is_err()
    }
    fn is_enough(&self, chains: &[&Chain]) -> bool {
        is_enough(chains)
    }
    fn checkpoint(&self) -> Option<&Checkpoint> {
        Some(&self.checkpoint)
    }
}

/// Something that depends on the draws.
fn is_enough(chains: &[&Chain]) -> bool {
    let ln_density: f64 = chains.iter().flat_map(|chain| &chain.ln_density).sum();
    chains[0].n_draws() >= 50 && ln_density.rem_euclid(1.0) > 0.5
}

/// Only ends a run that has enough.
struct Enough;

impl Progress for Enough {
    fn report(&self, _: &ChainProgress) {}
    fn is_enough(&self, chains: &[&Chain]) -> bool {
        is_enough(chains)
    }
}

/// Copies the checkpoint at one transition: what a loss of power there leaves.
struct Loss<'a> {
    checkpoint: Checkpoint,
    left: AtomicUsize,
    from: &'a Path,
    to: &'a Path,
}

impl Progress for Loss<'_> {
    fn report(&self, _: &ChainProgress) {}
    fn should_stop(&self) -> bool {
        if self.left.fetch_sub(1, Ordering::Relaxed) == 1 {
            fs::create_dir_all(self.to).unwrap();
            for entry in fs::read_dir(self.from).unwrap().flatten() {
                // a temporary file may be gone by now
                let _ = fs::copy(entry.path(), self.to.join(entry.file_name()));
            }
        }
        false
    }
    fn checkpoint(&self) -> Option<&Checkpoint> {
        Some(&self.checkpoint)
    }
}

/// A model with all that is needed to sample it.
struct Job {
    model: Model,
    sampler: Sampler,
    starts: Vec<Vec<f64>>,
    settings: Settings,
}

impl Job {
    fn new(model: Model, sampler: Sampler, settings: Settings) -> Self {
        let Settings { chains, seed, .. } = settings;
        let starts = jittered_starts(&model, &model.initial(), chains, seed).unwrap();
        Self { model, sampler, starts, settings }
    }

    fn sample(&self, progress: &dyn Progress) -> Vec<ChainResult> {
        self.sampler.sample(&self.model, &self.starts, &self.settings, progress).unwrap()
    }

    fn whole(&self) -> String {
        numbers(all(self.sample(&Silent)))
    }

    /// Stops after so many transitions, goes on, stops again …, until nothing is left to do.
    fn in_pieces(&self, every: &[usize]) -> String {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("checkpoint");
        let long = Duration::from_hours(1);
        let mut checkpoint = Checkpoint::begin(&folder, &identity(), long).unwrap();
        for transitions in every.iter().cycle() {
            let cut = Cut { checkpoint, left: (*transitions).into() };
            let results = self.sample(&cut);
            let stopped = |r: &ChainResult| {
                r.as_ref().is_err_and(|error| error.failure == ChainFailure::Stopped)
            };
            if !results.iter().any(stopped) {
                return numbers(all(results));
            }
            checkpoint = Checkpoint::resume(&folder, &identity(), long).unwrap();
            assert!(checkpoint.has_states());
        }
        unreachable!()
    }

    /// Goes on from what was on the disk when a run with frequent savings was this far.
    fn after_loss(&self, transitions: usize) -> String {
        let place = tempfile::tempdir().unwrap();
        let [from, to] = ["checkpoint", "copy"].map(|name| place.path().join(name));
        let checkpoint = Checkpoint::begin(&from, &identity(), Duration::ZERO).unwrap();
        let loss = Loss { checkpoint, left: transitions.into(), from: &from, to: &to };
        self.sample(&loss);
        let checkpoint = Checkpoint::resume(&to, &identity(), Duration::ZERO).unwrap();
        numbers(all(self.sample(&Cut { checkpoint, left: usize::MAX.into() })))
    }
}

/// Everything about chains but times, and where their draws are; floating-point numbers print so that their bits come
/// back.
fn numbers(chains: Vec<Chain>) -> String {
    let draws = thinned(&chains, usize::MAX).unwrap();
    let (seconds_warmup, seconds_sampling) = (0.0, 0.0);
    let rest = |chain| Chain { draws: Spool::default(), seconds_warmup, seconds_sampling, ..chain };
    format!("{draws:?} {:?}", chains.into_iter().map(rest).collect::<Vec<_>>())
}

fn erp_model(n_sites: usize) -> Model {
    let (basis, measurements) = erp_experiment(n_sites);
    Model::new(shipped("erp"), Some(&basis), &measurements).unwrap()
}

fn check(job: &Job) {
    let whole = job.whole();
    let every = [37, 1, 5, 111];
    assert!(job.in_pieces(&every) == whole, "in pieces of {every:?}");
    for transitions in [20, 130, 190, 299] {
        assert!(job.after_loss(transitions) == whole, "after a loss at {transitions}");
    }
}

#[test]
fn nuts() {
    check(&Job::new(erp_model(10), Sampler::Nuts, settings()));
}

#[test]
fn nuts_with_a_diagonal_metric() {
    let settings = Settings { metric: MetricKind::Diagonal, warmup: 150, draws: 10, ..settings() };
    check(&Job::new(erp_model(10), Sampler::Nuts, settings));
}

#[test]
fn blocked_with_fewer_sites_than_modes() {
    check(&Job::new(erp_model(10), Sampler::Blocked, settings()));
}

#[test]
fn blocked_with_fewer_modes_than_sites() {
    check(&Job::new(erp_model(40), Sampler::Blocked, settings()));
}

#[test]
fn integrated() {
    let basis = support::basis(60, 24);
    let rows = support::numbers_on(&basis, &["direct"]);
    let model = Model::new(&normal_fields::one_noise::OneNoise, Some(&basis), &rows).unwrap();
    check(&Job::new(model, Sampler::Integrated, settings()));
}

#[test]
fn blocked_with_unknowns_beside_the_fields() {
    let basis = support::basis(200, 24);
    let model = Model::new(&language::mixed::Mixed, Some(&basis), &support::mixed_rows()).unwrap();
    check(&Job::new(model, Sampler::Blocked, settings()));
}

mod wide {
    use eplat::prelude::*;
    model! {
        /// A block of draws is soon full.
        model Wide;
        param x(400) ~ Normal(0.0, 1.0);
    }
}

/// Most draws are in a file of their own: there is a block of them in it when the run is cut.
#[test]
fn draws_that_fill_blocks() {
    let basis = support::basis(60, 24);
    let rows = support::numbers_on(&basis, &["direct"]);
    let normal = Model::new(&normal_fields::one_noise::OneNoise, Some(&basis), &rows).unwrap();
    let wide = Model::new(&wide::Wide, None, &Measurements::default()).unwrap();
    let jobs =
        [(erp_model(10), Sampler::Blocked), (normal, Sampler::Integrated), (wide, Sampler::Nuts)];
    for (model, sampler) in jobs {
        let draws = Spool::rows_of_block(model.dim()) + 200;
        let settings = Settings { chains: 1, warmup: 60, draws, ..settings() };
        let job = Job::new(model, sampler, settings);
        let whole = job.whole();
        // before the block is full, twice after that, and to the end
        let every = [draws - 250, 150, 150, 300];
        assert!(job.in_pieces(&every) == whole, "{sampler:?} in pieces of {every:?}");
        assert!(job.after_loss(60 + draws - 50) == whole, "{sampler:?} after a loss");
    }
}

/// A block is in the file when the run is cut, and the state, which is older, does not tell of it: it is written again
/// where it was, and the next one after it.
#[test]
fn a_block_that_the_state_does_not_tell_of_is_written_again() {
    let wide = Model::new(&wide::Wide, None, &Measurements::default()).unwrap();
    let block = Spool::rows_of_block(wide.dim());
    let settings = Settings { chains: 1, warmup: 60, draws: 2 * block + 20, ..settings() };
    let job = Job::new(wide, Sampler::Nuts, settings);
    let whole = job.whole();
    for transitions in 60 + block - 1..60 + block + 3 {
        assert!(job.after_loss(transitions) == whole, "after a loss at {transitions}");
    }
}

#[test]
fn draws_that_are_not_those_of_the_state_are_refused() {
    let job = Job::new(erp_model(10), Sampler::Blocked, settings());
    let draws = Spool::rows_of_block(job.model.dim()) + 50;
    let job = Job { settings: Settings { draws, threads: 1, ..job.settings }, ..job };
    let place = tempfile::tempdir().unwrap();
    let folder = place.path().join("checkpoint");
    let long = Duration::from_hours(1);
    let checkpoint = Checkpoint::begin(&folder, &identity(), long).unwrap();
    job.sample(&Cut { checkpoint, left: (3 * 60 + draws - 10).into() });
    let path = folder.join("draws-0");
    let bytes = fs::read(&path).unwrap();
    let resumed = || {
        let checkpoint = Checkpoint::resume(&folder, &identity(), long).unwrap();
        let cut = Cut { checkpoint, left: 0.into() };
        job.sampler.sample(&job.model, &job.starts, &job.settings, &cut).map(|_| ())
    };
    for at in [8, bytes.len() / 2, bytes.len() - 1] {
        let mut flipped = bytes.clone();
        flipped[at] ^= 16;
        fs::write(&path, flipped).unwrap();
        let refused = resumed().unwrap_err().to_string();
        assert!(refused.contains("draws-0: it does not hold the draws that chain-0 tells of"));
        fs::write(&path, &bytes[..at]).unwrap();
        assert!(resumed().is_err());
    }
    fs::write(&path, &bytes).unwrap();
    resumed().unwrap();
}

/// A chain that is through a stage of warm-up when another is stopped in it must not go on into the
/// next: what it kept there would be taken for real once that stage has come.
#[test]
fn chains_stopped_in_a_stage_that_others_are_through_go_on_together() {
    let job = Job::new(erp_model(10), Sampler::Blocked, Settings { threads: 1, ..settings() });
    let place = tempfile::tempdir().unwrap();
    let folder = place.path().join("checkpoint");
    let long = Duration::from_hours(1);
    let checkpoint = Checkpoint::begin(&folder, &identity(), long).unwrap();
    // one chain after the other; the last stage of warm-up is transitions 37 to 60 of each
    job.sample(&Cut { checkpoint, left: (3 * 36 + 2 * 24 + 10).into() });
    // then all through that stage, and the first two through their draws, which nothing keeps
    let checkpoint = Checkpoint::resume(&folder, &identity(), long).unwrap();
    job.sample(&Cut { checkpoint, left: (2 * 24 + 14 + 2 * 40 + 10).into() });
    let checkpoint = Checkpoint::resume(&folder, &identity(), long).unwrap();
    let end = job.sample(&Cut { checkpoint, left: usize::MAX.into() });
    assert!(numbers(all(end)) == job.whole());
}

#[test]
fn a_run_that_ends_with_enough_draws_ends_there_in_pieces() {
    let longest = Settings { draws: 100, enough_after: Some(10), ..settings() };
    let threads_1 = Settings { threads: 1, ..longest.clone() };
    for settings in [longest, threads_1] {
        let job = Job::new(erp_model(10), Sampler::Blocked, settings);
        let whole = all(job.sample(&Enough));
        let n_draws = whole[0].n_draws();
        assert!(
            (60..100).contains(&n_draws) && whole.iter().all(|chain| chain.n_draws() == n_draws),
            "{n_draws}"
        );
        let whole = numbers(whole);
        for every in [&[50, 90, 17][..], &[191, 10]] {
            assert!(job.in_pieces(every) == whole, "in pieces of {every:?}");
        }
    }
}

/// What is read is what the chain goes on from: with another chain's state the draws are others.
#[test]
fn a_chain_goes_on_from_its_state() {
    let job = Job::new(erp_model(10), Sampler::Blocked, settings());
    let place = tempfile::tempdir().unwrap();
    let folder = place.path().join("checkpoint");
    let long = Duration::from_hours(1);
    let checkpoint = Checkpoint::begin(&folder, &identity(), long).unwrap();
    // warm-up takes 180
    job.sample(&Cut { checkpoint, left: 190.into() });
    let states = [0, 1, 2].map(|chain| folder.join(format!("chain-{chain}")));
    fs::copy(&states[1], &states[2]).unwrap();
    let checkpoint = Checkpoint::resume(&folder, &identity(), long).unwrap();
    let mixed = numbers(all(job.sample(&Cut { checkpoint, left: usize::MAX.into() })));
    assert!(mixed != job.whole());
}

#[test]
fn what_is_no_state_of_this_run_is_refused() {
    let job = Job::new(erp_model(10), Sampler::Nuts, settings());
    let place = tempfile::tempdir().unwrap();
    let folder = place.path().join("checkpoint");
    let long = Duration::from_hours(1);
    let begin = |identity| Checkpoint::begin(&folder, &identity, long);
    let resume = |identity| Checkpoint::resume(&folder, &identity, long);
    let of = |seed: &str| BTreeMap::from([("seed".to_owned(), seed.to_owned())]);
    assert!(matches!(resume(of("1")), Err(CheckpointError::Nothing { .. })));
    job.sample(&Cut { checkpoint: begin(of("1")).unwrap(), left: 100.into() });

    assert!(matches!(begin(of("1")), Err(CheckpointError::Occupied { .. })));
    let Err(CheckpointError::Differs { differences, .. }) = resume(of("2")) else { panic!() };
    assert_eq!(differences, ["seed is 1 there, 2 here"]);

    let path = folder.join("chain-0");
    let state = fs::read(&path).unwrap();
    let refused = |bytes: &[u8]| {
        fs::write(&path, bytes).unwrap();
        let error = resume(of("1")).unwrap_err();
        assert!(matches!(error, CheckpointError::Damaged { .. }), "{error}");
        error.to_string()
    };
    for length in [0, 7, 40, state.len() / 2, state.len() - 1] {
        assert!(refused(&state[..length]).contains("chain-0: "));
    }
    for at in [0, 9, 60, state.len() / 2, state.len() - 1] {
        let mut flipped = state.clone();
        flipped[at] ^= 16;
        refused(&flipped);
    }
    fs::write(&path, &state).unwrap();
    resume(of("1")).unwrap();

    // the whole and sound state of a run with another seed
    fs::rename(&folder, place.path().join("old")).unwrap();
    job.sample(&Cut { checkpoint: begin(of("2")).unwrap(), left: 100.into() });
    let foreign = fs::read(&path).unwrap();
    fs::remove_dir_all(&folder).unwrap();
    fs::rename(place.path().join("old"), &folder).unwrap();
    assert!(refused(&foreign).contains("the state is of another run"));
}
