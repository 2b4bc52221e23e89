//! What cannot be right, or cannot be done, is refused before any work: with what was found, and where.
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/program.rs"]
mod program;

use std::io::{BufRead as _, BufReader};
use std::process::Stdio;

use eplat::manifold::{Basis, eigenpairs};
use eplat::mesh::{Units, read};
use program::{Workplace, text};

/// The error that a command ends with.
fn refused(place: &Workplace, arguments: &str) -> String {
    let begun = std::time::Instant::now();
    let output = place.eplat(arguments);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{arguments}\n{}{said}", text(&output.stdout));
    assert!(begun.elapsed().as_secs() < 60, "{arguments}");
    let at = said.find("error: ").unwrap_or_else(|| panic!("{arguments}\n{said}"));
    assert!(said[at..].contains("\nhelp: "), "{said}");
    said[at..].to_owned()
}

const VTK: &str = "# vtk DataFile Version 3.0\ns\nASCII\nDATASET POLYDATA\nPOINTS 4 double\n\
    0 0 0\n10 0 0\n0 10 0\n10 10 0\nPOLYGONS 2 8\n3 0 1 2\n3 1 3 2\n";

const VTP: &str = "<VTKFile type=\"PolyData\"><PolyData>\n<Piece NumberOfPoints=\"4\" NumberOfPolys=\"2\">\n\
    <Points><DataArray type=\"Float64\" NumberOfComponents=\"3\" format=\"ascii\">0 0 0 10 0 0 0 10 0 10 10 0</DataArray></Points>\n\
    <Polys><DataArray type=\"Float64\" Name=\"connectivity\" format=\"ascii\">0 1 2 1 3 2</DataArray>\n\
    <DataArray type=\"Int64\" Name=\"offsets\" format=\"ascii\">3 6</DataArray></Polys>\n</Piece></PolyData></VTKFile>";

const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
    element face 1\nproperty list uchar float vertex_indices\nend_header\n0 0 0\n10 0 0\n0 10 0\n3 0 1 2\n";

#[test]
fn meshes_that_contradict_themselves() {
    let place = Workplace::new();
    // what follows a comment counts
    let commented = &VTP.replace(">0 0 0 10", ">0 0 <!-- the first -->0 10");
    let whole = [("ok.vtk", VTK), ("ok.vtp", VTP), ("ok.ply", PLY), ("said.vtp", commented)];
    for (name, mesh) in whole {
        place.file(name, mesh);
        let info = place.eplat(&format!("mesh info {name} --units mm"));
        assert!(info.status.success(), "{name}: {}", text(&info.stderr));
    }
    let cases = [
        ("polygons.vtk", VTK.to_owned() + "POLYGONS 1 4\n3 1 3 2\n", "POLYGONS a second time"),
        (
            "points.vtk",
            VTK.to_owned() + "POINT_DATA 4\nPOINTS 2 double\n0 0 0\n1 1 1\n",
            "POINTS a second time",
        ),
        (
            "far.vtk",
            VTK.replace("10 0 0", "1e308 0 0"),
            "vertex 1 is at (1e308, 0.0, 0.0) mm, expected coordinates below 1e12 mm",
        ),
        (
            "field.vtk",
            VTK.to_owned() + "POINT_DATA 4\nFIELD F 1\nlat 4611686018427387904 4 double\n1 2 3 4\n",
            "the file ends here",
        ),
        ("part.vtp", VTP.replace(">0 1 2", ">0.9 1 2"), "expected whole numbers, got 0.9"),
        ("part2.vtp", VTP.replace(">3 6", ">3 6.5"), "expected whole numbers, got 6.5"),
        (
            "n.vtp",
            VTP.replace("Points=\"4\"", "Points=\"400\""),
            "400 of them, as NumberOfPoints says, got 4",
        ),
        (
            "m.vtp",
            VTP.replace("Polys=\"2\"", "Polys=\"5\""),
            "5 of them, as NumberOfPolys says, got 2",
        ),
        (
            "more.vtp",
            VTP.replace("10 10 0<", "10 10 0 5 5 5<"),
            "4 of them, as NumberOfPoints says, got 5",
        ),
        (
            "ragged.vtp",
            VTP.replace("10 10 0<", "10 10<"),
            "three coordinates for every point, got 11 numbers",
        ),
        (
            "part.ply",
            PLY.replace("3 0 1 2", "3 0.9 1 2"),
            "expected whole numbers as corners, got 0.9",
        ),
    ];
    for (name, mesh, expected) in cases {
        place.file(name, mesh);
        let said = refused(&place, &format!("mesh info {name} --units mm"));
        assert!(said.contains(expected), "{name}: {said}");
    }
}

