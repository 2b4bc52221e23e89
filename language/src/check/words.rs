//! The priors, kernels and likelihoods that ship: whether each stands where it may, and takes what it is
//! given. What the file declares under one of their names is the user's own, and not judged.

use proc_macro2::Group;
use syn::Expr;
use syn::parse::Parser as _;
use syn::punctuated::Punctuated;

use crate::around::Around;
use crate::mistake::{Mistake, span_of};
use crate::names::mentions;
use crate::print;
use crate::syntax::{Ident, Observe};
use crate::vocabulary::{Class, KINDS, Role, Word, find, listed, nearest};

const LIKELIHOODS: &str = "a Bracket takes TopHat(f) or Interval(f, sigma); a Number takes Normal(mu, sd), StudentT, Cauchy, Laplace, LogNormal, Gamma or Exponential, or Censored(Normal(mu, sd), floor); a Count takes PoissonLog(eta), BernoulliLogit(eta), BinomialLogit(n, eta), NegBinomialLog(eta, phi) or OrderedLogit(eta, cut); any of these as Outliers(likelihood, share, sd), Mixture(share, A, B) or, of normal errors, Widened(likelihood, sd)";

/// A prior of one number or of a vector.
pub(super) fn prior(e: &Expr, around: &Around) -> Vec<Mistake> {
    let mut mistakes = arguments(e, around);
    let is_prior =
        |word: &Word| word.classes.iter().any(|c| matches!(c, Class::Prior | Class::Joint));
    each(e, around, &mut |word, e| {
        if !is_prior(word) {
            let help = format!("a prior is {}", listed(is_prior));
            mistakes.push(Mistake::at(span_of(e), format!("`{}` is no prior", word.name), help));
        }
    });
    mistakes
}

/// A kernel, or a sum or product of kernels.
pub(super) fn kernel(e: &Expr, around: &Around) -> Vec<Mistake> {
    if let Expr::Binary(binary) = e {
        return [kernel(&binary.left, around), kernel(&binary.right, around)].concat();
    }
    let mut mistakes = vec![];
    let is_kernel = |word: &Word| word.classes.contains(&Class::Kernel);
    each(e, around, &mut |word, e| {
        if !is_kernel(word) {
            let help = format!("a kernel is {}", listed(is_kernel));
            mistakes.push(Mistake::at(span_of(e), format!("`{}` is no kernel", word.name), help));
        }
    });
    mistakes
}

/// What is observed is one of the kinds that ship, or a type of the file.
pub(super) fn kind(observe: &Observe, around: &Around) -> Vec<Mistake> {
    let kind = observe.kind.to_string();
    let is_known = KINDS.contains(&kind.as_str()) || around.is_open() || around.declares(&kind);
    if is_known {
        return vec![];
    }
    let near = nearest(&kind, KINDS).map(|near| format!("did you mean `{near}`? "));
    let near = near.unwrap_or_default();
    let help = if near.is_empty() { "what" } else { "What" };
    let help = format!("{near}{help} is observed is a Bracket, a Number or a Count");
    vec![Mistake::at(observe.kind.span(), format!("unknown name `{kind}`"), help)]
}

/// A likelihood of the kind of measurement.
pub(super) fn likelihood(observe: &Observe, around: &Around) -> Vec<Mistake> {
    let mut mistakes = arguments(&observe.likelihood, around);
    let kind = observe.kind.to_string();
    if !KINDS.contains(&kind.as_str()) || around.declares(&kind) {
        return mistakes;
    }
    let takes = |word: &Word| {
        let mut classes = word.classes.iter();
        classes.any(|c| matches!(c, Class::Likelihood(kinds) if kinds.contains(&kind.as_str())))
    };
    each(&observe.likelihood, around, &mut |word, e| {
        if !takes(word) {
            let message = format!("`{}` is not a likelihood of a `{kind}`", word.name);
            mistakes.push(Mistake::at(span_of(e), message, LIKELIHOODS));
        }
        mistakes.extend(censored(word, e, around, &takes));
    });
    mistakes
}

