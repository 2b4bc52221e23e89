//! How often `criticise` is right, on studies of known truth.
//!
//! ```sh
//! cargo test --release --test loop_rates -- --ignored --nocapture
//! ```
//! `SCENARIO=force,null`, `SEEDS=20` (or `SEEDS=21..60`) and `NULLS=99` run a part of it. A bar fails where the
//! count has a probability below 5 % under it; the table shows the counts themselves.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "for tests")]

#[path = "support/skipped.rs"]
mod skipped;

#[path = "support/shipped.rs"]
mod shipped;
#[path = "support/studies.rs"]
mod studies;

use std::fmt::Write as _;
use std::ops::ControlFlow;
use std::ops::RangeInclusive;
use std::path::Path;

use eplat::criticism::{
    CLAIM, Criticism, Engine, Outer, SearchSettings, Subject, TriedTerm, criticise, leave_out,
    with_heldout,
};
use eplat::manifold::{Basis, eigenpairs_cached};
use eplat::model::{Form, Model};
use eplat::table::Measurements;
use rayon::prelude::*;
use shipped::shipped;
use studies::{ALL, Heart, Scenario, Study, study};

/// What a search came to.
#[derive(Clone, Debug, Default)]
struct Result {
    seed: u64,
    findings: Vec<String>,
    ambiguous: Vec<[String; 2]>,
    unexplained: bool,
    /// Held-out root mean squared error and log score, before and after; if anything was found.
    rmse: Option<[f64; 2]>,
    elpd: Option<[f64; 2]>,
    /// Share of held-out rows in their 90 % intervals, before and after.
    coverage: Option<[f64; 2]>,
    note: String,
}

/// What is right, and what else is no wrong name.
fn expected(scenario: Scenario) -> (&'static [&'static str], &'static [&'static str]) {
    match scenario {
        Scenario::Force | Scenario::Missing | Scenario::Interaction => (&["force_g"], &[]),
        Scenario::Catheter => (&["catheter"], &[]),
        Scenario::Drift => (&["t_min"], &[]),
        Scenario::Rate => (&["S1"], &[]),
        Scenario::Output => (&["output_mA"], &[]),
        Scenario::Wall => (&["wall_mm"], &[]),
        Scenario::Outliers => (&["outliers"], &[]),
        Scenario::Region => (&["region"], &[]),
        Scenario::Patch => (&["patch"], &["dist_scar_mm"]),
        Scenario::Two | Scenario::TwoLarge => (&["force_g", "catheter"], &[]),
        Scenario::TwoLevels => (&["region", "force_g"], &[]),
        Scenario::Hetero => (&["hetero(force_g)"], &[]),
        Scenario::HeteroCatheter => (&["hetero(catheter)"], &[]),
        Scenario::Cancel => (&[], &["force_g", "output_mA"]),
        Scenario::Misscaled => (&[], &["force_g"]),
        Scenario::Decoys => (&[], &["session"]),
        Scenario::Null
        | Scenario::Confounded
        | Scenario::ConfoundedRegion
        | Scenario::Outside
        | Scenario::Repeated
        | Scenario::Third => (&[], &[]),
    }
}

/// The causes that cannot be told apart.
fn pair(scenario: Scenario) -> Option<[&'static str; 2]> {
    match scenario {
        Scenario::Confounded => Some(["catheter", "operator"]),
        Scenario::ConfoundedRegion => Some(["catheter", "region"]),
        _ => None,
    }
}

impl Result {
    fn is_right(&self, scenario: Scenario) -> bool {
        if let Some(pair) = pair(scenario) {
            let names = |p: &[String; 2]| pair.iter().all(|name| p.iter().any(|n| n == name));
            return self.findings.is_empty() && self.ambiguous.iter().any(names);
        }
        match scenario {
            Scenario::Null | Scenario::Repeated => self.findings.is_empty() && !self.unexplained,
            Scenario::Outside => self.findings.is_empty() && self.unexplained,
            Scenario::Two | Scenario::TwoLarge | Scenario::TwoLevels => {
                expected(scenario).0.iter().all(|name| self.findings.iter().any(|n| n == name))
            }
            // of a force that acts in one region, to name both and claim neither is honest
            Scenario::Interaction if self.findings.is_empty() => {
                self.ambiguous.iter().flatten().any(|name| name == "force_g")
            }
            Scenario::Cancel | Scenario::Misscaled | Scenario::Decoys => !self.is_wrong(scenario),
            _ => self.findings.first().is_some_and(|name| expected(scenario).0[0] == name),
        }
    }

