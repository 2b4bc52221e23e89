//! Models whose measurements are normal about a sum: of fields, parameters and effects, each with a factor. And what shifts
//! normal measurements, without a factor.

use crate::linear::is_linear;
use crate::names::mentions;
use crate::syntax::{Expr, Field, Ident, Item, Model, Observe, Over, Prior, Value};
use quote::ToTokens;

/// Fields and parameters that shift normal measurements.
#[derive(Debug)]
pub struct Shifts<'m> {
    /// The fields and parameters.
    pub names: Vec<&'m Ident>,
    /// The parameters that the sds of these measurements are made of. Nothing else mentions them.
    pub sds: Vec<&'m Ident>,
}

impl Model {
    /// Fields and parameters that are added to the MU of measurements `Normal(MU, SD)`, and are seen nowhere else; `None` if
    /// there are none, or if the SDs are not made of parameters of their own.
    ///
    /// `let`s count as what they stand for. Fields that are bent into a range do not shift.
    pub fn shifts(&self) -> Option<Shifts<'_>> {
        let mut sum = Sum { model: self, names: vec![], fields: Fields::These(vec![]) };
        let normals = || self.observes().filter_map(normal);
        let others = || self.observes().filter(|observe| normal(observe).is_none());
        let is_shift = |sum: &Sum<'_>| {
            normals().all(|(mu, sd)| sum.is_linear(mu) && sum.is_free(sd))
                && others().all(|observe| sum.is_free(&observe.likelihood))
        };
        let mut seen = vec![];
        normals().for_each(|(mu, _)| self.mentioned(mu, &mut seen));
        for item in seen.into_iter().filter(|item| matches!(item, Item::Field(_) | Item::Param(_)))
        {
            if self.is_mentioned_elsewhere(item.name()) {
                continue;
            }
            sum.push(item);
            if !is_shift(&sum) {
                sum.pop(item);
            }
        }
        let (mut sds, mut others) = (vec![], vec![]);
        for observe in self.observes() {
            match normal(observe) {
                Some((mu, sd)) if !sum.is_free(mu) => {
                    self.mentioned(sd, &mut sds);
                    self.mentioned(mu, &mut others);
                }
                _ => self.mentioned(&observe.likelihood, &mut others),
            }
        }
        let names = sum.summed();
        let is_own = |item: &&Item| {
            matches!(item, Item::Param(_))
                && !self.is_mentioned_elsewhere(item.name())
                && others.iter().all(|other| other.name() != item.name())
        };
        (!names.is_empty() && sds.iter().all(is_own))
            .then(|| Shifts { names, sds: sds.iter().map(|item| item.name()).collect() })
    }

    /// Adds what `e` mentions, itself or by its `let`s, each once.
    fn mentioned<'m>(&'m self, e: &impl ToTokens, found: &mut Vec<&'m Item>) {
        for mention in mentions(e) {
            let is_it = |item: &&Item| *item.name() == mention.name;
            let Some(item) = self.items().find(is_it) else { continue };
            if found.iter().any(|known| known.name() == item.name()) {
                continue;
            }
            found.push(item);
            if let Item::Let(own) = item {
                found.pop();
                match &own.value {
                    Value::Expr(e) => self.mentioned(e, found),
                    Value::Linear { .. } => found.push(item),
                    Value::Operator(o) => o.exprs().for_each(|e| self.mentioned(e, found)),
                }
            }
        }
    }

    /// If every measurement is `Normal(MU, SD)`, MU linear in the fields and SD without any: the parameters and effects
    /// in which MU is linear, too, together with the fields. Nothing else mentions these.
    ///
    /// `let`s count as what they stand for. Fields that are bent into a range are not linear.
    pub fn normal_about(&self) -> Option<Vec<&Ident>> {
        let normals = self.observes().map(normal).collect::<Option<Vec<_>>>()?;
        let mut sum = Sum { model: self, names: vec![], fields: Fields::All };
        let is_sum =
            |sum: &Sum<'_>| normals.iter().all(|(mu, sd)| sum.is_linear(mu) && sum.is_free(sd));
        if !is_sum(&sum) {
            return None;
        }
        let items = self.items();
        for item in items.filter(|item| matches!(item, Item::Param(_) | Item::Effect(_))) {
            if self.is_mentioned_elsewhere(item.name()) {
                continue;
            }
            sum.names.push(item.name());
            if !is_sum(&sum) {
                sum.names.pop();
            }
        }
        Some(sum.names)
    }

    /// Whether something mentions `name` that is neither a likelihood nor a `let`.
    fn is_mentioned_elsewhere(&self, name: &Ident) -> bool {
        let is_in = |e: &dyn ToTokens| {
            mentions(&e.to_token_stream()).iter().any(|mention| mention.name == *name)
        };
        let of_prior = |prior: &Prior| is_in(&prior.expr);
        let of_field = |field: &Field| {
            is_in(&field.value) || field.params.iter().any(|param| of_prior(&param.prior))
        };
        self.statements.iter().any(|statement| match &statement.item {
            Item::Param(param) => of_prior(&param.prior),
            Item::Column(column) => column.prior.as_ref().is_some_and(of_prior),
            Item::Hyper(hyper) => hyper.params.iter().any(|param| of_prior(&param.prior)),
            Item::Field(field) => of_field(field),
            Item::Effect(effect) => {
                of_prior(&effect.prior) || effect.form.numbers.iter().any(|e| is_in(e))
            }
            Item::Density(density) => is_in(&density.expr),
            Item::Observe(observe) => observe.from.as_ref().is_some_and(|e| is_in(e)),
            Item::Let(_) => false,
        })
    }
}

