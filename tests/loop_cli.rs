//! `eplat loop` end to end: what it finds, what it writes, what it refuses.
//!
//! The texts are snapshots: `INSTA_UPDATE=always cargo test --release --test loop_cli`, read as a newcomer would.

#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/picture.rs"]
mod picture;
#[path = "support/program.rs"]
mod program;
#[path = "support/studies.rs"]
mod studies;

use std::fmt::Write as _;

use program::{Workplace, text};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use serde_json::Value;

/// Vertices along each edge of the sheet, 5 mm apart.
const SIDE: usize = 9;

/// A flat sheet as legacy VTK.
fn sheet() -> String {
    let mut points = String::new();
    for i in 0..SIDE * SIDE {
        let _ = writeln!(points, "{} {} 0", 5 * (i % SIDE), 5 * (i / SIDE));
    }
    let mut triangles = String::new();
    for (i, j) in (0..SIDE - 1).flat_map(|i| (0..SIDE - 1).map(move |j| (i, j))) {
        let v = j * SIDE + i;
        let _ = writeln!(triangles, "3 {v} {} {}", v + 1, v + SIDE);
        let _ = writeln!(triangles, "3 {} {} {}", v + 1, v + SIDE + 1, v + SIDE);
    }
    let (n, m) = (SIDE * SIDE, 2 * (SIDE - 1) * (SIDE - 1));
    format!(
        "# vtk DataFile Version 3.0\nsheet\nASCII\nDATASET POLYDATA\nPOINTS {n} double\n{points}POLYGONS {m} {}\n{triangles}",
        4 * m
    )
}

/// Brackets at two of three vertices for training, at the others held out: a smooth field, `force` ms per sd of
/// contact force, and a further error of 40 ms of each seventh if there are outliers; columns that do nothing beside it.
fn tables(force: f64, has_outliers: bool) -> [String; 2] {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let header = "site,vertex,protocol,lower,upper,force_g,catheter,wall_mm,constant,void\n";
    let mut tables = [header.to_owned(), header.to_owned()];
    for vertex in 0..SIDE * SIDE {
        let mut normal = || rng.sample::<f64, _>(StandardNormal);
        let (contact, wall, noise) = (normal(), normal(), normal());
        let catheter = ["A", "B"][usize::from(normal() > 0.0)];
        let (x, y) = ((vertex % SIDE) as f64, (vertex / SIDE) as f64);
        let field = 90.0 + 10.0 * (0.5 * x).sin() + 8.0 * (0.4 * y).cos();
        let further = if has_outliers && vertex % 7 == 3 { 40.0 } else { 0.0 };
        let error = (2.0 + further) * noise;
        let lower = 10.0 * ((field + force * contact + error) / 10.0).floor();
        let _ = writeln!(
            tables[usize::from(vertex % 3 == 2)],
            "{vertex},{vertex},S1S2,{lower},{},{:.2},{catheter},{:.2},4,",
            lower + 10.0,
            15.0 + 5.0 * contact,
            2.0 + 0.5 * wall
        );
    }
    tables
}

/// A folder with the shipped model, the sheet and both tables.
fn workplace(force: f64, has_outliers: bool) -> Workplace {
    let place = Workplace::new();
    let [train, heldout] = tables(force, has_outliers);
    place
        .file("recovery.rs", include_str!("../models/recovery.rs"))
        .file("sheet.vtk", sheet())
        .file("data/train.csv", train)
        .file("heldout.csv", heldout);
    place
}

const ON: &str = "--mesh sheet.vtk --units mm --data data/train.csv";

fn finding(place: &Workplace, out: &str) -> Value {
    serde_json::from_str(&place.read(&format!("{out}/finding.json"))).unwrap()
}

