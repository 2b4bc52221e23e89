//! Gaussian-process fields at probes, with their adjoint.
//!
//! ```text
//! θ(probe) = mean + Σ_k w_k φ_k(probe),   w_k = Σ_terms amplitude √S(√λ_k) η_k
//! ```
//! A probe is a row of K numbers: the eigenfunctions at a vertex, or any linear functional of them.
//!
//! The constant mode φ₀ and a flat mean move the field in the same way. If the mean is a flat
//! parameter that nothing else mentions, both are *collapsed*: instead of m, the sampler moves `m'
//! = m + Σ_terms amplitude √S(0) φ₀ η₀`. This is exact, with the Jacobian 1. η₀ stays standard
//! normal and independent of everything else, so it is drawn afterwards ([`Field::restore`]).

use num_dual::DualStruct;
use pulp::{Arch, NullaryFnOnce};

use super::functions::KernelFn;
use super::scalar::Scalar;
use super::scope::Local;
use super::tape::{Bent, Op, Tape, add_rows, sum};
use crate::field::Kernel;
use crate::num::vector::dot;
use crate::num::{Dual, LN_SQRT_2PI, derivatives};

/// √S at the frequencies of the basis, with its derivatives in what it depends on.
pub(super) trait Spectrum: Bent + Send + Sync {
    /// Number of derivatives.
    fn width(&self) -> usize;
    /// `c_k = √S(w_k)`, and `dc` its derivatives, (width, modes).
    fn push(&self, v: &[f64], frequency: &[f64], c: &mut [f64], dc: &mut [f64]);
    /// Carries the adjoint of `c` to what it depends on.
    fn pull(&self, bar: &[f64], dc: &[f64], g: &mut [f64]);
    /// √S at one frequency.
    fn at(&self, v: &[f64], frequency: f64) -> f64;
    /// √S at the basis's frequencies.
    fn values(&self, v: &[f64], frequency: &[f64], c: &mut [f64]);
    /// The values that it depends on.
    fn mentions(&self) -> Vec<usize>;
}

pub(super) struct SpectrumAt<F, const N: usize> {
    pub(super) local: Local<N>,
    pub(super) f: F,
}

impl<F: KernelFn<N>, const N: usize> Spectrum for SpectrumAt<F, N> {
    fn width(&self) -> usize {
        N
    }

    fn push(&self, v: &[f64], frequency: &[f64], c: &mut [f64], dc: &mut [f64]) {
        Arch::new().dispatch(Push { local: &self.local, f: &self.f, v, frequency, c, dc });
    }

    fn pull(&self, bar: &[f64], dc: &[f64], g: &mut [f64]) {
        let e: [f64; N] = std::array::from_fn(|j| dot::<8>(bar, &dc[j * bar.len()..][..bar.len()]));
        self.local.scatter_array(&e, g);
    }

    fn at(&self, v: &[f64], frequency: f64) -> f64 {
        self.f.kernel(self.local.plain(v)).sqrt_density(frequency).0
    }

    fn values(&self, v: &[f64], frequency: &[f64], c: &mut [f64]) {
        let kernel = self.f.kernel(self.local.plain(v));
        for (c, w) in c.iter_mut().zip(frequency) {
            *c = kernel.sqrt_density(*w).0;
        }
    }

    fn mentions(&self) -> Vec<usize> {
        self.local.places()
    }
}

struct Push<'a, F, const N: usize> {
    local: &'a Local<N>,
    f: &'a F,
    v: &'a [f64],
    frequency: &'a [f64],
    c: &'a mut [f64],
    dc: &'a mut [f64],
}

impl<F: KernelFn<N>, const N: usize> NullaryFnOnce for Push<'_, F, N> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let n = self.frequency.len();
        let (c, dc) = (&mut self.c[..n], &mut self.dc[..n * N]);
        let kernel = self.f.kernel::<Dual<N>>(self.local.dual(self.v));
        for k in 0..n {
            let s = kernel.sqrt_density(self.frequency[k]);
            c[k] = s.re();
            for (j, e) in derivatives(&s.0).into_iter().enumerate() {
                dc[j * n + k] = e;
            }
        }
    }
}

/// One `amplitude * gp(kernel, K = …)`.
#[derive(Debug)]
pub(super) struct Term {
    pub(super) amplitude: Box<dyn Scalar>,
    pub(super) spectrum: Box<dyn Spectrum>,
    /// Number of sampled modes: K, or K − 1 if the constant mode is collapsed.
    pub(super) k: usize,
    /// First unknown.
    pub(super) eta: usize,
    /// Where its `c`, `dc` and adjoint of `c` begin among the field's terms.
    pub(super) work: usize,
}

/// A mean with which the constant mode is collapsed: where its value is in `v`, and φ₀.
#[derive(Clone, Copy, Debug)]
pub(super) struct Collapsed {
    pub(super) mean: usize,
    pub(super) phi0: f64,
}

/// A field at all probes.
#[derive(Debug)]
pub(super) struct Field {
    pub(super) mean: Box<dyn Scalar>,
    /// The value that is the mean, if the mean is a hyperparameter that nothing else mentions.
    pub(super) lone_mean: Option<usize>,
    pub(super) terms: Vec<Term>,
    pub(super) collapsed: Option<Collapsed>,
    /// Sampled modes of the longest term.
    pub(super) k: usize,
    /// Where this field's part of `work` begins: w and q, then the terms.
    pub(super) work: usize,
    /// First value: one per probe, padded.
    pub(super) theta: usize,
    /// Probes row-major, `stride` ≥ `k` numbers each, zero-padded.
    pub(super) probes: Vec<f64>,
    pub(super) stride: usize,
    /// Their transpose: a row per mode, of all probes, padded.
    pub(super) modes: Vec<f64>,
    /// √λ of the sampled modes.
    pub(super) frequency: Vec<f64>,
}