    /// Whether something is claimed that does not act.
    fn is_wrong(&self, scenario: Scenario) -> bool {
        let (right, allowed) = expected(scenario);
        let is_fine = |name: &String| right.iter().chain(allowed).any(|n| n == name);
        !self.findings.iter().all(is_fine)
    }

    fn is_better(&self, scenario: Scenario) -> bool {
        use Scenario::{Hetero, HeteroCatheter, Outliers};
        if matches!(scenario, Outliers | Hetero | HeteroCatheter) {
            return self.elpd.is_some_and(|[before, after]| after > before);
        }
        self.rmse.is_some_and(|[before, after]| after < before)
    }
}

fn searched(heart: &Heart, scenario: Scenario, seed: u64, nulls: usize) -> Result {
    let Study { train, heldout, .. } = study(heart, scenario, seed);
    search_of([&train, &heldout], &heart.basis, seed, nulls)
}

/// The search of the first of two tables, and what it predicts of the second.
fn search_of(tables: [&Measurements; 2], basis: &Basis, seed: u64, nulls: usize) -> Result {
    let case = Subject { model: shipped("erp"), basis: Some(basis), table: tables[0] };
    let search = |nulls: usize| {
        let settings = SearchSettings { nulls, ..SearchSettings::default() };
        criticise(&case, &settings, &|_| ControlFlow::Continue(())).unwrap()
    };
    // without enough evidence there is no claim, whatever the null searches come to
    let outcome = Some(search(0))
        .filter(|quick| quick.rounds[0].best() <= CLAIM)
        .unwrap_or_else(|| search(nulls));
    let scores = (!outcome.found().is_empty()).then(|| {
        [(&outcome.rounds[0].base.outer, &[][..]), (&outcome.last.outer, &outcome.found()[..])]
            .map(|(outer, found)| heldout(&case, tables[1], &outcome, outer, found))
    });
    Result {
        seed,
        findings: outcome.findings().into_iter().map(ToString::to_string).collect(),
        ambiguous: outcome.ambiguous().into_iter().map(|p| p.map(ToString::to_string)).collect(),
        unexplained: outcome.is_unexplained(),
        rmse: scores.map(|s| s.map(|[rmse, ..]| rmse)),
        elpd: scores.map(|s| s.map(|[_, elpd, _]| elpd)),
        coverage: scores.map(|s| s.map(|[.., coverage]| coverage)),
        note: note(&outcome),
    }
}

/// What stands behind a result, in a line.
fn note(outcome: &Criticism) -> String {
    let text = |form: Option<&Form>| form.map_or("outliers".into(), Form::text);
    let mut note =
        format!("site {:.1} of sd {:.1}", outcome.site_log_bf, outcome.last.outer.ln_site.exp());
    if let Some(finer) = outcome.finer_log_bf {
        let _ = write!(note, ", finer {finer:.1}");
    }
    for round in &outcome.rounds {
        for c in round.claimed.iter().map(|c| &outcome.candidates[*c]) {
            let _ = write!(note, " [{} on {}]", text(c.form.as_ref()), c.on.join("+"));
        }
        let bar = round.nulls.get((0.95 * round.nulls.len() as f64) as usize);
        let _ = write!(note, " | null95 {:.1};", bar.copied().unwrap_or(f64::NAN));
        if let Some(([a, b], log_bf)) = round.pair {
            let [a, b] = [a, b].map(|c| &outcome.candidates[c].cause);
            let _ = write!(note, " {a} and {b} {log_bf:.1};");
        }
        for t in round.tried.iter().take(3) {
            let c = &outcome.candidates[t.candidate];
            let form = text(t.form.as_ref());
            let form = form.split('(').next().unwrap_or_default();
            let on = c.on.join("+");
            let _ = write!(note, " {} {form} {on} {:.1} ({});", c.cause, t.log_bf, t.judgement);
        }
    }
    note
}

