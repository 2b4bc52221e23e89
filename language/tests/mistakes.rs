//! What is said about the mistakes in `tests/mistakes/*.rs` of the package, without a compiler; and
//! about more of them, each in a statement or two.

#![allow(clippy::unwrap_used, clippy::too_many_lines, reason = "tests: a table of cases")]

use std::fs;
use std::path::Path;

use eplat_language::File;

/// What is said about the file of this text.
fn said(name: &str, text: &str) -> Vec<String> {
    let mistakes = match File::read(text) {
        Ok(file) => file.check(),
        Err(mistake) => vec![mistake],
    };
    mistakes.iter().map(|mistake| mistake.show(name, text)).collect()
}

/// Not mistakes of the language: rustc's business, or none.
const NO_MISTAKE: [&str; 4] =
    ["column_on_the_left", "f64_function", "integer_in_an_expression", "number_on_the_left"];

#[test]
fn the_mistakes_of_the_program_are_told_from_the_text() {
    let package = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let (mut n, mut differ) = (0, vec![]);
    for entry in fs::read_dir(package.join("tests/mistakes")).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_str().unwrap();
        let said = said(&format!("{name}.rs"), &fs::read_to_string(&path).unwrap());
        n += 1;
        if NO_MISTAKE.contains(&name) {
            assert!(said.is_empty(), "{name}: {said:?}");
            continue;
        }
        let snapshot = package.join(format!("tests/snapshots/mistakes__{name}.snap"));
        if std::env::var_os("UPDATE").is_some() {
            let head = "---\nsource: tests/mistakes.rs\nexpression: said\n---\nerror: ";
            fs::write(&snapshot, format!("{head}{}\n", said.join("\n\nerror: "))).unwrap();
        }
        let snapshot = fs::read_to_string(snapshot).unwrap();
        let (_, expected) = snapshot.split_once("error: ").unwrap();
        if said.join("\n\nerror: ") != expected.trim_end() {
            differ.push(format!("{name}: {}\n{}", said.join("\n\nerror: "), expected));
        }
    }
    assert_eq!(n, 32);
    assert!(differ.is_empty(), "{}", differ.join("\n"));
}

/// Each mistake in a model of these statements, as `marked token: message; help`.
fn in_words(statements: &str) -> Vec<String> {
    let text = format!(
        "use eplat::prelude::*;\nconst LOW: f64 = 1.0;\nfn half<D: Real>(x: D) -> D {{ x * 0.5 }}\nmodel! {{\nmodel Case;\n{statements}\n}}\n"
    );
    let file = File::read(&text).unwrap_or_else(|m| panic!("{}", m.show("m.rs", &text)));
    let words =
        |m: &eplat_language::Mistake| format!("{}: {}; {}", &text[m.range()], m.message, m.help);
    file.check().iter().map(words).collect()
}

/// A field, a `let` and a vector, which the statements of the cases below come after.
const ABOVE: &str = "
    param mu ~ Normal(0, 1);
    param beta(3) ~ Normal(0, 1);
    param alpha(operator) ~ Normal(0, 1);
    column dose;
    field f(x) = m + a * gp(Rbf(rho), K = 4) where { m ~ Flat; a ~ Flat; rho ~ Flat; }
    let g(x) = f(x) + mu;
";

