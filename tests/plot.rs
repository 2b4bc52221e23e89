//! `eplat plot DIR`: the pictures of a run and of surrogates, and what is refused. Those of a loop and of a study are
//! drawn where the tests have one: `loop_cli.rs`, `study_cli.rs`.

#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/picture.rs"]
mod picture;
#[path = "support/program.rs"]
mod program;

use std::f64::consts::PI;

use eplat::mesh::{TriMesh, write_vtp};
use picture::{Picture, checked};
use program::{Workplace, text};
use serde_json::Value;

const SHORT: &str = "--chains 2 --warmup 100 --draws 60 --quiet";
/// The table that the committed surrogate was fitted to.
const STRIPS: &str =
    include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/engine/src/surrogate/erp_design.csv"));

impl Workplace {
    /// Standard output of `eplat plot ARGUMENTS`, and names of its pictures, each without a fault.
    fn plot(&self, arguments: &str) -> (String, Vec<String>) {
        let output = self.eplat(&format!("plot {arguments}"));
        assert!(output.status.success(), "{}", text(&output.stderr));
        let stdout = text(&output.stdout);
        let names = checked(&self.path(""), &stdout);
        (stdout, names)
    }

    /// Standard error of a command that ends with this code.
    fn refused(&self, arguments: &str, code: i32) -> String {
        let output = self.eplat(&format!("plot {arguments}"));
        let stderr = text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{stderr}");
        stderr
    }
}

