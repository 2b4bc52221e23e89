//! States that were changed on purpose, for tests of who takes them up.

use serde_json::Value;

/// Tells `change` of changes of one length, number or choice in `value`, and what was changed. Of long lists the first and last items
/// stand for all.
pub(crate) fn forgeries(value: &Value, at: &str, change: &mut dyn FnMut(&str, Value)) {
    match value {
        Value::Array(items) => {
            if let Some(last) = items.last() {
                change(&format!("{at}: none"), Value::Array(vec![]));
                change(&format!("{at}: one less"), items[1..].into());
                change(
                    &format!("{at}: one more"),
                    [&items[..], std::slice::from_ref(last)].concat().into(),
                );
            }
            let is_tried = |i: &usize| items.len() < 5 || [0, items.len() - 1].contains(i);
            for i in (0..items.len()).filter(is_tried) {
                forgeries(&items[i], &format!("{at}[{i}]"), &mut |what, item| {
                    let mut items = items.clone();
                    items[i] = item;
                    change(what, items.into());
                });
            }
        }
        Value::Object(entries) => {
            for (name, entry) in entries {
                forgeries(entry, &format!("{at}.{name}"), &mut |what, entry| {
                    let mut entries = entries.clone();
                    entries.insert(name.clone(), entry);
                    change(what, entries.into());
                });
            }
            change(&format!("{at}: null"), Value::Null);
        }
        Value::Number(number) => {
            if let Some(n) = number.as_u64() {
                for other in [0, n + 1, n.saturating_sub(1), 1 << 40] {
                    change(&format!("{at}: {other}"), other.into());
                }
            } else {
                for other in [0.0, -1.0, 1e300] {
                    change(&format!("{at}: {other}"), other.into());
                }
            }
        }
        Value::Bool(yes) => change(&format!("{at}: {}", !yes), (!yes).into()),
        Value::Null | Value::String(_) => {}
    }
}

/// Whether such a change is one of a list's length.
pub(crate) fn changes_length(what: &str) -> bool {
    [": none", ": one less", ": one more"].iter().any(|end| what.ends_with(end))
}
