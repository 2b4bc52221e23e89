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
use super::curvature::Curvature;
use super::density::Evaluator;
use super::hamiltonian::PhasePoint;
use faer::Mat;
use rand::{Rng, RngExt as _};
use rand_distr::StandardNormal;

/// Standard deviations of the steps under π*.
const STEPS: [f64; 3] = [0.1, 0.3, 0.9];
/// How many steps a move makes.
const N_STEPS: usize = 30;

/// Moves the scales of each field once, from the position of `point`, which it keeps up to date with its log density.
/// Returns how often it evaluated the density.
pub(super) fn move_scales(
    curvature: &Curvature,
    evaluator: &mut dyn Evaluator,
    point: &mut PhasePoint,
    rng: &mut impl Rng,
) -> u64 {
    moves(curvature, evaluator, point, rng, [1.0; 2])
}

/// The powers of the ratios of |L| and of π* are 1, and something else in tests that must fail.
fn moves(
    curvature: &Curvature,
    evaluator: &mut dyn Evaluator,
    point: &mut PhasePoint,
    rng: &mut impl Rng,
    powers: [f64; 2],
) -> u64 {
    let mut n = 0;
    let all = fields(curvature.scales(), evaluator, &point.position);
    for (scales, coordinates) in all.clone() {
        let field = Field::new(curvature, evaluator, &point.position, scales, coordinates);
        let Some(here) = field.normal(evaluator, &point.position) else { continue };
        let Some((there, mut position)) = field.walk(&here, evaluator, &point.position, rng) else {
            continue;
        };
        // the way back would not be this one, where a multiplier has become 0 or is no longer
        if fields(curvature.scales(), evaluator, &position) != all {
            continue;
        }
        field.carry(&here, &there, &mut position);
        let ln_density = evaluator.value(&position);
        n += 1;
        let ln_ratio = ln_density - point.ln_density
            + powers[0] * (here.ln_det - there.ln_det)
            + powers[1] * (here.ln_density - there.ln_density);
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

/// A field's scales and coordinates, with what all other unknowns leave for these to explain.
struct Field<'c> {
    curvature: &'c Curvature,
    scales: Vec<usize>,
    blocks: Vec<Block>,
}

/// Coordinates that measurements see together.
struct Block {
    coordinates: Vec<usize>,
    /// The slope of the normal likelihood in each, times its multiplier, where all of them are 0.
    slope: Vec<f64>,
}

/// The coordinates of a field, given its scales and all other unknowns, under the normal likelihood.
struct Normal {
    /// Of each block: mean, and L.
    blocks: Vec<(Vec<f64>, Factor)>,
    /// ln |L|
    ln_det: f64,
    /// ln π* of the scales.
    ln_density: f64,
}

impl<'c> Field<'c> {
    fn new(
        curvature: &'c Curvature,
        evaluator: &mut dyn Evaluator,
        position: &[f64],
        scales: Vec<usize>,
        coordinates: Vec<usize>,
    ) -> Self {
        let c = evaluator.multipliers(position);
        let mut others: Vec<f64> =
            position.iter().zip(&c).map(|(x, c)| if *c == 0.0 { *x } else { c * x }).collect();
        for i in coordinates.iter().chain(curvature.scales()) {
            others[*i] = 0.0;
        }
        let slope = |i: &usize| curvature.slope_at(*i, &others);
        let block = |coordinates: Vec<usize>| Block {
            slope: coordinates.iter().map(slope).collect(),
            coordinates,
        };
        let blocks = curvature.seen_together(coordinates).into_iter().map(block).collect();
        Self { curvature, scales, blocks }
    }

    /// `None` where the likelihood's information is no normal's.
    fn normal(&self, evaluator: &mut dyn Evaluator, position: &[f64]) -> Option<Normal> {
        let c = evaluator.multipliers(position);
        let mut normal =
            Normal { blocks: vec![], ln_det: 0.0, ln_density: evaluator.ln_prior(position) };
        for Block { coordinates, slope } in &self.blocks {
            let n = coordinates.len();
            let precision = Mat::from_fn(n, n, |a, b| {
                let (i, j) = (coordinates[a], coordinates[b]);
                c[i] * c[j] * self.curvature.information(i, j) + f64::from(u8::from(a == b))
            });
            let factor = Factor::of(precision.as_ref())?;
            let mut mean: Vec<f64> =
                coordinates.iter().zip(slope).map(|(i, slope)| c[*i] * slope).collect();
            factor.solve(&mut mean);
            normal.ln_det += factor.ln_det();
            // the coordinates' own prior is in the normal
            let own = coordinates.iter().map(|i| position[*i] * position[*i]).sum::<f64>();
            normal.ln_density +=
                0.5 * (own + mean.iter().map(|x| x * x).sum::<f64>()) - factor.ln_det();
            factor.solve_transposed(&mut mean);
            normal.blocks.push((mean, factor));
        }
        Some(normal)
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

    /// Brings the coordinates from one normal to the other.
    fn carry(&self, from: &Normal, to: &Normal, position: &mut [f64]) {
        for ((block, (old, before)), (new, after)) in
            self.blocks.iter().zip(&from.blocks).zip(&to.blocks)
        {
            let off: Vec<f64> =
                block.coordinates.iter().zip(old).map(|(i, mean)| position[*i] - mean).collect();
            let mut z = before.whitened(&off);
            after.solve_transposed(&mut z);
            for ((i, x), mean) in block.coordinates.iter().zip(z).zip(new) {
                position[*i] = mean + x;
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

    /// t + t³/10 of t = c (a + 2 b) was measured as 1 with an error of 0.3, and c a as d − 0.5 with one of 1; s has an sd of
    /// 0.5, the others of 1. c is exp(s), or 0 where s is below `cut`.
    struct Bent {
        cut: f64,
    }

    impl Bent {
        fn c(&self, s: f64) -> f64 {
            if s < self.cut { 0.0 } else { s.exp() }
        }
    }

    impl Evaluator for Bent {
        fn ln_density(&mut self, q: &[f64], g: &mut [f64]) -> f64 {
            let [s, a, b, d] = [q[0], q[1], q[2], q[3]];
            let c = self.c(s);
            let sum = c * (a + 2.0 * b);
            let seen = sum + 0.1 * sum.powi(3);
            let force = -(seen - 1.0) / 0.09 * (1.0 + 0.3 * sum * sum);
            let off = d - 0.5 - c * a;
            g.copy_from_slice(&[
                force * sum + off * c * a - 4.0 * s,
                (force + off) * c - a,
                2.0 * force * c - b,
                -off - d,
            ]);
            -0.5 * ((seen - 1.0).powi(2) / 0.09 + off * off + 4.0 * s * s + a * a + b * b + d * d)
        }
        fn multipliers(&mut self, q: &[f64]) -> Vec<f64> {
            vec![0.0, self.c(q[0]), self.c(q[0]), 0.0]
        }
        fn ln_prior(&mut self, q: &[f64]) -> f64 {
            -0.5 * (4.0 * q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
        }
    }

    /// Largest z of the changes of moments over draws of the density itself, and the share of moves that led elsewhere.
    fn worst(cut: f64, powers: [f64; 2]) -> (f64, f64) {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut bent = Bent { cut };
        let curvature = Curvature::at(&mut bent, &[0.2, 0.3, 0.2, 0.6], &[0]);
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
                point.ln_density = bent.ln_density(q, &mut point.gradient);
                if rng.random::<f64>().ln() < point.ln_density - prior {
                    break;
                }
            }
            let before = point.position.clone();
            moves(&curvature, &mut bent, &mut point, &mut rng, powers);
            moved += f64::from(u8::from(point.position[0].to_bits() != before[0].to_bits()));
            let pairs = || point.position.iter().zip(&before);
            changes.add(pairs().map(|(a, b)| a - b).chain(pairs().map(|(a, b)| a * a - b * b)));
        }
        let n: f64 = 20_000.0;
        let z =
            |(mean, sd): (&f64, &f64)| if *sd > 0.0 { (mean / (sd / n.sqrt())).abs() } else { 0.0 };
        (changes.means().iter().zip(&changes.sds()).map(z).fold(0.0, f64::max), moved / n)
    }

    /// Within √(2 ln(8/0.001)): eight moments, 0.1 % in all. With a factor left out, draws are off.
    #[test]
    fn the_moves_leave_the_density_as_it_is() {
        for cut in [f64::NEG_INFINITY, 0.0] {
            let (right, moved) = worst(cut, [1.0; 2]);
            assert!(right < 4.24 && moved > 0.3, "{cut}: {right} {moved}");
        }
        let wrong = [[0.0, 1.0], [1.0, 0.0]].map(|powers| worst(f64::NEG_INFINITY, powers).0);
        assert!(wrong.iter().all(|z| *z > 9.0), "{wrong:?}");
    }

    /// exp(s) and exp(t) multiply the first field, of which each measurement sees one coordinate; exp(r) the second.
    struct TwoFields;

    impl Evaluator for TwoFields {
        fn ln_density(&mut self, q: &[f64], g: &mut [f64]) -> f64 {
            let c = self.multipliers(q);
            g.fill(0.0);
            let mut sum = 0.0;
            for i in 3..7 {
                let seen = c[i] * q[i] - 1.0;
                sum -= 0.5 * (seen * seen + q[i] * q[i]);
                g[i] = -seen * c[i] - q[i];
            }
            sum
        }
        fn multipliers(&mut self, q: &[f64]) -> Vec<f64> {
            let first = (q[0] + q[2]).exp();
            vec![0.0, 0.0, 0.0, first, q[1].exp(), 2.0 * first, q[1].exp()]
        }
    }

    #[test]
    fn scales_of_the_same_coordinates_move_together() {
        let position = [0.1, 0.2, 0.3, 1.0, 1.0, 1.0, 1.0];
        let fields = fields(&[0, 1, 2], &mut TwoFields, &position);
        assert_eq!(fields, [(vec![0, 2], vec![3, 5]), (vec![1], vec![4, 6])]);
        let curvature = Curvature::at(&mut TwoFields, &position, &[0, 1, 2]);
        let mut blocks = curvature.seen_together(vec![3, 4, 5, 6]);
        blocks.sort();
        assert_eq!(blocks, [[3], [4], [5], [6]]);
    }
}
