//! Whether activation started at other places than the table says.

use std::io;

use crate::diagnostics::verdict::Doubt;
use crate::experiment::thinned;
use crate::model::Breakthrough;
use crate::run::Fit;

/// Draws at which a further start must explain the measurements better.
const DRAWS: usize = 5;
/// Places that are tried at first, spread over the surface.
const PLACES: usize = 100;
/// Then those within this distance of the best of them, mm.
const NEAR: f64 = 8.0;
/// Least gain of log likelihood, in every draw. A right model gained at most 1 (docs/verdict.md).
const LEAST: f64 = 4.0;

impl Fit<'_> {
    /// The activations that measurements ask a further start of.
    ///
    /// # Errors
    /// From the disk that draws are on.
    pub(super) fn breakthroughs(&self) -> io::Result<Vec<Doubt>> {
        let (model, loaded) = (self.model(), self.problem().loaded());
        let n = model.n_activations();
        let (Some(on), Some(surface), true) = (model.triangulation(), loaded.surface(), n > 0)
        else {
            return Ok(vec![]);
        };
        let draws = thinned(self.chains(), DRAWS)?;
        let Some(first) = draws.first() else { return Ok(vec![]) };
        let all = 0..on.mesh.n_vertices() as u32;
        let spread: Vec<u32> = all.clone().step_by(on.mesh.n_vertices().div_ceil(PLACES)).collect();
        let rough = model.breakthroughs(first, &vec![spread; n]);
        let point = |v: u32| nalgebra::Vector3::from(on.mesh.vertices()[v as usize]);
        let around = |best: &Option<Breakthrough>| -> Vec<u32> {
            let Some(best) = best else { return vec![] };
            all.clone().filter(|v| (point(*v) - point(best.vertex)).norm() < NEAR).collect()
        };
        let near: Vec<Vec<u32>> = rough.iter().map(around).collect();
        let found = model.breakthroughs(first, &near);
        let alone: Vec<Vec<u32>> =
            found.iter().map(|best| best.iter().map(|best| best.vertex).collect()).collect();
        let mut others = vec![];
        for draw in &draws[1..] {
            others.push(model.breakthroughs(draw, &alone));
        }
        let doubt = |(i, best): (usize, &Option<Breakthrough>)| {
            let best = best.as_ref()?;
            let of_others = others.iter().map(|all| all[i].as_ref().map_or(0.0, |own| own.gain));
            let gain = of_others.fold(best.gain, f64::min);
            let vertex = surface.source_vertex[on.vertices[best.vertex as usize] as usize];
            (gain > LEAST).then(|| Doubt::Breakthrough {
                activation: best.activation.clone(),
                vertex,
                later: best.later,
                gain,
                rows: best.rows,
            })
        };
        Ok(found.iter().enumerate().filter_map(doubt).collect())
    }
}
