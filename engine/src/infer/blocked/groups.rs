//! The whitening of all groups, one after the other.

use std::ops::Range;

use super::latent::{Design, Layout};
use super::stand_in::StandIn;
use super::whiten::GroupWhitening;

/// The coordinates z of all coefficients w at one value of the hyperparameters. They are those of
/// [`GroupWhitening`], one group after the other.
#[derive(Clone, Debug)]
pub(super) struct Whitening {
    pub(super) designs: Vec<Design>,
    groups: Vec<Part>,
    /// Σ κ
    pub(super) ln_evidence: f64,
}

/// A group, and which coefficients and latent values belong to it.
#[derive(Clone, Debug)]
struct Part {
    whitening: GroupWhitening,
    coefficients: Range<usize>,
    latent: Range<usize>,
}

impl Whitening {
    /// Memory for this layout.
    pub(super) fn new(layout: &Layout) -> Self {
        let (mut n, mut n_latent) = (0, 0);
        let mut groups = vec![];
        for group in &layout.groups {
            let whitening = GroupWhitening::new(group);
            let coefficients = n..n + group.n_coefficients();
            let latent = n_latent..n_latent + group.n_latent();
            (n, n_latent) = (coefficients.end, latent.end);
            groups.push(Part { whitening, coefficients, latent });
        }
        let designs = layout.groups.iter().map(Design::new).collect();
        Self { designs, groups, ln_evidence: 0.0 }
    }

    /// Takes up the designs; `false` if one of them has no factor.
    pub(super) fn prepare(&mut self, stand_in: &StandIn) -> bool {
        self.ln_evidence = 0.0;
        for ((part, design), stand_in) in
            self.groups.iter_mut().zip(&self.designs).zip(&stand_in.groups)
        {
            if !part.whitening.prepare(design, stand_in) {
                return false;
            }
            self.ln_evidence += part.whitening.ln_evidence;
        }
        true
    }

    /// w at z.
    pub(super) fn coefficients(&self, z: &[f64], w: &mut [f64]) {
        for Part { whitening, coefficients, .. } in &self.groups {
            whitening.coefficients(&z[coefficients.clone()], &mut w[coefficients.clone()]);
        }
    }

    /// z at w.
    pub(super) fn whitened(&self, w: &[f64], z: &mut [f64]) {
        for Part { whitening, coefficients, .. } in &self.groups {
            whitening.whitened(&w[coefficients.clone()], &mut z[coefficients.clone()]);
        }
    }

    /// θ at w.
    pub(super) fn latent(&self, w: &[f64], theta: &mut [f64]) {
        for (Part { whitening, coefficients, latent }, design) in
            self.groups.iter().zip(&self.designs)
        {
            whitening.latent(design, &w[coefficients.clone()], &mut theta[latent.clone()]);
        }
    }

    /// b + A U⁻¹ s of a group, and A U⁻¹, column after column.
    pub(super) fn basis(&self, group: usize) -> (&[f64], &[f64]) {
        self.groups[group].whitening.basis()
    }

    /// Which coefficients are of a group, and how many latent values.
    pub(super) fn of_group(&self, group: usize) -> (Range<usize>, usize) {
        let Part { coefficients, latent, .. } = &self.groups[group];
        (coefficients.clone(), latent.len())
    }

    /// Makes ready for [`Whitening::latent_at`], [`Whitening::pull`] and [`Whitening::basis`].
    pub(super) fn set_basis(&mut self) {
        for (part, design) in self.groups.iter_mut().zip(&self.designs) {
            part.whitening.set_basis(design);
        }
    }

    /// Both; `None` if one of the designs has no factor.
    pub(super) fn prepare_basis(&mut self, stand_in: &StandIn) -> Option<()> {
        self.prepare(stand_in).then(|| self.set_basis())
    }

    /// θ at z.
    pub(super) fn latent_at(&self, z: &[f64], theta: &mut [f64]) {
        for Part { whitening, coefficients, latent } in &self.groups {
            whitening.latent_at(&z[coefficients.clone()], &mut theta[latent.clone()]);
        }
    }

    /// The gradient in z of a function with this gradient in θ.
    pub(super) fn pull(&self, theta_bar: &[f64], z_bar: &mut [f64]) {
        for Part { whitening, coefficients, latent } in &self.groups {
            whitening.pull(&theta_bar[latent.clone()], &mut z_bar[coefficients.clone()]);
        }
    }
}