#[test]
fn a_hidden_effect_is_found_written_and_told() {
    let place = workplace(-12.0, false);
    let data = place.path("data/train.csv");
    let arguments = format!(
        "loop recovery.rs --mesh sheet.vtk --units mm --data {} --heldout heldout.csv --nulls 39 --out loop",
        data.display()
    );
    let output = place.eplat(&arguments);
    let (stdout, stderr) = (text(&output.stdout), text(&output.stderr));
    assert!(matches!(output.status.code(), Some(0 | 3)), "{stderr}");
    assert!(stderr.contains("search round 1: 39 searches on simulated data"), "{stderr}");
    assert!(stdout.contains("Recovery lacks an effect of force_g on recovery."), "{stdout}");
    for line in ["not tried constant: it has one value only", "not tried void: every cell is empty"]
    {
        assert!(stdout.contains(line), "{stdout}");
    }

    let finding = finding(&place, "loop");
    assert_eq!(finding["findings"], serde_json::json!(["force_g"]));
    let interval = finding["effect_interval"]["force_g"].as_array().unwrap();
    let [low, high] = [0, 1].map(|i| interval[i].as_f64().unwrap());
    assert!(low < -9.0 && high > -15.0 && high < -6.0, "{low} {high}");
    for what in ["heldout", "leave_one_site_out"] {
        let of = |name: &str| finding[what][name].as_f64().unwrap();
        assert!(of("rmse_after") < of("rmse_before"), "{what}: {}", finding[what]);
        assert!(of("elpd_gain") > 2.0 * of("elpd_gain_se"), "{what}: {}", finding[what]);
    }
    assert_eq!(place.read("loop/heldout_predictions.csv").lines().count(), 1 + SIDE * SIDE / 3);

    // nothing of the folders on this machine in what is passed on
    let (model, page) =
        (place.read("loop/recovery_plus_force_g.rs"), place.read("loop/report.html"));
    let folder = place.path("data");
    for told in [&model, &page, &place.read("loop/finding.json")] {
        assert!(!told.contains(folder.to_str().unwrap()), "{told}");
    }
    assert!(model.contains("/// Found by `eplat loop` in train.csv: log Bayes factor "), "{model}");
    the_page_tells(&page);

    the_pictures_are_whole(&place);

    // the file runs by itself, to the same fit
    let again = place.eplat(&format!("run loop/recovery_plus_force_g.rs {ON} --out again"));
    assert!(matches!(again.status.code(), Some(0 | 3)), "{}", text(&again.stderr));
    let summary = |file: &str| -> Value { serde_json::from_str(&place.read(file)).unwrap() };
    let (after, again) = (summary("loop/after/summary.json"), summary("again/summary.json"));
    let furthest = furthest_apart(&after, &again);
    assert!(furthest < 4.5, "{furthest} standard errors apart");
    let before = summary("loop/declared/summary.json");
    assert!(furthest_apart(&before, &again) > 4.5, "another model passes for the same");
}

/// The curve of the effect, and residuals before and after: by site, and on the sheet.
fn the_pictures_are_whole(place: &Workplace) {
    let drawn = place.eplat("plot loop");
    assert!(drawn.status.success(), "{}", text(&drawn.stderr));
    let names = picture::checked(&place.path(""), &text(&drawn.stdout));
    assert_eq!(names, ["effect", "residuals", "residuals_map"]);
    for (name, says) in [("effect", "force_g"), ("residuals", "after"), ("residuals_map", "after")]
    {
        assert!(place.read(&format!("loop/figures/{name}.svg")).contains(says), "{name}");
    }
}

/// What `eplat loop` leaves in `loop` of a study, and what it prints.
fn closed(scenario: studies::Scenario, seed: u64) -> (Workplace, String) {
    let study = studies::study(&studies::Heart::new(), scenario, seed);
    let place = Workplace::new();
    place
        .file("erp.rs", include_str!("../models/erp.rs"))
        .file("train.csv", study.train.to_csv())
        .file("heldout.csv", study.heldout.to_csv());
    place.eplat("mesh atrium --edge 2 --out atrium.vtk");
    let on = "--mesh atrium.vtk --units mm --data train.csv";
    let output =
        place.eplat(&format!("loop erp.rs {on} --heldout heldout.csv --nulls 19 --out loop"));
    let stderr = text(&output.stderr);
    assert!(matches!(output.status.code(), Some(0 | 3)), "{stderr}");
    (place, text(&output.stdout))
}

