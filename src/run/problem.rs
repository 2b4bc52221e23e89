//! A model laid out on its surface and measurements: what is fitted.

use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::sync::{Arc, OnceLock};
use std::time::Instant;

use super::inputs::{DataSource, Inputs, MODEL_ROLE, MeshSource, ModelText, Origin, hash};
use super::verdict::doubts;
use super::{Event, RunError, Watch};
use crate::diagnostics::verdict::Doubt;
use crate::experiment::{Design, TRUTH_MODES, experiment};
use crate::manifold::{Basis, eigenpairs_are_cached, eigenpairs_cached};
use crate::mesh::{self, Atrium, MeshError, Surface};
use crate::model::{Declare, Exceedance, Maps, Model};
use crate::store::{cache, memory};
use crate::table::{FIELD_MODES, Measurements};

/// Vertices of a mesh file beyond which a surface is decimated, and to how many: edges of about 1 mm on
/// an atrium, far below the wavelength of any mode that is used.
const LARGEST: usize = 100_000;
const WORKING: usize = 20_000;

/// A surface with what fields on it are made of.
#[derive(Clone, Debug)]
pub struct Domain {
    /// The surface, mm.
    pub surface: Surface,
    /// Its eigenfunctions: those that the model needs, or more.
    pub basis: Basis,
    /// Length in mm of the unit of the surface's file, and of places in tables.
    pub scale: f64,
}

/// Everything that a model is laid out on.
#[derive(Clone, Debug, Default)]
pub struct Loaded {
    /// Absent for models without fields.
    pub domain: Option<Arc<Domain>>,
    /// The measurements, with their places on the surface.
    pub measurements: Measurements,
    /// True fields and derived quantities (n_vertices) in the model's order, by name; empty unless the
    /// measurements are synthetic.
    pub truth: Vec<(String, Vec<f64>)>,
    /// SHA-256 of all that was read, by role.
    pub hashes: BTreeMap<String, String>,
    /// What all that is called.
    pub origin: Origin,
}

impl Loaded {
    /// Reads or makes everything that `model` needs; `watch` is told what it is.
    ///
    /// # Errors
    /// [`RunError::NoMeasurements`], [`RunError::Read`]; what is wrong with the mesh, the basis or the
    /// table, or does not fit between them.
    pub fn new(model: &dyn Declare, inputs: &Inputs, watch: &Watch<'_>) -> Result<Self, RunError> {
        let outline = Model::outline(model)?;
        let (hashes, origin) = (inputs.hashed()?, inputs.origin()?);
        let table = match &inputs.data {
            DataSource::Synthetic(_) => None,
            DataSource::File(path) => Some(Measurements::read(path)?),
            DataSource::Table(table) => Some(table.clone()),
        };
        let is_own_surface = !matches!(inputs.mesh, MeshSource::Unnamed);
        let is_on_a_surface = outline.has_fields() || is_own_surface && table.is_some();
        if !is_on_a_surface {
            let measurements = without_a_surface(table, &outline, watch)?;
            return Ok(Self { measurements, hashes, origin, ..Self::default() });
        }
        let surface = surface(&inputs.mesh, watch)?;
        let basis = eigenpairs(inputs, &surface, &outline, watch)?;
        let scale = surface.units.in_mm();
        let domain = Domain { surface, basis, scale };
        let (measurements, truth) = match (table, &inputs.data) {
            (Some(table), _) => (domain.place(checked(table, &outline, watch)?, watch)?, vec![]),
            (None, DataSource::Synthetic(design)) => domain.measure(model, design, watch)?,
            (None, _) => (Measurements::default(), vec![]),
        };
        Ok(Self { domain: Some(Arc::new(domain)), measurements, truth, hashes, origin })
    }

    /// Takes this text for that of the model: one that was made from it.
    pub fn is_of(&mut self, model: ModelText) {
        self.hashes.insert(MODEL_ROLE.into(), hash(model.text.as_bytes()));
        self.origin.model = Some(model);
    }

