//! Moves of what multiplies coordinates, the scales of fields, in which the coordinates move as well.
//!
//! What the Hessians at some places say (see [`Curvature`]) is a normal likelihood of the coordinates. With it the
//! coordinates η of a field are normal, N(μ(s), P(s)⁻¹), given its scales s and all other unknowns, and the scales have a
//! density π* of their own, which costs no evaluation of the model:
//!
//! ```text
//! ln π*(s) = ln p(s) + ½ μᵀ P μ − ln |L|        P = L Lᵀ
//! ```
//! A move makes some Metropolis steps from s under π*, and leaves z, the coordinates in units of that normal. Where they
//! end is accepted by the model's own density π:
//!
//! ```text
//! η = μ(s) + L(s)⁻ᵀ z        min(1, π(s′, η′) |L(s)| π*(s) / (π(s, η) |L(s′)| π*(s′)))
//! ```
//! So coordinates that measurements tell stay where they are, and those that they do not tell follow the scales. This is
//! exact, however poor the normal is, and costs one evaluation, without gradient, however far the steps lead.
//!
//! # Source
//! Christen and Fox 2005, "Markov chain Monte Carlo using an approximation", with several steps instead of one.

use super::cholesky::Factor;
use super::curvature::{Curvature, LEAST, factor, prior};
use super::density::Evaluator;
use super::hamiltonian::PhasePoint;
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, Par};
use rand::{Rng, RngExt as _};
use rand_distr::StandardNormal;

/// Standard deviations of the steps under π*.
const STEPS: [f64; 3] = [0.1, 0.3, 0.9];
/// How many there are in a move.
const N_STEPS: usize = 30;

/// Moves the scales of each field once, from the position of `point`, which it keeps up to date with its log density.
/// Returns how often it evaluated the density.
pub(super) fn move_scales(
    curvature: &Curvature,
    evaluator: &mut dyn Evaluator,
    point: &mut PhasePoint,
    rng: &mut impl Rng,
) -> u64 {
    moves(curvature, evaluator, point, rng, 1.0)
}

/// `volume` is 1, and something else in a test that must fail.
fn moves(
    curvature: &Curvature,
    evaluator: &mut dyn Evaluator,
    point: &mut PhasePoint,
    rng: &mut impl Rng,
    volume: f64,
) -> u64 {
    let mut n = 0;
    for of in fields(curvature.still(), evaluator, &point.position) {
        let multipliers = evaluator.multipliers(&point.position);
        let Some(field) = Field::new(curvature, &multipliers, of) else { continue };
        let Some(here) = field.normal(evaluator, &point.position) else { continue };
        let Some((there, mut position)) = field.walk(&here, evaluator, &point.position, rng) else {
            continue;
        };
        field.carry(&here, &there, &mut position);
        let ln_density = evaluator.value(&position);
        n += 1;
        let ln_ratio = ln_density - point.ln_density + volume * (here.factor.ln_det() - there.factor.ln_det())
            - (there.ln_density - here.ln_density);
        // NaN is not accepted
        if rng.random::<f64>().ln() < ln_ratio {
            point.position.copy_from_slice(&position);
            point.ln_density = ln_density;
        }
    }
    n
}

/// Scales, each with the coordinates that it multiplies. Scales of the same coordinates go together.
fn fields(
    scales: &[usize],
    evaluator: &mut dyn Evaluator,
    position: &[f64],
) -> Vec<(Vec<usize>, Vec<usize>)> {
    let here = evaluator.multipliers(position);
    let mut fields: Vec<(Vec<usize>, Vec<usize>)> = vec![];
    for scale in scales {
        let mut moved = position.to_vec();
        moved[*scale] += 0.1;
        let there = evaluator.multipliers(&moved);
        let is_multiplied = |i: &usize| here[*i].to_bits() != there[*i].to_bits();
        let coordinates: Vec<usize> = (0..here.len()).filter(is_multiplied).collect();
        let shared = fields.iter_mut().find(|(_, of)| of.iter().any(|i| coordinates.contains(i)));
        match shared {
            None => fields.push((vec![*scale], coordinates)),
            Some((scales, of)) => {
                scales.push(*scale);
                of.extend(coordinates);
                of.sort_unstable();
                of.dedup();
            }
        }
    }
    fields
}

