//! Every example runs and prints what its header promises; the README shows the model that ships.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "tests")]

#[path = "../examples/close_the_loop.rs"]
#[allow(dead_code, reason = "its main only prints")]
mod close_the_loop;
#[path = "support/program.rs"]
mod program;
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

/// Whether a line of the README is what the program printed: the same words, and numbers that differ by less than
/// another machine's last digits may lead to. What stands for "…" at its end is left out.
fn is_line(shown: &str, printed: &str) -> bool {
    let is_same = |(shown, printed): (&str, &str)| {
        let number = |text: &str| text.trim_end_matches(',').parse::<f64>().ok();
        match (number(shown), number(printed)) {
            (Some(a), Some(b)) => (a - b).abs() < 0.2 * a.abs(),
            _ => shown == printed,
        }
    };
    let (shown, is_open) = match shown.strip_suffix(" …") {
        Some(shown) => (shown, true),
        None => (shown, false),
    };
    let (n, n_printed) = (shown.split_whitespace().count(), printed.split_whitespace().count());
    (n == n_printed || is_open && n < n_printed)
        && shown.split_whitespace().zip(printed.split_whitespace()).all(is_same)
}

#[test]
fn the_readme_shows_what_its_first_command_prints() {
    let (_, rest) = include_str!("../README.md").split_once("```text\n").unwrap();
    let (sample, _) = rest.split_once("```").unwrap();
    let done = program::Workplace::new().with_erp().eplat("run erp.rs");
    let printed = program::text(&done.stdout) + &program::text(&done.stderr);
    let mut lines = printed.lines();
    for shown in sample.lines().filter(|line| line.trim() != "…") {
        // in the same order
        assert!(lines.any(|line| is_line(shown, line)), "not printed: {shown}\n{printed}");
    }
    assert!(!is_line("RMSE 9.6 ms", "RMSE 14.1 ms") && !is_line("a 1 b", "a 1 c"));
}
