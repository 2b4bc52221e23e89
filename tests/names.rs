//! Names and texts of a user's, whatever signs they have, go through every command.
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/program.rs"]
mod program;
#[path = "support/sheet.rs"]
mod sheet;

use std::fmt::Write as _;

use eplat::mesh::write_vtp;
use program::{Workplace, text};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// What a spreadsheet may have as the header of a column; commas and quotes as CSV has them.
const COLUMNS: [&str; 10] = [
    "contact force (g)",
    "dV/dt",
    ".x",
    "__x",
    "\"a \"\"quoted\"\" name\"",
    "back\\slash",
    "\"one, two\"",
    "=cmd|' /C calc'!A0",
    "größe µm",
    "fn",
];

/// Point data of the mesh.
const DATA: [&str; 9] =
    ["dV/dt", ".x", "__x", "zarr.json", "100%", "a \"b\" & <c>", "back\\slash", "=cmd", "größe"];

/// Sites as a spreadsheet may name them, each before a number.
const SITES: [&str; 4] = ["=cmd ", "\"roof, left\" ", "- of ", "'@"];

/// Brackets at every third vertex of a sheet, less by 8 ms per sd of the contact force, and columns that do nothing.
fn table(first: usize, rng: &mut ChaCha8Rng) -> String {
    let mut table = format!("site,vertex,protocol,lower,upper,{}\n", COLUMNS.join(","));
    for (row, vertex) in (first..sheet::N).step_by(3).enumerate() {
        let mut normal = || rng.sample::<f64, _>(StandardNormal);
        let contact = normal();
        let (x, y) = ((vertex / 10) as f64, (vertex % 10) as f64);
        let mean = 90.0 + 10.0 * (0.3 * x).sin() + 8.0 * (0.2 * y).cos() - 8.0 * contact;
        let lower = 10.0 * ((mean + 2.0 * normal()) / 10.0).floor();
        let site = SITES[row % 4];
        let site = if row % 4 == 1 {
            format!("\"{}{vertex}\"", "roof, left ")
        } else {
            format!("{site}{vertex}")
        };
        let _ = write!(
            table,
            "{site},{vertex},S1S2,{lower},{},{:.2}",
            lower + 10.0,
            15.0 + 5.0 * contact
        );
        for _ in &COLUMNS[1..] {
            let _ = write!(table, ",{:.3}", normal());
        }
        table.push('\n');
    }
    table
}

fn workplace() -> Workplace {
    let place = Workplace::new();
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let values: Vec<f64> = (0..sheet::N).map(|i| i as f64).collect();
    let data = DATA.map(|name| (name, &values[..]));
    write_vtp(&place.path("sheet.vtp"), &sheet::mesh(), &data).unwrap();
    place.file("train.csv", table(0, &mut rng)).file("new.csv", table(1, &mut rng));
    place
}

const ON: &str = "recovery --mesh sheet.vtp --units mm --data train.csv";

/// Cells of a CSV file that a spreadsheet would take for formulas.
fn formulas(place: &Workplace, file: &str) -> Vec<String> {
    let mut reader = csv::Reader::from_path(place.path(file)).unwrap();
    let header = reader.headers().unwrap().clone();
    let rows: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
    assert!(!rows.is_empty(), "{file}");
    let cells = std::iter::once(&header).chain(&rows).flatten();
    let is_formula =
        |cell: &&str| cell.starts_with(['=', '+', '-', '@']) && cell.parse::<f64>().is_err();
    cells.filter(is_formula).map(String::from).collect()
}

#[test]
fn a_run_takes_names_and_texts_of_any_kind() {
    let place = workplace();
    let checked = place.eplat(&format!("check {ON}"));
    assert!(checked.status.success(), "{}", text(&checked.stderr));
    let ran = place.eplat(&format!("run {ON} --warmup 200 --draws 200 --chains 2 --out run"));
    let said = text(&ran.stderr);
    assert!(matches!(ran.status.code(), Some(0 | 3 | 4)), "{said}");
    // as they are where any name is taken
    let shown = text(&place.eplat("mesh info run/fields.vtp --units mm").stdout);
    assert!(DATA.iter().all(|name| shown.contains(name)), "{shown}");
    // and as folders may be called
    for name in ["dV%2Fdt", "%2Ex", "%5F_x", "%7Aarr.json", "100%25", "back%5Cslash", "=cmd"] {
        let array = place.path("run/posterior.zarr/fields").join(name);
        assert!(array.join("zarr.json").is_file(), "{name}");
    }
    let predicted = place.eplat("predict run new.csv --out predicted");
    assert_eq!(predicted.status.code(), Some(0), "{}", text(&predicted.stderr));
    let files = ["run/rows.csv", "run/loo.csv", "predicted/predictions.csv"];
    for file in files {
        assert_eq!(formulas(&place, file), [""; 0], "{file}");
        assert!(place.read(file).contains("=cmd"), "{file}");
    }
    for command in ["report run", "plot run", "compare run run"] {
        let output = place.eplat(command);
        assert!(matches!(output.status.code(), Some(0 | 3 | 4)), "{}", text(&output.stderr));
    }
    let rows = eplat::report::read_rows(&place.path("run/rows.csv")).unwrap();
    let sites: Vec<&str> = rows.iter().take(4).map(|row| row.site.as_str()).collect();
    // an apostrophe before a formula is no part of it, as in a spreadsheet
    assert_eq!(sites, ["=cmd 0", "roof, left 3", "- of 6", "@9"]);
}

#[test]
fn a_loop_takes_names_and_texts_of_any_kind() {
    let place = workplace();
    let out = format!("loop {ON} --heldout new.csv --nulls 19 --out loop");
    let output = place.eplat(&out);
    let said = text(&output.stdout);
    assert!(matches!(output.status.code(), Some(0 | 3 | 4)), "{}", text(&output.stderr));
    assert!(said.contains("lacks an effect of contact force (g)"), "{said}");
    assert_eq!(formulas(&place, "loop/heldout_predictions.csv"), [""; 0]);
    let cells = place.read("loop/heldout_predictions.csv");
    assert!(cells.contains("\n\"roof, left 4\",S1S2,"), "{cells}");
    // what was written is a model
    let model = "loop/recovery_plus_contact_force_g.rs";
    let checked = place.eplat(&format!("check {}", ON.replace("recovery ", &format!("{model} "))));
    assert!(checked.status.success(), "{}", text(&checked.stderr));
}
