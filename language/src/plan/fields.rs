//! Fields, and blocks of hyperparameters.

use quote::format_ident;
use syn::parse_quote;

use super::scope::{Kind, Scope};
use super::{Call, Field, Parameter, Planner, Term, declared, kind_of, parameter};
use crate::print::print;
use crate::syntax::{self, Expr, Hyper, Ident, Item, Param, Range};

impl<'m> Planner<'m> {
    /// A block: its parameters are declared here if a field shares them, otherwise by each field that takes it.
    pub(super) fn hyper(&mut self, hyper: &'m Hyper) {
        let is_shared = self.model.items().any(|item| match item {
            Item::Field(field) => {
                field.block.as_ref().is_some_and(|b| b.is_shared && b.name == hyper.name)
            }
            _ => false,
        });
        let (params, own) = self.params(&hyper.name, &hyper.params, &Scope::default());
        self.blocks.push((hyper, own));
        if is_shared {
            self.calls.push(Call::Block { name: &hyper.name, params });
        }
    }

    /// Hyperparameters of `owner`, each of which sees those before it; and their names. `seen` are names of others.
    fn params(
        &self,
        owner: &Ident,
        params: &'m [Param],
        seen: &Scope,
    ) -> (Vec<Parameter<'m>>, Scope) {
        let (mut calls, mut own) = (vec![], seen.clone());
        for param in params {
            calls.push(parameter(param, &self.scope.with(&own)));
            own.declare(&param.name, format!("{owner}.{}", param.name), kind_of(param));
        }
        (calls, own)
    }

    pub(super) fn field(&mut self, field: &'m syntax::Field) {
        let declared = declared(&field.name, field.unit.as_ref(), print(&field.value));
        let block = field.block.as_ref().and_then(|own| {
            let found = self.blocks.iter().find(|(hyper, _)| hyper.name == own.name);
            found.map(|(hyper, names)| (own.is_shared, *hyper, names.clone()))
        });
        let (mut params, own) = match block {
            Some((true, _, names)) => (vec![], names),
            Some((false, hyper, _)) => self.params(&field.name, &hyper.params, &Scope::default()),
            None => (vec![], Scope::default()),
        };
        let (more, own) = self.params(&field.name, &field.params, &own);
        params.extend(more);
        let scope = self.scope.with(&own);
        let lone_mean = lone_name(field.mean.as_ref(), &own);
        let number =
            |e: &Option<Expr>, else_it_is: Expr| scope.function(e.as_ref().unwrap_or(&else_it_is));
        let terms = field.terms.iter().map(|term| Term {
            amplitude: number(&term.amplitude, parse_quote!(1.0)),
            modes: term.modes,
            kernel: scope.function(&term.kernel),
        });
        let (mean, terms) = (number(&field.mean, parse_quote!(0.0)), terms.collect());
        self.declare_field(field);
        let field = Field { declared, field, params, mean, lone_mean, terms };
        self.calls.push(Call::Field(Box::new(field)));
    }

    /// A field as expressions see it: its sum or, where it is bent into a range, a `let` of its sum.
    fn declare_field(&mut self, field: &syntax::Field) {
        let (name, place) = (&field.name, &field.place);
        let Some(Range { low, high }) = field.range.filter(|_| field.is_within) else {
            self.scope.declare(name, name.to_string(), Kind::Row);
            return;
        };
        let sum = format_ident!("{name}__sum");
        self.scope.declare(&sum, format!("{name}.sum"), Kind::Row);
        let value = Box::new(parse_quote!(expansion::within(#low, #high, #sum(#place))));
        self.scope.declare(name, name.to_string(), Kind::Let { row: place.clone(), value });
    }
}

/// `tau_out.m` where the mean is a hyperparameter and nothing else.
fn lone_name(mean: Option<&Expr>, own: &Scope) -> Option<String> {
    let Some(Expr::Path(path)) = mean else { return None };
    path.path.get_ident()?;
    let mentioned = own.mentioned(path);
    if let [name] = mentioned.numbers[..] { Some(name.full.clone()) } else { None }
}
