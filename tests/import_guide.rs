//! Every file and command of `docs/import.md` does what the page says.
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/carto.rs"]
mod carto;
#[path = "support/program.rs"]
mod program;

use program::{Workplace, text};

/// The code blocks of this language.
fn blocks<'p>(page: &'p str, language: &str) -> Vec<&'p str> {
    let fence = format!("```{language}\n");
    page.split(&fence).skip(1).map(|after| after.split_once("```").unwrap().0).collect()
}

/// A sheet of 10 × 10 vertices with activation times.
fn shell() -> String {
    let n = 10;
    let vertex = |v: usize| (6 * (v % n), 6 * (v / n));
    let lines = |line: &dyn Fn(usize) -> String| (0..n * n).map(line).collect::<Vec<_>>().concat();
    let points = lines(&|v| format!("{} {} 0\n", vertex(v).0, vertex(v).1));
    let times = lines(&|v| format!("{}\n", vertex(v).0 + vertex(v).1));
    let squares = (0..n * (n - 1)).filter(|v| v % n < n - 1);
    let square = |v| format!("3 {} {} {}\n3 {} {} {}\n", v, v + 1, v + n, v + 1, v + n + 1, v + n);
    let triangles = squares.map(square).collect::<Vec<String>>().concat();
    format!(
        "# vtk DataFile Version 3.0\nshell\nASCII\nDATASET POLYDATA\nPOINTS 100 double\n{points}POLYGONS 162 648\n{triangles}POINT_DATA 100\nSCALARS activation_times double\nLOOKUP_TABLE default\n{times}"
    )
}

#[test]
fn a_newcomer_gets_through_the_page() {
    let page = include_str!("../docs/import.md");
    let place = Workplace::new();
    for (name, bytes) in carto::files() {
        place.file(&format!("study/{name}"), bytes);
    }
    place.file("voltage.rs", include_str!("../models/voltage.rs"));
    place.file("lat.rs", include_str!("../models/lat.rs"));
    place.file("shell.vtk", shell());
    place.file("log.csv", blocks(page, "csv")[0]);
    let mut said = vec![];
    for block in blocks(page, "sh") {
        for command in block.lines() {
            let done = place.eplat(command.strip_prefix("eplat ").unwrap());
            let text = text(&done.stdout) + &text(&done.stderr);
            assert_eq!(done.status.code(), Some(0), "{command}:\n{text}");
            said.push(text);
        }
    }
    assert_eq!(said.len(), 5);
    assert!(said[1].contains("observe bipolar: 10 measurements"), "{}", said[1]);
    let models = "models too\n  lat_fibres: 8 lat\n  lat_velocity: 8 lat\n  voltage: 10 bipolar";
    assert!(said[2].contains(models), "{}", said[2]);
    let contradiction = "contradiction at site B, s1s2, S1 600 ms: captured at 250 ms (line 6), but not at 260 ms (line 7)";
    assert!(said[3].contains(contradiction), "{}", said[3]);
    assert!(said[3].contains("\n  erp: 2 s1s2, 2 s1s2s3"), "{}", said[3]);
}
