//! Moves of amplitudes, lengthscales and means that leave the fields as they are.
//!
//! ```text
//! w_k = amplitude √S_k η_k stays,  (amplitude, lengthscale) → new,  η_k → w_k / (amplitude √S_k) new
//! accepted with  min(1, π(new) / π(old) · Π_k η_k new / η_k old)
//! ```
//! Likewise a mean and the coefficient of the constant mode, of which the likelihood sees the sum:
//!
//! ```text
//! η₀ → a standard normal number,  m → m + w₀ φ₀ old − w₀ φ₀ new,  accepted with  min(1, p(m new) / p(m old))
//! ```
//! The likelihood sees fields alone, so the ratio is that of the priors, and costs next to nothing. Together
//! with moves of the η at fixed scales this is the interweaving of two parametrisations: where data tell the
//! fields well, the scales mix by this move, elsewhere by both.
//!
//! # Source
//! Yu and Meng 2011, "To center or not to center: that is not the question".

use rand::{Rng, RngExt as _};
use rand_distr::StandardNormal;

use super::gp::{Field, Term};
use super::laid_out::{Model, PriorEntry};
use super::reported::Parameter;
use super::tape::{Op as _, Tape};
use crate::dist::Support;

/// Moves between two transitions: some in small steps, some in large ones.
const STEPS: [f64; 3] = [0.05, 0.2, 0.6];
const ROUNDS: usize = 10;

impl Model {
    /// The unknowns that only scale fields: amplitudes and what kernels mention, if declared with a field.
    pub(super) fn scales_of_fields(&self) -> Vec<usize> {
        self.own_scales().flat_map(|entry| entry.u.clone()).collect()
    }

    fn own_scales(&self) -> impl Iterator<Item = &PriorEntry> {
        let terms = self.fields.iter().flat_map(|field| &field.op.terms);
        let scales: Vec<usize> = terms.flat_map(Term::scaled_by).collect();
        let means: Vec<usize> = self.fields.iter().flat_map(|f| f.op.mean.mentions()).collect();
        let is_in = |entry: &PriorEntry, values: &[usize]| {
            values.iter().any(|v| (entry.v..entry.v + entry.len).contains(v))
        };
        let own = self.with_priors().filter(move |(parameter, entry)| {
            // what is declared with a field, FIELD.NAME, nothing but fields can mention
            parameter.name.contains('.') && is_in(entry, &scales) && !is_in(entry, &means)
        });
        own.map(|(_, entry)| entry)
    }

    /// Parameters that are declared, with their priors.
    fn with_priors(&self) -> impl Iterator<Item = (&Parameter, &PriorEntry)> {
        self.declared().zip(&self.prior_entries)
    }

    /// Moves the scales of fields, and their coefficients with them.
    pub(super) fn rescale_fields(&self, t: &mut Tape, position: &mut [f64], rng: &mut dyn Rng) {
        self.rescale(t, position, rng, 1.0);
    }

    /// Moves means, and the coefficients of constant modes with them.
    pub(super) fn recentre_fields(&self, t: &mut Tape, position: &mut [f64], rng: &mut dyn Rng) {
        self.recentre(t, position, rng, 1.0);
    }

    /// `power` of the ratio is 1, and something else in a test that must fail.
    fn recentre(&self, t: &mut Tape, position: &mut [f64], rng: &mut dyn Rng, power: f64) {
        for (field, v) in self.fields.iter().filter_map(|f| Some((&f.op, f.op.lone_mean?))) {
            let Some((term, phi0)) = field.terms.first().zip(field.constant_mode()) else {
                continue;
            };
            // of a mean that may be any number, the unknown is linear in the value
            let is_its = |(parameter, entry): &(&Parameter, &PriorEntry)| {
                parameter.support == Support::Real && (entry.v..entry.v + entry.len).contains(&v)
            };
            let found = self.with_priors().enumerate().find(|(_, declared)| is_its(declared));
            let Some((prior, (_, entry))) = found else { continue };
            let unknown = entry.u.start + (v - entry.v);
            let old = self.ln_prior_alone(t, position);
            let sqrt_density = term.spectrum.at(&t.v, field.frequency[0]);
            let scale = term.amplitude.value(&t.v) * sqrt_density * phi0;
            let eta: f64 = rng.sample(StandardNormal);
            let mut proposal = position.to_vec();
            proposal[term.eta] = eta;
            let mean = t.v[v] + scale * (position[term.eta] - eta);
            proposal[unknown] = self.priors[prior].unknown(&t.v, mean);
            // what η₀ is drawn from is in both priors
            let drawn = 0.5 * (eta * eta - position[term.eta].powi(2));
            let ln_ratio = self.ln_prior_alone(t, &proposal) - old + drawn;
            if rng.random::<f64>().ln() < power * ln_ratio {
                position.copy_from_slice(&proposal);
            }
        }
    }

