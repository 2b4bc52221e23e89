//! What shifts the rows, and which rows.

use std::collections::BTreeMap;

use crate::dist::Gaussian;
use crate::model::blocked::priors_of;
use crate::model::gp::Term;
use crate::model::laid_out::{FieldEntry, Model};
use crate::model::tape::Tape;

/// What integrates out of a model, and what rests during a trajectory.
#[derive(Debug)]
pub(super) struct Shifts<'m> {
    pub(super) model: &'m Model,
    /// The fields that are integrated out.
    pub(super) fields: Vec<usize>,
    pub(super) coefficients: Vec<Coefficient>,
    pub(super) parts: Vec<Part>,
    /// Unknowns that C depends on.
    pub(super) shaping: Vec<usize>,
    /// The same, then those that W depends on, in groups that move one after the other.
    pub(super) moving: Vec<Vec<usize>>,
    /// The unknowns of [`Model::scales_of_fields`] that are not `shaping`, those that W depends on, and the coefficients.
    pub(super) resting: Vec<usize>,
    /// The values that C, and that W depends on.
    pub(super) depends: [Vec<usize>; 2],
}

/// A number that is integrated out.
#[derive(Debug)]
pub(super) struct Coefficient {
    /// Its unknown, which is `zero + unit w`.
    pub(super) unknown: usize,
    pub(super) zero: f64,
    pub(super) unit: f64,
    /// Prior precision of w.
    pub(super) precision: f64,
    pub(super) from: Origin,
}

/// Where a coefficient belongs.
#[derive(Clone, Copy, Debug)]
pub(super) enum Origin {
    /// Mode k of a term of a field.
    Mode { field: usize, term: usize, k: usize },
    /// A value that is location + scale w.
    Value { at: usize, location: f64, scale: f64 },
}

/// Coefficients that no row connects with others.
#[derive(Debug, Default)]
pub(super) struct Part {
    /// Which coefficients.
    pub(super) of: Vec<usize>,
    pub(super) rows: Vec<PartRow>,
    /// D, row-major `(row, coefficient)`.
    pub(super) design: Vec<f64>,
}

/// A row, and one of its numbers that shift it.
#[derive(Clone, Copy, Debug)]
pub(super) struct PartRow {
    /// `[observe, row]`
    pub(super) id: [usize; 2],
    pub(super) number: usize,
    /// Derivative of the row's mean in that number: 1 or −1.
    pub(super) slope: f64,
}

impl PartRow {
    /// The derivative of ln L in the row's mean, and W, after a forward pass.
    pub(super) fn normal(self, model: &Model, t: &Tape) -> [f64; 2] {
        let Self { id: [observe, row], number, slope } = self;
        let [first, second] = model.observes[observe].op.derivatives(t, row, number);
        [first / slope, -second / (slope * slope)]
    }
}

impl<'m> Shifts<'m> {
    /// `None` where there is nothing to integrate out.
    pub(super) fn of(model: &'m Model) -> Option<Self> {
        if model.over.is_empty() {
            return None;
        }
        let tree = model.syntax().ok()?;
        let shifts = tree.shifts()?;
        let named = |names: &[&syn::Ident]| names.iter().map(ToString::to_string).collect();
        let (names, sds): (Vec<String>, Vec<String>) = (named(&shifts.names), named(&shifts.sds));
        let own = model.scales_of_fields();
        let mut tape = model.tape();
        model.forward(&mut tape, &model.initial());
        let scaled_by = |entry: &FieldEntry| -> Vec<usize> {
            entry.op.terms.iter().flat_map(Term::scaled_by).collect()
        };
        let is_named = |entry: &FieldEntry| {
            let name = entry.name.split('[').next();
            name.is_some_and(|name| names.iter().any(|n| n == name))
        };
        let others: Vec<usize> =
            model.fields.iter().filter(|f| !is_named(f)).flat_map(scaled_by).collect();
        let (mut fields, mut coefficients) = (vec![], vec![]);
        let (mut moving, mut depends) = (vec![], [vec![], vec![]]);
        for (field, entry) in model.fields.iter().enumerate().filter(|(_, entry)| is_named(entry)) {
            let scaled_by = scaled_by(entry);
            let scales = model.unknowns_of(&scaled_by);
            let is_own = scales.iter().all(|u| own.contains(u));
            if !is_own || scaled_by.iter().any(|v| others.contains(v)) {
                continue;
            }
            for (term, op) in entry.op.terms.iter().enumerate() {
                coefficients.extend((0..op.k).map(|k| Coefficient {
                    unknown: op.eta + k,
                    zero: 0.0,
                    unit: 1.0,
                    precision: 1.0,
                    from: Origin::Mode { field, term, k },
                }));
            }
            fields.push(field);
            depends[0].extend(scaled_by);
            if !scales.is_empty() && !moving.contains(&scales) {
                moving.push(scales);
            }
        }
        for prior in priors_of(model, &names) {
            let entry = &model.prior_entries[prior];
            if !entry.mentions.is_empty() {
                continue;
            }
            let Gaussian { location, scale, precision } = model.priors[prior].gaussian(&tape.v)?;
            let unknown = |w: f64| model.priors[prior].unknown(&tape.v, location + scale * w);
            let [zero, one] = [0.0, 1.0].map(unknown);
            coefficients.extend(entry.u.clone().enumerate().map(|(i, u)| Coefficient {
                unknown: u,
                zero,
                unit: one - zero,
                precision,
                from: Origin::Value { at: entry.v + i, location, scale },
            }));
        }
        let mut shaping = moving.concat();
        shaping.sort_unstable();
        shaping.dedup();
        for name in &sds {
            let entry =
                model.declared().zip(&model.prior_entries).find(|(own, _)| own.name == *name)?.1;
            depends[1].extend(entry.v..entry.v + entry.len);
            moving.extend(entry.u.clone().map(|u| vec![u]));
        }
        let parts = parts(model, &tape, &coefficients)?;
        let mut resting = own;
        resting.extend(moving.iter().flatten());
        resting.retain(|i| shaping.binary_search(i).is_err());
        resting.extend(coefficients.iter().map(|c| c.unknown));
        resting.sort_unstable();
        resting.dedup();
        (!coefficients.is_empty()).then_some(Self {
            model,
            fields,
            coefficients,
            parts,
            shaping,
            moving,
            resting,
            depends,
        })
    }
}

