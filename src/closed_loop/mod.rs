//! The whole loop: a search, the model with what was found, the fits, and the errors before and after.
//!
//! [`Loop::close`] gives a [`Story`]. This is data: what was found, with its evidence, and how well
//! each model predicts what it has not seen. `eplat loop` prints it, and [`Story::write`] writes
//! its files.
//!
//! ```no_run
//! use eplat::closed_loop::{Loop, LoopSettings, LoopWatch};
//! use eplat::run::{Inputs, Loaded, Watch};
//! # fn close(model: &dyn eplat::model::Declare) -> Result<(), Box<dyn std::error::Error>> {
//! let inputs = Inputs { data: std::path::Path::new("train.csv").into(), ..Inputs::default() };
//! let loaded = Loaded::new(model, &inputs, &Watch::default())?;
//! let story = Loop::new(model, loaded, None, LoopSettings::default())?
//!     .close(None, &LoopWatch::default())?;
//! assert_eq!(story.verdict(), "Erp lacks an effect of force_g on erp_s2 and erp_s3.");
//! # Ok(())
//! # }
//! ```

mod contribution;
mod discrepancy;
mod effects;
mod error;
mod event;
mod files;
mod finding;
mod held_out;
mod kept;
mod left_out;
mod narrow;
mod page;
mod score;
mod seen;
mod sizes;
mod story;
mod words;

pub use contribution::{Contribution, Point};
pub use effects::FoundEffect;
pub use error::LoopError;
pub use event::{LoopEvent, LoopWatch};
pub use files::FITS;
pub use held_out::HeldOut;
pub use left_out::LeftOut;
pub use narrow::Narrow;
pub use sizes::Size;
pub use story::{Story, Told, Trouble};

use std::borrow::Cow;
use std::collections::BTreeMap;

use self::error::{LEAST_NULLS, LEAST_SITES};
use self::held_out::Joint;
use self::kept::KeptSearches;
use self::seen::Seen;
use self::sizes::spread;
use crate::criticism::{
    Criticism, FINER, Findings, Remembered, SearchSettings, Subject, criticise_remembering,
    rewrite, site_column,
};
use crate::infer;
use crate::manifold::{Basis, eigenpairs_cached};
use crate::model::{AddedEffect, Augmented, Declare, Discrepancy, Model};
use crate::run::{
    Ended, Event, Fit, Keep, Loaded, ModelText, Options, OutputFolder, Problem, RunError, Watch,
};
use crate::store::Checkpoint;
use crate::table::Measurements;

/// How a loop is closed.
#[derive(Clone, Debug, Default)]
pub struct LoopSettings {
    /// How the search is made. Everything else has the same seed.
    pub search: SearchSettings,
    /// How the fits are sampled.
    pub sampling: infer::Settings,
    /// Whether the eigenfunctions come from a file of the user's. Further ones of the surface can
    /// then not be computed beside them.
    pub basis_is_given: bool,
    /// Whether an interrupted loop in the output folder goes on, to the same files.
    pub resume: bool,
}

/// A model with its measurements. They are checked before anything slow is done.
pub struct Loop<'m> {
    declared: &'m dyn Declare,
    loaded: Loaded,
    joint: Option<Joint>,
    settings: LoopSettings,
}

impl std::fmt::Debug for Loop<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Loop").field("model", &self.declared.name()).finish_non_exhaustive()
    }
}

impl<'m> Loop<'m> {
    /// The loop of a model and what it is laid out on. `held_out` are measurements that play no
    /// part in the search; the errors before and after are errors at these.
    ///
    /// # Errors
    /// Too few sites or searches; sites that are held out and trained on; what does not fit between the
    /// model and the tables.
    pub fn new(
        declared: &'m dyn Declare,
        loaded: Loaded,
        held_out: Option<Measurements>,
        settings: LoopSettings,
    ) -> Result<Self, LoopError> {
        let outline = Model::outline(declared)?;
        if outline.observes.is_empty() {
            return Err(LoopError::NothingObserved { model: outline.name });
        }
        if settings.search.nulls < LEAST_NULLS {
            return Err(LoopError::TooFewNulls { nulls: settings.search.nulls });
        }
        check_sites(&loaded.measurements)?;
        if let Some(held_out) = &held_out {
            check_apart(&loaded.measurements, held_out)?;
        }
        let joint = held_out.map(|held_out| Joint::new(declared, &loaded, held_out));
        Ok(Self { declared, joint: joint.transpose()?, loaded, settings })
    }

