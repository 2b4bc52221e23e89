//! Which names does an expression mention? Answered at compile time, from the text of its tokens.
//!
//! `macro_rules!` cannot look into an expression, but `stringify!` can print it and a `const fn` can
//! read the print. Overlooking a name is impossible (a name that is used is in the text); a false hit
//! only makes one dual number wider.

/// Bit `i` is set if `names[i]` occurs in `text` as an identifier that is not a member (`row.sigma`).
pub const fn uses(text: &str, names: &[&str]) -> u128 {
    assert!(names.len() <= 128, "a model has at most 128 names");
    let text = text.as_bytes();
    let (mut mask, mut i) = (0, 0);
    while i < text.len() {
        let (start, end) = identifier(text, i);
        let mut n = 0;
        while end > start && !is_member(text, start) && n < names.len() {
            if same(text, start, end, names[n].as_bytes()) {
                mask |= 1 << n;
            }
            n += 1;
        }
        i = if end > start { end } else { start + 1 };
    }
    mask
}

/// As [`uses`], and also what the mentioned `let`s mention; `lets[i]` is the text behind name `first + i`.
pub const fn uses_through(text: &str, names: &[&str], first: usize, lets: &[&str]) -> u128 {
    let (mut mask, mut i) = (uses(text, names), lets.len());
    while i > 0 {
        i -= 1; // a `let` mentions only earlier ones, so one pass from the last to the first closes the set
        if mask >> (first + i) & 1 == 1 {
            mask |= uses(lets[i], names);
        }
    }
    mask
}

/// Whether `text` reads a column of the row that it calls `row`: `row.force_g`.
pub const fn mentions_columns(text: &str, row: &str) -> bool {
    let text = text.as_bytes();
    let mut i = 0;
    while i < text.len() {
        let (start, end) = identifier(text, i);
        let mut next = end;
        while next < text.len() && text[next] == b' ' {
            next += 1;
        }
        if end > start
            && same(text, start, end, row.as_bytes())
            && next < text.len()
            && text[next] == b'.'
        {
            return true;
        }
        i = if end > start { end } else { start + 1 };
    }
    false
}

/// Whether `text` reads `column` of the table that it calls `data`: `data.y`, or `data` as a whole.
pub(super) fn reads(text: &str, data: &str, column: &str) -> bool {
    let bytes = text.as_bytes();
    let mut i = 0;
    while i < bytes.len() {
        let (start, end) = identifier(bytes, i);
        if &text[start..end] == data && !is_member(bytes, start) {
            let Some(member) = text[end..].trim_start().strip_prefix('.') else { return true };
            let member = member.trim_start();
            if identifier(member.as_bytes(), 0).1 == column.len() && member.starts_with(column) {
                return true;
            }
        }
        i = if end > start { end } else { start + 1 };
    }
    false
}

/// Number of scalars behind the names in `mask`.
pub(super) const fn width(mask: u128, lens: &[usize]) -> usize {
    let (mut n, mut i) = (0, 0);
    while i < lens.len() {
        if mask >> i & 1 == 1 {
            n += lens[i];
        }
        i += 1;
    }
    n
}

/// The identifier that starts at byte `start`, as `(start, end)`; empty if there is none.
const fn identifier(text: &[u8], start: usize) -> (usize, usize) {
    let mut end = start;
    while end < text.len()
        && (text[end].is_ascii_alphanumeric() || text[end] == b'_' || text[end] >= 128)
    {
        end += 1;
    }
    (start, end)
}

/// Whether what starts at `start` follows a single dot (`row.sigma`, but not `0..sigma`).
const fn is_member(text: &[u8], start: usize) -> bool {
    start > 0 && text[start - 1] == b'.' && !(start > 1 && text[start - 2] == b'.')
}

const fn same(text: &[u8], start: usize, end: usize, name: &[u8]) -> bool {
    if end - start != name.len() {
        return false;
    }
    let mut i = 0;
    while i < name.len() {
        if text[start + i] != name[i] {
            return false;
        }
        i += 1;
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_found_as_whole_identifiers_only() {
        let names = &["m", "alpha", "sigma"];
        assert_eq!(uses("m + alpha * gp", names), 0b011);
        assert_eq!(uses("(mm + alphabet).exp()", names), 0);
        assert_eq!(uses("Normal(m, row.sigma)", names), 0b001);
        assert_eq!(uses("(0..sigma)", names), 0b100);
    }

    #[test]
    fn lets_are_followed_to_what_they_mention() {
        let names = &["a", "b", "f", "g"]; // f and g are lets
        assert_eq!(uses_through("TopHat(g(x))", names, 2, &["a * 2.0", "f(x) + b"]), 0b1111);
        assert_eq!(uses_through("TopHat(f(x))", names, 2, &["a * 2.0", "f(x) + b"]), 0b0101);
    }

    #[test]
    fn columns_are_seen_through_the_rows_own_name() {
        assert!(mentions_columns("noise * row.force_g", "row"));
        assert!(mentions_columns("x .dose", "x"));
        assert!(!mentions_columns("erp(x) + 2.0", "x"));
        assert!(!mentions_columns("max.dose", "x"));
    }

    #[test]
    fn only_the_columns_of_the_table_that_are_read_count() {
        let text = "garch(mu, data.y, & data . before)";
        assert!(reads(text, "data", "y") && reads(text, "data", "before"));
        assert!(!reads(text, "data", "mu") && !reads(text, "data", "bef"));
        assert!(!reads("row.data.y", "data", "y"));
        assert!(reads("whole(data)", "data", "y"));
    }
}
