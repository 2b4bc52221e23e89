//! Names of arrays in formats where a name is one word: other signs are a `%` and two hex digits.

use std::fmt::Write as _;

/// Name `name` as one word.
pub(super) fn encoded(name: &str) -> String {
    let mut encoded = String::new();
    for byte in name.bytes() {
        if byte.is_ascii_graphic() && !matches!(byte, b'%' | b'"') {
            encoded.push(char::from(byte));
        } else {
            let _ = write!(encoded, "%{byte:02X}");
        }
    }
    encoded
}

/// The name that was [`encoded`].
pub(super) fn decoded(name: &str) -> String {
    let mut bytes = Vec::with_capacity(name.len());
    let mut rest = name.as_bytes();
    while let Some((&byte, tail)) = rest.split_first() {
        let code = (byte == b'%').then(|| tail.get(..2)).flatten();
        let code = code.and_then(|hex| u8::from_str_radix(std::str::from_utf8(hex).ok()?, 16).ok());
        bytes.push(code.unwrap_or(byte));
        rest = if code.is_some() { &tail[2..] } else { tail };
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_percent_decoded() {
        assert_eq!(decoded("LAT%20(ms)"), "LAT (ms)");
        assert_eq!(decoded("100%25"), "100%");
        assert_eq!(decoded("a%zz%4"), "a%zz%4");
        assert_eq!(decoded("%C2%B5V"), "µV");
    }

    #[test]
    fn names_are_one_word() {
        assert_eq!(encoded("LAT (ms) 5%"), "LAT%20(ms)%205%25");
        assert_eq!(decoded(&encoded("µ \"x\" %41")), "µ \"x\" %41");
    }
}
