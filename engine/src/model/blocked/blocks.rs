//! Which unknowns are in blocks, and what the design of a block is computed from.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::free::FreeBlock;
use super::places::PlaceBlock;
use crate::dist::Gaussian;
use crate::infer::{BlockLayout, Group, Layout, Shape};
use crate::model::gp::Field;
use crate::model::laid_out::Model;
use crate::model::tape::{Op, add_rows};

/// A model seen as a [`LatentGaussian`](crate::infer::LatentGaussian).
#[derive(Debug)]
pub(super) struct Blocks<'m> {
    pub(super) model: &'m Model,
    pub(super) layout: Layout,
    /// The fields, group after group, in the order of the layout.
    pub(super) fields: Vec<Block>,
    /// Deviations of places. They come after the fields; there is then one group only.
    pub(super) places: Vec<PlaceBlock>,
    /// Parameters and effects that are free latent values.
    pub(super) free: Vec<FreeBlock>,
    /// For each group the rows of each of its places, `(observe, row)`. Rows that see none are with the first.
    pub(super) rows: Vec<Vec<Vec<[usize; 2]>>>,
}

/// What is precomputed of one field.
#[derive(Debug)]
pub(super) struct Block {
    /// Which of the model's fields it is.
    pub(super) field: usize,
    /// Its group, and its number within the group.
    pub(super) at: (usize, usize),
    /// Whether its design is triangular: a coefficient per site.
    pub(super) is_triangular: bool,
    /// Which of the model's priors is that of its mean; `None` if the mean is not in the block.
    pub(super) mean: Option<usize>,
    /// The sites' modes `(n_sites, k)`, without padding.
    pub(super) modes: Arc<Vec<f64>>,
    /// Products φᵢ φⱼ of every pair of sites j ≤ i `(k, pairs)`. Empty unless there are fewer sites
    /// than modes.
    products: Vec<f64>,
}

impl<'m> Blocks<'m> {
    /// Each group has a coefficient per site or one per mode, whichever are fewer.
    pub(super) fn new(model: &'m Model) -> Self {
        Self::shaped(model, &|ops| {
            let n_latent: usize = ops.iter().map(|op| op.n_probes()).sum();
            let n_modes: usize = ops.iter().map(|op| op.k).sum();
            n_latent < n_modes
        })
    }

    /// A coefficient per mode; these priors are those of free latent values.
    pub(super) fn integrated(model: &'m Model, free: &[usize]) -> Self {
        let free = free.iter().map(|prior| FreeBlock::new(model, *prior)).collect();
        Self::assembled(model, &|_| false, free, &|_, _| vec![])
    }

    /// Each group has a coefficient per site (its designs are triangular) or one per mode.
    /// `is_triangular` decides from the group's fields; either is exact.
    pub(super) fn shaped(model: &'m Model, is_triangular: &dyn Fn(&[&Field]) -> bool) -> Self {
        Self::assembled(model, is_triangular, vec![], &PlaceBlock::all)
    }

    fn assembled(
        model: &'m Model,
        is_triangular: &dyn Fn(&[&Field]) -> bool,
        free: Vec<FreeBlock>,
        places: &dyn Fn(&Model, &[Block]) -> Vec<PlaceBlock>,
    ) -> Self {
        let mut members: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for (field, entry) in model.fields.iter().enumerate() {
            members.entry(entry.group).or_default().push(field);
        }
        let (mut fields, mut groups) = (vec![], vec![]);
        for (group, members) in members.values().enumerate() {
            let ops: Vec<&Field> = members.iter().map(|f| &model.fields[*f].op).collect();
            let is_triangular = is_triangular(&ops);
            let first = fields.len();
            fields.extend(
                members.iter().enumerate().map(|(number, field)| {
                    Block::new(model, *field, (group, number), is_triangular)
                }),
            );
            let blocks = fields[first..].iter().map(|block| block.layout(model)).collect();
            groups.push(Group { n_seen: ops[0].n_probes(), blocks });
        }
        let places = places(model, &fields);
        if let Some(group) = groups.first_mut() {
            group.blocks.extend(places.iter().map(PlaceBlock::layout));
        }
        let is_outer = |prior: usize| is_outer(prior, &fields, &places, &free);
        let entries = model.prior_entries.iter().enumerate().filter(|(prior, _)| is_outer(*prior));
        let outer: Vec<usize> = entries.flat_map(|(_, entry)| entry.u.clone()).collect();
        let is_hyper = hyperparameters(model, &fields, &places);
        let hyper = (0..outer.len()).filter(|i| is_hyper.contains(&outer[*i])).collect();
        let free_precision =
            free.iter().flat_map(|block| vec![block.precision; block.u.len()]).collect();
        let layout = Layout { groups, free_precision, outer, hyper };
        let rows = rows_of_places(model, &layout, &fields, &places);
        Self { model, layout, fields, places, free, rows }
    }

