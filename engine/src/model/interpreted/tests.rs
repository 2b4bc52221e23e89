use eplat_language::File;
use eplat_language::vocabulary::{Class, WORDS};

use super::Interpreted;
use super::kernels::Shape;
use super::likelihoods::Word;
use super::priors::Family;

/// Words of the language that are left to the compiler.
const COMPILED: [&str; 2] = ["MultivariateNormal", "OrderedLogit"];

#[test]
fn every_word_of_the_language_is_read_or_known_to_be_left_to_the_compiler() {
    // what stands around others, or before a vector, is read by hand
    let by_hand = [
        "authors",
        "Censored",
        "Outliers",
        "Widened",
        "Mixture",
        "Dirichlet",
        "Ordered",
        "LkjCholesky",
        "SumToZero",
    ];
    for word in WORDS {
        let name = word.name;
        let is_read = word.classes.iter().all(|class| match class {
            Class::Prior => Family::of(name).is_some_and(|(_, n)| n == word.arguments.len()),
            Class::Kernel => Shape::of(name).is_some(),
            Class::Likelihood(kinds) => kinds.iter().all(|kind| {
                Word::of(kind, name).is_some_and(|(_, takes)| takes.len() == word.arguments.len())
            }),
            Class::Joint => false,
        });
        let is_known = by_hand.contains(&name) || COMPILED.contains(&name);
        assert!(is_read != is_known, "{name}");
    }
}

/// What of a model is left to the compiler, if anything is. `around` stands beside it; `e` is a mean.
fn left(around: &str, e: &str) -> Option<String> {
    let source = format!(
        "use eplat::prelude::*;\n{around}\nmodel! {{\n    model M;\n    column dose;\n    param a ~ Normal(0.0, 1.0);\n    \
         param mu(2) ~ Normal(0.0, 1.0);\n    observe y(row): Number ~ {e};\n}}\n"
    );
    let file = File::read(&source).unwrap_or_else(|mistake| panic!("{}", mistake.message));
    Interpreted::of(&file).err().map(|beyond| beyond.0)
}

/// Where Rust means something else, or nothing, a model must not be read as if it meant what it looks like.
#[test]
fn what_only_a_compiler_understands_is_refused() {
    let mean = |e: &str| left("", &format!("Normal({e}, 1.0)"));
    for fine in ["a * 2", "2 * a", "2.0 * row.dose + a", "exp(2) + a", "-a.powi(2)", "mu[1]"] {
        assert_eq!(mean(fine), None, "{fine}");
    }
    for refused in [
        "1 / 2 + a",        // 0
        "2 * row.dose + a", // no such product
        "2.0.sqrt() + a",   // of which kind?
        "a.floor()",        // no such method
        "mu[2]",            // there are two
        "mu[0 + 1]",        // an expression
        "mu",               // a vector
        "a as f64",
        "if row.dose > 1.0 { a } else { mu[0] }",
        "{ let b = a; b }",
        "[a, mu[0]].iter().copied().sum::<Num<T>>()",
        "pow(2, 3) + a",
        "a % 2.0",
    ] {
        assert!(mean(refused).is_some(), "{refused}");
    }
    assert!(left("", "Mixture(0.5, Normal(a, 1.0), Normal(a, 2.0))").is_some());
    assert!(left("", "Widened(StudentT(3.0, a, 1.0), 0.5)").is_some());
    assert!(left("", "Outliers(Normal(a, 1.0), a, 3.0)").is_some());
}

#[test]
fn functions_of_numbers_are_read_and_others_named() {
    let of = |function: &str, e: &str| left(function, &format!("Normal({e}, 1.0)"));
    let generic = "fn f<D: Real>(x: D, y: D) -> D { let z = x * y; z - 1.0 }";
    assert_eq!(of(generic, "f(a, mu[0])"), None);
    assert_eq!(of(generic, "a + f(row.dose, 2.0)"), None);
    // two types
    assert!(of(generic, "f(a, row.dose)").is_some());
    // a plain number on the left
    assert!(of("fn f<D: Real>(x: D) -> D { 2.0 * x }", "f(a)").is_some());
    assert_eq!(of("fn f<T: Real>(x: Num<T>) -> Num<T> { 2 * x }", "f(a)"), None);
    assert!(of("fn f<T: Real>(x: Num<T>) -> Num<T> { 2 * x }", "a + f(row.dose)").is_some());
    // a result of another type
    assert!(of("fn f<T: Real>(x: Num<T>) -> Num<T> { 1.0 }", "f(a)").is_some());
    assert!(of("fn f<D: Real>(x: D) -> D { 1.0 }", "f(a)").is_some());
    assert!(of("fn f(x: f64) -> f64 { 1 }", "a + f(2.0)").is_some());
    // it would never end
    assert!(of("fn f<D: Real>(x: D) -> D { f(x) }", "f(a)").is_some());
    let named = |around: &str| left(around, "Normal(a, 1.0)").unwrap();
    assert_eq!(named("fn f<D: Real>(x: &[D]) -> D { x[0] }"), "fn f");
    assert_eq!(named("fn f<D: Real>(x: D) -> D { for _ in 0..3 {} x }"), "fn f");
    assert_eq!(named("struct Own;"), "struct Own");
    assert_eq!(named("mod other;"), "mod other");
    assert_eq!(named("const N: usize = 3;"), "const N");
    assert_eq!(named("use std::f64::consts::PI;"), "use std::f64::consts::PI;");
}
