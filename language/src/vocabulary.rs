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
    "rad", "degC",
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
const NUMBER: &[Class] = &[Likelihood(&["Number"])];
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
    word("MultivariateNormal", &[Joint], &[("mean", Same), ("covariance", Other)]),
    word("LkjCholesky", &[Joint], &[("eta", Other)]),
    word("SumToZero", &[Joint], &[("sd", Same)]),
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
    word("Censored", NUMBER, &[("likelihood", Inner), ("floor", Same)]),
    word("Outliers", ANY, &[("likelihood", Inner), ("share", Other), ("sd", Same)]),
    word("Widened", NORMAL_ERRORS, &[("likelihood", Inner), ("sd", Same)]),
    word("Mixture", ANY, &[("share", Other), ("a", Inner), ("b", Inner)]),
];

/// What else a model file sees by `use eplat::prelude::*;`.
pub const PRELUDE: &[&str] = &[
    "Bracket",
    "Number",
    "Count",
    "Dist",
    "Kernel",
    "Likelihood",
    "Observation",
    "Argument",
    "CholeskyFactor",
    "Covariance",
    "EffectForm",
    "Adjoints",
    "Everywhere",
    "Memo",
    "Operands",
    "Operator",
    "operator_error",
    "Measurements",
    "Num",
    "RealLine",
    "Sequence",
    "Step",
    "cholesky",
    "correlation_cholesky",
    "forms",
    "Support",
    "Real",
    "Rng",
    "RngExt",
    "abs",
    "cos",
    "exp",
    "ln",
    "log10",
    "max",
    "min",
    "pow",
    "sin",
    "sqrt",
    "tan",
    "tanh",
    "ln_gamma",
    "ln_logistic",
    "ln_sum_exp",
    "logistic",
    "model",
    "rand_distr",
    "surrogate",
];

/// Functions as other languages call them, and what they are here.
const ELSEWHERE: &[(&str, &str)] = &[
    ("log", "`ln(x)` or `log10(x)`"),
    ("log1p", "`x.ln_1p()`"),
    ("expm1", "`x.exp_m1()`"),
    ("fabs", "`abs(x)`"),
    ("fmax", "`max(a, b)`"),
    ("fmin", "`min(a, b)`"),
    ("square", "`pow(x, 2)`"),
    ("power", "`pow(x, y)`"),
    ("inv_logit", "`logistic(x)`"),
    ("expit", "`logistic(x)`"),
    ("sigmoid", "`logistic(x)`"),
    ("plogis", "`logistic(x)`"),
    ("lgamma", "`ln_gamma(x)`"),
    ("gammaln", "`ln_gamma(x)`"),
    ("log_sum_exp", "`ln_sum_exp(&[a, b])`"),
    ("logsumexp", "`ln_sum_exp(&[a, b])`"),
];

/// What a function of other languages is written as here.
pub(crate) fn elsewhere(name: &str) -> Option<&'static str> {
    ELSEWHERE.iter().find(|(other, _)| *other == name).map(|(_, here)| *here)
}

/// What is observed, unless it is a type of the user's.
pub(crate) const KINDS: &[&str] = &["Bracket", "Number", "Count"];

/// What every Rust file sees.
pub(crate) const RUST: &[&str] = &[
    "bool", "char", "f32", "f64", "i8", "i16", "i32", "i64", "i128", "isize", "str", "u8", "u16",
    "u32", "u64", "u128", "usize", "Box", "Clone", "Copy", "Default", "Err", "Fn", "From", "Into",
    "Iterator", "None", "Ok", "Option", "Result", "Self", "Some", "String", "Vec", "drop", "core",
    "std", "eplat", "D", "_", "as", "break", "const", "continue", "crate", "dyn", "else", "false",
    "fn", "for", "if", "impl", "in", "let", "loop", "match", "move", "mut", "ref", "return",
    "self", "static", "super", "true", "type", "unsafe", "use", "where", "while",
];

/// The right-hand side of an effect.
#[derive(Clone, Copy, Debug)]
pub struct Shape {
    /// Its name.
    pub name: &'static str,
    /// How many columns it takes; `None` for one or more.
    pub columns: Option<usize>,
    /// How many numbers stand behind them.
    pub numbers: usize,
    /// How it is written.
    pub written: &'static str,
}

const fn form(
    name: &'static str,
    columns: Option<usize>,
    numbers: usize,
    written: &'static str,
) -> Shape {
    Shape { name, columns, numbers, written }
}

/// The forms of effects that ship; each but `linear` is a function of `eplat::model::forms`.
pub const FORMS: &[Shape] = &[
    form("linear", None, 0, "linear(row.a, row.b)"),
    form("scaled", Some(1), 2, "scaled(row.a, CENTRE, SCALE)"),
    form("scaled_by", Some(2), 2, "scaled_by(row.a, row.label, CENTRE, SCALE)"),
    form("saturating", Some(1), 1, "saturating(row.a, CENTRE)"),
    form("smooth", Some(1), 3, "smooth(row.a, LOW, HIGH, DEGREE)"),
    form("above", Some(1), 1, "above(row.a, THRESHOLD)"),
    form("logistic", Some(1), 2, "logistic(row.a, CENTRE, SCALE)"),
    form("group", Some(1), 0, "group(row.a)"),
    form("family", Some(1), 0, "family(row.a)"),
    form("all", Some(0), 0, "all(row)"),
    form("surface", Some(0), 2, "surface(row, MODES, LENGTHSCALE)"),
    form("path", Some(0), 2, "path(row, MODES, LENGTHSCALE)"),
];

/// The form of this name that ships.
pub fn shape(name: &syn::Ident) -> Option<&'static Shape> {
    FORMS.iter().find(|shape| name == shape.name)
}

/// The words of which this holds, as a list to read.
pub(crate) fn listed(is_one: impl Fn(&Word) -> bool) -> String {
    let names: Vec<&str> = WORDS.iter().filter(|word| is_one(word)).map(|word| word.name).collect();
    match &names[..] {
        [all @ .., last] if !all.is_empty() => format!("{} or {last}", all.join(", ")),
        names => names.join(""),
    }
}

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
