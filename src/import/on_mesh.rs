//! A map that stands on a mesh: values in a mesh file, or in a file beside it, count as measurements at
//! its vertices.

use std::path::{Path, PathBuf};

use super::{Ground, ImportError, Map, QUANTITIES, Study};
use crate::mesh::{self, Surface, Units};

/// What the user says of a file that does not tell by itself.
#[derive(Clone, Debug, Default)]
pub struct Given {
    /// The mesh that a pacing log, or values without a mesh, belong to.
    pub mesh: Option<PathBuf>,
    /// Unit of the mesh's coordinates; without it what its format or its size says.
    pub units: Option<Units>,
    /// The quantity that the values are: one of [`QUANTITIES`].
    pub quantity: Option<String>,
    /// The array of the mesh that holds it.
    pub array: Option<String>,
    /// The frame of an `.igb` file, from 0.
    pub frame: Option<usize>,
}

/// Names under which programs write a quantity, in lower case.
const ALIASES: [(&str, &[&str]); 3] = [
    ("bipolar", &["bipolar", "bip", "bipolar_voltage", "voltage", "bi_voltage"]),
    ("unipolar", &["unipolar", "uni", "unipolar_voltage", "uni_voltage"]),
    (
        "lat",
        &[
            "lat",
            "act",
            "activation",
            "activation_time",
            "activation_times",
            "local_activation_time",
        ],
    ),
];

impl Given {
    /// Complains about anything that is said of an export, which tells all of it.
    pub(super) fn check_unused(&self, path: &Path) -> Result<(), ImportError> {
        let said = [
            ("--mesh", self.mesh.is_some()),
            ("--units", self.units.is_some()),
            ("--as", self.quantity.is_some()),
            ("--array", self.array.is_some()),
            ("--frame", self.frame.is_some()),
        ];
        match said.iter().find(|(_, is_said)| *is_said) {
            None => Ok(()),
            Some((option, _)) => Err(ImportError::Unusable {
                file: path.display().to_string(),
                what: format!(
                    "{option} is not for an export, which has its surface and says its quantities"
                ),
                help: format!("leave {option} out"),
            }),
        }
    }

    /// Reads and mends a mesh.
    pub(super) fn surface(&self, path: &Path) -> Result<Surface, ImportError> {
        Ok(mesh::repair(path, self.units, 0.0)?)
    }

    /// The surface of `mesh`, if one is given.
    pub(super) fn ground(&self) -> Result<Option<Ground>, ImportError> {
        let Some(path) = &self.mesh else { return Ok(None) };
        Ok(Some(Ground::Surface(Box::new(self.surface(path)?))))
    }
}

/// The quantity that programs write under this name.
fn quantity_of(name: &str) -> Option<&'static str> {
    let plain = name.to_ascii_lowercase().replace([' ', '-'], "_");
    let found = ALIASES.iter().find(|(_, aliases)| aliases.contains(&plain.as_str()));
    found.map(|(quantity, _)| *quantity)
}

/// Reads a mesh file with values at its vertices.
///
/// # Errors
/// [`ImportError::Mesh`]; no array of the name given.
pub(super) fn read(path: &Path, given: &Given) -> Result<Study, ImportError> {
    let mut surface = given.surface(path)?;
    let remarks = name_arrays(&mut surface, path, given)?;
    Ok(study(path, surface, remarks))
}

/// Reads numbers for each vertex of the mesh that is given.
///
/// # Errors
/// No mesh, another number of vertices, or no word on what they are.
pub(super) fn read_values(
    path: &Path,
    mut values: Vec<f64>,
    given: &Given,
) -> Result<Study, ImportError> {
    let unusable = |what: String, help: &str| ImportError::Unusable {
        file: path.display().to_string(),
        what,
        help: help.into(),
    };
    let Some(mesh) = &given.mesh else {
        let help = "name it with --mesh FILE";
        return Err(unusable("the mesh that these values belong to is missing".into(), help));
    };
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let Some(quantity) = given.quantity.as_deref().or_else(|| quantity_of(&stem)) else {
        let help = "say --as lat, bipolar or unipolar";
        return Err(unusable("the name does not tell what the values are".into(), help));
    };
    let mut surface = given.surface(mesh)?;
    if values.len() != surface.n_source_vertices {
        let what = format!(
            "{} values, but {} has {} vertices",
            values.len(),
            mesh.display(),
            surface.n_source_vertices
        );
        return Err(unusable(
            what,
            "only values at vertices are read; check that the two belong together",
        ));
    }
    let mut remarks = vec![];
    if quantity == "lat" {
        let n = values.iter().filter(|x| **x < 0.0).count();
        values.iter_mut().filter(|x| **x < 0.0).for_each(|x| *x = f64::NAN);
        if n > 0 {
            remarks.push(format!("{n} vertices have a negative time: they were not activated"));
        }
    }
    let kept: Vec<f64> = surface.source_vertex.iter().map(|v| values[*v as usize]).collect();
    surface.point_data.insert(quantity.into(), kept.into());
    Ok(study(path, surface, remarks))
}

fn study(path: &Path, surface: Surface, remarks: Vec<String>) -> Study {
    let name = path.file_stem().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
    let ground = Some(Ground::Surface(Box::new(surface)));
    let map = Map { name, ground, remarks, ..Map::default() };
    Study { format: "values on a mesh".into(), maps: vec![map], remarks: vec![] }
}

/// Gives the arrays that are quantities their own names, and tells what was taken for what.
fn name_arrays(
    surface: &mut Surface,
    path: &Path,
    given: &Given,
) -> Result<Vec<String>, ImportError> {
    let known = surface.names();
    let listed = if known.is_empty() { "none".into() } else { known.join(", ") };
    let mut taken: Vec<(&str, &String)> = vec![];
    if let Some(array) = &given.array {
        if !known.contains(array) {
            return Err(ImportError::Unusable {
                file: path.display().to_string(),
                what: format!("no array `{array}` at the vertices; it has: {listed}"),
                help: "say --array NAME with one of these".into(),
            });
        }
        let quantity = given.quantity.as_deref().or_else(|| quantity_of(array));
        let Some(quantity) = quantity else {
            return Err(ImportError::Unusable {
                file: path.display().to_string(),
                what: format!("the name `{array}` does not tell what its values are"),
                help: "say --as lat, bipolar or unipolar".into(),
            });
        };
        taken.push((quantity, array));
    } else {
        for (quantity, _) in QUANTITIES {
            let found = known.iter().find(|name| quantity_of(name) == Some(quantity));
            taken.extend(found.map(|array| (quantity, array)));
        }
    }
    let mut remarks = vec![];
    for (quantity, array) in &taken {
        if let Some(values) = surface.scalar(array) {
            surface.point_data.remove(*array);
            surface.point_data.insert((*quantity).to_owned(), values.into());
            if *quantity != array.as_str() {
                remarks.push(format!("array `{array}` is taken as {quantity}"));
            }
        }
    }
    if taken.is_empty() {
        remarks.push(format!(
            "no array at the vertices is known to be a measurement (there are: {listed}); --array NAME --as lat says so"
        ));
    }
    Ok(remarks)
}
