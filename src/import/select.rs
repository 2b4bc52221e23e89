//! From a map to a surface and rows of a table: which map, which of its points, and where they lie.

use std::collections::BTreeMap;

use super::distance::Incidence;
use super::{ImportError, Map, Point, QUANTITIES, Reading, Site, Study, Value};
use crate::mesh::Surface;

/// What the user chooses.
#[derive(Clone, Debug)]
pub struct Options {
    /// Name of the map; needed where more than one is usable.
    pub map: Option<String>,
    /// Points farther from the surface than this are left out, mm.
    pub within: f64,
    /// Distance that measurements on the mesh keep from each other, mm; all vertices without it.
    pub thin: Option<f64>,
    /// Take the values on the mesh, though there are points.
    pub mesh_values: bool,
    /// Leave out brackets with an open end.
    pub closed: bool,
    /// Vertex of the surface that is written at which activation starts; the earliest without it.
    pub source: Option<u32>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            map: None,
            within: 10.0,
            thin: None,
            mesh_values: false,
            closed: false,
            source: None,
        }
    }
}

/// A row's place and measurement.
#[derive(Clone, Debug)]
pub struct Row {
    /// Name of its site.
    pub site: String,
    /// Vertex of the surface; none without a surface.
    pub vertex: Option<u32>,
    /// Where it was taken, mm.
    pub place: [f64; 3],
    /// Its distance from the vertex, mm.
    pub off_surface: f64,
    /// The measurement.
    pub reading: Reading,
    /// What else is known of it, by column.
    pub cells: BTreeMap<String, String>,
}

/// A map on its mended surface.
#[derive(Clone, Debug)]
pub struct Selected {
    /// The map, without its ground and points; its remarks and what was left out have grown.
    pub map: Map,
    /// Its surface; none for measurements at vertices of a surface that is elsewhere.
    pub surface: Option<Surface>,
    /// The rows of the table.
    pub rows: Vec<Row>,
    /// Whether they are the values on the mesh.
    pub is_on_mesh: bool,
    /// Vertex at which activation starts, where there are times.
    pub source: Option<u32>,
}

/// Chooses the map, mends its surface and places its measurements.
///
/// # Errors
/// No usable map, or no choice among several; a surface that cannot be mended; a source that is no vertex.
pub fn select(study: &mut Study, options: &Options) -> Result<Selected, ImportError> {
    let mut map = chosen(study, options)?;
    let ground = map.ground.take();
    let points = std::mem::take(&mut map.points);
    let surface = match ground {
        Some(ground) => {
            let mended = ground.surface();
            Some(mended.map_err(|source| ImportError::Surface { map: map.name.clone(), source })?)
        }
        None => None,
    };
    if surface.is_none() && points.is_empty() {
        let what =
            format!("map {} has neither a surface nor measurements; the study has", map.name);
        study.maps.push(map);
        return Err(ImportError::Map { what, maps: in_lines(&study.maps) });
    }
    let mut selected = Selected { map, surface, rows: vec![], is_on_mesh: false, source: None };
    let is_measured = points.iter().any(|point| !point.readings.is_empty());
    selected.note_surface();
    if options.mesh_values || !is_measured {
        selected.take_mesh_values(options.thin, is_measured);
    } else {
        selected.take_points(points, options);
    }
    selected.note_no_surface();
    selected.find_source(options.source)?;
    // rows count the vertices of the file that is written
    selected.surface = selected.surface.map(|mended| {
        let Surface { mesh, point_data, cell_data, .. } = mended;
        let mut written = Surface::new(mesh, BTreeMap::new());
        (written.point_data, written.cell_data) = (point_data, cell_data);
        written
    });
    Ok(selected)
}

fn in_lines(maps: &[Map]) -> Vec<String> {
    maps.iter().map(Map::in_words).collect()
}