/// Different tissue differs in every field: one finding, an effect on each.
#[test]
fn a_patch_is_written_with_an_effect_on_every_field() {
    let (place, stdout) = closed(studies::Scenario::Patch, 111);
    let lacks = "Erp lacks an effect of dist_scar_mm on apd_max and tau_out.";
    assert!(stdout.contains(lacks), "{stdout}");
    let finding = finding(&place, "loop");
    assert_eq!(finding["findings"], serde_json::json!(["patch"]));
    let names: Vec<&String> = finding["effect_interval"].as_object().unwrap().keys().collect();
    assert_eq!(names, ["patch", "patch_tau_out"]);
    let of = |name: &str| finding["heldout"][name].as_f64().unwrap();
    assert!(of("rmse_after") < of("rmse_before"), "{}", finding["heldout"]);
    // as it was tried, and as it is claimed
    let tried = finding["tried"].as_array().unwrap();
    let taken = tried.iter().find(|t| t["verdict"] == "found").unwrap();
    assert!(taken["form"].as_str().unwrap().starts_with("above(row.dist_scar_mm, "), "{taken}");
    let shown = text(&place.eplat("show loop/erp_plus_patch.rs").stdout);
    for effect in ["patch on apd_max", "patch_tau_out on tau_out"] {
        let statement = format!("effect {effect} [ms] = logistic(row.dist_scar_mm, ");
        assert!(place.read("loop/erp_plus_patch.rs").contains(&statement), "{statement}");
        assert!(shown.contains(effect.split(' ').next().unwrap()), "{shown}");
    }
    let page = place.read("loop/report.html");
    assert!(page.contains(&format!("<h1>{lacks}</h1>")));
    assert!(page.contains("above(dist_scar_mm, "), "the form that was tried");
    sites_differ_in_what_is_claimed(&place, "loop/erp_plus_patch.rs", &finding);
}

/// The model that is written lets sites and brackets differ, so that its intervals hold what they say, and those
/// of the model as written hold less.
fn sites_differ_in_what_is_claimed(place: &Workplace, file: &str, finding: &Value) {
    let model = place.read(file);
    for statement in [
        "/// Added by `eplat loop`: what each site differs by, for reasons that no column tells.",
        "param site_sd [ms] ~ HalfNormal(10.0);",
        "effect site_difference on erp_s2, erp_s3 [ms] = group(row.site) ~ Normal(0.0, site_sd);",
        "param row_error [ms] ~ HalfNormal(10.0);",
        "~ Widened(TopHat(erp_s2(x)), row_error);",
    ] {
        assert!(model.contains(statement), "{statement}\n{model}");
    }
    let held_out = &finding["heldout"];
    let of = |name: &str| held_out[name].as_f64().unwrap();
    // 60 sites: three binomial errors
    let (lowest, highest) = (0.9 - 3.0 * 0.0387, 0.9 + 2.6 * 0.0387);
    assert!((lowest..=highest).contains(&of("coverage90_after")), "{held_out}");
    assert!(of("coverage90_declared") < of("coverage90_after"), "{held_out}");
    assert!(of("elpd_gain").abs() < 200.0, "a number that one row makes: {held_out}");
    assert!(finding["fits"]["declared"]["questions"].is_array(), "{}", finding["fits"]);
    // what one site makes of it is said
    assert!(held_out.get("more_than_half_of_the_gain").is_some());
}

/// Scatter of one catheter: the model that is written has an error that goes with the catheter, and runs to the same fit.
#[test]
fn scatter_is_written_as_an_error_that_goes_with_its_column() {
    let (place, stdout) = closed(studies::Scenario::HeteroCatheter, 301);
    assert!(stdout.contains("Erp lacks scatter that goes with catheter (errors "), "{stdout}");
    let finding = finding(&place, "loop");
    assert_eq!(finding["findings"], serde_json::json!(["hetero(catheter)"]));
    let file = "loop/erp_plus_hetero_catheter.rs";
    let model = place.read(file);
    for statement in [
        "let ln_scatter(row) = 0.0;",
        "~ Widened(TopHat(erp_s2(x)), row_error * exp(ln_scatter(x)));",
        "effect hetero_catheter on ln_scatter = group(row.catheter) ~ Normal(0.0, 1.0);",
    ] {
        assert!(model.contains(statement), "{statement}\n{model}");
    }
    // ln of the factor between two catheters: that of 20 ms against 3.5 is 1.7
    let interval = &finding["effect_interval"]["hetero(catheter)"];
    let [low, high] = [0, 1].map(|end| interval[end].as_f64().unwrap());
    assert!(low > 0.0 && low < 1.7 && high > 1.0, "{interval}");
    assert!(finding["heldout"]["elpd_gain"].as_f64().unwrap() > 0.0, "{}", finding["heldout"]);
    let on = "--mesh atrium.vtk --units mm --data train.csv";
    let again = place.eplat(&format!("run {file} {on} --out again"));
    assert!(matches!(again.status.code(), Some(0 | 3 | 4)), "{}", text(&again.stderr));
    let summary = |file: &str| -> Value { serde_json::from_str(&place.read(file)).unwrap() };
    let [after, again, before] =
        ["loop/after", "again", "loop/before"].map(|at| summary(&format!("{at}/summary.json")));
    let furthest = furthest_apart(&after, &again);
    assert!(furthest < 4.5, "{furthest} standard errors apart");
    assert!(furthest_apart(&before, &again) > 4.5, "another model passes for the same");
}

