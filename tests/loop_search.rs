//! `criticise` on data of our own making: what was put in is found, and nothing else.
#![allow(clippy::unwrap_used, reason = "for tests")]

use std::ops::ControlFlow;

use eplat::closed_loop::{Loop, LoopSettings, LoopWatch, Story};
use eplat::criticism::{Criticism, CriticismError, SearchSettings, Subject, criticise};
use eplat::run::{Loaded, OutputFolder};
use eplat::table::{Columns, Measurements, Role};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

mod level {
    use eplat::prelude::*;
    model! {
        /// The same duration at every site, in brackets of 10 ms.
        model Level;
        param level [ms] ~ Normal(200.0, 50.0);
        param noise [ms] ~ HalfNormal(5.0);
        let duration(row) [ms] = level;
        observe bracket(row): Bracket [ms] ~ Interval(duration(row), noise);
    }
}

/// What acts on the truth besides the level: per sd of `force_g`, and of catheter B against A.
#[derive(Clone, Copy, Default)]
struct Truth {
    force: f64,
    catheter: f64,
    /// Effect of something that no column tells, per sd.
    hidden: f64,
    /// sd of a further error of each measurement with catheter B.
    scatter: f64,
    /// Whether operator and catheter go together.
    confounded: bool,
}

/// 40 sites, two rows each.
fn table(truth: Truth, seed: u64) -> Measurements {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut cells = vec![];
    for site in 0..40 {
        let mut normal = || rng.sample::<f64, _>(StandardNormal);
        let (force, wall, drift, hidden) = (normal(), normal(), normal(), normal());
        let errors = [normal(), normal()];
        let is_b = rng.random_bool(0.5);
        let operator = if truth.confounded { is_b } else { rng.random_bool(0.5) };
        for error in errors {
            let shift = truth.force * force
                + truth.hidden * hidden
                + if is_b { truth.catheter } else { 0.0 };
            let sd = 3.0 + if is_b { truth.scatter } else { 0.0 };
            let lower = ((200.0 + shift + sd * error) / 10.0).floor() * 10.0;
            let label = |yes: bool| if yes { "B" } else { "A" };
            cells.push(vec![
                site.to_string(),
                lower.to_string(),
                (lower + 10.0).to_string(),
                (15.0 + 5.0 * force).to_string(),
                (2.0 + 0.5 * wall).to_string(),
                (40.0 + 20.0 * drift).to_string(),
                label(is_b).into(),
                label(operator).into(),
            ]);
        }
    }
    let header = ["site", "lower", "upper", "force_g", "wall_mm", "t_min", "catheter", "operator"];
    Measurements::from_cells("made", header.map(String::from).to_vec(), cells).unwrap()
}

fn searched(truth: Truth, seed: u64) -> (Vec<String>, Criticism) {
    let table = table(truth, seed);
    let case = Subject { model: &level::Level, basis: None, table: &table };
    let settings = SearchSettings { nulls: 39, ..SearchSettings::default() };
    let outcome = criticise(&case, &settings, &|_| ControlFlow::Continue(())).unwrap();
    let names = outcome.findings().into_iter().map(ToString::to_string).collect();
    (names, outcome)
}

#[test]
fn nothing_is_found_where_nothing_is_missing() {
    // at the level of 5 %, two claims in ten have a probability of 9 %, three of 1 %
    let claims = (1..=10).filter(|seed| !searched(Truth::default(), *seed).0.is_empty()).count();
    assert!(claims <= 2, "{claims} claims in 10 data sets without an effect");
}

#[test]
fn an_effect_is_found_by_its_name_and_size() {
    let (names, outcome) = searched(Truth { force: -8.0, ..Truth::default() }, 1);
    assert_eq!(names, ["force_g"]);
    let (mean, covariance) = outcome.last.coefficients(&outcome.engine);
    let sd = outcome.candidates[outcome.found()[0]].sd;
    let (mean, error) = (sd * mean[0], sd * covariance[(0, 0)].sqrt());
    assert!((mean + 8.0).abs() < 4.0 * error, "{mean} ± {error}");
}

