//! The cases of a plan: truth, measurements, calibration, error.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};

use rayon::prelude::*;

use super::outcome::{MapError, Outcome, Time};
use super::plan::{Block, Case, Choice, Estimate, Plan};
use super::{Results, StudyError};
use crate::experiment::{
    ExperimentError, Laboratory, Lesson, Minutes, TRUTH_MODES, Truth, Visit, agree, coverage,
    lessons, repaired, rms_error, thinned,
};
use crate::infer::{Chain, OptimumSettings, Settings, Silent, jittered_starts, maximise};
use crate::manifold::{Basis, eigenpairs_cached, maximin};
use crate::mesh::TriMesh;
use crate::model::{Asked, Declare, Maps, Model, Sampler, Summaries};
use crate::run::RunError;

/// Most iterations on the way to a mode: the ripple of bracket likelihoods needs thousands.
const MOST_ITERATIONS: usize = 50_000;
/// Draws that maps are made of.
pub(super) const MAP_DRAWS: usize = 400;
/// Sites that are considered one after the other.
const CANDIDATES: usize = 150;

/// A plan on its surface, with the designs that its blocks share.
pub struct Study<'a> {
    plan: &'a Plan,
    laboratory: Laboratory<'a>,
    /// How long measurements take.
    minutes: Minutes,
    /// Visits by number of sites and design.
    designs: BTreeMap<(usize, usize), Vec<Visit>>,
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
        let laboratory = Laboratory::new(model, basis)?;
        if let Some(minutes) = &plan.minutes {
            let observes = &laboratory.outline().observes;
            let known: Vec<&str> = observes.iter().map(|o| o.name).collect();
            minutes.check_names(&known).map_err(|why| plan.fault(why))?;
        }
        // otherwise a site is a site, whatever is measured there
        let site_by_site = || Minutes { moving: 1.0, protocols: BTreeMap::new() };
        let minutes = plan.minutes.clone().unwrap_or_else(site_by_site);
        let mut designs = BTreeMap::new();
        for case in plan.cases() {
            let key = (case.sites, case.design);
            if let std::collections::btree_map::Entry::Vacant(entry) = designs.entry(key) {
                let sites = maximin(mesh, case.sites, plan.exclude, plan.design_seed(&case))?;
                entry.insert(laboratory.visits(&sites));
            }
        }
        let candidates = match plan.choice {
            Choice::Maximin => vec![],
            Choice::Next => maximin(mesh, CANDIDATES, plan.exclude, plan.seed)?,
        };
        Ok(Self { plan, laboratory, minutes, designs, candidates })
    }

    /// The eigenpairs that a study of `model` on `mesh` needs, from the cache if they are there.
    ///
    /// # Errors
    /// [`StudyError::Model`], [`StudyError::Sites`].
    pub fn basis(model: &dyn Declare, mesh: &TriMesh) -> Result<Basis, StudyError> {
        let modes = Model::outline(model)?.n_modes().max(TRUTH_MODES);
        Ok(eigenpairs_cached(mesh, modes.min(mesh.n_vertices() - 1))?)
    }

    /// Names of the maps that are judged: fields, then derived quantities.
    pub fn names(&self) -> Vec<String> {
        self.laboratory.map_names()
    }

    /// Calibrates all cases of those of `blocks` whose results are missing, and writes each block's results
    /// when they are done; every case is reported to `done`. On so many `threads`, 0 for one per core;
    /// they change no number. Whether it came to its end: not once `stop` is set.
    ///
    /// # Errors
    /// [`StudyError`].
    pub fn complete(
        &self,
        results: &Results,
        blocks: &[Block],
        threads: usize,
        stop: &AtomicBool,
        done: &(dyn Fn() + Sync),
    ) -> Result<bool, StudyError> {
        let names = self.names();
        let missing: Vec<&Block> = results.missing(blocks);
        let one = |block: &&Block| -> Result<bool, StudyError> {
            if stop.load(Ordering::Relaxed) {
                return Ok(false);
            }
            let (repaired, outcomes) = self.run(block, done)?;
            results.write(self.plan, &names, block, repaired, &outcomes)?;
            Ok(true)
        };
        let threads = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
        let all: Result<Vec<bool>, _> = threads.install(|| missing.par_iter().map(one).collect());
        Ok(all?.into_iter().all(|is_done| is_done))
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
        let truth = self.laboratory.truth(block.lengthscale, seed)?;
        let mut outcomes = vec![];
        let mut grown = BTreeMap::new();
        for case in self.plan.cases() {
            let visits = match self.plan.choice {
                Choice::Maximin => self.designs[&(case.sites, case.design)].clone(),
                Choice::Next => {
                    let key = (case.design, case.resolution.to_bits());
                    let visits = grown.entry(key).or_insert_with(|| self.fewest(&case));
                    self.grow(visits, block, case, &truth)?;
                    self.in_time(visits, &case).to_vec()
                }
            };
            let (model, seed) = self.measured(block, case, &truth, &visits)?;
            let outcome = match self.plan.estimate {
                Estimate::Mode => self.mode(&model, case, &truth)?,
                Estimate::Mean => self.mean(&model, case, &truth, seed)?,
            };
            let time = self.plan.minutes.is_some().then(|| self.time(&visits));
            outcomes.push(Outcome { time, ..outcome });
            done();
        }
        Ok((truth.repaired(), outcomes))
    }

    /// The model with what is measured on these visits, and the seed of its calibration.
    fn measured(
        &self,
        block: &Block,
        case: Case,
        truth: &Truth,
        visits: &[Visit],
    ) -> Result<(Model, u64), StudyError> {
        let seed = self.plan.case_seed(block, &case);
        let laboratory = &self.laboratory;
        let table = laboratory.measure(&truth.fields, visits, case.resolution, seed)?;
        Ok((Model::new(laboratory.declared(), Some(laboratory.basis()), &table)?, seed))
    }

    /// The plan's smallest design.
    fn fewest(&self, case: &Case) -> Vec<Visit> {
        let fewest = self.plan.sites.iter().copied().min().unwrap_or(case.sites);
        self.designs[&(fewest, case.design)].clone()
    }

    /// Adds visit after visit where most is learnt per minute, until the time of this case is over.
    fn grow(
        &self,
        visits: &mut Vec<Visit>,
        block: &Block,
        case: Case,
        truth: &Truth,
    ) -> Result<(), StudyError> {
        while self.seconds(visits) < self.most_seconds(&case) {
            let so_far = Case { sites: visits.len(), ..case };
            let (model, seed) = self.measured(block, so_far, truth, visits)?;
            let (chains, _) = self.draws(&model, seed)?;
            let found = lessons(
                self.laboratory.declared(),
                &model,
                self.laboratory.basis(),
                &thinned(&chains, MAP_DRAWS).map_err(RunError::draws)?,
                &self.candidates,
                case.resolution,
            )?;
            let is_known = |lesson: &Lesson| {
                let here = visits.iter().filter(|visit| visit.vertex == lesson.vertex);
                here.flat_map(|visit| &visit.observes).any(|o| lesson.observes.contains(o))
            };
            let per_minute = |Lesson { vertex, observes, gain, .. }: &Lesson| {
                gain / self.minutes_of(visits.last().map(|v| v.vertex), *vertex, observes)
            };
            let new = found.into_iter().filter(|lesson| !is_known(lesson));
            let best = new.max_by(|a, b| per_minute(a).total_cmp(&per_minute(b)));
            let Some(Lesson { vertex, observes, .. }) = best else {
                let why = "there is no further site".into();
                return Err(ExperimentError::NotSynthetic { why }.into());
            };
            visits.push(Visit { vertex, observes });
        }
        Ok(())
    }

    /// Minutes to measure these at `vertex`, coming from the vertex `at`.
    fn minutes_of(&self, at: Option<u32>, vertex: u32, observes: &[&str]) -> f64 {
        let moving = if at == Some(vertex) { 0.0 } else { self.minutes.moving };
        moving + self.minutes.measuring(observes)
    }

    /// Length of these visits, each in whole seconds, so that sums in another order are equal.
    fn seconds(&self, visits: &[Visit]) -> f64 {
        let (mut at, mut seconds) = (None, 0.0);
        for Visit { vertex, observes } in visits {
            seconds += (60.0 * self.minutes_of(at, *vertex, observes)).round();
            at = Some(*vertex);
        }
        seconds
    }

    /// As long as the sites of this case take with everything measured at each.
    fn most_seconds(&self, case: &Case) -> f64 {
        self.seconds(&self.designs[&(case.sites, case.design)])
    }

    /// The visits that are over in the time of this case.
    fn in_time<'v>(&self, visits: &'v [Visit], case: &Case) -> &'v [Visit] {
        let most = self.most_seconds(case);
        let n = (0..=visits.len()).rfind(|n| self.seconds(&visits[..*n]) <= most);
        &visits[..n.unwrap_or(0)]
    }

    fn time(&self, visits: &[Visit]) -> Time {
        let times = |name| visits.iter().filter(|visit| visit.observes.contains(&name)).count();
        let measured =
            self.laboratory.outline().observes.iter().map(|o| (o.name, times(o.name))).collect();
        Time { minutes: self.seconds(visits) / 60.0, measured }
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
        let maps = Maps::new(model, self.laboratory.basis());
        let one = std::slice::from_ref(&optimum.position);
        let summary = maps.summarise(one, &Asked::default()).maps;
        let fields: Vec<Vec<f64>> =
            summary.into_iter().take(maps.n_fields()).map(|map| map.mean).collect();
        let mut tape = model.tape();
        model.forward(&mut tape, &optimum.position);
        let mended = match repaired(&maps, &tape, fields.clone(), self.laboratory.basis()) {
            // nothing to repair from: what follows from such a mode has no error, not a small one
            Err(ExperimentError::NothingPhysical) => {
                let derived = maps.derived_fields(&tape, &fields);
                let unphysical = vec![true; self.laboratory.basis().n_vertices()];
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
            time: None,
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
        let thinned = thinned(&chains, MAP_DRAWS).map_err(RunError::draws)?;
        let maps = Maps::new(model, self.laboratory.basis());
        let truths: Vec<&[f64]> = truth.maps().map(Vec::as_slice).collect();
        let asked_of_maps = Asked { truth: &truths, ..Asked::default() };
        let Summaries { maps: summary, unphysical, .. } = maps.summarise(&thinned, &asked_of_maps);
        let errors = summary.iter().zip(&truths).map(|(map, truth)| MapError {
            rmse: rms_error(&map.mean, truth),
            coverage: map.rank.as_ref().map(|rank| coverage(rank)),
        });
        Ok(Outcome {
            case,
            converged: chains.len() == asked && agree(model, &chains).map_err(RunError::draws)?,
            repaired: unphysical.iter().sum::<f64>() / unphysical.len() as f64,
            errors: errors.collect(),
            time: None,
        })
    }
}
