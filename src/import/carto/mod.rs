//! CARTO 3: the folder or archive that "Export study data" writes.
//!
//! A study file (`<Study name=…>`) lists the maps; each has a `.mesh`, `NAME_car.txt`,
//! `NAME_Points_Export.xml` and files of its points. What is not there is a remark.
//!
//! # Source
//! The export itself, and how pyCEPS, cartoreader-lite and OpenEP read it.

#[cfg(test)]
#[path = "../../../tests/support/carto.rs"]
pub(super) mod example;
mod mesh;
mod points;

use std::collections::BTreeMap;

use roxmltree::{Document, Node};

use super::bundle::{Bundle, base_of, folder_of};
use super::{Ground, ImportError, Map, Study};
use crate::table::decode;
use points::Listed;

/// What stands for a missing number, and all below it.
const MISSING: f64 = -10_000.0;

/// A number that is not missing.
fn valid(x: f64) -> Option<f64> {
    (x > MISSING).then_some(x)
}

/// The file that lists the maps of the study.
pub(super) fn study_file(bundle: &mut Bundle) -> Option<String> {
    let names = bundle.with_extension("xml");
    let is_study = |name: &String| {
        !name.to_ascii_lowercase().ends_with("_export.xml")
            && bundle.head(name, 400).is_ok_and(|head| decode(&head).contains("<Study "))
    };
    names.into_iter().find(is_study)
}

/// Whether these are files of CARTO.
pub(super) fn is_carto(bundle: &mut Bundle) -> bool {
    let meshes = bundle.with_extension("mesh");
    let mut is_mesh = |name: &String| {
        bundle.head(name, 64).is_ok_and(|head| {
            String::from_utf8_lossy(&head).to_ascii_lowercase().contains("triangulatedmesh")
        })
    };
    meshes.iter().any(&mut is_mesh) || study_file(bundle).is_some()
}

/// Reads the study.
///
/// # Errors
/// A file that is there and damaged.
pub(super) fn read(bundle: &mut Bundle) -> Result<Study, ImportError> {
    let mut study = Study { format: "CARTO 3 export".into(), ..Study::default() };
    let listed = if let Some(file) = study_file(bundle) {
        let folder = folder_of(&file).to_owned();
        listed(&file, &folder, &decode(&bundle.read(&file)?))?
    } else {
        study.remarks.push(
            "no study file (<Study name=…>): maps are taken from the .mesh files, without tags"
                .into(),
        );
        let meshes = bundle.with_extension("mesh");
        meshes.iter().map(|name| Entry::of_mesh(name)).collect()
    };
    let mut first = None;
    for entry in listed {
        let name = entry.name.clone();
        match entry.read(bundle) {
            Ok(map) => study.maps.push(map),
            // a map with a damaged file does not keep the others from being imported
            Err(error) => {
                let remarks = vec![first_line(&error)];
                study.maps.push(Map { name, remarks, ..Map::default() });
                first = first.or(Some(error));
            }
        }
    }
    match first {
        Some(error) if !study.maps.iter().any(Map::is_usable) => Err(error),
        _ => Ok(study),
    }
}

/// What an error says is wrong, without its help.
fn first_line(error: &ImportError) -> String {
    error.to_string().lines().next().unwrap_or_default().to_owned()
}

/// A map as the study file lists it.
#[derive(Debug, Default)]
struct Entry {
    name: String,
    folder: String,
    /// Names of its meshes.
    meshes: Vec<String>,
    listed: Listed,
}

impl Entry {
    fn of_mesh(name: &str) -> Self {
        let folder = folder_of(name).to_owned();
        let base = base_of(name);
        let stem = base.get(..base.len().saturating_sub(".mesh".len())).unwrap_or(base);
        Self { name: stem.into(), folder, meshes: vec![base.into()], ..Self::default() }
    }

