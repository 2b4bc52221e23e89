//! A model as equations: what `eplat show` prints and the report's first page holds.

use std::fmt::Write as _;

use crate::print;
use crate::syntax::{
    Column, Effect, Field, Hyper, Item, Let, Model, Observe, Over, Param, Prior, Range, Statement,
    Unit, Value,
};

/// Each section's title, and the statements that stand in it.
const SECTIONS: [(&str, &str); 8] = [
    ("Columns of the table", "column"),
    ("Parameters", "param"),
    ("Hyperparameters", "hyper"),
    ("Fields on the surface (GP: Σ η_k √S(√λ_k) φ_k(x), η_k ~ Normal(0, 1))", "field"),
    ("Derived", "let"),
    ("Effects", "effect"),
    ("Log densities", "density"),
    ("Measurements", "observe"),
];

/// Columns of a line; what is longer goes on below, unless it is one word.
const WIDTH: usize = 100;
/// How far that is set in.
const INDENT: &str = "      ";

/// The model as equations, with parameters, units and what `support` says of where the values of a
/// parameter lie. It is asked by the name under which the parameter is reported, such as `tau_out.m`.
pub fn equations(model: &Model, support: &dyn Fn(&str) -> Option<String>) -> String {
    let mut page = Page { text: format!("{}\n", model.name), support, widths: LEAST };
    page.comment("  ", &model.docs);
    for (title, keyword) in SECTIONS {
        let is_of = |s: &&Statement| s.item.keyword() == keyword;
        let statements: Vec<&Statement> = model.statements.iter().filter(is_of).collect();
        if !statements.is_empty() {
            page.line(format_args!("\n{title}"));
        }
        let params = statements.iter().filter_map(|s| match &s.item {
            Item::Param(p) => Some(p),
            _ => None,
        });
        page.widths = widths(params);
        for statement in statements {
            page.comment("  # ", &statement.docs);
            page.statement(&statement.item, model);
        }
    }
    page.text
}

struct Page<'a> {
    text: String,
    support: &'a dyn Fn(&str) -> Option<String>,
    /// Of a parameter's name and its prior, so that they stand below each other.
    widths: [usize; 2],
}

/// Least widths of a parameter's name and its prior.
const LEAST: [usize; 2] = [16, 24];

/// Widths that hold the names and the priors of all these parameters.
fn widths<'p>(params: impl Iterator<Item = &'p Param>) -> [usize; 2] {
    params.fold(LEAST, |[name, of_prior], p| {
        [name.max(head(p).chars().count()), of_prior.max(prior(&p.prior).chars().count())]
    })
}

/// Name, number of values and unit.
fn head(p: &Param) -> String {
    let over = match &p.over {
        Over::One => String::new(),
        Over::Many(n) => format!("({n})"),
        Over::Each(label) => format!("({label})"),
    };
    format!("{}{over}{}", p.name, show(p.unit.as_ref()))
}

/// Words in lines, none longer than [`WIDTH`] with its mark unless it is one word.
fn filled(mark: &str, lines: &[String]) -> Vec<String> {
    let mut filled: Vec<String> = vec![];
    for word in lines.iter().flat_map(|line| line.split_whitespace()) {
        match filled.last_mut() {
            Some(line)
                if [mark, line, word].iter().map(|s| s.chars().count()).sum::<usize>() < WIDTH =>
            {
                line.push(' ');
                line.push_str(word);
            }
            _ => filled.push(word.to_owned()),
        }
    }
    filled
}

/// A line in parts of at most [`WIDTH`] columns, broken before what is expected or else at a space.
fn broken(line: &str) -> Vec<String> {
    let (mut parts, mut rest) = (vec![], line.to_owned());
    while rest.chars().count() > WIDTH {
        let end = rest.char_indices().nth(WIDTH).map_or(rest.len(), |(at, _)| at);
        let indent = rest.len() - rest.trim_start().len();
        let space = rest[indent..end].rfind(' ').map(|at| at + indent);
        let Some(at) = rest.find("    expected in").filter(|at| *at <= end).or(space) else {
            break;
        };
        let next = format!("{INDENT}{}", rest[at..].trim_start());
        parts.push(rest[..at].trim_end().to_owned());
        rest = next;
    }
    parts.push(rest);
    parts
}