/// MU and SD of a measurement `~ Normal(MU, SD)`.
fn normal(observe: &Observe) -> Option<(&Expr, &Expr)> {
    let Expr::Call(call) = &observe.likelihood else { return None };
    let is_normal = matches!(&*call.func, Expr::Path(path) if path.path.is_ident("Normal"));
    let mut arguments = call.args.iter();
    let (mu, sd) = arguments.next().zip(arguments.next())?;
    (is_normal && arguments.next().is_none()).then_some((mu, sd))
}

/// Which fields are summed.
enum Fields<'m> {
    /// All, each with a factor. So may parameters and effects have.
    All,
    /// These, without a factor. Nor have parameters any.
    These(Vec<&'m Ident>),
}

/// A sum of fields, and of the parameters and effects of these names.
struct Sum<'m> {
    model: &'m Model,
    names: Vec<&'m Ident>,
    fields: Fields<'m>,
}

impl<'m> Sum<'m> {
    /// Adds a field, which is one of these, or a parameter.
    fn push(&mut self, item: &'m Item) {
        match (&mut self.fields, item) {
            (Fields::These(fields), Item::Field(_)) => fields.push(item.name()),
            _ => self.names.push(item.name()),
        }
    }

    /// Takes away what was added last.
    fn pop(&mut self, item: &Item) {
        match (&mut self.fields, item) {
            (Fields::These(fields), Item::Field(_)) => fields.pop(),
            _ => self.names.pop(),
        };
    }

