//! The likeliest mistakes in a model file, and what the compiler then says.
//!
//! The texts are those of the Rust release that `rust-version` names; after a change:
//! `TRYBUILD=overwrite cargo test --release --test ui`, and read them as a newcomer would.

#[test]
fn mistakes_in_a_model_file_are_explained_at_their_token() {
    trybuild::TestCases::new().compile_fail("tests/ui/*.rs");
}
