//! What is done to the rows of one block: plain loops over fixed arrays, which the compiler turns into
//! vector instructions. Sums have a fixed order, so that no bit depends on the machine's vector width.

use crate::ep::cell::{StepRates, gradual_step};
use crate::ep::precision::Precision;

/// Rows that sleep and wake together, and that one task works on.
pub(super) const BLOCK: usize = 128;

/// Cells whose substeps are computed side by side: enough that the processor has other cells to compute while one waits for what
/// its last substep gave.
const CELLS: usize = 16;

/// Partial sums of a block.
const LANES: usize = 8;

/// Least change of V in a step that counts: where V turns at `V_gate` itself, rounding would say which way.
const LEAST_CHANGE: f64 = 1e-3;

/// `substeps` of the cells; `scale · diffused` is what diffusion added to V in the last step.
///
/// Whether the gate opens or closes is decided by degrees, by how far V is above `V_gate` in units of its change in a
/// step: on average as by V alone, but rounding that puts V on one side or the other does not move APD by a step.
/// Around `V_gate` the inward current is none: V changes by diffusion and the outward current.
#[inline(always)]
pub(super) fn react<F: Precision>(
    v: &mut [F; BLOCK],
    h: &mut [F; BLOCK],
    diffused: &[F; BLOCK],
    scale: &[F; BLOCK],
    rates: &StepRates<[F; BLOCK]>,
    substeps: u32,
) {
    let (n, least) = (F::of(f64::from(substeps)), F::of(LEAST_CHANGE));
    let StepRates { excite, leak, open, close } = rates;
    let [excite, leak, open, close] = [excite, leak, open, close].map(|r| r.as_chunks::<CELLS>().0);
    let [diffused, scale] = [diffused, scale].map(|x| x.as_chunks::<CELLS>().0);
    let (v, h) = (v.as_chunks_mut::<CELLS>().0, h.as_chunks_mut::<CELLS>().0);
    for (c, (v, h)) in v.iter_mut().zip(h).enumerate() {
        let mut steepness = [F::zero(); CELLS];
        for i in 0..CELLS {
            let change = scale[c][i] * diffused[c][i] - n * leak[c][i] * (F::one() - h[i]) * v[i];
            steepness[i] = (change.abs() + least).recip();
        }
        for _ in 0..substeps {
            for i in 0..CELLS {
                let rates = StepRates {
                    excite: excite[c][i],
                    leak: leak[c][i],
                    open: open[c][i],
                    close: close[c][i],
                };
                (v[i], h[i]) = gradual_step(v[i], h[i], steepness[i], rates);
            }
        }
    }
}

/// `a · b`.
#[inline(always)]
pub(super) fn dot<F: Precision>(a: &[F; BLOCK], b: &[F; BLOCK]) -> f64 {
    let mut lanes = [F::zero(); LANES];
    for (a, b) in a.as_chunks::<LANES>().0.iter().zip(b.as_chunks::<LANES>().0) {
        for l in 0..LANES {
            lanes[l] = lanes[l] + a[l] * b[l];
        }
    }
    lanes.iter().map(|sum| sum.f64()).sum()
}

/// `a + factor · b` into `b`.
#[inline(always)]
pub(super) fn add_scaled<F: Precision>(a: &[F; BLOCK], factor: F, b: &mut [F; BLOCK]) {
    for (a, b) in a.iter().zip(b) {
        *b = *a + factor * *b;
    }
}

/// Adds `factor · a` to `b`.
#[inline(always)]
pub(super) fn add_to<F: Precision>(factor: F, a: &[F; BLOCK], b: &mut [F; BLOCK]) {
    for (a, b) in a.iter().zip(b) {
        *b = *b + factor * *a;
    }
}

/// Adds `a · b`, row by row, to `out`.
#[inline(always)]
pub(super) fn add_product<F: Precision>(a: &[F; BLOCK], b: &[F; BLOCK], out: &mut [F; BLOCK]) {
    for i in 0..BLOCK {
        out[i] = out[i] + a[i] * b[i];
    }
}

/// What follows `last` in a straight line from `before`, into `before`.
#[inline(always)]
pub(super) fn extrapolate<F: Precision>(last: &[F; BLOCK], before: &mut [F; BLOCK]) {
    for (last, before) in last.iter().zip(before) {
        *before = *last + (*last - *before);
    }
}

/// The largest magnitude; NaN counts as none.
#[inline(always)]
pub(super) fn peak<F: Precision>(a: &[F; BLOCK]) -> F {
    let mut lanes = [F::zero(); LANES];
    for a in a.as_chunks::<LANES>().0 {
        for l in 0..LANES {
            let size = a[l].abs();
            lanes[l] = if size > lanes[l] { size } else { lanes[l] };
        }
    }
    lanes.into_iter().fold(F::zero(), F::max)
}

/// Which rows meet one of `levels` on the way from `a` to `b`.
#[inline(always)]
pub(super) fn meets<F: Precision>(levels: &[F], a: &[F; BLOCK], b: &[F; BLOCK]) -> [bool; BLOCK] {
    let mut meets = [false; BLOCK];
    for level in levels {
        for i in 0..BLOCK {
            meets[i] |= (a[i] > *level) != (b[i] > *level);
            meets[i] |= (a[i] < *level) != (b[i] < *level);
        }
    }
    meets
}
