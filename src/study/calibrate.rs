//! The cases of a plan: truth, measurements, calibration, error.

use std::collections::BTreeMap;

use super::next::lessons;
use super::plan::{Block, Case, Choice, Estimate, Plan};
use super::truth::{Truth, repaired};
use super::{StudyError, measure};
use crate::diagnostics::r_hat;
use crate::dsl::{Declare, Maps, Model, Sampler};
use crate::infer::{
    Chain, LogDensity as _, OptimumSettings, Settings, Silent, jittered_starts, maximise,
};
use crate::manifold::{Basis, maximin};
use crate::mesh::TriMesh;

/// Most iterations on the way to a mode: the ripple of bracket likelihoods needs thousands.
const MOST_ITERATIONS: usize = 50_000;
/// Draws that maps are made of.
pub(super) const MAP_DRAWS: usize = 400;
/// Sites that are considered one after the other.
const CANDIDATES: usize = 150;
/// Central intervals whose coverage is counted.
pub const INTERVALS: [f64; 3] = [0.5, 0.9, 0.95];

/// What came of one case.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The case.
    pub case: Case,
    /// Whether the mode was reached, or the draws can be used.
    pub converged: bool,
    /// Share of vertices whose estimate was unphysical and repaired.
    pub repaired: f64,
    /// By field and derived quantity, in the order of [`Study::names`].
    pub errors: Vec<MapError>,
}

/// How far an estimate is from the truth over the surface.
#[derive(Clone, Debug)]
pub struct MapError {
    /// Root mean squared error over all vertices, in the map's unit.
    pub rmse: f64,
    /// Share of vertices whose truth lies in each of [`INTERVALS`]; only from draws.
    pub coverage: Option<[f64; 3]>,
}

/// A plan on its surface, with the designs that its blocks share.
pub struct Study<'a> {
    plan: &'a Plan,
    model: &'a dyn Declare,
    basis: &'a Basis,
    outline: Model,
    /// Sites by number of sites and design.
    designs: BTreeMap<(usize, usize), Vec<u32>>,
    /// Sites that are considered one after the other.
    candidates: Vec<u32>,
}

impl std::fmt::Debug for Study<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Study").field("plan", self.plan).finish_non_exhaustive()
    }
}

impl<'a> Study<'a> {
    /// Places all sites.
    ///
    /// # Errors
    /// [`StudyError`].
    pub fn new(
        plan: &'a Plan,
        model: &'a dyn Declare,
        mesh: &TriMesh,
        basis: &'a Basis,
    ) -> Result<Self, StudyError> {
        let outline = Model::outline(model)?;
        let mut designs = BTreeMap::new();
        for case in plan.cases() {
            let key = (case.sites, case.design);
            if let std::collections::btree_map::Entry::Vacant(entry) = designs.entry(key) {
                entry.insert(maximin(mesh, case.sites, plan.exclude, plan.design_seed(&case))?);
            }
        }
        let candidates = match plan.choice {
            Choice::Maximin => vec![],
            Choice::Next => maximin(mesh, CANDIDATES, plan.exclude, plan.seed)?,
        };
        Ok(Self { plan, model, basis, outline, designs, candidates })
    }

