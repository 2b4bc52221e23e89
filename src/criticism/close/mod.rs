//! The whole loop: a search, the model with what was found, both fits, and the errors before and after.
//!
//! [`Loop::close`] gives a [`Story`], which is data: what was found, with its evidence, and how well each
//! model predicts what it has not seen. `eplat loop` prints it; [`Story::write`] writes its files.
//!
//! ```no_run
//! use eplat::criticism::{Loop, LoopSettings, LoopWatch};
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

mod effects;
mod error;
mod event;
mod files;
mod finding;
mod held_out;
mod left_out;
mod page;
mod score;
mod sizes;
mod story;
mod words;

pub use effects::FoundEffect;
pub use error::LoopError;
pub use event::{LoopEvent, LoopWatch};
pub use held_out::HeldOut;
pub use left_out::LeftOut;
pub use sizes::Size;
pub use story::{Story, Told};

use std::borrow::Cow;
use std::collections::BTreeMap;

use self::error::{LEAST_NULLS, LEAST_SITES};
use self::held_out::Joint;
use super::{Criticism, FINER, SearchSettings, Subject, criticise, site_column};
use crate::infer;
use crate::manifold::{Basis, eigenpairs_cached};
use crate::model::{AddedEffect, Augmented, Declare, Model};
use crate::run::{Ended, Event, Fit, Keep, Loaded, Options, OutputFolder, Problem, Watch};
use crate::table::Measurements;

/// How a loop is closed.
#[derive(Clone, Debug, Default)]
pub struct LoopSettings {
    /// The search. Its seed is that of everything else too.
    pub search: SearchSettings,
    /// Both fits.
    pub sampling: infer::Settings,
    /// Whether the eigenfunctions come from elsewhere, so that no further ones of the surface can be
    /// computed beside them.
    pub basis_is_given: bool,
}

/// A model with its measurements, checked before anything slow is done.
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
    /// Of a model and what it is laid out on. `held_out` are measurements that play no part in the search:
    /// the error before and after is theirs.
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

    /// Closes it: searches, samples the model before and after, and compares their errors. With a folder the
    /// fits are written to its folders `before` and `after`.
    ///
    /// # Errors
    /// A model that cannot be criticised or sampled; [`LoopError::Stopped`].
    pub fn close(
        self,
        out: Option<&OutputFolder>,
        watch: &LoopWatch<'_>,
    ) -> Result<Story, LoopError> {
        let criticism = self.search(watch)?;
        let effects = effects::found(self.declared, &criticism, &self.loaded.measurements)?;
        let before = self.sample(self.declared, "before", out, watch)?;
        let added: Vec<AddedEffect> = effects.iter().map(|(effect, ..)| effect.clone()).collect();
        let augmented =
            Augmented::new(self.declared, &added).with_outliers(criticism.last.outer.outliers);
        let after = if added.is_empty() && criticism.last.outer.outliers.is_none() {
            None
        } else {
            Some(self.sample(&augmented, "after", out, watch)?)
        };
        let seed = self.settings.search.seed;
        let held_out = self
            .joint
            .as_ref()
            .map(|joint| joint.predict(&self.loaded, &criticism, &before, after.as_deref(), seed));
        let told = after.as_deref().map(Told::of);
        let effects = effects.into_iter().filter_map(|(effect, cause, why)| {
            let size = Size::of(&effect, after.as_deref()?, &self.loaded.measurements);
            Some(FoundEffect { cause, effect, why, size })
        });
        Ok(Story {
            effects: effects.collect(),
            before: Told::of(&before),
            after: told,
            held_out: held_out.transpose()?,
            left: LeftOut::sites(&criticism, seed),
            left_units: LeftOut::units(&criticism, seed),
            criticism,
            loaded: self.loaded,
        })
    }

    fn search(&self, watch: &LoopWatch<'_>) -> Result<Criticism, LoopError> {
        let basis = self.finer_basis()?;
        let table = &self.loaded.measurements;
        let subject = Subject { model: self.declared, basis: basis.as_deref(), table };
        let threads = self.settings.sampling.threads;
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
        let search = || criticise(&subject, &self.settings.search, &|at| watch.search(at));
        let criticism = pool.install(search)?;
        watch.tell(&LoopEvent::Searched);
        Ok(criticism)
    }

    /// More modes than the model has, to tell what these cannot follow from what no field explains; of a
    /// basis from elsewhere all that are there.
    fn finer_basis(&self) -> Result<Option<Cow<'_, Basis>>, LoopError> {
        let Some(domain) = &self.loaded.domain else { return Ok(None) };
        if self.settings.basis_is_given {
            return Ok(Some(Cow::Borrowed(&domain.basis)));
        }
        let most = domain.surface.mesh.n_vertices() - 1;
        let n_modes = (FINER * domain.basis.n_modes()).min(most);
        Ok(Some(Cow::Owned(eigenpairs_cached(&domain.surface.mesh, n_modes)?)))
    }

    /// Samples a model, in the folder of the fit if there is one.
    fn sample<'d>(
        &self,
        declared: &'d dyn Declare,
        which: &'static str,
        out: Option<&OutputFolder>,
        watch: &LoopWatch<'_>,
    ) -> Result<Box<Fit<'d>>, LoopError> {
        watch.tell(&LoopEvent::Sample { which });
        let problem = Problem::new(declared, self.loaded.clone())?;
        let on_event = |event: &Event<'_>| watch.tell(&LoopEvent::Fit(event));
        let watch = Watch { on_event: &on_event, stop: watch.stop };
        let options = Options { watch, ..Options::default() };
        let settings =
            infer::Settings { seed: self.settings.search.seed, ..self.settings.sampling.clone() };
        let Some(out) = out else {
            return Ok(Box::new(problem.fit_with(&settings, &options)?));
        };
        let folder = OutputFolder::open(out.file(which))?;
        match problem.run_into(&folder, &settings, &options, &Keep::default())? {
            Ended::Now(fit, _) => Ok(fit),
            Ended::Before | Ended::Stopped => Err(LoopError::Stopped),
        }
    }
}

/// The sites of a table by name, each with a row; `column` names them.
fn sites(table: &Measurements, column: Option<&str>) -> BTreeMap<String, usize> {
    let site = |row: usize| match column {
        Some(column) => table.cell(row, column).unwrap_or_default().to_owned(),
        None => row.to_string(),
    };
    (0..table.len()).map(|row| (site(row), row)).collect()
}

/// Complains about too few sites.
fn check_sites(table: &Measurements) -> Result<(), LoopError> {
    let n = sites(table, site_column(table)).len();
    if n >= LEAST_SITES {
        return Ok(());
    }
    Err(LoopError::TooFewSites { file: table.file().into(), n })
}

/// Complains about sites that would be predicted from themselves.
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
