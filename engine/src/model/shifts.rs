//! Fields and parameters that shift normal measurements, integrated out.
//!
//! Where a model has an operator over the surface, a gradient costs milliseconds, and fields that are added to the operator's
//! numbers can stand for much of what it says: a chain that moves both moves slowly. But they integrate out. With w
//! their coefficients, of prior precision T, and C what these are multiplied by:
//!
//! ```text
//! y ~ N(m + D C w, W⁻¹)        P = T + C DᵀWD C        b = C DᵀW (y − m)
//! ln ∫ p(w) L dw = ln p(0) L(0) + ½ bᵀP⁻¹b − ½ ln |P| + const        w | y ~ N(P⁻¹b, P⁻¹)
//! ```
//! C and W rest during a trajectory, so that P stays. The gradient of the integral is that of p(w) L at w = P⁻¹b. Between
//! trajectories C and W move under the integral, which costs no operator, and then w is drawn.

use faer::Mat;
use rand::{Rng, RngExt as _};
use rand_distr::StandardNormal;
use rayon::prelude::*;

use super::blocked::{Predictive, priors_of};
use super::gp::{Term, padded};
use super::laid_out::{FieldEntry, Model};
use super::local::RowId;
use super::second::Hessian;
use super::tape::{Op as _, Tape};
use crate::dist::Gaussian;
use crate::infer::{Evaluator, Factor, LogDensity};
use crate::num::LN_SQRT_2PI;
use crate::num::vector::dot;
use crate::random::Stream;

/// Steps of C and of W: some small, some large, and how often each is made.
const STEPS: [f64; 3] = [0.03, 0.1, 0.3];
const ROUNDS: usize = 10;

/// The density of a model with an operator over the surface, with what shifts its measurements integrated out. A position is
/// one of the model's unknowns; of those that are integrated out it does not depend.
#[derive(Debug)]
pub(super) struct WithoutShifts<'m> {
    model: &'m Model,
    /// The fields that are integrated out.
    fields: Vec<usize>,
    coefficients: Vec<Coefficient>,
    parts: Vec<Part>,
    /// Unknowns that C, then those that W depends on. Each of these moves on its own.
    moving: Vec<Vec<usize>>,
    /// All unknowns of [`Model::scales_of_fields`], of `moving`, and the coefficients.
    resting: Vec<usize>,
    /// The values that C, and that W depends on.
    depends: [Vec<usize>; 2],
}

/// A number that is integrated out.
#[derive(Debug)]
struct Coefficient {
    /// Its unknown: where w is 0, and by how much it moves with w.
    unknown: usize,
    zero: f64,
    unit: f64,
    /// Prior precision of w.
    precision: f64,
    from: From,
}

/// What a coefficient shifts.
#[derive(Clone, Copy, Debug)]
enum From {
    /// Mode k of a term of a field.
    Mode { field: usize, term: usize, k: usize },
    /// A value that is location + scale w.
    Value { at: usize, location: f64, scale: f64 },
}

/// Coefficients that no row connects with others.
#[derive(Debug)]
struct Part {
    /// Which coefficients.
    of: Vec<usize>,
    rows: Vec<PartRow>,
    /// D, row-major `(row, coefficient)`.
    design: Vec<f64>,
}

/// A row, and one of its numbers, which shifts it.
#[derive(Clone, Copy, Debug)]
struct PartRow {
    /// `[observe, row]`
    id: [usize; 2],
    number: usize,
    /// Of the row's location in the number.
    slope: f64,
}

impl PartRow {
    /// dln L/dlocation and W, after a forward pass.
    fn normal(self, model: &Model, t: &Tape) -> [f64; 2] {
        let Self { id: [observe, row], number, slope } = self;
        let [first, second] = model.observes[observe].op.derivatives(t, row, number);
        [first / slope, -second / (slope * slope)]
    }
}

impl<'m> WithoutShifts<'m> {
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
                    from: From::Mode { field, term, k },
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
                from: From::Value { at: entry.v + i, location, scale },
            }));
        }
        for name in &sds {
            let entry =
                model.declared().zip(&model.prior_entries).find(|(own, _)| own.name == *name)?.1;
            depends[1].extend(entry.v..entry.v + entry.len);
            moving.extend(entry.u.clone().map(|u| vec![u]));
        }
        let parts = parts(model, &tape, &coefficients)?;
        let mut resting = own;
        resting.extend(moving.iter().flatten());
        resting.extend(coefficients.iter().map(|c| c.unknown));
        resting.sort_unstable();
        resting.dedup();
        (!coefficients.is_empty()).then_some(Self {
            model,
            fields,
            coefficients,
            parts,
            moving,
            resting,
            depends,
        })
    }
}

