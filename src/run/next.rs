//! Where to measure next, and what: candidates ranked by what they would teach per minute.

use std::fmt::Write as _;
use std::path::Path;

use super::{Fit, Problem, RunError};
use crate::experiment::{Lesson, Minutes, agree, lessons};
use crate::manifold::maximin;
use crate::mesh::{Surface, TriMesh};
use crate::store::write_file;

/// Choices that are printed.
const SHOWN: usize = 10;
/// Draws that covariances are made of.
const DRAWS: usize = 1000;

/// Which further measurements are considered.
#[derive(Clone, Debug)]
pub struct Candidates {
    /// Number of sites, spread over the surface.
    pub n_sites: usize,
    /// Distance that they keep from openings, mm.
    pub exclude: f64,
    /// Width of the bracket of a further measurement, in its unit.
    pub resolution: f64,
    /// How long it takes to move to a site, and to measure there; 1 minute for a protocol that is not
    /// named.
    pub minutes: Minutes,
    /// Seed of the sites.
    pub seed: u64,
}

/// Further measurements, those first that are expected to teach most per minute.
#[derive(Debug)]
pub struct Ranking {
    /// Minutes that each takes, moving included, and what it would teach.
    pub choices: Vec<(f64, Lesson)>,
    /// Whether the chains agree; if not, the ranking is not to be relied on.
    pub is_reliable: bool,
    source_vertex: Vec<u32>,
    /// At the choices, in the unit of the mesh's file.
    points: Vec<[f64; 3]>,
}

impl Fit<'_> {
    /// Ranks further measurements by the share of the posterior variance (of the derived quantities, over
    /// the surface) that they are expected to take away per minute.
    ///
    /// # Errors
    /// [`RunError::NoField`]; [`RunError::NoProtocol`]; [`RunError::Manifold`] where the sites cannot be
    /// placed; [`RunError::Experiment`] for a model that does not predict one value at a place alone;
    /// [`RunError::Draws`].
    pub fn next(&self, candidates: &Candidates) -> Result<Ranking, RunError> {
        let Some(domain) = &self.problem.loaded().domain else { return Err(RunError::NoField) };
        let Candidates { n_sites, exclude, resolution, seed, .. } = *candidates;
        let minutes = candidates.minutes_of(&self.problem)?;
        let sites = maximin(&domain.surface.mesh, n_sites, exclude, seed)?;
        let (declared, model, draws) =
            (self.problem.declared(), self.model(), self.thinned(DRAWS)?);
        let found = lessons(declared, model, &domain.basis, &draws, &sites, resolution)?;
        let timed = |lesson: Lesson| (minutes.moving + minutes.measuring(&lesson.observes), lesson);
        let mut choices: Vec<(f64, Lesson)> = found.into_iter().map(timed).collect();
        choices.sort_by(|a, b| (b.1.gain / b.0).total_cmp(&(a.1.gain / a.0)));
        let is_reliable = agree(model, self.chains()).map_err(RunError::draws)?;
        Ok(Ranking::new(choices, is_reliable, &domain.surface, domain.scale))
    }
}

impl Candidates {
    /// Complains about what `problem` cannot be asked; [`Fit::next`] does so too, after the fit.
    ///
    /// # Errors
    /// [`RunError::NoField`], [`RunError::NoProtocol`].
    pub fn check(&self, problem: &Problem<'_>) -> Result<(), RunError> {
        if problem.loaded().domain.is_none() {
            return Err(RunError::NoField);
        }
        self.minutes_of(problem).map(|_| ())
    }

    /// How long everything takes that the model observes.
    fn minutes_of(&self, problem: &Problem<'_>) -> Result<Minutes, RunError> {
        let observes = problem.model().observes.iter();
        let known: Vec<String> = observes.map(|observe| observe.name.to_string()).collect();
        let mut minutes = self.minutes.clone();
        if let Some(name) = minutes.protocols.keys().find(|name| !known.contains(name)) {
            return Err(RunError::NoProtocol { name: name.clone(), known });
        }
        for name in known {
            minutes.protocols.entry(name).or_insert(1.0);
        }
        Ok(minutes)
    }
}

impl Ranking {
    fn new(choices: Vec<(f64, Lesson)>, is_reliable: bool, on: &Surface, scale: f64) -> Self {
        let place = |mesh: &TriMesh, vertex: u32| mesh.vertices()[vertex as usize];
        let points =
            choices.iter().map(|(_, l)| place(&on.mesh, l.vertex).map(|x| x / scale)).collect();
        let source = choices.iter().map(|(_, l)| on.source_vertex[l.vertex as usize]).collect();
        Self { choices, is_reliable, source_vertex: source, points }
    }

    /// The best choices as a table.
    pub fn text(&self) -> String {
        let mut text =
            String::from("vertex  variance  minutes  per minute  measure there (predicted)");
        for (vertex, (minutes, lesson)) in self.source_vertex.iter().zip(&self.choices).take(SHOWN)
        {
            let Lesson { observes, gain, predicted, .. } = lesson;
            let what: Vec<String> = observes
                .iter()
                .zip(predicted)
                .map(|(name, (mean, sd))| format!("{name} ({mean:.0} ± {sd:.0})"))
                .collect();
            let _ = write!(
                text,
                "\n{vertex:>6}  {:>7.2}%  {minutes:>7}  {:>9.2}%  {}",
                -100.0 * gain,
                -100.0 * gain / minutes,
                what.join(", ")
            );
        }
        text
    }

    /// Writes every choice as a CSV file, best first.
    ///
    /// # Errors
    /// [`RunError::Write`].
    pub fn write(&self, path: &Path) -> Result<(), RunError> {
        let header = ["vertex", "x", "y", "z", "protocols", "variance_share", "minutes"];
        write_file(path, |file| {
            let mut table = csv::Writer::from_writer(file);
            table.write_record(header)?;
            let places = self.source_vertex.iter().zip(&self.points);
            for ((vertex, point), (minutes, lesson)) in places.zip(&self.choices) {
                let [x, y, z] = point.map(|x| x.to_string());
                table.write_record([
                    vertex.to_string(),
                    x,
                    y,
                    z,
                    lesson.observes.join("+"),
                    lesson.gain.to_string(),
                    minutes.to_string(),
                ])?;
            }
            table.flush()
        })
        .map_err(RunError::write(path))
    }
}
