//! `eplat-fuzz TARGET SECONDS` reads mutations of valid files; TARGET may be `all`. `eplat-fuzz corpus FOLDER` writes
//! what libFuzzer begins from.

use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [what, how] = &arguments[..] else {
        eprintln!("usage: eplat-fuzz TARGET|all SECONDS, or eplat-fuzz corpus FOLDER");
        return ExitCode::from(2);
    };
    if what == "corpus" {
        eplat_fuzz::write_corpus(Path::new(how));
        return ExitCode::SUCCESS;
    }
    let Ok(seconds) = how.parse() else {
        eprintln!("{how}: expected seconds");
        return ExitCode::from(2);
    };
    for name in eplat_fuzz::NAMES.iter().filter(|name| what == "all" || what == *name) {
        let n = eplat_fuzz::mutate(name, Duration::from_secs(seconds));
        println!("{name}: {n} files in {seconds} s, no fault");
    }
    ExitCode::SUCCESS
}
