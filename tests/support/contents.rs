//! What a command left in a folder, without what differs from one time to the next.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

/// Contents of every file below a folder by path; of records and reports all but times, dates and commands.
pub(crate) fn contents(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut found = vec![];
    for entry in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        if entry.is_dir() {
            let name = entry.file_name().unwrap();
            let below = contents(&entry).into_iter();
            found.extend(below.map(|(path, bytes)| (Path::new(name).join(path), bytes)));
            continue;
        }
        let bytes = timeless(&entry, fs::read(&entry).unwrap());
        found.push((entry.strip_prefix(folder).unwrap().to_owned(), bytes));
    }
    found.sort();
    found
}

/// The bytes of a file without times, dates and commands.
fn timeless(path: &Path, bytes: Vec<u8>) -> Vec<u8> {
    let name = path.file_name().unwrap().to_str().unwrap();
    match name {
        "run.json" => {
            let mut record: Value = serde_json::from_slice(&bytes).unwrap();
            for timed in ["seconds", "ns_per_grad", "sampler_ns_per_grad", "ess_per_second"] {
                assert!(record.as_object_mut().unwrap().remove(timed).is_some(), "{timed}");
            }
            // the page tells times
            assert!(record["files"].as_object_mut().unwrap().remove("report.html").is_some());
            let provenance = record["provenance"].as_object_mut().unwrap();
            assert!(provenance.remove("command").is_some() && provenance.remove("date").is_some());
            record.to_string().into_bytes()
        }
        "simulation.json" | "vulnerability.json" => {
            let mut record: Value = serde_json::from_slice(&bytes).unwrap();
            assert!(record.as_object_mut().unwrap().remove("seconds").is_some());
            record.to_string().into_bytes()
        }
        "experiment.json" => {
            let mut record: Value = serde_json::from_slice(&bytes).unwrap();
            assert!(record.as_object_mut().unwrap().remove("seconds_of_the_run").is_some());
            assert!(record["simulation"].as_object_mut().unwrap().remove("seconds").is_some());
            record.to_string().into_bytes()
        }
        "report.html" => {
            let timed = |line: &&str| {
                let terms = ["<dt>gradients<", "<dt>ESS per second<", "<dt>seconds<"];
                terms.iter().chain(&["<p class=\"provenance\">"]).any(|term| line.starts_with(term))
            };
            let page = String::from_utf8(bytes).unwrap();
            page.lines().filter(|line| !timed(line)).collect::<String>().into_bytes()
        }
        _ => bytes,
    }
}

/// Both folders hold the same files.
pub(crate) fn same_files(a: &Path, b: &Path) {
    let [a, b] = [a, b].map(contents);
    let names = |files: &[(PathBuf, Vec<u8>)]| -> Vec<PathBuf> {
        files.iter().map(|(path, _)| path.clone()).collect()
    };
    assert_eq!(names(&a), names(&b));
    for (a, b) in a.iter().zip(&b) {
        assert!(a.1 == b.1, "{} differs", a.0.display());
    }
}