impl WithoutShifts<'_> {
    /// See [`Model::predictive`]. Of y ~ N(μ, 1/W) at the coefficients' mean, of which the row has variance v by them, the others
    /// leave a residual (y − μ)/(1 − W v) and a variance 1/W/(1 − W v).
    pub(super) fn predictive(
        &self,
        draws: &[Vec<f64>],
        rows: &[RowId],
        seed: u64,
    ) -> Vec<Option<Predictive>> {
        let found = |id: &RowId| {
            let is_it = |row: &PartRow| row.id == [id.observe, id.row];
            self.parts
                .iter()
                .enumerate()
                .find_map(|(p, part)| Some((p, part.rows.iter().position(is_it)?)))
        };
        let places: Vec<Option<(usize, usize)>> = rows.iter().map(found).collect();
        let known: Vec<(usize, usize)> = places.iter().flatten().copied().collect();
        let told: Vec<Vec<[f64; 2]>> = draws
            .par_iter()
            .map_init(|| Integrated::new(self), |on, draw| on.left_out(draw, &known))
            .collect();
        let mut nth = 0..;
        let of_row = |(i, (place, id)): (usize, (&Option<(usize, usize)>, &RowId))| {
            let nth = place.and(nth.next())?;
            let y = self.model.observes[id.observe].op.observed_row(id.row)[0];
            let mut rng = Stream::WithoutRow { row: i }.rng(seed);
            let mut predictive = Predictive::default();
            for row in &told {
                let [residual, variance] = *row.get(nth)?;
                let ln_norm = -0.5 * variance.ln() - LN_SQRT_2PI;
                predictive.ln_density.push(ln_norm - 0.5 * residual * residual / variance);
                let z: f64 = rng.sample(StandardNormal);
                predictive.replicates.push(y - residual + variance.sqrt() * z);
            }
            Some(predictive)
        };
        places.iter().zip(rows).enumerate().map(of_row).collect()
    }
}

/// Coefficients in parts that no row connects; `None` where the rows are not all normal.
fn parts(model: &Model, tape: &Tape, coefficients: &[Coefficient]) -> Option<Vec<Part>> {
    // the coefficients that each value of a row shows, with what each is multiplied by beside C
    let shown = |v: usize| -> Vec<(usize, f64)> {
        let of = |(j, c): (usize, &Coefficient)| match c.from {
            From::Value { at, .. } => (at == v).then_some((j, 1.0)),
            From::Mode { field, k, .. } => {
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
            let number = seen.iter().position(|seen| !seen.is_empty())?;
            let slope = slopes[number];
            let own = PartRow { id: [observe, row], number: of.op.place.slots()[number], slope };
            rows.push((own, design));
        }
    }
    let mut left: Vec<usize> = (0..rows.len()).collect();
    let mut parts = vec![];
    while let Some(first) = left.pop() {
        let (mut own, mut reached) = (vec![first], 0);
        while let Some(row) = own.get(reached).copied() {
            let shares = |other: &mut usize| {
                rows[*other].1.iter().any(|(j, _)| rows[row].1.iter().any(|(k, _)| j == k))
            };
            own.extend(left.extract_if(.., shares));
            reached += 1;
        }
        own.sort_unstable();
        let mut of: Vec<usize> =
            own.iter().flat_map(|row| &rows[*row].1).map(|(j, _)| *j).collect();
        of.sort_unstable();
        of.dedup();
        let mut design = vec![0.0; own.len() * of.len()];
        for (row, out) in own.iter().zip(design.chunks_exact_mut(of.len())) {
            for (j, x) in &rows[*row].1 {
                if let Ok(at) = of.binary_search(j) {
                    out[at] += x;
                }
            }
        }
        let rows = own.iter().map(|row| rows[*row].0).collect();
        parts.push(Part { of, rows, design });
    }
    Some(parts)
}

impl Model {
    /// Of a model with an operator over the surface: its density with the fields and parameters integrated out that shift normal
    /// measurements; `None` if there are none. This is what [`Sampler::Nuts`](super::Sampler::Nuts) then samples: a position is one of the model's
    /// unknowns, and the density does not depend on those that are integrated out ([`Evaluator::ln_whole`] does).
    pub fn without_shifts(&self) -> Option<Box<dyn LogDensity + '_>> {
        WithoutShifts::of(self).map(|density| Box::new(density) as Box<dyn LogDensity>)
    }

    /// The unknowns of declared parameters among whose values these are.
    fn unknowns_of(&self, values: &[usize]) -> Vec<usize> {
        let is_in = |v: std::ops::Range<usize>| values.iter().any(|value| v.contains(value));
        let entries = self.prior_entries.iter().filter(|e| is_in(e.v..e.v + e.len));
        entries.flat_map(|entry| entry.u.clone()).collect()
    }
}

