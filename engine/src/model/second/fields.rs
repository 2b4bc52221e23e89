//! Second derivatives of fields, their amplitudes and their kernels.

use crate::field::Kernel;
use crate::model::functions::{KernelFn, ScalarFn};
use crate::model::gp::{Field, SpectrumAt, padded};
use crate::model::scalar::{Scalar, ScalarAt};
use crate::model::tape::{Bent, Second, Tape, add_rows, sum};
use crate::num::{Hyper, Num};

impl<F: ScalarFn<N>, const N: usize> Bent for ScalarAt<F, N> {
    fn bend(&self, t: &Tape, bars: &[f64], _: &[f64], d: &mut Tape) {
        for j in 0..N {
            let x: Num<Hyper> = self.f.value(self.local.hyper(j, t, d));
            d.g[self.local.place(j)] += bars[0] * x.0.eps1eps2;
        }
    }
}

impl<F: KernelFn<N>, const N: usize> Bent for SpectrumAt<F, N> {
    fn bend(&self, t: &Tape, bars: &[f64], frequency: &[f64], d: &mut Tape) {
        for j in 0..N {
            let kernel = self.f.kernel::<Hyper>(self.local.hyper(j, t, d));
            let term = |(bar, w): (&f64, &f64)| bar * kernel.sqrt_density(*w).0.eps1eps2;
            d.g[self.local.place(j)] += bars.iter().zip(frequency).map(term).sum::<f64>();
        }
    }
}

/// A term at a point and its change: amplitude, √S and coefficients.
struct TermAt {
    amplitude: [f64; 2],
    c: [Vec<f64>; 2],
    eta: [Vec<f64>; 2],
}

impl Field {
    fn term_at(&self, i: usize, t: &Tape, d: &Tape) -> TermAt {
        let (term, tail) = (&self.terms[i], &t.work[self.work + 2 * self.stride..]);
        let (c, dc) = tail[term.work..].split_at(term.k);
        let mut change = vec![0.0; term.k];
        for (place, dc) in term.spectrum.mentions().into_iter().zip(dc.chunks_exact(term.k)) {
            change.iter_mut().zip(dc).for_each(|(change, dc)| *change += dc * d.v[place]);
        }
        let eta = [&t.u, &d.u].map(|u| u[term.eta..][..term.k].to_vec());
        let amplitude = [term.amplitude.value(&t.v), along(&*term.amplitude, t, d)];
        TermAt { amplitude, c: [c.to_vec(), change], eta }
    }
}

/// The change of a scalar.
fn along(scalar: &dyn Scalar, t: &Tape, d: &Tape) -> f64 {
    let mut slope = vec![0.0; t.v.len()];
    scalar.pull(&t.v, 1.0, &mut slope);
    scalar.mentions().into_iter().map(|at| slope[at] * d.v[at]).sum()
}

impl Second for Field {
    fn push(&self, t: &Tape, d: &mut Tape) {
        let mut w = vec![0.0; self.stride];
        for i in 0..self.terms.len() {
            let TermAt { amplitude: [a, da], c: [c, dc], eta: [eta, d_eta] } =
                self.term_at(i, t, d);
            for k in 0..c.len() {
                w[k] += da * c[k] * eta[k] + a * dc[k] * eta[k] + a * c[k] * d_eta[k];
            }
        }
        let mean = along(&*self.mean, t, d);
        let theta = &mut d.v[self.theta..][..padded(self.n_probes())];
        theta.fill(mean);
        add_rows(&w, &self.modes, theta);
    }

    fn pull(&self, t: &Tape, d: &mut Tape) {
        let q = &t.work[self.work + self.stride..][..self.stride];
        let mut dq = vec![0.0; self.stride];
        let theta_bar = d.g[self.theta..][..self.n_probes()].to_vec();
        add_rows(&theta_bar, &self.probes, &mut dq);
        for (i, term) in self.terms.iter().enumerate() {
            let TermAt { amplitude: [a, da], c: [c, dc], eta: [eta, d_eta] } =
                self.term_at(i, t, d);
            let (mut a_bar, mut da_bar) = (0.0, 0.0);
            let (mut c_bar, mut dc_bar) = (vec![0.0; term.k], vec![0.0; term.k]);
            for k in 0..term.k {
                a_bar += c[k] * eta[k] * q[k];
                da_bar += (dc[k] * eta[k] + c[k] * d_eta[k]) * q[k] + c[k] * eta[k] * dq[k];
                c_bar[k] = a * eta[k] * q[k];
                dc_bar[k] = (da * eta[k] + a * d_eta[k]) * q[k] + a * eta[k] * dq[k];
                d.gu[term.eta + k] += (da * c[k] + a * dc[k]) * q[k] + a * c[k] * dq[k] - d_eta[k];
            }
            let tail = &t.work[self.work + 2 * self.stride + term.work + term.k..];
            term.spectrum.pull(&dc_bar, &tail[..term.k * term.spectrum.width()], &mut d.g);
            term.spectrum.bend(t, &c_bar, &self.frequency[..term.k], d);
            term.amplitude.pull(&t.v, da_bar, &mut d.g);
            term.amplitude.bend(t, &[a_bar], &[], d);
        }
        self.mean.pull(&t.v, sum(&theta_bar), &mut d.g);
        let mean_bar = sum(&t.g[self.theta..][..self.n_probes()]);
        self.mean.bend(t, &[mean_bar], &[], d);
    }
}
