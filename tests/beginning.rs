//! The first commands of a new user: `init`, `doctor`, `completions`, and models by their name.
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/program.rs"]
mod program;

use program::{Workplace, text};

/// The folder that is made holds what its README says, and every command there runs.
#[test]
fn the_commands_of_a_folder_that_is_made_run() {
    let place = Workplace::new();
    let made = place.eplat("init work");
    assert!(made.status.success(), "{}", text(&made.stderr));
    let inside = |name: &str| place.read(&format!("work/{name}"));
    assert_eq!(inside("erp.rs"), include_str!("../models/erp.rs"));
    let readme = inside("README.md");
    let (_, commands) = readme.split_once("```sh\n").unwrap();
    let (commands, _) = commands.split_once("```").unwrap();
    let columns = inside("measurements.csv").lines().next().unwrap().replace(',', "`, `");
    assert!(readme.contains(&format!("`{columns}`")), "{readme}");
    assert_eq!(commands.lines().count(), 3, "{commands}");
    for line in commands.lines() {
        let arguments = line.split('#').next().unwrap().trim().strip_prefix("eplat ").unwrap();
        let mut command = place.command(arguments);
        if arguments.starts_with("loop") {
            command.args(["--nulls", "19"]);
        }
        let output = command.current_dir(place.path("work")).output().unwrap();
        let said = text(&output.stdout) + &text(&output.stderr);
        assert!(matches!(output.status.code(), Some(0 | 3 | 4)), "{line}\n{said}");
    }
    assert!(place.path("work/out/erp/report.html").is_file());
    assert!(place.path("work/out/erp-loop/report.html").is_file());
    // what is there is left alone
    let again = place.eplat("init work --model voltage");
    assert_eq!(again.status.code(), Some(2));
    assert!(text(&again.stderr).contains("work is there already"), "{}", text(&again.stderr));
}

#[test]
fn models_with_an_example_begin_and_the_others_say_why_not() {
    let place = Workplace::new();
    for model in ["erp_robust", "voltage"] {
        let made = place.eplat(&format!("init {model} --model {model}"));
        assert!(made.status.success(), "{model}: {}", text(&made.stderr));
        let on = format!("--mesh embedded --data {model}/measurements.csv");
        let checked = place.eplat(&format!("check {model}/{model}.rs {on}"));
        assert!(checked.status.success(), "{model}: {}", text(&checked.stderr));
    }
    for (model, why) in [("lat", "no fields on a surface"), ("joint", "reads the column `s2_ms`")] {
        let none = place.eplat(&format!("init other --model {model}"));
        let said = text(&none.stderr);
        assert_eq!(none.status.code(), Some(2), "{said}");
        assert!(said.contains(why) && said.contains("choose erp, erp_robust or voltage"), "{said}");
    }
    assert_eq!(place.names(), ["erp_robust", "voltage"]);
}

#[test]
fn a_model_that_ships_needs_no_file() {
    let place = Workplace::new();
    let shown = place.eplat("show erp --source");
    assert_eq!(text(&shown.stdout), include_str!("../models/erp.rs"));
    let ran = place.eplat("run erp --warmup 100 --draws 50 --json");
    assert!(matches!(ran.status.code(), Some(0 | 3 | 4)), "{}", text(&ran.stderr));
    assert!(place.path("out/erp/run.json").is_file());
    let unknown = text(&place.eplat("run epr").stderr);
    assert!(
        unknown.contains("epr: expected a model file (.rs), or the name of a model"),
        "{unknown}"
    );
    assert!(unknown.contains("erp, erp_emulated"), "{unknown}");
    let absent = text(&place.eplat("run models/voltage.rs").stderr);
    assert!(absent.contains("`eplat show erp --source` prints a model that ships"), "{absent}");
}

#[test]
fn doctor_says_what_runs_here_and_what_to_install() {
    let place = Workplace::new();
    let well = place.eplat("doctor");
    let said = text(&well.stdout);
    assert!(well.status.success(), "{said}");
    assert!(said.contains("ok  Rust") && said.contains("with Rust code in them, too."), "{said}");
    let bare = place.command("doctor").env("PATH", "").output().unwrap();
    let said = text(&bare.stdout);
    assert!(bare.status.success(), "{said}");
    assert!(said.contains("--  Rust") && said.contains("https://rustup.rs"), "{said}");
    assert!(said.contains("run; those with Rust code in them do not yet"), "{said}");
    place.file("file", "");
    let unwritable =
        place.command("doctor").env("EPLAT_CACHE", place.path("file/x")).output().unwrap();
    assert!(text(&unwritable.stdout).contains("NO  cache"), "{}", text(&unwritable.stdout));
}

#[test]
fn shells_complete_commands() {
    let place = Workplace::new();
    for shell in ["bash", "zsh", "fish"] {
        let script = text(&place.eplat(&format!("completions {shell}")).stdout);
        assert!(script.contains("simulate") && script.contains("target-accept"), "{shell}");
    }
}
