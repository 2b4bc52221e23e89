//! Fields and derived quantities over the surface, with the truth beside them where it is known.

use std::borrow::Cow;

use crate::experiment::{coverage, rms_error};
use crate::manifold::Basis;
use crate::mesh::Surface;
use crate::model::{Asked, Exceedance, MapSummary, Maps, Model, Summaries};
use crate::report::FieldDraws;

/// What the names of maps of quantiles end with.
const QUANTILES: [&str; 3] = ["_q5", "_q50", "_q95"];

/// A field or derived quantity at every vertex.
#[derive(Clone, Debug)]
pub struct FittedMap {
    /// Name in the model file.
    pub name: String,
    /// Declared unit.
    pub unit: String,
    /// Mean over the draws (n_vertices); NaN where no draw is physical.
    pub mean: Vec<f64>,
    /// Standard deviation over the draws (n_vertices); NaN where fewer than two are physical.
    pub sd: Vec<f64>,
    /// 5, 50 and 95 % quantiles of the draws (n_vertices); NaN where no draw is physical.
    pub quantiles: [Vec<f64>; 3],
    /// Share of (vertex, draw) pairs outside the declared range; `None` if there is none.
    pub outside: Option<f64>,
    /// The truth (n_vertices), where it is known.
    pub truth: Option<Vec<f64>>,
    /// How much of the surface has its truth in the central 50, 90 and 95 % interval of the draws.
    pub coverage: Option<[f64; 3]>,
}

impl FittedMap {
    /// Root mean squared error of the mean over the surface, in the map's unit.
    pub fn rmse(&self) -> Option<f64> {
        self.truth.as_ref().map(|truth| rms_error(&self.mean, truth))
    }

    /// Independent standard errors, `|mean − truth| / sd` (n_vertices).
    pub fn ise(&self) -> Option<Vec<f64>> {
        let truth = self.truth.as_ref()?;
        let errors = self.mean.iter().zip(truth).map(|(m, t)| m - t);
        Some(errors.zip(&self.sd).map(|(e, sd)| e.abs() / sd).collect())
    }
}

/// All maps of a fit.
#[derive(Clone, Debug)]
pub(super) struct SurfaceMaps {
    pub(super) maps: Vec<FittedMap>,
    /// Share of unphysical draws (n_vertices).
    pub(super) unphysical: Vec<f64>,
    /// Probabilities that were asked for (n_vertices), by name.
    exceeded: Vec<(String, Vec<f64>)>,
}

/// Values at the vertices, with their name and unit.
pub(super) struct VertexArray<'m> {
    pub(super) name: String,
    pub(super) unit: String,
    pub(super) values: Cow<'m, [f64]>,
    /// Whether it is in the files alone, for the page would grow too large.
    pub(super) is_quantile: bool,
}

impl SurfaceMaps {
    pub(super) fn new(
        model: &Model,
        basis: &Basis,
        draws: &[Vec<f64>],
        truth: &[(String, Vec<f64>)],
        asked: &[Exceedance],
    ) -> Self {
        // the truth is in the order of the model's maps
        let values: Vec<&[f64]> = truth.iter().map(|(_, map)| map.as_slice()).collect();
        let wanted = Asked { exceed: asked, truth: &values };
        let Summaries { maps: summaries, unphysical, exceeded } =
            Maps::new(model, basis).summarise(draws, &wanted);
        let fitted = |MapSummary { name, unit, mean, sd, quantiles, outside, rank }| {
            let truth = truth.iter().find(|(of, _)| *of == name).map(|(_, map)| map.clone());
            let coverage = rank.map(|rank| coverage(&rank));
            FittedMap { name, unit, mean, sd, quantiles, outside, truth, coverage }
        };
        Self {
            maps: summaries.into_iter().map(fitted).collect(),
            unphysical,
            exceeded: asked.iter().map(Exceedance::name).zip(exceeded).collect(),
        }
    }

    /// 1 at vertices where every map has a mean and a standard deviation, else 0: no draw is physical there.
    fn known(&self) -> Vec<f64> {
        let has = |v: usize| self.maps.iter().all(|m| m.mean[v].is_finite() && m.sd[v].is_finite());
        (0..self.unphysical.len()).map(|v| f64::from(u8::from(has(v)))).collect()
    }

    /// All that `fields.vtp` and the page show: the maps, then what the mesh's file brought along.
    pub(super) fn arrays(&self, surface: &Surface) -> Vec<VertexArray<'_>> {
        let mut arrays: Vec<VertexArray<'_>> = vec![];
        let mut push = |name: String, unit: &str, values| {
            let is_quantile = QUANTILES.iter().any(|q| name.ends_with(q));
            arrays.push(VertexArray { name, unit: unit.to_owned(), values, is_quantile });
        };
        for map in &self.maps {
            let named = |suffix: &str| format!("{}_{suffix}", map.name);
            push(named("mean"), &map.unit, Cow::from(&map.mean));
            push(named("sd"), &map.unit, Cow::from(&map.sd));
            if let (Some(truth), Some(ise)) = (&map.truth, map.ise()) {
                push(named("true"), &map.unit, Cow::from(truth));
                push(named("ise"), "", Cow::from(ise));
            }
        }
        for map in &self.maps {
            for (suffix, values) in QUANTILES.iter().zip(&map.quantiles) {
                push(format!("{}{suffix}", map.name), &map.unit, Cow::from(values));
            }
        }
        for (name, probability) in &self.exceeded {
            push(name.clone(), "1", Cow::from(probability));
        }
        push("unphysical".to_owned(), "1", Cow::from(&self.unphysical));
        push("known".to_owned(), "1", Cow::from(self.known()));
        // an earlier run's fields.vtp as the mesh has maps of these names already
        let n_own = arrays.len();
        for (name, values) in surface.scalars() {
            if arrays[..n_own].iter().all(|own| own.name != name) {
                let (unit, values) = (String::new(), Cow::from(values));
                arrays.push(VertexArray { name, unit, values, is_quantile: false });
            }
        }
        arrays
    }
}

/// The draws of the fields; `None` if the model has no field.
pub(super) fn field_draws<'b>(
    model: &Model,
    basis: &'b Basis,
    draws: &[Vec<f64>],
) -> Option<FieldDraws<'b>> {
    let maps = Maps::new(model, basis);
    if maps.n_fields() == 0 {
        return None;
    }
    let (n_modes, fields) = maps.coefficients(draws);
    let rows = (0..basis.n_vertices()).flat_map(|v| &basis.at(v)[..n_modes]);
    let is_whole = n_modes == basis.n_modes();
    Some(FieldDraws {
        n_modes,
        eigenfunctions: if is_whole {
            Cow::from(&basis.eigenfunctions)
        } else {
            rows.copied().collect()
        },
        coefficients: fields.into_iter().map(|(name, c)| (name.into(), c)).collect(),
        within: maps.links().map(|(name, within)| (name.into(), within)).collect(),
    })
}
