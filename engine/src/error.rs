//! What the command line shows when something is wrong, and the exit code it leaves with.
//!
//! Every module has its own small error enum whose `Display` says what, where, expected, got and,
//! on a last line that begins with `help:`, what to do.  This module only carries such a text to the edge.

use std::fmt;
use std::path::Path;

use crate::store::advice;

/// A failure on its way to the user: a text and an exit code.
#[derive(Debug)]
pub struct Failure {
    message: String,
    code: u8,
}

impl Failure {
    /// Bad input or a failure while running: exit code 1.
    pub fn new(message: impl fmt::Display) -> Self {
        Self { message: message.to_string(), code: 1 }
    }

    /// A command line that makes no sense: exit code 2.
    pub fn usage(message: impl fmt::Display) -> Self {
        Self { message: message.to_string(), code: 2 }
    }

    /// A file that cannot be written, or whatever else `action` says: exit code 1.
    pub fn io(action: &str, path: &Path, error: &std::io::Error) -> Self {
        let help = advice(error);
        Self::new(format_args!("cannot {action} {}: {error}\nhelp: {help}", path.display()))
    }

    /// The exit code: 1 bad input or failure, 2 usage.
    pub fn code(&self) -> u8 {
        self.code
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl<E: std::error::Error> From<E> for Failure {
    fn from(error: E) -> Self {
        Self::new(error)
    }
}
