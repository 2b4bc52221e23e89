//! What the Rust compiler says about a model file, as it says it.

use std::collections::BTreeSet;

use serde::Deserialize;

/// One error of rustc's `--error-format=json`.
#[derive(Deserialize)]
struct Diagnostic {
    level: String,
    /// Where it is; none for a summary of the others.
    spans: Vec<serde_json::Value>,
    rendered: Option<String>,
}

/// A line of cargo's `--message-format=json`.
#[derive(Deserialize)]
struct FromCargo {
    message: Diagnostic,
}

/// A line of the compiler's output.
fn parse(line: &str) -> Option<Diagnostic> {
    let from_cargo = serde_json::from_str::<FromCargo>(line).map(|m| m.message);
    from_cargo.or_else(|_| serde_json::from_str(line)).ok()
}

/// The errors that the compiler found in what it read.
fn errors(output: &str) -> impl Iterator<Item = Diagnostic> {
    let is_error = |d: &Diagnostic| d.level == "error" && !d.spans.is_empty();
    output.lines().filter_map(parse).filter(is_error)
}

/// Whether the compiler found an error in what it read, and did not fail for another reason.
pub(super) fn has_errors(output: &str) -> bool {
    errors(output).next().is_some()
}

/// The errors in the compiler's output as it prints them itself; all of the output if it has none.
pub(super) fn rendered(output: &str) -> String {
    let mut errors: Vec<String> = errors(output).filter_map(|d| d.rendered).collect();
    let mut seen = BTreeSet::new();
    errors.retain(|error| seen.insert(error.clone())); // `model!` may use an expression twice
    if !errors.is_empty() {
        return errors.concat().trim_end().to_string();
    }
    let line = |line| parse(line).map_or(Some(format!("{line}\n")), |d| d.rendered);
    output.lines().filter_map(line).collect::<String>().trim_end().to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_shown_as_the_compiler_prints_them() {
        let of = |level: &str, spans: &str, text: &str| {
            format!("{{\"level\":\"{level}\",\"spans\":[{spans}],\"rendered\":\"{text}\\n\"}}\n")
        };
        let output = of("warning", "{}", "unused") + &of("error", "{}", "mismatched");
        let output = output + &of("error", "", "aborting");
        assert_eq!(rendered(&output), "mismatched");
        let from_cargo = format!("{{\"message\":{}}}", of("error", "{}", "mismatched").trim());
        assert_eq!(rendered(&from_cargo), "mismatched");
        assert_eq!(rendered("linker not found\n"), "linker not found");
        assert!(has_errors(&output) && has_errors(&from_cargo));
        assert!(!has_errors("linker not found") && !has_errors(&of("error", "", "bus error")));
    }
}