#[test]
fn scatter_is_found_by_its_column_and_not_as_outliers() {
    let (names, outcome) = searched(Truth { scatter: 17.0, ..Truth::default() }, 1);
    assert_eq!(names, ["hetero(catheter)"]);
    let (_, ln) = outcome.scatter()[0];
    // 20 ms against 3: the larger of the factors that are tried
    assert!(ln.contains(&2.0), "{ln:?}");
}

#[test]
fn two_effects_are_found_one_after_the_other() {
    let (mut names, _) = searched(Truth { force: -8.0, catheter: 15.0, ..Truth::default() }, 2);
    names.sort();
    assert_eq!(names, ["catheter", "force_g"]);
}

#[test]
fn causes_that_go_together_are_both_named_and_neither_is_claimed() {
    let truth = Truth { catheter: 15.0, confounded: true, ..Truth::default() };
    let (names, outcome) = searched(truth, 3);
    assert!(names.is_empty(), "{names:?}");
    let mut pair = outcome.ambiguous()[0].map(ToString::to_string);
    pair.sort();
    assert_eq!(pair, ["catheter", "operator"]);
}

#[test]
fn what_no_column_tells_remains_unexplained() {
    let (names, outcome) = searched(Truth { hidden: 8.0, ..Truth::default() }, 4);
    assert!(names.is_empty(), "{names:?}");
    assert!(outcome.is_unexplained());
    let (_, nothing) = searched(Truth::default(), 4);
    assert!(!nothing.is_unexplained(), "log Bayes factor {}", nothing.site_log_bf);
}

/// Rows of `table` and, of every second site, the same rows again.
fn with_copies(table: &Measurements) -> Measurements {
    let row = |row: usize| -> Vec<String> {
        table.columns().iter().map(|c| table.cell(row, c).unwrap().to_owned()).collect()
    };
    let copied = (0..table.len()).filter(|row| row / 2 % 2 == 0);
    let rows = (0..table.len()).chain(copied).map(row).collect();
    Measurements::from_cells("made", table.columns().to_vec(), rows).unwrap()
}

#[test]
fn copies_count_once_and_replicates_as_often_as_they_were_made() {
    let evidence = |table: &Measurements| {
        let case = Subject { model: &level::Level, basis: None, table };
        criticise(&case, &SearchSettings { nulls: 0, ..SearchSettings::default() }, &|_| {
            ControlFlow::Continue(())
        })
        .unwrap()
    };
    // one row a site: all that is there twice is a copy
    let both = table(Truth { hidden: 8.0, ..Truth::default() }, 4);
    let row = |row: usize| -> Vec<String> {
        both.columns().iter().map(|c| both.cell(row, c).unwrap().to_owned()).collect()
    };
    let rows = (0..both.len()).step_by(2).map(row).collect();
    let single = Measurements::from_cells("made", both.columns().to_vec(), rows).unwrap();
    let [plain, copied] = [&single, &with_copies(&single)].map(|table| evidence(table).site_log_bf);
    assert!((plain - copied).abs() < 1e-9, "{plain} {copied}");
    // two measurements a site, of which some came out the same: they tell how far these scatter
    let same = (0..both.len()).step_by(2).filter(|first| row(*first) == row(first + 1)).count();
    let outcome = evidence(&both);
    assert!((5..35).contains(&same), "{same}");
    assert_eq!(outcome.engine.rows.len(), both.len());
}

#[test]
fn a_user_says_what_a_column_means() {
    let causes = |roles: Columns| -> Vec<String> {
        let mut table = table(Truth { force: -8.0, ..Truth::default() }, 1);
        table.set_roles(roles).unwrap();
        let subject = Subject { model: &level::Level, basis: None, table: &table };
        let settings = SearchSettings { nulls: 0, ..SearchSettings::default() };
        let outcome = criticise(&subject, &settings, &|_| ControlFlow::Continue(())).unwrap();
        let mut causes: Vec<_> = outcome.candidates.iter().map(|c| c.cause.to_string()).collect();
        causes.sort();
        causes.dedup();
        causes
    };
    let with_scatter = |columns: &[&str], others: &[&str]| {
        let scatter = columns.iter().map(|column| format!("hetero({column})"));
        let all = columns.iter().chain(others).map(|name| (*name).to_owned());
        let mut all: Vec<String> = all.chain(scatter).collect();
        all.sort();
        all
    };
    let columns = ["catheter", "force_g", "operator", "t_min", "wall_mm"];
    assert_eq!(causes(Columns::default()), with_scatter(&columns, &["outliers"]));
    let roles =
        Columns::default().with("force_g", Role::Structural).with("wall_mm", Role::Distance);
    let columns = ["catheter", "operator", "t_min", "wall_mm"];
    assert_eq!(causes(roles), with_scatter(&columns, &["outliers", "patch"]));
}

