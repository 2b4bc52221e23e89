//! What each `observe` compares with its measurements.

use crate::dsl::Model;

/// For each `observe` of a model, the first field or `let` that its likelihood mentions; `None` for one
/// that mentions parameters alone.
pub fn observables(model: &Model) -> Vec<Option<String>> {
    let named: Vec<&str> = model
        .statements
        .iter()
        .filter(|s| ["field", "let"].contains(&s.keyword))
        .map(|s| s.decl.name)
        .collect();
    let one = |observe: &crate::dsl::Observe| {
        let statement = model
            .statements
            .iter()
            .find(|s| s.keyword == "observe" && s.decl.name == observe.name)?;
        let likelihood = statement.decl.text.split_once('~')?.1;
        let words = likelihood.split(|c: char| !(c.is_alphanumeric() || c == '_'));
        words.into_iter().find(|w| named.contains(w)).map(String::from)
    };
    model.observes.iter().map(one).collect()
}