/// The map that is named, or the only usable one.
fn chosen(study: &mut Study, options: &Options) -> Result<Map, ImportError> {
    let found: Vec<usize> = match &options.map {
        Some(name) => (0..study.maps.len()).filter(|k| study.maps[*k].name == *name).collect(),
        None => (0..study.maps.len()).filter(|k| study.maps[*k].is_usable()).collect(),
    };
    let what = match (&found[..], &options.map) {
        ([one], _) => return Ok(study.maps.remove(*one)),
        ([], Some(name)) => format!("the study has no map `{name}`; it has"),
        (several, Some(name)) => {
            format!("{} maps are called `{name}`; the study has", several.len())
        }
        ([], None) if study.maps.len() == 1 => return Ok(study.maps.remove(0)),
        ([], None) => "no map of the study has both a surface and measurements; it has".into(),
        (several, None) => format!("{} maps of the study can be imported; it has", several.len()),
    };
    Err(ImportError::Map { what, maps: in_lines(&study.maps) })
}

impl Selected {
    /// Tells what was mended.
    fn note_surface(&mut self) {
        let Some(surface) = &self.surface else { return };
        self.map.remarks.extend(surface.notes.iter().map(|note| format!("surface: {note}")));
    }

    fn note_no_surface(&mut self) {
        if self.surface.is_none() {
            self.map.remarks.push(
                "no surface: --mesh FILE places the measurements now, or name it to run".into(),
            );
        }
    }

    /// A row for each reading of each point that lies near enough.
    fn take_points(&mut self, points: Vec<Point>, options: &Options) {
        let within = options.within;
        let mut n_far = 0;
        let triangles = self.surface.as_ref().map(|s| Incidence::new(&s.mesh)).unwrap_or_default();
        for point in points {
            let Some((vertex, place, off_surface)) = self.place(point.site, &triangles) else {
                self.map.leave_out("points at vertices of a piece that was dropped");
                continue;
            };
            if off_surface > within {
                self.map.leave_out(format!("points more than {within} mm from the surface"));
                continue;
            }
            n_far += usize::from(off_surface > 5.0);
            for reading in point.readings {
                if options.closed && reading.is_open() {
                    self.map.leave_out("brackets with an open end");
                    continue;
                }
                let (site, cells) = (point.name.clone(), point.cells.clone());
                self.rows.push(Row { site, vertex, place, off_surface, reading, cells });
            }
        }
        if n_far > 0 {
            self.map.remarks.push(format!(
                "{n_far} points lie more than 5 mm from the surface; --within 5 leaves them out"
            ));
        }
    }

    fn place(&self, site: Site, triangles: &Incidence) -> Option<(Option<u32>, [f64; 3], f64)> {
        let Some(surface) = &self.surface else {
            return Some(match site {
                Site::At(place) => (None, place, f64::NAN),
                Site::Vertex(vertex) => (Some(vertex as u32), [f64::NAN; 3], f64::NAN),
            });
        };
        match site {
            Site::At(place) => {
                let (vertex, distance) = triangles.nearest(&surface.mesh, place);
                Some((Some(vertex), place, distance))
            }
            Site::Vertex(source) => {
                let vertex = surface.vertex_of_source(source)?;
                Some((Some(vertex), surface.mesh.vertices()[vertex as usize], 0.0))
            }
        }
    }