/// P of every part at some C and W.
struct Known {
    /// The values on which C and W depend.
    at: [Vec<f64>; 2],
    c: Vec<f64>,
    grams: Vec<Gram>,
    factors: Vec<Factor>,
}

/// DᵀWD of a part: W is that of its first row times these factors.
struct Gram {
    first: f64,
    factors: Vec<f64>,
    product: Mat<f64>,
}

struct Integrated<'m> {
    of: &'m WithoutShifts<'m>,
    tape: Tape,
    known: Option<Known>,
    /// b, then P⁻¹b.
    mean: Vec<f64>,
    /// Where the last integral was, but for w.
    position: Vec<f64>,
}

impl<'m> Integrated<'m> {
    fn new(of: &'m WithoutShifts<'m>) -> Self {
        let mean = vec![0.0; of.coefficients.len()];
        Self { of, tape: of.model.tape(), known: None, mean, position: vec![] }
    }

    /// Residual and variance that the other rows leave each of these, (part, row), at a position; nothing where there is no integral.
    fn left_out(&mut self, position: &[f64], rows: &[(usize, usize)]) -> Vec<[f64; 2]> {
        if !self.value_at(position).is_finite() {
            return vec![];
        }
        self.set_mean(position);
        let Some(known) = &self.known else { return vec![] };
        let one = |(p, row): &(usize, usize)| {
            let (part, factor) = (&self.of.parts[*p], &known.factors[*p]);
            let [slope, w] = part.rows[*row].normal(self.of.model, &self.tape);
            let design = &part.design[row * part.of.len()..][..part.of.len()];
            let mut x: Vec<f64> =
                part.of.iter().zip(design).map(|(j, d)| known.c[*j] * d).collect();
            factor.solve(&mut x);
            let left = 1.0 - w * dot::<4>(&x, &x);
            [slope / w / left, 1.0 / w / left]
        };
        rows.iter().map(one).collect()
    }

    /// The unknowns at w = 0.
    fn at_zero(&self, position: &[f64]) -> Vec<f64> {
        let mut u = position.to_vec();
        self.of.coefficients.iter().for_each(|c| u[c.unknown] = c.zero);
        u
    }

    /// ln of the integral at a position.
    fn value_at(&mut self, position: &[f64]) -> f64 {
        let u = self.at_zero(position);
        if u == self.position {
            return self.value_again(position);
        }
        self.of.model.forward(&mut self.tape, &u);
        self.position = u;
        self.integral()
    }

    /// The same where nothing but what C and W depend on has changed since the last one.
    fn value_again(&mut self, position: &[f64]) -> f64 {
        self.position = self.at_zero(position);
        self.tape.u.copy_from_slice(&self.position);
        let model = self.of.model;
        model.priors.iter().for_each(|prior| prior.forward(&mut self.tape));
        self.of.fields.iter().for_each(|f| model.fields[*f].op.forward(&mut self.tape));
        self.integral()
    }

    /// ln of the integral, with everything on the tape at w = 0; −∞ where there is none.
    fn integral(&mut self) -> f64 {
        let of = self.of;
        let at_zero = of.model.ln_density_of_values(&mut self.tape);
        if !at_zero.is_finite() || !self.know() {
            return f64::NEG_INFINITY;
        }
        let Some(known) = &self.known else { return f64::NEG_INFINITY };
        let t = &self.tape;
        for ((b, coefficient), c) in self.mean.iter_mut().zip(&of.coefficients).zip(&known.c) {
            *b = c * match coefficient.from {
                From::Value { at, .. } => t.g[at],
                From::Mode { field, k, .. } => {
                    let op = &of.model.fields[field].op;
                    let n = op.n_probes();
                    dot::<4>(&op.modes[k * padded(n)..][..n], &t.g[op.theta..][..n])
                }
            };
        }
        let mut sum = at_zero;
        for (part, factor) in of.parts.iter().zip(&known.factors) {
            let mut x: Vec<f64> = part.of.iter().map(|j| self.mean[*j]).collect();
            factor.solve(&mut x);
            sum += 0.5 * dot::<4>(&x, &x) - factor.ln_det();
            factor.solve_transposed(&mut x);
            part.of.iter().zip(x).for_each(|(j, x)| self.mean[*j] = x);
        }
        sum
    }

