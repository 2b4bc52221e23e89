//! Where results that are slow to compute are kept between runs, and under what name.
//!
//! A cache entry is named by a hash of everything it was computed from, so that an entry is either
//! right or absent.  Knows nothing of what is stored.

use sha2::{Digest, Sha256};
use std::env;
use std::path::PathBuf;

/// The cache folder: `$EPLAT_CACHE`, else `$XDG_CACHE_HOME/eplat`, else `$HOME/.cache/eplat`.
///
/// `None` when none of the three is set; the folder need not exist yet.
pub fn folder() -> Option<PathBuf> {
    folder_from(|name| env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from))
}

fn folder_from(variable: impl Fn(&str) -> Option<PathBuf>) -> Option<PathBuf> {
    variable("EPLAT_CACHE")
        .or_else(|| variable("XDG_CACHE_HOME").map(|base| base.join("eplat")))
        .or_else(|| variable("HOME").map(|home| home.join(".cache").join("eplat")))
}

/// SHA-256 of `parts` as 64 hexadecimal digits.
///
/// Each part is hashed with its length before it: moving bytes from one part to the next changes
/// the key.
pub fn key(parts: &[&[u8]]) -> String {
    let mut hash = Sha256::new();
    for part in parts {
        hash.update((part.len() as u64).to_le_bytes());
        hash.update(part);
    }
    format!("{:x}", hash.finalize())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_variable_that_is_set_wins() {
        let all = |name: &str| Some(PathBuf::from(format!("/{name}")));
        assert_eq!(folder_from(all), Some("/EPLAT_CACHE".into()));
        let without_own = |name: &str| if name == "EPLAT_CACHE" { None } else { all(name) };
        assert_eq!(folder_from(without_own), Some("/XDG_CACHE_HOME/eplat".into()));
        let home = |name: &str| if name == "HOME" { all(name) } else { None };
        assert_eq!(folder_from(home), Some("/HOME/.cache/eplat".into()));
        assert_eq!(folder_from(|_| None), None);
    }

    #[test]
    fn the_key_depends_on_content_and_on_where_parts_end() {
        // sha256 of eight zero bytes (a length) followed by nothing: printf '\0%.0s' {1..8} | sha256sum
        let empty_part = "af5570f5a1810b7af78caf4bc70a660f0df51e42baf91d4de5b2328de0e83dfc";
        assert_eq!(key(&[b""]), empty_part);
        assert_ne!(key(&[b"ab", b"c"]), key(&[b"a", b"bc"]));
        assert_ne!(key(&[b"ab"]), key(&[b"ab", b""]));
    }
}
