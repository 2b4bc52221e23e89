//! How rows of a place are told from all others at a draw of the posterior: the values at the place vary, and those at other
//! places follow as the stand-in has it.
//!
//! In whitened coefficients z the stand-in's posterior is standard normal, and θ = o + B z. The rows of B at a place span a
//! plane, in which z has the coordinates t = Qᵀ z. What is left of z does not vary with t under the stand-in, whether the
//! place was measured or not.

use nalgebra::{Cholesky, DMatrix, DVector};
use rand::{Rng, RngExt as _};

use super::latent::{Latent, Layout};
use super::mixture::Student;
use super::particles::Memory;
use super::stand_in::{GroupStandIn, StandIn};
use super::told::{RowWithout, Values};
use crate::num::vector::{axpy, dot};

/// Degrees of freedom of what t is drawn from.
const NU: usize = 4;
/// How much wider it is than the stand-in has it.
const WIDER: f64 = 1.25;
/// Least precision of t without the place, in units of that with it.
const LEAST: f64 = 0.02;
/// Points double with each further dimension of the plane, so often at most.
const MOST_DOUBLINGS: usize = 5;
/// A row of the plane that has less than this share of its square beside those before is none of its own.
const ROUNDING: f64 = 1e-10;

/// Writes the rows of these places, `[group, place]`, at a draw of the posterior with these coefficients, of which the designs are
/// those of `memory`; none where they cannot be told. The mean of 1/density over draws is exact for any number of points.
pub(super) fn tell(
    memory: &mut Memory<'_>,
    (stand_in, coefficients): (&StandIn, &[f64]),
    (places, n_points): (&[[usize; 2]], usize),
    rng: &mut impl Rng,
    told: &mut [Vec<RowWithout>],
) {
    let Memory { layout, latent, whitening, .. } = memory;
    if whitening.prepare_basis(stand_in).is_none() {
        return;
    }
    let (mut z, mut theta) = (vec![0.0; coefficients.len()], vec![0.0; layout.n_latent()]);
    whitening.whitened(coefficients, &mut z);
    whitening.latent_at(&z, &mut theta);
    for (at, told) in places.iter().zip(told) {
        let (range, _) = whitening.of_group(at[0]);
        let basis = whitening.basis(at[0]);
        if let Some(plane) = Plane::new(layout, *at, stand_in, basis, &z[range]) {
            let group = &stand_in.groups[at[0]];
            let theta = &theta[layout.n_latent_before(at[0])..][..basis.0.len()];
            let values = plane.points(&mut **latent, (group, theta), n_points, rng);
            let mut lns = latent.ln_of_rows(*at, &values.theta);
            for lns in &mut lns {
                none_for_nan(lns);
            }
            *told = values.rows(&lns, rng);
            for row in told {
                row.ln_weight = -row.ln_density;
            }
        }
    }
}

/// The plane of a place.
struct Plane {
    at: [usize; 2],
    n_seen: usize,
    /// t at the draw.
    t: Vec<f64>,
    /// B Q, column after column: what a step of t does to all values of the group.
    steps: Vec<Vec<f64>>,
    /// Where t is drawn: without the place, and with it.
    from: [Student; 2],
}

