//! Walks through the bytes of a legacy VTK file: lines, words and arrays of numbers.
//!
//! Knows where it stands, so that every error names a line (ASCII) or a byte (BINARY).

use super::super::{MeshError, Place};
use crate::store::Kind;
use std::path::Path;

/// A position in a file's bytes.
#[derive(Debug)]
pub(super) struct Scanner<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    at: usize,
    /// Whether arrays are big-endian bytes instead of text.
    pub(super) is_binary: bool,
}

impl<'a> Scanner<'a> {
    /// Stands at the first byte of `bytes`, which are the content of `path`.
    pub(super) fn new(path: &'a Path, bytes: &'a [u8]) -> Self {
        Self { path, bytes, at: 0, is_binary: false }
    }

    /// The file.
    pub(super) fn path(&self) -> &'a Path {
        self.path
    }

    /// An error at the position `at`.
    fn error_at(&self, at: usize, expected: &str, got: String) -> MeshError {
        MeshError::Parse {
            path: self.path.into(),
            place: self.place(at),
            expected: expected.into(),
            got,
        }
    }

    /// An error on the line or array just read; on a last line without its end, that the file ends.
    pub(super) fn error(&self, expected: &str, got: impl Into<String>) -> MeshError {
        if self.is_cut_off() {
            return self.truncated(expected);
        }
        self.error_at(self.at.saturating_sub(1), expected, got.into())
    }

    /// An error because the file ends where `expected` should follow.
    pub(super) fn truncated(&self, expected: &str) -> MeshError {
        MeshError::Truncated {
            path: self.path.into(),
            place: self.place(self.bytes.len()),
            expected: expected.into(),
        }
    }

    /// Whether what was just read is the file's end and not the end of a line.
    fn is_cut_off(&self) -> bool {
        self.at == self.bytes.len() && self.bytes.last() != Some(&b'\n')
    }

    fn place(&self, at: usize) -> Place {
        let before = &self.bytes[..at.min(self.bytes.len())];
        if self.is_binary {
            Place::Byte(before.len())
        } else {
            Place::Line(before.split(|&byte| byte == b'\n').count())
        }
    }

    /// The next line without its end, blank ones included; `None` at the end of the file.
    pub(super) fn line(&mut self) -> Option<String> {
        let rest = &self.bytes[self.at..];
        if rest.is_empty() {
            return None;
        }
        let length = rest.iter().position(|&byte| byte == b'\n').unwrap_or(rest.len());
        self.at = (self.at + length + 1).min(self.bytes.len());
        Some(String::from_utf8_lossy(&rest[..length]).trim_end_matches('\r').to_owned())
    }

    /// The words of the next line that is not blank; `None` at the end of the file.
    pub(super) fn words(&mut self) -> Option<Vec<String>> {
        self.skip_white();
        let line = self.line()?;
        Some(line.split_ascii_whitespace().map(str::to_owned).collect())
    }

    /// Like [`Self::words`], where the file may not end.
    pub(super) fn words_of(&mut self, expected: &str) -> Result<Vec<String>, MeshError> {
        self.words().ok_or_else(|| self.truncated(expected))
    }

    /// Whether the next word is `keyword`, in upper or lower case.
    pub(super) fn next_is(&mut self, keyword: &str) -> bool {
        let start = self.bytes[self.at..].iter().position(|b| !b.is_ascii_whitespace());
        start.is_some_and(|skip| {
            self.bytes[self.at + skip..]
                .get(..keyword.len())
                .is_some_and(|word| word.eq_ignore_ascii_case(keyword.as_bytes()))
        })
    }

    /// `n` real numbers.
    pub(super) fn reals(
        &mut self,
        n: usize,
        kind: Kind,
        what: &str,
    ) -> Result<Vec<f64>, MeshError> {
        self.array(n, kind, what, parse_real, Kind::real)
    }

    /// `n` integers.
    pub(super) fn integers(
        &mut self,
        n: usize,
        kind: Kind,
        what: &str,
    ) -> Result<Vec<i64>, MeshError> {
        self.array(n, kind, what, |word| word.parse().ok(), Kind::integer)
    }

    fn array<T>(
        &mut self,
        n: usize,
        kind: Kind,
        what: &str,
        from_text: fn(&str) -> Option<T>,
        from_bytes: fn(Kind, &[u8]) -> T,
    ) -> Result<Vec<T>, MeshError> {
        if self.is_binary {
            let bytes = self.take(n.saturating_mul(kind.size()), what)?;
            return Ok(bytes
                .chunks_exact(kind.size())
                .map(|number| from_bytes(kind, number))
                .collect());
        }
        // A header may promise more than the file holds: at least two bytes make one number.
        let mut numbers = Vec::with_capacity(n.min((self.bytes.len() - self.at) / 2 + 1));
        for i in 0..n {
            let (start, word) = self
                .word()
                .ok_or_else(|| self.truncated(&format!("{n} numbers for {what}, got {i}")))?;
            let Some(number) = from_text(word) else {
                let expected = format!("number {i} of {n} for {what}");
                if self.is_cut_off() {
                    return Err(self.truncated(&expected));
                }
                return Err(self.error_at(start, &expected, format!("{word:?}")));
            };
            numbers.push(number);
        }
        Ok(numbers)
    }

    /// The next `n` bytes.
    pub(super) fn take(&mut self, n: usize, what: &str) -> Result<&'a [u8], MeshError> {
        let rest = &self.bytes[self.at..];
        let Some(taken) = rest.get(..n) else {
            return Err(self.truncated(&format!("{n} bytes for {what}, got {}", rest.len())));
        };
        self.at += n;
        Ok(taken)
    }

    fn word(&mut self) -> Option<(usize, &'a str)> {
        self.skip_white();
        let rest = &self.bytes[self.at..];
        let length = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        let start = self.at;
        self.at += length;
        // Bytes that are no text cannot be a number either: the empty word fails as one.
        (length > 0).then(|| (start, std::str::from_utf8(&rest[..length]).unwrap_or_default()))
    }

    fn skip_white(&mut self) {
        let rest = &self.bytes[self.at..];
        self.at += rest.iter().position(|b| !b.is_ascii_whitespace()).unwrap_or(rest.len());
    }
}

/// A real number as any C library prints it: some write `nan(ind)` or `-nan`.
fn parse_real(word: &str) -> Option<f64> {
    word.parse().ok().or_else(|| {
        let unsigned = word.trim_start_matches(['-', '+']).to_ascii_lowercase();
        unsigned.starts_with("nan(").then_some(f64::NAN)
    })
}
