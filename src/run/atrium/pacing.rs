//! Which vertices are paced, and when.

use super::{AtriumError, Ground, PacingSettings};
use crate::ep::surface::Pacing;
use crate::mesh::Refined;

/// How many of a field's values a message lists.
const LISTED: usize = 12;

impl PacingSettings {
    /// When stimuli begin, ms: the S1 train, then each further interval.
    fn times(&self) -> Vec<f64> {
        let mut times: Vec<f64> = (0..self.beats).map(|beat| f64::from(beat) * self.s1).collect();
        for interval in &self.extra {
            times.push(times.last().map_or(0.0, |last| last + interval));
        }
        times
    }

    /// On the refined mesh of the ground's surface.
    pub(super) fn on(&self, ground: &Ground, refined: &Refined) -> Result<Pacing, AtriumError> {
        let is_paced = match &self.pace_region {
            Some((name, value)) => region(name, *value, ground, refined)?,
            None => self.discs(ground, refined)?,
        };
        let times = self.times();
        Ok(Pacing {
            vertices: (0..).zip(is_paced).filter(|(_, paced)| *paced).map(|(v, _)| v).collect(),
            end: times.last().map_or(0.0, |last| last + self.last),
            strength: self.strength,
            measured: self.measure.map_or(times.len(), |beat| beat as usize).saturating_sub(1),
            times,
        })
    }

    /// Which vertices are near one of those that are named.
    fn discs(&self, ground: &Ground, refined: &Refined) -> Result<Vec<bool>, AtriumError> {
        let surface = &ground.surface;
        let mut is_paced = vec![false; refined.mesh.n_vertices()];
        for &vertex in &self.pace {
            let n_vertices = surface.n_source_vertices;
            let centre = surface
                .vertex_of_source(vertex)
                .ok_or(AtriumError::NoVertex { vertex, n_vertices })?;
            let centre = surface.mesh.vertices()[centre as usize];
            for (is_paced, p) in is_paced.iter_mut().zip(refined.mesh.vertices()) {
                let square: f64 = (0..3).map(|k| (p[k] - centre[k]).powi(2)).sum();
                *is_paced |= square <= self.radius * self.radius;
            }
        }
        Ok(is_paced)
    }
}

/// Which vertices are in a region; of the new ones those between two of its vertices.
fn region(
    name: &str,
    value: f64,
    ground: &Ground,
    refined: &Refined,
) -> Result<Vec<bool>, AtriumError> {
    let Some(field) = ground.surface.scalar(name) else {
        return Err(AtriumError::NoPointData {
            what: format!("--pace-region {name}={value}: the surface has no data {name}"),
            found: ground.names(),
            help: "give one of these names, or vertices with --pace".to_owned(),
        });
    };
    let is_in: Vec<bool> = field.iter().map(|x| (x - value).abs() < 1e-9).collect();
    if !is_in.contains(&true) {
        let mut lowest = field;
        lowest.sort_by(f64::total_cmp);
        lowest.dedup();
        lowest.truncate(LISTED);
        return Err(AtriumError::NoRegion { name: name.to_owned(), value, lowest });
    }
    Ok(refined.carry(is_in, |a, b| a && b))
}
