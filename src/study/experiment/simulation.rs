//! The paced atrium with the true fields, and with their posterior means.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::time::Duration;

use crate::ep::surface::BeatMap;
use crate::mesh::{Surface, write_vtp};
use crate::run;
use crate::run::atrium::{
    Atrium, AtriumError, AtriumRecord, AtriumSettings, Beat, Begin, Ended, Event, Ground, Map,
    PacingSettings, Resume, Source, TissueSettings, Watch,
};
use crate::store::Identity;
use crate::study::Recovery;

/// Fronts need vertices no farther apart than this, mm.
const EDGE: f64 = 0.4;
/// Least time between two savings of a simulation.
const EVERY: Duration = Duration::from_secs(10);
/// The fields that are simulated: the true ones, and the means of the posterior.
const BOTH: [&str; 2] = ["true", "mean"];

/// How the atrium is paced with what was recovered.
#[derive(Clone, Debug)]
pub struct SimulationPlan {
    /// Beats, 600 ms apart; the last is measured.
    pub beats: u32,
    /// Vertex that is paced, counted from 0 as in the surface's file; without it one at the rim of the
    /// widest opening.
    pub pace: Option<usize>,
    /// How often every triangle is cut into four; without it until vertices are 0.4 mm apart.
    pub refine: Option<u32>,
}

/// What the two simulations gave.
#[derive(Clone, Debug)]
pub struct Simulated {
    /// Maps at the vertices before they were refined: each map of the beat for the truth and for the mean,
    /// and mean less truth.
    pub maps: Vec<Map>,
    /// Records of the truth and of the mean; the latter has the comparison.
    pub records: [AtriumRecord; 2],
}

/// What happens during the two simulations.
#[derive(Clone, Copy, Debug)]
pub enum SimulationEvent<'a> {
    /// The one with the `true` or the `mean` fields begins.
    Begins(&'static str, &'a Atrium),
    /// It is under way.
    Goes(Event<'a>),
    /// It was complete before, in this folder.
    WasComplete(&'a Path),
    /// It came to its end, in this folder.
    Ends(&'a Atrium, &'a Beat, &'a Path),
}

/// Who is told how an experiment goes, and may stop it.
#[derive(Clone, Copy)]
pub struct ExperimentWatch<'a> {
    /// Told of the calibration; its flag stops the simulations too.
    pub run: run::Watch<'a>,
    /// Told of the simulations.
    pub on_simulation: &'a (dyn Fn(SimulationEvent<'_>) + Sync),
}

impl Default for ExperimentWatch<'_> {
    /// Hears nothing and never stops it.
    fn default() -> Self {
        Self { run: run::Watch::default(), on_simulation: &|_| () }
    }
}

impl std::fmt::Debug for ExperimentWatch<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ExperimentWatch").field("run", &self.run).finish_non_exhaustive()
    }
}

impl SimulationPlan {
    /// What the results depend on.
    pub(super) fn identity(&self) -> Identity {
        let text = |value: Option<String>| value.unwrap_or_else(|| "default".to_owned());
        Identity::from([
            ("beats".to_owned(), self.beats.to_string()),
            ("pace".to_owned(), text(self.pace.map(|v| v.to_string()))),
            ("refine".to_owned(), text(self.refine.map(|n| n.to_string()))),
        ])
    }

    /// The vertex of the surface that is paced.
    ///
    /// # Errors
    /// [`AtriumError::NoVertex`].
    pub(super) fn vertex(&self, surface: &Surface) -> Result<u32, AtriumError> {
        let Some(vertex) = self.pace else {
            let loops = surface.mesh.boundary_loops();
            let widest = loops.iter().max_by_key(|rim| rim.len());
            return Ok(widest.and_then(|rim| rim.first().copied()).unwrap_or(0));
        };
        let n_vertices = surface.n_source_vertices;
        surface.vertex_of_source(vertex).ok_or(AtriumError::NoVertex { vertex, n_vertices })
    }

