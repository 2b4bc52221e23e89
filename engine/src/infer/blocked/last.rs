//! The values of the last place of an order, drawn given those at all others.

use rand::Rng;

use super::mixture::Student;
use super::order::Order;
use crate::num::LN_SQRT_2PI;
use crate::num::vector::dot;

/// Points for each particle.
const POINTS: usize = 4;
/// Degrees of freedom of what they are drawn from.
pub(super) const NU: usize = 4;

/// The last place of an order, whose values are θ = given + L ε, and one point there.
pub(super) struct Last<'a> {
    /// The rows of L.
    rows: Vec<&'a [f64]>,
    /// Blocks whose values the other places do not determine.
    open: Vec<usize>,
    /// The density of drawing what is likeliest, by what the other places say, and from where the posterior has it.
    peaks: [f64; 2],
    from_others: Student,
    from_posterior: Option<&'a Student>,
    given: Vec<f64>,
    theta: Vec<f64>,
    /// ε of every block, and of those that are open.
    eps: [Vec<f64>; 2],
    scratch: Vec<f64>,
}

impl<'a> Last<'a> {
    /// Of this order; with where the posterior has the values, if they vary.
    pub(super) fn new(order: &'a Order<'_>, posterior: Option<&'a Student>) -> Self {
        let first = order.n() - order.n_blocks();
        let rows: Vec<&[f64]> = (first..order.n()).map(|i| &order.row(i)[first..]).collect();
        let open: Vec<usize> = (0..rows.len()).filter(|f| rows[*f][*f] > 0.0).collect();
        let n = rows.len();
        let scale: f64 = open.iter().map(|f| rows[*f][*f]).product();
        let from_others = Student::standard(open.len(), NU);
        let from_posterior = posterior.filter(|_| open.len() == n);
        Self {
            peaks: [
                from_others.peak(),
                from_posterior.map_or(0.0, |student| scale * student.peak()),
            ],
            from_others,
            from_posterior,
            given: vec![0.0; n],
            theta: vec![0.0; n],
            eps: [vec![0.0; n], vec![0.0; open.len()]],
            scratch: vec![],
            rows,
            open,
        }
    }

    /// Points for each particle.
    pub(super) fn n_points(&self) -> usize {
        if self.open.is_empty() { 1 } else { POINTS }
    }

    /// What the other places say of each block in a particle.
    pub(super) fn set_given<'b>(&mut self, given: impl Iterator<Item = &'b f64>) {
        self.given.iter_mut().zip(given).for_each(|(to, given)| *to = *given);
    }

    /// The point, `(block)`.
    pub(super) fn theta(&self) -> &[f64] {
        &self.theta
    }

    fn set_theta(&mut self) {
        for ((theta, given), row) in self.theta.iter_mut().zip(&self.given).zip(&self.rows) {
            *theta = given + dot::<1>(row, &self.eps[0][..row.len()]);
        }
    }

    /// Takes up a random value: from where the posterior has it, or from what the other places say.
    pub(super) fn draw(&mut self, from_posterior: bool, rng: &mut impl Rng) {
        let [eps, open] = &mut self.eps;
        if let Some(posterior) = self.from_posterior.filter(|_| from_posterior) {
            posterior.draw(rng, &mut self.theta);
            for (f, row) in self.rows.iter().enumerate() {
                eps[f] = (self.theta[f] - self.given[f] - dot::<1>(&row[..f], &eps[..f])) / row[f];
            }
            open.copy_from_slice(eps);
        } else {
            self.from_others.draw(rng, open);
            self.open.iter().zip(open).for_each(|(f, x)| eps[*f] = *x);
            self.set_theta();
        }
    }

    /// The densities of drawing ε from what the other places say, and from where the posterior has it.
    pub(super) fn densities(&mut self) -> [f64; 2] {
        let others = self.from_others.relative_density(&self.eps[1], &mut self.scratch);
        let posterior =
            |student: &Student| student.relative_density(&self.theta, &mut self.scratch);
        let posterior = self.from_posterior.map_or(0.0, posterior);
        [self.peaks[0] * others, self.peaks[1] * posterior]
    }

    /// The density of drawing ε.
    pub(super) fn density(&mut self) -> f64 {
        let [others, posterior] = self.densities();
        let share = if self.from_posterior.is_some() { 0.5 } else { 1.0 };
        share * (others + posterior)
    }

    /// ln of the standard normal density of ε.
    pub(super) fn ln_normal(&self) -> f64 {
        let square: f64 = self.eps[1].iter().map(|x| x * x).sum();
        -0.5 * square - LN_SQRT_2PI * self.open.len() as f64
    }
}
