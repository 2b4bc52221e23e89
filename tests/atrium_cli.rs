//! `eplat simulate atrium` and `cell` as a user runs them, on a small sheet and one cell.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

#[path = "support/program.rs"]
mod program;
#[path = "support/sheet.rs"]
mod sheet;

use std::collections::BTreeMap;
use std::fs;
use std::process::Output;
use std::sync::Mutex;
use std::sync::atomic::AtomicBool;

use eplat::mesh::{self, Units};
use eplat::report::FieldDraws;
use eplat::run::atrium::{
    Atrium, AtriumSettings, Beat, Event, Ground, PacingSettings, TissueSettings, Watch,
};
use program::Workplace;

fn said(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

fn place() -> Workplace {
    let place = Workplace::new();
    sheet::write(&place.path("fields.vtp"));
    place
}

fn succeeds(place: &Workplace, arguments: &str) -> String {
    let output = place.eplat(arguments);
    assert!(output.status.success(), "{arguments}: {}", said(&output));
    said(&output)
}

fn maps(place: &Workplace, folder: &str) -> BTreeMap<String, Vec<f64>> {
    let file = place.path(folder).join("beat.vtp");
    mesh::read(&file, Units::Mm).unwrap().scalars()
}

#[test]
fn a_sheet_is_paced_and_its_maps_read_back() {
    let place = place();
    let arguments = "simulate atrium --fields fields.vtp --refine 2 --pace 0 --radius 1.5 --beats 2 --s1 320 \
                     --last 320 --snapshots 40 --out beat";
    let said = succeeds(&place, arguments);
    assert!(said.contains("beat 2 of 2: 1813 of 1813 vertices activated"), "{said}");
    let surface = mesh::read(&place.path("beat/beat.vtp"), Units::Mm).unwrap();
    let [lat, apd90] = ["lat", "apd90"].map(|name| surface.point_data[name].values());
    let of = |values: &[f64], x: f64| {
        let near =
            surface.mesh.vertices().iter().zip(values).filter(|(p, _)| (p[0] - x).abs() < 1e-9);
        let near: Vec<f64> = near.map(|(_, value)| *value).collect();
        near.iter().sum::<f64>() / near.len() as f64
    };
    assert!(of(lat, 2.0) < of(lat, 6.0) && of(lat, 6.0) < of(lat, 11.0));
    assert!(of(apd90, 2.0) + 10.0 < of(apd90, 11.0), "longer where APD_max is");
    // V at 0, 40 … 320 ms of the beat, and their list
    let series = place.read("beat/voltage.pvd");
    assert_eq!(series.matches("<DataSet").count(), 9);
    assert!(series.contains("timestep=\"40.000\" file=\"voltage/0001.vtp\""), "{series}");
    assert_eq!(fs::read_dir(place.path("beat/voltage")).unwrap().count(), 9);
    assert_eq!(fs::read_dir(place.path("beat")).unwrap().count(), 4);
    let record: serde_json::Value =
        serde_json::from_str(&place.read("beat/simulation.json")).unwrap();
    assert_eq!(record["activated_vertices"], 1813);
    // without snapshots the earlier ones go
    succeeds(&place, "simulate atrium --fields fields.vtp --pace 0 --beats 1 --last 9 --out beat");
    assert_eq!(fs::read_dir(place.path("beat")).unwrap().count(), 2);
}

#[test]
fn pacing_from_several_vertices_and_a_region() {
    let place = place();
    let common = "simulate atrium --fields fields.vtp --refine 1 --beats 1 --last 30";
    succeeds(&place, &format!("{common} --pace 0,129 --radius 1.2 --out two"));
    let lat = &maps(&place, "two")["lat"];
    // both corners at once, the middle later
    assert!((lat[0] - lat[129]).abs() < 1.0 && lat[65] > lat[0] + 4.0, "{} {}", lat[0], lat[65]);
    let said = succeeds(&place, &format!("{common} --pace-region region=1 --out edge"));
    // 10 vertices and the 9 between them
    assert!(said.contains("1 stimuli at 19 vertices"), "{said}");
    let lat = &maps(&place, "edge")["lat"];
    assert!((lat[120] - lat[129]).abs() < 1.0 && lat[120] > lat[60] && lat[60] > lat[0]);
}

#[test]
fn fibres_slow_what_crosses_them() {
    let place = place();
    let common =
        "simulate atrium --fields fields.vtp --refine 2 --pace-region region=1 --beats 1 --last 60";
    succeeds(&place, &format!("{common} --out isotropic"));
    succeeds(&place, &format!("{common} --fibres fib --anisotropy 1 --out one"));
    succeeds(&place, &format!("{common} --fibres fib --anisotropy 2 --out across"));
    let lat = |folder: &str| maps(&place, folder)["lat"].clone();
    let (isotropic, one, across) = (lat("isotropic"), lat("one"), lat("across"));
    assert_eq!(isotropic, one);
    // from 4 to 10 mm at half the speed
    let time = |lat: &[f64]| lat[105] - lat[45];
    let ratio = time(&across) / time(&isotropic);
    assert!((1.85..2.25).contains(&ratio), "{ratio}");
}

#[test]
fn another_simulation_is_compared_with() {
    let place = place();
    let common = "simulate atrium --fields fields.vtp --refine 1 --pace 0 --beats 1 --last 400";
    succeeds(&place, &format!("{common} --apd-max 180 --out a"));
    let said = succeeds(&place, &format!("{common} --apd-max 190 --compare a/beat.vtp --out b"));
    assert!(said.contains("against a/beat.vtp:") && said.contains("apd90  RMSE"), "{said}");
    let record: serde_json::Value = serde_json::from_str(&place.read("b/simulation.json")).unwrap();
    let compared = &record["compared"]["apd90"];
    let [rmse, mean] = ["rmse_ms", "mean_difference_ms"].map(|key| compared[key].as_f64().unwrap());
    let (a, b) = (maps(&place, "a"), maps(&place, "b"));
    let differences: Vec<f64> = b["apd90"].iter().zip(&a["apd90"]).map(|(b, a)| b - a).collect();
    assert_eq!(b["apd90_difference"], differences);
    assert!((mean - differences.iter().sum::<f64>() / differences.len() as f64).abs() < 1e-9);
    assert!(mean > 5.0 && rmse >= mean && rmse < 15.0, "{rmse} {mean}");
    let coarse = common.replace("--refine 1", "--refine 0");
    let output = place.eplat(&format!("{coarse} --compare a/beat.vtp --out c"));
    assert!(self::said(&output).contains("it is of another mesh"), "{}", self::said(&output));
}

#[test]
fn the_library_simulates_the_same_in_memory_and_can_be_stopped() {
    let place = place();
    succeeds(
        &place,
        "simulate atrium --fields fields.vtp --refine 1 --pace 0 --beats 1 --last 90 --out a",
    );
    let there = Beat::read(&place.path("a")).unwrap();
    let settings = AtriumSettings {
        tissue: TissueSettings { refine: 1, ..TissueSettings::default() },
        pacing: PacingSettings { pace: vec![0], beats: 1, last: 90.0, ..PacingSettings::default() },
        ..AtriumSettings::default()
    };
    let ground = Ground::read(&place.path("fields.vtp"), Units::Mm).unwrap();
    let atrium = Atrium::new(ground, &settings).unwrap();
    let last = Mutex::new(0.0);
    let hears = |event: Event<'_>| {
        if let Event::Time(time) = event {
            *last.lock().unwrap() = time;
        }
    };
    let watch = Watch { on_event: &hears, ..Watch::default() };
    let here = atrium.simulate(watch).unwrap().unwrap();
    assert!((*last.lock().unwrap() - atrium.total_time()).abs() < 1e-9);
    let bits = |maps: &[(String, Vec<f64>)]| -> BTreeMap<String, Vec<u64>> {
        let map = |(name, values): &(String, Vec<f64>)| {
            (name.clone(), values.iter().map(|x| x.to_bits()).collect())
        };
        maps.iter().map(map).collect()
    };
    assert!(bits(&here.maps) == bits(&there.maps));
    assert_eq!(here.record.summary, there.record.summary);
    assert_eq!(here.record.settings, there.record.settings, "options and settings are the same");
    let stopped = Watch { stop: &AtomicBool::new(true), ..Watch::default() };
    assert!(atrium.simulate(stopped).unwrap().is_none());
}

