//! Tests that cannot run here say so, and are listed at the end of all tests (`tests/all.rs`).

use std::path::Path;

/// Notes that the test of this thread did not run, and why.
#[allow(clippy::print_stdout, clippy::unwrap_used, reason = "for tests")]
pub(crate) fn skipped(why: &str) {
    println!("{why}: skipped");
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("not_run");
    let test = std::thread::current().name().unwrap_or("main").replace("::", ".");
    std::fs::create_dir_all(&folder).and_then(|()| std::fs::write(folder.join(test), why)).unwrap();
}
