//! The model language of eplat, as text: one grammar, read once.
//!
//! [`parse`] turns the tokens of a `model! { … }` into one typed tree, [`syntax::Model`];
//! [`File::read`] finds the `model! { … }` of a model file first. [`check()`] resolves the names of the
//! tree and compares its units. What else is asked of a model's text is answered from the tree:
//! what an expression mentions ([`names`]), the calls that it stands for ([`plan`]), the model as equations
//! ([`equations()`]), and the same file with an effect added ([`File::with_added`]).
//!
//! Knows no numbers, no files and no data: everything here is tested on text alone.

mod around;
mod brackets;
mod check;
mod depends;
mod edit;
mod equations;
mod file;
mod grammar;
mod linear;
mod mistake;
pub mod names;
mod normal;
mod operator;
pub mod plan;
mod predictor;
mod print;
pub mod syntax;
mod units;
pub mod vocabulary;

pub use check::check;
pub use edit::{Added, FurtherError, as_name, is_name};
pub use equations::equations;
pub use file::File;
pub use grammar::{parse, parse_text};
pub use mistake::Mistake;
pub use predictor::Parted;
pub use print::print;
