//! Studies as laboratories have them: what a mapping system exports, what a simulation writes, what a
//! lab notes by hand.
//!
//! [`read`] looks at a folder, an archive or a file and gives a [`Study`]. [`select`] chooses one of
//! its maps, mends the surface and places the measurements; [`write()`] makes the folder that `eplat run`
//! takes: `surface.vtp`, `measurements.csv` and `import.json`. Knows nothing of models.

mod bundle;
mod carto;
mod distance;
mod ensite;
mod error;
mod matlab;
mod on_mesh;
mod opencarp;
mod openep;
mod pacing;
mod select;
mod study;
mod write;

use std::path::Path;

pub use bundle::Source;
pub use distance::from_surface;
pub use error::ImportError;
pub use on_mesh::Given;
pub use select::{Options, Row, Selected, select};
pub use study::{Ground, Map, Point, QUANTITIES, Reading, Shell, Site, Study, Value};
pub use write::{distances, histogram, write};

use crate::table::{Measurements, decode};
use bundle::{Bundle, has_extension};

/// What can be read, for messages.
const KNOWN: &str = "eplat reads an export of CARTO 3 or EnSite (folder or zip), an OpenEP file (.mat), a mesh with values at its vertices (.vtk, .vtp, .vtu, .ply, .npz, openCARP's .pts), openCARP's .dat and .igb (with --mesh), and a pacing log (.csv)";

/// Reads the study at `path`, a folder, an archive or a file, and what its files are.
///
/// # Errors
/// Nothing there is known, or a file is damaged.
pub fn read(path: &Path, given: &Given) -> Result<(Study, Vec<Source>), ImportError> {
    let mut bundle = Bundle::open(path)?;
    if bundle.is_file() {
        let file = bundle.names().first().cloned().unwrap_or_default();
        let study = read_file(&file, path, given, &mut bundle)?;
        let mut sources = bundle.sources();
        sources.extend(given.mesh.as_deref().map(bundle::source_of).transpose()?);
        return Ok((study, sources));
    }
    let study = if carto::is_carto(&mut bundle) {
        given.check_unused(path)?;
        carto::read(&mut bundle)?
    } else if ensite::is_ensite(&mut bundle) {
        given.check_unused(path)?;
        ensite::read(&mut bundle)?
    } else if let [file] = &bundle.with_extension("mat")[..] {
        given.check_unused(path)?;
        openep::read(file, bundle.read(file)?)?
    } else if let ([file], true) = (&single(&bundle)[..], path.is_dir()) {
        return read(&path.join(file), given);
    } else {
        return Err(unknown(&mut bundle));
    };
    Ok((study, bundle.sources()))
}

/// Extensions of files with a mesh.
const MESHES: [&str; 6] = ["vtk", "vtp", "vtu", "ply", "npz", "pts"];

/// The files that can be a study each.
fn single(bundle: &Bundle) -> Vec<String> {
    let other = ["mat", "mesh", "dat", "igb", "csv", "tsv"];
    // without elements, points are no mesh
    let is_mesh = |name: &String| {
        !has_extension(name, "pts")
            || bundle.find(&format!("{}elem", &name[..name.len() - "pts".len()])).is_some()
    };
    let is_known = |name: &String| MESHES.iter().chain(&other).any(|e| has_extension(name, e));
    let known = |name: &String| is_known(name) && is_mesh(name);
    bundle.names().iter().filter(|name| known(name)).cloned().collect()
}

/// A study in one file, by its extension.
fn read_file(
    file: &str,
    path: &Path,
    given: &Given,
    bundle: &mut Bundle,
) -> Result<Study, ImportError> {
    let is = |extension: &str| has_extension(file, extension);
    if is("mat") || is("mesh") {
        given.check_unused(path)?;
    }
    if is("mat") {
        return openep::read(file, bundle.read(file)?);
    }
    if is("mesh") {
        return carto::read(bundle);
    }
    if is("csv") || is("txt") || is("tsv") {
        bundle.read(file)?;
        let table = Measurements::read(path)?;
        if !pacing::is_log(&table) {
            return Err(ImportError::Unusable {
                file: path.display().to_string(),
                what: format!("no pacing log: it has {}", table.columns().join(", ")),
                help: "a log has columns s2 and captured, and site, vertex or x, y, z; a table of measurements needs no import: give it to run with --data".into(),
            });
        }
        let mut study = pacing::read(path, &table)?;
        for map in &mut study.maps {
            map.ground = given.ground()?;
        }
        return Ok(study);
    }
    if is("dat") {
        let values = opencarp::dat(file, &decode(&bundle.read(file)?))?;
        return on_mesh::read_values(path, values, given);
    }
    if is("igb") {
        let values = opencarp::igb(file, &bundle.read(file)?, given.frame)?;
        return on_mesh::read_values(path, values, given);
    }
    if MESHES.into_iter().any(is) {
        bundle.read(file)?;
        return on_mesh::read(path, given);
    }
    Err(unknown(bundle))
}

/// Says what is there instead of a study.
fn unknown(bundle: &mut Bundle) -> ImportError {
    let names = bundle.names().to_vec();
    let mut kinds = std::collections::BTreeMap::<String, usize>::new();
    for name in &names {
        let kind = Path::new(name).extension().map(|e| format!(".{}", e.to_string_lossy()));
        *kinds.entry(kind.unwrap_or_else(|| "no extension".into())).or_default() += 1;
    }
    let shown: Vec<String> = kinds.iter().take(12).map(|(kind, n)| format!("{n} {kind}")).collect();
    let found = if names.is_empty() { "no file".into() } else { shown.join(", ") };
    let mut is_binary = |name: &String| bundle.head(name, 1024).is_ok_and(|head| head.contains(&0));
    let sample = names.iter().take(50);
    let n_binary = sample.clone().filter(|name| is_binary(name)).count();
    let single = single(bundle);
    let archives = names.iter().filter(|name| bundle::has_extension(name, "zip")).count();
    let help = if bundle.is_file() && bundle::has_extension(&names.concat(), "xml") {
        "if this belongs to an export, give the folder that it lies in".to_owned()
    } else if names.len() > 1 && archives > 0 {
        "the folder holds archives: give one of them".to_owned()
    } else if names.len() > 1 && 2 * n_binary > sample.len() {
        format!(
            "most files are binary: this may be the mapping system's own study folder, which only the system can read; export the study on the workstation (CARTO: Export Study Data) and give that folder. {KNOWN}"
        )
    } else if !bundle.is_file() && (2..=12).contains(&single.len()) {
        format!("the files are no one study together; give one of them: {}", single.join(", "))
    } else {
        KNOWN.to_owned()
    };
    ImportError::Unknown { path: bundle.path().into(), found, help }
}
