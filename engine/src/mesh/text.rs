//! The lines of a text file, with the place for errors.

use super::{MeshError, Place};
use std::borrow::Cow;
use std::path::Path;

/// Walks through the lines of a text file.
#[derive(Debug)]
pub(super) struct Lines<'a> {
    path: &'a Path,
    rest: &'a [u8],
    /// The line that was read last, counted from 1.
    line: usize,
}

impl<'a> Lines<'a> {
    /// Stands before the first line.
    pub(super) fn new(path: &'a Path, bytes: &'a [u8]) -> Self {
        Self { path, rest: bytes, line: 0 }
    }

    /// The next line that is not blank, trimmed; `None` at the end of the file.
    pub(super) fn next(&mut self) -> Option<Cow<'a, str>> {
        while !self.rest.is_empty() {
            let end = self.rest.iter().position(|byte| *byte == b'\n').unwrap_or(self.rest.len());
            let (line, rest) = self.rest.split_at(end);
            self.rest = rest.get(1..).unwrap_or_default();
            self.line += 1;
            let line = line.trim_ascii();
            if !line.is_empty() {
                return Some(String::from_utf8_lossy(line));
            }
        }
        None
    }

    /// Like [`Self::next`], where the file may not end.
    pub(super) fn expect(&mut self, expected: &str) -> Result<Cow<'a, str>, MeshError> {
        self.next().ok_or_else(|| MeshError::Truncated {
            path: self.path.into(),
            place: Place::Line(self.line),
            expected: expected.into(),
        })
    }

    /// Bytes and lines read so far, of `n_bytes` in all.
    pub(super) fn position(&self, n_bytes: usize) -> (usize, usize) {
        (n_bytes - self.rest.len(), self.line)
    }

    /// An error on the line that was read last.
    pub(super) fn wrong(&self, expected: &str, got: &str) -> MeshError {
        let start: String = got.chars().take(40).collect();
        MeshError::Parse {
            path: self.path.into(),
            place: Place::Line(self.line),
            expected: expected.into(),
            got: format!("{start:?}"),
        }
    }

    /// The next three words as coordinates; more may follow.
    pub(super) fn point<'w>(
        &self,
        words: &mut impl Iterator<Item = &'w str>,
    ) -> Result<[f64; 3], MeshError> {
        let mut point = [0.0; 3];
        for x in &mut point {
            let word = words.next().unwrap_or_default();
            *x = word.parse().map_err(|_| self.wrong("three coordinates", word))?;
        }
        Ok(point)
    }
}
