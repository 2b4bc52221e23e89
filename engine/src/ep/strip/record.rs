//! When each node activates and recovers, and what follows from it: CV and APD.

use super::grid::MIDDLE_HALF_WIDTH;
use super::lanes::{LANES, Lane};
use super::{Absence, Beat, Grid};

/// V at which an upstroke counts as activation.
const ACTIVATION: f64 = 0.7;

/// V at which a downstroke counts as recovery to 20, 30, 50 and 90 %.
const RECOVERY: [f64; 4] = [0.8, 0.7, 0.5, 0.1];

/// The last activation of every node and, for the first `D` levels, its last recovery, in steps since
/// the stimulus.
#[derive(Debug)]
pub(super) struct Recorder<const D: usize> {
    activation: Vec<[Option<f64>; LANES]>,
    recovery: Vec<[[Option<f64>; D]; LANES]>,
    /// Nodes of each strip that have activated.
    pub(super) n_activated: [usize; LANES],
    /// Step from which a strip's crossings count.
    pub(super) start: [usize; LANES],
}

/// What a beat needs.
pub(super) type BeatRecorder = Recorder<{ RECOVERY.len() }>;

impl<const D: usize> Recorder<D> {
    /// Records crossings of lane `k` from step `start[k]` on.
    pub(super) fn new(n_nodes: usize, start: [usize; LANES]) -> Self {
        Self {
            activation: vec![[None; LANES]; n_nodes],
            recovery: vec![[[None; D]; LANES]; n_nodes],
            n_activated: [0; LANES],
            start,
        }
    }

    /// Forgets lane `k`, whose crossings count from step `start` on.
    pub(super) fn restart(&mut self, k: usize, start: usize) {
        for (activation, recovery) in self.activation.iter_mut().zip(&mut self.recovery) {
            (activation[k], recovery[k]) = (None, [None; D]);
        }
        (self.n_activated[k], self.start[k]) = (0, start);
    }

    /// Looks for crossings in the step that leads from `before` to `after`.
    #[allow(clippy::needless_bitwise_bool, reason = "without branches it becomes vector code")]
    #[inline(always)]
    pub(super) fn observe(&mut self, before: &[Lane], after: &[Lane], index: usize) {
        for (i, (a, b)) in before.iter().zip(after).enumerate() {
            let mut crossed = false;
            for k in 0..LANES {
                crossed |= (a[k] < ACTIVATION) & (b[k] >= ACTIVATION);
                for level in &RECOVERY[..D] {
                    crossed |= (a[k] > *level) & (b[k] <= *level);
                }
            }
            if crossed {
                self.note(i, a, b, index);
            }
        }
    }

    /// Notes the crossings of node `i`, linear in time within the step.
    #[cold]
    fn note(&mut self, i: usize, before: &Lane, after: &Lane, index: usize) {
        for k in 0..LANES {
            if index < self.start[k] {
                continue;
            }
            let (a, b) = (before[k], after[k]);
            let time = |level: f64| Some(index as f64 + (level - a) / (b - a));
            if a < ACTIVATION && b >= ACTIVATION {
                self.n_activated[k] += usize::from(self.activation[i][k].is_none());
                self.activation[i][k] = time(ACTIVATION);
            }
            for (recovery, &level) in self.recovery[i][k].iter_mut().zip(&RECOVERY) {
                if a > level && b <= level {
                    *recovery = time(level);
                }
            }
        }
    }
}

impl BeatRecorder {
    /// CV and APD of strip `lane`, if every node activated and then recovered.
    pub(super) fn beat(&self, lane: usize, grid: &Grid) -> Result<Beat, Absence> {
        let mut nodes = Vec::with_capacity(self.activation.len());
        for (activation, recovery) in self.activation.iter().zip(&self.recovery) {
            let lat = activation[lane].ok_or(Absence::NoActivation)?;
            let after = |end: Option<f64>| end.filter(|&end| end > lat);
            let [apd20, apd30, apd50, apd90] =
                recovery[lane].map(|end| after(end).map(|end| (end - lat) * grid.dt));
            let apd90 = apd90.ok_or(Absence::NoRecovery)?;
            nodes.push(Node { lat: lat * grid.dt, early: [apd20, apd30, apd50], apd90 });
        }
        Ok(measure(&nodes, grid))
    }
}

/// One node in one beat, ms.
struct Node {
    lat: f64,
    /// APD20, APD30 and APD50, if V was ever above.
    early: [Option<f64>; 3],
    apd90: f64,
}

/// CV (inverse least-squares slope of LAT) and mean APD over the middle of the strip.
fn measure(nodes: &[Node], grid: &Grid) -> Beat {
    let (middle, columns) = (0.5 * grid.length(), grid.columns());
    let (mut n, mut sum_x, mut sum_lat, mut sum_apd) = (0.0, 0.0, 0.0, 0.0);
    let (mut sum_xx, mut sum_xlat, mut sum_early) = (0.0, 0.0, [Some(0.0); 3]);
    for (i, node) in nodes.iter().enumerate() {
        let x = (i / columns) as f64 * grid.spacing - middle;
        if x.abs() < MIDDLE_HALF_WIDTH - 1e-9 {
            // A folded node stands for two, one in the middle column for itself.
            let w = if i % columns == columns - 1 { 1.0 } else { 2.0 };
            n += w;
            sum_x += w * x;
            sum_lat += w * node.lat;
            sum_xx += w * x * x;
            sum_xlat += w * x * node.lat;
            sum_apd += w * node.apd90;
            for (sum, apd) in sum_early.iter_mut().zip(node.early) {
                *sum = sum.zip(apd).map(|(sum, apd)| sum + w * apd);
            }
        }
    }
    // The reference tables are one time step shorter than the crossings on every row.
    let mean = |sum: f64| sum / n - grid.dt;
    let [apd20, apd30, apd50] = sum_early.map(|sum| sum.map(mean));
    let cv = (n * sum_xx - sum_x * sum_x) / (n * sum_xlat - sum_x * sum_lat);
    Beat { cv, apd20, apd30, apd50, apd90: mean(sum_apd) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_wave_has_its_own_speed_and_duration() {
        let grid = Grid::default();
        let nodes: Vec<_> = (0..2 * grid.n_along)
            .map(|i| (i / 2) as f64 * grid.spacing / 0.8 + 3.0)
            .map(|lat| Node { lat, early: [Some(50.0), Some(70.0), None], apd90: 200.0 })
            .collect();
        let beat = measure(&nodes, &grid);
        assert!((beat.cv - 0.8).abs() < 1e-12);
        assert!((beat.apd30.unwrap() - 69.9).abs() < 1e-10);
        assert_eq!(beat.apd50, None);
        assert!((beat.apd90 - 199.9).abs() < 1e-10);
    }

    #[test]
    fn crossings_are_linear_in_time_and_only_count_from_the_start() {
        let mut recorder = BeatRecorder::new(1, [5; LANES]);
        recorder.observe(&[[0.0; LANES]], &[[1.0; LANES]], 4);
        assert_eq!(recorder.n_activated, [0; LANES]);
        recorder.observe(&[[0.6; LANES]], &[[1.0; LANES]], 5);
        assert_eq!(recorder.n_activated, [1; LANES]);
        assert!((recorder.activation[0][0].unwrap() - 5.25).abs() < 1e-12);
        assert_eq!(recorder.beat(0, &Grid::default()), Err(Absence::NoRecovery));
    }
}
