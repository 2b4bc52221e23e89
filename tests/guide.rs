//! Every file and command of `docs/write_a_model.md` does what the page says.
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/program.rs"]
mod program;

use program::{Workplace, text};

/// The code blocks of this language, each with the text before it.
fn blocks<'p>(page: &'p str, language: &str) -> Vec<(&'p str, &'p str)> {
    let fence = format!("```{language}\n");
    let mut found = vec![];
    let mut rest = page;
    while let Some((before, after)) = rest.split_once(&fence) {
        let (block, next) = after.split_once("```").unwrap();
        found.push((before, block));
        rest = next;
    }
    found
}

/// The last file name in backquotes.
fn file_name(before: &str) -> &str {
    let (head, _) = before.rsplit_once('`').unwrap();
    head.rsplit_once('`').unwrap().1
}

#[test]
fn a_newcomer_gets_through_the_page() {
    let page = include_str!("../docs/write_a_model.md");
    let place = Workplace::new();
    for language in ["csv", "rust"] {
        for (before, block) in blocks(page, language) {
            place.file(file_name(before), block);
        }
    }
    let mut n_run = 0;
    for (_, commands) in blocks(page, "sh") {
        for command in commands.lines() {
            let done = place.eplat(command.strip_prefix("eplat ").unwrap());
            let said = text(&done.stdout) + &text(&done.stderr);
            assert_eq!(done.status.code(), Some(0), "{command}:\n{said}");
            if command.contains("compare flat field") {
                assert!(said.contains("B predicts better"), "{said}");
            }
            n_run += 1;
        }
    }
    assert_eq!(n_run, 8);
    let noise = place.read("flat/summary.csv");
    let noise = noise.lines().find(|line| line.starts_with("noise,")).unwrap();
    let mean: f64 = noise.split(',').nth(1).unwrap().parse().unwrap();
    assert!((mean - 14.0).abs() < 1.0, "the page says 14 ohm: {mean}");
}
