//! A model file with effects added: the user's own text, in which only what is new is new.

use std::fmt::Write as _;

use crate::file::File;
use crate::grammar::{first_span, last_span, parse};
use crate::mistake::Mistake;
use crate::syntax::{Item, Model};

impl Model {
    /// Puts the likelihood of every `observe` within `Outliers(…, share, sd)`.
    pub fn add_outliers(&mut self, share: f64, sd: f64) {
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
    /// A text that is not one `effect` statement, such as one with a column whose name is no name.
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
            is_effect(effect)?;
            text.push('\n');
            for line in why.lines() {
                let _ = writeln!(text, "    /// {}", line.replace('\r', " "));
            }
            let _ = writeln!(text, "    {effect}");
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
pub fn outlying(likelihood: &str, share: f64, sd: f64) -> String {
    format!("Outliers({}, {share:?}, {sd:?})", likelihood.trim())
}

/// Whether a text can be the name of a column or of an effect in a model file.
pub fn is_name(text: &str) -> bool {
    syn::parse_str::<syn::Ident>(text).is_ok_and(|name| name == text)
}

/// One `effect` statement in one line, without a comment that could swallow a part of it.
fn is_effect(text: &str) -> Result<(), Mistake> {
    let wrong = |help: &str| {
        let message = format!("`{text}` is not one effect");
        Mistake::at(proc_macro2::Span::call_site(), message, help)
    };
    if ["//", "/*", "\n"].iter().any(|mark| text.contains(mark)) {
        return Err(wrong("take out the comment or the end of a line"));
    }
    let tokens = format!("model M; {text}").parse();
    let tokens = tokens.map_err(|_| wrong("names in it must be those of Rust"))?;
    let model = parse(tokens).map_err(|mistake| wrong(&mistake.message))?;
    match &model.statements[..] {
        [one] if matches!(one.item, Item::Effect(_)) => Ok(()),
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