    fn read(self, bundle: &mut Bundle) -> Result<Map, ImportError> {
        let mut map = Map { name: self.name, ..Map::default() };
        if self.meshes.len() > 1 {
            map.remarks.push(format!(
                "the map has {} meshes; the first that is there is taken",
                self.meshes.len()
            ));
        }
        let there = |name: &String| bundle.find(&format!("{}{name}", self.folder));
        match self.meshes.iter().find_map(there) {
            Some(file) => take_mesh(&mut map, &file, bundle)?,
            None => map.remarks.push(format!("no mesh file ({})", self.meshes.join(", "))),
        }
        points::add(&mut map, &self.folder, &self.listed, bundle)?;
        if map.points.is_empty() && map.left_out.is_empty() {
            map.remarks.push("no points".into());
        }
        Ok(map)
    }
}

fn take_mesh(map: &mut Map, file: &str, bundle: &mut Bundle) -> Result<(), ImportError> {
    let mesh = mesh::parse(file, &decode(&bundle.read(file)?))?;
    for (n, what) in [
        (mesh.n_inactive, "triangles of inactive groups"),
        (mesh.n_hidden, "triangles of hidden groups"),
        (mesh.n_unused, "vertices that no active triangle uses"),
    ] {
        if n > 0 {
            map.left_out.insert(what.into(), n);
        }
    }
    if mesh.has_empty_colours {
        map.remarks.push(
            "the mesh has no values: high-density colouring of version 6 does not export them"
                .into(),
        );
    }
    if mesh.shell.triangles.is_empty() {
        map.remarks.push("the mesh has no visible triangle".into());
    } else {
        map.ground = Some(Ground::Shell(mesh.shell));
    }
    Ok(())
}

/// The maps of the study file.
fn listed(file: &str, folder: &str, text: &str) -> Result<Vec<Entry>, ImportError> {
    let document = xml(file, text)?;
    let nodes = |name: &'static str| document.descendants().filter(move |n| n.has_tag_name(name));
    let tag = |node: Node| {
        Some((node.attribute("ID")?.to_owned(), node.attribute("Full_Name")?.to_owned()))
    };
    let tags: BTreeMap<String, String> =
        nodes("TagsTable").flat_map(|table| table.children()).filter_map(tag).collect();
    let entry = |map: Node| {
        let words = |text: &str| text.split_whitespace().map(String::from).collect::<Vec<_>>();
        let mut listed = Listed::default();
        for point in map.descendants().filter(|node| node.has_tag_name("Point")) {
            let Some(id) = point.attribute("Id").or(point.attribute("ID")) else { continue };
            let place = point.attribute("Position3D").map(words).unwrap_or_default();
            let place: Option<Vec<f64>> = place.iter().map(|word| word.parse().ok()).collect();
            if let Some([x, y, z]) = place.as_deref() {
                listed.places.insert(id.into(), [*x, *y, *z]);
            }
            let own = point.children().find(|node| node.has_tag_name("Tags"));
            let ids = own.and_then(|node| node.text()).map(words).unwrap_or_default();
            let named: Vec<String> =
                ids.into_iter().map(|id| tags.get(&id).cloned().unwrap_or(id)).collect();
            if !named.is_empty() {
                listed.tags.insert(id.into(), named);
            }
        }
        let meshes = map.attribute("FileNames").unwrap_or_default();
        Entry {
            name: map.attribute("Name").unwrap_or_default().into(),
            folder: folder.into(),
            meshes: mesh_names(meshes),
            listed,
        }
    };
    Ok(nodes("Map").map(entry).collect())
}

/// Names end in `.mesh` and may hold blanks.
fn mesh_names(text: &str) -> Vec<String> {
    let mut names = vec![];
    let mut rest = text.trim();
    while let Some(at) = rest.to_ascii_lowercase().find(".mesh") {
        let (name, after) = rest.split_at(at + ".mesh".len());
        names.push(name.trim_matches([' ', ',', ';']).to_owned());
        rest = after;
    }
    names
}

/// An XML document.
fn xml<'t>(file: &str, text: &'t str) -> Result<Document<'t>, ImportError> {
    Document::parse(text).map_err(|error| ImportError::Unusable {
        file: file.into(),
        what: format!("no valid XML: {error}"),
        help: "the file is damaged; export it again".into(),
    })
}