    /// Names of the maps that are judged: fields, then derived quantities.
    pub fn names(&self) -> Vec<&'static str> {
        Maps::new(&self.outline, self.basis).names().into_iter().map(|map| map.name).collect()
    }

    /// All cases of a block, each reported to `done`, and the share of the truth that was repaired.
    ///
    /// # Errors
    /// [`StudyError`].
    pub fn run(
        &self,
        block: &Block,
        done: &(dyn Fn() + Sync),
    ) -> Result<(f64, Vec<Outcome>), StudyError> {
        let seed = self.plan.truth_seed(block);
        let truth = Truth::new(&self.outline, self.basis, block.lengthscale, seed)?;
        let mut outcomes = vec![];
        let mut grown = BTreeMap::new();
        for case in self.plan.cases() {
            let sites = match self.plan.choice {
                Choice::Maximin => self.designs[&(case.sites, case.design)].clone(),
                Choice::Next => {
                    let key = (case.design, case.resolution.to_bits());
                    let sites = grown.entry(key).or_insert_with(|| self.fewest(&case));
                    self.grow(sites, block, case, &truth)?;
                    sites[..case.sites].to_vec()
                }
            };
            let (model, seed) = self.measured(block, case, &truth, &sites)?;
            outcomes.push(match self.plan.estimate {
                Estimate::Mode => self.mode(&model, case, &truth)?,
                Estimate::Mean => self.mean(&model, case, &truth, seed)?,
            });
            done();
        }
        Ok((truth.repaired(), outcomes))
    }

    /// The model with what is measured at these sites, and the seed of its calibration.
    fn measured(
        &self,
        block: &Block,
        case: Case,
        truth: &Truth,
        sites: &[u32],
    ) -> Result<(Model, u64), StudyError> {
        let seed = self.plan.case_seed(block, &case);
        let (outline, basis) = (&self.outline, self.basis);
        let table =
            measure(self.model, outline, basis, &truth.fields, sites, case.resolution, seed)?;
        Ok((Model::new(self.model, Some(basis), &table)?, seed))
    }

    /// The plan's smallest design.
    fn fewest(&self, case: &Case) -> Vec<u32> {
        let fewest = self.plan.sites.iter().copied().min().unwrap_or(case.sites);
        self.designs[&(fewest, case.design)].clone()
    }

    /// Adds site after site where all measurements together teach most, until there are enough.
    fn grow(
        &self,
        sites: &mut Vec<u32>,
        block: &Block,
        case: Case,
        truth: &Truth,
    ) -> Result<(), StudyError> {
        while sites.len() < case.sites {
            let so_far = Case { sites: sites.len(), ..case };
            let (model, seed) = self.measured(block, so_far, truth, sites)?;
            let (chains, _) = self.draws(&model, seed)?;
            let found = lessons(
                self.model,
                &model,
                self.basis,
                &thinned(&chains, MAP_DRAWS),
                &self.candidates,
                case.resolution,
            )?;
            let everything = found.iter().filter(|l| l.observes.len() == model.observes.len());
            let Some(best) = everything.max_by(|a, b| a.gain.total_cmp(&b.gain)) else {
                return Err(StudyError::NotSynthetic { why: "there is no further site".into() });
            };
            sites.push(best.vertex);
        }
        Ok(())
    }

    fn draws(&self, model: &Model, seed: u64) -> Result<(Vec<Chain>, usize), StudyError> {
        let Plan { chains, warmup, draws, .. } = *self.plan;
        let settings = Settings { chains, warmup, draws, seed, threads: 1, ..Settings::default() };
        let starts = jittered_starts(model, &model.initial(), chains, seed)?;
        let sampled = Sampler::of(model).sample(model, &starts, &settings, &Silent)?;
        Ok((sampled.into_iter().flatten().collect(), starts.len()))
    }

    /// The paper's validation: fields at the mode, unphysical vertices repaired.
    fn mode(&self, model: &Model, case: Case, truth: &Truth) -> Result<Outcome, StudyError> {
        let settings = OptimumSettings { max_iterations: MOST_ITERATIONS, ..Default::default() };
        let optimum = maximise(model, &model.initial(), &settings)?;
        let maps = Maps::new(model, self.basis);
        let (summary, _) = maps.summarise(&[&optimum.position]);
        let fields: Vec<Vec<f64>> =
            summary.into_iter().take(maps.n_fields()).map(|map| map.mean).collect();
        let mut tape = model.tape();
        model.forward(&mut tape, &optimum.position);
        let mended = match repaired(&maps, &tape, fields.clone(), self.basis) {
            // nothing to repair from: what follows from such a mode has no error, not a small one
            Err(StudyError::NothingPhysical) => {
                let derived = maps.derived_fields(&tape, &fields);
                let unphysical = vec![true; self.basis.n_vertices()];
                Truth { fields, derived, unphysical }
            }
            mended => mended?,
        };
        let estimates = mended.fields.iter().chain(&mended.derived);
        let errors = estimates
            .zip(truth.maps())
            .map(|(estimate, truth)| MapError { rmse: rms_error(estimate, truth), coverage: None });
        Ok(Outcome {
            case,
            converged: optimum.converged,
            repaired: mended.repaired(),
            errors: errors.collect(),
        })
    }

    /// Means over physical draws, and where the truth ranks among them.
    fn mean(
        &self,
        model: &Model,
        case: Case,
        truth: &Truth,
        seed: u64,
    ) -> Result<Outcome, StudyError> {
        let (chains, asked) = self.draws(model, seed)?;
        let thinned = thinned(&chains, MAP_DRAWS);
        let maps = Maps::new(model, self.basis);
        let (summary, unphysical) = maps.summarise(&thinned);
        let truths: Vec<&[f64]> = truth.maps().map(Vec::as_slice).collect();
        let ranks = maps.ranks(&thinned, &truths);
        let errors = summary.iter().zip(&truths).zip(&ranks).map(|((map, truth), ranks)| {
            MapError { rmse: rms_error(&map.mean, truth), coverage: Some(coverage(ranks)) }
        });
        Ok(Outcome {
            case,
            converged: chains.len() == asked && agree(model, &chains),
            repaired: unphysical.iter().sum::<f64>() / unphysical.len() as f64,
            errors: errors.collect(),
        })
    }
}

/// At most `most` draws of all chains, evenly spaced.
pub fn thinned(chains: &[Chain], most: usize) -> Vec<&[f64]> {
    let all: Vec<&[f64]> =
        chains.iter().flat_map(|c| (0..c.n_draws()).map(|i| c.draw(i))).collect();
    let step = all.len().div_ceil(most).max(1);
    all.into_iter().step_by(step).collect()
}

/// Whether every unknown has an R̂ that short chains can have.
pub fn agree(model: &Model, chains: &[Chain]) -> bool {
    const MAX_R_HAT: f64 = 1.05;
    (0..model.dim()).all(|i| {
        let of = |chain: &Chain| (0..chain.n_draws()).map(|k| chain.draw(k)[i]).collect();
        let columns: Vec<Vec<f64>> = chains.iter().map(of).collect();
        let slices: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
        let r_hat = r_hat(&slices);
        r_hat.is_nan() || r_hat <= MAX_R_HAT
    })
}

/// Share of ranks within the central interval of each of [`INTERVALS`]; unknown ranks (NaN) do not count.
pub fn coverage(ranks: &[f64]) -> [f64; 3] {
    let known = || ranks.iter().filter(|rank| !rank.is_nan());
    INTERVALS.map(|level| {
        let inside = known().filter(|rank| (*rank - 0.5).abs() <= 0.5 * level).count();
        inside as f64 / known().count() as f64
    })
}

/// Root mean squared difference over the vertices where both are known.
pub fn rms_error(estimate: &[f64], truth: &[f64]) -> f64 {
    let squares = estimate.iter().zip(truth).map(|(e, t)| (e - t) * (e - t));
    let known: Vec<f64> = squares.filter(|square| square.is_finite()).collect();
    (known.iter().sum::<f64>() / known.len() as f64).sqrt()
}
