//! A model file with effects added: the user's own text, in which only what is new is new.

use std::fmt::Write as _;

use crate::file::File;
use crate::grammar::{first_span, last_span, parse};
use crate::mistake::Mistake;
use crate::syntax::{Effect, Item, Model};

impl Model {
    /// Puts the likelihood of every `observe` within `Outliers(…, share, sd)`.
    pub fn add_outliers(&mut self, share: f64, sd: f64) {
        let [share, sd] = [share, sd].map(proc_macro2::Literal::f64_unsuffixed);
        for statement in &mut self.statements {
            if let Item::Observe(observe) = &mut statement.item {
                let likelihood = &observe.likelihood;
                observe.likelihood = syn::parse_quote!(Outliers(#likelihood, #share, #sd));
            }
        }
    }
}

impl File {
    /// `source`, which this file was read from, with more in its model: effects declared at its end,
    /// each given by its statement and the line above it that says why; and, if there are `outliers`
    /// (share, sd), every likelihood within `Outliers(…, share, sd)`.
    ///
    /// # Errors
    /// A text that is not one `effect` statement. What is written is printed from its tree.
    pub fn with_effects(
        &self,
        source: &str,
        effects: &[(String, String)],
        outliers: Option<(f64, f64)>,
    ) -> Result<String, Mistake> {
        let end = self.brackets.end - 1;
        let mut text = match outliers {
            Some((share, sd)) => self.with_outliers(&source[..end], share, sd),
            None => source[..end].to_owned(),
        };
        text.truncate(text.trim_end().len());
        text.push('\n');
        for (effect, why) in effects {
            text.push('\n');
            for line in why.lines() {
                let _ = writeln!(text, "    /// {}", line.replace('\r', " "));
            }
            let _ = writeln!(text, "    {}", self::effect(effect)?.text());
        }
        Ok(text + &source[end..])
    }

    /// The text up to the end of the model with the likelihood of every `observe` in `Outliers(…)`.
    fn with_outliers(&self, source: &str, share: f64, sd: f64) -> String {
        let (mut text, mut done) = (String::new(), 0);
        for observe in self.model.observes() {
            let start = first_span(&observe.likelihood).byte_range().start;
            let end = last_span(&observe.likelihood).byte_range().end;
            text += &source[done..start];
            text += &outlying(&source[start..end], share, sd);
            done = end;
        }
        text + &source[done..]
    }
}

/// A likelihood with outliers, as it is written.
fn outlying(likelihood: &str, share: f64, sd: f64) -> String {
    format!("Outliers({}, {share:?}, {sd:?})", likelihood.trim())
}

/// Whether a text can be the name of a column or of an effect in a model file.
pub fn is_name(text: &str) -> bool {
    syn::parse_str::<syn::Ident>(text).is_ok_and(|name| name == text)
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
    let is_sign = |c: char| !is_name(&format!("a{c}"));
    let words: Vec<&str> = header.split(is_sign).filter(|word| !word.is_empty()).collect();
    let name = words.join("_");
    let tries = [name.clone(), format!("{name}_"), format!("_{name}")];
    tries.into_iter().find(|name| is_name(name)).unwrap_or_else(|| "unnamed".into())
}

/// One `effect` statement.
fn effect(text: &str) -> Result<Effect, Mistake> {
    let wrong = |help: &str| {
        let message = format!("`{text}` is not one effect");
        Mistake::at(proc_macro2::Span::call_site(), message, help)
    };
    let tokens = format!("model M; {text}").parse();
    let tokens = tokens.map_err(|_| wrong("names in it must be those of Rust"))?;
    let model = parse(tokens).map_err(|mistake| wrong(&mistake.message))?;
    let mut statements = model.statements.into_iter().map(|statement| statement.item);
    match (statements.next(), statements.next()) {
        (Some(Item::Effect(effect)), None) => Ok(effect),
        _ => Err(wrong("write `effect NAME on LET [unit] = linear(row.COLUMN) ~ PRIOR;`")),
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
        let effects: Vec<_> = effects.iter().map(|(e, w)| ((*e).into(), (*w).into())).collect();
        File::read(source)?.with_effects(source, &effects, outliers)
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
