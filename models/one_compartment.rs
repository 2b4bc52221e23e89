//! One-compartment pharmacokinetics: a drug absorbed at first order, eliminated by Michaelis–Menten.
//!
//! `eplat run models/one_compartment.rs --data FILE.csv`, where FILE.csv has the columns `time` (days,
//! ascending from above 0) and `concentration` (mg/L). Shows an ordinary differential equation in a log
//! density written by hand; the density of posteriordb's `one_comp_mm_elim_abs`.
use eplat::prelude::*;

/// Dose, mg, and volume of the compartment, L.
const DOSE: f64 = 30.0;
const VOLUME: f64 = 2.0;

/// Longest step of the solver, days.
const STEP: f64 = 0.1;

model! {
    /// dC/dt = k_a DOSE/VOLUME e^(−k_a t) − v_m/VOLUME C/(k_m + C), C = 0 at time 0, seen with
    /// log-normal noise.
    model OneCompartment;

    column time;
    column concentration;

    /// Absorption rate, 1/day; Michaelis–Menten constant, mg/L; maximum elimination rate, mg/day.
    param k_a ~ HalfCauchy(1.0);
    param k_m ~ HalfCauchy(1.0);
    param v_m ~ HalfCauchy(1.0);
    /// Noise of ln concentration.
    param sigma ~ HalfCauchy(1.0);

    density assay(data) = assay(k_a, k_m, v_m, sigma, data.time, data.concentration);
}

/// The log density of each concentration.
fn assay<D: Real>(k_a: D, k_m: D, v_m: D, sigma: D, time: &[f64], seen: &[f64]) -> Vec<D> {
    let slope = |t: f64, c: D| {
        let dose = k_a * exp(-k_a * t) * (DOSE / VOLUME);
        dose - v_m / VOLUME * c / (k_m + c)
    };
    let (mut t, mut c) = (0.0, D::from(0.0));
    let mut terms = vec![];
    for (end, seen) in time.iter().zip(seen) {
        let steps = ((end - t) / STEP).ceil();
        let h = (end - t) / steps;
        for i in 0..steps as usize {
            c = runge_kutta(slope, t + h * i as f64, c, h);
        }
        t = *end;
        terms.push(LogNormal(ln(c), sigma).ln_likelihood(seen));
    }
    terms
}

/// One step of length `h` of the classical fourth-order method.
fn runge_kutta<D: Real>(slope: impl Fn(f64, D) -> D, t: f64, x: D, h: f64) -> D {
    let k1 = slope(t, x);
    let k2 = slope(t + h / 2.0, x + k1 * (h / 2.0));
    let k3 = slope(t + h / 2.0, x + k2 * (h / 2.0));
    let k4 = slope(t + h, x + k3 * h);
    x + (k1 + k2 * 2.0 + k3 * 2.0 + k4) * (h / 6.0)
}