    /// What is summed, if fields are named.
    fn summed(&self) -> Vec<&'m Ident> {
        match &self.fields {
            Fields::All => vec![],
            Fields::These(fields) => fields.iter().chain(&self.names).copied().collect(),
        }
    }

    /// Whether this field is summed.
    fn has_field(&self, name: &Ident) -> bool {
        match &self.fields {
            Fields::All => true,
            Fields::These(fields) => fields.contains(&name),
        }
    }

    /// Whether `e` depends on nothing that is summed.
    fn is_free(&self, e: &Expr) -> bool {
        mentions(e).iter().all(|mention| {
            !self.names.contains(&&mention.name)
                && match self.model.value(&mention.name) {
                    Some(Item::Field(field)) => !self.has_field(&field.name),
                    Some(Item::Let(own)) => {
                        !self.has_effect(&own.name)
                            && match &own.value {
                                Value::Expr(e) => self.is_free(e),
                                Value::Linear { beta, .. } => !self.names.contains(&beta),
                                Value::Operator(o) => o.exprs().all(|e| self.is_free(e)),
                            }
                    }
                    _ => true,
                }
        })
    }

    /// Whether an effect that is summed acts on this field or `let`.
    fn has_effect(&self, on: &Ident) -> bool {
        self.model.statements.iter().any(|statement| {
            matches!(&statement.item, Item::Effect(effect)
                if self.names.contains(&&effect.name) && effect.on.contains(on))
        })
    }

    /// Whether `e` is linear in what is summed, up to something free; without factors, if there are none.
    fn is_linear(&self, e: &Expr) -> bool {
        let is_factor = |e: &Expr| matches!(self.fields, Fields::All) && self.is_free(e);
        is_linear(e, &|e| self.is_free(e), &is_factor, &|e| self.is_term(e))
    }

    /// Whether `e` is one number that is summed: `f(x)`, `a`, `b[0]`, `c(row)`, or a `let` that is a sum.
    fn is_term(&self, e: &Expr) -> bool {
        let name = |e: &Expr| match e {
            Expr::Path(path) => path.path.get_ident().cloned(),
            _ => None,
        };
        match e {
            Expr::Path(_) => self.is_summed(e, &|over| matches!(over, Over::One)),
            Expr::Index(e) => {
                self.is_free(&e.index)
                    && self.is_summed(&e.expr, &|over| matches!(over, Over::Many(_)))
            }
            Expr::Call(call) => {
                call.args.iter().all(|argument| self.is_free(argument))
                    && (self.is_summed(&call.func, &|over| matches!(over, Over::Each(_)))
                        || name(&call.func).is_some_and(|name| self.is_sum(&name)))
            }
            _ => false,
        }
    }

    /// Whether `e` names a parameter that is summed, and that varies over this.
    fn is_summed(&self, e: &Expr, varies: &dyn Fn(&Over) -> bool) -> bool {
        let Expr::Path(path) = e else { return false };
        self.model.statements.iter().any(|statement| match &statement.item {
            Item::Param(param) => {
                path.path.is_ident(&param.name)
                    && self.names.contains(&&param.name)
                    && varies(&param.over)
            }
            _ => false,
        })
    }

    /// Whether this is a field that is not bent, or a `let` that is a sum.
    fn is_sum(&self, name: &Ident) -> bool {
        match self.model.value(name) {
            Some(Item::Field(field)) => !field.is_within && self.has_field(&field.name),
            Some(Item::Let(own)) => match &own.value {
                Value::Expr(e) => self.is_linear(e),
                Value::Linear { .. } => matches!(self.fields, Fields::All),
                Value::Operator(_) => false,
            },
            _ => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::File;

    /// The names in which the model is linear, if it is normal about a sum.
    fn names(mu: &str, sd: &str, more: &str) -> Option<String> {
        let text = format!(
            "model! {{
                model M;
                column dose;
                param s ~ HalfNormal(1.0);
                param a ~ Normal(0.0, 1.0);
                param b(2) ~ Normal(0.0, s);
                param c(patient) ~ Normal(0.0, 1.0);
                field f(x) = m + gp(Rbf(2.0), K = 4) where {{ m ~ Flat; }}
                field g(x) within 0.0..1.0 = m + gp(Rbf(2.0), K = 4) where {{ m ~ Normal(0.5, 0.5); }}
                let twice(row) = f(row) * 2 + a;
                let square(row) = f(row) * f(row);
                let level(row) = exp(s);
                let along(row) = linear(row.dose, row.dose; b);
                {more}
                observe y(row): Number ~ Normal({mu}, {sd});
            }}"
        );
        let model = File::read(&text).unwrap_or_else(|mistake| panic!("{}", mistake.message)).model;
        let names = model.normal_about()?;
        Some(names.iter().map(ToString::to_string).collect::<Vec<_>>().join(" "))
    }

    #[test]
    fn sums_of_fields_parameters_and_lets_are_found() {
        for (mu, found) in [
            ("f(row)", "a c b"),
            ("-(2.0 * f(row) - s) / 3.0 + f(row) * s", "a b c"),
            ("s", "a b c"),
            ("f(row) + a * row.dose + b[1] + c(row)", "a b c"),
            ("twice(row) + level(row) - along(row)", "a b c"),
            ("f(row) * level(row) + s * c(row)", "a b c"),
            ("f(row) * a + b[0]", "b c"),
            ("f(row) + exp(a) + c(row)", "b c"),
            ("a * b[0] + f(row)", "a c"),
            ("f(row) + b[0] * c(row)", "a b"),
        ] {
            let sorted = |names: &str| {
                let mut names: Vec<String> = names.split(' ').map(String::from).collect();
                names.sort();
                names
            };
            let own = names(mu, "2.0 * s", "").unwrap_or_else(|| panic!("{mu}"));
            assert_eq!(sorted(&own), sorted(found), "{mu}");
        }
    }

    /// What shifts the measurements, and what their sds are made of.
    fn shifts(mu: &str, sd: &str, more: &str) -> String {
        let text = format!(
            "model! {{
                model M;
                column dose;
                param s(source) ~ HalfNormal(1.0);
                param a ~ Normal(0.0, 1.0);
                param c(source) ~ Normal(0.0, 1.0);
                param d ~ Normal(0.0, 1.0);
                field f(x) = m + gp(Rbf(2.0), K = 4) where {{ m ~ Flat; }}
                field g(x, source) = gp(Rbf(2.0), K = 4);
                field h(x) within 0.0..1.0 = m + gp(Rbf(2.0), K = 4) where {{ m ~ Normal(0.5, 0.5); }}
                let path(row) = eikonal(f(row); row.source);
                let spread(row) = s(row) * 2.0;
                let later(row) = c(row) - g(row);
                {more}
                observe y(row): Number ~ Normal({mu}, {sd});
            }}"
        );
        let model = File::read(&text).unwrap_or_else(|mistake| panic!("{}", mistake.message)).model;
        let Some(super::Shifts { names, sds }) = model.shifts() else { return String::new() };
        let joined = |names: Vec<&syn::Ident>| {
            let mut names: Vec<String> = names.iter().map(ToString::to_string).collect();
            names.sort();
            names.join(" ")
        };
        joined(names) + ": " + &joined(sds)
    }

    #[test]
    fn what_shifts_normal_measurements_is_found() {
        for (mu, sd, found) in [
            ("c(row) + path(row) + g(row)", "s(row)", "c g: s"),
            ("later(row) + path(row) - a", "spread(row) + 1.0", "a c g: s"),
            ("2.0 * c(row) + path(row) + g(row)", "2.0", "g: "),
            ("path(row) + f(row) + a", "1.0", "a: "),
            ("path(row) + h(row)", "1.0", ""),
            ("path(row) * g(row) + a", "s(row)", "a: s"),
            ("path(row) + g(row)", "g(row)", ""),
            ("path(row) + g(row)", "s(row) + h(row)", ""),
            ("path(row) + g(row) + s(row)", "s(row)", ""),
            ("path(row) + g(row) + exp(s(row))", "s(row)", ""),
        ] {
            assert_eq!(shifts(mu, sd, ""), found, "{mu}, {sd}");
        }
        let both = "c(row) + path(row) + g(row) + a";
        for (more, found) in [
            ("observe z(row): Number ~ StudentT(4.0, g(row), 1.0);", "a c: s"),
            ("observe z(row): Number ~ StudentT(4.0, path(row), 1.0);", "a c g: s"),
            ("observe z(row): Number ~ StudentT(4.0, path(row), s(row));", ""),
            ("param e ~ Normal(a, 1.0);", "c g: s"),
            ("density e = s[0];", ""),
        ] {
            assert_eq!(shifts(both, "s(row)", more), found, "{more}");
        }
    }

    #[test]
    fn what_is_not_linear_in_fields_is_none() {
        for other in [
            "f(row) * f(row)",
            "s / f(row)",
            "f(row).exp()",
            "exp(f(row))",
            "g(row)",
            "square(row)",
        ] {
            assert_eq!(names(other, "s", ""), None, "{other}");
        }
        assert_eq!(names("f(row)", "s * f(row)", ""), None);
        assert_eq!(names("f(row)", "exp(twice(row))", ""), None);
        let other = "observe z(row): Number ~ StudentT(4.0, f(row), s);";
        assert_eq!(names("f(row)", "s", other), None);
    }

    #[test]
    fn what_is_mentioned_elsewhere_is_no_part_of_the_sum() {
        for more in [
            "param d ~ Normal(a, 1.0);",
            "field h(x) = a + gp(Rbf(2.0), K = 4);",
            "effect e on twice = scaled(row.dose, 1.0, 1.0) ~ Normal(0.0, a.exp());",
            "density d = a * a;",
        ] {
            let own = names("f(row) + a + c(row)", "s", more).unwrap_or_else(|| panic!("{more}"));
            assert!(!own.split(' ').any(|name| name == "a"), "{more}: {own}");
        }
        assert_eq!(names("f(row) + a", "a.exp()", "").as_deref(), Some("b c"));
    }

    #[test]
    fn effects_are_summed_where_what_they_act_on_is() {
        let effect = "effect e on level = scaled(row.dose, 1.0, 1.0) ~ Normal(0.0, 1.0);";
        let has_effect = |mu: &str| names(mu, "s", effect).unwrap().split(' ').any(|n| n == "e");
        assert!(has_effect("f(row) + level(row)"));
        assert!(!has_effect("f(row) * level(row)"));
        assert!(!has_effect("f(row) + exp(level(row))"));
    }
}
