//! A model with effects that its file does not declare.

use super::builder::Builder;
use super::declare::Declare;
use super::discrepancy::Discrepancy;
use super::error::ModelError;
use super::forms::Form;
use super::functions::Decl;

/// An effect to add to a model: what `effect NAME on ON [unit] = FORM ~ Normal(0.0, SD);` declares.
#[derive(Clone, Debug, PartialEq)]
pub struct AddedEffect {
    /// Name.
    pub name: String,
    /// Fields and `let`s that it acts on.
    pub on: Vec<String>,
    /// Their unit, empty if none.
    pub unit: String,
    /// How it depends on a row.
    pub form: Form,
    /// Prior sd of its coefficients, in that unit.
    pub sd: f64,
}

impl AddedEffect {
    /// The statement.
    pub fn statement(&self) -> String {
        let unit = if self.unit.is_empty() { String::new() } else { format!(" [{}]", self.unit) };
        let (on, prior) = (self.on.join(", "), self.prior());
        format!("effect {} on {on}{unit} = {} ~ {prior};", self.name, self.form.text())
    }

    fn prior(&self) -> String {
        format!("Normal(0.0, {:?})", self.sd)
    }
}

/// A model with effects added: the same as a file with their statements at its end.
pub struct Augmented<'m> {
    model: &'m dyn Declare,
    effects: Vec<AddedEffect>,
    discrepancy: Discrepancy,
    outliers: Option<(f64, f64)>,
}

impl std::fmt::Debug for Augmented<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut f = f.debug_struct("Augmented");
        f.field("effects", &self.effects).field("outliers", &self.outliers);
        f.field("discrepancy", &self.discrepancy).finish_non_exhaustive()
    }
}

impl<'m> Augmented<'m> {
    /// `model` with `effects`.
    pub fn new(model: &'m dyn Declare, effects: &[AddedEffect]) -> Self {
        let (effects, discrepancy) = (effects.to_vec(), Discrepancy::default());
        Self { model, effects, discrepancy, outliers: None }
    }

    /// Adds a discrepancy: sites, recordings or measurements may differ by more than the model
    /// says.
    #[must_use]
    pub fn with_discrepancy(self, discrepancy: Discrepancy) -> Self {
        Self { discrepancy, ..self }
    }

    /// Adds outliers: a `share` of the measurements has a further error of standard deviation `sd`.
    /// Every likelihood is put within `Outliers(…, share, sd)`.
    #[must_use]
    pub fn with_outliers(self, outliers: Option<(f64, f64)>) -> Self {
        Self { outliers, ..self }
    }
}

impl Declare for Augmented<'_> {
    fn name(&self) -> &'static str {
        self.model.name()
    }
    fn source(&self) -> String {
        let effects = self.effects.iter().map(AddedEffect::statement);
        let all = self.discrepancy.statements().into_iter().chain(effects);
        all.fold(self.model.source(), |text, statement| text + "\n" + &statement)
    }
    fn declare(&self, b: &mut Builder<'_>) -> Result<(), ModelError> {
        b.want_offsets(self.effects.iter().flat_map(|effect| effect.on.iter().cloned()));
        b.want_offsets(
            self.discrepancy.spreads.iter().flat_map(|spread| spread.on.iter().cloned()),
        );
        self.discrepancy.row_errors.iter().for_each(|error| b.add_row_error(error));
        if let Some((share, sd)) = self.outliers {
            b.add_outliers(share, sd);
        }
        self.model.declare(b)?;
        for spread in &self.discrepancy.spreads {
            b.spread(spread)?;
        }
        for effect in &self.effects {
            let decl = Decl {
                name: effect.name.clone().into(),
                unit: effect.unit.clone().into(),
                text: effect.prior().into(),
            };
            b.added_effect(&decl, &effect.on, &effect.form, effect.sd)?;
        }
        Ok(())
    }
}
