//! Operators over the whole surface, one in each file.

mod eikonal;
mod gradient;
mod path;

pub(super) use eikonal::{Arrival, Source};
pub(super) use gradient::Slope;
pub(super) use path::Along;

use std::fmt::Debug;

use crate::manifold::Front;
use crate::mesh::TriMesh;
use crate::table::ProbeError;

/// An operator over the whole surface: numbers of rows that depend on expressions of the model at every vertex.
///
/// One of your own is written `let y(row) = near(f(row); 5.0);`, which calls `near(surface, 5.0)`. That function takes an
/// [`Everywhere`] and gives an operator. [`operator_error`] says whether its derivatives are right.
///
/// ```
/// # extern crate eplat_engine as eplat;
/// use eplat::prelude::*;
///
/// model! {
///     /// A voltage, seen as the mean over all vertices nearer than `width` mm.
///     model Blurred;
///     field voltage(x) [mV] = m + alpha * gp(Rbf(20.0), K = 8) where {
///         m     [mV] ~ Flat;
///         alpha [mV] ~ HalfNormal(2.0);
///     }
///     let seen(row) [mV] = near(voltage(row); 5.0);
///     observe v(row): Number [mV] ~ Normal(seen(row), 0.1);
/// }
///
/// #[derive(Debug)]
/// struct Near(Vec<Vec<usize>>);
///
/// fn near(surface: &Everywhere<'_>, width: f64) -> Near {
///     let p = surface.mesh.vertices();
///     let gap = |a: usize, b: usize| (0..3).map(|k| (p[a][k] - p[b][k]).powi(2)).sum::<f64>();
///     let near = |a: usize| (0..p.len()).filter(|b| gap(a, *b) < width * width).collect();
///     Near(surface.at.iter().map(|row| near(*row as usize)).collect())
/// }
///
/// impl Operator for Near {
///     fn forward(&self, of: &Operands<'_>, _: &mut Memo, out: &mut [f64]) {
///         for (out, near) in out.iter_mut().zip(&self.0) {
///             *out = near.iter().map(|v| of.everywhere[0][*v]).sum::<f64>() / near.len() as f64;
///         }
///     }
///     fn push(&self, _: &Operands<'_>, kept: &Memo, changes: &Operands<'_>, out: &mut [f64]) {
///         self.forward(changes, &mut kept.clone(), out); // it is linear
///     }
///     fn pull(&self, _: &Operands<'_>, _: &Memo, bars: &[f64], into: &mut Adjoints<'_>) {
///         for (bar, near) in bars.iter().zip(&self.0) {
///             near.iter().for_each(|v| into.everywhere[0][*v] += bar / near.len() as f64);
///         }
///     }
/// }
/// # fn main() {}
/// ```
pub trait Operator: Debug + Send + Sync {
    /// Its numbers (one per row) for these operands; NaN refuses the draw.
    fn forward(&self, of: &Operands<'_>, kept: &mut Memo, out: &mut [f64]);

    /// The change of its numbers for a change of the operands, about the last forward pass with the same operands.
    fn push(&self, of: &Operands<'_>, kept: &Memo, changes: &Operands<'_>, out: &mut [f64]);

    /// Adds the adjoints of the operands to `into`, for those of its numbers.
    fn pull(&self, of: &Operands<'_>, kept: &Memo, bars: &[f64], into: &mut Adjoints<'_>);

    /// The places among its numbers of those that belong to each activation. Only `eikonal` has any.
    fn activations(&self) -> Vec<Vec<usize>> {
        vec![]
    }

    /// What its numbers would be if activation started at this vertex of the triangulation alone, at 0 ms.
    fn started_at(&self, _: &Operands<'_>, _vertex: u32) -> Vec<f64> {
        vec![]
    }

    /// The maps that a forward pass has made, each (`n_vertices`), or empty where it could not. Those of `eikonal` are
    /// reported; one of your own has none.
    fn maps(&self, _: &Memo) -> Vec<Vec<f64>> {
        vec![]
    }

    /// By how much its maps are off at these operands, after a forward pass, as far as finer triangles tell. Only `eikonal`
    /// knows it.
    ///
    /// # Errors
    /// What finer triangles are refused for.
    fn off(&self, _: &Operands<'_>, _: &Memo) -> Result<Option<Off>, ProbeError> {
        Ok(None)
    }

    /// From now on adds this to its maps, and to its numbers, which are read from them.
    fn correct(&self, _by: Vec<Vec<f64>>) {}
}

/// By how much maps of an operator are off.
#[derive(Debug)]
pub struct Off {
    /// At each vertex of each map.
    pub by: Vec<Vec<f64>>,
    /// Of the finer triangles that told it.
    pub n_vertices: usize,
}

impl Off {
    /// The mean of at least one.
    pub(in crate::model) fn mean(of: &[&Self]) -> Vec<Vec<f64>> {
        let Some((first, others)) = of.split_first() else { return vec![] };
        let mut sum = first.by.clone();
        for off in others {
            for (sum, by) in sum.iter_mut().flatten().zip(off.by.iter().flatten()) {
                *sum += by;
            }
        }
        sum.iter_mut().flatten().for_each(|sum| *sum /= of.len() as f64);
        sum
    }
}

/// What an operator depends on, or the change of it.
#[derive(Clone, Debug)]
pub struct Operands<'a> {
    /// Expressions of the model at the vertices of the triangulation, each (`n_vertices`).
    pub everywhere: Vec<&'a [f64]>,
    /// Single numbers: delays of further sources of `eikonal`.
    pub numbers: Vec<f64>,
}