/// The length of a row of `n` numbers, rounded up to whole vector registers.
pub(super) fn padded(n: usize) -> usize {
    n.next_multiple_of(4)
}

impl Field {
    pub(super) fn n_probes(&self) -> usize {
        self.probes.len() / self.stride.max(1)
    }

    /// The mean and the weights of the sampled modes, after a forward pass.
    pub(super) fn weights<'t>(&self, t: &'t Tape) -> (f64, &'t [f64]) {
        (self.mean.value(&t.v), &t.work[self.work..][..self.k])
    }

    /// Carries the adjoint of the ln of what each mode of a term is multiplied by to what that depends on, after a forward
    /// pass.
    pub(super) fn pull_ln_multipliers(&self, t: &mut Tape, term: &Term, bar: &[f64]) {
        let (c, rest) = t.work[self.work + 2 * self.stride + term.work..].split_at(term.k);
        // a multiplier that is 0, by rounding, does not change
        let of_ln = |bar: f64, x: f64| if x == 0.0 { 0.0 } else { bar / x };
        let of_c = |(bar, c): (&f64, &f64)| of_ln(*bar, *c);
        let c_bar: Vec<f64> = bar.iter().zip(c).map(of_c).collect();
        term.spectrum.pull(&c_bar, &rest[..term.k * term.spectrum.width()], &mut t.g);
        let amplitude = term.amplitude.value(&t.v);
        term.amplitude.pull(&t.v, of_ln(sum(bar), amplitude), &mut t.g);
    }

    /// Takes the collapsed η₀ of every term from `eta0`, which is standard normal. Returns them,
    /// and the mean m that goes with them.
    pub(super) fn restore(
        &self,
        t: &Tape,
        eta0: &mut dyn FnMut() -> f64,
    ) -> Option<(f64, Vec<f64>)> {
        let collapsed = self.collapsed?;
        let mut mean = t.v[collapsed.mean];
        let eta0 = self.terms.iter().map(|term| {
            let eta = eta0();
            let scale = term.amplitude.value(&t.v) * term.spectrum.at(&t.v, 0.0);
            mean -= scale * collapsed.phi0 * eta;
            eta
        });
        let eta0 = eta0.collect();
        Some((mean, eta0))
    }
}

impl Op for Field {
    fn forward(&self, t: &mut Tape) {
        let (head, tail) = t.work[self.work..].split_at_mut(2 * self.stride);
        let w = &mut head[..self.stride];
        w.fill(0.0);
        for term in &self.terms {
            let amplitude = term.amplitude.value(&t.v);
            let (c, dc) = tail[term.work..].split_at_mut(term.k);
            let dc = &mut dc[..term.k * term.spectrum.width()];
            term.spectrum.push(&t.v, &self.frequency[..term.k], c, dc);
            for ((w, c), eta) in w.iter_mut().zip(&*c).zip(&t.u[term.eta..][..term.k]) {
                *w += amplitude * c * eta;
            }
        }
        let mean = self.mean.value(&t.v);
        let theta = &mut t.v[self.theta..][..padded(self.n_probes())];
        theta.fill(mean);
        add_rows(w, &self.modes, theta);
    }

    fn backward(&self, t: &mut Tape) {
        let (head, tail) = t.work[self.work..].split_at_mut(2 * self.stride);
        let q = &mut head[self.stride..]; // adjoint of w
        q.fill(0.0);
        let theta_bar = &t.g[self.theta..][..self.n_probes()];
        add_rows(theta_bar, &self.probes, q);
        let mean_bar = sum(theta_bar);
        for term in &self.terms {
            let k = term.k;
            let amplitude = term.amplitude.value(&t.v);
            let (c, rest) = tail[term.work..].split_at_mut(k);
            let (dc, rest) = rest.split_at_mut(k * term.spectrum.width());
            let c_bar = &mut rest[..k];
            let (eta, eta_bar) = (&t.u[term.eta..][..k], &mut t.gu[term.eta..][..k]);
            let (mut amplitude_bar, mut squares) = (0.0, 0.0);
            for i in 0..k {
                squares += eta[i] * eta[i];
                amplitude_bar += c[i] * eta[i] * q[i];
                c_bar[i] = amplitude * eta[i] * q[i];
                eta_bar[i] += amplitude * c[i] * q[i] - eta[i];
            }
            t.lp -= 0.5 * squares + LN_SQRT_2PI * k as f64;
            term.spectrum.pull(c_bar, dc, &mut t.g);
            term.amplitude.pull(&t.v, amplitude_bar, &mut t.g);
        }
        self.mean.pull(&t.v, mean_bar, &mut t.g);
    }

    fn ln_density(&self, t: &mut Tape) {
        for term in &self.terms {
            let mut squares = 0.0;
            for eta in &t.u[term.eta..][..term.k] {
                squares += eta * eta;
            }
            t.lp -= 0.5 * squares + LN_SQRT_2PI * term.k as f64;
        }
    }
}
