//! A model file with statements added: the user's own text, in which only what is new is new.

use std::fmt::Write as _;
use std::ops::Range;

use proc_macro2::{Ident as Word, Span};
use quote::ToTokens as _;
use unicode_ident::{is_xid_continue, is_xid_start};

use crate::file::File;
use crate::grammar::{first_span, last_span, parse};
use crate::mistake::Mistake;
use crate::print::print;
use crate::syntax::{Expr, Ident, Item, Let, Model, Observe, Param, Value};

/// What is added to a model.
#[derive(Clone, Debug, Default)]
pub struct Added {
    /// `param`, `let` and `effect` statements, each with the lines above it that say why, in their order.
    pub statements: Vec<(String, String)>,
    /// `observe`s whose measurements have a further error.
    pub row_errors: Vec<FurtherError>,
    /// Share and sd of outliers: every likelihood is put within `Outliers(…, share, sd)`.
    pub outliers: Option<(f64, f64)>,
}

/// A further error of the measurements of an `observe`. Its likelihood is put within `Widened(…, SD)` or,
/// with scatter, within `Widened(…, SD * exp(SCATTER(row)))`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FurtherError {
    /// The name of the `observe`.
    pub observe: String,
    /// The parameter that is its sd; its statement is added too.
    pub sd: String,
    /// The `let` of the row that is ln of a factor of the sd; its statement is added too.
    pub scatter: Option<String>,
}

