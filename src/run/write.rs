//! The files of a fit.

use std::io::Write as _;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use serde_json::{Map, json};

use super::fit::{Fit, Method};
use super::folder::NewFiles;
use super::maps::{VertexArray, field_draws};
use super::results::{MEASUREMENTS, MODEL, Results, VERSION};
use super::unknowns::{self, Unknowns};
use super::{OutputFolder, RunError};
use crate::model::equations;
use crate::report::{
    self, FieldDraws, Group, Page, PointData, Predictions, RunRecord, Variable, write_draws,
    write_html, write_loo, write_rows, write_summary_csv, write_summary_json, write_zarr,
};
use crate::store::write_file;

impl Fit<'_> {
    /// Writes all that `eplat run` leaves into a folder.
    ///
    /// ```text
    /// summary.csv summary.json draws.csv posterior.zarr loo.csv fields.vtp field_draws.npz
    /// model.rs measurements.csv unknowns.npz rows.csv report.html run.json
    /// ```
    /// They take the place of all that an earlier run left there, when all of them are written.
    ///
    /// # Errors
    /// [`RunError::Unwritable`], [`RunError::Write`], [`RunError::Report`], [`RunError::Mesh`].
    pub fn write(&self, folder: impl AsRef<Path>) -> Result<Results, RunError> {
        self.write_into(&OutputFolder::open(folder)?)
    }

    /// As [`Fit::write`], into a folder that was tried before.
    ///
    /// # Errors
    /// Those of [`Fit::write`].
    pub fn write_into(&self, out: &OutputFolder) -> Result<Results, RunError> {
        let new = out.begin()?;
        let (record, files) = self.write_files(&new).map_err(|error| new.named(out, error))?;
        out.replace(&new, &files)?;
        Ok(Results {
            folder: out.path().to_owned(),
            record,
            rows: self.posterior().rows.clone(),
            files,
        })
    }

    /// Writes all files, the record last; the record, and their names.
    fn write_files(&self, new: &NewFiles) -> Result<(RunRecord, Vec<&'static str>), RunError> {
        let begun = Instant::now();
        let posterior = self.posterior();
        let surface = self.problem.loaded().surface();
        let arrays = surface.zip(self.surface_maps()).map(|(surface, maps)| maps.arrays(surface));
        let arrays = arrays.unwrap_or_default();
        let mut files = vec!["summary.csv", "summary.json", "draws.csv"];
        write_summary_csv(&new.file("summary.csv"), &posterior.rows)?;
        write_summary_json(&new.file("summary.json"), &posterior.rows)?;
        write_draws(&new.file("draws.csv"), &posterior.posterior)?;
        self.write_zarr(new, &arrays)?;
        files.push("posterior.zarr");
        if let Some(loo) = self.loo() {
            write_loo(&new.file("loo.csv"), &loo.rows)?;
            files.push("loo.csv");
        }
        files.extend(self.write_surface(new, &arrays)?);
        files.extend(self.write_inputs(new)?);
        if self.method != Method::Prior {
            Unknowns::new(self).write(&new.file(unknowns::FILE))?;
            files.push(unknowns::FILE);
        }
        let predictions = self.write_predictions(new)?;
        files.extend((!predictions.rows.is_empty()).then_some("rows.csv"));
        let mut record = self.record_after(begun.elapsed().as_secs_f64());
        let named: Vec<&str> = files.iter().copied().chain(["run.json"]).collect();
        self.write_page(new, &record, &arrays, (&predictions, &named))?;
        files.push("report.html");
        record.files = new.seals(&files)?;
        record.write(&new.file("run.json"))?;
        files.push("run.json");
        Ok((record, files))
    }

    /// The model's text and the table, as they were given; the names of the files.
    fn write_inputs(&self, new: &NewFiles) -> Result<Vec<&'static str>, RunError> {
        let (origin, table) = (&self.problem.loaded().origin, self.problem.measurements());
        let made = || (!table.is_empty()).then(|| Arc::from(table.to_csv().into_bytes()));
        let source = origin.model.as_ref().map(|model| Arc::from(model.text.as_bytes()));
        let contents: [(_, Option<Arc<[u8]>>); 2] =
            [(MODEL, source), (MEASUREMENTS, origin.table.clone().or_else(made))];
        let mut files = vec![];
        for (name, bytes) in contents {
            let Some(bytes) = bytes else { continue };
            let path = new.file(name);
            write_file(&path, |file| file.write_all(&bytes)).map_err(RunError::write(&path))?;
            files.push(name);
        }
        Ok(files)
    }

    /// Every measurement with its predictions; none for draws from the prior, which have seen none.
    fn write_predictions(&self, new: &NewFiles) -> Result<Predictions, RunError> {
        if self.method == Method::Prior {
            return Ok(Predictions::default());
        }
        let predictions = self.predictions()?;
        if !predictions.rows.is_empty() {
            write_rows(&new.file("rows.csv"), &predictions.rows)?;
        }
        Ok(predictions)
    }

    /// Maps and draws of the fields; the names of the files.
    fn write_surface(
        &self,
        new: &NewFiles,
        arrays: &[VertexArray<'_>],
    ) -> Result<Vec<&'static str>, RunError> {
        let Some(domain) = &self.problem.loaded().domain else { return Ok(vec![]) };
        let named: Vec<(&str, &[f64])> =
            arrays.iter().map(|array| (array.name.as_str(), &*array.values)).collect();
        domain.surface.write_maps(&new.file("fields.vtp"), &named)?;
        let mut files = vec!["fields.vtp"];
        if let Some(fine) = domain.surface.fine() {
            let carried: Vec<(&str, Vec<f64>)> =
                named.iter().map(|(name, values)| (*name, fine.carry(values))).collect();
            let carried: Vec<(&str, &[f64])> =
                carried.iter().map(|(name, values)| (*name, &values[..])).collect();
            fine.surface.write_maps(&new.file("fields_full.vtp"), &carried)?;
            files.push("fields_full.vtp");
        }
        if let Some(draws) = field_draws(self.model(), &domain.basis, &self.kept) {
            draws.write(&new.file(FieldDraws::FILE))?;
            files.push(FieldDraws::FILE);
        }
        Ok(files)
    }

    fn write_zarr(&self, new: &NewFiles, arrays: &[VertexArray<'_>]) -> Result<(), RunError> {
        let mut groups = self.posterior().groups();
        let fields;
        if self.problem.loaded().domain.is_some() {
            let variable = |VertexArray { name, unit, values, .. }: &VertexArray<'_>| {
                Variable::new(name, unit, &[("vertex", values.len())], values.to_vec())
            };
            let variables = arrays.iter().map(variable).collect();
            fields = Group { name: "fields".into(), variables };
            groups.push(&fields);
        }
        let mut attributes = Map::new();
        attributes.insert("model".into(), json!(self.model().name));
        attributes.insert("eplat_version".into(), json!(VERSION));
        Ok(write_zarr(&new.file("posterior.zarr"), &groups, &attributes)?)
    }

    fn write_page(
        &self,
        new: &NewFiles,
        record: &RunRecord,
        arrays: &[VertexArray<'_>],
        (predictions, files): (&Predictions, &[&str]),
    ) -> Result<(), RunError> {
        let surface = self.problem.loaded().surface();
        let sites: Vec<[f64; 3]> = surface.map_or(vec![], |s| {
            let vertices = self.problem.measurements().vertices();
            vertices.iter().map(|v| s.mesh.vertices()[*v as usize]).collect()
        });
        let data: Vec<PointData<'_>> = arrays
            .iter()
            .filter(|array| !array.is_quantile)
            .map(|VertexArray { name, unit, values, .. }| PointData { name, unit, values })
            .collect();
        let posterior = self.posterior();
        let page = Page {
            title: self.model().name,
            equations: &equations(self.model()),
            record,
            rows: &posterior.rows,
            posterior: &posterior.posterior,
            loo: self.loo(),
            predictions,
            files,
            surface: surface.map(|s| report::Surface {
                mesh: &s.mesh,
                point_data: &data,
                sites: &sites,
                axes: s.axes,
            }),
        };
        Ok(write_html(&new.file("report.html"), &page)?)
    }
}