#[test]
fn a_basis_that_is_not_of_the_surface() {
    let place = Workplace::new();
    assert!(place.eplat("mesh atrium --edge 3 --out la.vtk").status.success());
    let mesh = read(&place.path("la.vtk"), Units::Mm).unwrap().mesh;
    let good = eigenpairs(&mesh, 24).unwrap();
    let (n, k) = (good.n_vertices(), good.n_modes());
    let made = |of: &dyn Fn(usize, usize) -> f64| Basis {
        eigenvalues: good.eigenvalues.clone(),
        eigenfunctions: (0..n * k).map(|i| of(i / k, i % k)).collect(),
    };
    let constant = made(&|v, _| good.at(v)[0]);
    let permuted = made(&|v, mode| good.at((v + n / 2) % n)[mode]);
    let turned = made(&|v, mode| good.at(v)[(mode + 1) % k]);
    let mixed = made(&|v, mode| match mode {
        2 => 0.6 * good.at(v)[1] + 0.8 * good.at(v)[2],
        _ => good.at(v)[mode],
    });
    place.file("sites.csv", "vertex,protocol,lower,upper\n10,s1s2,200,210\n200,s1s2s3,180,190\n");
    for (name, basis) in
        [("constant", constant), ("permuted", permuted), ("turned", turned), ("mixed", mixed)]
    {
        basis.write_npz(&place.path("basis.npz")).unwrap();
        let on = "--mesh la.vtk --units mm --data sites.csv --basis basis.npz";
        let said = refused(&place, &format!("check erp {on}"));
        assert!(said.contains("expected mode"), "{name}: {said}");
    }
    good.write_npz(&place.path("basis.npz")).unwrap();
    let checked =
        place.eplat("check erp --mesh la.vtk --units mm --data sites.csv --basis basis.npz");
    assert_ne!(checked.status.code(), Some(1), "{}", text(&checked.stderr));
}

#[test]
fn numbers_that_no_machine_has_room_for() {
    let place = Workplace::new();
    let erp = include_str!("../models/erp.rs");
    for k in ["0", "2147483648000", "2049", "18446744073709551616"] {
        place.file("k.rs", erp.replace("K = 24", &format!("K = {k}")));
        let said = refused(&place, "check k.rs");
        assert!(said.contains("from 1 to 2048 modes") && said.contains("k.rs:"), "{said}");
    }
    place.file("k.rs", erp.replace("K = 24", "K = 1"));
    let one = place.eplat("check k.rs");
    assert!(matches!(one.status.code(), Some(0 | 4)), "{}", text(&one.stderr));
    for arguments in
        ["--draws 10000000000", "--chains 100000000000", "--chains 9223372036854775807"]
    {
        let said = refused(&place, &format!("run erp {arguments}"));
        assert!(
            said.contains(" GB of memory; ") && said.contains("--draws and --chains"),
            "{said}"
        );
        assert!(!place.path("out").exists(), "{said}");
    }
    place.file("erp.rs", erp).file(
        "plan.toml",
        "model = \"erp.rs\"\nlengthscales = [64.0]\nsites = [5]\nresolutions = [10.0]\nfields = 1000000000000\ndesigns = 1000000000\n",
    );
    let said = refused(&place, "study run plan.toml --out study");
    assert!(said.contains("1000000000000000000000 cases: a study has at most 10000000"), "{said}");
    assert!(place.eplat("mesh atrium --edge 3 --out la.vtk").status.success());
    for times in ["12", "4294967295"] {
        let refined =
            "simulate atrium --fields la.vtk --units mm --tau-out 8 --apd-max 200 --pace 0";
        let said = refused(&place, &format!("{refined} --refine {times} --out beat"));
        assert!(said.contains(" GB of memory; ") && said.contains("--refine"), "{said}");
    }
    let said = refused(&place, "simulate cell --beats 4294967295 --out cell");
    assert!(said.contains(" GB of memory; ") && said.contains("--beats"), "{said}");
    let nulls = place.eplat("loop erp --mesh embedded --data t.csv --nulls 100000000000000");
    assert!(text(&nulls.stderr).contains("more than a million"), "{}", text(&nulls.stderr));
}

#[test]
fn a_measurement_with_an_error_that_is_none_is_named() {
    let place = Workplace::new();
    place.file(
        "m.rs",
        "use eplat::prelude::*;\nmodel! {\n    model Lik;\n    column err [ms];\n    param m [ms] ~ Normal(1.0, 2.0);\n    let level(row) [ms] = m;\n    observe y(row): Number [ms] ~ Normal(level(row), row.err);\n}\n",
    );
    for error in ["0", "-1", "inf"] {
        place.file("table.csv", format!("y,err\n1,0.5\n2,{error}\n"));
        for command in ["check m.rs", "run m.rs --out out", "run m.rs --optimize --out out"] {
            let said = refused(&place, &format!("{command} --data table.csv"));
            assert!(said.contains("row 2") || said.contains("line 3"), "{command}: {said}");
        }
    }
}

#[test]
fn draws_of_fields_that_are_no_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("field_draws.npz");
    let draws = eplat::report::FieldDraws {
        n_modes: 1,
        eigenfunctions: vec![1.0, 1.0].into(),
        coefficients: [("tau_out".to_owned(), vec![10.0, f64::NAN])].into(),
        within: std::collections::BTreeMap::new(),
    };
    draws.write(&path).unwrap();
    let said = eplat::report::FieldDraws::read(&path).unwrap_err().to_string();
    assert!(said.contains("tau_out: expected finite numbers"), "{said}");
}

/// What takes minutes is announced before it begins.
#[test]
fn many_eigenfunctions_are_announced() {
    let place = Workplace::new();
    place.file("k.rs", include_str!("../models/erp.rs").replace("K = 24", "K = 2000"));
    let mut command = place.command("check k.rs");
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let said = BufReader::new(child.stderr.take().unwrap()).lines();
    let mut said = said.map_while(Result::ok).skip_while(|line| !line.starts_with("basis "));
    let line = said.next().unwrap_or_default();
    let _ = child.kill();
    child.wait().unwrap();
    assert!(line.contains("computing 2000 eigenfunctions of 5166 vertices: about 23 s"), "{line}");
}
