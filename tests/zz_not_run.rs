//! The last of the tests to run: lists those that did not for want of data or a program, with a count.

#![allow(clippy::print_stdout, reason = "it prints")]

use std::fs;
use std::path::Path;

fn main() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("not_run");
    let entries = fs::read_dir(&folder).into_iter().flatten().flatten();
    let mut lines: Vec<String> = entries
        .map(|entry| {
            let why = fs::read_to_string(entry.path()).unwrap_or_default();
            format!("  {}: {why}", entry.file_name().display())
        })
        .collect();
    lines.sort();
    println!("\n{} tests did not run for want of data or a program", lines.len());
    for line in &lines {
        println!("{line}");
    }
    // the next run tells anew
    let _ = fs::remove_dir_all(&folder);
}
