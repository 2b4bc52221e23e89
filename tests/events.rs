//! What commands tell on stderr: `--json` one event a line, each documented; `--quiet` nothing but errors.
#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/program.rs"]
mod program;
#[path = "support/sheet.rs"]
mod sheet;

use std::process::{Command, Output, Stdio};

use program::{Workplace, text};
use serde_json::{Value, json};

const SMALL: &str = "--chains 2 --warmup 60 --draws 60";

/// Every line of stderr, which must be an object with an `event` that the documentation tells.
fn events(output: &Output) -> Vec<Value> {
    let documented = include_str!("../docs/outputs.md");
    let said = text(&output.stderr);
    let read = said.lines().map(|line| {
        let event: Value = serde_json::from_str(line).unwrap_or_else(|e| panic!("{e}: {line}"));
        let row = format!("| `{}` |", event["event"].as_str().unwrap());
        assert!(documented.contains(&row), "docs/outputs.md has no row {row}");
        event
    });
    read.collect()
}

fn named<'a>(events: &'a [Value], name: &'a str) -> impl Iterator<Item = &'a Value> {
    events.iter().filter(move |event| event["event"] == name)
}

#[test]
fn a_run_tells_where_it_is_as_json() {
    let place = Workplace::new().with_erp();
    let output = place.eplat(&format!("run erp.rs {SMALL} --json --out out"));
    assert!(matches!(output.status.code(), Some(0 | 3)), "{}", text(&output.stderr));
    let events = events(&output);
    let names: Vec<&str> = events.iter().map(|e| e["event"].as_str().unwrap()).collect();
    assert_eq!(names[..4], ["surface", "basis", "experiment", "sampling"]);
    assert_eq!(events[1]["modes"], 24);
    assert_eq!(events[3]["sampler"], "blocked");
    assert_eq!([&events[3]["chains"], &events[3]["draws"]], [&json!(2), &json!(60)]);
    for chain in 1..=2 {
        let own = named(&events, "progress").filter(|p| p["chain"] == chain);
        let done: Vec<u64> = own.map(|p| p["done"].as_u64().unwrap()).collect();
        assert!(done.contains(&60) && done.last() == Some(&120), "{done:?}");
        assert!(done.is_sorted());
    }
    // stdout has what it had
    let result: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(result["summary"]["apd_max.rho"]["r_hat"].is_f64());
}

#[test]
fn a_quiet_command_says_nothing_but_its_result_and_errors() {
    let place = Workplace::new().with_erp();
    let loud = place.eplat(&format!("run erp.rs {SMALL} --out loud"));
    let quiet = place.eplat(&format!("run erp.rs {SMALL} --quiet --out loud"));
    assert_eq!(quiet.status.code(), loud.status.code());
    assert!(text(&loud.stderr).contains("chain 1") && quiet.stderr.is_empty());
    // all but the line of times
    let result = |output: &Output| -> Vec<String> {
        text(&output.stdout)
            .lines()
            .filter(|l| !l.contains("gradients of"))
            .map(String::from)
            .collect()
    };
    assert_eq!(result(&quiet), result(&loud));
    let failed = place.eplat("run none.rs -q");
    assert!(text(&failed.stderr).starts_with("error: cannot read the model file none.rs: "));
}

#[test]
fn an_error_is_an_event_with_the_same_text_and_code() {
    let place = Workplace::new().with_erp();
    for arguments in ["run none.rs", "run erp.rs --data none.csv", "study run none.toml"] {
        let words = place.eplat(arguments);
        let output = place.eplat(&format!("{arguments} --json"));
        assert_eq!(output.status.code(), words.status.code());
        let events = events(&output);
        let error = events.last().unwrap();
        assert_eq!(format!("error: {}\n", error["text"].as_str().unwrap()), text(&words.stderr));
        assert_eq!(error["code"].as_i64(), words.status.code().map(i64::from));
    }
}

#[test]
fn strips_an_atrium_and_a_study_tell_how_much_is_done() {
    let place = Workplace::new().with_erp();
    sheet::write(&place.path("fields.vtp"));
    place.file("plan.toml", "model = \"erp.rs\"\nlengthscales = [64.0]\nsites = [5]\nresolutions = [10.0]\nfields = 1\ndesigns = 1\n");
    let commands = [
        ("surrogate design --n 9 --vary tau_out --out d.csv", "written", None),
        ("simulate strip --params d.csv --out o.csv --beats 1 --cable", "strips", Some(9)),
        (
            "simulate atrium --fields fields.vtp --pace 0 --beats 1 --last 9 --out beat",
            "time",
            Some(9),
        ),
        ("study run plan.toml --out study", "calibrations", Some(1)),
    ];
    for (arguments, event, of) in commands {
        let output = place.eplat(&format!("{arguments} --json"));
        assert!(output.status.success(), "{arguments}: {}", text(&output.stderr));
        let events = events(&output);
        let told: Vec<&Value> = named(&events, event).collect();
        let last = told.last().unwrap_or_else(|| panic!("{arguments}: {events:?}"));
        if let Some(of) = of {
            assert_eq!([&last["done"], &last["of"]], [&json!(of), &json!(of)], "{arguments}");
        }
    }
    let quiet = place.eplat("simulate strip --params d.csv --out o.csv --beats 1 --cable --quiet");
    assert!(quiet.status.success() && quiet.stderr.is_empty());
}

#[test]
fn a_run_goes_on_though_nobody_reads() {
    let place = Workplace::new().with_erp();
    let mut command = place.command(&format!("run erp.rs {SMALL} --json --out out"));
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    drop(child.stderr.take());
    assert!(matches!(child.wait().unwrap().code(), Some(0 | 3)));
    assert!(place.path("out/run.json").is_file());
}

/// A terminal is made by util-linux' `script`.
#[test]
fn no_color_is_respected_on_a_terminal() {
    let place = Workplace::new();
    let program = env!("CARGO_BIN_EXE_eplat");
    let on_terminal = |no_color: &str| {
        let mut script = Command::new("script");
        script.args(["-qec", &format!("{program} run --nonsense"), "/dev/null"]);
        script.env("TERM", "xterm-256color").env_remove("NO_COLOR").stdin(Stdio::null());
        if !no_color.is_empty() {
            script.env("NO_COLOR", no_color);
        }
        script.current_dir(place.path(".")).output().ok().map(|output| text(&output.stdout))
    };
    let (Some(coloured), Some(plain)) = (on_terminal(""), on_terminal("1")) else {
        program::skipped::skipped("no program `script` to make a terminal");
        return;
    };
    assert!(coloured.contains("\x1b[") && coloured.contains("--nonsense"), "{coloured:?}");
    assert!(!plain.contains("\x1b[") && plain.contains("--nonsense"), "{plain:?}");
}
