//! The words of the language: keywords, units, and what the distributions, kernels and forms that ship
//! take. A test of the library holds this table against what the library exports.

use quote::ToTokens as _;
use syn::Expr;

/// The words that begin a statement.
pub(crate) const KEYWORDS: &[&str] =
    &["param", "field", "let", "column", "observe", "effect", "density", "hyper"];

/// Names of units; a number after one is its power (`ms2`).
const UNITS: &[&str] = &[
    "1", "%", "ms", "s", "min", "mm", "cm", "m", "ms2", "mm2", "Hz", "mV", "mA", "g", "ohm", "deg",
    "degC",
];

/// What an argument is to the quantity that is described.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Of the same unit: a location, a scale, a bound.
    Same,
    /// Of the inverse unit: a rate.
    Inverse,
    /// Something else: a shape, a share, a number of trials.
    Other,
    /// A distribution or a likelihood.
    Inner,
}

/// What a word of the language stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Class {
    /// A prior of one number.
    Prior,
    /// A prior of a whole vector.
    Joint,
    /// A kernel.
    Kernel,
    /// A likelihood of a measurement of these kinds.
    Likelihood(&'static [&'static str]),
}

/// A function of the prelude that builds a prior, a kernel or a likelihood.
#[derive(Clone, Copy, Debug)]
pub struct Word {
    /// Its name.
    pub name: &'static str,
    /// What it may stand for.
    pub classes: &'static [Class],
    /// Its arguments, with what each is.
    pub arguments: &'static [(&'static str, Role)],
}

use Class::{Joint, Kernel, Likelihood, Prior};
use Role::{Inner, Inverse, Other, Same};

/// A distribution that is also the likelihood of a Number.
const BOTH: &[Class] = &[Prior, Likelihood(&["Number"])];
const COUNT: &[Class] = &[Likelihood(&["Count"])];
const BRACKET: &[Class] = &[Likelihood(&["Bracket"])];
const NORMAL_ERRORS: &[Class] = &[Likelihood(&["Bracket", "Number"])];
const ANY: &[Class] = &[Likelihood(&["Bracket", "Number", "Count"])];

const fn word(
    name: &'static str,
    classes: &'static [Class],
    arguments: &'static [(&'static str, Role)],
) -> Word {
    Word { name, classes, arguments }
}

/// The words that ship.
pub const WORDS: &[Word] = &[
    word("Normal", BOTH, &[("mean", Same), ("sd", Same)]),
    word("StudentT", BOTH, &[("nu", Other), ("location", Same), ("scale", Same)]),
    word("Cauchy", BOTH, &[("location", Same), ("scale", Same)]),
    word("Laplace", BOTH, &[("location", Same), ("scale", Same)]),
    word("LogNormal", BOTH, &[("mean", Other), ("sd", Other)]),
    word("Gamma", BOTH, &[("shape", Other), ("rate", Inverse)]),
    word("Exponential", BOTH, &[("rate", Inverse)]),
    word("HalfNormal", &[Prior], &[("sd", Same)]),
    word("HalfCauchy", &[Prior], &[("scale", Same)]),
    word("HalfStudentT", &[Prior], &[("nu", Other), ("scale", Same)]),
    word("InvGamma", &[Prior], &[("shape", Other), ("scale", Same)]),
    word("Beta", &[Prior], &[("a", Other), ("b", Other)]),
    word("Uniform", &[Prior], &[("low", Same), ("high", Same)]),
    word(
        "TruncatedNormal",
        &[Prior],
        &[("mean", Same), ("sd", Same), ("low", Same), ("high", Same)],
    ),
    word("Flat", &[Prior], &[]),
    word("FlatPositive", &[Prior], &[]),
    word("FlatBetween", &[Prior], &[("low", Same), ("high", Same)]),
    word("Dirichlet", &[Joint], &[("concentration", Other)]),
    word("Ordered", &[Joint], &[("prior", Inner)]),
    word("Rbf", &[Kernel], &[("lengthscale", Same)]),
    word("Matern12", &[Kernel], &[("lengthscale", Same)]),
    word("Matern32", &[Kernel], &[("lengthscale", Same)]),
    word("Matern52", &[Kernel], &[("lengthscale", Same)]),
    word("authors", &[Kernel], &[("kernel", Inner)]),
    word("TopHat", BRACKET, &[("f", Same)]),
    word("Interval", BRACKET, &[("f", Same), ("sigma", Same)]),
    word("PoissonLog", COUNT, &[("eta", Other)]),
    word("BernoulliLogit", COUNT, &[("eta", Other)]),
    word("BinomialLogit", COUNT, &[("n", Other), ("eta", Other)]),
    word("NegBinomialLog", COUNT, &[("eta", Other), ("phi", Other)]),
    word("OrderedLogit", COUNT, &[("eta", Other), ("cut", Other)]),
    word("Outliers", NORMAL_ERRORS, &[("likelihood", Inner), ("share", Other), ("sd", Same)]),
    word("Widened", NORMAL_ERRORS, &[("likelihood", Inner), ("sd", Same)]),
    word("Mixture", ANY, &[("share", Other), ("a", Inner), ("b", Inner)]),
];

/// The word of this name.
pub fn find(name: &str) -> Option<&'static Word> {
    WORDS.iter().find(|word| word.name == name)
}

/// Names of the units.
pub(crate) fn unit_names() -> impl Iterator<Item = &'static str> {
    UNITS.iter().copied()
}

/// Whether this is the name of a unit.
pub(crate) fn is_unit(name: &str) -> bool {
    UNITS.contains(&name)
}

/// Whether an expression calls a prior of a whole vector.
pub(crate) fn is_joint(prior: &Expr) -> bool {
    let Expr::Call(call) = prior else { return false };
    let name = call.func.to_token_stream().to_string();
    find(&name).is_some_and(|word| word.classes.contains(&Joint))
}

/// The name that is nearest to a misspelt one: at most a third of its letters differ.
pub(crate) fn nearest<'a>(name: &str, known: &[&'a str]) -> Option<&'a str> {
    let far = (name.chars().count() / 3).max(1);
    let near = known.iter().map(|k| (distance(name, k), *k)).filter(|(d, _)| *d > 0 && *d <= far);
    near.min_by_key(|(d, _)| *d).map(|(_, k)| k)
}

/// Levenshtein distance: letters to change, add or leave out.
fn distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().enumerate() {
        let mut diagonal = std::mem::replace(&mut row[0], i + 1);
        for (j, y) in b.iter().enumerate() {
            let least = (diagonal + usize::from(x != *y)).min(row[j] + 1).min(row[j + 1] + 1);
            diagonal = std::mem::replace(&mut row[j + 1], least);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_word_is_found_and_nothing_far_away() {
        assert_eq!(nearest("InvGama", &["Gamma", "InvGamma"]), Some("InvGamma"));
        assert_eq!(nearest("parm", KEYWORDS), Some("param"));
        assert_eq!(nearest("msec", &["ms", "mm"]), None);
        assert_eq!(distance("kitten", "sitting"), 3);
    }
}
