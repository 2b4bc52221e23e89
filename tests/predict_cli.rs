//! `eplat predict`: a finished run says what it expects at rows that it has not seen.

#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/program.rs"]
mod program;

use std::collections::BTreeMap;
use std::fs;

use program::{Workplace, text};

/// Columns of `predictions.csv` by their titles.
fn column(csv: &str, title: &str) -> Vec<String> {
    let mut lines = csv.lines();
    let at = lines.next().unwrap().split(',').position(|name| name == title).unwrap();
    lines.map(|line| line.split(',').nth(at).unwrap().to_owned()).collect()
}

fn numbers(csv: &str, title: &str) -> Vec<f64> {
    column(csv, title).iter().map(|cell| cell.parse().unwrap()).collect()
}

/// Rows at fitted sites and far from them; the folder of the run is enough, wherever the command is given.
#[test]
fn new_sites_and_fitted_ones() {
    let place = Workplace::new();
    let run = place.eplat("run erp --warmup 300 --draws 300 --out run");
    assert!(matches!(run.status.code(), Some(0 | 3)), "{}", text(&run.stderr));
    let fitted = place.read("run/measurements.csv");
    place.file("again.csv", &fitted);
    let output = place.eplat("predict run again.csv --quiet");
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let again = place.read("run/predicted/predictions.csv");
    // rows that were fitted lie in their intervals as rows.csv says, from other replicates of the same draws
    let inside = column(&again, "inside").iter().filter(|cell| *cell == "true").count();
    assert!(inside >= 18, "{again}");
    // rows.csv has the rows of one statement after the other
    let by_line = |csv: &str| -> BTreeMap<String, f64> {
        column(csv, "line").into_iter().zip(numbers(csv, "predicted_q50")).collect()
    };
    let (here, there) = (by_line(&again), by_line(&place.read("run/rows.csv")));
    assert_eq!(here.len(), 20);
    for (line, q50) in here {
        assert!((q50 - there[&line]).abs() <= 10.0, "{line}"); // one step of the protocol
    }
    let said = text(&output.stdout);
    assert!(said.contains("s1s2: ") && said.contains("of 10 measured rows"), "{said}");
    assert!(place.path("run/predicted/predictions.zarr/predictions/s1s2/zarr.json").is_file());

    // what is not measured yet, in another folder and moved away
    place.file("new.csv", "site,vertex,protocol\na,100,s1s2\nb,2500,s1s2s3\n");
    fs::rename(place.path("run"), place.path("moved")).unwrap();
    let output = place.eplat("predict moved new.csv --out there --json");
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(json["rows"].as_array().unwrap().len(), 2);
    assert_eq!(json["rows"][1]["site"], "b");
    assert!(json["rows"][0]["inside"].is_null());
    let new = place.read("there/predictions.csv");
    assert_eq!(column(&new, "inside"), ["", ""]);
    assert!(numbers(&new, "sd").iter().all(|sd| *sd > 1.0), "{new}");
    let same = place.eplat("predict moved new.csv --out same");
    assert_eq!(same.status.code(), Some(0));
    assert_eq!(place.read("same/predictions.csv"), new);
}

/// Paths to new rows are measured as those to fitted ones were.
#[test]
fn arrival_times_at_new_rows() {
    let place = Workplace::new();
    let rows = |vertices: &[usize]| {
        let row = |v: &usize| format!("{v},40,lat,{}\n", 20 + v / 12);
        "vertex,source,protocol,value\n".to_owned() + &vertices.iter().map(row).collect::<String>()
    };
    let fitted: Vec<usize> = (0..24).map(|i| 40 + 50 * i).collect();
    place.file("fitted.csv", rows(&fitted)).file("new.csv", rows(&[100, 700, 540]));
    place.eplat("mesh atrium --edge 3 --out atrium.vtk");
    let run = place.eplat(
        "run lat --mesh atrium.vtk --units mm --data fitted.csv --chains 2 --draws 500 --out run",
    );
    assert!(matches!(run.status.code(), Some(0 | 3 | 4)), "{}", text(&run.stderr));
    let output = place.eplat("predict run new.csv --quiet");
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let predicted = place.read("run/predicted/predictions.csv");
    let at = |csv: &str, title: &str, line: &str| {
        let row = column(csv, "line").iter().position(|cell| cell == line).unwrap();
        numbers(csv, title)[row]
    };
    // the last of the new rows was fitted, too; medians of 1000 replicates are off by 0.04 sd each
    let here = at(&predicted, "predicted_q50", "4");
    let there = at(&place.read("run/rows.csv"), "predicted_q50", "12");
    let sd = at(&predicted, "sd", "4");
    assert!((here - there).abs() < 4.5 * 0.056 * sd, "{here} {there} of sd {sd}");
    let nearer = at(&predicted, "predicted_q50", "2");
    assert!((nearer - here).abs() > 4.5 * 0.056 * sd, "paths of other lengths: {nearer} {here}");
}

