//! The bench: the model laid out with everything that a search tries. Every step of the search
//! works on it.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::candidate::{Candidate, Level, Unusable};
use super::checks::{Warning, check, copies};
use super::engine::{Engine, Outer, TriedTerm};
use super::error::CriticismError;
use super::fine::{finer_fields, smooth_fields};
use super::fit::LaplaceFit;
use super::observable::{observables, step_of};
use super::outer::{Free, optimise};
use super::propose::{Maker, covariates};
use super::screen::field_sd;
use super::units::{Unit, by_site, random_unit, unit_of};
use crate::manifold::Basis;
use crate::model::{Declare, Form, Model};
use crate::table::Measurements;

/// What is criticised.
#[derive(Clone, Copy)]
pub struct Subject<'a> {
    /// The model as declared.
    pub model: &'a dyn Declare,
    /// Eigenpairs of the surface, if the model has fields.
    pub basis: Option<&'a Basis>,
    /// The measurements.
    pub table: &'a Measurements,
}

impl std::fmt::Debug for Subject<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Subject").field("model", &self.model.name()).finish_non_exhaustive()
    }
}

/// A model laid out with everything that is tried. A round does not change its bench; what the
/// round claims makes another one.
#[derive(Clone, Debug)]
pub(super) struct Bench<'a> {
    pub(super) table: &'a Measurements,
    pub(super) candidates: Vec<Candidate>,
    /// Its terms are, in this order, those of the candidates, that of the unit, those of finer
    /// fields, those of smooth fields, and those of empty cells.
    pub(super) engine: Engine,
    /// Terms of finer fields, once for each size.
    pub(super) finer: Vec<Vec<usize>>,
    /// Terms of smooth fields.
    pub(super) smooth: Vec<usize>,
    /// For each column with empty cells, the term that gives each site with an empty cell a value
    /// of its own.
    pub(super) absent: BTreeMap<String, usize>,
    /// Width of a protocol step.
    pub(super) step: f64,
    /// The unit with a random effect, if there is one.
    pub(super) unit: Option<Unit>,
    /// Seed of every random stream.
    pub(super) seed: u64,
}

/// A bench, the fit of the model as declared, and what the table's checks say.
pub(super) struct Start<'a> {
    pub(super) bench: Bench<'a>,
    pub(super) base: LaplaceFit,
    pub(super) unusable: Vec<Unusable>,
    pub(super) warnings: Vec<Warning>,
}

impl<'a> Start<'a> {
    /// Lays the model out, fits it and proposes the candidates.
    pub(super) fn new(subject: &Subject<'a>, seed: u64) -> Result<Self, CriticismError> {
        let Subject { table, basis, .. } = *subject;
        let on = observables(&Model::outline(subject.model)?)?;
        let mut plain = laid_out(subject, &on)?;
        let columns = covariates(&plain.model, table);
        let warnings = check(table, &columns);
        let unit = random_unit(table, columns.into_iter());
        let of_unit = unit.as_ref().map(|unit| Arc::new(unit_term(unit, &on)));
        plain.terms.extend(of_unit.clone());
        let step = step_of(&plain.model);
        let mut base = base_fit(&plain, step)?;
        let field_sd = field_sd(&plain, &base, step);
        let maker = Maker {
            model: &plain.model,
            table,
            on: each_once(&on),
            step,
            field_sd: field_sd.clone(),
            unit: unit.as_ref(),
        };
        let (candidates, unusable) = maker.all();
        let mut engine = plain.clone();
        engine.terms = candidates.iter().map(|c| Arc::new(term(c, table))).collect();
        base.active = if of_unit.is_some() { vec![engine.terms.len()] } else { vec![] };
        engine.terms.extend(of_unit);
        let finer = add_finer_fields(&mut engine, basis, table, &field_sd);
        let first = engine.terms.len();
        let smooth = smooth_fields(&engine.model, basis, table, engine.sites.len(), &field_sd);
        engine.terms.extend(smooth.into_iter().map(Arc::new));
        let smooth = (first..engine.terms.len()).collect();
        let absent = add_absent(&mut engine, table, &each_once(&on), step);
        let bench = Bench { table, candidates, engine, finer, smooth, absent, step, unit, seed };
        Ok(Self { bench, base, unusable, warnings })
    }
}

impl Bench<'_> {
    /// The terms of a fit: the random effect of units, which is always there, and these.
    pub(super) fn active(&self, candidates: &[usize]) -> Vec<usize> {
        let unit = self.unit.iter().map(|_| self.candidates.len());
        unit.chain(candidates.iter().copied()).collect()
    }

    /// The terms of a fit, and a candidate. Where the candidate's column is empty, its effect may
    /// act unseen. So each site with an empty cell gets a value of its own. Otherwise these sites,
    /// which the candidate cannot explain, would hide what it explains at the others.
    pub(super) fn and(&self, active: &[usize], candidate: usize) -> Vec<usize> {
        let is_shift = self.candidates[candidate].level == Level::Observable;
        let column = self.column(candidate).filter(|_| is_shift);
        let absent = column.and_then(|column| self.absent.get(column));
        let absent = absent.filter(|term| !active.contains(term));
        active.iter().chain(absent).copied().chain([candidate]).collect()
    }

    /// The fit without the terms of empty cells, because no model file declares these.
    pub(super) fn declared(&self, fit: &LaplaceFit) -> Option<LaplaceFit> {
        let is_declared = |term: &usize| !self.absent.values().any(|absent| absent == term);
        let active: Vec<usize> = fit.active.iter().copied().filter(is_declared).collect();
        if active == fit.active {
            return Some(fit.clone());
        }
        self.engine.fit(&fit.outer, &active, None)
    }

    /// The same bench, with another form of some candidates.
    pub(super) fn with_form(&self, which: &[usize], form: &Form) -> Self {
        self.with(which, |candidate| candidate.form = Some(form.clone()))
    }

    /// The same bench, with some candidates changed.
    pub(super) fn with(&self, which: &[usize], change: impl Fn(&mut Candidate)) -> Self {
        let mut other = self.clone();
        for c in which {
            change(&mut other.candidates[*c]);
            other.engine.terms[*c] = Arc::new(term(&other.candidates[*c], self.table));
        }
        other
    }

    /// The best fit from `start`, and its score.
    pub(super) fn optimised(&self, start: &LaplaceFit, free: Free) -> Option<(LaplaceFit, f64)> {
        optimise(&self.engine, &start.active, start, free, self.step)
    }

    /// The column that a candidate reads.
    pub(super) fn column(&self, candidate: usize) -> Option<&str> {
        self.candidates[candidate].column()
    }

    /// The unit that is left out as a whole to confirm an effect of `column`, or of no column.
    /// `None` stands for the site.
    pub(super) fn left_out(&self, column: Option<&str>) -> Option<Unit> {
        let unit = Some(unit_of(self.table, column)).filter(|unit| *unit != by_site(self.table));
        if column.is_some() { unit } else { unit.or_else(|| self.unit.clone()) }
    }
}