impl Plane {
    fn new(
        layout: &Layout,
        at: [usize; 2],
        stand_in: &StandIn,
        (origin, columns): (&[f64], &[f64]),
        z: &[f64],
    ) -> Option<Self> {
        let [group, place] = at;
        let own = &layout.groups[group];
        let (n, n_latent) = (z.len(), origin.len());
        let mut q: Vec<Vec<f64>> = vec![];
        for f in 0..own.blocks.len() {
            let mut row: Vec<f64> =
                (0..n).map(|k| columns[k * n_latent + f * own.n_seen + place]).collect();
            let square = dot::<4>(&row, &row);
            for other in &q {
                let along = dot::<4>(other, &row);
                axpy(-along, other, &mut row);
            }
            let left = dot::<4>(&row, &row);
            if left > ROUNDING * square {
                for x in &mut row {
                    *x /= left.sqrt();
                }
                q.push(row);
            }
        }
        if q.is_empty() {
            return None;
        }
        let d = q.len();
        let step = |q: &Vec<f64>| {
            let mut step = vec![0.0; n_latent];
            q.iter().zip(columns.chunks_exact(n_latent)).for_each(|(q, b)| axpy(*q, b, &mut step));
            step
        };
        let steps: Vec<Vec<f64>> = q.iter().map(step).collect();
        let r = DMatrix::from_fn(own.blocks.len(), d, |f, j| steps[j][f * own.n_seen + place]);
        let (w, y) = stand_in.groups[group].at(place);
        let off = DVector::from_fn(own.blocks.len(), |f, _| y[f] - origin[f * own.n_seen + place]);
        let mut eigen = (DMatrix::identity(d, d) - r.transpose() * &w * &r).symmetric_eigen();
        eigen.eigenvalues.apply(|x| *x = x.max(LEAST));
        let without = Cholesky::new(eigen.recompose())?.inverse();
        let mean = -&without * (r.transpose() * (w * off));
        let wider = WIDER * WIDER;
        let from = [
            Student::new(1.0, &mean, without * wider, NU)?,
            Student::new(1.0, &DVector::zeros(d), DMatrix::identity(d, d) * wider, NU)?,
        ];
        let t = q.iter().map(|q| dot::<4>(q, z)).collect();
        Some(Self { at, n_seen: own.n_seen, t, steps, from })
    }

    /// Points of t, of which one is that of the draw, where the group's latent values are `theta`. `n_points` are those of one
    /// dimension.
    fn points(
        &self,
        latent: &mut dyn Latent,
        (stand_in, theta): (&GroupStandIn, &[f64]),
        n_points: usize,
        rng: &mut impl Rng,
    ) -> Values {
        let n_points = n_points << (self.t.len() - 1).min(MOST_DOUBLINGS);
        let mut scratch = vec![];
        let mut densities = |t: &[f64]| {
            self.from.each_ref().map(|from| from.peak() * from.relative_density(t, &mut scratch))
        };
        // which half of the points the draw's own t belongs to follows from the densities of drawing it
        let [without, with] = densities(&self.t);
        let own = usize::from(rng.random::<f64>() * (without + with) < with);
        let (mut moved, mut ln_weights) = (vec![], vec![]);
        let mut t = self.t.clone();
        for point in 0..n_points {
            if point == own {
                t.copy_from_slice(&self.t);
            } else {
                self.from[point % 2].draw(rng, &mut t);
            }
            let mut all = theta.to_vec();
            for ((step, to), from) in self.steps.iter().zip(&t).zip(&self.t) {
                axpy(to - from, step, &mut all);
            }
            let square: f64 = t.iter().map(|t| t * t).sum();
            let density: f64 = densities(&t).iter().sum();
            ln_weights.push(stand_in.whole_quadratic(&all) - 0.5 * square - density.ln());
            moved.push(all);
        }
        let [group, own] = self.at;
        let mut lns = vec![0.0; n_points];
        for place in (0..self.n_seen).filter(|place| *place != own) {
            latent.ln_likelihoods([group, place], &self.at_place(&moved, place), &mut lns);
            none_for_nan(&mut lns);
            axpy(1.0, &lns, &mut ln_weights);
        }
        Values { theta: self.at_place(&moved, own), ln_weights }
    }

    /// The values of a place, `(point, block)`.
    fn at_place(&self, moved: &[Vec<f64>], place: usize) -> Vec<f64> {
        moved.iter().flat_map(|all| all.iter().skip(place).step_by(self.n_seen)).copied().collect()
    }
}

/// What is not a number is no likelihood: 0.
fn none_for_nan(lns: &mut [f64]) {
    lns.iter_mut().filter(|ln| ln.is_nan()).for_each(|ln| *ln = f64::NEG_INFINITY);
}
