//! A calibrated atrium as openCARP takes it: the surface, and the parameters of the cell at every node.
//!
//! ```text
//! atrium.pts .elem .lon      the surface, µm
//! mean/  draw_001/ …         mMS.tau_in mMS.tau_out mMS.tau_open mMS.tau_close, and mMS.par that names them
//! export.json                what the parameters were, and the hashes of what was read and written
//! ```
//! openCARP's model `mMS` has the equations of [`ep::cell`](crate::ep::cell). With a membrane of 1 µF/cm² and 1/µm of
//! it, a conductivity of 1 S/m is a diffusivity of 0.1 mm²/ms. An equivalent monodomain takes half of g where g inside
//! and outside are equal.
//!
//! # Source
//! How the authors of Coveney et al. 2022 write their simulations: `scripts/mmserp_createCARPfiles` of the public
//! repository samcoveney/mmserp.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs;
use std::io;
use std::path::Path;

use serde_json::json;

use super::posterior::Posterior;
use super::tissue::{Column, TissueFields};
use super::{AtriumError, Ground, TissueSettings};
use crate::ep::Parameters;
use crate::ep::cell::V_GATE;
use crate::mesh::{Array, Encoding, MeshError, Surface};
use crate::store::{seals, write_folder};

/// What openCARP reads from files, node by node.
const NAMES: [&str; 4] = ["tau_in", "tau_out", "tau_open", "tau_close"];
/// Conductivity of a diffusivity of 1 mm²/ms, S/m.
const CONDUCTIVITY: f64 = 10.0;
/// The arrays of tags and of fibres, by which the mesh's writer knows them.
const REGION: &str = "region";
const FIBRE: &str = "fibre";

/// What was written for openCARP.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exported {
    /// Nodes of the surface.
    pub n_nodes: usize,
    /// Draws beside the mean.
    pub n_draws: usize,
    /// Mean edge length, mm.
    pub edge: f64,
    /// Share of nodes, of the mean and all draws, at which a parameter had left its range; there it is the nearest in it.
    pub out_of_range: f64,
}

/// Writes the folder `out`, which must not be there: the parameters as `settings` say and, of a run's surface with its
/// draws, `draws` of them, evenly spaced.
///
/// # Errors
/// [`AtriumError`]; `Occupied`; `OneNumber` for a `CV_max` or `tau_in` that is a field, since openCARP takes
/// conductivities by region.
pub fn export_opencarp(
    ground: &Ground,
    settings: &TissueSettings,
    draws: Option<u32>,
    out: &Path,
) -> Result<Exported, AtriumError> {
    if out.exists() {
        return Err(AtriumError::Occupied { folder: out.to_owned() });
    }
    let tissue = TissueFields::new(ground, settings)?;
    let [cv_max, tau_in, ..] = &tissue.columns;
    for (name, column) in [("cv-max", cv_max), ("tau-in", tau_in)] {
        if matches!(column, Column::Field { .. }) {
            return Err(AtriumError::OneNumber { name });
        }
    }
    let given = tissue.given()?;
    let posterior = draws.zip(ground.draws.clone());
    let posterior = posterior.map(|(n, kept)| Posterior::new(kept, n as usize, &tissue));
    let posterior = posterior.transpose()?;
    let surface = surface(ground, settings, &tissue);
    let par = parameter_file(&surface, settings, &given.parameters);
    let n = posterior.as_ref().map_or(0, |posterior| posterior.n);
    let mut n_outside = given.n_outside();
    let fill = |root: &Path| -> io::Result<()> {
        surface.write(&root.join("atrium.pts"), Encoding::Ascii).map_err(MeshError::into_cause)?;
        write_set(&root.join("mean"), &given.parameters, &par)?;
        let mut names =
            ["atrium.pts", "atrium.elem", "atrium.lon", "mean"].map(String::from).to_vec();
        for i in 0..n {
            let Some(drawn) = posterior.as_ref().map(|p| p.parameters(&tissue, i)) else { break };
            n_outside += drawn.n_outside();
            names.push(format!("draw_{:03}", i + 1));
            write_set(&root.join(&names[4 + i]), &drawn.parameters, &par)?;
        }
        let record = json!({
            "version": env!("CARGO_PKG_VERSION"), "settings": settings, "hashes": ground.hashes,
            "files": seals(root, &names)?,
        });
        fs::write(root.join("export.json"), format!("{record:#}\n"))
    };
    write_folder(out, fill).map_err(AtriumError::io("write", out))?;
    Ok(Exported {
        n_nodes: given.was.len(),
        n_draws: n,
        edge: tissue.mesh().mean_edge_length(),
        out_of_range: n_outside as f64 / ((n + 1) * given.was.len()) as f64,
    })
}

