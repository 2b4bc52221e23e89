//! Likelihoods as they are written.

use eplat_language::print;
use eplat_language::syntax::Expr;

use super::expression::{Read, Reader, beyond};
use super::likelihoods::{MOST, Takes, Word, Written};
use super::program::Value;

impl Reader<'_> {
    /// A likelihood of this kind of measurement.
    pub(super) fn likelihood(&mut self, kind: &str, e: &Expr) -> Read<Written> {
        let Expr::Call(call) = e else { return beyond(e) };
        let Expr::Path(path) = &*call.func else { return beyond(e) };
        let all: Vec<&Expr> = call.args.iter().collect();
        match (print(path).as_str(), &all[..]) {
            ("Censored", [inner, floor]) if kind == "Number" => self.censored(e, inner, floor),
            ("Outliers", [inner, share, sd]) => {
                let inner = self.likelihood(kind, inner)?;
                let (share, sd) = (self.value(share)?, self.value(sd)?);
                match (share, sd) {
                    (Value::Plain(share), Value::Plain(sd)) if inner.widens() => {
                        Ok(Written::Outliers(Box::new(inner), share, sd))
                    }
                    _ => beyond(e),
                }
            }
            ("Widened", [inner, sd]) => {
                let (inner, sd) = (self.likelihood(kind, inner)?, self.value(sd)?);
                if !inner.widens() {
                    return beyond(e);
                }
                Ok(Written::Widened(Box::new(inner), sd))
            }
            ("Mixture", [share, a, b]) => {
                let share = self.value(share)?;
                let (a, b) = (self.likelihood(kind, a)?, self.likelihood(kind, b)?);
                match share {
                    Value::Number(_) => Ok(Written::Mixture(share, Box::new(a), Box::new(b))),
                    _ => beyond(e),
                }
            }
            (name, all) => {
                let Some((word, takes)) = Word::of(kind, name) else { return beyond(e) };
                let arguments = self.arguments(e, takes, all)?;
                Ok(Written::Plain(word, arguments))
            }
        }
    }

    fn censored(&mut self, e: &Expr, inner: &Expr, floor: &Expr) -> Read<Written> {
        let Expr::Call(call) = inner else { return beyond(e) };
        let word = match print(&call.func).as_str() {
            "Normal" => "CensoredNormal",
            "LogNormal" => "CensoredLogNormal",
            _ => return beyond(e),
        };
        let Some((word, takes)) = Word::of("Number", word) else { return beyond(e) };
        let all: Vec<&Expr> = call.args.iter().chain([floor]).collect();
        Ok(Written::Plain(word, self.arguments(e, takes, &all)?))
    }

    fn arguments(&mut self, e: &Expr, takes: &[Takes], all: &[&Expr]) -> Read<[Value; MOST]> {
        if takes.len() != all.len() {
            return beyond(e);
        }
        let mut own = [Value::Whole(0); MOST];
        for ((own, takes), e) in own.iter_mut().zip(takes).zip(all) {
            *own = self.value(e)?;
            match (takes, &own) {
                (Takes::Any, _)
                | (Takes::Derivatives, Value::Number(_))
                | (Takes::Plain, Value::Plain(_)) => {}
                _ => return beyond(*e),
            }
        }
        Ok(own)
    }
}
