//! The measurements against what the model predicts of them.

use std::collections::BTreeMap;
use std::io;

use rayon::prelude::*;

use super::reading::{Reading, groups};
use crate::diagnostics::quantile;
use crate::diagnostics::verdict::{Fits, Misfit, Within};
use crate::model::Observe;
use crate::report::Values;
use crate::run::Fit;
use crate::table::{Measurements, SITE};

/// Most misfits that are named.
const MOST_NAMED: usize = 3;
/// A measurement beyond everything predicted by more than this many times what predictions reach from
/// their median is impossible.
const REACH: f64 = 3.0;

/// One measurement and its predictions.
struct Judged {
    /// Row of the table.
    row: usize,
    is_inside: bool,
    is_impossible: bool,
    /// How far outside its interval, in widths of the interval.
    excess: f64,
    predicted: [f64; 2],
}

impl Reading {
    /// Against replicates in ascending order.
    fn judged(&self, row: usize, sorted: &[f64]) -> Judged {
        let [q5, median, q95] = [0.05, 0.5, 0.95].map(|p| quantile(sorted, p));
        let rounding = self.rounding(median);
        let outside = self.outside([q5, q95]);
        let (least, most) = (sorted[0], sorted[sorted.len() - 1]);
        let beyond = |reach: f64, by: f64| by > REACH * reach.max(self.width) + rounding;
        Judged {
            row,
            is_inside: outside <= 0.0,
            is_impossible: beyond(most - median, self.low - most)
                || beyond(median - least, least - self.high),
            excess: outside / (q95 - q5).max(self.width).max(rounding),
            predicted: [q5, q95 + self.width],
        }
    }
}

impl Fit<'_> {
    /// The measurements against their predictive intervals; `None` if nothing can be simulated.
    ///
    /// # Errors
    /// From the disk that replicates are on.
    pub(super) fn fits(&self) -> io::Result<Option<Fits>> {
        let mut judged: Vec<(&Observe, Vec<Judged>)> = vec![];
        for observe in self.model().observes.iter().filter(|o| !o.rows.is_empty()) {
            judged.extend(self.judge(observe)?.map(|rows| (observe, rows)));
        }
        if judged.is_empty() {
            return Ok(None);
        }
        let table = self.problem().measurements();
        let (mut all_sets, sites) = (sets(&judged, table), sites(&judged, table));
        let n_kept = all_sets.len();
        all_sets.extend(sites);
        let mut fits = Fits::new(&all_sets, n_kept);
        let all = || judged.iter().flat_map(|(o, rows)| rows.iter().map(move |row| (*o, row)));
        fits.n_impossible = all().filter(|(_, row)| row.is_impossible).count();
        let mut outside: Vec<(&Observe, &Judged)> = all().filter(|(_, r)| !r.is_inside).collect();
        outside.sort_by(|a, b| b.1.excess.total_cmp(&a.1.excess));
        let misfit = |&(observe, row): &(&Observe, &Judged)| misfit(observe, row, table);
        fits.misfits = outside.iter().take(MOST_NAMED).map(misfit).collect();
        fits.doubts = [self.problem().doubts(), &self.breakthroughs()?, &self.regimes()?].concat();
        Ok(Some(fits))
    }

    /// Every measurement of a statement against its replicates.
    fn judge(&self, observe: &Observe) -> io::Result<Option<Vec<Judged>>> {
        let predictive = &self.posterior().posterior_predictive;
        let variable = predictive.variables.iter().find(|v| v.name == observe.name);
        let Some(Values::Columns(columns)) = variable.map(|v| &v.values) else { return Ok(None) };
        let observed = observe.observed();
        let one = |(i, row): (usize, &usize)| {
            let mut sorted = columns.column(i)?;
            sorted.retain(|x| x.is_finite());
            sorted.sort_unstable_by(f64::total_cmp);
            Ok((!sorted.is_empty()).then(|| Reading::of(&observed[i]).judged(*row, &sorted)))
        };
        let rows = observe.rows.par_iter().enumerate().with_min_len(self.at_once());
        let judged: io::Result<Vec<Option<Judged>>> = rows.map(one).collect();
        Ok(judged?.into_iter().collect())
    }
}