impl FurtherError {
    /// The sd of the row of this name.
    fn of(&self, row: &Ident) -> Expr {
        let name = |name: &str| Ident::new(name, proc_macro2::Span::call_site());
        let sd = name(&self.sd);
        match self.scatter.as_deref().map(name) {
            Some(scatter) => syn::parse_quote!(#sd * exp(#scatter(#row))),
            None => syn::parse_quote!(#sd),
        }
    }

    /// Whether a statement of this name must stand before the likelihood.
    fn mentions(&self, name: &Ident) -> bool {
        name == &self.sd || self.scatter.as_ref().is_some_and(|scatter| name == scatter)
    }
}

impl Model {
    /// Puts the likelihood of every `observe` within `Outliers(…, share, sd)`.
    pub fn add_outliers(&mut self, share: f64, sd: f64) {
        let [share, sd] = [share, sd].map(proc_macro2::Literal::f64_unsuffixed);
        self.change_likelihoods(|observe| {
            let likelihood = &observe.likelihood;
            syn::parse_quote!(Outliers(#likelihood, #share, #sd))
        });
    }

    /// Gives the measurements of an `observe` a further error.
    pub fn add_row_error(&mut self, error: &FurtherError) {
        self.change_likelihoods(|observe| {
            let (likelihood, sd) = (&observe.likelihood, error.of(&observe.row));
            if observe.name == error.observe {
                syn::parse_quote!(Widened(#likelihood, #sd))
            } else {
                likelihood.clone()
            }
        });
    }

    fn change_likelihoods(&mut self, change: impl Fn(&Observe) -> Expr) {
        for statement in &mut self.statements {
            if let Item::Observe(observe) = &mut statement.item {
                observe.likelihood = change(observe);
            }
        }
    }
}

impl File {
    /// `source`, which this file was read from, with more in its model. A parameter that a likelihood
    /// mentions stands before the first `observe`, everything else at the end.
    ///
    /// # Errors
    /// A text that is not one `param`, `let` or `effect` statement. What is written is printed from its tree.
    pub fn with_added(&self, source: &str, added: &Added) -> Result<String, Mistake> {
        let (mut errors, mut others) = (String::new(), String::new());
        for (statement, why) in &added.statements {
            let item = self::statement(statement)?;
            let is_error = added.row_errors.iter().any(|error| error.mentions(item.name()));
            let to = if is_error { &mut errors } else { &mut others };
            to.push('\n');
            for line in why.lines() {
                let _ = writeln!(to, "    /// {}", line.replace('\r', " "));
            }
            let _ = writeln!(to, "    {}", text(&item));
        }
        let end = self.brackets.end - 1;
        let first = if errors.is_empty() { 0 } else { self.before_observes(source) };
        let mut text = source[..first].trim_end().to_owned();
        if !errors.is_empty() {
            text = text + "\n" + &errors + "\n";
        }
        text += &self.with_likelihoods(source, first..end, added);
        text.truncate(text.trim_end().len());
        Ok(text + "\n" + &others + &source[end..])
    }

    /// Where the line of the first `observe` begins, or of the comment above it.
    fn before_observes(&self, source: &str) -> usize {
        let name = self.model.observes().next().map(|observe| observe.name.span().byte_range());
        let word = name.and_then(|name| source[..name.start].rfind("observe"));
        let Some(word) = word else { return self.brackets.end - 1 };
        let line_of = |at: usize| source[..at].rfind('\n').map_or(0, |end| end + 1);
        let mut first = line_of(word);
        if !source[first..word].trim().is_empty() {
            return word; // something else stands before it on its line
        }
        while first > 0 {
            let above = line_of(first - 1);
            if !source[above..first].trim_start().starts_with("//") {
                break;
            }
            first = above;
        }
        first
    }

    /// A part of the text with the likelihoods in it as they become.
    fn with_likelihoods(&self, source: &str, part: Range<usize>, added: &Added) -> String {
        let (mut text, mut done) = (String::new(), part.start);
        for observe in self.model.observes() {
            let start = first_span(&observe.likelihood).byte_range().start;
            let end = last_span(&observe.likelihood).byte_range().end;
            text += &source[done..start];
            let mut likelihood = source[start..end].trim().to_owned();
            for error in added.row_errors.iter().filter(|error| observe.name == error.observe) {
                likelihood = format!("Widened({likelihood}, {})", print(&error.of(&observe.row)));
            }
            if let Some((share, sd)) = added.outliers {
                likelihood = format!("Outliers({likelihood}, {share:?}, {sd:?})");
            }
            text += &likelihood;
            done = end;
        }
        text + &source[done..part.end]
    }
}

/// Whether a text can be the name of a column or of an effect in a model file.
pub fn is_name(text: &str) -> bool {
    let mut signs = text.chars();
    let is_spelt = signs.next().is_some_and(|first| first == '_' || is_xid_start(first))
        && signs.all(is_xid_continue);
    // a text that is parsed is kept as long as its thread, for the places of its parts; an identifier is not
    is_spelt && syn::parse2::<Word>(Word::new(text, Span::call_site()).into_token_stream()).is_ok()
}

/// The name under which a model file reads the column of this header, and the name of an effect of it:
/// letters, digits and `_` as they are, one `_` for whatever else stands between them.
///
/// ```
/// use eplat_language::as_name;
/// assert_eq!(["force_g", "contact force (g)"].map(as_name), ["force_g", "contact_force_g"]);
/// assert_eq!(["dV/dt", "2nd", "type", "%"].map(as_name), ["dV_dt", "_2nd", "type_", "unnamed"]);
/// ```
pub fn as_name(header: &str) -> String {
    if is_name(header) {
        return header.to_owned();
    }
    let words: Vec<&str> =
        header.split(|c| !is_xid_continue(c)).filter(|word| !word.is_empty()).collect();
    let name = words.join("_");
    let tries = [name.clone(), format!("{name}_"), format!("_{name}")];
    tries.into_iter().find(|name| is_name(name)).unwrap_or_else(|| "unnamed".into())
}

/// One `param`, `let` or `effect` statement.
fn statement(text: &str) -> Result<Item, Mistake> {
    let wrong = |help: &str| {
        let message = format!("`{text}` is not one statement");
        Mistake::at(proc_macro2::Span::call_site(), message, help)
    };
    let tokens = format!("model M; {text}").parse();
    let tokens = tokens.map_err(|_| wrong("names in it must be those of Rust"))?;
    let model = parse(tokens).map_err(|mistake| wrong(&mistake.message))?;
    let mut statements = model.statements.into_iter().map(|statement| statement.item);
    match (statements.next(), statements.next()) {
        (Some(item @ (Item::Effect(_) | Item::Param(_) | Item::Let(_))), None) => Ok(item),
        _ => Err(wrong("write `effect NAME on LET [unit] = linear(row.COLUMN) ~ PRIOR;`")),
    }
}

/// The statement, as a person would write it.
fn text(item: &Item) -> String {
    match item {
        Item::Effect(effect) => effect.text(),
        Item::Param(Param { name, unit, prior, .. }) => {
            let unit = unit.as_ref().map_or(String::new(), |unit| format!(" [{}]", unit.text));
            format!("param {name}{unit} ~ {};", print(&prior.expr))
        }
        Item::Let(Let { name, row, value: Value::Expr(value), .. }) => {
            format!("let {name}({row}) = {};", print(value))
        }
        _ => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FORCE: &str = "effect force on erp_s2, erp_s3 [ms] = scaled(row.force_g, 15.0, 7.25) ~ Normal(0.0, 10.0);";

    fn rewritten(
        source: &str,
        effects: &[(&str, &str)],
        outliers: Option<(f64, f64)>,
    ) -> Result<String, Mistake> {
        let statements = effects.iter().map(|(e, w)| ((*e).into(), (*w).into())).collect();
        File::read(source)?.with_added(source, &Added { statements, row_errors: vec![], outliers })
    }

    #[test]
    fn the_statement_stands_before_the_bracket_that_closes_the_model() {
        let source = "// model! { not this }\nmodel! {\n    /// a } in a comment\n    model M;\n    let a(x) = f(\"}\");\n}\nfn f() {}\n";
        let text = rewritten(source, &[(FORCE, "why")], None).unwrap();
        let expected =
            format!("    let a(x) = f(\"}}\");\n\n    /// why\n    {FORCE}\n}}\nfn f() {{}}\n");
        assert!(text.ends_with(&expected), "{text}");
        assert!(text.starts_with("// model! { not this }\nmodel! {\n    /// a }"), "{text}");
    }

    #[test]
    fn outliers_surround_every_likelihood() {
        let source = "// observe ä ~ b;\nmodel! {\n    model M;\n    observe s1s2(x):   Bracket [ms] ~ TopHat(erp(x)); // observe\n    observe y(x): Number ~ Normal(f(x), s); /* ~ */\n}\n";
        let text = rewritten(source, &[], Some((0.05, 50.0))).unwrap();
        let expected = "// observe ä ~ b;\nmodel! {\n    model M;\n    observe s1s2(x):   Bracket [ms] ~ Outliers(TopHat(erp(x)), 0.05, 50.0); // observe\n    observe y(x): Number ~ Outliers(Normal(f(x), s), 0.05, 50.0); /* ~ */\n}\n";
        assert_eq!(text, expected);
    }

    #[test]
    fn an_error_of_rows_is_declared_above_the_likelihoods_that_mention_it() {
        let source = "model! {\n    model M;\n    let a(x) = 1.0;\n\n    // why\n    observe s1s2(x): Bracket [ms] ~ TopHat(a(x));\n    observe y(x): Number ~ Normal(a(x), 1.0);\n}\n";
        let why = |what: &str| format!("why {what}");
        let added = Added {
            statements: vec![
                ("param row_error [ms] ~ HalfNormal(10.0);".into(), why("rows")),
                ("param site_sd [ms] ~ HalfNormal(10.0);".into(), why("sites")),
                (
                    "effect site on a [ms] = group(row.site) ~ Normal(0.0, site_sd);".into(),
                    why("so"),
                ),
            ],
            row_errors: vec![FurtherError {
                observe: "s1s2".into(),
                sd: "row_error".into(),
                scatter: None,
            }],
            outliers: Some((0.05, 50.0)),
        };
        let text = File::read(source).unwrap().with_added(source, &added).unwrap();
        let expected = "model! {\n    model M;\n    let a(x) = 1.0;\n\n    /// why rows\n    param row_error [ms] ~ HalfNormal(10.0);\n\n    // why\n    observe s1s2(x): Bracket [ms] ~ Outliers(Widened(TopHat(a(x)), row_error), 0.05, 50.0);\n    observe y(x): Number ~ Outliers(Normal(a(x), 1.0), 0.05, 50.0);\n\n    /// why sites\n    param site_sd [ms] ~ HalfNormal(10.0);\n\n    /// why so\n    effect site on a [ms] = group(row.site) ~ Normal(0.0, site_sd);\n}\n";
        assert_eq!(text, expected);
    }

    #[test]
    fn a_text_without_a_model_has_no_place_for_it() {
        assert!(rewritten("fn main() {}", &[], None).is_err());
        assert!(rewritten("model! { model M;", &[], None).is_err());
    }

    #[test]
    fn what_is_no_effect_is_not_written() {
        let source = "model! { model M; let erp_s2(x) = 1.0; }";
        for (from, to) in [
            ("force_g", "force g"),
            ("force_g, 15.0", "force_g, 15.0) ~ Flat; param b ~ Flat; // "),
            ("force_g, 15.0", "force_g, 15.0) ~ Flat; /*"),
            ("~ Normal(0.0, 10.0);", "~ Flat; param b ~ Flat;"),
            ("[ms] =", "[ms] = }"),
        ] {
            let effect = FORCE.replace(from, to);
            assert_ne!(effect, FORCE);
            assert!(rewritten(source, &[(&effect, "why")], None).is_err(), "{effect}");
        }
        let text = rewritten(source, &[(FORCE, "why\nparam b ~ Flat;")], None).unwrap();
        assert!(text.contains("    /// why\n    /// param b ~ Flat;\n    effect"), "{text}");
        assert!(is_name("force_g") && !is_name("force g") && !is_name("type") && !is_name(""));
    }
}