    /// The surface, if the model is on one.
    pub fn surface(&self) -> Option<&Surface> {
        self.domain.as_ref().map(|domain| &domain.surface)
    }

    /// Its eigenfunctions.
    pub fn basis(&self) -> Option<&Basis> {
        self.domain.as_ref().map(|domain| &domain.basis)
    }
}

/// A model laid out on its surface and measurements. Copies share everything.
#[derive(Clone)]
pub struct Problem<'m>(Arc<Parts<'m>>);

struct Parts<'m> {
    declared: &'m dyn Declare,
    model: Model,
    loaded: Loaded,
    /// What it took to load, s.
    seconds: f64,
    doubts: OnceLock<Vec<Doubt>>,
}

impl<'m> Problem<'m> {
    /// Loads what `inputs` name and lays `model` out on it.
    ///
    /// # Errors
    /// Those of [`Loaded::new`], and what does not fit between the model and its data.
    pub fn load(model: &'m dyn Declare, inputs: &Inputs) -> Result<Self, RunError> {
        Self::load_watched(model, inputs, &Watch::default())
    }

    /// As [`Problem::load`], telling `watch` what is loaded.
    ///
    /// # Errors
    /// Those of [`Problem::load`].
    pub fn load_watched(
        model: &'m dyn Declare,
        inputs: &Inputs,
        watch: &Watch<'_>,
    ) -> Result<Self, RunError> {
        let begun = Instant::now();
        Self::laid_out(model, Loaded::new(model, inputs, watch)?, begun)
    }

    /// Lays `model` out on what is in memory.
    ///
    /// # Errors
    /// What does not fit between them.
    pub fn new(model: &'m dyn Declare, loaded: Loaded) -> Result<Self, RunError> {
        Self::laid_out(model, loaded, Instant::now())
    }

    fn laid_out(
        declared: &'m dyn Declare,
        loaded: Loaded,
        begun: Instant,
    ) -> Result<Self, RunError> {
        let model = Model::new(declared, loaded.basis(), &loaded.measurements)?;
        let seconds = begun.elapsed().as_secs_f64();
        Ok(Self(Arc::new(Parts { declared, model, loaded, seconds, doubts: OnceLock::new() })))
    }

    /// The same with a changed model.
    pub(super) fn changed(
        &self,
        change: impl FnOnce(&mut Model) -> Result<(), RunError>,
    ) -> Result<Self, RunError> {
        let Parts { declared, loaded, seconds, doubts, .. } = &*self.0;
        let mut model = Model::new(*declared, loaded.basis(), &loaded.measurements)?;
        change(&mut model)?;
        let (loaded, doubts) = (loaded.clone(), doubts.clone());
        Ok(Self(Arc::new(Parts { declared: *declared, model, loaded, seconds: *seconds, doubts })))
    }

