//! What is declared: each name once, vectors as long as their priors need.

use super::scope::Local;
use crate::mistake::{Mistake, span_of};
use crate::names::mentions;
use crate::print::print;
use crate::syntax::{Expr, Field, Ident, Item, Model, Over, Param, Prior, Range};

/// Names that are declared twice. What an expression mentions by its bare name, the columns, the
/// measurements and the densities may each have the name of one of the others.
pub(super) fn twice(model: &Model) -> Vec<Mistake> {
    let mut mistakes = vec![];
    for (i, statement) in model.statements.iter().enumerate() {
        let name = statement.item.name();
        let mut above = model.statements[..i].iter().map(|above| &above.item);
        if above.any(|above| above.name() == name && is_same_kind(above, &statement.item)) {
            mistakes.push(second(name));
        }
    }
    mistakes
}

/// Names that a block of parameters declares twice.
pub(super) fn twice_in(params: &[Param]) -> Vec<Mistake> {
    let is_second = |(i, p): &(usize, &Param)| params[..*i].iter().any(|q| q.name == p.name);
    params.iter().enumerate().filter(is_second).map(|(_, p)| second(&p.name)).collect()
}

fn second(name: &Ident) -> Mistake {
    let message = format!("`{name}` is declared twice");
    Mistake::at(name.span(), message, "give one of them another name")
}

fn is_same_kind(a: &Item, b: &Item) -> bool {
    use Item::{Column, Density, Effect, Field, Hyper, Let, Observe, Param};
    match (a, b) {
        // effects are reported as parameters
        (Column(_), Column(_))
        | (Observe(_), Observe(_))
        | (Density(_), Density(_))
        | (Effect(_), Effect(_) | Param(_))
        | (Param(_), Effect(_)) => true,
        _ => [a, b].iter().all(|item| matches!(item, Param(_) | Field(_) | Let(_) | Hyper(_))),
    }
}

/// The correlation of two is one number.
fn takes_one(prior: &Prior) -> bool {
    matches!(&prior.expr, Expr::Call(call) if print(&call.func) == "LkjCholesky")
}

/// A vector prior is one of at least two numbers.
pub(super) fn length(param: &Param) -> Vec<Mistake> {
    let Param { name, over, prior, .. } = param;
    let (message, help) = match over {
        Over::Many(0) => (
            format!("`{name}` has no number"),
            format!("declare `param {name}(2) ~ PRIOR;` or more, or `param {name} ~ PRIOR;`"),
        ),
        Over::One if prior.is_joint => (
            format!("`{name}` is one number, and its prior is one of a whole vector"),
            format!("declare `param {name}(3) ~ PRIOR;`, or give it a prior of one number"),
        ),
        Over::Many(1) if prior.is_joint && !takes_one(prior) => (
            format!("param {name}(1): proportions and ordered numbers come at least in twos"),
            format!("declare `param {name}(2) ~ PRIOR;` or more"),
        ),
        _ => return vec![],
    };
    vec![Mistake::at(name.span(), message, help)]
}

/// Hyperparameters of each label belong to a field of each label.
pub(super) fn labels(field: &Field, locals: &[Local<'_>]) -> Vec<Mistake> {
    let mut mistakes = vec![];
    for Local { param, .. } in locals {
        let Over::Each(label) = &param.over else { continue };
        if field.label.as_ref() == Some(label) {
            continue;
        }
        let Field { name, place, .. } = field;
        let h = &param.name;
        let message = format!("`{h}` has a value for each `{label}`, and `{name}` has not");
        let help = format!("write `field {name}({place}, {label})`, or `{h}` without `({label})`");
        let is_own = field.params.iter().any(|p| p.name == *h);
        let at = if is_own { label.span() } else { name.span() };
        mistakes.push(Mistake::at(at, message, help));
    }
    mistakes
}

/// A flat prior of the mean of a field that is bent into a range: far outside, all means are alike, and the
/// posterior has no end.
pub(super) fn flat_within(field: &Field, locals: &[Local<'_>], model: &Model) -> Vec<Mistake> {
    let (Some(Range { low, high }), Some(mean), true) = (field.range, &field.mean, field.is_within)
    else {
        return vec![];
    };
    let declared = model.statements.iter().filter_map(|statement| match &statement.item {
        Item::Param(param) => Some(param),
        _ => None,
    });
    // a hyperparameter hides a parameter of its name
    let seen: Vec<&Param> = locals.iter().map(|l| l.param).chain(declared).collect();
    let mut mistakes = vec![];
    for mention in mentions(mean) {
        let Some(param) = seen.iter().find(|p| p.name == mention.name) else { continue };
        if print(&param.prior.expr) != "Flat" {
            continue;
        }
        let (name, field) = (&param.name, &field.name);
        let message = format!("`{name}` has a flat prior, and `{field}` stays within a range");
        let (middle, sd) = (0.5 * (low + high), (high - low) / 3.0);
        let help = format!(
            "far outside the range one mean is as good as another: give it a prior such as `Normal({middle:?}, {sd:.1})`"
        );
        mistakes.push(Mistake::at(span_of(&param.prior.expr), message, help));
    }
    mistakes
}
