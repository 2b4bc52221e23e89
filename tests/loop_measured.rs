//! `eplat loop` on measured data: what is undeclared is found by its column, and nothing else.
//!
//! The brackets are optically mapped recovery times of an explanted ventricle (jtmff/cosmas; Tomek et al. 2021), a
//! flat patch and not an ERP. Each was read at 50 % and at 70 % of the transient's size. A split takes 40 sites
//! for training and 60 held out, reads half of each at one threshold and half at the other, and tells which only
//! under one innocent column among decoys; or it reads all at one.

#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/program.rs"]
mod program;

use std::collections::BTreeMap;
use std::fmt::Write as _;

use program::{Workplace, shared, text};
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;

const LABELS: [&str; 3] = ["operator", "catheter", "session"];
const TRAIN: usize = 40;
const HELDOUT: usize = 60;

/// Measured brackets: (lower, upper) at 50 and at 70 %, and two columns that go with the site.
struct Site {
    vertex: usize,
    brackets: BTreeMap<String, [String; 2]>,
    others: [String; 2],
}

fn measured() -> Option<Vec<Site>> {
    let mut reader = csv::Reader::from_path(shared("cosmas/recovery_intervals.csv")?).unwrap();
    let header = reader.headers().unwrap().clone();
    let at = |name: &str| header.iter().position(|h| h == name).unwrap();
    let [site, threshold, lower, upper] = ["site", "threshold", "lower", "upper"].map(at);
    let others = ["amp_s1", "act_rel_ms"].map(at);
    let mut sites: BTreeMap<usize, Site> = BTreeMap::new();
    for row in reader.records().map(Result::unwrap) {
        let vertex = row[site].parse().unwrap();
        let own = sites.entry(vertex).or_insert_with(|| Site {
            vertex,
            brackets: BTreeMap::new(),
            others: others.map(|c| row[c].to_string()),
        });
        own.brackets.insert(row[threshold].into(), [lower, upper].map(|c| row[c].to_string()));
    }
    Some(sites.into_values().collect())
}

/// Both tables of a split: training and held out. `told` is the column that tells the threshold; without one
/// every bracket is read at 70 %.
fn tables(sites: &[Site], told: Option<usize>, seed: u64) -> [String; 2] {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut order: Vec<usize> = (0..sites.len()).collect();
    order.shuffle(&mut rng);
    let header = "site,vertex,protocol,S1,resolution,lower,upper,operator,catheter,session,amp_s1,activation_ms,t_min,temperature_C\n";
    let mut tables = [header.to_owned(), header.to_owned()];
    for (i, &site) in order[..TRAIN + HELDOUT].iter().enumerate() {
        let table = usize::from(i >= TRAIN);
        let labels = [(); 3].map(|()| rng.random_bool(0.5));
        let is_half = told.is_none_or(|told| labels[told]);
        let [lower, upper] = &sites[site].brackets[if is_half { "0.7" } else { "0.5" }];
        let lower = if lower.parse().is_ok_and(f64::is_finite) { lower } else { "" };
        let upper = if upper.parse().is_ok_and(f64::is_finite) { upper } else { "" };
        let [operator, catheter, session] = labels.map(|b| if b { "B" } else { "A" });
        let (t, degrees) = (60.0 * rng.random::<f64>(), 36.9 + 0.6 * (rng.random::<f64>() - 0.5));
        let Site { vertex, others: [amplitude, activation], .. } = &sites[site];
        let _ = writeln!(
            tables[table],
            "{vertex},{vertex},S1S2,150,10,{lower},{upper},{operator},{catheter},{session},{amplitude},{activation},{t:.2},{degrees:.2}"
        );
    }
    tables
}

/// What the loop finds in a split.
fn finding(sites: &[Site], told: Option<usize>, seed: u64) -> Value {
    let place = Workplace::new();
    let [train, heldout] = tables(sites, told, seed);
    let patch = std::fs::read(shared("cosmas/undeclared_threshold/patch.vtk").unwrap()).unwrap();
    place
        .file("recovery.rs", include_str!("../models/recovery.rs"))
        .file("patch.vtk", patch)
        .file("train.csv", train)
        .file("heldout.csv", heldout);
    let output = place.eplat(
        "loop recovery.rs --mesh patch.vtk --units mm --data train.csv --heldout heldout.csv --out out",
    );
    assert!(matches!(output.status.code(), Some(0 | 3)), "{}", text(&output.stderr));
    serde_json::from_str(&place.read("out/finding.json")).unwrap()
}

#[test]
#[ignore = "20 splits with an undeclared threshold and 20 without, 8 minutes"]
fn the_undeclared_threshold_is_found_under_its_column_in_18_of_20_splits() {
    let Some(sites) = measured() else { return };
    let (mut right, mut before, mut after) = (0, 0.0, 0.0);
    for seed in 0..20 {
        let told = seed as usize % LABELS.len();
        let finding = finding(&sites, Some(told), seed);
        let error = |name: &str| finding["heldout"][name].as_f64().unwrap();
        println!(
            "split {seed}, told by {}: {} ambiguous {}, held-out rms {:.2} → {:.2} ms",
            LABELS[told],
            finding["findings"],
            finding["ambiguous"],
            error("rmse_before"),
            error("rmse_after")
        );
        right += usize::from(finding["findings"] == serde_json::json!([LABELS[told]]));
        before += error("rmse_before") / 20.0;
        after += error("rmse_after") / 20.0;
    }
    println!("right in {right} of 20, held-out rms {before:.2} → {after:.2} ms on average");
    assert!(right >= 18, "{right} of 20");
    assert!(after < 0.8 * before, "{before} → {after}");

    let claims =
        (0..20).filter(|seed| finding(&sites, None, *seed)["findings"] != serde_json::json!([]));
    let claims =
        claims.inspect(|seed| println!("a claim in split {seed} without a threshold")).count();
    // at a level of 5 % three or more have a probability of 8 %
    println!("{claims} claims in 20 splits without an undeclared threshold");
    assert!(claims <= 2, "{claims} of 20");
}
