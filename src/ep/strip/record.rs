//! When each node activates and recovers, and what follows from it: CV and APD90.

use super::lanes::{LANES, Lane};
use super::{Absence, Beat, Grid};

/// V at which an upstroke counts as activation.
const ACTIVATION: f64 = 0.7;

/// V at which a downstroke counts as recovery to 90 %.
const RECOVERY: f64 = 0.1;

/// CV and APD90 are taken over the nodes closer than this to the strip's middle, mm.
const MIDDLE_HALF_WIDTH: f64 = 3.0;

/// The last activation and recovery of every node, in steps since the stimulus.
#[derive(Debug)]
pub(super) struct Recorder {
    activation: Vec<[Option<f64>; LANES]>,
    recovery: Vec<[Option<f64>; LANES]>,
    /// Nodes of each strip that have activated.
    pub(super) n_activated: [usize; LANES],
    /// Step from which a strip's crossings count.
    start: [usize; LANES],
}

impl Recorder {
    /// Records crossings of lane `k` from step `start[k]` on.
    pub(super) fn new(n_nodes: usize, start: [usize; LANES]) -> Self {
        let none = vec![[None; LANES]; n_nodes];
        Self { activation: none.clone(), recovery: none, n_activated: [0; LANES], start }
    }

    /// Looks for crossings in the step that leads from `before` to `after`.
    #[allow(clippy::needless_bitwise_bool, reason = "without branches it becomes vector code")]
    #[inline(always)]
    pub(super) fn observe(&mut self, before: &[Lane], after: &[Lane], index: usize) {
        for (i, (a, b)) in before.iter().zip(after).enumerate() {
            let mut crossed = false;
            for k in 0..LANES {
                let up = (a[k] < ACTIVATION) & (b[k] >= ACTIVATION);
                let down = (a[k] > RECOVERY) & (b[k] <= RECOVERY);
                crossed |= up | down;
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
            } else if a > RECOVERY && b <= RECOVERY {
                self.recovery[i][k] = time(RECOVERY);
            }
        }
    }

    /// CV and APD90 of strip `lane`, if every node activated and then recovered.
    pub(super) fn beat(&self, lane: usize, grid: &Grid) -> Result<Beat, Absence> {
        let mut nodes = Vec::with_capacity(self.activation.len());
        for (activation, recovery) in self.activation.iter().zip(&self.recovery) {
            let lat = activation[lane].ok_or(Absence::NoActivation)?;
            let end = recovery[lane].filter(|&end| end > lat).ok_or(Absence::NoRecovery)?;
            nodes.push((lat * grid.dt, end * grid.dt));
        }
        Ok(measure(&nodes, grid))
    }
}

/// CV (inverse least-squares slope of LAT) and mean APD90 over the middle of the strip.
fn measure(nodes: &[(f64, f64)], grid: &Grid) -> Beat {
    let middle = 0.5 * grid.length();
    let (mut n, mut sum_x, mut sum_lat, mut sum_apd) = (0.0, 0.0, 0.0, 0.0);
    let (mut sum_xx, mut sum_xlat) = (0.0, 0.0);
    for (i, (lat, end)) in nodes.iter().enumerate() {
        let x = (i / 2) as f64 * grid.spacing - middle;
        if x.abs() < MIDDLE_HALF_WIDTH - 1e-9 {
            // A folded outer node stands for two.
            let w = if i % 2 == 0 { 2.0 } else { 1.0 };
            n += w;
            sum_x += w * x;
            sum_lat += w * lat;
            sum_xx += w * x * x;
            sum_xlat += w * x * lat;
            sum_apd += w * (end - lat);
        }
    }
    let cv = (n * sum_xx - sum_x * sum_x) / (n * sum_xlat - sum_x * sum_lat);
    // The reference tables are one time step shorter than the crossings on every row.
    Beat { cv, apd90: sum_apd / n - grid.dt }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_wave_has_its_own_speed_and_duration() {
        let grid = Grid::default();
        let nodes: Vec<_> = (0..2 * grid.n_along)
            .map(|i| (i / 2) as f64 * grid.spacing / 0.8 + 3.0)
            .map(|lat| (lat, lat + 200.0))
            .collect();
        let beat = measure(&nodes, &grid);
        assert!((beat.cv - 0.8).abs() < 1e-12);
        assert!((beat.apd90 - 199.9).abs() < 1e-10);
    }

    #[test]
    fn crossings_are_linear_in_time_and_only_count_from_the_start() {
        let mut recorder = Recorder::new(1, [5; LANES]);
        recorder.observe(&[[0.0; LANES]], &[[1.0; LANES]], 4);
        assert_eq!(recorder.n_activated, [0; LANES]);
        recorder.observe(&[[0.6; LANES]], &[[1.0; LANES]], 5);
        assert_eq!(recorder.n_activated, [1; LANES]);
        assert!((recorder.activation[0][0].unwrap() - 5.25).abs() < 1e-12);
        assert_eq!(recorder.beat(0, &Grid::default()), Err(Absence::NoRecovery));
    }
}