/// Lays the model out for Laplace fits, without anything to try. Copies of rows are left aside.
/// They would make errors look small, so that any difference between sites would look like a cause.
fn laid_out(subject: &Subject<'_>, on: &[String]) -> Result<Engine, CriticismError> {
    let Subject { model, basis, table } = *subject;
    let outline = Model::outline(model)?;
    let fields = outline.field_names().into_iter().map(String::from);
    let offsets_on: Vec<String> = on.iter().cloned().chain(fields).collect();
    let model = Model::with_offsets(model, basis, table, &offsets_on)?;
    let copies = copies(table, &covariates(&model, table));
    Ok(Engine::new(model, on, &by_site(table).group, &copies, vec![]))
}

/// The effect of a candidate.
fn term(candidate: &Candidate, table: &Measurements) -> TriedTerm {
    let (design, n) = candidate.form.as_ref().map_or((vec![], 0), |form| form.design(table));
    TriedTerm { on: candidate.on.clone(), design, n, sd: Some(candidate.sd) }
}

/// The random effect of units.
fn unit_term(unit: &Unit, on: &[String]) -> TriedTerm {
    TriedTerm { on: on.to_vec(), design: unit.design(), n: unit.n, sd: None }
}

fn each_once(on: &[String]) -> Vec<String> {
    let mut once = on.to_vec();
    once.sort();
    once.dedup();
    once
}

/// Adds the terms of finer fields. Returns their numbers, once for each size.
fn add_finer_fields(
    engine: &mut Engine,
    basis: Option<&Basis>,
    table: &Measurements,
    field_sd: &BTreeMap<String, f64>,
) -> Vec<Vec<usize>> {
    let mut finer = vec![];
    for terms in finer_fields(&engine.model, basis, table, engine.sites.len(), field_sd) {
        let first = engine.terms.len();
        engine.terms.extend(terms.into_iter().map(Arc::new));
        finer.push((first..engine.terms.len()).collect());
    }
    finer
}

/// Adds a term for each column of numbers that has empty cells, if these are at most at half of the
/// sites. The term has a value for each of these sites.
fn add_absent(
    engine: &mut Engine,
    table: &Measurements,
    on: &[String],
    step: f64,
) -> BTreeMap<String, usize> {
    let (site, mut found) = (by_site(table), BTreeMap::new());
    for column in covariates(&engine.model, table) {
        let Some(numbers) = table.column(column).and_then(|c| c.numbers()) else { continue };
        let mut sites: Vec<usize> =
            (0..table.len()).filter(|r| numbers[*r].is_nan()).map(|r| site.group[r]).collect();
        sites.sort_unstable();
        sites.dedup();
        if sites.is_empty() || 2 * sites.len() > site.n {
            continue;
        }
        let n = sites.len();
        let mut design = vec![0.0; table.len() * n];
        for row in (0..table.len()).filter(|r| numbers[*r].is_nan()) {
            if let Ok(k) = sites.binary_search(&site.group[row]) {
                design[row * n + k] = 1.0;
            }
        }
        found.insert(column.clone(), engine.terms.len());
        let term = TriedTerm { on: on.to_vec(), design, n, sd: Some(step) };
        engine.terms.push(Arc::new(term));
    }
    found
}

/// The base fit, before anything is tried. It starts from the model's own start, with noise of a
/// third of a step. Differences of sites can be explained in two ways: by smooth fields and random
/// effects, or by rough fields. The better of the two is taken.
fn base_fit(engine: &Engine, step: f64) -> Result<LaplaceFit, CriticismError> {
    let initial = engine.model.initial();
    let active: Vec<usize> = (0..engine.terms.len()).collect();
    let third = (step / 3.0).ln();
    let from = |site: f64| {
        let outer = Outer {
            other: engine.split.other.iter().map(|u| initial[*u]).collect(),
            ln_site: (site * step).ln(),
            ln_noise: third,
            ln_unit: active.first().map(|_| third),
            outliers: None,
            scatter: vec![],
        };
        let start = engine.fit(&outer, &active, None)?;
        optimise(engine, &active, &start, Free::All, step)
    };
    let fits = [1.0 / 3.0, 0.1].into_iter().filter_map(from);
    let best = fits.max_by(|a, b| a.1.total_cmp(&b.1));
    best.map(|(fit, _)| fit).ok_or(CriticismError::NoFit)
}