#[test]
fn each_mistake_is_told_in_words() {
    let below = "observe y(x): Number ~ Normal(g(x), 1);";
    for (statement, expected) in [
        // names
        ("let h(x) = mu(x);", "mu: `mu` is the same in every row; write `mu`"),
        (
            "let h(x) = beta(x);",
            "beta: `beta` is the same in every row; write `beta[0]` for its first number",
        ),
        ("let h(x) = alpha;", "alpha: `alpha` is used without its row; write `alpha(x)`"),
        ("let h(row) = f(row) + g(x);", "g: `g` takes its row and nothing else; write `g(row)`"),
        ("let h(x) = dose;", "dose: unknown name `dose`; a column of the row is written `x.dose`"),
        (
            "let h(x) = x.dosa;",
            "dosa: no column `dosa` is declared; did you mean `dose`? Else declare it: `column dosa [unit];` (declared are: `dose`)",
        ),
        (
            "density d(data) = half(data.y);",
            "y: no column `y` is declared; declare it: `column y [unit];` (declared are: `dose`)",
        ),
        ("let h(x) = hlf(mu);", "hlf: unknown name `hlf`; did you mean `half`?"),
        (
            "let h(x) = h(x);",
            "h: unknown name `h`; a statement does not see the name that it declares",
        ),
        (
            "param b ~ Normal(f(x), 1);",
            "f: `f` has a value in each row, and none here; priors, means, kernels and densities see parameters alone",
        ),
        (
            "observe z(row): Number from (row.dose * mu) ~ Normal(0, 1);",
            "mu: `mu` is not known before the model is fitted; only columns, numbers and functions of these stand here",
        ),
        ("column dose;", "dose: `dose` is declared twice; give one of them another name"),
        (
            "effect mu on f = all(row) ~ Flat;",
            "mu: `mu` is declared twice; give one of them another name",
        ),
        // arrival times
        (
            "column age ~ Normal(50, 9); let t(row) = eikonal(f(row), row.age; row.source);",
            "age: `row.age` has no value between the rows; it is needed at every place of the surface: only fields, parameters and columns have a value there, and what is computed of these alone",
        ),
        (
            "column age ~ Normal(50, 9); let h(row) = f(row) * row.age; let t(row) = eikonal(h(row); row.source);",
            "h: `h` has no value between the rows; it is needed at every place of the surface: only fields, parameters and columns have a value there, and what is computed of these alone",
        ),
        (
            "let t(row) = eikonal(alpha(row); row.source);",
            "alpha: `alpha` has no value between the rows; it is needed at every place of the surface: only fields, parameters and columns have a value there, and what is computed of these alone",
        ),
        (
            "let t(row) = eikonal(f(row), 2.0; row.start);",
            "start: activation cannot start at column `start`; the column with the vertex at which it starts is called `source`",
        ),
        (
            "let t(row) = eikonal(f(row); row.source, row.start + mu);",
            "start: activation cannot start at column `start`; columns with further vertices at which it starts are called `source2`, `source3` and so on",
        ),
        (
            "let t(row) = eikonal(f(row); row.source, row.source2 + 2 * mu);",
            "mu: `2 * mu` is no parameter; by how much later activation starts is one parameter, `later`, or one for each label, `later(row)`",
        ),
        (
            "let t(row) = grdient(f(row); 2.0);",
            "grdient: unknown operator `grdient`; did you mean `gradient`? Operators over the surface are `eikonal`, `path`, `gradient`, and functions of the file that make one",
        ),
        ("let t(row) = half(f(row); mu);", "mu: `mu` is not known before the model is fitted; "),
        (
            "let t(x) = path(f(x); x.source); let s(x) = gradient(t(x));",
            "t: `t` has no value between the rows; it is needed at every place of the surface: only fields, parameters and columns have a value there, and what is computed of these alone",
        ),
        // fields
        (
            "field h(x) = m + gp(Rbf(2.0), K = 4) where { s ~ HalfNormal(t); t ~ Flat; m ~ Normal(0, s); }",
            "t: unknown name `t`; it is declared below, in line 13: put that statement above this one",
        ),
        (
            "field h(x) = m + gp(Rbf(2.0), K = 4) where { m ~ Flat; m ~ Flat; }",
            "m: `m` is declared twice; give one of them another name",
        ),
        (
            "field h(x) = m + gp(Rbf(2.0), K = 4) where { m(patient) ~ Flat; }",
            "patient: `m` has a value for each `patient`, and `h` has not; write `field h(x, patient)`, or `m` without `(patient)`",
        ),
        (
            "hyper wide { m ~ Flat; } field h(x) = m + gp(Rbf(2.0), K = 4) where wid;",
            "wid: unknown block of hyperparameters `wid`; did you mean `wide`?",
        ),
        (
            "field h(x) = m + gp(Rbf(2.0), K = 4) where shared wide; hyper wide { m ~ Flat; }",
            "wide: unknown name `wide`; it is declared below, in line 13: put that statement above this one",
        ),
        (
            "field h(x) = g(x) + gp(Rbf(2.0), K = 4);",
            "g: `g` has a value in each row, and none here; priors, means, kernels and densities see parameters alone",
        ),
        (
            "field h(x) within 1..31 = m + gp(Rbf(2.0), K = 4) where { m ~ Flat; }",
            "Flat: `m` has a flat prior, and `h` stays within a range; far outside the range one mean is as good as another: give it a prior such as `Normal(16.0, 10.0)`",
        ),
        (
            "param level ~ Flat; field h(x) within 1..31 = m + level + gp(Rbf(2.0), K = 4) where { m ~ Normal(0, 1); }",
            "Flat: `level` has a flat prior, and `h` stays within a range; far outside",
        ),
        // what takes what
        ("param b ~ Rbf(1.0);", "Rbf(1.0): `Rbf` is no prior; a prior is "),
        ("param b ~ Flat();", "Flat: `Flat` takes no arguments; write `Flat`"),
        (
            "param b ~ Normal;",
            "Normal: `Normal` takes 2 arguments but 0 arguments were supplied; write `Normal(mean, sd)`",
        ),
        (
            "param b ~ HalfNormal(1, 2);",
            "HalfNormal: `HalfNormal` takes 1 argument but 2 arguments were supplied; write `HalfNormal(1)`",
        ),
        (
            "field h(x) = gp(Normal(0, 1), K = 4);",
            "Normal(0, 1): `Normal` is no kernel; a kernel is Rbf, Matern12, Matern32, Matern52 or authors",
        ),
        (
            "field h(x) = gp(Rbf(1.0) * (Rbf(2.0) + Mater32(1.0)), K = 4);",
            "Mater32: unknown name `Mater32`; did you mean `Matern32`?",
        ),
        (
            "param b ~ Dirichlet(1.0);",
            "b: `b` is one number, and its prior is one of a whole vector; declare `param b(3) ~ PRIOR;`, or give it a prior of one number",
        ),
        (
            "param b(1) ~ Dirichlet(1.0);",
            "b: param b(1): proportions and ordered numbers come at least in twos; declare `param b(2) ~ PRIOR;` or more",
        ),
        (
            "observe z(x): Numbr ~ Normal(f(x), 1);",
            "Numbr: unknown name `Numbr`; did you mean `Number`? What is observed is a Bracket, a Number or a Count",
        ),
        (
            "observe z(x): Count ~ Outliers(Normal(f(x), 1), 0.1, 5.0);",
            "Normal(f(x), 1): `Normal` is not a likelihood of a `Count`; a Bracket takes ",
        ),
        (
            "observe z(x): Number ~ Censored(Outliers(Normal(f(x), 1), 0.1, 5.0), 0.05);",
            "Outliers(Normal(f(x), 1), 0.1, 5.0): `Outliers` cannot be censored; Censored takes Normal(mean, sd) or LogNormal(mean, sd); ",
        ),
        (
            "observe z(x): Bracket ~ Censored(TopHat(f(x)), 0.05);",
            "Censored(TopHat(f(x)), 0.05): `Censored` is not a likelihood of a `Bracket`; a Bracket takes ",
        ),
        (
            "let h(x) = linear(x.dose; beta);",
            "beta: let h: `beta` has 3 coefficients, the design has 1 columns; declare `param beta(1) ~ …;`",
        ),
        (
            "let h(x) = linear(x.dose; g);",
            "g: let h: `g` is no vector of coefficients; declare it above: `param g(1) ~ PRIOR;`",
        ),
        // effects
        (
            "let h(x) = mu; effect e on h = all(x) ~ Flat;",
            "h: effect e: `h` is neither a field nor a `let` that a measurement depends on; an effect acts on the name of a field or of a `let`, for instance `effect e on g = …`",
        ),
        (
            "effect e on f = linaer(x.dose) ~ Flat;",
            "linaer: unknown form of an effect `linaer`; did you mean `linear`? Forms are `linear(row.a, row.b)`, ",
        ),
        (
            "effect e on f = scaled(x.dose, 1.0) ~ Flat;",
            "scaled: `scaled` takes other arguments; write `scaled(row.a, CENTRE, SCALE)`",
        ),
        (
            "effect e on f = above(x.dose, mu) ~ Flat;",
            "mu: `mu` is not known before the model is fitted; only columns, numbers and functions of these stand here",
        ),
    ] {
        let said = in_words(&format!("{ABOVE}{statement}{below}"));
        assert_eq!(said.len(), 1, "{statement}: {said:#?}");
        assert!(said[0].starts_with(expected), "{statement}: {}", said[0]);
    }
}