    /// The model as declared, without data.
    pub fn declared(&self) -> &'m dyn Declare {
        self.0.declared
    }

    /// The model on its data: a log density.
    pub fn model(&self) -> &Model {
        &self.0.model
    }

    /// What it is laid out on.
    pub fn loaded(&self) -> &Loaded {
        &self.0.loaded
    }

    /// Its measurements.
    pub fn measurements(&self) -> &Measurements {
        &self.0.loaded.measurements
    }

    /// What is wrong with the measurements, as far as the model can tell before it is sampled.
    pub fn doubts(&self) -> &[Doubt] {
        self.0.doubts.get_or_init(|| doubts(self.model(), self.loaded()))
    }

    pub(super) fn tell_doubts(&self, watch: &Watch<'_>) {
        if !self.doubts().is_empty() {
            watch.tell(&Event::Doubts(self.doubts()));
        }
    }

    /// Says so where operators are computed at fewer vertices than the surface has, or corrected by those of finer triangles.
    pub(super) fn tell_triangulation(&self, watch: &Watch<'_>) {
        let of = self.loaded().surface().map_or(0, |surface| surface.mesh.n_vertices());
        let corrected_by = self.model().n_finer();
        let on = self.model().triangulation().map(|on| on.mesh.n_vertices());
        if let Some(n_vertices) = on
            && (n_vertices < of || corrected_by.is_some())
        {
            watch.tell(&Event::Triangulation { n_vertices, of, corrected_by });
        }
    }

    /// An event at every vertex, from a text such as `erp_s2 > 250`, for [`Options::exceed`](super::Options::exceed).
    ///
    /// # Errors
    /// [`RunError::Exceedance`] where it is none on this model's maps.
    pub fn exceedance(&self, text: &str) -> Result<Exceedance, RunError> {
        let basis = self.loaded().basis();
        let maps = basis.map(|basis| Maps::new(self.model(), basis));
        let names = maps.as_ref().map_or(vec![], Maps::all_names);
        Ok(Exceedance::read(text, &names)?)
    }

    /// What it took to load, s.
    pub(super) fn seconds(&self) -> f64 {
        self.0.seconds
    }
}

impl std::fmt::Debug for Problem<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Problem").field("model", &self.model().name).finish_non_exhaustive()
    }
}

fn without_a_surface(
    table: Option<Measurements>,
    outline: &Model,
    watch: &Watch<'_>,
) -> Result<Measurements, RunError> {
    match (table, outline.readers().first()) {
        (Some(table), _) => checked(table, outline, watch),
        (None, None) => Ok(Measurements::default()),
        (None, Some(observe)) => Err(RunError::NoMeasurements { model: outline.name, observe }),
    }
}

fn checked(
    mut table: Measurements,
    outline: &Model,
    watch: &Watch<'_>,
) -> Result<Measurements, RunError> {
    let unread = table.drop_unread(&outline.readers());
    if !unread.is_empty() {
        watch.tell(&Event::Unread(&unread));
    }
    table.check_protocols(&outline.readers())?;
    Ok(table)
}

/// The surface that is named; `watch` is told what it is.
///
/// # Errors
/// [`RunError::Mesh`].
pub fn surface(mesh: &MeshSource, watch: &Watch<'_>) -> Result<Surface, RunError> {
    let (file, surface) = match mesh {
        MeshSource::Unnamed => return self::surface(&MeshSource::ATRIUM, watch),
        MeshSource::Embedded { edge } if !Atrium::EDGE_RANGE.contains(edge) => {
            return Err(MeshError::Edge { edge: *edge }.into());
        }
        MeshSource::Embedded { edge } => (None, Surface::left_atrium(*edge)),
        MeshSource::File { path, reading, whole } => {
            let mut surface = mesh::read(path, reading.clone())?;
            if surface.mesh.n_vertices() > LARGEST && !whole {
                surface = surface.decimated(WORKING).map_err(RunError::from)?;
            }
            (Some(path.as_path()), surface)
        }
        MeshSource::Surface(surface) => return Ok((**surface).clone()),
    };
    watch.tell(&Event::Surface {
        file,
        n_vertices: surface.mesh.n_vertices(),
        area: surface.mesh.area(),
        notes: &surface.notes,
    });
    Ok(surface)
}

