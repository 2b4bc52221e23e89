//! Arrivals of plane fronts that come to the same vertices again and again.
//!
//! Where activation along fibres is five times as fast as across, a vertex that turns out to be reached earlier makes its
//! neighbours earlier, and these it, many times until nothing changes.  So two steps take turns here (policy iteration):
//! every vertex takes its best way for the arrivals that there are, then all arrivals become those of these ways, at once.
//! A plane front's arrival is the least of
//!
//! ```text
//! T_v = (1 − λ) T_a + λ T_b + time
//! ```
//! over triangles and λ, so the second step is a linear system.  If no arrival is too early at first, none becomes later
//! in any step.  The system is solved in the order in which vertices are reached from each other.  Vertices that are
//! each reached partly from the other (`order.rs`) are solved by Gauss–Seidel sweeps, in the order of arrival and back.
//!
//! # Source
//! Howard 1960, Dynamic Programming and Markov Processes; Bokanowski, Maroso and Zidani 2009, Some convergence results
//! for Howard's algorithm (why it settles).

use super::march::{LEAST, March};
use super::step::Step;
use super::way::{NONE, Way};

/// Most times that ways and arrivals take turns; 7 to 12 were needed at ratios of 5 to 40. What has not settled then is too late by
/// what is left.
const ROUNDS: usize = 100;
/// Sweeps end once none changes an arrival by more than this part of what the largest has changed by.
const SMALL: f64 = 1e-3;
const MOST_SWEEPS: usize = 1000;

impl March<'_> {
    /// Makes arrivals final, none of which may be too early. All fronts are plane.
    pub(super) fn settle_ways(&mut self) {
        for _ in 0..ROUNDS {
            let changes = self.take_best_ways();
            if changes.is_empty() {
                break;
            }
            let changes = self.all_changes(&changes);
            for (reached, change) in self.front.reached.iter_mut().zip(changes) {
                reached.arrival += change;
            }
        }
    }

    /// Gives every vertex its best way. Returns by how much later each is reached on it, none if all are settled.
    fn take_best_ways(&mut self) -> Vec<f64> {
        let best: Vec<_> = (0..self.front.ways.len() as u32).map(|v| self.earliest(v)).collect();
        let mut is_settled = true;
        let mut changes = vec![0.0; best.len()];
        for (v, best) in best.iter().enumerate().filter(|(_, best)| best.way != Way::Never) {
            changes[v] = best.arrival - self.front.reached[v].arrival;
            is_settled &= changes[v].abs() <= LEAST * best.arrival.abs();
            self.front.ways[v] = best.way;
        }
        if is_settled { vec![] } else { changes }
    }

    /// By how much each arrival changes in all: by its `own` change, and by what those it is reached from change.
    fn all_changes(&mut self, own: &[f64]) -> Vec<f64> {
        let parents: Vec<_> = (0..own.len()).map(|v| self.parents(v)).collect();
        self.front.sort(self.geometry);
        let (order, reached) = (&self.front.order, &self.front.reached);
        let mut all = own.to_vec();
        // returns by how much it was off
        let renew = |v: u32, all: &mut [f64]| {
            let from = parents[v as usize].iter().filter(|(parent, _)| *parent != NONE);
            let sum =
                from.fold(own[v as usize], |sum, (u, weight)| sum + weight * all[*u as usize]);
            (std::mem::replace(&mut all[v as usize], sum) - sum).abs()
        };
        order.each_group(false, |start, end| {
            let mut group = order.vertices[start..end].to_vec();
            if let [v] = group[..] {
                renew(v, &mut all);
                return;
            }
            let arrival = |v: &u32| reached[*v as usize].arrival;
            group.sort_by(|u, v| arrival(u).total_cmp(&arrival(v)));
            for _ in 0..MOST_SWEEPS {
                let off = group.iter().fold(0.0, |off: f64, v| off.max(renew(*v, &mut all)));
                let size = group.iter().fold(0.0, |size: f64, v| size.max(all[*v as usize].abs()));
                if off <= SMALL * size {
                    break;
                }
                group.reverse();
            }
        });
        all
    }

    /// The vertices that a vertex is reached from, with the parts of their arrivals in its own.
    fn parents(&self, v: usize) -> [(u32, f64); 2] {
        let way = self.front.ways[v];
        let ends = self.geometry.parents(way);
        let parts = match way {
            Way::Never | Way::Ray(_) => [0.0; 2],
            Way::Along { .. } => [1.0, 0.0],
            Way::Across { triangle, to, .. } => {
                let arrivals = ends.map(|end| self.front.reached[end as usize].arrival);
                let timed = &self.front.timed[triangle as usize];
                Step::new(timed, to as usize, arrivals).across_slope(None).ends
            }
        };
        [0, 1].map(|k| (ends[k], parts[k]))
    }
}