    /// A row for each value at each vertex, or at vertices that keep a distance.
    fn take_mesh_values(&mut self, thin: Option<f64>, is_choice: bool) {
        let Some(surface) = &self.surface else { return };
        let there = |name: &str| surface.point_data.get(name)?.scalars();
        let quantities: Vec<(&str, &[f64])> = QUANTITIES
            .iter()
            .filter_map(|(name, _)| Some((*name, there(name)?)))
            .filter(|(_, values)| values.iter().any(|x| x.is_finite()))
            .collect();
        if quantities.is_empty() {
            return;
        }
        let is_filled = |v: usize| quantities.iter().any(|(_, values)| values[v].is_finite());
        let filled: Vec<usize> = (0..surface.mesh.n_vertices()).filter(|v| is_filled(*v)).collect();
        let kept = match thin {
            Some(distance) => spread(surface, &filled, distance),
            None => filled.clone(),
        };
        let mut rows = vec![];
        for v in &kept {
            for (protocol, values) in quantities.iter().filter(|(_, x)| x[*v].is_finite()) {
                let value = Value::Number(values[*v]);
                rows.push(Row {
                    site: format!("V{v}"),
                    vertex: Some(*v as u32),
                    place: surface.mesh.vertices()[*v],
                    off_surface: 0.0,
                    reading: Reading { protocol: (*protocol).into(), value },
                    cells: BTreeMap::new(),
                });
            }
        }
        let n_empty = surface.mesh.n_vertices() - filled.len();
        let n_thinned = filled.len() - kept.len();
        (self.rows, self.is_on_mesh) = (rows, true);
        let why = if is_choice { "as asked" } else { "the map has no points with a value" };
        self.map.remarks.push(format!(
            "the values on the mesh are taken as measurements ({why}): they are interpolated or simulated, so that neighbours are not independent and fits will be too sure; --thin MM spreads them out"
        ));
        for (n, what) in [
            (n_empty, "vertices without a value"),
            (n_thinned, "vertices nearer to another than --thin"),
        ] {
            if n > 0 {
                self.map.left_out.insert(what.into(), n);
            }
        }
    }

    /// Activation starts where it is earliest, if the user does not say otherwise.
    fn find_source(&mut self, given: Option<u32>) -> Result<(), ImportError> {
        let Some(surface) = &self.surface else { return Ok(()) };
        let n = surface.mesh.n_vertices();
        if let Some(vertex) = given.filter(|vertex| *vertex as usize >= n) {
            return Err(ImportError::Unusable {
                file: "--source".into(),
                what: format!("vertex {vertex} is not on the surface (0 to {})", n - 1),
                help: "vertices are counted as in surface.vtp, from 0".into(),
            });
        }
        let time = |row: &Row| match row.reading {
            Reading { ref protocol, value: Value::Number(ms) } if protocol == "lat" => {
                Some((ms, row.vertex?))
            }
            _ => None,
        };
        let earlier = |a: &(f64, u32), b: &(f64, u32)| a.0.total_cmp(&b.0);
        let of_rows = self.rows.iter().filter_map(time).min_by(earlier);
        // what was thinned out counts, too
        let values = surface.point_data.get("lat").filter(|_| self.is_on_mesh);
        let values = values.and_then(|array| array.scalars());
        let on_mesh = values.into_iter().flatten().copied().zip(0..);
        let earliest = on_mesh.filter(|(ms, _)| ms.is_finite()).min_by(earlier).or(of_rows);
        self.source = given.or(earliest.map(|(_, vertex)| vertex));
        if let (Some((ms, vertex)), None) = (earliest, given) {
            self.map.remarks.push(format!(
                "column `source`: activation is taken to start at vertex {vertex}, the earliest ({ms} ms); --source VERTEX says otherwise"
            ));
        }
        Ok(())
    }
}

/// Vertices among `candidates`, in their order, that keep `distance` mm (a straight line) from those
/// before them.
fn spread(surface: &Surface, candidates: &[usize], distance: f64) -> Vec<usize> {
    let size = distance.max(1e-3);
    let cell = |p: [f64; 3]| p.map(|x| (x / size).floor() as i64);
    let mut cells: BTreeMap<[i64; 3], Vec<usize>> = BTreeMap::new();
    let mut kept = vec![];
    for v in candidates {
        let p = surface.mesh.vertices()[*v];
        let is_near = |w: &usize| {
            let q = surface.mesh.vertices()[*w];
            (0..3).map(|k| (p[k] - q[k]).powi(2)).sum::<f64>() < distance * distance
        };
        let [i, j, k] = cell(p);
        let around = (-1_i64..=1).flat_map(|a| (-1_i64..=1).map(move |b| (a, b)));
        let mut around = around.flat_map(|(a, b)| {
            (-1_i64..=1)
                .map(move |c| [i.saturating_add(a), j.saturating_add(b), k.saturating_add(c)])
        });
        if !around.any(|key| cells.get(&key).is_some_and(|own| own.iter().any(is_near))) {
            cells.entry([i, j, k]).or_default().push(*v);
            kept.push(*v);
        }
    }
    kept
}
