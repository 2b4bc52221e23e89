//! What a command says may reach nobody: its results are written all the same. And it can always be ended.
#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/program.rs"]
mod program;

use std::fs::File;
use std::io::{BufRead as _, BufReader, Read as _};
use std::process::{Command, Stdio};

use program::{Workplace, text};

const SMALL: &str = "run erp --chains 2 --warmup 60 --draws 100 --out out";

/// A pipe that nobody reads.
fn closed() -> Stdio {
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    writer.into()
}

/// A disk without room, where there is one.
fn full() -> Stdio {
    File::options().write(true).open("/dev/full").map_or_else(|_| closed(), Stdio::from)
}

#[test]
fn a_run_writes_its_results_whoever_listens() {
    for kind in [closed, full] {
        for arguments in [SMALL, "run erp --optimize --out mode", "predict out new.csv"] {
            let place = Workplace::new();
            if arguments.starts_with("predict") {
                assert!(place.eplat(SMALL).status.code().is_some_and(|code| code != 1));
                place.file("new.csv", place.read("out/measurements.csv"));
            }
            let mut command = place.command(arguments);
            let code = command.stderr(kind()).stdout(Stdio::null()).status().unwrap().code();
            assert!(matches!(code, Some(0 | 3 | 4)), "{arguments}: {code:?}");
            let record = ["out/run.json", "mode/map.json", "out/predicted/predictions.csv"];
            assert!(record.iter().any(|name| place.path(name).is_file()), "{arguments}");
        }
        let place = Workplace::new();
        let output = place.command(SMALL).stdout(kind()).output().unwrap();
        assert!(matches!(output.status.code(), Some(0 | 3 | 4)), "{}", text(&output.stderr));
        assert!(place.path("out/run.json").is_file());
    }
}

#[test]
fn a_command_whose_reader_has_left_is_content() {
    let place = Workplace::new();
    for arguments in ["show erp", "mesh atrium --edge 3 --out la.vtk", "mesh info la.vtk", "doctor"]
    {
        let output = place.command(arguments).stdout(closed()).output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{arguments}: {}", text(&output.stderr));
        let status = place.command(arguments).stderr(closed()).stdout(Stdio::null()).status();
        assert_eq!(status.unwrap().code(), Some(0), "{arguments}");
    }
}

const STUCK: &str = "use eplat::prelude::*;

fn stuck<D: Real>(x: D) -> D {
    eprintln!(\"here\");
    while x.re() < 1e300 {
        std::hint::spin_loop();
    }
    x
}

model! {
    model Stuck;
    param mean [ms] ~ Normal(10.0, 2.0);
    let shifted(row) [ms] = stuck(mean);
    observe y(row): Number [ms] ~ Normal(shifted(row), 1.0);
}
";

#[test]
fn a_second_ctrl_c_ends_a_function_that_never_returns() {
    let place = Workplace::new();
    place.file("stuck.rs", STUCK).file("table.csv", "y\n1\n2\n");
    let mut child = place
        .command("run stuck.rs --data table.csv --out out")
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut said = BufReader::new(child.stderr.take().unwrap());
    let mut line = String::new();
    while !line.starts_with("here") {
        line.clear();
        assert!(said.read_line(&mut line).unwrap() > 0, "it ended");
    }
    let interrupt = || {
        let id = child.id().to_string();
        assert!(Command::new("kill").args(["-INT", &id]).status().unwrap().success());
        std::thread::sleep(std::time::Duration::from_millis(300));
    };
    interrupt();
    interrupt();
    assert_eq!(child.wait().unwrap().code(), Some(131));
    let mut rest = String::new();
    said.read_to_string(&mut rest).unwrap();
    assert!(rest.contains("error: ended at once, by a second Ctrl-C\nhelp: "), "{rest}");
}
