//! The report is one whole file: it loads nothing, holds the numbers it was given, and draws itself in a browser.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "tests")]

#[path = "report_html/packed.rs"]
mod packed;
#[path = "support/skipped.rs"]
mod skipped;
#[path = "report_html/viewer.rs"]
mod viewer;

use eplat::diagnostics::Summary;
use eplat::diagnostics::verdict::{Questions, Verdict};
use eplat::mesh::{Axes, TriMesh};
use eplat::report::{
    Group, LeaveOneOut, LeftOutBy, LooRecord, LooRow, Page, PointData, Predicted, PredictedRow,
    Predictions, Provenance, ReportError, Row, RunRecord, Seconds, SettingsRecord, Surface,
    Variable, write_html, write_rows,
};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;
use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};
use std::path::Path;

const N_ARRAYS: usize = 12;

/// A bent tube open at both ends, about the size of an atrium: 100 × 50 vertices.
fn mesh() -> TriMesh {
    let (around, along) = (100_u32, 50_u32);
    let mut vertices = Vec::new();
    for j in 0..along {
        for i in 0..around {
            let (angle, height) =
                (TAU * f64::from(i) / f64::from(around), f64::from(j) / f64::from(along - 1));
            let r = 12.0 + 14.0 * (PI * height).sin() + 1.5 * (3.0 * angle).sin();
            vertices.push([
                r * angle.cos() + 10.0 * height * height,
                0.8 * r * angle.sin(),
                70.0 * height - 35.0,
            ]);
        }
    }
    let mut triangles = Vec::new();
    for j in 0..along - 1 {
        for i in 0..around {
            let [a, b] = [i, (i + 1) % around].map(|i| j * around + i);
            triangles.extend([[a, b, a + around], [b, b + around, a + around]]);
        }
    }
    TriMesh::new(vertices, triangles).unwrap()
}

fn row(name: &str, unit: &str, mean: f64, r_hat: f64) -> Row {
    let sd = 0.1 * mean;
    let (q5, q95) = (mean - 1.6 * sd, mean + 1.6 * sd);
    let (mcse, ess_bulk, ess_tail) = (sd / 40.0, 1600.0, 1512.0);
    let [mcse_sd, mcse_q50] = [mcse; 2];
    let [mcse_q5, mcse_q95] = [2.0 * mcse; 2];
    let summary = Summary {
        mean,
        sd,
        mcse,
        q5,
        q50: mean,
        q95,
        ess_bulk,
        ess_tail,
        r_hat,
        mcse_sd,
        mcse_q5,
        mcse_q50,
        mcse_q95,
    };
    Row { name: name.to_owned(), unit: unit.to_owned(), summary }
}

fn record() -> RunRecord {
    let (sampler, metric) = ("nuts".to_owned(), "diag".to_owned());
    RunRecord {
        model: "Erp".to_owned(),
        version: "0.1.0".to_owned(),
        seed: 1,
        provenance: Provenance {
            mesh: Some("patient <7>/atrium.vtk".to_owned()),
            n_vertices: 5166,
            data: "brackets.csv".to_owned(),
            n_rows: 20,
            n_sites: 10,
            command: "eplat run models/erp.rs --data brackets.csv".to_owned(),
            date: "2026-11-22".to_owned(),
            ..Provenance::default()
        },
        settings: SettingsRecord {
            sampler,
            chains: 4,
            warmup: 1000,
            draws: 1000,
            most_draws: None,
            target_accept: Some(0.95),
            metric,
        },
        hashes: BTreeMap::from([("mesh".to_owned(), "5f".repeat(32))]),
        files: BTreeMap::new(),
        n_params: 54,
        grad_evals: 901_234,
        ns_per_grad: 1830.5,
        sampler_ns_per_grad: 410.25,
        seconds: Seconds { compile: 0.0, setup: 1.25, warmup: 2.0, sampling: 2.5, total: 5.75 },
        failed_chains: vec![],
        divergences: 3,
        max_r_hat: 1.004,
        min_ess_bulk: 1600.0,
        min_ess_tail: 1512.0,
        ess_per_second: 355.0,
        e_bfmi: 0.83,
        rmse: Some(BTreeMap::from([("tau_out".to_owned(), 2.25), ("apd_max".to_owned(), 14.5)])),
        coverage: None,
        units: BTreeMap::new(),
        unphysical: None,
        divergent_at: vec![],
        strays: None,
        not_simulated: vec![],
        loo: None,
        laplace: None,
        questions: Questions::default(),
        verdict: Verdict::default(),
    }
}

