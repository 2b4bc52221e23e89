//! Whether measurements ask for a further place at which an activation starts.

use super::laid_out::Model;
use super::over::Over;
use super::tape::{Op as _, Tape};

/// The shares of an activation's rows that a further front is tried to reach first.
const SHARES: [f64; 9] = [0.03, 0.06, 0.1, 0.2, 0.3, 0.45, 0.6, 0.8, 1.0];

/// A further place at which an activation may start.
#[derive(Clone, Debug, PartialEq)]
pub struct Breakthrough {
    /// The map of the activation.
    pub activation: String,
    /// A vertex of the triangulation on which arrivals are computed.
    pub vertex: u32,
    /// By how much later than at the first place, ms.
    pub later: f64,
    /// By how much the log likelihood of all measurements grows, with all unknowns as they are.
    pub gain: f64,
    /// How many rows the further front reaches first, of how many.
    pub rows: [usize; 2],
}

impl Model {
    /// For each activation of an `eikonal`, in their order, the best of these vertices for a further start, at the
    /// unknowns `u`, though the gain may be negative; `None` where none can be tried.
    pub fn breakthroughs(&self, u: &[f64], among: &[Vec<u32>]) -> Vec<Option<Breakthrough>> {
        let mut t = self.tape();
        self.forward(&mut t, u);
        let before = self.ln_likelihood(&mut t);
        let mut found = vec![];
        for over in &self.over {
            for (own, name) in over.activations().iter().zip(&over.names) {
                let mut one = |vertex: &u32| {
                    let (gain, later, n) = self.further(&mut t, over, own, *vertex, before)?;
                    let (activation, rows) = (name.clone(), [n, own.len()]);
                    Some(Breakthrough { activation, vertex: *vertex, later, gain, rows })
                };
                let all = among.get(found.len()).into_iter().flatten().filter_map(&mut one);
                found.push(all.max_by(|a, b| a.gain.total_cmp(&b.gain)));
            }
        }
        found
    }

    /// How many activations there are.
    pub fn n_activations(&self) -> usize {
        self.over.iter().map(|over| over.activations().len().min(over.names.len())).sum()
    }

    /// The largest gain of a further start at a vertex, for the rows `own` of an operator, when it starts, and how many
    /// rows it then reaches first.
    fn further(
        &self,
        t: &mut Tape,
        over: &Over,
        own: &[usize],
        vertex: u32,
        before: f64,
    ) -> Option<(f64, f64, usize)> {
        let from = over.started_at(t, vertex);
        let places: Vec<usize> = own.iter().map(|i| over.rows[*i]).collect();
        let here: Vec<f64> = places.iter().map(|at| t.v[*at]).collect();
        // until when the front must start to reach each row first
        let until: Vec<f64> = own.iter().zip(&here).map(|(i, here)| here - from[*i]).collect();
        let mut latest = until.clone();
        latest.sort_by(|a, b| b.total_cmp(a));
        let at =
            |share: f64| latest[((share * latest.len() as f64) as usize).min(latest.len() - 1)];
        let mut tried = SHARES.map(at).to_vec();
        tried.retain(|onset| onset.is_finite());
        let mut gains = vec![];
        for onset in tried {
            for ((at, i), here) in places.iter().zip(own).zip(&here) {
                t.v[*at] = here.min(onset + from[*i]);
            }
            let n = until.iter().filter(|until| **until > onset).count();
            gains.push((self.ln_likelihood(t) - before, onset, n));
        }
        for (at, here) in places.iter().zip(here) {
            t.v[*at] = here;
        }
        gains.into_iter().filter(|(gain, ..)| gain.is_finite()).max_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// Of all measurements, for values of the tape that are not those of its unknowns.
    fn ln_likelihood(&self, t: &mut Tape) -> f64 {
        self.offsets.iter().for_each(|range| t.v[range.clone()].fill(0.0));
        self.predictors.iter().for_each(|predictor| predictor.forward(t));
        self.linear.iter().for_each(|linear| linear.forward(t));
        t.lp = 0.0;
        self.observes.iter().for_each(|observe| observe.op.backward(t));
        t.lp
    }
}
