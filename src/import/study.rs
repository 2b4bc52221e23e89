//! What a study holds, whichever system it comes from.

use std::collections::BTreeMap;

use crate::mesh::{MeshError, Surface, mended};

/// A study of a mapping system.
#[derive(Clone, Debug, Default)]
pub struct Study {
    /// What the files are: system and version.
    pub format: String,
    /// Its maps.
    pub maps: Vec<Map>,
    /// Sentences for the user about the study as a whole.
    pub remarks: Vec<String>,
}

/// One map: a surface and what was measured on it.
#[derive(Clone, Debug, Default)]
pub struct Map {
    /// Its name.
    pub name: String,
    /// Its surface.
    pub ground: Option<Ground>,
    /// The points that were taken; brackets of pacing among them.
    pub points: Vec<Point>,
    /// Sentences for the user.
    pub remarks: Vec<String>,
    /// What was left out: the reason, and how often.
    pub left_out: BTreeMap<String, usize>,
}

/// The surface of a map.
#[derive(Clone, Debug)]
pub enum Ground {
    /// As a file has it.
    Shell(Shell),
    /// Mended; [`Site::Vertex`] counts the vertices of its file.
    Surface(Box<Surface>),
}

/// A surface as a file has it, mm. It may have faults.
#[derive(Clone, Debug, Default)]
pub struct Shell {
    /// Coordinates, mm.
    pub vertices: Vec<[f64; 3]>,
    /// Triangles as indices of vertices.
    pub triangles: Vec<[u32; 3]>,
    /// Values at the vertices by name, NaN where there is none.
    pub data: BTreeMap<String, Vec<f64>>,
}

/// Where something was measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Site {
    /// A place, mm.
    At([f64; 3]),
    /// A vertex of the file's surface.
    Vertex(usize),
}

/// A point of a map: what was measured at one place.
#[derive(Clone, Debug)]
pub struct Point {
    /// Its name in the study.
    pub name: String,
    /// Where it was taken.
    pub site: Site,
    /// What was measured.
    pub readings: Vec<Reading>,
    /// What else is known of it, by column.
    pub cells: BTreeMap<String, String>,
}

/// One measurement.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading {
    /// Its kind: `bipolar` (mV), `unipolar` (mV), `lat` (ms), or a pacing protocol such as `s1s2`.
    pub protocol: String,
    /// What it is.
    pub value: Value,
}

impl Reading {
    /// Whether it is a bracket with an open end.
    pub fn is_open(&self) -> bool {
        matches!(self.value, Value::Bracket(None, _) | Value::Bracket(_, None))
    }
}

/// A number, or a bracket of which an end may be open.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Value {
    /// In the unit of its protocol.
    Number(f64),
    /// Lower and upper end, ms; an open end is `None`.
    Bracket(Option<f64>, Option<f64>),
}

/// Quantities of a map that are measurements, with their unit. An array of a shell with one of these
/// names is a map of it.
pub const QUANTITIES: [(&str, &str); 3] = [("bipolar", "mV"), ("unipolar", "mV"), ("lat", "ms")];

impl Map {
    /// Counts something that was left out.
    pub(super) fn leave_out(&mut self, reason: impl Into<String>) {
        *self.left_out.entry(reason.into()).or_default() += 1;
    }

    /// Whether a point has a measurement.
    pub fn has_points(&self) -> bool {
        self.points.iter().any(|point| !point.readings.is_empty())
    }

    /// Quantities that stand on the shell's vertices, with the number of vertices that have a value.
    pub fn on_mesh(&self) -> Vec<(&'static str, usize)> {
        let filled = |name: &&'static str| {
            let values = self.ground.as_ref()?.scalar(name)?;
            let n = values.iter().filter(|x| x.is_finite()).count();
            (n > 0).then_some((*name, n))
        };
        QUANTITIES.iter().filter_map(|(name, _)| filled(name)).collect()
    }

    /// Whether there is a surface and something measured on it.
    pub fn is_usable(&self) -> bool {
        self.ground.is_some() && (self.has_points() || !self.on_mesh().is_empty())
    }

    /// The map in a few words, for a list.
    pub fn in_words(&self) -> String {
        let measured = self.points.iter().filter(|point| !point.readings.is_empty()).count();
        let ground = match &self.ground {
            Some(ground) => format!("a surface of {} vertices", ground.n_vertices()),
            None => "no surface".into(),
        };
        let on_mesh: Vec<&str> = self.on_mesh().into_iter().map(|(name, _)| name).collect();
        let on_mesh = match &on_mesh[..] {
            [] => "no values on it".into(),
            names => format!("{} on it", names.join(", ")),
        };
        let remarks = match &self.remarks[..] {
            [] => String::new(),
            remarks => format!(" ({})", remarks.join("; ")),
        };
        format!(
            "  {}: {ground}, {on_mesh}, {measured} points with a measurement{remarks}",
            self.name
        )
    }
}

impl Ground {
    /// The values `name` at its vertices.
    pub fn scalar(&self, name: &str) -> Option<Vec<f64>> {
        match self {
            Self::Shell(shell) => shell.data.get(name).cloned(),
            Self::Surface(surface) => surface.scalar(name),
        }
    }

    fn n_vertices(&self) -> usize {
        match self {
            Self::Shell(shell) => shell.vertices.len(),
            Self::Surface(surface) => surface.mesh.n_vertices(),
        }
    }

    /// The surface, mended where that needs no choice.
    ///
    /// # Errors
    /// Those of [`mended`].
    pub fn surface(self) -> Result<Surface, MeshError> {
        match self {
            Self::Shell(shell) => mended(shell.vertices, shell.triangles, shell.data),
            Self::Surface(surface) => Ok(*surface),
        }
    }
}

impl Point {
    /// A point of which only the place is known.
    pub(super) fn at(name: impl Into<String>, site: Site) -> Self {
        Self { name: name.into(), site, readings: vec![], cells: BTreeMap::new() }
    }

    /// Adds a number, if it is one.
    pub(super) fn measure(&mut self, protocol: &str, value: Option<f64>) {
        if let Some(value) = value.filter(|x| x.is_finite()) {
            let value = Value::Number(value);
            self.readings.push(Reading { protocol: protocol.into(), value });
        }
    }

    /// Adds a number that goes with the measurements.
    pub(super) fn know(&mut self, column: &str, value: Option<f64>) {
        if let Some(value) = value.filter(|x| x.is_finite()) {
            self.cells.insert(column.into(), value.to_string());
        }
    }
}
