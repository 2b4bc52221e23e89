//! The surface of EnSite: XML of version `SJM_DIF_5.0`. What kind of map its values are stands in the
//! comment before them.

use roxmltree::{Document, Node};

use crate::import::{ImportError, Shell};

/// The version that is read.
const VERSION: &str = "SJM_DIF_5.0";
/// What the comment before values says before it names their kind.
const KIND: &str = "Data values at each vertex of DxL map";
/// The status of vertices that the system has not mapped.
const UNMAPPED: f64 = 2.0;

/// A surface and what was left out of its values.
#[derive(Debug, Default)]
pub(super) struct Surface {
    pub(super) shell: Shell,
    pub(super) n_unmapped: usize,
    pub(super) remarks: Vec<String>,
}

impl Surface {
    /// Whether two files have the same geometry.
    pub(super) fn is_same_as(&self, other: &Self) -> bool {
        self.shell.triangles == other.shell.triangles
            && self.shell.vertices.len() == other.shell.vertices.len()
    }

    /// Takes the values of another file of the same geometry.
    pub(super) fn take_values(&mut self, other: Self) {
        self.n_unmapped = self.n_unmapped.max(other.n_unmapped);
        self.remarks.extend(other.remarks);
        for (name, values) in other.shell.data {
            self.shell.data.entry(name).or_insert(values);
        }
    }
}

/// Reads a surface.
///
/// # Errors
/// No XML, another version, no volume with vertices, a number that is none, a polygon of another kind.
pub(super) fn parse(file: &str, text: &str) -> Result<Surface, ImportError> {
    let unusable = |what: String, help: &str| ImportError::Unusable {
        file: file.into(),
        what,
        help: help.into(),
    };
    let document = Document::parse(text).map_err(|error| {
        unusable(format!("no valid XML: {error}"), "the file is damaged; export it again")
    })?;
    let text_of = |name: &str| {
        document.descendants().find(|n| n.has_tag_name(name)).and_then(|n| n.text()).map(str::trim)
    };
    let version = text_of("Version").unwrap_or("none");
    if version != VERSION {
        return Err(unusable(
            format!("version {version}, expected {VERSION}"),
            "only this version is read; export the map as VTK or for OpenEP",
        ));
    }
    let volumes: Vec<Node> =
        document.descendants().filter(|node| node.has_tag_name("Volume")).collect();
    let has_vertices = |node: &&Node| node.children().any(|n| n.has_tag_name("Vertices"));
    let Some(volume) = volumes.iter().find(has_vertices) else {
        return Err(unusable("no volume with vertices".into(), "export the map with its surface"));
    };
    let mut surface = Surface::default();
    if volumes.len() > 1 {
        surface.remarks.push(format!("{file}: the first of {} volumes is taken", volumes.len()));
    }
    surface.read(file, *volume)?;
    Ok(surface)
}

impl Surface {
    fn read(&mut self, file: &str, volume: Node) -> Result<(), ImportError> {
        let mut status = vec![];
        for node in volume.children().filter(Node::is_element) {
            match node.tag_name().name() {
                "Vertices" => {
                    self.shell.vertices = triples(file, node)?;
                }
                "Polygons" => {
                    for corners in triples(file, node)? {
                        self.shell.triangles.push(corners.map(|v| v as u32));
                    }
                }
                "Map_status" => status = numbers(file, node)?,
                "Map_data" => self.take_map(file, node)?,
                _ => {}
            }
        }
        let n = self.shell.vertices.len();
        let is_corner = |v: &u32| (1..=n as u64).contains(&u64::from(*v));
        if !self.shell.triangles.iter().flatten().all(is_corner) {
            return Err(ImportError::Unusable {
                file: file.into(),
                what: format!("a polygon names a vertex that is not there (1 to {n})"),
                help: "the file is damaged; export it again".into(),
            });
        }
        // polygons count from 1
        self.shell.triangles.iter_mut().flatten().for_each(|v| *v -= 1);
        self.shell.data.retain(|_, values| values.len() == n);
        if status.len() == n {
            let is_unmapped = |v: &usize| (status[*v] - UNMAPPED).abs() < 0.5;
            let unmapped: Vec<usize> = (0..n).filter(is_unmapped).collect();
            for values in self.shell.data.values_mut() {
                for v in &unmapped {
                    values[*v] = f64::NAN;
                }
            }
            self.n_unmapped = unmapped.len();
        }
        Ok(())
    }

    /// Values whose kind the comment before them tells.
    fn take_map(&mut self, file: &str, node: Node) -> Result<(), ImportError> {
        let comment = node.prev_siblings().skip(1).find(Node::is_comment).and_then(|n| n.text());
        let kind = comment.and_then(|text| text.split_once(KIND)).map(|(_, kind)| kind.trim());
        let values = numbers(file, node)?;
        let name = match kind {
            Some(kind) if kind.contains("LAT") => "lat",
            Some(kind) if kind.contains("P-P") && kind.contains("uni") => "unipolar",
            Some(kind) if kind.contains("P-P") => "bipolar",
            other => {
                let kind = other.unwrap_or("no comment tells");
                self.remarks.push(format!("{file}: values of another kind are left out ({kind})"));
                return Ok(());
            }
        };
        if values.len() == self.shell.vertices.len() {
            self.shell.data.insert(name.into(), values);
        } else {
            self.remarks.push(format!(
                "{file}: {} values of {name} for {} vertices are left out",
                values.len(),
                self.shell.vertices.len()
            ));
        }
        Ok(())
    }
}

/// The numbers of an element, three each.
fn triples(file: &str, node: Node) -> Result<Vec<[f64; 3]>, ImportError> {
    let numbers = numbers(file, node)?;
    let (triples, rest) = numbers.as_chunks::<3>();
    if rest.is_empty() {
        return Ok(triples.to_vec());
    }
    Err(ImportError::Unusable {
        file: file.into(),
        what: format!(
            "{} has {} numbers, no multiple of three",
            node.tag_name().name(),
            numbers.len()
        ),
        help: "only triangles are read; the file may be damaged: export it again".into(),
    })
}

fn numbers(file: &str, node: Node) -> Result<Vec<f64>, ImportError> {
    let text = node.text().unwrap_or_default();
    let number = |word: &str| {
        word.parse::<f64>().map_err(|_| ImportError::Unusable {
            file: file.into(),
            what: format!("{}: expected a number, got `{word}`", node.tag_name().name()),
            help: "the file is damaged; export it again".into(),
        })
    };
    text.split_whitespace().map(number).collect()
}