/// A field: its scales and the coordinates that they multiply. All others are integrated out under the normal likelihood,
/// or rest if they are scales.
struct Field {
    scales: Vec<usize>,
    coordinates: Vec<usize>,
    /// G and slope of the normal likelihood of the coordinates times their multipliers.
    information: Mat<f64>,
    slope: Vec<f64>,
    others: Vec<usize>,
    /// By how much the others' means fall where a coordinate times its multiplier rises, `(others, coordinates)`.
    follows: Mat<f64>,
}

/// The coordinates of a field, given its scales, under the normal likelihood.
struct Normal {
    multipliers: Vec<f64>,
    mean: Vec<f64>,
    /// L
    factor: Factor,
    /// ln π* of the scales.
    ln_density: f64,
}

impl Field {
    /// `None` where the likelihood's information is no normal's.
    fn new(
        curvature: &Curvature,
        multipliers: &[f64],
        (scales, coordinates): (Vec<usize>, Vec<usize>),
    ) -> Option<Self> {
        let moves = |i: &usize| !coordinates.contains(i) && !curvature.still().contains(i);
        let others: Vec<usize> = (0..multipliers.len()).filter(moves).collect();
        let c: Vec<f64> = others.iter().map(|i| factor(multipliers[*i])).collect();
        let precision = |least: f64| {
            let of = |a: usize, b: usize| {
                let (i, j) = (others[a], others[b]);
                let own = f64::from(u8::from(a == b)) * (prior(multipliers[i]) + least);
                c[a] * c[b] * curvature.information(i, j) + own
            };
            Factor::of(Mat::from_fn(others.len(), others.len(), of).as_ref())
        };
        let precision = LEAST.into_iter().find_map(precision)?;
        let mut follows = Mat::from_fn(others.len(), coordinates.len(), |a, b| {
            c[a] * curvature.information(others[a], coordinates[b])
        });
        precision.solve_all(follows.as_mut());
        let mut told: Vec<f64> =
            others.iter().zip(&c).map(|(i, c)| c * curvature.slope(*i)).collect();
        precision.solve(&mut told);
        let mut information = Mat::from_fn(coordinates.len(), coordinates.len(), |a, b| {
            curvature.information(coordinates[a], coordinates[b])
        });
        matmul(&mut information, Accum::Add, follows.transpose(), &follows, -1.0, Par::Seq);
        let slope = coordinates.iter().enumerate().map(|(b, i)| {
            let by_others: f64 = follows.col(b).iter().zip(&told).map(|(w, x)| w * x).sum();
            curvature.slope(*i) - by_others
        });
        let slope = slope.collect();
        precision.solve_all_transposed(follows.as_mut());
        Some(Self { scales, coordinates, information, slope, others, follows })
    }

    /// `None` where the likelihood's information is no normal's.
    fn normal(&self, evaluator: &mut dyn Evaluator, position: &[f64]) -> Option<Normal> {
        let all = evaluator.multipliers(position);
        let c: Vec<f64> = self.coordinates.iter().map(|i| all[*i]).collect();
        let precision = Mat::from_fn(c.len(), c.len(), |a, b| {
            c[a] * c[b] * self.information[(a, b)] + f64::from(u8::from(a == b))
        });
        let factor = Factor::of(precision.as_ref())?;
        let mut mean: Vec<f64> = self.slope.iter().zip(&c).map(|(slope, c)| c * slope).collect();
        factor.solve(&mut mean);
        let square = |x: f64| x * x;
        // the coordinates' own prior is in the normal
        let own: f64 = self.coordinates.iter().map(|i| square(position[*i])).sum();
        let told: f64 = mean.iter().map(|x| square(*x)).sum();
        let ln_density = evaluator.ln_prior(position) + 0.5 * (own + told) - factor.ln_det();
        factor.solve_transposed(&mut mean);
        Some(Normal { multipliers: c, mean, factor, ln_density })
    }

    /// Metropolis steps under π*. Where they end: the normal there, and the position with its scales there; `None` if none
    /// led elsewhere.
    fn walk(
        &self,
        here: &Normal,
        evaluator: &mut dyn Evaluator,
        position: &[f64],
        rng: &mut impl Rng,
    ) -> Option<(Normal, Vec<f64>)> {
        let mut end: Option<(Normal, Vec<f64>)> = None;
        for _ in 0..N_STEPS {
            // drawn, so that the steps the other way round are as likely
            let step = STEPS[rng.random_range(0..STEPS.len())];
            let (from, at) = end.as_ref().map_or((here, position), |(normal, at)| (normal, at));
            let mut next = at.to_vec();
            for scale in &self.scales {
                next[*scale] += step * rng.sample::<f64, _>(StandardNormal);
            }
            let normal = self.normal(evaluator, &next);
            let uniform = rng.random::<f64>();
            if let Some(normal) = normal
                && uniform.ln() < normal.ln_density - from.ln_density
            {
                end = Some((normal, next));
            }
        }
        end
    }

