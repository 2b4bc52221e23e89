//! The differences of sites, recordings and measurements that the search's base fit allows, as
//! statements of a model.

use std::collections::BTreeMap;

use eplat_language::as_name;
use eplat_language::syntax::{Item, Model as Tree, Observe};

use super::LoopError;
use crate::criticism::{Criticism, observables};
use crate::model::forms::group;
use crate::model::{Declare, Discrepancy, Model, RowError, Spread};
use crate::table::{Measurements, SITE, VERTEX};

/// The same differences as in the base fit:
///
/// - of sites, if there are several measurements per site, which tell them from errors of single
///   measurements;
/// - of recordings or sessions, if the search had them;
/// - of single measurements, if brackets are taken as exact, or if scatter was found, which is
///   that of this error.
pub(super) fn discrepancy(
    declared: &dyn Declare,
    criticism: &Criticism,
    table: &Measurements,
    held_out: Option<&Measurements>,
) -> Result<Discrepancy, LoopError> {
    let outline = Model::outline(declared)?;
    let Ok(tree) = outline.syntax() else { return Ok(Discrepancy::default()) };
    let names = Names { tree: &tree, table };
    let has_several = criticism.engine.sites.iter().any(|rows| rows.len() > 1);
    let site = site_of(table, held_out).filter(|_| has_several);
    let unit = criticism.unit_log_bf.as_ref().map(|(unit, _)| unit.as_str());
    let mut targets: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for on in observables(&outline)? {
        let own = targets.entry(names.unit_of(&on)).or_default();
        if !own.contains(&on) {
            own.push(on);
        }
    }
    let mut spreads = vec![];
    for (number, (of_unit, on)) in targets.into_iter().enumerate() {
        let further = if number == 0 { String::new() } else { format!("_{}", on[0]) };
        for column in site.into_iter().chain(unit).filter(|column| !names.has_spread(column)) {
            let what = if Some(column) == site { "site".into() } else { as_name(column) };
            spreads.push(Spread {
                name: names.free(&format!("{what}_difference{further}")),
                sd: names.free(&format!("{what}_sd{further}")),
                prior_sd: criticism.step,
                on: on.clone(),
                unit: of_unit.clone(),
                form: group(column),
                why: format!(
                    "Added by `eplat loop`: what each {} differs by, for reasons that no column tells.",
                    what.trim_end_matches('_')
                ),
            });
        }
    }
    let scatter = (!criticism.scatter().is_empty()).then(|| names.free(SCATTER));
    Ok(Discrepancy { spreads, row_errors: names.row_errors(criticism.step, scatter.as_deref()) })
}

/// The `let` that is ln of the factor by which scatter goes with a column.
const SCATTER: &str = "ln_scatter";

/// The name of that `let` in this model.
pub(super) fn scatter_on(tree: &Tree, table: &Measurements) -> String {
    Names { tree, table }.free(SCATTER)
}

/// The column that names sites in both tables.
fn site_of(table: &Measurements, held_out: Option<&Measurements>) -> Option<&'static str> {
    let columns = || [SITE, VERTEX].into_iter().filter(|column| table.has(column));
    let in_both = |column: &&str| held_out.is_none_or(|held_out| held_out.has(column));
    columns().find(in_both).or_else(|| columns().next())
}

/// The names that are taken by a model and by its table.
struct Names<'a> {
    tree: &'a Tree,
    table: &'a Measurements,
}

impl Names<'_> {
    fn items(&self) -> impl Iterator<Item = &Item> {
        self.tree.statements.iter().map(|statement| &statement.item)
    }

    fn unit_of(&self, name: &str) -> String {
        let item = self.items().find(|item| item.name() == name);
        item.and_then(Item::unit).map_or_else(String::new, |unit| unit.text.clone())
    }

    /// The name, or a longer one if the model or the table has it already.
    fn free(&self, name: &str) -> String {
        let mut name = name.to_owned();
        while self.table.has(&name) || self.items().any(|item| item.name() == &name) {
            name += "_further";
        }
        name
    }

    /// Whether the model has a difference of the labels of this column already.
    fn has_spread(&self, column: &str) -> bool {
        self.items().any(|item| match item {
            Item::Effect(effect) => {
                let is_group = effect.form.name.get_ident().is_some_and(|form| form == "group");
                is_group && effect.form.columns.iter().any(|own| *own == as_name(column))
            }
            _ => false,
        })
    }

    /// A further error of the measurements whose likelihood has none; with scatter, of all that can
    /// have one.
    fn row_errors(&self, step: f64, scatter: Option<&str>) -> Vec<RowError> {
        let mut of_unit: BTreeMap<String, Vec<String>> = BTreeMap::new();
        let has_error = |observe: &&Observe| {
            self.tree.is_exact(observe) || scatter.is_some() && self.tree.widens(observe)
        };
        for observe in self.tree.observes().filter(has_error) {
            let unit = observe.unit.as_ref().map_or_else(String::new, |unit| unit.text.clone());
            of_unit.entry(unit).or_default().push(observe.name.to_string());
        }
        let error = |(number, (unit, observes)): (usize, (String, Vec<String>))| {
            let further = if number == 0 { String::new() } else { format!("_{}", observes[0]) };
            RowError {
                name: self.free(&format!("row_error{further}")),
                prior_sd: step,
                unit,
                observes,
                scatter: scatter.map(String::from),
                why: match scatter {
                    Some(_) => "Added by `eplat loop`: a further error of each measurement.",
                    None => "Added by `eplat loop`: an error of each measurement; its bracket is not taken as exact.",
                }
                .into(),
            }
        };
        of_unit.into_iter().enumerate().map(error).collect()
    }
}