/// No column tells what sites differ by, so that the intervals of the model as written are too narrow.
#[test]
fn intervals_that_are_too_narrow_are_told_and_mended() {
    let (place, stdout) = closed(studies::Scenario::Outside, 7);
    let finding = finding(&place, "loop");
    assert_eq!(finding["findings"], serde_json::json!([]));
    assert!(stdout.contains("narrow    as written, "), "{stdout}");
    assert!(stdout.contains("allowed   sites differ by "), "{stdout}");
    assert!(finding["as_written_too_narrow"].is_string(), "{finding}");
    sites_differ_in_what_is_claimed(&place, "loop/erp_plus_discrepancy.rs", &finding);
    let page = place.read("loop/report.html");
    assert!(page.contains("As written its intervals are too narrow"));
    assert!(page.contains("before/report.html"));
    // nothing of what was tried is hidden
    let tried = finding["tried"].as_array().unwrap();
    assert!(tried.iter().all(|t| !t["verdict"].as_str().unwrap().is_empty()));
    for record in tried {
        assert!(page.contains(record["effect"].as_str().unwrap()), "{record}");
    }
}

#[test]
fn outliers_are_found_written_and_sampled() {
    let place = workplace(0.0, true);
    let output =
        place.eplat(&format!("loop recovery.rs {ON} --heldout heldout.csv --nulls 19 --out loop"));
    let (stdout, stderr) = (text(&output.stdout), text(&output.stderr));
    assert!(matches!(output.status.code(), Some(0 | 3)), "{stderr}");
    let finding = finding(&place, "loop");
    assert_eq!(finding["findings"], serde_json::json!(["outliers"]), "{stdout}");
    assert!(stdout.contains("Recovery lacks room for outliers ("), "{stdout}");
    let of = |name: &str| finding["heldout"][name].as_f64().unwrap();
    assert!(of("elpd_gain") > of("elpd_gain_se"), "{}", finding["heldout"]);
    let model = place.read("loop/recovery_plus_outliers.rs");
    assert!(model.contains("~ Outliers(Interval(recovery(x), noise), 0."), "{model}");
    assert!(place.read("loop/report.html").contains("Outliers("));
    // what was sampled is what the file says
    let shown = place.eplat("show loop/recovery_plus_outliers.rs");
    assert!(text(&shown.stdout).contains("Outliers(Interval(recovery(x), noise), 0."));
}

/// The greatest difference of two fits' means that both report, in Monte Carlo standard errors.
fn furthest_apart(a: &Value, b: &Value) -> f64 {
    let number = |of: &Value, name: &str| of[name].as_f64().unwrap();
    let apart = |(name, a): (&String, &Value)| {
        let b = b.get(name)?;
        let error = number(a, "mcse").hypot(number(b, "mcse"));
        Some((number(a, "mean") - number(b, "mean")).abs() / error)
    };
    a.as_object().unwrap().iter().filter_map(apart).fold(0.0, f64::max)
}

/// The story in order, the answer first, without anything from elsewhere.
fn the_page_tells(page: &str) {
    let story = [
        "<h1>Recovery lacks an effect of force_g on recovery.</h1>",
        "90 % interval",
        "The model as written",
        "What it leaves over",
        "aria-label=\"residuals before\"",
        "What was tried",
        "The model with it",
        "<mark>  force_g [ms]",
        "Before and after",
        "class=\"band\"",
        "class=\"curve\"",
        "aria-label=\"residuals after\"",
        "What is still unexplained",
        "Columns not tried",
        "<dt>void<dd>every cell is empty",
        "not a left atrium",
    ];
    let mut rest = page;
    for part in story {
        let at = rest.find(part).unwrap_or_else(|| panic!("no `{part}` in its place"));
        rest = &rest[at..];
    }
    assert!(
        !page.contains("http:") && !page.contains("https:") && !page.contains("<script"),
        "it needs something from elsewhere"
    );
    assert!(!page.contains("NaN") && !page.contains("{{"), "a hole");
}

