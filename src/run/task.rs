//! Work that is shared by tasks of a job array.

use std::str::FromStr;

/// The share of one task: the pieces whose number leaves the rest `task` by `of`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Task {
    /// Number of the task, from 0.
    pub task: usize,
    /// Number of tasks.
    pub of: usize,
}

impl Task {
    /// Whether the piece of this number is this task's.
    pub fn has(&self, piece: usize) -> bool {
        piece % self.of == self.task
    }
}

impl FromStr for Task {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let parts =
            text.split_once('/').and_then(|(k, n)| Some((k.parse().ok()?, n.parse().ok()?)));
        match parts {
            Some((task, of)) if task < of => Ok(Self { task, of }),
            _ => Err("expected K/N with K from 0 to N − 1, such as 0/8".to_owned()),
        }
    }
}