#[test]
fn bad_input_is_named_and_nothing_is_left_behind() {
    let place = place();
    let fails = |more: &str| {
        let output = place.eplat(&format!("simulate atrium --fields fields.vtp --out beat {more}"));
        assert_ne!(output.status.code(), Some(0), "{more}");
        assert!(!place.path("beat").exists());
        said(&output)
    };
    let cases = [
        ("--pace 130", "--pace 130 is no vertex of the surface, which has 130"),
        ("--pace 0,130", "--pace 130 is no vertex"),
        ("--pace-region region=7", "no vertex has this value; the lowest are [0.0, 1.0]"),
        ("--pace-region rim=1", "no data rim; it has: apd_max_mean, fib_0"),
        ("--pace-region region", "expected NAME=VALUE"),
        ("--pace 0 --pace-region region=1", "cannot be used with"),
        ("--beats 1", "--pace <VERTEX>"),
        ("--pace 0 --apd-max apd", "it has: apd_max_mean, fib_0"),
        (
            "--pace 0 --tau-out 50",
            "vertex 0: tau_out = 50 ms is outside its valid range 1 to 30 ms",
        ),
        ("--pace 0 --measure 9", "there is no beat 9 among 8"),
        ("--pace 0 --measure 0", "0 is not in 1.."),
        ("--pace 0 --beats 0", "0 is not in 1.."),
        ("--pace 0 --extra 0.1", "do not fit"),
        ("--pace 0 --dt 0", "time step"),
        ("--pace 0 --snapshots 0", "--snapshots"),
        ("--pace 0 --units furlong", "unknown unit"),
        ("--pace 0 --fibres fib", "--anisotropy <R>"),
        ("--pace 0 --fibres region --anisotropy 2", "has no vectors of this name"),
        ("--pace 0 --fibres up --anisotropy 2", "leaves the surface at 90°"),
        ("--pace 0 --fibres fib --anisotropy 0.5", "an anisotropy of 0.5"),
        ("--pace 0 --compare none.vtp", "none.vtp"),
        ("--pace 0 --compare fields.vtp", "it has no map lat"),
        ("--pace 0 --draws 5", "cannot be used with"),
        ("--pace 0 --checkpoint-every nan", "--checkpoint-every: expected seconds"),
        ("--pace 0 --resume", "no interrupted run in beat/checkpoint"),
    ];
    for (more, expected) in cases {
        let said = fails(more);
        assert!(said.contains(expected), "{more}: {said}");
    }
}