#[test]
fn every_picture_of_a_run_is_whole() {
    let place = Workplace::new().with_erp();
    let ran = place.eplat(&format!("run erp.rs {SHORT} --out run"));
    assert!(matches!(ran.status.code(), Some(0 | 3 | 4)), "{}", text(&ran.stderr));

    let (stdout, names) = place.plot("run");
    let maps = ["apd_max", "erp_s2", "erp_s3", "tau_out"];
    let of = |kind: &'static str| maps.iter().map(move |map| format!("{kind}_{map}"));
    let others = ["share_unphysical", "predicted", "traces"].map(String::from);
    let expected: Vec<String> = of("field").chain(of("truth")).chain(others).collect();
    assert_eq!(names, expected);
    let line = "run/figures/field_apd_max.png  apd_max, posterior mean and standard deviation, from six sides\n";
    assert!(stdout.contains(line), "{stdout}");
    let svg = place.read("run/figures/field_apd_max.svg");
    for label in
        ["anterior", "inferior", "mitral valve", "LSPV", "20 mm", "measurement sites", ">ms<"]
    {
        assert!(svg.contains(label), "{label}");
    }

    // some of them, elsewhere, fading; the same again to the byte
    let (_, some) = place.plot("run --only fields,traces --uncertainty opacity --out some");
    assert_eq!(some, [&names[..4], &names[10..]].concat());
    let bytes = |file: &str| std::fs::read(place.path(file)).unwrap();
    assert_eq!(bytes("some/traces.png"), bytes("run/figures/traces.png"));
    assert_ne!(bytes("some/field_erp_s2.png"), bytes("run/figures/field_erp_s2.png"));

    // lines every 10 ms
    assert!(!svg.contains("every 10 ms"));
    let (_, lined) = place.plot("run --only fields --isochrones 10 --out lined");
    assert_eq!(lined, names[..4]);
    let svg = place.read("lined/field_apd_max.svg");
    assert!(svg.contains("every 10 ms") && svg.contains(r#"stroke-width=".5" stroke-linecap"#));
    let stderr = place.refused("run --isochrones 0", 2);
    assert!(stderr.contains("expected a number of ms, 0.1 or more"), "{stderr}");

    let stderr = place.refused("run --only fields maps", 2);
    assert!(stderr.contains("--only maps: no such kind"), "{stderr}");
    assert!(stderr.contains("there are fields, truth, shares, predicted, traces"), "{stderr}");

    // what the checks above would see
    let mut picture = Picture::read(&place.path("run/figures/predicted.png"));
    let width = picture.width;
    picture.pixels[5 * width - 1] = [90; 3];
    assert_eq!(picture.faults(), [format!("ink at the rim: ({}, 4)", width - 1)]);
    picture.pixels.fill([255; 3]);
    assert_eq!(picture.faults(), ["all but blank: 0 pixels"]);
    picture.width = 2 * width;
    assert_eq!(picture.faults().len(), 2);
}

/// A sphere of 20 mm, its pole on the z axis the first vertex; `up` is 1 or −1, where that pole is.
fn sphere(up: f64) -> TriMesh {
    const RINGS: u32 = 23;
    const AROUND: u32 = 48;
    let at = |ring: u32, k: u32| {
        let polar = PI * f64::from(ring) / f64::from(RINGS + 1);
        let around = 2.0 * PI * f64::from(k) / f64::from(AROUND) * up;
        [polar.sin() * around.cos(), polar.sin() * around.sin(), up * polar.cos()].map(|x| 20.0 * x)
    };
    let rings = (1..=RINGS).flat_map(|ring| (0..AROUND).map(move |k| at(ring, k)));
    let vertices: Vec<_> = [at(0, 0)].into_iter().chain(rings).chain([at(RINGS + 1, 0)]).collect();
    let number = |ring: u32, k: u32| 1 + (ring - 1) * AROUND + k % AROUND;
    let last = vertices.len() as u32 - 1;
    let mut triangles = vec![];
    for k in 0..AROUND {
        triangles.push([0, number(1, k), number(1, k + 1)]);
        triangles.push([last, number(RINGS, k + 1), number(RINGS, k)]);
        for ring in 1..RINGS {
            let [a, b] = [number(ring, k), number(ring, k + 1)];
            let [c, d] = [number(ring + 1, k), number(ring + 1, k + 1)];
            triangles.extend([[a, c, d], [a, d, b]]);
        }
    }
    TriMesh::new(vertices, triangles).unwrap()
}

/// Whether a colour is this one, dimmed by no more than a wall that is turned away a little.
fn is_like(seen: [u8; 3], expected: [u8; 3]) -> bool {
    seen.iter().zip(expected).all(|(a, b)| a.abs_diff(b) <= 12)
}

/// The pixel this many units right of and above the middle of a view (column, row) of the first of two maps.
fn near_middle(picture: &Picture, view: [usize; 2], shift: [f64; 2]) -> [u8; 3] {
    let x = 6.0 + 206.0 * (view[0] as f64 + 0.5) + shift[0];
    let y = 22.0 + 186.0 * (view[1] as f64 + 0.5) - shift[1];
    picture.at((3.0 * x) as usize, (3.0 * y) as usize)
}

#[test]
fn colours_and_sites_are_where_they_belong() {
    let place = Workplace::new().with_erp();
    write_vtp(&place.path("sphere.vtp"), &sphere(1.0), &[]).unwrap();
    // all at the first vertex, the pole
    let rows = "site,vertex,protocol,lower,upper\n1,0,S1S2,220,230\n1,0,S1S2S3,180,190\n1,0,S1S2,220,230\n";
    place.file("rows.csv", rows);
    let on = "--mesh sphere.vtp --units mm --data rows.csv";
    let ran = place.eplat(&format!("run erp.rs {on} {SHORT} --out run"));
    assert!(matches!(ran.status.code(), Some(0 | 3 | 4)), "{}", text(&ran.stderr));
    // the maps that the record names are replaced
    let mut record: Value = serde_json::from_str(&place.read("run/run.json")).unwrap();
    assert!(record.as_object_mut().unwrap().remove("files").is_some());
    place.file("run/run.json", record.to_string());
    // the field is z, or −z, on the sphere with its first vertex above or below
    let drawn = |sign: f64, up: f64| {
        let mesh = sphere(up);
        let z: Vec<f64> = mesh.vertices().iter().map(|at| sign * at[2]).collect();
        let sd = vec![1.0; z.len()];
        let arrays: [(&str, &[f64]); 2] = [("z_mean", &z), ("z_sd", &sd)];
        write_vtp(&place.path("run/fields.vtp"), &mesh, &arrays).unwrap();
        assert_eq!(place.plot("run --only fields").1, ["field_z"]);
        Picture::read(&place.path("run/figures/field_z.png"))
    };
    let (anterior, superior, inferior) = ([0, 0], [2, 0], [2, 1]);
    // ends, middle and three quarters of viridis; 38.5 units are half the radius
    let [low, middle, quarter, high] = [[68, 1, 84], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
    let is_field = |picture: &Picture| {
        is_like(near_middle(picture, superior, [10.0, 0.0]), high)
            && is_like(near_middle(picture, anterior, [0.0, 0.0]), middle)
            && is_like(near_middle(picture, anterior, [0.0, 38.5]), quarter)
            && is_like(near_middle(picture, inferior, [10.0, 0.0]), low)
    };
    let has_site = |picture: &Picture, view| near_middle(picture, view, [0.0; 2]) == [255; 3];
    let (picture, other, mirrored) = (drawn(1.0, 1.0), drawn(-1.0, 1.0), drawn(1.0, -1.0));
    assert!(is_field(&picture) && is_field(&mirrored));
    assert!(!is_field(&other), "another field passes for it");
    assert!(has_site(&picture, superior) && !has_site(&picture, inferior));
    assert!(!has_site(&mirrored, superior) && has_site(&mirrored, inferior));
    // a sphere of 77 units ends before its view does
    assert_eq!(near_middle(&picture, anterior, [80.0, 0.0]), [255; 3]);
    assert_ne!(near_middle(&picture, anterior, [75.0, 0.0]), [255; 3]);
}

#[test]
fn surrogates_are_drawn_from_the_table_of_strips() {
    let place = Workplace::new();
    place.file("erp/table.csv", STRIPS);
    let (_, names) = place.plot("erp");
    assert_eq!(names, ["surrogate_cubic", "error_cubic", "surrogate_gp", "error_gp"]);
    // as `eplat surrogate fit` reports it
    assert!(
        place
            .read("erp/figures/error_cubic.svg")
            .contains("ERP_S2: surrogate − simulator, RMS 0.46 ms")
    );
    let stderr = place.refused("erp --only fields", 2);
    assert!(stderr.contains("there are cubic, gp"), "{stderr}");
}

#[test]
fn a_folder_of_nothing_is_refused() {
    let place = Workplace::new();
    place.file("empty/notes.csv", "a,b\n1,2\n");
    for folder in ["empty", "absent"] {
        let stderr = place.refused(folder, 1);
        assert!(
            stderr.contains(&format!("{folder}: nothing to draw; expected run.json")),
            "{stderr}"
        );
        assert!(!place.path(&format!("{folder}/figures")).exists());
    }
}