/// Root mean squared error of the bracket's middle, log score, and share in their 90 % intervals of held-out rows, by
/// the Laplace fit of the training rows.
fn heldout(
    case: &Subject<'_>,
    held: &Measurements,
    outcome: &Criticism,
    outer: &Outer,
    found: &[usize],
) -> [f64; 3] {
    let mut joint = with_heldout(case.table, held, &["s1s2", "s1s2s3"]);
    let basis = case.basis.unwrap();
    joint.place_at_indices(basis.n_vertices()).unwrap();
    let on = ["erp_s2", "erp_s3"].map(String::from).to_vec();
    let all = [on.clone(), vec!["tau_out".into(), "apd_max".into()]].concat();
    let model = Model::with_offsets(case.model, case.basis, &joint, &all).unwrap();
    let term = |f: &usize| {
        let c = &outcome.candidates[*f];
        let design = |form: &Form| form.design(&joint);
        let (design, n) = c.form.as_ref().map_or((vec![], 0), design);
        TriedTerm { on: c.on.clone(), design, n, sd: Some(c.sd) }
    };
    let first = case.table.len();
    let site = |row: usize| {
        let number: usize = joint.cell(row, "site").unwrap().parse().unwrap();
        number + if row < first { 0 } else { first }
    };
    let sites: Vec<usize> = (0..joint.len()).map(site).collect();
    let engine = Engine::new(model, &on, &sites, &[], found.iter().map(term).collect());
    let hidden: Vec<usize> =
        (0..engine.rows.len()).filter(|r| engine.table_row(*r) >= first).collect();
    let active: Vec<usize> = (0..found.len()).collect();
    let fit = engine.fit_without(&hidden, outer, &active, None).unwrap();
    let left = leave_out(&engine, &fit, &hidden, 1);
    let (mut square, mut inside) = (0.0, 0.0);
    for r in &hidden {
        square += (left.predicted[*r] - engine.middle(*r)).powi(2);
        inside += f64::from(u8::from(left.residual[*r].abs() < SCORE_90));
    }
    let n = hidden.len() as f64;
    [(square / n).sqrt(), left.elpd.iter().sum(), inside / n]
}

/// Normal score of the ends of a central 90 % interval.
const SCORE_90: f64 = 1.645;
/// What 90 % intervals must hold on average, in each scenario.
const HOLD: [f64; 2] = [0.85, 0.95];

/// Mean and its standard error.
fn mean(x: &[f64]) -> [f64; 2] {
    let n = x.len() as f64;
    let mean = x.iter().sum::<f64>() / n;
    let variance = x.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
    [mean, (variance / n).sqrt()]
}

/// The lowest count out of `n` that is not below `share` at the level of 5 %.
fn least(n: usize, share: f64) -> usize {
    let mut below = 0.0;
    for k in 0..=n {
        below += binomial(n, k, share);
        if below >= 0.05 {
            return k;
        }
    }
    n
}

fn binomial(n: usize, k: usize, p: f64) -> f64 {
    let choose = (0..k).fold(1.0, |c, i| c * (n - i) as f64 / (i + 1) as f64);
    choose * p.powi(k as i32) * (1.0 - p).powi((n - k) as i32)
}

/// Share of the seeds in which the answer must be right.
fn bar(scenario: Scenario) -> f64 {
    match scenario {
        Scenario::Null | Scenario::Repeated => 0.95,
        Scenario::Output | Scenario::Wall => 0.75,
        Scenario::Region | Scenario::Patch => 0.4,
        _ => 0.9,
    }
}

fn row(scenario: Scenario, results: &[Result]) -> (String, Vec<String>) {
    let n = results.len();
    let count = |what: &dyn Fn(&Result) -> bool| results.iter().filter(|r| what(r)).count();
    let right = count(&|r| r.is_right(scenario));
    let wrong = count(&|r| r.is_wrong(scenario));
    let claims = || results.iter().filter(|r| r.is_right(scenario) && r.rmse.is_some());
    let (n_claims, better) = claims()
        .fold((0, 0), |(n, better), r| (n + 1, better + usize::from(r.is_better(scenario))));
    let coverage =
        |of: usize| mean(&claims().filter_map(|r| Some(r.coverage?[of])).collect::<Vec<_>>());
    let (before, [held, error]) = (coverage(0)[0], coverage(1));
    let others = (count(&|r| !r.ambiguous.is_empty()), count(&|r| r.unexplained));
    let line = format!(
        "{:<18} {n:>5} {right:>5} {wrong:>5} {:>9} {:>11} {:>8}  {:.0} → {:.1} ± {:.1} %",
        format!("{scenario:?}"),
        others.0,
        others.1,
        format!("{better}/{n_claims}"),
        100.0 * before,
        100.0 * held,
        100.0 * error
    );
    let mut failures = vec![];
    if right < least(n, bar(scenario)) {
        failures.push(format!("{scenario:?}: right in {right} of {n}, bar {}", bar(scenario)));
    }
    if n - wrong < least(n, 0.95) {
        failures.push(format!("{scenario:?}: a wrong name in {wrong} of {n}"));
    }
    // a column with empty cells leaves over what it does there
    let beside = count(&|r| r.is_right(scenario) && !r.findings.is_empty() && r.unexplained);
    if scenario != Scenario::Missing && n_claims - beside < least(n_claims, 0.95) {
        failures
            .push(format!("{scenario:?}: unexplained beside {beside} of {n_claims} right names"));
    }
    if better < least(n_claims, 0.95) {
        failures.push(format!("{scenario:?}: held-out error lower in {better} of {n_claims}"));
    }
    // two standard errors: a bar that is just met is missed by chance once in forty
    if n_claims > 1 && (held + 2.0 * error < HOLD[0] || held - 2.0 * error > HOLD[1]) {
        failures.push(format!("{scenario:?}: 90 % intervals hold {held:.3} ± {error:.3}"));
    }
    (line, failures)
}