/// The numbers of a file of openCARP with one number behind each node.
fn nodal(place: &Workplace, file: &str) -> Vec<f64> {
    let text = place.read(file);
    let mut lines = text.lines();
    let n: usize = lines.next().unwrap().parse().unwrap();
    assert_eq!(lines.next(), Some("intra"));
    let number = |(node, line): (usize, &str)| {
        let (own, value) = line.split_once(' ').unwrap();
        assert_eq!(own, node.to_string());
        value.parse().unwrap()
    };
    let values: Vec<f64> = lines.enumerate().map(number).collect();
    assert_eq!(values.len(), n);
    values
}

#[test]
fn a_calibrated_atrium_goes_out_as_files_of_opencarp() {
    let place = place();
    // the fields of a run, with two draws of one of them
    fs::create_dir(place.path("run")).unwrap();
    fs::copy(place.path("fields.vtp"), place.path("run/fields.vtp")).unwrap();
    let sheet = mesh::read(&place.path("fields.vtp"), Units::Mm).unwrap();
    let n = sheet.mesh.n_vertices();
    let draws = FieldDraws {
        n_modes: 1,
        eigenfunctions: (0..n).map(|v| v as f64 / n as f64).collect(),
        coefficients: BTreeMap::from([("tau_out".into(), vec![8.0, 1.0, 28.0, 4.0])]),
        within: BTreeMap::new(),
    };
    draws.write(&place.path("run/field_draws.npz")).unwrap();
    let arguments = "export --run run --draws 2 --refine 1 --cv-max 0.5 --out carp";
    let output = place.eplat(arguments);
    let told = String::from_utf8(output.stdout.clone()).unwrap();
    assert!(output.status.success(), "{}", said(&output));
    let atrium = mesh::read(&place.path("carp/atrium.pts"), None).unwrap();
    let fine = atrium.mesh.n_vertices();
    assert!(told.starts_with(&format!("wrote carp: {fine} nodes, the mean and 2 draws")), "{told}");
    assert!((atrium.mesh.area() / sheet.mesh.area() - 1.0).abs() < 1e-9);
    // APD_max = tau_close ln(1 + tau_out (1 − V_gate)²/(4 tau_in)), at a node of the file
    let apd_max = sheet.point_data["apd_max_mean"].values();
    let set = |set: &str| {
        ["tau_in", "tau_out", "tau_open", "tau_close"]
            .map(|name| nodal(&place, &format!("carp/{set}/mMS.{name}")))
    };
    for folder in ["mean", "draw_001", "draw_002"] {
        let [tau_in, tau_out, tau_open, tau_close] = set(folder);
        assert_eq!((tau_in[7], tau_open[7], tau_in.len()), (0.05, 120.0, fine));
        let duration = tau_close[7] * (1.0 + tau_out[7] * 0.81 / (4.0 * 0.05)).ln();
        assert!((duration - apd_max[7]).abs() < 1e-9, "{folder}: {duration}");
    }
    let drawn = set("draw_001")[1][7];
    assert!((drawn - (8.0 + 7.0 / n as f64)).abs() < 1e-12, "{drawn}");
    // 28 to 32 ms: above 30 the nearest that is allowed
    assert!(set("draw_002")[1].iter().all(|tau_out| *tau_out <= 30.0));
    assert!(
        told.contains(
            "% of the nodes, of the mean and all draws, had a parameter outside its range"
        ),
        "{told}"
    );
    // D = tau_in/2 (CV/0.4)² = 0.0390625 mm²/ms is 0.390625 S/m, twice of which counts by half
    let par = place.read("carp/mean/mMS.par");
    assert!(par.contains("gregion[0].g_il = 0.78125\n"), "{par}");
    assert!(par.contains("adjustment[3].variable = \"mMS.tau_close\"\n"), "{par}");
    for (more, expected) in [
        ("--out carp", "carp: it exists"),
        ("--cv-max tau_out_mean --out other", "--cv-max is a field"),
        ("--draws 3 --out other", "the run kept 2 draws"),
    ] {
        let output = place.eplat(&format!("export --run run {more}"));
        assert!(said(&output).contains(expected), "{}", said(&output));
        assert!(!place.path("other").exists());
    }
}