/// Six scalar parameters of 4 × 1000 draws; the last one with a heavy tail and a chain apart from the others.
fn posterior() -> Group {
    let stream = &mut ChaCha8Rng::seed_from_u64(1);
    let names =
        ["tau_out.m", "tau_out.alpha", "tau_out.rho", "apd_max.m", "apd_max.alpha", "apd_max.rho"];
    let variables = names.iter().enumerate().map(|(k, name)| {
        let mut state = 0.0;
        let draws: Vec<f64> = (0..4000)
            .map(|i| {
                state = 0.9 * state + stream.random::<f64>() - 0.5;
                let shift = if k == 5 && i >= 3000 { 1.5 } else { 0.0 };
                if k == 5 { (1.5 * state + shift).exp() } else { 10.0 + state }
            })
            .collect();
        Variable::new(*name, "mm", &[("chain", 4), ("draw", 1000)], draws)
    });
    Group { name: "posterior".to_owned(), variables: variables.collect() }
}

/// Twelve arrays of which the first has vertices without a value.
fn arrays(mesh: &TriMesh) -> Vec<(String, Vec<f64>)> {
    let names = ["tau_out", "apd_max", "erp_s2", "erp_s3"];
    let name = |k: usize| format!("{}_{}", names[k % 4], ["mean", "sd", "true"][k / 4]);
    let value = |k: usize, [x, y, z]: [f64; 3]| {
        let k = k as f64;
        if k == 0.0 && x > 25.0 {
            f64::NAN
        } else {
            12.0 + k + 5.0 * (0.05 * x + k).sin() * (0.08 * z + 0.05 * y).cos()
        }
    };
    (0..N_ARRAYS)
        .map(|k| (name(k), mesh.vertices().iter().map(|&at| value(k, at)).collect()))
        .collect()
}

/// Three measurements, of which the second is hard to predict and the third cannot be judged.
fn leave_one_out() -> LeaveOneOut {
    let row = |(site, pareto_k): (usize, f64)| LooRow {
        measurement: "s1s2".to_owned(),
        place: format!("at site {site} <roof>"),
        likelihood: "TopHat".to_owned(),
        observed: "240 250".to_owned(),
        elpd: -2.5,
        pareto_k,
        loo_by: LeftOutBy::Weights,
    };
    let record = LooRecord {
        elpd_loo: -7.5,
        se: 0.5,
        p_loo: 2.0,
        n_measurements: 3,
        k_threshold: 0.7,
        n_high_k: 2,
        n_integrated: 0,
        n_left_out: 0,
        worst: vec!["s1s2 at site 3 <roof> (inf)".to_owned()],
    };
    let rows = [(1, 0.25), (2, 0.81), (3, f64::INFINITY)].map(row).to_vec();
    LeaveOneOut { record, rows }
}