/// Runs scenarios, prints the table and returns the bars that are not met.
fn rates(scenarios: &[Scenario], seeds: RangeInclusive<u64>, nulls: usize) -> Vec<String> {
    let heart = Heart::new();
    let mut failures = vec![];
    println!(
        "scenario           seeds right wrong ambiguous unexplained held-out  in 90 % intervals"
    );
    for scenario in scenarios {
        let results: Vec<Result> = seeds
            .clone()
            .into_par_iter()
            .map(|seed| searched(&heart, *scenario, seed, nulls))
            .collect();
        if std::env::var_os("VERBOSE").is_some() {
            for r in &results {
                println!(
                    "  {} {:?} {:?} {} {:?} {}",
                    r.seed, r.findings, r.ambiguous, r.unexplained, r.rmse, r.note
                );
            }
        }
        let (line, own) = row(*scenario, &results);
        println!("{line}");
        failures.extend(own);
    }
    failures
}

fn variable(name: &str, default: &str) -> String {
    std::env::var(name).unwrap_or_else(|_| default.into())
}

#[test]
fn one_study_of_each_kind_is_read_rightly() {
    let heart = Heart::new();
    let kinds = [
        (Scenario::Null, 1),
        (Scenario::Force, 1),
        (Scenario::Two, 1),
        (Scenario::Two, 305), // neither is found alone: a pair
        (Scenario::Confounded, 1),
        (Scenario::Outside, 7),
    ];
    kinds.into_par_iter().for_each(|(scenario, seed)| {
        let result = searched(&heart, scenario, seed, 19);
        assert!(result.is_right(scenario), "{scenario:?}: {result:?}");
    });
}

/// As it is found, with a sharp edge on one field, it takes 8 % off the error of sites that played no part.
#[test]
fn a_patch_is_claimed_on_every_field_with_a_soft_edge() {
    let result = searched(&Heart::new(), Scenario::Patch, 111, 19);
    assert_eq!(result.findings, ["patch"], "{result:?}");
    assert_eq!(result.note.matches("[logistic(").count(), 2, "{result:?}");
    let [before, after] = result.rmse.unwrap();
    assert!(after < 0.8 * before, "{result:?}");
}

/// Without smooth fields the sites of the first, in which nothing acts, would be called unexplained (log Bayes factor
/// 8.9). With fields as rough as sites differ in their place, those of the second would not (2.7).
#[test]
fn sites_are_compared_with_smooth_fields() {
    let heart = Heart::new();
    let kinds = [(Scenario::Null, 614), (Scenario::Outside, 701)];
    kinds.into_par_iter().for_each(|(scenario, seed)| {
        let result = searched(&heart, scenario, seed, 0);
        assert!(result.is_right(scenario), "{scenario:?}: {result:?}");
    });
}

/// The model that is claimed lets sites differ: without that its intervals would be too narrow.
#[test]
fn intervals_after_a_right_claim_hold_what_they_say() {
    let heart = Heart::new();
    let seeds: Vec<u64> = (1..=6).collect();
    let results: Vec<Result> =
        seeds.into_par_iter().map(|seed| searched(&heart, Scenario::Force, seed, 19)).collect();
    let right = results.iter().filter(|r| r.is_right(Scenario::Force));
    let [held, error] = mean(&right.filter_map(|r| Some(r.coverage?[1])).collect::<Vec<_>>());
    assert!(held + 2.0 * error > HOLD[0] && held - 2.0 * error < HOLD[1], "{held} ± {error}");
}