    /// Settings of one of the two simulations, of fields as [`tissue`] names them.
    fn settings(&self, which: &str, surface: &Surface) -> Result<AtriumSettings, AtriumError> {
        let halvings = (surface.mesh.mean_edge_length() / EDGE).log2().ceil().max(0.0);
        let field = |name: &str| Source::Field(format!("{name}_{which}"));
        Ok(AtriumSettings {
            tissue: TissueSettings {
                refine: self.refine.unwrap_or(halvings as u32),
                cv_max: Source::Field("cv_max".to_owned()),
                tau_out: field("tau_out"),
                apd_max: field("apd_max"),
                ..TissueSettings::default()
            },
            pacing: PacingSettings {
                pace: vec![self.vertex(surface)? as usize],
                beats: self.beats,
                ..PacingSettings::default()
            },
            ..AtriumSettings::default()
        })
    }

    /// Simulates what is not simulated yet in `folder`; `None` if interrupted. `fields` are `CV_max`
    /// (n_vertices, m/s) and what was recovered.
    ///
    /// # Errors
    /// [`AtriumError`].
    pub(super) fn simulate(
        &self,
        surface: &Surface,
        fields: (&[f64], &Recovery),
        folder: &Path,
        watch: ExperimentWatch<'_>,
    ) -> Result<Option<Simulated>, AtriumError> {
        fs::create_dir_all(folder).map_err(AtriumError::io("write", folder))?;
        let ground = ground(surface, fields, &folder.join("tissue.vtp"))?;
        let folders = BOTH.map(|which| folder.join(which));
        let mut beats = vec![];
        for (which, to) in BOTH.into_iter().zip(&folders) {
            let mut settings = self.settings(which, surface)?;
            settings.compare = (which == "mean").then(|| folders[0].join("beat.vtp"));
            let atrium = Atrium::new(ground.clone(), &settings)?;
            (watch.on_simulation)(SimulationEvent::Begins(which, &atrium));
            let goes = |event: Event<'_>| (watch.on_simulation)(SimulationEvent::Goes(event));
            let control = Watch { stop: watch.run.stop, on_event: &goes };
            let begin = Begin { resume: Resume::IfBegun, every: EVERY };
            beats.push(match atrium.simulate_into(to, begin, control)? {
                Ended::Interrupted => return Ok(None),
                Ended::Before => {
                    (watch.on_simulation)(SimulationEvent::WasComplete(to));
                    Beat::read(to)?
                }
                Ended::Now(beat) => {
                    (watch.on_simulation)(SimulationEvent::Ends(&atrium, &beat, to));
                    *beat
                }
            });
        }
        let [truth, mean] = [beats.swap_remove(0), beats.swap_remove(0)];
        Ok(Some(Simulated::of(truth, mean, surface.mesh.n_vertices())))
    }
}

/// The surface with the parameters of both simulations; it is left in `file` for whoever wants to repeat
/// them.
fn ground(
    surface: &Surface,
    (cv_max, recovery): (&[f64], &Recovery),
    file: &Path,
) -> Result<Ground, AtriumError> {
    let mut fields = vec![("cv_max".to_owned(), cv_max)];
    for map in &recovery.maps {
        fields.push((format!("{}_true", map.name), &map.truth));
        fields.push((format!("{}_mean", map.name), &map.mean));
    }
    let data: Vec<(&str, &[f64])> = fields.iter().map(|(n, v)| (n.as_str(), *v)).collect();
    write_vtp(file, &surface.mesh, &data)?;
    let data: BTreeMap<String, Vec<f64>> =
        fields.into_iter().map(|(name, values)| (name, values.to_vec())).collect();
    Ground::of(Surface::new(surface.mesh.clone(), data)).with_hash("hash of the surface", file)
}

impl Simulated {
    fn of(truth: Beat, mean: Beat, n_vertices: usize) -> Self {
        let records = [truth.record, mean.record];
        // the vertices of the refined mesh begin with those it was made of
        let coarse = |maps: &[Map], name: &str| -> Vec<f64> {
            let map = maps.iter().find(|map| map.0 == name);
            map.map_or_else(Vec::new, |map| map.1[..n_vertices].to_vec())
        };
        let mut maps = vec![];
        for name in BeatMap::NAMES {
            let (truth, mean) = (coarse(&truth.maps, name), coarse(&mean.maps, name));
            let difference = mean.iter().zip(&truth).map(|(mean, truth)| mean - truth).collect();
            maps.push((format!("{name}_true"), truth));
            maps.push((format!("{name}_mean"), mean));
            maps.push((format!("{name}_difference"), difference));
        }
        Self { maps, records }
    }
}
