//! `cargo run --release --manifest-path book/Cargo.toml` builds `target/book/index.html`.

use std::path::Path;
use std::process::ExitCode;

fn main() -> ExitCode {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    match eplat_book::build(&root) {
        Ok(first) => {
            println!("{}", first.canonicalize().unwrap_or(first).display());
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("{error:#}");
            eprintln!("help: mend these places; the book is built from docs/ and its SUMMARY.md");
            ExitCode::FAILURE
        }
    }
}
