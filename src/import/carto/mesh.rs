//! The `.mesh` file of CARTO 3: sections of lines `index = values`.

use std::collections::BTreeMap;

use super::MISSING;
use crate::import::{ImportError, Shell};

/// A mesh and what was left out of it.
#[derive(Debug, Default)]
pub(super) struct Mesh {
    /// Active and visible triangles, and the vertices that they use.
    pub(super) shell: Shell,
    /// Triangles of the group −1000000, or at vertices of that group.
    pub(super) n_inactive: usize,
    /// Triangles of another negative group.
    pub(super) n_hidden: usize,
    /// Vertices that no remaining triangle uses.
    pub(super) n_unused: usize,
    /// Whether there is a colours section, all of whose values are missing.
    pub(super) has_empty_colours: bool,
}

/// What marks a vertex or triangle as deleted.
const INACTIVE: i64 = -1_000_000;

/// Reads the text of `file`.
///
/// # Errors
/// No triangulated mesh, a line that holds something else, or a count in the header that the
/// sections do not have.
pub(super) fn parse(file: &str, text: &str) -> Result<Mesh, ImportError> {
    let mut raw = Raw::default();
    let mut section = Section::Head;
    let first = text.lines().next().unwrap_or_default();
    if !first.to_ascii_lowercase().contains("triangulatedmeshversion") {
        return Err(ImportError::line(file, 1, "#TriangulatedMeshVersion2.0", first));
    }
    for (number, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.starts_with('[') {
            section = Section::named(line);
        } else if line.starts_with('#') || line.is_empty() {
        } else if let Some(comment) = line.strip_prefix(';') {
            raw.comment(section, comment);
        } else {
            let wrong = |expected: &str| ImportError::line(file, number + 1, expected, line);
            raw.line(section, line).map_err(wrong)?;
        }
    }
    raw.check_counts(file, text.lines().count())?;
    Ok(raw.finish())
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Section {
    Head,
    Vertices,
    Triangles,
    Colours,
    Attributes,
    Other,
}

impl Section {
    fn named(line: &str) -> Self {
        match line.trim_matches(['[', ']']).to_ascii_lowercase().as_str() {
            "generalattributes" => Self::Head,
            "verticessection" => Self::Vertices,
            "trianglessection" => Self::Triangles,
            "verticescolorssection" => Self::Colours,
            "verticesattributessection" => Self::Attributes,
            _ => Self::Other,
        }
    }
}

#[derive(Debug, Default)]
struct Raw {
    /// Counts that the header promises.
    counts: BTreeMap<String, usize>,
    vertices: Vec<[f64; 3]>,
    vertex_groups: Vec<i64>,
    triangles: Vec<[u32; 3]>,
    triangle_groups: Vec<i64>,
    colour_names: Vec<String>,
    /// A row for each vertex, as far as the section goes.
    colours: Vec<Vec<f64>>,
    attribute_names: Vec<String>,
    attributes: Vec<Vec<f64>>,
}

impl Raw {
    /// The comment that heads a section names its columns.
    fn comment(&mut self, section: Section, comment: &str) {
        // the names of the colours run straight into the name of a section
        let names = comment.split('[').next().unwrap_or_default();
        let names: Vec<String> = names.split_whitespace().map(String::from).collect();
        match section {
            Section::Colours if self.colours.is_empty() && !comment.contains('=') => {
                self.colour_names = names;
            }
            Section::Attributes if self.attributes.is_empty() && !comment.contains('=') => {
                self.attribute_names = names;
            }
            _ => {}
        }
    }

    /// A line of data; the error says what was expected.
    fn line(&mut self, section: Section, line: &str) -> Result<(), &'static str> {
        let Some((key, values)) = line.split_once('=') else {
            return if section == Section::Other { Ok(()) } else { Err("`name = value`") };
        };
        let key = key.trim();
        match section {
            Section::Head => {
                if let Ok(count) = values.trim().parse() {
                    self.counts.insert(key.into(), count);
                }
            }
            Section::Vertices => {
                const EXPECTED: &str = "the next vertex: `index = X Y Z NX NY NZ GroupID`";
                let values = numbers(values).ok_or(EXPECTED)?;
                let [x, y, z, .., group] = values[..] else { return Err(EXPECTED) };
                check_index(key, self.vertices.len()).ok_or(EXPECTED)?;
                self.vertices.push([x, y, z]);
                self.vertex_groups.push(group as i64);
            }
            Section::Triangles => {
                const EXPECTED: &str = "a triangle: `index = V0 V1 V2 NX NY NZ GroupID`";
                let values = numbers(values).ok_or(EXPECTED)?;
                let [a, b, c, .., group] = values[..] else { return Err(EXPECTED) };
                let n = self.vertices.len() as f64;
                if [a, b, c].iter().any(|v| !(0.0..n).contains(v) || v.fract() != 0.0) {
                    return Err("a triangle of three vertices of the section before");
                }
                self.triangles.push([a, b, c].map(|v| v as u32));
                self.triangle_groups.push(group as i64);
            }
            Section::Colours => {
                const EXPECTED: &str = "the colours of the next vertex: `index = numbers`";
                check_index(key, self.colours.len()).ok_or(EXPECTED)?;
                self.colours.push(numbers(values).ok_or(EXPECTED)?);
            }
            Section::Attributes => {
                const EXPECTED: &str = "the attributes of the next vertex: `index = numbers`";
                check_index(key, self.attributes.len()).ok_or(EXPECTED)?;
                self.attributes.push(numbers(values).ok_or(EXPECTED)?);
            }
            Section::Other => {}
        }
        Ok(())
    }

    fn check_counts(&self, file: &str, n_lines: usize) -> Result<(), ImportError> {
        let there = [("NumVertex", self.vertices.len()), ("NumTriangle", self.triangles.len())];
        for (name, got) in there {
            if let Some(&expected) = self.counts.get(name).filter(|expected| **expected != got) {
                let expected = format!("{expected} lines, as {name} says");
                return Err(ImportError::line(file, n_lines, expected, &format!("{got} of them")));
            }
        }
        Ok(())
    }

    fn finish(self) -> Mesh {
        let mut mesh = Mesh::default();
        let mut kept = vec![];
        for (triangle, group) in self.triangles.iter().zip(&self.triangle_groups) {
            let groups = triangle.map(|v| self.vertex_groups[v as usize]);
            if *group == INACTIVE || groups.contains(&INACTIVE) {
                mesh.n_inactive += 1;
            } else if *group < 0 {
                mesh.n_hidden += 1;
            } else {
                kept.push(*triangle);
            }
        }
        let mut new_index = vec![None; self.vertices.len()];
        let mut order = vec![];
        for v in kept.iter_mut().flatten() {
            let index = new_index[*v as usize].get_or_insert_with(|| {
                order.push(*v as usize);
                order.len() as u32 - 1
            });
            *v = *index;
        }
        mesh.n_unused = self.vertices.len() - order.len();
        mesh.shell.vertices = order.iter().map(|v| self.vertices[*v]).collect();
        mesh.shell.triangles = kept;
        mesh.shell.data = self.data(&order);
        mesh.has_empty_colours = !self.colours.is_empty()
            && !self.colour_names.iter().any(|name| mesh.shell.data.contains_key(&column(name)));
        mesh
    }

    /// The columns that have a value, at the vertices that are kept.
    fn data(&self, order: &[usize]) -> BTreeMap<String, Vec<f64>> {
        let colours = self.colour_names.iter().enumerate().map(|(k, name)| {
            let value = |v: &usize| self.colours.get(*v).and_then(|row| row.get(k)).copied();
            let value = |v| value(v).filter(|x| *x > MISSING).unwrap_or(f64::NAN);
            (column(name), order.iter().map(value).collect::<Vec<f64>>())
        });
        let attributes = self.attribute_names.iter().enumerate().map(|(k, name)| {
            let value = |v: &usize| self.attributes.get(*v).and_then(|row| row.get(k)).copied();
            // 0 is no mark
            let value = |v| value(v).unwrap_or(0.0);
            (column(name), order.iter().map(value).collect::<Vec<f64>>())
        });
        let colours = colours.filter(|(_, values)| values.iter().any(|x| x.is_finite()));
        let attributes = attributes.filter(|(_, values)| values.iter().any(|x| *x > 0.0));
        colours.chain(attributes).collect()
    }
}

