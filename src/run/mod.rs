//! What the program does, for programs.

pub mod atrium;
