//! Text of files from laboratories: UTF-8 or UTF-16 with a byte order mark, else cp1252.

use std::borrow::Cow;

use encoding_rs::{Encoding, WINDOWS_1252};

/// The text in `bytes`. A byte order mark says UTF-8 or UTF-16 and is dropped; without one it is
/// UTF-8 where it is valid, else cp1252 (Western Windows), in which every byte is a character.
pub fn decode(bytes: &[u8]) -> Cow<'_, str> {
    if let Some((encoding, mark)) = Encoding::for_bom(bytes) {
        return encoding.decode_without_bom_handling(&bytes[mark..]).0;
    }
    std::str::from_utf8(bytes)
        .map_or_else(|_| WINDOWS_1252.decode_without_bom_handling(bytes).0, Cow::Borrowed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_encodings_of_spreadsheets_and_mapping_systems_are_told_apart() {
        assert_eq!(decode(b"\xEF\xBB\xBFsite"), "site");
        assert_eq!(decode("µV".as_bytes()), "µV");
        assert_eq!(decode(b"\xB5V \x80"), "µV €");
        assert_eq!(decode(b"\xFF\xFEs\0i\0"), "si");
        assert_eq!(decode(b""), "");
    }
}
