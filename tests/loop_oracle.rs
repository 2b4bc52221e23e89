//! What the studies of `tests/loop_rates.rs` let anybody tell: the power of tests that know how they were made, and the
//! evidence of candidates that the loop does not try.
//!
//! ```sh
//! WHAT=sites,region,scatter,third SEEDS=1001..1100 \
//!     cargo test --release --test loop_oracle -- --ignored --nocapture
//! ```
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "for tests")]

#[path = "support/shipped.rs"]
mod shipped;
#[path = "support/site_oracle.rs"]
mod site_oracle;
#[path = "support/studies.rs"]
mod studies;

use std::ops::ControlFlow;
use std::sync::Arc;

use eplat::criticism::{Criticism, Outer, SearchSettings, Subject, TriedTerm, criticise};
use eplat::field::{Kernel as _, Matern52};
use rayon::prelude::*;
use shipped::shipped;
use site_oracle::{Knows, Oracle};
use studies::{Heart, Scenario, Study, study};

/// A search without null searches, so that nothing is claimed.
fn searched(heart: &Heart, study: &Study) -> Criticism {
    let case = Subject { model: shipped("erp"), basis: Some(&heart.basis), table: &study.train };
    let settings = SearchSettings { nulls: 0, ..SearchSettings::default() };
    criticise(&case, &settings, &|_| ControlFlow::Continue(())).unwrap()
}

fn seeds() -> std::ops::RangeInclusive<u64> {
    let seeds = std::env::var("SEEDS").unwrap_or_else(|_| "1001..1020".into());
    let (first, last) = seeds.split_once("..").unwrap();
    first.parse().unwrap()..=last.parse().unwrap()
}

fn is_wanted(what: &str) -> bool {
    std::env::var("WHAT").map_or(true, |all| all.split(',').any(|own| own == what))
}

/// A figure of each of these studies.
fn of_each<T: Send>(
    heart: &Heart,
    scenario: Scenario,
    what: &(dyn Fn(&Study) -> T + Sync),
) -> Vec<T> {
    seeds().into_par_iter().map(|seed| what(&study(heart, scenario, seed))).collect()
}

/// Share of studies above what 5 % of those are above in which nothing acts.
fn power(nothing: &[f64], acts: &[f64]) -> String {
    let (mut low, mut high) = (nothing.to_vec(), acts.to_vec());
    low.sort_by(f64::total_cmp);
    high.sort_by(f64::total_cmp);
    let bar = low[(0.95 * low.len() as f64) as usize];
    let share = |x: &[f64], bar: f64| {
        100.0 * x.iter().filter(|x| **x > bar).count() as f64 / x.len() as f64
    };
    format!(
        "{:.0} % above {bar:.1}, {:.0} % above 3, {:.0} % above 6, at least {:.1}; where it does not act {:.0} % above 3, at most {:.1}",
        share(&high, bar),
        share(&high, 3.0),
        share(&high, 6.0),
        high[0],
        share(&low, 3.0),
        low[low.len() - 1],
    )
}

#[test]
#[ignore = "600 studies of 1001 to 1100, 200 searches without null searches, 15 minutes"]
fn what_a_test_can_tell() {
    type Of<'a> = &'a (dyn Fn(&Study) -> Vec<f64> + Sync);
    let heart = Heart::new();
    let of = |own: &Study, which: &dyn Fn(&Oracle<'_>, Knows) -> f64| {
        [Knows::All, Knows::Forms].map(|knows| which(&Oracle::new(&heart.basis, own), knows))
    };
    let sites: Of<'_> = &|own| {
        let loops = searched(&heart, own).site_log_bf;
        of(own, &|oracle, knows| oracle.sites(knows)).into_iter().chain([loops]).collect()
    };
    let region: Of<'_> = &|own| of(own, &|oracle, knows| oracle.region(knows)).to_vec();
    let scatter: Of<'_> = &|own| of(own, &|oracle, knows| oracle.scatter(knows)).to_vec();
    for (name, what, nothing, acts) in [
        ("sites", sites, Scenario::Null, Scenario::Outside),
        ("region", region, Scenario::Force, Scenario::TwoLevels),
        ("scatter", scatter, Scenario::Null, Scenario::Hetero),
    ] {
        if !is_wanted(name) {
            continue;
        }
        let [nothing, acts] = [nothing, acts].map(|scenario| of_each(&heart, scenario, what));
        let who = ["knows all but whether it acts", "knows the forms", "the loop"];
        for (k, who) in who.iter().enumerate().take(nothing[0].len()) {
            let [nothing, acts] =
                [&nothing, &acts].map(|all| all.iter().map(|own| own[k]).collect::<Vec<f64>>());
            println!("{name}, {who}: {}", power(&nothing, &acts));
        }
    }
}

/// Log Bayes factor of a further smooth field that moves one kind of measurement alone, S1S2S3.
fn third(heart: &Heart, own: &Study, found: &Criticism) -> f64 {
    let base = &found.rounds[0].base;
    let (basis, table) = (&heart.basis, &own.train);
    let spacing = basis.at(0)[0].recip() / (own.truth.shift.len() as f64).sqrt();
    let mut best = f64::NEG_INFINITY;
    for lengthscale in [1.0, 2.0, 4.0].map(|times| times * spacing) {
        let kernel = Matern52(lengthscale);
        let weights: Vec<f64> = basis.eigenvalues[..24]
            .iter()
            .map(|l| kernel.sqrt_density(l.max(0.0).sqrt()))
            .collect();
        let at = |row: usize| basis.at(table.vertex(row).unwrap() as usize);
        let design: Vec<f64> = (0..table.len())
            .flat_map(|row| weights.iter().zip(at(row)).map(|(w, phi)| w * phi).collect::<Vec<_>>())
            .collect();
        for steps in [0.25, 0.5, 1.0] {
            let mut engine = found.engine.clone();
            let active = [&base.active[..], &[engine.terms.len()]].concat();
            engine.terms.push(Arc::new(TriedTerm {
                on: vec!["erp_s3".into()],
                design: design.clone(),
                n: weights.len(),
                sd: Some(steps * found.step),
            }));
            // the field may take the place of what sites and rows differ by
            for less in [0.0, 0.5, 1.0] {
                let Outer { ln_site, ln_noise, .. } = base.outer;
                let ln_site = ln_site - less;
                let outer =
                    Outer { ln_site, ln_noise: ln_noise - 0.5 * less, ..base.outer.clone() };
                if let Some(fit) = engine.fit(&outer, &active, Some(base)) {
                    best = best.max(fit.ln_evidence);
                }
            }
        }
    }
    best - base.ln_evidence
}

#[test]
#[ignore = "80 searches without null searches, 2 minutes"]
fn fields_that_are_no_candidates() {
    if !is_wanted("third") {
        return;
    }
    let heart = Heart::new();
    for scenario in [Scenario::Null, Scenario::Outside, Scenario::Region, Scenario::Third] {
        let mut all = of_each(&heart, scenario, &|own| {
            let found = searched(&heart, own);
            (third(&heart, own, &found), found.finer_log_bf.unwrap())
        });
        let beyond = |of: fn(&(f64, f64)) -> f64| all.iter().filter(|own| of(own) > 3.0).count();
        let (thirds, shorts) = (beyond(|own| own.0), beyond(|own| own.1));
        println!("{scenario:?}: third above 3 in {thirds}, short in {shorts} of {}", all.len());
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        println!("    third {:.1?}", all.iter().map(|own| own.0).collect::<Vec<f64>>());
    }
}
