//! Every example runs and prints what its header promises; the README shows the model that ships.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "tests")]

#[path = "../examples/close_the_loop.rs"]
#[allow(dead_code, reason = "its main only prints")]
mod close_the_loop;
#[path = "../examples/quickstart.rs"]
#[allow(dead_code, reason = "its main only prints")]
mod quickstart;

/// The number that follows `before` in `text`.
fn number_after(text: &str, before: &str) -> f64 {
    let (_, rest) = text.split_once(before).expect(before);
    rest.split_whitespace().next().unwrap().parse().unwrap()
}

#[test]
fn quickstart_recovers_the_field_it_measured() {
    let mut out = vec![];
    let folder = tempfile::tempdir().unwrap();
    quickstart::run(&mut out, folder.path()).unwrap();
    let text = String::from_utf8(out).unwrap();
    for parameter in ["erp.m ", "erp.alpha ", "erp.rho ", "erp.eta"] {
        assert!(text.contains(parameter), "no {parameter}:\n{text}");
    }
    assert!(!text.contains('✗'), "the chains do not agree:\n{text}");
    let (error, spread) = (number_after(&text, "off by "), number_after(&text, "sd is "));
    assert!(folder.path().join("report.html").is_file(), "{text}");
    // Twenty brackets of 10 ms leave 3 ms at a site and about twice that between sites.
    assert!(error < 0.3 * spread, "{text}");
}

#[test]
fn close_the_loop_finds_what_it_hid() {
    let mut out = vec![];
    close_the_loop::run(&mut out).unwrap();
    let text = String::from_utf8(out).unwrap();
    assert!(text.contains("effect force_g on erp [ms] = "), "{text}");
    assert_eq!(text.matches("effect ").count(), 1, "{text}");
    let (before, after) = (number_after(&text, "left out: "), number_after(&text, "before, "));
    assert!(after < 0.8 * before, "{text}");
}

#[test]
fn the_readme_shows_the_shipped_model_in_full() {
    let readme = include_str!("../README.md");
    let (_, rest) = readme.split_once("```rust\n").unwrap();
    let (shown, _) = rest.split_once("```").unwrap();
    assert_eq!(shown, include_str!("../models/erp.rs"));
}