    /// Closes the loop: searches, samples the models, and compares their errors. Up to three models
    /// are sampled:
    ///
    /// - the model *as written*, always;
    /// - the model *before*, in which sites and measurements differ as they do in the search, if
    ///   something is found or the intervals of the model as written are too narrow;
    /// - the model *after*, which has what was found too, if something is found.
    ///
    /// With a folder the fits are written to its folders `declared`, `before` and `after`.
    ///
    /// # Errors
    /// A model that cannot be criticised or sampled; [`LoopError::Stopped`].
    pub fn close(
        self,
        out: Option<&OutputFolder>,
        watch: &LoopWatch<'_>,
    ) -> Result<Story, LoopError> {
        let kept = out.map(|out| KeptSearches::open(&self, out)).transpose()?;
        let criticism = self.search(kept.as_ref(), watch).or_else(|error| match out {
            // what cannot be criticised cannot be gone on with
            Some(out) if !matches!(error, LoopError::Stopped) => {
                kept::forget(out).map_err(LoopError::from).and(Err(error))
            }
            _ => Err(error),
        })?;
        let effects = effects::found(self.declared, &criticism, &self.loaded.measurements)?;
        if let Some(out) = out {
            files::clear(out)?;
        }
        let declared = self.sample(self.declared, "declared", None, out, watch)?;
        let mut seen = Seen::new(&self, &criticism, &declared)?;
        let narrow = Narrow::of(&seen.first(&criticism));
        let discrepancy = self.discrepancy(&criticism, narrow.is_some())?;
        let added: Vec<AddedEffect> = effects.iter().map(|(effect, ..)| effect.clone()).collect();
        let with = |effects: &[AddedEffect]| {
            Augmented::new(self.declared, effects).with_discrepancy(discrepancy.clone())
        };
        let (plain, augmented) =
            (with(&[]), with(&added).with_outliers(criticism.last.outer.outliers));
        let outliers = criticism.last.outer.outliers;
        let whys = effects.iter().map(|(effect, _, why)| (effect.clone(), why.clone())).collect();
        let findings =
            Findings { discrepancy: discrepancy.clone(), effects: vec![], outliers: None };
        let before = (!discrepancy.is_empty()).then(|| {
            let text = self.rewritten(&findings)?;
            self.sample(&plain, "before", text, out, watch)
        });
        let before = before.transpose()?;
        let is_found = !added.is_empty() || outliers.is_some();
        let after = is_found.then(|| {
            let text = self.rewritten(&Findings { effects: whys, outliers, ..findings })?;
            self.sample(&augmented, "after", text, out, watch)
        });
        let after = after.transpose()?;
        seen.predict(&self, before.as_deref(), after.as_deref())?;
        let table = &self.loaded.measurements;
        let (mut found, mut contribution) = (vec![], None);
        if let Some(fit) = after.as_deref() {
            for (effect, cause, why) in effects {
                let size = Size::of(&effect, fit, table)?;
                found.push(FoundEffect { cause, effect, why, size });
            }
            contribution = Contribution::of(&found, fit, table)?;
        }
        Ok(Story {
            effects: found,
            contribution,
            narrow,
            spread: after
                .as_ref()
                .or(before.as_ref())
                .map_or(vec![], |fit| spread(&discrepancy, fit)),
            declared: Told::of("declared", &declared),
            before: before.as_deref().map(|fit| Told::of("before", fit)),
            after: after.as_deref().map(|fit| Told::of("after", fit)),
            discrepancy,
            held_out: seen.held_out,
            left: seen.left,
            left_units: seen.left_units,
            criticism,
            loaded: self.loaded,
        })
    }

    /// What sites and measurements differ by. It is needed where something is found, where they
    /// differ by more than the model says, or where the intervals of the model are too narrow.
    fn discrepancy(
        &self,
        criticism: &Criticism,
        is_narrow: bool,
    ) -> Result<Discrepancy, LoopError> {
        if criticism.found().is_empty() && !criticism.is_unexplained() && !is_narrow {
            return Ok(Discrepancy::default());
        }
        let held_out = self.joint.as_ref().map(Joint::held_out);
        discrepancy::discrepancy(self.declared, criticism, &self.loaded.measurements, held_out)
    }