/// The rows of `heldout` with the brackets of `answers`, whose rows are the same.
fn answered(heldout: &Measurements, answers: &Measurements) -> Measurements {
    let text =
        |table: &Measurements, row: usize, name: &str| table.cell(row, name).unwrap().to_owned();
    let header = [heldout.columns(), &["lower".into(), "upper".into()]].concat();
    let cells = (0..heldout.len()).map(|row| {
        for name in ["site", "protocol"] {
            assert_eq!(text(heldout, row, name), text(answers, row, name));
        }
        let own = heldout.columns().iter().map(|name| text(heldout, row, name));
        own.chain(["lower", "upper"].map(|name| text(answers, row, name))).collect()
    });
    Measurements::from_cells("heldout", header, cells.collect()).unwrap()
}

/// The sphere and clinical sets of the reference data: another generator, other fields, other surfaces.
#[test]
#[ignore = "8 searches, 2 minutes; needs EPLAT_SHARED"]
fn the_reference_sets_are_read_rightly() {
    let shared = variable("EPLAT_SHARED", "../shared");
    let folder = Path::new(&shared).join("data/synthetic");
    if !folder.exists() {
        skipped::skipped("reference data not found");
        return;
    }
    let sets: [(&str, Scenario); 8] = [
        ("sphere/null_s101", Scenario::Null),
        ("sphere/force_s101", Scenario::Force),
        ("sphere/drift_s101", Scenario::Drift),
        ("sphere/region_pv_s101", Scenario::Region),
        ("sphere/two_force_catheter_s101", Scenario::Two),
        ("sphere/confound_catheter_region_s101", Scenario::ConfoundedRegion),
        ("clinical/null_s102", Scenario::Null),
        ("clinical/force_s102", Scenario::Force),
    ];
    let nulls = variable("NULLS", "19").parse().unwrap();
    let read = |(set, scenario): &(&str, Scenario)| {
        let folder = folder.join(set);
        let mesh = folder.parent().unwrap().join("mesh.vtk");
        let surface = eplat::mesh::read(&mesh, eplat::mesh::Units::Mm).unwrap();
        let basis = eigenpairs_cached(&surface.mesh, 96).unwrap();
        let read = |file: &str| Measurements::read(&folder.join(file)).unwrap();
        let mut train = read("train.csv");
        let mut heldout = answered(&read("heldout.csv"), &read("heldout_answers.csv"));
        train.place_on(&surface, 1.0).unwrap();
        heldout.place_on(&surface, 1.0).unwrap();
        let result = search_of([&train, &heldout], &basis, 1, nulls);
        println!("{set}: {result:?}");
        !result.is_wrong(*scenario)
    };
    let wrong: Vec<&str> = sets.par_iter().filter(|set| !read(set)).map(|(set, _)| *set).collect();
    assert!(wrong.is_empty(), "a wrong name in {}", wrong.join(", "));
}

/// The tables of studies as `eplat loop` reads them, in `FOLDER/SCENARIO_SEED`.
#[test]
#[ignore = "writes files: SCENARIO=patch SEEDS=101..120 FOLDER=studies"]
fn studies_as_files() {
    let heart = Heart::new();
    let (scenarios, seeds) = wanted();
    for scenario in scenarios {
        for seed in seeds.clone() {
            let name = format!("{scenario:?}_{seed}").to_lowercase();
            let folder = Path::new(&variable("FOLDER", "target/studies")).join(name);
            std::fs::create_dir_all(&folder).unwrap();
            let Study { train, heldout, .. } = study(&heart, scenario, seed);
            for (file, table) in [("train.csv", train), ("heldout.csv", heldout)] {
                std::fs::write(folder.join(file), table.to_csv()).unwrap();
            }
        }
    }
}

/// Scenarios and seeds that the environment names.
fn wanted() -> (Vec<Scenario>, RangeInclusive<u64>) {
    let (wanted, seeds) = (variable("SCENARIO", "all").to_lowercase(), variable("SEEDS", "20"));
    let is_wanted = |s: &&Scenario| {
        wanted == "all" || wanted.split(',').any(|name| format!("{s:?}").to_lowercase() == name)
    };
    let scenarios: Vec<Scenario> = ALL.iter().filter(is_wanted).copied().collect();
    assert!(!scenarios.is_empty(), "no scenario {wanted} among {ALL:?}");
    let (first, last) = seeds.split_once("..").unwrap_or(("1", &seeds));
    (scenarios, first.parse().unwrap()..=last.parse().unwrap())
}

#[test]
#[ignore = "380 searches, most of an hour"]
fn the_rates_are_within_their_bars() {
    let (scenarios, seeds) = wanted();
    let failures = rates(&scenarios, seeds, variable("NULLS", "19").parse().unwrap());
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}
