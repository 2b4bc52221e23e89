//! `model!`.
