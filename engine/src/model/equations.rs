//! A model as equations: what `eplat show` prints and the report's first page holds.

use super::laid_out::Model;
use crate::dist::Support;

impl Model {
    /// The syntax tree of the model, with what was added to it.
    ///
    /// # Errors
    /// The text is no model. This cannot be where it comes from [`Model::source`], which was
    /// compiled.
    pub fn syntax(&self) -> Result<eplat_language::syntax::Model, eplat_language::Mistake> {
        let mut tree = eplat_language::parse_text(&self.source)?;
        for error in &self.row_errors {
            tree.add_row_error(error);
        }
        if let Some((share, sd)) = self.outliers {
            tree.add_outliers(share, sd);
        }
        Ok(tree)
    }
}

/// The model as equations, with parameters, units and supports.
pub fn equations(model: &Model) -> String {
    let support = |name: &str| {
        let parameter = model.parameters.iter().find(|p| p.name == name)?;
        Some(words(parameter.support))
    };
    match model.syntax() {
        Ok(tree) => eplat_language::equations(&tree, &support),
        Err(mistake) => mistake.message,
    }
}

fn words(support: Support) -> String {
    match support {
        Support::Real => "real".into(),
        Support::Positive => "positive".into(),
        Support::Interval(a, b) => format!("in ({a}, {b})"),
        Support::Between => "between its bounds".into(),
        Support::Simplex => "positive, sum 1".into(),
        Support::Ordered => "increasing".into(),
        Support::Described(words) => words.into(),
    }
}