    /// `jacobian` is 1, and something else in a test that must fail.
    fn rescale(&self, t: &mut Tape, position: &mut [f64], rng: &mut dyn Rng, jacobian: f64) {
        let scales = self.scales_of_fields();
        if scales.is_empty() {
            return;
        }
        let mut here = self.scaled(t, position);
        let mut proposal = position.to_vec();
        for step in std::iter::repeat_n(STEPS, ROUNDS).flatten() {
            proposal.copy_from_slice(position);
            for u in &scales {
                proposal[*u] += step * rng.sample::<f64, _>(StandardNormal);
            }
            let there = self.scaled(t, &proposal);
            let mut ln_ratio = 0.0;
            for ((at, old), new) in here.at.iter().zip(&here.scale).zip(&there.scale) {
                proposal[*at] *= old / new;
                ln_ratio += jacobian * (old / new).ln();
            }
            ln_ratio += self.ln_prior_alone(t, &proposal) - self.ln_prior_alone(t, position);
            // NaN, from a scale that is no number, is not accepted
            if rng.random::<f64>().ln() < ln_ratio {
                position.copy_from_slice(&proposal);
                here = there;
            }
        }
    }

    /// Amplitude √S of each unknown that is a coefficient of a field and scaled by [`Model::scales_of_fields`] alone; 0 for
    /// the others, (dim).
    pub(super) fn multipliers(&self, t: &mut Tape, u: &[f64]) -> Vec<f64> {
        let own: Vec<_> = self.own_scales().map(|entry| entry.v..entry.v + entry.len).collect();
        let Scaled { at, scale } = self.scaled(t, u);
        let mut pairs = at.into_iter().zip(scale);
        let mut all = vec![0.0; u.len()];
        for term in self.fields.iter().flat_map(|field| &field.op.terms) {
            let is_own = term.scaled_by().iter().all(|v| own.iter().any(|own| own.contains(v)));
            for (at, scale) in pairs.by_ref().take(term.k) {
                all[at] = if is_own { scale } else { 0.0 };
            }
        }
        all
    }

    /// Each coefficient's unknown, with amplitude √S.
    fn scaled(&self, t: &mut Tape, u: &[f64]) -> Scaled {
        t.u.copy_from_slice(u);
        self.priors.iter().for_each(|prior| prior.forward(t));
        let (mut at, mut scale) = (vec![], vec![]);
        for field in self.fields.iter().map(|field| &field.op) {
            for term in &field.terms {
                let amplitude = term.amplitude.value(&t.v);
                let mut c = vec![0.0; term.k];
                term.spectrum.values(&t.v, &field.frequency[..term.k], &mut c);
                at.extend(term.eta..term.eta + term.k);
                scale.extend(c.iter().map(|c| amplitude * c));
            }
        }
        Scaled { at, scale }
    }

    /// Log density of all priors, without any value but those of parameters.
    pub(super) fn ln_prior_alone(&self, t: &mut Tape, u: &[f64]) -> f64 {
        t.u.copy_from_slice(u);
        self.priors.iter().for_each(|prior| prior.forward(t));
        t.lp = 0.0;
        self.fields.iter().for_each(|field| field.op.ln_density(t));
        self.priors.iter().for_each(|prior| prior.ln_density(t));
        t.lp
    }
}

/// Coefficients of fields: their unknowns, and what each is multiplied by.
struct Scaled {
    at: Vec<usize>,
    scale: Vec<f64>,
}

impl Field {
    /// φ₀, if the first sampled mode is the same wherever the field is seen.
    fn constant_mode(&self) -> Option<f64> {
        let mut first = self.probes.chunks_exact(self.stride.max(1)).map(|probe| probe[0]);
        let phi0 = first.next()?;
        let is_same = |phi: f64| (phi - phi0).abs() <= 1e-6 * phi0.abs();
        (self.k > 0 && first.all(is_same)).then_some(phi0)
    }
}

