//! Equations: from `LaTeX` to `MathML`, which browsers draw without a script.

use math_core::{LatexToMathML, MathCoreConfig, MathDisplay};

/// Where an equation stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// In a line of text: `$…$`.
    Inline,
    /// On a line of its own: `$$…$$`, or a code block of the language `math`.
    Block,
}

/// A mistake in an equation.
#[derive(Clone, Debug)]
pub struct Mistake {
    /// Where it is in the `LaTeX` text, in bytes.
    pub at: usize,
    /// What is wrong.
    pub what: String,
}

/// The equation as `MathML` that may stand in a Markdown page: one line, and no text that Markdown reads.
///
/// # Errors
/// A command that does not exist, brackets that do not match, and so on.
pub fn mathml(latex: &str, place: Place) -> Result<String, Mistake> {
    let display = match place {
        Place::Inline => MathDisplay::Inline,
        Place::Block => MathDisplay::Block,
    };
    let mistake = |at, what| Mistake { at, what };
    // math-core would print the length as text
    if let Some(at) = latex.find(r"\\[") {
        return Err(mistake(at, r"a length after `\\` is not read: leave it out".into()));
    }
    let converter = LatexToMathML::new(MathCoreConfig::default())
        .map_err(|error| mistake(0, format!("{error:?}")))?;
    let found = converter
        .convert_with_local_state(latex, display)
        .map_err(|error| mistake(error.0.start, error.error_message()))?;
    let html = quoted(&found.mathml);
    Ok(match place {
        Place::Inline => html,
        Place::Block => format!("<span class=\"equation\">{html}</span>"),
    })
}

/// Signs between tags that Markdown would read, as entities.
fn quoted(html: &str) -> String {
    let mut out = String::with_capacity(html.len());
    let mut in_tag = false;
    for sign in html.chars() {
        match sign {
            '<' => in_tag = true,
            '>' => in_tag = false,
            _ => {}
        }
        match sign {
            '\n' => out.push(' '),
            '*' | '_' | '|' | '[' | ']' | '\\' | '`' | '~' | '$' if !in_tag => {
                out.push_str("&#");
                out.push_str(&(sign as u32).to_string());
                out.push(';');
            }
            _ => out.push(sign),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_equation_becomes_one_line_that_markdown_leaves_alone() {
        let html = mathml(r"\left[ a_k \right] | b^* |", Place::Block).map_err(|m| m.what);
        let html = html.unwrap_or_else(|what| panic!("{what}"));
        assert!(
            html.starts_with("<span class=\"equation\"><math")
                && html.contains("display=\"block\""),
            "{html}"
        );
        let text: String =
            html.split('<').filter_map(|part| part.split_once('>')).map(|p| p.1).collect();
        assert!(!text.contains(['[', '|', '*', '\n']), "{text}");
    }

    #[test]
    fn what_is_wrong_has_a_place() {
        let found = mathml(r"a + \nosuch b", Place::Inline).err();
        let found = found.unwrap_or_else(|| panic!("accepted"));
        assert_eq!(found.at, 4, "{}", found.what);
        assert!(mathml(r"\frac{a}{b", Place::Inline).is_err());
        assert!(
            mathml(r"\begin{aligned} a &= b \\[4pt] c &= d \end{aligned}", Place::Block).is_err()
        );
    }
}