#[test]
fn all_mistakes_are_told_at_once() {
    let said = in_words(
        "param b ~ Normal(c); let h(x) = x.dose + k; observe y(x): Count ~ Normal(h(x), b);",
    );
    assert_eq!(said.len(), 5, "{said:#?}");
}

#[test]
fn what_is_right_is_no_mistake() {
    for statement in [
        "let h(x) = { let t = f(x) * 2; t.max(mu) };",
        "let h(x) = beta.iter().fold(mu, |sum, b| sum + *b) * LOW;",
        "let h(x) = if f(x) > LOW { half(mu) } else { match 1 { n if n > 0 => mu, _ => g(x) } };",
        "let h(x) = (0..3).map(|i| beta[i]).sum::<D>() + D::from(x.dose) as f64;",
        "let h(x) = f(x) * mu; let t(x) = eikonal(h(x) + 0.2, 2.0, half(g(x)); x.source); let u(x) = t(x) + x.dose;",
        "let b(x) = eikonal(f(x); x.source, x.source2 + mu, x.source3 + alpha(x)); let w(x) = path(f(x) * x.dose; x.source); let s(x) = gradient(f(x) + mu); let v(x) = 1 / s(x);",
        "let n(x) = half(f(x), mu; 2.0, LOW); let o(x) = own::half(x.dose * f(x););",
        "let h(x) = std::f64::consts::PI * surrogate::erp_s2(f(x), mu);",
        "let alphas(x) = alpha(x); let g2(x) = g(x);",
        "let h(x) = linear(x.a, x.b; beta); let k(x) = linear(x.dose; mu);",
        "let half2(x) = [f(x), g(x)].map(half)[0];",
        "hyper smooth { m ~ Normal(mu, 1); rho ~ Flat; }
         field h(x, operator) = m + alpha * gp(Rbf(rho) * Matern12(rho), K = 4) where shared smooth;
         field k(x, operator) = m + c * gp(Rbf(rho), K = 4) where smooth { c(operator) ~ Normal(m, 1); }
         observe z(x): Bracket ~ Widened(TopHat(h(x) + k(x)), 1);",
        "column age ~ Normal(mu, 2); let h(x) = x.age * x.dose;",
        "effect e on f, g = smooth(row.other, LOW, 3, 2) ~ Normal(0, half(mu)); effect w on f = all(row) ~ Flat;",
        // a form of the file's own, by its name or in another place
        "effect e on f = half(row.other, LOW, 3) ~ Flat; effect w on f = my::form(row.other) ~ Flat;",
        "param w(2) ~ Ordered(Normal(mu, 1)); density w2 = half(w[0]) + beta[1];",
        "observe z(row): Number from (row.dose.ln() / LOW) ~ Mixture(0.1, Normal(mu, 1), Normal(0, 2));",
        "observe z(row): Count ~ Outliers(PoissonLog(mu), 0.1, 3);",
        "observe z(row): Number ~ Outliers(Widened(Censored(LogNormal(mu, 1), row.dose), 2), 0.1, 3);",
        "param t ~ TruncatedNormal(0, 1, -mu, mu * 2 + 1);",
    ] {
        let said = in_words(&format!("{ABOVE}{statement} observe y(x): Number ~ Normal(g(x), 1);"));
        assert!(said.is_empty(), "{statement}: {said:#?}");
    }
}