/// The adjoints of what an operator depends on.
#[derive(Debug)]
pub struct Adjoints<'a> {
    /// Of the expressions, each (`n_vertices`).
    pub everywhere: Vec<&'a mut [f64]>,
    /// Of the single numbers.
    pub numbers: Vec<f64>,
}

/// What a forward pass leaves for the passes that follow it.
#[derive(Clone, Debug, Default)]
pub struct Memo {
    /// Whatever an operator wants to find again.
    pub numbers: Vec<f64>,
    /// Of each activation.
    fronts: Vec<Front>,
}

/// The surface as an operator sees it.
#[derive(Clone, Copy, Debug)]
pub struct Everywhere<'a> {
    /// A triangulation of at most some 2,000 vertices, besides those of rows and sources, at which the operands are given, mm.
    pub mesh: &'a TriMesh,
    /// Its vertex at which each row is (rows).
    pub at: &'a [u32],
    /// Its vertex at which the activation of each row starts (rows); `None` without a column `source`.
    pub source: &'a [Option<u32>],
}

/// The largest error of an operator's `push` beside central differences of its `forward`, and of its `pull` beside its `push`,
/// each relative to 1 + the derivative, for these operands of an operator without single numbers.
///
/// # Panics
/// When the operator panics on these operands.
pub fn operator_error(operator: &dyn Operator, operands: &[&[f64]], n_rows: usize) -> f64 {
    const STEP: f64 = 1e-6;
    let of = |everywhere: Vec<&[f64]>| {
        let mut out = vec![0.0; n_rows];
        let mut kept = Memo::default();
        operator.forward(&Operands { everywhere, numbers: vec![] }, &mut kept, &mut out);
        (out, kept)
    };
    // directions that have nothing to do with each other
    let wave = |i: usize, k: usize| (((i + 1) * (2 * k + 3)) as f64 * 0.7).sin();
    let directions: Vec<Vec<f64>> = operands
        .iter()
        .enumerate()
        .map(|(k, of)| (0..of.len()).map(|i| wave(i, k)).collect())
        .collect();
    let moved = |by: f64| {
        let all: Vec<Vec<f64>> = operands
            .iter()
            .zip(&directions)
            .map(|(x, d)| x.iter().zip(d).map(|(x, d)| x + by * d).collect())
            .collect();
        of(all.iter().map(Vec::as_slice).collect()).0
    };
    let (_, kept) = of(operands.to_vec());
    let here = Operands { everywhere: operands.to_vec(), numbers: vec![] };
    let everywhere = directions.iter().map(Vec::as_slice).collect();
    let changes = Operands { everywhere, numbers: vec![] };
    let mut pushed = vec![0.0; n_rows];
    operator.push(&here, &kept, &changes, &mut pushed);
    let bars: Vec<f64> = (0..n_rows).map(|i| wave(i, 5)).collect();
    let mut adjoints: Vec<Vec<f64>> = operands.iter().map(|of| vec![0.0; of.len()]).collect();
    let everywhere = adjoints.iter_mut().map(Vec::as_mut_slice).collect();
    let mut into = Adjoints { everywhere, numbers: vec![] };
    operator.pull(&here, &kept, &bars, &mut into);
    let error = |a: f64, b: f64| (a - b).abs() / (1.0 + b.abs());
    let differences =
        moved(STEP).into_iter().zip(moved(-STEP)).map(|(a, b)| (a - b) / (2.0 * STEP));
    let of_push = pushed.iter().zip(differences).map(|(a, b)| error(*a, b)).fold(0.0, f64::max);
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let pulled: f64 = adjoints.iter().zip(&directions).map(|(a, d)| product(a, d)).sum();
    of_push.max(error(pulled, product(&bars, &pushed)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::manifold::{Eikonal, Gradient, Paths};
    use crate::mesh::Surface;
    use crate::table::Finer;

    /// Slowness and ratio, or anything else, at the vertices of an atrium.
    fn waves(mesh: &TriMesh) -> [Vec<f64>; 2] {
        let of = |k: f64| {
            let wave = |p: &[f64; 3]| 1.3 + 0.4 * (k * p[0] + 0.02 * p[1]).sin();
            mesh.vertices().iter().map(wave).collect()
        };
        [of(0.05), of(0.03)]
    }

    #[test]
    fn derivatives_of_those_that_ship_are_those_of_differences() {
        let mesh = Surface::left_atrium(3.0).mesh;
        let [slowness, ratio] = waves(&mesh);
        let rows: Vec<u32> = (0..mesh.n_vertices() as u32).step_by(17).collect();
        let paths = Paths::new(&mesh, 5).unwrap();
        let of_row =
            |row: &u32| (0..).zip(paths.weights(*row)).filter(|(_, w)| *w != 0.0).collect();
        let along = Along { weights: rows.iter().map(of_row).collect() };
        let slope = Slope { gradient: Gradient::new(&mesh), rows: rows.clone() };
        let at = |row: &u32| (vec![(5, None)], *row);
        let solver = Eikonal::new(&mesh, None).unwrap().into();
        let finer = Finer::new((mesh.clone(), None), vec![], None).into();
        let arrival = Arrival::new(solver, finer, rows.iter().map(at).collect());
        for (name, error) in [
            ("path", operator_error(&along, &[&slowness], rows.len())),
            ("gradient", operator_error(&slope, &[&slowness], rows.len())),
            ("eikonal", operator_error(&arrival, &[&slowness, &ratio, &ratio], rows.len())),
        ] {
            println!("{name}: {error:e}");
            assert!(error < 1e-6, "{name}: {error:e}");
        }
    }

    /// Of a length of a vector, but one of these is wrong.
    #[derive(Debug)]
    struct Wrong {
        push: f64,
        pull: f64,
    }

    impl Operator for Wrong {
        fn forward(&self, of: &Operands<'_>, _: &mut Memo, out: &mut [f64]) {
            out[0] = of.everywhere[0].iter().map(|x| x * x).sum();
        }
        fn push(&self, of: &Operands<'_>, _: &Memo, changes: &Operands<'_>, out: &mut [f64]) {
            let both = of.everywhere[0].iter().zip(changes.everywhere[0]);
            out[0] = both.map(|(x, d)| self.push * x * d).sum();
        }
        fn pull(&self, of: &Operands<'_>, _: &Memo, bars: &[f64], into: &mut Adjoints<'_>) {
            for (into, x) in into.everywhere[0].iter_mut().zip(of.everywhere[0]) {
                *into += self.pull * x * bars[0];
            }
        }
    }

    #[test]
    fn wrong_derivatives_are_found() {
        let error = |push: f64, pull: f64| operator_error(&Wrong { push, pull }, &[&[0.4, 1.2]], 1);
        assert!(error(2.0, 2.0) < 1e-9);
        assert!(error(2.1, 2.1) > 1e-2 && error(2.0, 2.1) > 1e-2 && error(2.1, 2.0) > 1e-2);
    }
}