/// Brackets whose intervals hold them, but for every tenth.
fn predictions(n: usize) -> Predictions {
    let row = |i: usize| {
        let lower = 200.0 + 10.0 * (i % 8) as f64;
        let median = lower + 5.0 + 3.0 * (i as f64).sin() + if i % 10 == 9 { 60.0 } else { 0.0 };
        let quantiles = [median - 12.0, median, median + 12.0];
        let fitted = Predicted { quantiles, inside: [i % 10 != 9; 4] };
        PredictedRow {
            line: i as u64 + 2,
            protocol: if 2 * i < n { "s1s2" } else { "s1s2s3" }.to_owned(),
            site: format!("{} <roof>", i / 2),
            unit: "ms".to_owned(),
            measured: [lower, lower + 10.0],
            left_out: i.is_multiple_of(2).then(|| (fitted.clone(), LeftOutBy::Weights)),
            fitted,
        }
    };
    let sets = vec![
        ("all".to_owned(), (0..n).collect()),
        ("s1s2".to_owned(), (0..n.div_ceil(2)).collect()),
        ("s1s2s3".to_owned(), (n.div_ceil(2)..n).collect()),
    ];
    Predictions { rows: (0..n).map(row).collect(), sets }
}

/// Names of files that are written beside the page.
const FILES: [&str; 3] = ["rows.csv", "fields.vtp", "run.json"];

fn write(path: &Path, title: &str, arrays: &[(String, Vec<f64>)]) -> Result<(), ReportError> {
    write_with(path, title, arrays, 20)
}

/// The page of a run with this many measurements.
fn write_with(
    path: &Path,
    title: &str,
    arrays: &[(String, Vec<f64>)],
    n_rows: usize,
) -> Result<(), ReportError> {
    write_on(&mesh(), Axes::Unknown, path, title, arrays, n_rows)
}

/// The same page about fields on this mesh.
fn write_on(
    mesh: &TriMesh,
    axes: Axes,
    path: &Path,
    title: &str,
    arrays: &[(String, Vec<f64>)],
    n_rows: usize,
) -> Result<(), ReportError> {
    let predictions = predictions(n_rows);
    let point_data: Vec<PointData<'_>> =
        arrays.iter().map(|(name, values)| PointData { name, unit: "ms", values }).collect();
    let n_sites = n_rows / 2;
    let sites: Vec<[f64; 3]> =
        (0..n_sites).map(|i| mesh.vertices()[(437 * i + 300) % mesh.n_vertices()]).collect();
    let mut rows: Vec<Row> =
        posterior().variables.iter().map(|v| row(&v.name, &v.unit, 10.0, 1.004)).collect();
    rows.extend((0..24).map(|k| row(&format!("tau_out.eta[{k}]"), "", 0.5, 1.001)));
    let page = Page {
        title,
        equations: "tau_out(x) = m + α · GP(RBF(ρ), K = 24)   [ms]\n  m ~ Flat,  α ~ InvGamma(1, 5),  1 < x",
        record: &record(),
        rows: &rows,
        posterior: &posterior(),
        loo: Some(&leave_one_out()),
        predictions: &predictions,
        files: &FILES,
        surface: Some(Surface { mesh, point_data: &point_data, sites: &sites, axes }),
    };
    write_html(path, &page)
}

/// Where the links of a page lead.
fn links(page: &str) -> Vec<&str> {
    page.split("<a href=\"").skip(1).map(|link| link.split_once('"').unwrap().0).collect()
}

