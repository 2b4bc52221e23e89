//! What a measurement depends on, from the tree.

use crate::linear::is_linear;
use crate::names::mentions;
use crate::syntax::{Expr, Ident, Item, Model, Observe, Value};

impl Model {
    /// The first field or `let` that the likelihood of `observe` mentions; `None` if it mentions
    /// parameters alone.
    pub fn first_value(&self, observe: &Observe) -> Option<&Ident> {
        self.values_in(&observe.likelihood).into_iter().next()
    }

    /// The fields and `let`s that the likelihood of `observe` depends on: those that it mentions, and
    /// those that these mention in turn.
    pub fn values_behind(&self, observe: &Observe) -> Vec<&Ident> {
        let mut found = self.values_in(&observe.likelihood);
        let mut next = 0;
        while let Some(name) = found.get(next) {
            if let Some(Item::Let(l)) = self.value(name)
                && let Value::Expr(e) = &l.value
            {
                for name in self.values_in(e) {
                    if !found.contains(&name) {
                        found.push(name);
                    }
                }
            }
            next += 1;
        }
        found
    }

    /// Whether a field on the surface stands behind the likelihood of `observe`.
    pub fn is_of_field(&self, observe: &Observe) -> bool {
        let values = self.values_behind(observe);
        values.iter().any(|name| matches!(self.value(name), Some(Item::Field(_))))
    }

    /// Whether a likelihood allows for outliers.
    pub fn has_outliers(&self) -> bool {
        let mut mentions = self.observes().flat_map(|observe| mentions(&observe.likelihood));
        mentions.any(|mention| mention.name == "Outliers" && mention.arguments.is_some())
    }

    /// Whether the likelihood of `observe` takes brackets as exact: no parameter of it is an error.
    pub fn is_exact(&self, observe: &Observe) -> bool {
        let is_param = |name: &Ident| {
            let mut items = self.statements.iter().map(|statement| &statement.item);
            items.any(|item| matches!(item, Item::Param(param) if param.name == *name))
        };
        let all = mentions(&observe.likelihood);
        all.iter().any(|mention| mention.name == "TopHat")
            && !all.iter().any(|mention| is_param(&mention.name))
    }

    /// Whether the likelihood of `observe` has a normal error, so that it can stand within `Widened(…)`.
    pub fn widens(&self, observe: &Observe) -> bool {
        let is_normal = |name: &Ident| ["TopHat", "Interval", "Normal"].iter().any(|n| name == n);
        mentions(&observe.likelihood).iter().any(|mention| is_normal(&mention.name))
    }

    /// Whether every measurement is `Normal(MU, SD)`: MU a linear function of fields that are not bent into a range, SD
    /// without any field.
    pub fn is_normal(&self) -> bool {
        let is_normal = |observe: &Observe| match &observe.likelihood {
            Expr::Call(call) => {
                let is_normal =
                    matches!(&*call.func, Expr::Path(path) if path.path.is_ident("Normal"));
                let arguments: Vec<&Expr> = call.args.iter().collect();
                is_normal
                    && matches!(&arguments[..], [mu, sd] if self.is_linear(mu) && self.is_free(sd))
            }
            _ => false,
        };
        self.observes().all(is_normal)
    }

    /// Whether `e` mentions neither fields nor `let`s.
    fn is_free(&self, e: &Expr) -> bool {
        self.values_in(e).is_empty()
    }

    /// Whether `e` is linear in the fields that it mentions, up to a constant.
    fn is_linear(&self, e: &Expr) -> bool {
        let is_field = |e: &Expr| {
            let Expr::Call(call) = e else { return false };
            let Expr::Path(path) = &*call.func else { return false };
            let is_unbent = |name: &Ident| matches!(self.value(name), Some(Item::Field(field)) if !field.is_within);
            path.path.get_ident().is_some_and(is_unbent)
                && call.args.iter().all(|argument| self.is_free(argument))
        };
        is_linear(e, &|e| self.is_free(e), &is_field)
    }

    /// The fields and `let`s that `e` mentions, each once.
    fn values_in(&self, e: &Expr) -> Vec<&Ident> {
        let mut found: Vec<&Ident> = vec![];
        for mention in mentions(e) {
            if let Some(item) = self.value(&mention.name)
                && !found.contains(&item.name())
            {
                found.push(item.name());
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use crate::File;

    const MODEL: &str = "model! {
        model M;
        param s ~ HalfNormal(1.0);
        field f(x) = m + gp(Rbf(2.0), K = 4) where { m ~ Flat; }
        let twice(x) = f(x) * 2;
        let level(x) = s + 1;
        observe a(x): Number ~ Normal(twice(x) + level(x), s);
        observe b(x): Number ~ Outliers(Normal(level(x), s), 0.1, 2.0);
        observe c(x): Number ~ Normal(s, 1.0);
    }";

    #[test]
    fn what_is_observed_is_found_behind_lets() {
        let model = File::read(MODEL).unwrap().model;
        let [a, b, c] = &model.observes().collect::<Vec<_>>()[..] else { panic!() };
        let words = |o| model.values_behind(o).iter().map(ToString::to_string).collect::<Vec<_>>();
        assert_eq!(words(a), ["twice", "level", "f"]);
        assert_eq!(model.first_value(a).unwrap(), "twice");
        assert_eq!(model.first_value(b).unwrap(), "level");
        assert!(model.first_value(c).is_none());
        assert!(model.is_of_field(a) && !model.is_of_field(b));
        assert!(!model.is_normal() && model.has_outliers());
        let without = MODEL.replace("Outliers(", "Widened(");
        assert!(!File::read(&without).unwrap().model.has_outliers());
    }

    #[test]
    fn what_has_a_normal_error_can_be_widened() {
        for (likelihood, widens) in [
            ("TopHat(f(x))", true),
            ("Outliers(Normal(f(x), s), 0.1, 9.0)", true),
            ("StudentT(4.0, f(x), s)", false),
        ] {
            let text = format!(
                "model! {{
                    model M;
                    param s ~ HalfNormal(1.0);
                    field f(x) = m + gp(Rbf(2.0), K = 4) where {{ m ~ Flat; }}
                    observe a(x): Number ~ {likelihood};
                }}"
            );
            let model = File::read(&text).unwrap().model;
            let of = model.observes().next().unwrap();
            assert_eq!(model.widens(of), widens, "{likelihood}");
        }
    }

    #[test]
    fn normal_about_a_linear_function_of_fields() {
        let is_normal = |likelihood: &str| {
            let text = format!(
                "model! {{
                    model M;
                    param s ~ HalfNormal(1.0);
                    field f(x) = m + gp(Rbf(2.0), K = 4) where {{ m ~ Flat; }}
                    field g(x) within 0.0..1.0 = m + gp(Rbf(2.0), K = 4) where {{ m ~ Normal(0.5, 0.5); }}
                    let twice(x) = f(x) * 2;
                    observe a(x): Number ~ {likelihood};
                }}"
            );
            File::read(&text).unwrap().model.is_normal()
        };
        for linear in ["f(x)", "-(2.0 * f(x) - s) / 3.0 + f(x) * s", "s"] {
            assert!(is_normal(&format!("Normal({linear}, 2.0 * s)")), "{linear}");
        }
        for other in ["f(x) * f(x)", "s / f(x)", "f(x).exp()", "exp(f(x))", "g(x)", "twice(x)"] {
            assert!(!is_normal(&format!("Normal({other}, s)")), "{other}");
        }
        assert!(!is_normal("Normal(f(x), s * f(x))"));
        assert!(!is_normal("StudentT(4.0, f(x), s)"));
    }
}