/// The eigenpairs that are given, or as many as the model and the truth need.
fn eigenpairs(
    inputs: &Inputs,
    surface: &Surface,
    outline: &Model,
    watch: &Watch<'_>,
) -> Result<Basis, RunError> {
    let most = surface.mesh.n_vertices() - 1;
    let needed = match outline.n_modes() {
        0 => FIELD_MODES.min(most), // for fields that `eplat loop` may add
        needed => needed,
    };
    let basis = if let Some(path) = &inputs.basis {
        on_kept_vertices(Basis::read_npz(path)?, surface).in_unit_of(surface.units.in_mm())
    } else {
        let is_synthetic = matches!(inputs.data, DataSource::Synthetic(_));
        let truth = if is_synthetic { TRUTH_MODES.min(most) } else { 0 };
        let n_modes = needed.max(truth);
        announce(surface, n_modes, watch)?;
        let basis = eigenpairs_cached(&surface.mesh, n_modes)?;
        if let Some(folder) = cache::folder()
            && !eigenpairs_are_cached(&surface.mesh, n_modes)
        {
            watch.tell(&Event::NotCached { folder: &folder });
        }
        basis
    };
    basis.require_fit(&surface.mesh)?;
    let n_modes = needed.min(basis.n_modes());
    let last = basis.eigenvalues[n_modes.saturating_sub(1)];
    watch.tell(&Event::Basis { n_modes, wavelength: 2.0 * PI / last.max(0.0).sqrt() });
    Ok(basis)
}

/// Matrices as large as all eigenfunctions that are held while these are computed.
const COPIES: u128 = 4;
/// Time that eigenfunctions take, s, over vertices and modes²: 5.5 s for 1000 of 5166 vertices on a core of 2020.
const SECONDS: f64 = 1.1e-9;
/// Eigenfunctions that take longer are announced, s.
const LONG: f64 = 5.0;

/// Tells how long eigenfunctions will take, if that is long, and refuses those for which there is no memory.
fn announce(surface: &Surface, n_modes: usize, watch: &Watch<'_>) -> Result<(), RunError> {
    let n_vertices = surface.mesh.n_vertices();
    let numbers = (n_modes as u128).saturating_mul(n_vertices as u128).saturating_mul(COPIES);
    if let Some((bytes, free)) = memory::exceeds(numbers) {
        let what = format!("{n_modes} eigenfunctions of {n_vertices} vertices");
        let help = "take a coarser mesh (`eplat mesh decimate`), or fewer modes (K)";
        return Err(RunError::Memory { what, bytes, free, help });
    }
    let seconds = SECONDS * n_vertices as f64 * (n_modes as f64).powi(2);
    if seconds > LONG && !eigenpairs_are_cached(&surface.mesh, n_modes) {
        watch.tell(&Event::Eigenfunctions { n_modes, n_vertices, seconds });
    }
    Ok(())
}

/// A basis given for every vertex of the file, at the vertices that were kept.
fn on_kept_vertices(basis: Basis, surface: &Surface) -> Basis {
    if basis.n_vertices() != surface.n_source_vertices {
        return basis;
    }
    let rows = surface.source_vertex.iter().flat_map(|v| basis.at(*v as usize).to_vec());
    Basis { eigenfunctions: rows.collect(), eigenvalues: basis.eigenvalues.clone() }
}

/// Measurements and the truth they were made on.
type Measured = (Measurements, Vec<(String, Vec<f64>)>);

impl Domain {
    /// A table with its rows placed on the surface, and the modes there.
    pub(super) fn placed(&self, mut table: Measurements) -> Result<Measurements, RunError> {
        table.place_on(&self.surface, self.scale)?;
        table.probe(&self.surface, &self.basis)?;
        Ok(table)
    }

    fn place(&self, table: Measurements, watch: &Watch<'_>) -> Result<Measurements, RunError> {
        let table = self.placed(table)?;
        let (file, n_rows, n_sites) = (table.file(), table.len(), table.vertices().len());
        let notes = table.notes();
        watch.tell(&Event::Measurements { file, n_rows, n_sites, notes });
        Ok(table)
    }

    /// A synthetic experiment.
    fn measure(
        &self,
        model: &dyn Declare,
        design: &Design,
        watch: &Watch<'_>,
    ) -> Result<Measured, RunError> {
        let made = experiment(model, &self.surface.mesh, &self.basis, design)?;
        watch.tell(&Event::Experiment {
            n_measurements: made.measurements.len(),
            n_sites: design.n_sites,
            lengthscale: design.lengthscale,
            repaired: made.repaired,
        });
        Ok((made.measurements, made.truth))
    }
}