/// The refined mesh, with the tags and fibres of the triangles that its own were cut from. Without fibres all point
/// along x: conduction is the same in every direction.
fn surface(ground: &Ground, settings: &TissueSettings, tissue: &TissueFields) -> Surface {
    let mut refined = Surface::new(tissue.mesh().clone(), BTreeMap::new());
    let n = refined.mesh.n_triangles();
    let children = n / ground.surface.mesh.n_triangles().max(1);
    let tags = ground.surface.cell_data.get(REGION).and_then(Array::scalars);
    let tags = (0..n).map(|t| tags.map_or(0.0, |tags| tags[t / children])).collect::<Vec<f64>>();
    let name = settings.fibres.as_ref();
    let fibres = name.and_then(|name| ground.surface.triangle_fibres(name));
    let along = |t: usize| fibres.as_ref().map_or([1.0, 0.0, 0.0], |fibres| fibres[t / children]);
    let along: Vec<[f64; 3]> = (0..n).map(along).collect();
    refined.cell_data.insert(REGION.into(), tags.into());
    refined.cell_data.insert(FIBRE.into(), along.into());
    refined
}

/// What all sets of parameters share: model, tags, conductivities, and the names of the files beside it.
fn parameter_file(surface: &Surface, settings: &TissueSettings, given: &[Parameters]) -> String {
    let tags = surface.cell_data.get(REGION).and_then(Array::scalars).unwrap_or_default();
    let tags: BTreeSet<i64> = tags.iter().map(|tag| *tag as i64).collect();
    // half of it counts in an equivalent monodomain
    let along = given.first().map_or(0.0, |p| 2.0 * CONDUCTIVITY * p.tissue().diffusivity);
    let across = along / settings.anisotropy.unwrap_or(1.0).powi(2);
    let mut text = String::from(
        "# by eplat, for openCARP, in this folder: openCARP +F mMS.par -meshname ../atrium and what is paced\n\
         bidomain = 0\nbidm_eqv_mono = 1\nnum_imp_regions = 1\nimp_region[0].name = \"atrium\"\n\
         imp_region[0].cellSurfVolRatio = 1.0\nimp_region[0].im = \"mMS\"\n",
    );
    let _ = writeln!(text, "imp_region[0].im_param = \"V_gate={V_GATE},a_crit={V_GATE}\"");
    let _ = writeln!(text, "num_gregions = 1\ngregion[0].name = \"atrium\"");
    for region in ["imp_region[0]", "gregion[0]"] {
        let _ = writeln!(text, "{region}.num_IDs = {}", tags.len());
        for (k, tag) in tags.iter().enumerate() {
            let _ = writeln!(text, "{region}.ID[{k}] = {tag}");
        }
    }
    for (name, g) in [("g_el", along), ("g_et", across), ("g_il", along), ("g_it", across)] {
        let _ = writeln!(text, "gregion[0].{name} = {g}");
    }
    let _ = writeln!(text, "num_adjustments = {}", NAMES.len());
    for (k, name) in NAMES.iter().enumerate() {
        let _ = writeln!(text, "adjustment[{k}].variable = \"mMS.{name}\"");
        let _ = writeln!(text, "adjustment[{k}].file = \"mMS.{name}\"");
    }
    text
}

/// One set of parameters: a file of each, and the file that names them.
fn write_set(folder: &Path, parameters: &[Parameters], par: &str) -> io::Result<()> {
    fs::create_dir(folder)?;
    fs::write(folder.join("mMS.par"), par)?;
    for (k, name) in NAMES.iter().enumerate() {
        let mut text = format!("{}\nintra\n", parameters.len());
        for (node, parameters) in parameters.iter().enumerate() {
            let tissue = parameters.tissue();
            let value = [tissue.tau_in, tissue.tau_out, tissue.tau_open, tissue.tau_close][k];
            let _ = writeln!(text, "{node} {value}");
        }
        fs::write(folder.join(format!("mMS.{name}")), text)?;
    }
    Ok(())
}