impl Term {
    /// Where the values are that its amplitude and its kernel mention.
    pub(super) fn scaled_by(&self) -> Vec<usize> {
        [self.amplitude.mentions(), self.spectrum.mentions()].concat()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::infer::{LogDensity as _, Settings};
    use crate::manifold::made_up;
    use crate::num::Moments;
    use crate::prelude::*;
    use crate::random::Stream;

    model! {
        model Two;
        param a ~ HalfNormal(1.0);
        field f(x) = m + (alpha * a) * gp(Matern52(rho), K = 6) + (alpha) * gp(Rbf(rho), K = 3) where {
            m ~ Normal(1.0, 1.0);
            alpha ~ LogNormal(0.0, 0.5);
            rho [mm] ~ LogNormal(3.5, 0.4);
        }
        field g(x) = m + gp(Rbf(30.0), K = 4) where { m ~ Normal(0.0, 1.0); }
        observe y(row): Number ~ Normal(f(row) + g(row), a);
    }

    fn laid_out() -> Model {
        let cells = (0..5).map(|i| vec!["y".into(), i.to_string(), "1".into()]).collect();
        let header = ["protocol", "vertex", "value"].map(String::from).to_vec();
        let mut table = Measurements::from_cells("made up", header, cells).unwrap();
        table.place_at_indices(12).unwrap();
        Model::new(&Two, Some(&made_up()), &table).unwrap()
    }

    /// The unknowns that these moves have moved. No field may have.
    fn moved(model: &Model, moves: impl Fn(&mut Tape, &mut [f64], &mut dyn Rng)) -> Vec<String> {
        let (mut t, mut rng) = (model.tape(), Stream::Prior(0).rng(1));
        let mut u: Vec<f64> = (0..model.dim()).map(|i| 0.1 * i as f64 - 0.45).collect();
        model.forward(&mut t, &u);
        let (before, values) = (u.clone(), t.v.clone());
        moves(&mut t, &mut u, &mut rng);
        model.forward(&mut t, &u);
        for field in &model.fields {
            let at = field.op.theta..field.op.theta + field.op.n_probes();
            let differ = |(a, b): (&f64, &f64)| (a - b).abs() > 1e-9;
            assert!(!t.v[at.clone()].iter().zip(&values[at]).any(differ));
        }
        let names = model.unknown_names().into_iter().zip(before.iter().zip(&u));
        names.filter(|(_, (a, b))| a.to_bits() != b.to_bits()).map(|(name, _)| name).collect()
    }

    #[test]
    fn only_scales_of_fields_move_and_fields_stay() {
        let model = laid_out();
        let names = model.unknown_names();
        let scales: Vec<&str> = model.scales_of_fields().iter().map(|u| &*names[*u]).collect();
        assert_eq!(scales, ["f.alpha", "f.rho"]);
        let own: Vec<String> =
            names.iter().filter(|name| name.starts_with("f.") && *name != "f.m").cloned().collect();
        assert_eq!(moved(&model, |t, u, rng| model.rescale_fields(t, u, rng)), own);
    }

    #[test]
    fn means_and_constant_modes_move_and_fields_stay() {
        let model = laid_out();
        let mut moved = moved(&model, |t, u, rng| {
            (0..20).for_each(|_| model.recentre_fields(t, u, rng));
        });
        moved.sort();
        assert_eq!(moved, ["f.eta[0]", "f.m", "g.eta[0]", "g.m"]);
    }

    /// The metric may depend on what rests during a trajectory alone: the first term of `f` is scaled by `a`, too.
    #[test]
    fn multipliers_are_those_of_resting_scales() {
        let model = laid_out();
        let u: Vec<f64> = (0..model.dim()).map(|i| 0.1 * i as f64 - 0.45).collect();
        let multipliers = model.multipliers(&mut model.tape(), &u);
        let names = model.unknown_names();
        let of = |start: &str| -> Vec<f64> {
            let pairs = names.iter().zip(&multipliers);
            pairs.filter(|(name, _)| name.starts_with(start)).map(|(_, m)| *m).collect()
        };
        let f = of("f.eta");
        assert!(f[..6].iter().all(|m| *m == 0.0) && f[6..].iter().all(|m| *m > 0.0), "{f:?}");
        assert!(of("g.eta").iter().all(|m| *m > 0.0) && multipliers[0] == 0.0);
    }

    /// Draws of the prior are draws of the prior afterwards, within 4.5 standard errors; without the Jacobian, or where
    /// all new means are accepted, they are not.
    #[test]
    fn the_moves_leave_the_prior_as_it_is() {
        let model = laid_out();
        let settings = Settings { chains: 1, draws: 4000, ..Settings::default() };
        let worst = |jacobian: f64, power: f64| {
            let chain = &model.prior_draws(&settings).unwrap()[0];
            let (mut t, mut rng) = (model.tape(), Stream::Prior(1).rng(2));
            let mut changes = Moments::new(2 * model.dim());
            for i in 0..chain.n_draws() {
                let mut u = chain.draw(i).unwrap().into_owned();
                model.rescale(&mut t, &mut u, &mut rng, jacobian);
                for _ in 0..5 {
                    model.recentre(&mut t, &mut u, &mut rng, power);
                }
                let before = chain.draw(i).unwrap();
                let pairs = || u.iter().zip(&*before);
                let of = pairs().map(|(a, b)| a - b).chain(pairs().map(|(a, b)| a * a - b * b));
                changes.add(of);
            }
            let n = chain.n_draws() as f64;
            let z = |(mean, sd): (&f64, &f64)| {
                if *sd > 0.0 { (mean / (sd / n.sqrt())).abs() } else { 0.0 }
            };
            changes.means().iter().zip(&changes.sds()).map(z).fold(0.0, f64::max)
        };
        let (right, wrong, twin) = (worst(1.0, 1.0), worst(0.0, 1.0), worst(1.0, 0.0));
        assert!(right < 4.5 && wrong > 20.0 && twin > 9.0, "{right} {wrong} {twin}");
    }
}