#[test]
fn the_page_is_whole_and_holds_the_data() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("report.html");
    let mut arrays = arrays(&mesh());
    arrays[1].0 = "</script><b>".to_owned();
    write(&path, "A <b>title</b> & {{run}}", &arrays).unwrap();
    let html = std::fs::read_to_string(&path).unwrap();
    assert!(html.len() < 1_200_000, "{} bytes", html.len());
    let (page, scripts) = html.split_once("<script ").unwrap();
    assert!(page.contains("<h1>A &lt;b&gt;title&lt;/b&gt; &amp; {{run}}</h1>"));
    // what was fitted to what stands above the verdict
    let (before, _) = page.split_once("Verdict").unwrap();
    for told in [
        "Fitted to <b>brackets.csv</b>: 20 measurements at 10 sites of",
        "<b>patient &lt;7&gt;/atrium.vtk</b> (5166 vertices)",
        "2026-11-22 · eplat 0.1.0 · <code>eplat run models/erp.rs --data brackets.csv</code>",
    ] {
        assert!(before.contains(told), "{told}\n{before}");
    }
    for network in ["src=", "url(", "@import", "://", "<link", "<base"] {
        assert!(!page.contains(network), "the page has {network}");
    }
    assert_eq!(page.matches("href=").count(), links(page).len());
    // in the noscript text, in the section of predictions, and each in the list of files
    assert_eq!(links(page), ["fields.vtp", "rows.csv", "rows.csv", "fields.vtp", "run.json"]);
    assert_eq!(scripts.matches("</script>").count(), 3);
    assert!(page.contains("Pareto k is above 0.70 at 2 of 3 measurements"));
    assert_eq!(page.matches("<circle").count(), 3);
    let order = ["site 3 &lt;roof&gt;<td>", "site 2 &lt;roof&gt;<td>", "site 1 &lt;roof&gt;<td>"];
    let places = order.map(|row| page.find(row).unwrap());
    assert!(places.is_sorted(), "the worst measurement is not the first: {places:?}");

    let data = scripts.split_once('>').unwrap().1.split_once("</script>").unwrap().0;
    let data: Value = serde_json::from_str(data).unwrap();
    assert_eq!(data["arrays"].as_array().unwrap().len(), N_ARRAYS);
    assert_eq!(data["arrays"][1]["name"], "</script><b>");
}

#[test]
fn rows_outside_their_intervals_are_named_and_coverage_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("report.html");
    write(&path, "Erp", &arrays(&mesh())).unwrap();
    let html = std::fs::read_to_string(&path).unwrap();
    assert!(html.contains("<b>2 of 20 rows lie outside their 90 % predictive interval</b>"));
    let named = "<li>s1s2 line 11 (site 4 &lt;roof&gt;): measured 210 to 220 ms, predicted 276";
    assert!(html.contains(named), "{html}");
    assert_eq!(html.matches("<g class=\"far\"").count(), 2);
    assert!(html.contains("leave-one-out, 10 by importance weights (PSIS), 10 not known"));
    let all = "<td class=\"text\">all<td>20<td>90 %<td>90 %<td>90 %<td>90 %<td>10<td>100 %";
    assert!(html.contains(all), "{html}");
    let table = folder.path().join("rows.csv");
    write_rows(&table, &predictions(20).rows).unwrap();
    assert_eq!(std::fs::read_to_string(&table).unwrap().lines().count(), 21);
}

/// The page is a record also where a whole map was measured: it may not grow with the rows as it did.
#[test]
fn fourteen_hundred_rows_leave_the_page_below_twice_its_size() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("report.html");
    let size = |n: usize| {
        write_with(&path, "Erp", &arrays(&mesh()), n).unwrap();
        std::fs::read(&path).unwrap().len()
    };
    let [few, many] = [size(20), size(1400)];
    assert!(many < few + 150_000, "{few} bytes, {many} with 1400 rows");
}

#[test]
fn a_page_without_a_surface_has_no_script() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("report.html");
    let (record, posterior) = (record(), posterior());
    let rows = [row("mu", "", 1.0, 1.5)];
    let page = Page {
        title: "Schools",
        equations: "",
        record: &record,
        rows: &rows,
        posterior: &posterior,
        loo: None,
        predictions: &Predictions::default(),
        files: &[],
        surface: None,
    };
    write_html(&path, &page).unwrap();
    let html = std::fs::read_to_string(&path).unwrap();
    assert!(
        !html.contains("<script")
            && !html.contains("<circle")
            && !html.contains("href=")
            && html.contains("class=\"verdict bad\"><b>Verdict: red</b>")
            && html.contains("<dd>Not converged: worst R̂ 1.500 (mu)")
    );
}

#[test]
fn point_data_of_another_length_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("report.html");
    let error = write(&path, "Erp", &[("tau_out_mean".to_owned(), vec![1.0; 3])]).unwrap_err();
    assert!(!path.exists());
    insta::assert_snapshot!(error, @r"
    point data tau_out_mean: expected 5000 values, got 3
    help: give one value per vertex
    ");
}