#[test]
fn where_nothing_is_missing_nothing_is_claimed() {
    let place = workplace(0.0, false);
    let output = place.eplat(&format!("loop recovery.rs {ON} --nulls 19 --json --out loop"));
    assert!(matches!(output.status.code(), Some(0 | 3)), "{}", text(&output.stderr));
    let mut finding = finding(&place, "loop");
    // what is printed is no record of files
    assert!(finding.as_object_mut().unwrap().remove("files").is_some());
    assert_eq!(finding, serde_json::from_slice::<Value>(&output.stdout).unwrap());
    let told = text(&output.stderr);
    let told: Vec<Value> = told.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let mut searches = told.iter().filter(|event| event["event"] == "search");
    assert_eq!(searches.next_back().unwrap()["done"], 19);
    assert!(told.iter().any(|event| event["event"] == "sample" && event["which"] == "declared"));
    assert_eq!(finding["findings"], serde_json::json!([]));
    assert_eq!(finding["heldout"], Value::Null);
    let left = &finding["leave_one_site_out"];
    assert_eq!(left["rmse_before"], left["rmse_after"]);
    let page = place.read("loop/report.html");
    assert!(page.contains("<h1>Nothing is missing from Recovery that these data could show.</h1>"));
    assert!(page.contains("measurements, each site predicted from the others"));
    let files = ["declared", "finding.json", "report.html"];
    let mut written: Vec<String> = std::fs::read_dir(place.path("loop"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    written.sort();
    assert_eq!(written, files);
}

/// What a command says that is refused before anything is searched.
fn refused(place: &Workplace, arguments: &str) -> String {
    let output = place.eplat(arguments);
    let (code, stderr) = (output.status.code(), text(&output.stderr));
    assert!(matches!(code, Some(1 | 2)), "{arguments}: {code:?}\n{stderr}");
    assert!(!stderr.contains("search round") && !stderr.contains("panicked"), "{stderr}");
    assert!(!place.path("out").exists(), "{arguments} leaves files behind");
    let error = &stderr[stderr.rfind("error: ").unwrap()..];
    assert!(error.contains("help: ") || error.contains("'--help'"), "{error}");
    format!("$ eplat {arguments}\nexit {}\n{error}", code.unwrap())
}

#[test]
fn what_cannot_be_criticised_is_refused_at_once() {
    let place = workplace(0.0, false);
    let lines = |of: &str, n: usize| of.lines().take(n).collect::<Vec<_>>().join("\n");
    let [train, heldout] = tables(0.0, false);
    place
        .file("few.csv", lines(&train, 8))
        .file("same.csv", lines(&train, 3))
        .file("other.csv", heldout.replacen("S1S2", "S1S2S3", 3))
        .file("off.csv", heldout.replacen("2,2,S1S2", "2,9999,S1S2", 1))
        .file("normal.rs", include_str!("../models/normal.rs"))
        .file("y.csv", "y\n1\n2\n3\n4\n5\n6\n7\n8\n9\n10\n11\n");
    let sheet = "--mesh sheet.vtk --units mm";
    let commands = [
        "loop recovery.rs".to_owned(),
        format!("loop recovery.rs {ON} --nulls 5"),
        format!("loop recovery.rs {ON} --rounds 2"),
        format!("loop recovery.rs {ON} --column catheter=tool"),
        format!("loop recovery.rs {ON} --column cathether=unit"),
        format!("loop recovery.rs {sheet} --data few.csv"),
        format!("loop recovery.rs {sheet} --data other.csv"),
        format!("loop recovery.rs {ON} --heldout same.csv"),
        format!("loop recovery.rs {ON} --heldout other.csv"),
        format!("loop recovery.rs {ON} --heldout off.csv"),
        format!("loop recovery.rs {ON} --heldout missing.csv"),
        "loop normal.rs --data y.csv".to_owned(),
    ];
    let said: Vec<String> = commands.iter().map(|c| refused(&place, c)).collect();
    insta::assert_snapshot!(said.join("\n"));
}