/// What `Censored` cannot take, of what would do for the kind of measurement.
fn censored(
    word: &Word,
    e: &Expr,
    around: &Around,
    takes: &dyn Fn(&Word) -> bool,
) -> Option<Mistake> {
    const CENSORED: &str = "Censored takes Normal(mean, sd) or LogNormal(mean, sd); Widened and Outliers go around it: Outliers(Censored(Normal(mean, sd), floor), share, sd)";
    let Expr::Call(call) = e else { return None };
    let inner = call.args.first().filter(|_| word.name == "Censored" && takes(word))?;
    let mut mistake = None;
    let mut is_outer = true;
    each(inner, around, &mut |word, e| {
        let is_known = !takes(word) || matches!(word.name, "Normal" | "LogNormal");
        if std::mem::take(&mut is_outer) && !is_known {
            let message = format!("`{}` cannot be censored", word.name);
            mistake = Some(Mistake::at(span_of(e), message, CENSORED));
        }
    });
    mistake
}

/// The word that an expression is or calls, and those within it: the two parts of a mixture.
fn each(e: &Expr, around: &Around, found: &mut dyn FnMut(&Word, &Expr)) {
    let (function, arguments) = match e {
        Expr::Paren(paren) => return each(&paren.expr, around, found),
        Expr::Call(call) => (&*call.func, Some(&call.args)),
        e => (e, None),
    };
    let Expr::Path(path) = function else { return };
    let Some(name) = path.path.get_ident() else { return };
    let Some(word) = word(name, around) else { return };
    found(word, e);
    for (argument, (_, role)) in arguments.into_iter().flatten().zip(word.arguments) {
        if *role == Role::Inner {
            each(argument, around, found);
        }
    }
}

/// What ships under this name, unless the file has something else there.
fn word(name: &Ident, around: &Around) -> Option<&'static Word> {
    let name = name.to_string();
    if around.declares(&name) { None } else { find(&name) }
}

/// The words anywhere in `e` that are given another number of arguments than they take.
pub(super) fn arguments(e: &Expr, around: &Around) -> Vec<Mistake> {
    let mut mistakes = vec![];
    for mention in mentions(e) {
        let Some(word) = word(&mention.name, around) else { continue };
        let is_all = matches!(e, Expr::Path(_));
        let given = match &mention.arguments {
            Some(group) => split(group),
            None if is_all && !word.arguments.is_empty() => Some(vec![]),
            None => None,
        };
        let Some(given) = given else { continue };
        let wrong_call = word.arguments.is_empty() && mention.arguments.is_some();
        if given.len() != word.arguments.len() || wrong_call {
            mistakes.push(wrong_number(word, &mention.name, &given));
        }
    }
    mistakes
}

fn wrong_number(word: &Word, at: &Ident, given: &[String]) -> Mistake {
    let Word { name, arguments, .. } = word;
    if arguments.is_empty() {
        let message = format!("`{name}` takes no arguments");
        return Mistake::at(at.span(), message, format!("write `{name}`"));
    }
    let plural = |n: usize| if n == 1 { "argument" } else { "arguments" };
    let (takes, n) = (arguments.len(), given.len());
    let was = if n == 1 { "was" } else { "were" };
    let message =
        format!("`{name}` takes {takes} {} but {n} {} {was} supplied", plural(takes), plural(n));
    let missing = arguments.iter().skip(n).map(|(argument, _)| (*argument).to_string());
    let right: Vec<String> = given.iter().take(takes).cloned().chain(missing).collect();
    Mistake::at(at.span(), message, format!("write `{name}({})`", right.join(", ")))
}

/// The arguments between the brackets of a call; `None` where these are no expressions.
fn split(group: &Group) -> Option<Vec<String>> {
    let arguments = Punctuated::<Expr, syn::Token![,]>::parse_terminated;
    let arguments = arguments.parse2(group.stream()).ok()?;
    Some(arguments.iter().map(print).collect())
}
