//! EnSite: the contact mapping of Precision, and EnSite X. A map is a folder with a surface (XML of
//! version `SJM_DIF_5.0`) and tables of points.
//!
//! Not yet tried on a real export: every import says so.
//!
//! # Source
//! How pyCEPS and OpenEP read these files.

mod points;
mod surface;

use std::collections::BTreeMap;

use super::bundle::{Bundle, base_of, folder_of};
use super::{Ground, ImportError, Map, Study};
use crate::table::decode;

/// Said by every import.
const UNTRIED: &str = "this reader follows published descriptions and has not been tried on a real export of EnSite: check surface, counts and values before you trust them";

/// Surfaces of the study: the XML files of the version that is read.
fn surfaces(bundle: &mut Bundle) -> Vec<String> {
    let names = bundle.with_extension("xml");
    let is_surface = |name: &String| {
        bundle.head(name, 4000).is_ok_and(|head| {
            let head = decode(&head).into_owned();
            head.contains("SJM_DIF") || head.contains("<DIF>") || head.contains("DIFHeader")
        })
    };
    names.into_iter().filter(is_surface).collect()
}

/// Whether these are files of EnSite.
pub(super) fn is_ensite(bundle: &mut Bundle) -> bool {
    !surfaces(bundle).is_empty()
}

/// Reads the study: a map for every folder that has a surface with a map on it, or points.
///
/// # Errors
/// A file that is there and damaged, or of another version.
pub(super) fn read(bundle: &mut Bundle) -> Result<Study, ImportError> {
    let mut study = Study { format: "EnSite export".into(), ..Study::default() };
    study.remarks.push(UNTRIED.into());
    let mut folders: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for name in surfaces(bundle) {
        folders.entry(folder_of(&name).into()).or_default().push(name);
    }
    for (folder, files) in folders {
        if let Some(map) = map(&folder, files, bundle)? {
            study.maps.push(map);
        }
    }
    Ok(study)
}

/// The map in a folder. The model of all chambers, which has neither a map nor points beside it, is none.
fn map(
    folder: &str,
    mut files: Vec<String>,
    bundle: &mut Bundle,
) -> Result<Option<Map>, ImportError> {
    let last = folder.trim_end_matches('/').rsplit('/').next().unwrap_or_default();
    let name = if last.is_empty() { "map" } else { last };
    let mut map = Map { name: name.into(), ..Map::default() };
    // the landmark geometry and the contact mapping model are those that carry maps
    let rank = |file: &String| {
        let base = base_of(file).to_ascii_lowercase();
        !(base.starts_with("dxlandmark") || base.starts_with("contact_mapping"))
    };
    files.sort_by_key(|file| (rank(file), file.clone()));
    let mut first: Option<surface::Surface> = None;
    for file in &files {
        let read = surface::parse(file, &decode(&bundle.read(file)?))?;
        match &mut first {
            None => first = Some(read),
            // the maps of one geometry stand in several files
            Some(own) if own.is_same_as(&read) => own.take_values(read),
            Some(_) => map.remarks.push(format!(
                "{file}: another geometry than {}; its values are left out",
                files[0]
            )),
        }
    }
    if let Some(surface) = first {
        map.remarks.extend(surface.remarks);
        if surface.n_unmapped > 0 {
            map.left_out
                .insert("vertices that the system marks as not mapped".into(), surface.n_unmapped);
        }
        map.ground = Some(Ground::Shell(surface.shell));
    }
    points::add(&mut map, folder, bundle)?;
    let is_something = map.has_points() || !map.on_mesh().is_empty() || !map.left_out.is_empty();
    Ok(is_something.then_some(map))
}