    /// The priors of outer unknowns.
    pub(super) fn priors(&self) -> impl DoubleEndedIterator<Item = &dyn Op> {
        let is_outer = |prior: &usize| is_outer(*prior, &self.fields, &self.places, &self.free);
        (0..self.model.priors.len()).filter(is_outer).map(|prior| &*self.model.priors[prior])
    }
}

/// The prior, at these values, of a number that is in a block.
#[allow(clippy::expect_used, reason = "it is in the block because its prior is normal or flat")]
pub(super) fn gaussian(model: &Model, prior: usize, values: &[f64]) -> Gaussian {
    model.priors[prior].gaussian(values).expect("normal or flat")
}

impl Block {
    fn new(model: &Model, field: usize, at: (usize, usize), is_triangular: bool) -> Self {
        let op = &model.fields[field].op;
        let values = model.tape().v;
        let is_mean = |prior: &usize| {
            op.lone_mean == Some(model.prior_entries[*prior].v)
                && model.priors[*prior].gaussian(&values).is_some()
        };
        let mean = (0..model.priors.len()).find(is_mean);
        let rows = || op.probes.chunks_exact(op.stride).map(|row| &row[..op.k]);
        let mut products = vec![];
        for k in 0..op.k {
            for (i, left) in rows().enumerate().filter(|_| is_triangular) {
                products.extend(rows().take(i + 1).map(|right| left[k] * right[k]));
            }
        }
        let modes = Arc::new(rows().flatten().copied().collect());
        Self { field, at, is_triangular, mean, modes, products }
    }

    fn layout(&self, model: &Model) -> BlockLayout {
        let (op, values) = (&model.fields[self.field].op, model.tape().v);
        let precision = |prior| gaussian(model, prior, &values).precision;
        BlockLayout {
            n_coefficients: if self.is_triangular { op.n_probes() } else { op.k },
            mean_precision: self.mean.map(precision),
            shape: if self.is_triangular {
                Shape::Triangular
            } else {
                Shape::Scaled(Arc::clone(&self.modes))
            },
        }
    }

    /// The factor L of the covariance of the sites' values, given these variances of the modes. If
    /// the sites before one determine it to rounding, its column is zero.
    pub(super) fn lower(
        &self,
        variances: &[f64],
        covariance: &mut [f64],
        rows: &mut [f64],
        width: usize,
    ) {
        const ROUNDING: f64 = 1e-13;
        covariance.fill(0.0);
        add_rows(variances, &self.products, covariance);
        let mut at = 0;
        for i in 0..rows.len() / width {
            let (done, rest) = rows.split_at_mut(i * width);
            let row = &mut rest[..width];
            for j in 0..i {
                let other = &done[j * width..][..=j];
                let pivot = other[j];
                let sum: f64 = row.iter().zip(&other[..j]).map(|(a, b)| a * b).sum();
                row[j] = if pivot > 0.0 { (covariance[at + j] - sum) / pivot } else { 0.0 };
            }
            let variance = covariance[at + i];
            let left = variance - row[..i].iter().map(|x| x * x).sum::<f64>();
            row[i] = if left > ROUNDING * variance { left.sqrt() } else { 0.0 };
            at += i + 1;
        }
    }
}