impl Page<'_> {
    fn line(&mut self, line: impl std::fmt::Display) {
        for part in broken(&line.to_string()) {
            let _ = writeln!(self.text, "{part}");
        }
    }

    /// Documentation as it was written; a paragraph with too long a line is filled anew.
    fn comment(&mut self, mark: &str, lines: &[String]) {
        let lines: Vec<String> = lines.iter().map(|line| line.trim().to_owned()).collect();
        for paragraph in lines.split(String::is_empty) {
            let fits = |line: &String| line.chars().count() + mark.len() <= WIDTH;
            let said = if paragraph.iter().all(fits) {
                paragraph.to_vec()
            } else {
                filled(mark, paragraph)
            };
            for line in said {
                let _ = writeln!(self.text, "{mark}{line}");
            }
        }
    }

    fn statement(&mut self, item: &Item, model: &Model) {
        match item {
            Item::Column(c) => self.line(column(c)),
            Item::Param(p) => self.param(p, &p.name.to_string(), 2),
            Item::Hyper(h) => {
                self.line(format_args!("  {}", h.name));
                self.params(&h.params, &h.name.to_string());
            }
            Item::Field(f) => self.field(f, model),
            Item::Let(l) => self.line(let_statement(l)),
            Item::Effect(e) => self.line(effect(e)),
            Item::Density(d) => {
                self.line(format_args!("  ln p += {}    ({})", print(&d.expr), d.name));
            }
            Item::Observe(o) => self.line(observe(o)),
        }
    }

    /// The field, and below it its hyperparameters.
    fn field(&mut self, f: &Field, model: &Model) {
        let Field { name, place, unit, range, value, .. } = f;
        let label = f.label.as_ref().map_or(String::new(), |label| format!(", {label}"));
        let unit = show(unit.as_ref());
        let value = match (range, f.is_within) {
            (Some(Range { low, high }), true) => format!("within({low}, {high}; {})", print(value)),
            _ => print(value) + &expected(range.as_ref(), &unit),
        };
        self.line(format_args!("  {name}({place}{label}){unit} = {value}"));
        if let Some(block) = &f.block {
            if block.is_shared {
                self.line(format_args!("      with the hyperparameters {}", block.name));
            } else if let Some(Hyper { params, .. }) = model.hyper(&block.name) {
                let is_own = |p: &&Param| f.params.iter().any(|own| own.name == p.name);
                let params: Vec<Param> = params.iter().filter(|p| !is_own(p)).cloned().collect();
                self.params(&params, &name.to_string());
            }
        }
        self.params(&f.params, &name.to_string());
    }

    fn params(&mut self, params: &[Param], of: &str) {
        self.widths = widths(params.iter());
        for p in params {
            self.param(p, &format!("{of}.{}", p.name), 6);
        }
    }

    /// A parameter that is reported under the name `reported`.
    fn param(&mut self, p: &Param, reported: &str, indent: usize) {
        let [name, of_prior] = self.widths;
        let support = (self.support)(reported).unwrap_or_default();
        let (head, prior) = (head(p), prior(&p.prior));
        let line = format!("{:indent$}{head:<name$} ~ {prior:<of_prior$} {support}", "");
        self.line(line.trim_end());
    }
}

fn column(c: &Column) -> String {
    let len = c.len.map_or(String::new(), |n| format!("({n})"));
    let head = format!("  {}{len}{}", c.name, show(c.unit.as_ref()));
    match &c.prior {
        None => head,
        Some(p) => format!("{head} ~ {}    where its cell is empty", prior(p)),
    }
}