/// A column's name among the arrays of the surface.
fn column(name: &str) -> String {
    let sign = |c: char| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '_' };
    match name {
        "µBi" => "micro_bipolar".into(),
        name => name.chars().map(sign).collect(),
    }
}

fn check_index(text: &str, expected: usize) -> Option<()> {
    (text.parse() == Ok(expected)).then_some(())
}

/// All of the numbers, if they are numbers.
fn numbers(text: &str) -> Option<Vec<f64>> {
    text.split_whitespace().map(|word| word.parse().ok()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::carto::example;

    #[test]
    fn groups_unused_vertices_and_missing_values_are_left_out() {
        let mesh = parse("1-LA.mesh", &example::mesh()).unwrap();
        assert_eq!((mesh.n_inactive, mesh.n_hidden, mesh.n_unused), (1, 1, 2));
        assert_eq!((mesh.shell.vertices.len(), mesh.shell.triangles.len()), (100, 162));
        let data = &mesh.shell.data;
        assert!((data["bipolar"][0] - 1.0).abs() < 1e-12 && data["bipolar"][1].is_nan());
        // 0 ms is a value, and a column without any value is none
        assert!(data["lat"][0].abs() < 1e-12);
        assert_eq!(data.keys().collect::<Vec<_>>(), ["bipolar", "lat", "scar", "unipolar"]);
        assert!(!mesh.has_empty_colours);
    }

    #[test]
    fn empty_colours_are_noticed() {
        let text = example::mesh();
        let (before, _) = text.split_once("[VerticesColorsSection]").unwrap();
        let colours: Vec<String> = (0..102).map(|v| format!("{v} = -10000 -10000")).collect();
        let head = "[VerticesColorsSection]\n; Unipolar Bipolar\n\n";
        let empty = before.to_owned() + head + &colours.join("\n");
        assert!(parse("m.mesh", &empty).unwrap().has_empty_colours);
    }

    #[test]
    fn a_damaged_line_is_named() {
        let text = example::mesh();
        for (from, to, expected) in [
            ("#Triang", "#Strang", "m.mesh, line 1: expected #TriangulatedMeshVersion2.0"),
            ("   0 =  0 1 10", "   0 =  0 1 999", "a triangle of three vertices of the section"),
            ("NumTriangle            = 164", "NumTriangle            = 165", "expected 165 lines"),
            ("   1 =  6.0", "   2 =  6.0", "the next vertex"),
        ] {
            assert!(text.contains(from), "{from}");
            let error = parse("m.mesh", &text.replacen(from, to, 1)).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
    }
}