#[test]
fn a_cell_leaves_its_trace_and_restitution() {
    let place = Workplace::new();
    let said = succeeds(&place, "simulate cell --beats 2 --s2 150,300,450,600 --out cell");
    assert!(said.contains("2 S1 beats; 3 of 4 S2 beats captured"), "{said}");
    let trace = place.read("cell/trace.csv");
    assert_eq!(trace.lines().count(), 1 + 12_001);
    assert!(trace.starts_with("time_ms,v,h\n0.0,0,1\n"));
    let table = place.read("cell/restitution.csv");
    let mut rows = csv::Reader::from_reader(table.as_bytes());
    let rows: Vec<csv::StringRecord> = rows.records().map(Result::unwrap).collect();
    assert_eq!([&rows[0][0], &rows[0][5]], ["150", ""], "not captured");
    let apd90: Vec<f64> = rows[1..].iter().map(|row| row[5].parse().unwrap()).collect();
    assert!(apd90.is_sorted() && apd90[0] > 120.0 && apd90[2] < 260.0, "{apd90:?}");
    for svg in ["cell/trace.svg", "cell/restitution.svg"] {
        assert!(place.read(svg).starts_with("<svg xmlns="));
    }
    for (more, expected) in [
        ("--tau-out 40", "tau_out = 40 ms is outside its valid range"),
        ("--s2 700", "--s2 700 is not between 1 ms and the S1 interval"),
        ("--strength 0", "excites nothing"),
        ("--s1 0", "--s1 0 is no interval"),
    ] {
        let output = place.eplat(&format!("simulate cell --out none {more}"));
        assert!(!output.status.success() && !place.path("none").exists(), "{more}");
        assert!(self::said(&output).contains(expected), "{more}: {}", self::said(&output));
    }
}