    /// Makes P what it is now; `false` where it has no factor.
    fn know(&mut self) -> bool {
        let (of, t) = (self.of, &self.tape);
        let at = of
            .depends
            .each_ref()
            .map(|values| values.iter().map(|v| t.v[*v]).collect::<Vec<f64>>());
        if self.known.as_ref().is_some_and(|known| known.at == at) {
            return true;
        }
        let is_w_known = self.known.as_ref().is_some_and(|known| known.at[1] == at[1]);
        let mut grams = self.known.take().map_or_else(Vec::new, |known| known.grams);
        if !is_w_known {
            let mut old = grams.into_iter();
            grams = of.parts.iter().map(|part| of.gram(part, t, old.next())).collect();
        }
        let c = of.multipliers(t);
        let factor = |(part, gram): (&Part, &Gram)| {
            let n = part.of.len();
            let entry = |i: usize, j: usize| {
                let prior = if i == j { of.coefficients[part.of[i]].precision } else { 0.0 };
                prior + c[part.of[i]] * c[part.of[j]] * gram.first * gram.product[(i, j)]
            };
            Factor::of(Mat::from_fn(n, n, entry).as_ref())
        };
        let factors = of.parts.iter().zip(&grams).map(factor).collect::<Option<Vec<_>>>();
        self.known = factors.map(|factors| Known { at, c, grams, factors });
        self.known.is_some()
    }

    /// Writes the unknowns of these coefficients.
    fn put(&self, w: &[f64], position: &mut [f64]) {
        for (c, w) in self.of.coefficients.iter().zip(w) {
            position[c.unknown] = c.zero + c.unit * w;
        }
    }

    /// Brings the tape to where the coefficients have their mean, after [`Integrated::integral`] at this position.
    fn set_mean(&mut self, position: &[f64]) {
        let mut u = position.to_vec();
        self.put(&self.mean, &mut u);
        let (of, t) = (self.of, &mut self.tape);
        t.u.copy_from_slice(&u);
        for (coefficient, w) in of.coefficients.iter().zip(&self.mean) {
            if let From::Value { at, location, scale } = coefficient.from {
                t.v[at] = location + scale * w;
            }
        }
        of.fields.iter().for_each(|field| of.model.fields[*field].op.forward(t));
    }

    /// A position with coefficients drawn given all else, after [`Integrated::integral`] there.
    fn draw(&self, position: &mut [f64], rng: &mut dyn Rng) {
        let Some(known) = &self.known else { return };
        let mut w = self.mean.clone();
        for (part, factor) in self.of.parts.iter().zip(&known.factors) {
            let mut z: Vec<f64> = part.of.iter().map(|_| rng.sample(StandardNormal)).collect();
            factor.solve_transposed(&mut z);
            part.of.iter().zip(z).for_each(|(j, z)| w[*j] += z);
        }
        self.put(&w, position);
    }
}

impl WithoutShifts<'_> {
    /// C
    fn multipliers(&self, t: &Tape) -> Vec<f64> {
        let fields = &self.model.fields;
        let mut of_term = (usize::MAX, usize::MAX, vec![]);
        let mut one = |c: &Coefficient| match c.from {
            From::Value { scale, .. } => scale,
            From::Mode { field, term, k } => {
                if (of_term.0, of_term.1) != (field, term) {
                    let op = &fields[field].op.terms[term];
                    let mut values = vec![0.0; op.k];
                    op.spectrum.values(&t.v, &fields[field].op.frequency[..op.k], &mut values);
                    let amplitude = op.amplitude.value(&t.v);
                    values.iter_mut().for_each(|x| *x *= amplitude);
                    of_term = (field, term, values);
                }
                of_term.2[k]
            }
        };
        self.coefficients.iter().map(&mut one).collect()
    }

    /// DᵀWD, by the product of `old` if W has changed by a factor alone.
    fn gram(&self, part: &Part, t: &Tape, old: Option<Gram>) -> Gram {
        let n = part.of.len();
        let information = |row: &PartRow| row.normal(self.model, t)[1];
        let first = part.rows.first().map_or(0.0, information);
        let factors: Vec<f64> = part.rows.iter().map(|row| information(row) / first).collect();
        if let Some(old) = old.filter(|old| old.factors == factors) {
            return Gram { first, ..old };
        }
        let weighted =
            Mat::from_fn(part.rows.len(), n, |i, j| factors[i].sqrt() * part.design[i * n + j]);
        Gram { first, factors, product: weighted.transpose() * &weighted }
    }
}

