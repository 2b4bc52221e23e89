//! Whether measurements allow two regimes of the fields.

use std::io;

use crate::diagnostics::regimes::{APART, Between, Cut, Draws};
use crate::diagnostics::verdict::Doubt;
use crate::experiment::thinned;
use crate::mesh::Surface;
use crate::model::{MapName, Maps};
use crate::run::Fit;

/// Draws that are looked at.
const DRAWS: usize = 1000;
/// Most measured vertices that are looked at.
const VERTICES: usize = 400;
/// Least share of the draws in the smaller regime.
const LEAST: f64 = 0.02;
/// A field differs if its means are farther apart than so many standard deviations.
const DIFFERS: f64 = 2.0;

/// The fields at a vertex, cut in two.
struct Site {
    vertex: usize,
    cut: Cut,
    between: Between,
}

impl Fit<'_> {
    /// Regimes that the fields have at measured vertices, one for each region.
    ///
    /// # Errors
    /// From the disk that draws are on.
    pub(super) fn regimes(&self) -> io::Result<Vec<Doubt>> {
        let loaded = self.problem().loaded();
        let Some(basis) = loaded.basis() else { return Ok(vec![]) };
        let maps = Maps::new(self.model(), basis);
        let n_fields = maps.n_fields();
        let measured = self.problem().measurements().vertices();
        let step = measured.len().div_ceil(VERTICES).max(1);
        let vertices: Vec<usize> = measured.iter().step_by(step).map(|v| *v as usize).collect();
        if n_fields == 0 || vertices.is_empty() {
            return Ok(vec![]);
        }
        let draws = thinned(self.chains(), DRAWS)?;
        let cuts = maps.of_draws_at(&draws, &vertices, |maps| {
            let of_draw = |i: usize| maps[..n_fields].iter().map(move |map| map[i]);
            let draws = Draws::new(n_fields, (0..draws.len()).flat_map(of_draw).collect());
            let cut = draws.cut()?;
            let between = draws.between(&cut.is_high)?;
            let both_have_draws = (LEAST..=1.0 - LEAST).contains(&cut.high());
            (cut.apart > APART && cut.has_valley && both_have_draws).then_some((cut, between))
        });
        let of_vertex = |(vertex, cut): (&usize, Option<(Cut, Between)>)| {
            let (cut, between) = cut?;
            Some(Site { vertex: *vertex, cut, between })
        };
        let mut sites: Vec<Site> = vertices.iter().zip(cuts).filter_map(of_vertex).collect();
        sites.sort_by(|one, other| other.cut.apart.total_cmp(&one.cut.apart));
        let mut regions: Vec<(Site, usize)> = vec![];
        for site in sites {
            let is_same = |(first, _): &&mut (Site, usize)| site.cut.is_as(&first.cut);
            match regions.iter_mut().find(is_same) {
                Some((_, n)) => *n += 1,
                None => regions.push((site, 1)),
            }
        }
        Ok(regions
            .iter()
            .map(|(site, n)| site.doubt(*n, &maps.names(), loaded.surface()))
            .collect())
    }
}

impl Site {
    /// Of a region of `n` measured vertices whose regimes are farthest apart here.
    fn doubt(&self, n: usize, names: &[MapName<'_>], surface: Option<&Surface>) -> Doubt {
        let Between { means, variance, .. } = &self.between;
        let [smaller, larger] = if self.cut.high() < 0.5 { [1, 0] } else { [0, 1] };
        let apart =
            |(f, variance): (usize, &f64)| (means[1][f] - means[0][f]).abs() / variance.sqrt();
        let apart: Vec<f64> = variance.iter().enumerate().map(apart).collect();
        let field = |f: usize| {
            let MapName { name, unit, .. } = names[f];
            (name.to_owned(), unit.to_owned(), [smaller, larger].map(|which| means[which][f]))
        };
        Doubt::Regimes {
            vertex: surface
                .map_or(self.vertex as u32, |surface| surface.source_vertex[self.vertex]),
            n,
            share: self.cut.high().min(1.0 - self.cut.high()),
            fields: different(&apart).into_iter().map(field).collect(),
        }
    }
}

/// The fields that differ, by how many standard deviations their means are apart. Where none differs by itself, but a
/// combination of them does, these are the fields with more than half of the largest distance.
fn different(apart: &[f64]) -> Vec<usize> {
    let most = apart.iter().copied().fold(0.0, f64::max);
    let least = if most > DIFFERS { DIFFERS } else { 0.5 * most };
    (0..apart.len()).filter(|f| apart[*f] > least).collect()
}

#[cfg(test)]
mod tests {
    use super::different;

    #[test]
    fn some_field_is_named() {
        assert_eq!(different(&[2.5, 1.9, 4.0]), [0, 2]);
        assert_eq!(different(&[0.3, 1.8, 1.0]), [1, 2]);
    }
}