    fn search(
        &self,
        kept: Option<&KeptSearches>,
        watch: &LoopWatch<'_>,
    ) -> Result<Criticism, LoopError> {
        let basis = self.finer_basis()?;
        let table = &self.loaded.measurements;
        let subject = Subject { model: self.declared, basis: basis.as_deref(), table };
        let threads = self.settings.sampling.threads;
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
        let remembered: &dyn Remembered = kept.map_or(&(), |kept| kept);
        let settings = &self.settings.search;
        let search =
            || criticise_remembering(&subject, settings, &|at| watch.search(at), remembered);
        let criticism = pool.install(search)?;
        watch.tell(&LoopEvent::Searched);
        Ok(criticism)
    }

    /// More modes than the model has. They tell what the model's modes cannot follow from what no
    /// field explains. If the basis comes from elsewhere, all its modes are taken.
    fn finer_basis(&self) -> Result<Option<Cow<'_, Basis>>, LoopError> {
        let Some(domain) = &self.loaded.domain else { return Ok(None) };
        if self.settings.basis_is_given {
            return Ok(Some(Cow::Borrowed(&domain.basis)));
        }
        let most = domain.surface.mesh.n_vertices() - 1;
        let n_modes = (FINER * domain.basis.n_modes()).min(most);
        Ok(Some(Cow::Owned(eigenpairs_cached(&domain.surface.mesh, n_modes)?)))
    }

    /// The model's text with what was found, if the model has one.
    fn rewritten(&self, findings: &Findings) -> Result<Option<ModelText>, LoopError> {
        let Some(model) = &self.loaded.origin.model else { return Ok(None) };
        let name = || self.declared.name().to_owned();
        let text = rewrite(&model.text, findings)
            .map_err(|mistake| LoopError::ModelText { name: name(), mistake: mistake.message })?;
        Ok(Some(ModelText { text, path: None }))
    }

    /// Samples a model, in the folder of the fit if there is one. `text` is its text, if that is not
    /// the one that was loaded.
    fn sample<'d>(
        &self,
        declared: &'d dyn Declare,
        which: &'static str,
        text: Option<ModelText>,
        out: Option<&OutputFolder>,
        watch: &LoopWatch<'_>,
    ) -> Result<Box<Fit<'d>>, LoopError> {
        watch.tell(&LoopEvent::Sample { which });
        let mut loaded = self.loaded.clone();
        if let Some(text) = text {
            loaded.is_of(text);
        }
        let problem = Problem::new(declared, loaded)?;
        let on_event = |event: &Event<'_>| watch.tell(&LoopEvent::Fit(event));
        let watch = Watch { on_event: &on_event, stop: watch.stop };
        // sites are left out as a whole, not rows
        let options = Options { watch, weights_only: true, ..Options::default() };
        let settings =
            infer::Settings { seed: self.settings.search.seed, ..self.settings.sampling.clone() };
        let Some(out) = out else {
            return Ok(Box::new(problem.fit_with(&settings, &options)?));
        };
        let folder = OutputFolder::open(out.file(which))?;
        let has_begun =
            Checkpoint::identity(&folder.checkpoint()).map_err(RunError::from)?.is_some();
        let resume = self.settings.resume && has_begun;
        let keep = Keep { resume, stays: true, ..Keep::default() };
        match problem.run_into(&folder, &settings, &options, &keep)? {
            Ended::Now(fit, _) => Ok(fit),
            Ended::Before | Ended::Stopped => Err(LoopError::Stopped),
        }
    }
}

/// The sites of a table by name, each with one of its rows. `column` is the column that names them.
fn sites(table: &Measurements, column: Option<&str>) -> BTreeMap<String, usize> {
    let site = |row: usize| match column {
        Some(column) => table.cell(row, column).unwrap_or_default().to_owned(),
        None => row.to_string(),
    };
    (0..table.len()).map(|row| (site(row), row)).collect()
}

/// Refuses a table with too few sites.
fn check_sites(table: &Measurements) -> Result<(), LoopError> {
    let n = sites(table, site_column(table)).len();
    if n >= LEAST_SITES {
        return Ok(());
    }
    Err(LoopError::TooFewSites { file: table.file().into(), n })
}

/// Refuses sites that would be predicted from their own measurements.
fn check_apart(train: &Measurements, held_out: &Measurements) -> Result<(), LoopError> {
    let Some(column) = site_column(train).filter(|column| held_out.has(column)) else {
        return Ok(());
    };
    let own = sites(train, Some(column));
    let both = sites(held_out, Some(column)).into_iter().find(|(site, _)| own.contains_key(site));
    let Some((site, row)) = both else { return Ok(()) };
    let (file, line, train) = (held_out.file().into(), held_out.line(row), train.file().into());
    Err(LoopError::NotApart { file, line, column, site, train })
}