/// Coefficients in parts that no row connects; `None` where the rows are not all normal.
fn parts(model: &Model, tape: &Tape, coefficients: &[Coefficient]) -> Option<Vec<Part>> {
    // the coefficients that each value of a row shows, with what each is multiplied by beside C
    let shown = |v: usize| -> Vec<(usize, f64)> {
        let of = |(j, c): (usize, &Coefficient)| match c.from {
            Origin::Value { at, .. } => (at == v).then_some((j, 1.0)),
            Origin::Mode { field, k, .. } => {
                let op = &model.fields[field].op;
                let probe = v.checked_sub(op.theta).filter(|probe| *probe < op.n_probes())?;
                Some((j, op.probes[probe * op.stride + k]))
            }
        };
        coefficients.iter().enumerate().filter_map(of).collect()
    };
    let mut rows = vec![];
    for (observe, of) in model.observes.iter().enumerate() {
        for row in 0..of.rows.len() {
            let locals = of.op.place.locals(row);
            let values: Vec<f64> =
                locals.iter().map(|(v, hook)| tape.v[*v] + tape.v[*hook]).collect();
            let seen: Vec<_> = locals.iter().map(|(v, _)| shown(*v)).collect();
            if of.op.place.left_out == Some(row) || seen.iter().all(Vec::is_empty) {
                continue;
            }
            let slopes = of.op.location_slopes(row, &values)?;
            let mut design = vec![];
            for (seen, slope) in seen.iter().zip(&slopes) {
                design.extend(seen.iter().map(|(j, x)| (*j, slope * x)));
            }
            let shifts = |(seen, slope): (&Vec<_>, &f64)| !seen.is_empty() && *slope != 0.0;
            let Some(k) = seen.iter().zip(&slopes).position(shifts) else { continue };
            let number = of.op.place.slots()[k];
            rows.push((PartRow { id: [observe, row], number, slope: slopes[k] }, design));
        }
    }
    // each coefficient's part; at first it is alone
    let mut part_of: Vec<usize> = (0..coefficients.len()).collect();
    for (_, design) in &rows {
        let joined: Vec<usize> = design.iter().map(|(j, _)| part_of[*j]).collect();
        let Some(least) = joined.iter().min() else { continue };
        part_of.iter_mut().filter(|part| joined.contains(part)).for_each(|part| *part = *least);
    }
    let mut parts: BTreeMap<usize, Part> = BTreeMap::new();
    for (j, part) in part_of.iter().enumerate() {
        parts.entry(*part).or_default().of.push(j);
    }
    for (row, design) in rows {
        let Some(part) = design.first().and_then(|(j, _)| parts.get_mut(&part_of[*j])) else {
            continue;
        };
        let first = part.design.len();
        part.design.resize(first + part.of.len(), 0.0);
        for (j, x) in design {
            if let Ok(at) = part.of.binary_search(&j) {
                part.design[first + at] += x;
            }
        }
        part.rows.push(row);
    }
    Some(parts.into_values().collect())
}

impl Model {
    /// The unknowns of declared parameters among whose values these are.
    fn unknowns_of(&self, values: &[usize]) -> Vec<usize> {
        let is_in = |v: std::ops::Range<usize>| values.iter().any(|value| v.contains(value));
        let entries = self.prior_entries.iter().filter(|e| is_in(e.v..e.v + e.len));
        entries.flat_map(|entry| entry.u.clone()).collect()
    }
}