impl Evaluator for Integrated<'_> {
    fn ln_density(&mut self, position: &[f64], gradient: &mut [f64]) -> f64 {
        let value = self.value_at(position);
        if value.is_finite() {
            self.set_mean(position);
            self.of.model.backward(&mut self.tape);
            gradient.copy_from_slice(&self.tape.gu);
            self.of.resting.iter().for_each(|i| gradient[*i] = 0.0);
        } else {
            gradient.fill(0.0);
        }
        value
    }

    fn value(&mut self, position: &[f64]) -> f64 {
        self.value_at(position)
    }

    fn ln_whole(&mut self, position: &[f64], mut ln_density: f64) -> f64 {
        if self.position != self.at_zero(position) {
            ln_density = self.value_at(position);
        }
        let of = self.of;
        let from_mean = |j: &usize| {
            let c = &of.coefficients[*j];
            (position[c.unknown] - c.zero) / c.unit - self.mean[*j]
        };
        for (part, factor) in of.parts.iter().zip(self.known.iter().flat_map(|k| &k.factors)) {
            let d: Vec<f64> = part.of.iter().map(from_mean).collect();
            let z = factor.whitened(&d);
            ln_density += factor.ln_det() - 0.5 * dot::<4>(&z, &z);
        }
        ln_density
    }

    /// C and W move under the integral, what is integrated out is drawn, and then scales and means move as fields rest.
    fn interweave(&mut self, position: &mut [f64], rng: &mut dyn Rng) -> Option<f64> {
        let mut here = self.value_at(position);
        let mut proposal = position.to_vec();
        for step in std::iter::repeat_n(STEPS, ROUNDS).flatten() {
            for moving in &self.of.moving {
                proposal.copy_from_slice(position);
                for u in moving {
                    proposal[*u] += step * rng.sample::<f64, _>(StandardNormal);
                }
                let there = self.value_again(&proposal);
                // NaN is not accepted
                if rng.random::<f64>().ln() < there - here {
                    position.copy_from_slice(&proposal);
                    here = there;
                }
            }
        }
        self.value_again(position);
        self.draw(position, rng);
        self.of.model.rescale_fields(&mut self.tape, position, rng);
        self.of.model.recentre_fields(&mut self.tape, position, rng);
        // other fields are as they were, but nothing on the tape is at their new scales
        let value = self.value_again(position);
        self.position.clear();
        Some(value)
    }

    fn multipliers(&mut self, position: &[f64]) -> Vec<f64> {
        let mut all = self.of.model.multipliers(&mut self.tape, position);
        self.of.coefficients.iter().for_each(|c| all[c.unknown] = 0.0);
        all
    }

    fn ln_prior(&mut self, position: &[f64]) -> f64 {
        self.of.model.ln_prior_alone(&mut self.tape, position)
    }

    /// That of the integral: H − H(·, w) H(w, w)⁻¹ H(w, ·), where w has its mean. Of what rests it is −1.
    fn hessian(&mut self, position: &[f64], take: &mut dyn FnMut(usize, &[f64])) {
        let (of, dim) = (self.of, position.len());
        self.value_at(position);
        let mut at = position.to_vec();
        self.put(&self.mean, &mut at);
        let mut whole = Hessian::at(of.model, &at, true);
        let mut columns: Vec<Option<(Vec<f64>, Vec<f64>)>> = vec![None; dim];
        for i in (0..dim).filter(|i| of.resting.binary_search(i).is_err()) {
            let mut column = whole.column(i).to_vec();
            let mut with_w = vec![];
            for (part, factor) in
                of.parts.iter().zip(self.known.iter().flat_map(|known| &known.factors))
            {
                let one =
                    |j: &usize| column[of.coefficients[*j].unknown] * of.coefficients[*j].unit;
                let mut own: Vec<f64> = part.of.iter().map(one).collect();
                factor.solve(&mut own);
                with_w.extend(own);
            }
            of.resting.iter().for_each(|i| column[*i] = 0.0);
            columns[i] = Some((column, with_w));
        }
        let mut out = vec![0.0; dim];
        for i in 0..dim {
            out.fill(0.0);
            match &columns[i] {
                None => out[i] = -1.0,
                Some((column, with_w)) => {
                    for ((out, h), other) in out.iter_mut().zip(column).zip(&columns) {
                        *out = h + other.as_ref().map_or(0.0, |(_, other)| dot::<4>(with_w, other));
                    }
                }
            }
            take(i, &out);
        }
    }
}

impl LogDensity for WithoutShifts<'_> {
    fn dim(&self) -> usize {
        self.model.dim()
    }
    fn evaluator(&self) -> Box<dyn Evaluator + '_> {
        Box::new(Integrated::new(self))
    }
    fn interwoven(&self) -> Option<Vec<usize>> {
        Some(self.resting.clone())
    }
}
