//! What a measurement depends on, from the tree.

use crate::names::mentions;
use crate::operator::Operation;
use crate::syntax::{Expr, Ident, Item, Let, Model, Observe, Over, Param, Value};

impl Model {
    /// The first field or `let` that the likelihood of `observe` mentions; `None` if it mentions
    /// parameters alone.
    pub fn first_value(&self, observe: &Observe) -> Option<&Ident> {
        self.values_in(&observe.likelihood).into_iter().next()
    }

    /// The fields and `let`s that the likelihood of `observe` depends on: those that it mentions, and
    /// those that these mention in turn.
    pub fn values_behind(&self, observe: &Observe) -> Vec<&Ident> {
        self.and_behind(self.values_in(&observe.likelihood))
    }

    /// These fields and `let`s, and those that they mention in turn, each once.
    pub(crate) fn and_behind<'m>(&'m self, values: Vec<&'m Ident>) -> Vec<&'m Ident> {
        let (mut found, mut next) = (vec![], 0);
        let add = |found: &mut Vec<&'m Ident>, names: Vec<&'m Ident>| {
            for name in names {
                if !found.contains(&name) {
                    found.push(name);
                }
            }
        };
        add(&mut found, values);
        while let Some(name) = found.get(next) {
            if let Some(Item::Let(l)) = self.value(name) {
                let behind = l.exprs().into_iter().flat_map(|e| self.values_in(e)).collect();
                add(&mut found, behind);
            }
            next += 1;
        }
        found
    }

    /// The operators over the whole surface that measurements depend on, each once.
    pub fn operators_observed(&self) -> Vec<&Let> {
        let first = self.observes().flat_map(|observe| self.values_in(&observe.likelihood));
        let all = self.and_behind(first.collect());
        let operator = |name: &Ident| match self.value(name) {
            Some(Item::Let(own @ Let { value: Value::Operator(_), .. })) => Some(own),
            _ => None,
        };
        all.into_iter().filter_map(operator).collect()
    }

    /// Whether all operators over the whole surface are arrival times, those that no measurement depends on among them.
    pub fn has_arrivals_alone(&self) -> bool {
        self.items().all(|item| match item {
            Item::Let(Let { value: Value::Operator(operator), .. }) => {
                operator.operation == Operation::Eikonal
            }
            _ => true,
        })
    }

    /// The fields that measurements depend on through such operators, each once.
    pub fn fields_everywhere(&self) -> Vec<&Ident> {
        let operands = self.operators_observed().into_iter().flat_map(Let::exprs);
        let mut found = self.and_behind(operands.flat_map(|e| self.values_in(e)).collect());
        found.retain(|name| matches!(self.value(name), Some(Item::Field(_))));
        found
    }

    /// The parameter that `e` is: `later`, or `later(row)` with a number for each label.
    pub fn later_by(&self, e: &Expr) -> Option<&Param> {
        let (path, is_of_row) = match e {
            Expr::Path(path) => (path, false),
            Expr::Call(call) => match &*call.func {
                Expr::Path(path) => (path, true),
                _ => return None,
            },
            _ => return None,
        };
        self.items().find_map(|item| match item {
            Item::Param(own) if path.path.is_ident(&own.name) => match own.over {
                Over::One => (!is_of_row).then_some(own),
                Over::Each(_) => is_of_row.then_some(own),
                Over::Many(_) => None,
            },
            _ => None,
        })
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
            self.items().any(|item| matches!(item, Item::Param(param) if param.name == *name))
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

    /// The fields and `let`s that `e` mentions, each once.
    pub(crate) fn values_in(&self, e: &Expr) -> Vec<&Ident> {
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
        assert!(model.has_outliers());
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
}
