//! The memory that a run foresees, beside the most that it took: within a factor of 1.5.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests")]

#[path = "support/program.rs"]
mod program;

use std::fmt::Write as _;
use std::io::{BufRead as _, BufReader};
use std::process::Stdio;
use std::sync::mpsc;
use std::time::Duration;

use program::Workplace;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;

/// Brackets at places all over the embedded atrium, half of each protocol; of many rows they differ.
fn table(n_rows: usize) -> String {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut table = "vertex,protocol,lower,upper\n".to_owned();
    for i in 0..n_rows {
        let (protocol, same) = if i % 2 == 0 { ("S1S2", 230) } else { ("S1S2S3", 190) };
        // many that overlap: what they say of neighbours is soon sampled
        let (lower, width) =
            if n_rows < 100 { (same, 10) } else { (same - 30 + 10 * rng.random_range(0..2), 50) };
        let vertex = rng.random_range(0..5000);
        let _ = writeln!(table, "{vertex},{protocol},{lower},{}", lower + width);
    }
    table
}

/// Foreseen and taken, bytes.
fn measured(place: &Workplace, arguments: &str) -> [f64; 2] {
    let mut command = place.command(&format!("{arguments} --json --chains 2"));
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let lines = BufReader::new(child.stderr.take().unwrap()).lines();
    let (told, foreseen) = mpsc::channel();
    std::thread::spawn(move || {
        let events = lines.map_while(Result::ok).filter_map(|l| serde_json::from_str(&l).ok());
        for event in events.filter(|event: &Value| event["event"] == "sampling") {
            told.send(event["bytes"].as_f64().unwrap()).unwrap();
        }
    });
    let status = format!("/proc/{}/status", child.id());
    let mut peak = 0.0;
    while child.try_wait().unwrap().is_none() {
        let text = std::fs::read_to_string(&status).unwrap_or_default();
        let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let kilobytes = line.and_then(|line| line.split_whitespace().next()?.parse::<f64>().ok());
        peak = kilobytes.map_or(peak, |kb| f64::max(peak, 1024.0 * kb));
        std::thread::sleep(Duration::from_millis(5));
    }
    let code = child.wait().unwrap().code();
    assert!(matches!(code, Some(0 | 3 | 4)), "{arguments}: {code:?}");
    [foreseen.recv().unwrap(), peak]
}

#[test]
fn what_a_run_takes_is_foreseen() {
    let place = Workplace::new();
    place.file("some.csv", table(2000)).file("many.csv", table(9000)).file("few.csv", table(20));
    let made = place.eplat("mesh atrium --edge 0.6 --out fine.vtk");
    assert!(made.status.success());
    let mut foreseen = vec![];
    for arguments in [
        // with 20 the chains of such a table, in which nothing varies, run away with a quarter of all seeds
        "run erp --mesh embedded --data few.csv --warmup 50 --draws 50 --out few",
        "run erp --mesh fine.vtk --units mm --data few.csv --warmup 50 --draws 50 --out fine",
        "run erp --mesh embedded --data some.csv --warmup 20 --draws 300 --out some",
        "run erp --mesh embedded --data many.csv --warmup 20 --draws 50 --out many",
    ] {
        let [expected, taken] = measured(&place, arguments);
        println!("{arguments}: {:.0} MB foreseen, {:.0} MB taken", expected / 1e6, taken / 1e6);
        let ratio = expected / taken;
        assert!((1.0 / 1.5..1.5).contains(&ratio), "{arguments}: {ratio}");
        foreseen.push(expected);
    }
    // the sizes differ by more than the factor
    assert!(foreseen[3] > 4.0 * foreseen[0] && foreseen[1] > 1.5 * foreseen[0], "{foreseen:?}");
}