fn let_statement(l: &Let) -> String {
    let Let { name, row, unit, range, value } = l;
    let unit = show(unit.as_ref());
    let value = match value {
        Value::Expr(e) => print(e),
        Value::Linear { columns, beta } => {
            let columns: Vec<String> = columns.iter().map(|c| format!("{row}.{c}")).collect();
            format!("linear({}; {beta})", columns.join(", "))
        }
        Value::Operator(o) => o.text(row),
    };
    format!("  {name}({row}){unit} = {value}{}", expected(range.as_ref(), &unit))
}

fn effect(e: &Effect) -> String {
    let (name, unit, on) = (&e.name, show(e.unit.as_ref()), e.on());
    format!("  {name}{unit} on {on} = {} ~ {}", e.form.text(), prior(&e.prior))
}

fn observe(o: &Observe) -> String {
    let Observe { name, row, kind, unit, from, likelihood } = o;
    let from = from.as_ref().map_or(String::new(), |from| format!(" from ({})", print(from)));
    let unit = show(unit.as_ref());
    format!("  {name}({row}): {kind}{unit}{from} ~ {}", print(likelihood))
}

fn prior(prior: &Prior) -> String {
    print(&prior.expr)
}

fn expected(range: Option<&Range>, unit: &str) -> String {
    range.map_or(String::new(), |Range { low, high }| {
        format!("    expected in {low} to {high}{unit}")
    })
}

fn show(unit: Option<&Unit>) -> String {
    let unit = unit.filter(|unit| unit.text != "1");
    unit.map_or(String::new(), |unit| format!(" [{}]", unit.text))
}

#[cfg(test)]
mod tests {
    use super::broken;
    use crate::{File, equations};

    #[test]
    fn long_lines_go_on_below() {
        let call = format!("  f(x) = g({})", ["tau_out(x)"; 7].join(", "));
        let parts = broken(&format!("{call}    expected in 0 to 9 [ms]"));
        assert_eq!(parts, [call, "      expected in 0 to 9 [ms]".to_owned()]);
        let parts = broken(&format!("  f(x) = g({})", ["tau_out(x)"; 12].join(", ")));
        assert!(
            parts.len() == 2 && parts.iter().all(|part| part.chars().count() <= 100),
            "{parts:?}"
        );
        assert!(parts[1].starts_with("      tau_out(x)"), "{parts:?}");
        let word = "x".repeat(120);
        assert_eq!(broken(&word), [word]);
    }

    #[test]
    fn blocks_labels_and_empty_cells_are_shown() {
        let text = "model! {
            model M;
            column dose [g] ~ Normal(5.0, 2.0);
            param w(3) ~ Mine(1.0);
            hyper smooth { m [ms] ~ Flat; rho [mm] ~ InvGamma(1.0, 50.0); }
            field f(x, patient) [ms] = m + gp(Rbf(rho)*Matern12(rho), K=4) where shared smooth;
            field g(x, patient) [ms] = m + gp(Rbf(rho), K = 4) where smooth { m(patient) [ms] ~ Normal(0, 1); }
            field h(x) [ms] within -1.5..30 = 5.0 + gp(Rbf(9.0), K = 4);
        }";
        let model = File::read(text).unwrap().model;
        let said = equations(&model, &|name| Some(format!("<{name}>")));
        let said: Vec<&str> = said.lines().filter(|line| line.starts_with("  ")).collect();
        let expected = [
            "  dose [g] ~ Normal(5.0, 2.0)    where its cell is empty",
            "  w(3)             ~ Mine(1.0)                <w>",
            "  smooth",
            "      m [ms]           ~ Flat                     <smooth.m>",
            "      rho [mm]         ~ InvGamma(1.0, 50.0)      <smooth.rho>",
            "  f(x, patient) [ms] = m + gp(Rbf(rho) * Matern12(rho), K = 4)",
            "      with the hyperparameters smooth",
            "  g(x, patient) [ms] = m + gp(Rbf(rho), K = 4)",
            "      rho [mm]         ~ InvGamma(1.0, 50.0)      <g.rho>",
            "      m(patient) [ms]  ~ Normal(0, 1)             <g.m>",
            "  h(x) [ms] = within(-1.5, 30; 5.0 + gp(Rbf(9.0), K = 4))",
        ];
        assert_eq!(said, expected);
    }
}
