//! What a simulation gives, and one set of parameters simulated.

use std::path::Path;
use std::time::Instant;

use super::drive::{Drive, Event, Slot, Watch};
use super::series::{self, Series};
use super::setup::Subject;
use super::{Atrium, AtriumError, AtriumRecord, Map, Summary};
use crate::ep::cell::RANGES;
use crate::ep::surface::Simulation;
use crate::ep::{Parameters, Precision};

/// What a simulation gave.
#[derive(Clone, Debug)]
pub struct Beat {
    /// Of one simulation the five parameters, then LAT and APD of the measured beat (ms); of several
    /// their means and standard deviations. Then, if an earlier simulation was named, the differences.
    pub maps: Vec<Map>,
    /// The same in a few numbers.
    pub record: AtriumRecord,
}

impl Atrium {
    /// Simulates, in memory alone. `None` if it was stopped.
    ///
    /// # Errors
    /// [`AtriumError::Surface`] for a simulation that diverges.
    pub fn simulate(&self, watch: Watch<'_>) -> Result<Option<Beat>, AtriumError> {
        let begun = Instant::now();
        let found = self.found(&Drive { checkpoint: None, watch }, None)?;
        Ok(found.map(|(maps, summary)| self.beat(maps, summary, begun.elapsed().as_secs_f64())))
    }

    /// Maps and their summary; `None` if interrupted. A series of V goes to the folder `out`.
    pub(super) fn found(
        &self,
        drive: &Drive<'_>,
        out: Option<&Path>,
    ) -> Result<Option<(Vec<Map>, Summary)>, AtriumError> {
        match (&self.subject, self.settings.numerics.double) {
            (Subject::Posterior(posterior), false) => posterior.simulate::<f32>(self, drive),
            (Subject::Posterior(posterior), true) => posterior.simulate::<f64>(self, drive),
            (Subject::Given(given), false) => self.once::<f32>(given, drive, out),
            (Subject::Given(given), true) => self.once::<f64>(given, drive, out),
        }
    }

    /// The result, compared with an earlier simulation if one was named.
    pub(super) fn beat(&self, mut maps: Vec<Map>, summary: Summary, seconds: f64) -> Beat {
        let mut record = AtriumRecord::new(self, summary, seconds);
        if let Some(earlier) = &self.earlier {
            let (differences, compared) = earlier.compare(&maps);
            maps.extend(differences);
            record.compared = compared;
        }
        Beat { maps, record }
    }

    fn once<F: Precision>(
        &self,
        parameters: &[Parameters],
        drive: &Drive<'_>,
        out: Option<&Path>,
    ) -> Result<Option<(Vec<Map>, Summary)>, AtriumError> {
        let mut simulation = self.begin::<F>(parameters)?;
        let series = out.map(|out| Series::new(self, &out.join("checkpoint"), drive.goes_on()));
        let mut series = series.transpose()?.flatten();
        let mut each = |simulation: &Simulation<F>| {
            (drive.watch.on_event)(Event::Time(simulation.time()));
            series.as_mut().map_or(Ok(()), |series| series.take(self, simulation))
        };
        let kept = drive.kept(0)?;
        if !drive.run(Slot { slot: 0, draw: 0 }, &mut simulation, kept, &mut each)? {
            return Ok(None);
        }
        if let Some(out) = out {
            AtriumRecord::remove(out)?;
            series::replace(series.as_ref(), out)?;
        }
        let beat = simulation.beat();
        let activated = beat.lat.iter().copied().filter(|t| t.is_finite());
        let summary = Summary::One {
            activated_vertices: activated.clone().count(),
            latest_activation_ms: activated.fold(0.0, f64::max),
        };
        let column = |k: usize| parameters.iter().map(|p| p.to_array()[k]).collect();
        let names = RANGES.iter().enumerate();
        let mut maps: Vec<Map> =
            names.map(|(k, (name, ..))| ((*name).to_owned(), column(k))).collect();
        maps.extend(beat.named().map(|(name, values)| (name.to_owned(), values)));
        Ok(Some((maps, summary)))
    }
}