    /// Brings the coordinates from one normal to the other, and all others after them.
    fn carry(&self, from: &Normal, to: &Normal, position: &mut [f64]) {
        let off: Vec<f64> =
            self.coordinates.iter().zip(&from.mean).map(|(i, mean)| position[*i] - mean).collect();
        let mut z = from.factor.whitened(&off);
        to.factor.solve_transposed(&mut z);
        for (b, i) in self.coordinates.iter().enumerate() {
            let new = to.mean[b] + z[b];
            let rise = to.multipliers[b] * new - from.multipliers[b] * position[*i];
            position[*i] = new;
            for (other, follows) in self.others.iter().zip(self.follows.col(b).iter()) {
                position[*other] -= rise * follows;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::Moments;
    use rand::SeedableRng as _;
    use rand_chacha::ChaCha8Rng;

    /// t + t³/10 of t = exp(s) (a + 2 b) was measured as 1 with an error of 0.3, and exp(s) a as d − 0.5 with one of 1; s has an sd of 0.5, the
    /// others of 1.
    struct Bent;

    impl Evaluator for Bent {
        fn ln_density(&mut self, q: &[f64], g: &mut [f64]) -> f64 {
            let [s, a, b, d] = [q[0], q[1], q[2], q[3]];
            let sum = s.exp() * (a + 2.0 * b);
            let seen = sum + 0.1 * sum.powi(3);
            let force = -(seen - 1.0) / 0.09 * (1.0 + 0.3 * sum * sum);
            let off = d - 0.5 - s.exp() * a;
            g.copy_from_slice(&[
                force * sum + off * s.exp() * a - 4.0 * s,
                force * s.exp() + off * s.exp() - a,
                2.0 * force * s.exp() - b,
                -off - d,
            ]);
            -0.5 * ((seen - 1.0).powi(2) / 0.09 + off * off + 4.0 * s * s + a * a + b * b + d * d)
        }
        fn multipliers(&mut self, q: &[f64]) -> Vec<f64> {
            vec![0.0, q[0].exp(), q[0].exp(), 0.0]
        }
        fn ln_prior(&mut self, q: &[f64]) -> f64 {
            -0.5 * (4.0 * q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
        }
    }

    /// Largest z of the changes of moments over draws of the density itself, and the share of moves that led elsewhere.
    fn worst(volume: f64) -> (f64, f64) {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let curvature = Curvature::at(&mut Bent, &[0.2, 0.3, 0.2, 0.6], &[0]);
        let mut changes = Moments::new(8);
        let (mut moved, mut point) = (0.0, PhasePoint::new(4));
        for _ in 0..20_000 {
            // from the prior, by rejection
            loop {
                let sds = [0.5, 1.0, 1.0, 1.0];
                for (q, sd) in point.position.iter_mut().zip(sds) {
                    *q = sd * rng.sample::<f64, _>(StandardNormal);
                }
                let q = &point.position;
                let prior = -0.5 * (4.0 * q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
                point.ln_density = Bent.ln_density(q, &mut point.gradient);
                if rng.random::<f64>().ln() < point.ln_density - prior {
                    break;
                }
            }
            let before = point.position.clone();
            moves(&curvature, &mut Bent, &mut point, &mut rng, volume);
            moved += f64::from(u8::from(point.position[0].to_bits() != before[0].to_bits()));
            let pairs = || point.position.iter().zip(&before);
            changes.add(pairs().map(|(a, b)| a - b).chain(pairs().map(|(a, b)| a * a - b * b)));
        }
        let n: f64 = 20_000.0;
        let z =
            |(mean, sd): (&f64, &f64)| if *sd > 0.0 { (mean / (sd / n.sqrt())).abs() } else { 0.0 };
        (changes.means().iter().zip(&changes.sds()).map(z).fold(0.0, f64::max), moved / n)
    }

    /// Within √(2 ln(8/0.001)): eight moments, 0.1 % in all. The volume left out, draws are off.
    #[test]
    fn the_moves_leave_the_density_as_it_is() {
        let ((right, moved), (wrong, _)) = (worst(1.0), worst(0.0));
        assert!(right < 4.24 && wrong > 9.0 && moved > 0.5, "{right} {wrong} {moved}");
    }
}