/// What is no operator over the surface cannot be read.
#[test]
fn an_operator_has_its_operands_and_a_source() {
    let of_path = "write `path(EXPRESSION; x.source)`: the integral along the way from the vertex in column `source`";
    for (value, token, message, help) in [
        ("path(mu)", "path", "`path` does not say where activation starts", of_path),
        (
            "eikonal(mu; row.source, row.source2)",
            "source2",
            "`row.source2` does not say by how much later it starts",
            "add a parameter: `eikonal(SLOWNESS; x.source, x.source2 + later)` with `param later [ms] ~ PRIOR;` above",
        ),
        ("path(mu, 2; row.source)", "path", "`path` does not say where activation starts", of_path),
        (
            "path(mu; source)",
            "source",
            "expected a column",
            "a column of the row is written `row.NAME`",
        ),
        (
            "gradient(mu; row.source)",
            ";",
            "this does not belong between these brackets",
            "take it out",
        ),
    ] {
        let text = format!(
            "use eplat::prelude::*;\nmodel! {{\nmodel Case;\nparam mu ~ Flat;\nlet t(row) = {value};\n}}\n"
        );
        let mistake = File::read(&text).map(drop).unwrap_err();
        let said = (&text[mistake.range()], &*mistake.message, &*mistake.help);
        assert_eq!(said, (token, message, help), "{value}");
    }
}