/// Where the embedded atrium is named, paths on it are measured as on a mesh of one's own; without a mesh that is asked for.
#[test]
fn arrival_times_on_the_embedded_atrium() {
    let place = Workplace::new();
    let row = |i: i32| format!("lat,{},10,{}", 20 + 160 * i, 20 + 2 * i);
    let rows = (0..30).map(row).collect::<Vec<_>>().join("\n");
    place.file("lat.csv", format!("protocol,vertex,source,value\n{rows}"));
    let run = "run lat --data lat.csv --chains 2 --warmup 200 --draws 200 --out";
    let made = place.eplat(&format!("{run} run --mesh embedded"));
    assert!(matches!(made.status.code(), Some(0 | 3 | 4)), "{}", text(&made.stderr));
    let predicted = place.eplat("predict run lat.csv --quiet");
    assert_eq!(predicted.status.code(), Some(0), "{}", text(&predicted.stderr));
    let unnamed = place.eplat(&format!("{run} other"));
    let said = text(&unnamed.stderr);
    assert!(
        unnamed.status.code() == Some(1) && said.contains("name the surface with --mesh"),
        "{said}"
    );
}

/// The record names the file of the mesh, which may have changed or gone.
#[test]
fn what_the_run_was_made_from_must_be_as_it_was() {
    let place = Workplace::new();
    let made = place.eplat("mesh atrium --edge 3 --out atrium.vtp");
    assert!(made.status.success(), "{}", text(&made.stderr));
    let row = |i| format!("{0},s1s2,240,250\n{0},s1s2s3,200,210\n", 40 * i);
    let rows: Vec<String> = (0..8).map(row).collect();
    place.file("table.csv", format!("vertex,protocol,lower,upper\n{}", rows.concat()));
    let run = "run erp --mesh atrium.vtp --data table.csv --warmup 50 --draws 50 --out run";
    assert!(matches!(place.eplat(run).status.code(), Some(0 | 3 | 4)));
    // the table may be edited: the run has its own
    place.file("table.csv", "vertex,protocol\n7,s1s2\n");
    let predicted = place.eplat("predict run table.csv");
    assert_eq!(predicted.status.code(), Some(0), "{}", text(&predicted.stderr));
    fs::rename(place.path("atrium.vtp"), place.path("elsewhere.vtp")).unwrap();
    let gone = place.eplat("predict run table.csv");
    assert_eq!(gone.status.code(), Some(1));
    assert!(text(&gone.stderr).contains("atrium.vtp"), "{}", text(&gone.stderr));
    let moved = place.eplat("predict run table.csv --mesh elsewhere.vtp");
    assert_eq!(moved.status.code(), Some(0), "{}", text(&moved.stderr));
    let other = place.eplat("mesh atrium --edge 2.5 --out other.vtp");
    assert!(other.status.success());
    let other = place.eplat("predict run table.csv --mesh other.vtp");
    assert_eq!(other.status.code(), Some(1));
    let said = text(&other.stderr);
    assert!(said.contains("was made from other inputs: mesh is "), "{said}");
}

#[test]
fn a_finished_run_of_another_model_is_kept() {
    let place = Workplace::new();
    let short = "--warmup 50 --draws 50 --out run";
    assert!(matches!(place.eplat(&format!("run erp {short}")).status.code(), Some(0 | 3 | 4)));
    let before = place.read("run/run.json");
    let refused = place.eplat(&format!("run erp_exact {short}"));
    assert_eq!(refused.status.code(), Some(1));
    let said = text(&refused.stderr);
    let expected = "error: run holds a finished run of the model Erp; one of ErpExact would replace it\nhelp: name another folder with --out, or give --force\n";
    assert_eq!(said, expected);
    assert_eq!(place.read("run/run.json"), before);
    let replaced = place.eplat(&format!("run erp_exact --force {short}"));
    assert!(matches!(replaced.status.code(), Some(0 | 3 | 4)), "{}", text(&replaced.stderr));
    assert!(place.read("run/run.json").contains("\"ErpExact\""));
}