fn misfit(observe: &Observe, judged: &Judged, table: &Measurements) -> Misfit {
    let cells = observe.rows.iter().position(|row| *row == judged.row);
    let cells = cells.map_or(vec![], |i| observe.observed_row(i));
    Misfit {
        line: table.line(judged.row),
        place: format!("{} {}", observe.name, table.place(judged.row)),
        unit: observe.unit.clone(),
        measured: in_words(&cells),
        predicted: judged.predicted,
        is_impossible: judged.is_impossible,
    }
}

/// `240 to 250`, `above 240`, `below 60` or a number.
pub(super) fn in_words(cells: &[f64]) -> String {
    match *cells {
        [lower, upper] if lower.is_infinite() => format!("below {upper}"),
        [lower, upper] if upper.is_infinite() => format!("above {lower}"),
        [lower, upper] => format!("{lower} to {upper}"),
        _ => cells.iter().map(f64::to_string).collect(),
    }
}

/// All measurements, and those that belong together.
fn sets(judged: &[(&Observe, Vec<Judged>)], table: &Measurements) -> Vec<Within> {
    let all: Vec<(&str, &Judged)> =
        judged.iter().flat_map(|(o, rows)| rows.iter().map(|row| (o.name, row))).collect();
    let rows: Vec<(&str, usize)> = all.iter().map(|(name, judged)| (*name, judged.row)).collect();
    let set = |(name, own): &(String, Vec<usize>)| within(name, own.iter().map(|i| all[*i].1));
    groups(&rows, table).iter().map(set).collect()
}

/// Those at each site that has several.
fn sites(judged: &[(&Observe, Vec<Judged>)], table: &Measurements) -> Vec<Within> {
    let mut sites: BTreeMap<String, Vec<&Judged>> = BTreeMap::new();
    for row in judged.iter().flat_map(|(_, rows)| rows) {
        let site = table.cell(row.row, SITE).map(str::to_owned);
        let site = site.or_else(|| table.vertex(row.row).map(|v| format!("vertex {v}")));
        sites.entry(site.unwrap_or_default()).or_default().push(row);
    }
    sites.remove("");
    let several = sites.iter().filter(|(_, rows)| rows.len() > 1);
    several.map(|(site, rows)| within(&format!("site {site}"), rows.iter().copied())).collect()
}

fn within<'j>(name: &str, rows: impl Iterator<Item = &'j Judged>) -> Within {
    let mut set = Within { name: name.to_owned(), n: 0, inside: 0 };
    for row in rows {
        set.n += 1;
        set.inside += usize::from(row.is_inside);
    }
    set
}

#[cfg(test)]
mod tests {
    use super::*;

    fn judged(cells: &[f64], replicates: &[f64]) -> (bool, bool) {
        let judged = Reading::of(cells).judged(0, replicates);
        (judged.is_inside, judged.is_impossible)
    }

    #[test]
    fn a_bracket_is_compared_on_its_grid() {
        let replicates = [vec![220.0; 50], vec![230.0; 950]].concat();
        assert_eq!(judged(&[230.0, 240.0], &replicates), (true, false));
        assert_eq!(judged(&[240.0, 250.0], &replicates), (false, false));
        assert_eq!(judged(&[150.0, 160.0], &replicates), (false, true));
        assert_eq!(judged(&[270.0, 280.0], &replicates), (false, true));
        // open ends: below 240 is met by 230 to 240, above 240 is not
        assert_eq!(judged(&[f64::NEG_INFINITY, 240.0], &replicates), (true, false));
        assert_eq!(judged(&[240.0, f64::INFINITY], &replicates), (false, false));
        assert_eq!(judged(&[230.0, f64::INFINITY], &replicates), (true, false));
        assert_eq!(judged(&[f64::NEG_INFINITY, 220.0], &replicates), (false, false));
        assert_eq!(judged(&[300.0, f64::INFINITY], &replicates), (false, true));
    }

    #[test]
    fn a_number_is_impossible_far_beyond_all_replicates() {
        let replicates: Vec<f64> = (0..=1000).map(|i| 10.0 + f64::from(i) / 1000.0).collect();
        assert_eq!(judged(&[10.5], &replicates), (true, false));
        assert_eq!(judged(&[10.96], &replicates), (false, false));
        assert_eq!(judged(&[12.4], &replicates), (false, false));
        assert_eq!(judged(&[12.6], &replicates), (false, true));
        assert_eq!(judged(&[8.4], &replicates), (false, true));
    }
}
