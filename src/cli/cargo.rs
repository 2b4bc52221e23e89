//! Cargo, as it builds the library that models are compiled against: minutes, so it is shown how far it is.

use std::collections::BTreeSet;
use std::io::{self, BufRead as _, BufReader, Read as _};
use std::path::Path;
use std::process::{Command, Output, Stdio};

use serde::Deserialize;

use super::voice::Count;

/// What is read of a line of cargo's `--message-format=json`.
#[derive(Deserialize)]
struct Message {
    reason: String,
    package_id: Option<String>,
}

/// What is read of `cargo metadata`.
#[derive(Deserialize)]
struct Metadata {
    resolve: Resolve,
}

#[derive(Deserialize)]
struct Resolve {
    nodes: Vec<serde_json::Value>,
}

/// Runs `command`, a `cargo build` with messages in JSON of the package with this manifest, and counts the
/// packages that are built, if cargo tells how many there are.
pub(super) fn counted(command: &mut Command, manifest: &Path) -> io::Result<Output> {
    let Some(total) = n_packages(manifest) else { return command.output() };
    let template = "{bar:30} {pos} of {len} packages, {elapsed}";
    let count = Count::new("library_packages", total, template);
    let count = count.map_err(|failure| io::Error::other(failure.to_string()))?;
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn()?;
    let stderr = child.stderr.take();
    let errors = std::thread::spawn(move || {
        let mut text = vec![];
        stderr.map_or(Ok(0), |mut stderr| stderr.read_to_end(&mut text)).map(|_| text)
    });
    let (mut stdout, mut built) = (String::new(), BTreeSet::new());
    for line in child.stdout.take().into_iter().flat_map(|stdout| BufReader::new(stdout).lines()) {
        let line = line?;
        if let Ok(Message { reason, package_id: Some(package) }) = serde_json::from_str(&line)
            && reason == "compiler-artifact"
            && built.insert(package)
        {
            count.add(1);
        }
        stdout += &line;
        stdout.push('\n');
    }
    count.finish();
    let status = child.wait()?;
    let stderr = errors.join().map_err(|_| io::Error::other("cargo's errors were lost"))??;
    Ok(Output { status, stdout: stdout.into_bytes(), stderr })
}

/// How many packages are built on this system; `None` if cargo does not tell.
fn n_packages(manifest: &Path) -> Option<u64> {
    let host = Command::new("rustc").arg("-vV").stdin(Stdio::null()).output().ok()?;
    let host = String::from_utf8_lossy(&host.stdout).into_owned();
    let host = host.lines().find_map(|line| line.strip_prefix("host: "))?;
    let said = Command::new("cargo")
        .args(["metadata", "--format-version", "1", "--quiet", "--filter-platform", host])
        .arg("--manifest-path")
        .arg(manifest)
        .stdin(Stdio::null())
        .output()
        .ok()?;
    let metadata: Metadata = serde_json::from_slice(&said.stdout).ok()?;
    Some(metadata.resolve.nodes.len() as u64)
}
