//! A finished run as its folder has it: what its pictures are drawn from.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::super::rows::read_rows;
use super::super::summary::read_summary_json;
use super::super::text::shown;
use super::super::zarr::read_integers;
use super::super::{EMBEDDED_ATRIUM, PredictedRow, ReportError, Row, RunRecord};
use super::palette::Palette;
use super::picture::Picture;
use super::surface::{self, Block, Ground, range};
use super::traces::Scalar;
use super::{Style, Uncertainty, scatter, traces};
use crate::diagnostics::quantile;
use crate::mesh::{self, Reading, Units};

/// A finished run.
#[derive(Debug)]
pub(super) struct Finished {
    folder: PathBuf,
    record: RunRecord,
}

/// The surface of a run with the arrays on it.
#[derive(Debug)]
pub(super) struct Maps {
    pub(super) ground: Ground,
    arrays: BTreeMap<String, Vec<f64>>,
}

impl Finished {
    /// Of this folder.
    ///
    /// # Errors
    /// [`ReportError::Read`], [`ReportError::Malformed`].
    pub(super) fn read(folder: &Path) -> Result<Self, ReportError> {
        let record = RunRecord::read(&folder.join("run.json"))?;
        Ok(Self { folder: folder.to_owned(), record })
    }

    /// The path of a file that the run left.
    fn own(&self, name: &str) -> Result<PathBuf, ReportError> {
        self.record.own(&self.folder, name)
    }

    /// `fields.vtp`; `None` of a model without a surface.
    pub(super) fn maps(&self) -> Result<Option<Maps>, ReportError> {
        if !self.folder.join("fields.vtp").is_file() {
            return Ok(None);
        }
        let path = self.own("fields.vtp")?;
        let reading = Reading { units: Some(Units::Mm), ..Reading::default() };
        let surface = mesh::read(&path, reading).map_err(|error| ReportError::Malformed {
            path: path.clone(),
            reason: error.to_string(),
        })?;
        let mut sites = vec![];
        for vertex in self.vertices()? {
            sites.extend(usize::try_from(vertex).ok().and_then(|v| surface.vertex_of_source(v)));
        }
        sites.sort_unstable();
        sites.dedup();
        let is_atrium = self.record.provenance.mesh.as_deref() == Some(EMBEDDED_ATRIUM);
        let arrays = surface.scalars();
        Ok(Some(Maps { ground: Ground { mesh: surface.mesh, is_atrium, sites }, arrays }))
    }

    /// Vertices of all measurements, from `posterior.zarr`; none of a run that has not kept them.
    fn vertices(&self) -> Result<Vec<i64>, ReportError> {
        let group = self.folder.join("posterior.zarr").join("constant_data");
        let Ok(entries) = std::fs::read_dir(&group) else { return Ok(vec![]) };
        let mut vertices = vec![];
        for entry in entries {
            let path = entry.map_err(ReportError::read(&group))?.path();
            if path.file_name().is_some_and(|name| name.to_string_lossy().ends_with("_vertex")) {
                vertices.extend(read_integers(&path)?);
            }
        }
        Ok(vertices)
    }

    /// Mean and standard deviation of every field and derived map.
    pub(super) fn fields(&self, style: Style) -> Result<Vec<Picture>, ReportError> {
        let Some(maps) = self.maps()? else { return Ok(vec![]) };
        Ok(maps.names(["_mean", "_sd"]).map(|name| self.field(&maps, name, style)).collect())
    }

    fn field(&self, maps: &Maps, name: &str, style: Style) -> Picture {
        let [mean, sd] = ["mean", "sd"].map(|what| maps.array(name, what));
        let (named, unit) = (format!("field_{name}"), self.unit(name));
        let sides = surface::sides(&maps.ground);
        let block = |what: &str, values, palette| {
            Block::new(format!("{name}: {what}{}", in_brackets(unit)), unit, values, palette)
        };
        let lines = style.isochrones.filter(|_| unit == "ms");
        let mean = Block { lines, ..block("posterior mean", mean, Palette::Values) };
        if style.uncertainty == Uncertainty::Beside {
            let sd = block("posterior standard deviation", sd, Palette::Spread);
            let shows = format!("{name}, posterior mean and standard deviation, {sides}");
            return surface::picture(named, shows, &maps.ground, &[mean, sd]);
        }
        let mut known: Vec<f64> = sd.iter().copied().filter(|sd| sd.is_finite()).collect();
        known.sort_by(f64::total_cmp);
        // a map that is known everywhere does not fade
        let most =
            if known.is_empty() { 1.0 } else { quantile(&known, 0.95).max(f64::MIN_POSITIVE) };
        let title =
            format!("{}; grey where its sd reaches the surface's 95th percentile", mean.title);
        let shows =
            format!("{name}, posterior mean, fading to grey where it is uncertain, {sides}");
        let faded = Block { fades: Some((sd, most)), title, ..mean };
        surface::picture(named, shows, &maps.ground, &[faded])
    }

