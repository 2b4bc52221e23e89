//! Effects: what they act on, and how they depend on a row.

use crate::around::Around;
use crate::mistake::Mistake;
use crate::syntax::{Effect, Form, Ident, Model};
use crate::vocabulary::{FORMS, nearest, shape};

/// The mistakes in an effect's targets and form.
pub(super) fn mistakes(effect: &Effect, model: &Model, around: &Around) -> Vec<Mistake> {
    let mut mistakes = targets(effect, model);
    mistakes.extend(form(&effect.form, around));
    mistakes
}

/// An effect acts on fields and `let`s that a measurement depends on.
fn targets(effect: &Effect, model: &Model) -> Vec<Mistake> {
    let mut behind: Vec<&Ident> = vec![];
    for observe in model.observes() {
        behind.extend(model.values_behind(observe));
    }
    let is_wrong = |target: &&Ident| !behind.contains(target);
    let one = |target: &Ident| {
        let (name, known) = (&effect.name, names(&behind));
        let known: Vec<&str> = known.iter().map(String::as_str).collect();
        let near = nearest(&target.to_string(), &known).or(known.first().copied());
        let message = format!(
            "effect {name}: `{target}` is neither a field nor a `let` that a measurement depends on"
        );
        let help = format!(
            "an effect acts on the name of a field or of a `let`, for instance `effect {name} on {} = …`",
            near.unwrap_or("erp_s2")
        );
        Mistake::at(target.span(), message, help)
    };
    effect.on.iter().filter(is_wrong).map(one).collect()
}

fn names(of: &[&Ident]) -> Vec<String> {
    of.iter().map(ToString::to_string).collect()
}

/// A form that ships has the arguments that it takes; another is a function in scope of the file.
fn form(form: &Form, around: &Around) -> Option<Mistake> {
    let name = form.name.get_ident()?;
    let Some(shape) = shape(name) else {
        let is_known = around.is_open() || around.declares(&name.to_string());
        return (!is_known).then(|| unknown(name));
    };
    let columns = form.columns.len();
    let is_right = shape.columns.map_or(columns > 0, |n| n == columns)
        && shape.numbers == form.numbers.len()
        && form.row.is_some();
    let help = format!("write `{}`", shape.written);
    let message = format!("`{name}` takes other arguments");
    (!is_right).then(|| Mistake::at(name.span(), message, help))
}

fn unknown(name: &Ident) -> Mistake {
    let known: Vec<&str> = FORMS.iter().map(|shape| shape.name).collect();
    let near = nearest(&name.to_string(), &known);
    let near = near.map_or(String::new(), |near| format!("did you mean `{near}`? "));
    let written: Vec<String> = FORMS.iter().map(|shape| format!("`{}`", shape.written)).collect();
    let help =
        format!("{near}Forms are {}, and functions of the file that make one", written.join(", "));
    Mistake::at(name.span(), format!("unknown form of an effect `{name}`"), help)
}