/// See [`Blocks::rows`].
fn rows_of_places(
    model: &Model,
    layout: &Layout,
    fields: &[Block],
    places: &[PlaceBlock],
) -> Vec<Vec<Vec<[usize; 2]>>> {
    let mut rows: Vec<Vec<Vec<[usize; 2]>>> =
        layout.groups.iter().map(|group| vec![vec![]; group.n_seen]).collect();
    let place = |value: usize| {
        fields.iter().find_map(|block| {
            let op = &model.fields[block.field].op;
            let place = value.checked_sub(op.theta).filter(|place| *place < op.n_probes())?;
            Some((block.at.0, place))
        })
    };
    let mut left = vec![];
    for (observe, of) in model.observes.iter().enumerate() {
        for row in 0..of.rows.len() {
            match of.op.locals(row).into_iter().find_map(|(value, _)| place(value)) {
                Some((group, place)) => rows[group][place].push([observe, row]),
                None => left.push([observe, row]),
            }
        }
    }
    let places = places_of_deviations(model, places, layout.groups[0].n_seen, &left);
    for (row, place) in left.into_iter().zip(places) {
        rows[0][place].push(row);
    }
    rows
}

/// For each of these rows the place of which it sees the deviation; the first if it sees none.
fn places_of_deviations(
    model: &Model,
    places: &[PlaceBlock],
    n_places: usize,
    rows: &[[usize; 2]],
) -> Vec<usize> {
    let mut own = vec![0; rows.len()];
    if places.is_empty() || rows.is_empty() {
        return own;
    }
    let mut tape = model.tape();
    let mut numbers = |place: usize, deviation: f64| -> Vec<Vec<f64>> {
        for block in places {
            block.set_value(place, deviation, &mut tape);
        }
        model.set_offsets(&mut tape);
        let of_row = |[observe, row]: &[usize; 2]| {
            model.observes[*observe].op.place.numbers_at(&tape.v, *row)
        };
        rows.iter().map(of_row).collect()
    };
    for place in 0..n_places {
        let (with, without) = (numbers(place, 1.0), numbers(place, 0.0));
        for (own, (with, without)) in own.iter_mut().zip(with.into_iter().zip(without)) {
            if with != without {
                *own = place;
            }
        }
    }
    own
}

/// Whether a prior is one of outer unknowns: not of a mean in a block, of deviations of places, or of free values.
fn is_outer(prior: usize, fields: &[Block], places: &[PlaceBlock], free: &[FreeBlock]) -> bool {
    fields.iter().all(|block| block.mean != Some(prior))
        && places.iter().all(|block| block.prior != prior)
        && free.iter().all(|block| block.prior != prior)
}

/// The unknowns on which a field's mean, amplitudes and kernels and the sds of places depend,
/// directly or through their priors.
fn hyperparameters(model: &Model, fields: &[Block], places: &[PlaceBlock]) -> BTreeSet<usize> {
    let mut values: BTreeSet<usize> = BTreeSet::new();
    for block in places {
        values.extend(&model.prior_entries[block.prior].mentions);
    }
    for block in fields {
        let op = &model.fields[block.field].op;
        for term in &op.terms {
            values.extend(term.amplitude.mentions());
            values.extend(term.spectrum.mentions());
        }
        values.extend(match block.mean {
            Some(prior) => model.prior_entries[prior].mentions.clone(),
            None => op.mean.mentions(),
        });
    }
    let mut unknowns = BTreeSet::new();
    // a prior mentions only earlier parameters
    for entry in model.prior_entries.iter().rev() {
        // one that is mentioned takes its vector along: its numbers may depend on each other
        if values.range(entry.v..entry.v + entry.len).next().is_some() {
            values.extend(&entry.mentions);
            unknowns.extend(entry.u.clone());
        }
    }
    unknowns
}
