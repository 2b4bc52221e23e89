//! `eplat-fuzz TARGET SECONDS [SEED]` reads mutations of valid files for so many CPU seconds; TARGET may be `all`, and
//! another SEED gives other mutations. `eplat-fuzz corpus FOLDER` writes what libFuzzer begins from.

use std::panic::catch_unwind;
use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (what, how, seed) = match &arguments[..] {
        [what, how] => (what, how, Ok(0)),
        [what, how, seed] => (what, how, seed.parse()),
        _ => {
            eprintln!("usage: eplat-fuzz TARGET|all SECONDS [SEED], or eplat-fuzz corpus FOLDER");
            return ExitCode::from(2);
        }
    };
    if what == "corpus" {
        eplat_fuzz::write_corpus(Path::new(how));
        return ExitCode::SUCCESS;
    }
    let (Ok(seconds), Ok(seed)) = (how.parse(), seed) else {
        eprintln!("{}: expected seconds, and a whole number", arguments[1..].join(" "));
        return ExitCode::from(2);
    };
    let mut code = ExitCode::SUCCESS;
    for name in eplat_fuzz::NAMES.iter().filter(|name| what == "all" || what == *name) {
        let time = Duration::from_secs(seconds);
        // a fault has told of itself; the other targets are tried nonetheless
        if let Ok(n) = catch_unwind(|| eplat_fuzz::mutate(name, time, seed)) {
            println!("{name}: {n} files in {seconds} CPU s, no fault");
        } else {
            println!("{name}: a fault");
            code = ExitCode::FAILURE;
        }
    }
    code
}