    /// Where the truth is known: it, the mean, and their difference.
    pub(super) fn truth(&self) -> Result<Vec<Picture>, ReportError> {
        let Some(maps) = self.maps()? else { return Ok(vec![]) };
        let picture = |name: &str| {
            let [truth, mean] = ["true", "mean"].map(|what| maps.array(name, what));
            let difference: Vec<f64> =
                mean.iter().zip(truth).map(|(mean, truth)| mean - truth).collect();
            let unit = self.unit(name);
            let block = |what: &str, values, palette| {
                let title = format!("{name}: {what}{}", in_brackets(unit));
                let range = range(palette, &[truth, mean]);
                Block { range, ..Block::new(title, unit, values, palette) }
            };
            let off = format!("{name}: mean − truth{}", in_brackets(unit));
            let blocks = [
                block("truth", truth, Palette::Values),
                block("posterior mean", mean, Palette::Values),
                Block::new(off, unit, &difference, Palette::Difference),
            ];
            let shows = format!("{name}: truth, posterior mean and their difference");
            surface::picture(format!("truth_{name}"), shows, &maps.ground, &blocks)
        };
        Ok(maps.names(["_true", "_mean"]).map(picture).collect())
    }

    /// Shares of draws: outside a declared range, and of the events that `--exceed` asked for.
    pub(super) fn shares(&self) -> Result<Vec<Picture>, ReportError> {
        let Some(maps) = self.maps()? else { return Ok(vec![]) };
        let is_share = |name: &&String| name.as_str() == "unphysical" || name.starts_with("P_");
        let picture = |name: &String| {
            let values = maps.arrays[name].as_slice();
            let what = match name.strip_prefix("P_") {
                Some(event) => format!(
                    "probability of {}",
                    event.replace("_gt_", " > ").replace("_lt_", " < ")
                ),
                None => "share of draws outside a declared range".into(),
            };
            let most = values.iter().copied().filter(|x| x.is_finite()).fold(0.0, f64::max);
            // a probability is told on the whole scale, a share that is small throughout on its own
            let most = if name.starts_with("P_") || most <= 0.0 { 1.0 } else { most };
            let block = Block {
                range: [0.0, most],
                ..Block::new(what.clone(), "", values, Palette::Spread)
            };
            surface::picture(format!("share_{name}"), what, &maps.ground, &[block])
        };
        Ok(maps.arrays.keys().filter(is_share).map(picture).collect())
    }

    /// Predicted against measured.
    pub(super) fn predicted(&self) -> Result<Vec<Picture>, ReportError> {
        let has_rows = self.folder.join("rows.csv").is_file();
        let rows: Vec<PredictedRow> =
            if has_rows { read_rows(&self.own("rows.csv")?)? } else { vec![] };
        Ok(scatter::pictures(&rows))
    }

    /// Traces and ranks of every scalar parameter.
    pub(super) fn traces(&self) -> Result<Vec<Picture>, ReportError> {
        let rows: Vec<Row> = read_summary_json(&self.own("summary.json")?)?;
        Ok(traces::pictures(&self.scalars()?, &rows))
    }

    /// The columns of `draws.csv` that are no elements of an array.
    fn scalars(&self) -> Result<Vec<Scalar>, ReportError> {
        let path = self.own("draws.csv")?;
        let malformed = |reason: String| ReportError::Malformed { path: path.clone(), reason };
        let mut reader =
            csv::Reader::from_path(&path).map_err(|error| malformed(error.to_string()))?;
        let titles = reader.headers().map_err(|error| malformed(error.to_string()))?.clone();
        let columns: Vec<usize> = (2..titles.len()).filter(|k| !titles[*k].contains('[')).collect();
        let scalar = |k: &usize| Scalar { name: titles[*k].to_owned(), chains: vec![] };
        let mut scalars: Vec<Scalar> = columns.iter().map(scalar).collect();
        let mut record = csv::StringRecord::new();
        while reader.read_record(&mut record).map_err(|error| malformed(error.to_string()))? {
            let chain = record.get(0).and_then(|chain| chain.parse::<usize>().ok());
            for (scalar, k) in scalars.iter_mut().zip(&columns) {
                let draw = record.get(*k).and_then(|draw| draw.parse::<f64>().ok());
                let (Some(chain), Some(draw)) = (chain, draw) else {
                    let line = record.position().map_or(0, csv::Position::line);
                    return Err(malformed(format!("line {line}: no draw of {}", scalar.name)));
                };
                if chain >= scalar.chains.len() {
                    scalar.chains.resize(chain + 1, vec![]);
                }
                scalar.chains[chain].push(draw);
            }
        }
        Ok(scalars)
    }

    /// Empty for a number without one.
    fn unit(&self, name: &str) -> &str {
        self.record.units.get(name).map_or("", |unit| shown(unit))
    }
}

/// ` (ms)`, or nothing.
fn in_brackets(unit: &str) -> String {
    if unit.is_empty() { String::new() } else { format!(" ({unit})") }
}

impl Maps {
    /// Names of the maps that have arrays with both endings.
    fn names<'m>(&'m self, [first, second]: [&'m str; 2]) -> impl Iterator<Item = &'m str> {
        let names = self.arrays.keys().filter_map(move |name| name.strip_suffix(first));
        names.filter(move |name| self.arrays.contains_key(&format!("{name}{second}")))
    }

    /// An array of one of [`Maps::names`].
    fn array(&self, name: &str, what: &str) -> &[f64] {
        self.arrays.get(&format!("{name}_{what}")).map_or(&[], Vec::as_slice)
    }
}