#[test]
fn a_search_is_stopped_by_its_watcher() {
    let table = table(Truth::default(), 1);
    let subject = Subject { model: &level::Level, basis: None, table: &table };
    let stopped = criticise(&subject, &SearchSettings::default(), &|progress| {
        assert_eq!((progress.round, progress.of), (0, 99));
        ControlFlow::Break(())
    });
    assert!(matches!(stopped, Err(CriticismError::Cancelled)), "{stopped:?}");
}

/// What `eplat loop` does, without a file.
fn closed(measurements: Measurements) -> Story {
    let loaded = Loaded { measurements, ..Loaded::default() };
    let settings = LoopSettings {
        search: SearchSettings { nulls: 19, ..SearchSettings::default() },
        ..LoopSettings::default()
    };
    let prepared = Loop::new(&level::Level, loaded, None, settings).unwrap();
    prepared.close(None, &LoopWatch::default()).unwrap()
}

#[test]
fn the_loop_is_closed_in_memory() {
    let story = closed(table(Truth { force: -8.0, ..Truth::default() }, 1));
    assert_eq!(story.verdict(), "Level lacks an effect of force_g on duration.");
    let [low, high] = story.effects[0].size.interval;
    // a 90 % interval is 2 × 1.645 sd wide
    let (centre, sd) = (f64::midpoint(low, high), (high - low) / 3.29);
    assert!((centre + 8.0).abs() < 3.0 * sd, "{low} {high}");
    let error = &story.comparisons()[0];
    assert!(error.after.unwrap().rmse[0] < error.before.rmse[0], "{error:?}");
    assert_eq!(story.finding()["findings"], serde_json::json!(["force_g"]));
    assert!(story.page(&[]).contains("<h1>Level lacks an effect of force_g on duration.</h1>"));
}

/// The finding has the header's name; what is written has one that a model file can hold.
#[test]
fn columns_may_have_names_that_no_model_file_holds() {
    let table = table(Truth { force: -8.0, ..Truth::default() }, 1);
    let name = |own: &String| match own.as_str() {
        "force_g" => "contact force (g)".to_owned(),
        "wall_mm" => "dV/dt".to_owned(),
        "t_min" => "dV-dt".to_owned(),
        other => other.to_owned(),
    };
    let cells = |row: usize| table.cells(row).into_iter().map(String::from).collect();
    let cells = (0..table.len()).map(cells).collect();
    let header = table.columns().iter().map(name).collect();
    let story = closed(Measurements::from_cells("made", header, cells).unwrap());
    assert_eq!(story.verdict(), "Level lacks an effect of contact force (g) on duration.");
    assert_eq!(story.finding()["findings"], serde_json::json!(["contact force (g)"]));
    let unusable: Vec<&str> = story.criticism.unusable.iter().map(|u| &*u.column).collect();
    assert_eq!(unusable, ["dV/dt", "dV-dt"]);
    let folder = tempfile::tempdir().unwrap();
    let source = "use eplat::prelude::*;\nmodel! { model Level; param level ~ Flat; let duration(row) = level; observe bracket(row): Bracket ~ TopHat(duration(row)); }";
    let out = OutputFolder::open(folder.path()).unwrap();
    let files = story.write(&out, source, "level").unwrap();
    assert_eq!(files[0], "level_plus_contact_force_g.rs");
    let written = std::fs::read_to_string(folder.path().join(&files[0])).unwrap();
    let effect = "effect contact_force_g on duration [ms] = smooth(row.contact_force_g, ";
    let effects = ["smooth", "scaled"].map(|form| effect.replace("smooth", form));
    assert!(effects.iter().any(|effect| written.contains(effect)), "{written}");
    assert!(eplat_language::File::read(&written).is_ok_and(|file| file.check().is_empty()));
}
