//! openCARP's meshes: points in `BASE.pts`, elements with region tags in `BASE.elem` and fibres of the
//! elements in `BASE.lon`, in micrometres.

use super::bytes::{read_bytes, write_whole};
use super::content::{Cells, Content};
use super::text::Lines;
use super::{Array, Data, MeshError, Surface, Units};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io;
use std::path::{Path, PathBuf};

/// What the fibres and, of two vectors, the second ones are called.
const FIBRES: [&str; 2] = ["fibre", "sheet"];
/// What the tags of the elements are called.
const REGION: &str = "region";

/// The files `.pts`, `.elem` and `.lon` of the mesh that is named by any of them or by their base.
pub(super) fn files(path: &Path) -> [PathBuf; 3] {
    let extensions = ["pts", "elem", "lon"];
    let is_one = path.extension().is_some_and(|e| extensions.iter().any(|known| e == *known));
    let base = if is_one { path.with_extension("") } else { path.to_owned() };
    extensions.map(|extension| {
        let mut name = base.clone().into_os_string();
        name.push(".");
        name.push(extension);
        name.into()
    })
}

/// Reads the files of the mesh `path`; there may be no `.lon`.
///
/// # Errors
/// `Read`, `Parse`, `Truncated`, `IndexOutOfRange`, and `Unsupported` for volumes.
pub(super) fn read(path: &Path) -> Result<Content, MeshError> {
    let [pts, elem, lon] = files(path);
    let vertices = points(&pts, &read_bytes(&pts)?)?;
    let mut cells = Cells::new(vertices.len());
    if !elem.exists() {
        let reason = "no such file, in which openCARP has the elements of a mesh";
        let source = io::Error::new(io::ErrorKind::NotFound, reason);
        return Err(MeshError::Read { path: elem, source });
    }
    let tags =
        elements(&elem, &read_bytes(&elem)?, &mut cells).map_err(|error| at(&elem, error))?;
    let mut data: Data = BTreeMap::new();
    if !tags.iter().any(|tag| tag.is_nan()) {
        data.insert(REGION.into(), tags.into());
    }
    if lon.exists() {
        data.extend(fibres(&lon, &read_bytes(&lon)?, cells.len())?);
    }
    let content = cells.into_content(vertices, Data::new(), data);
    Ok(Content { units: Some(Units::Um), ..content })
}

fn at(path: &Path, error: MeshError) -> MeshError {
    match error {
        MeshError::IndexOutOfRange { .. } => {
            MeshError::Invalid { path: path.into(), source: error.into(), picture: String::new() }
        }
        other => other,
    }
}

/// The count on the first line.
fn count(lines: &mut Lines, of: &str) -> Result<usize, MeshError> {
    let expected = format!("the number of {of}");
    let line = lines.expect(&expected)?;
    line.parse().map_err(|_| lines.wrong(&expected, &line))
}

/// No line may follow.
fn end(lines: &mut Lines, n: usize, of: &str) -> Result<(), MeshError> {
    match lines.next() {
        None => Ok(()),
        Some(line) => Err(lines.wrong(&format!("the end of the file after {n} {of}"), &line)),
    }
}

fn points(path: &Path, bytes: &[u8]) -> Result<Vec<[f64; 3]>, MeshError> {
    let mut lines = Lines::new(path, bytes);
    let n = count(&mut lines, "points")?;
    let mut points = vec![];
    while points.len() < n {
        let line = lines.expect(&format!("point {} of {n}", points.len()))?;
        points.push(lines.point(&mut line.split_ascii_whitespace())?);
    }
    end(&mut lines, n, "points")?;
    Ok(points)
}

/// Adds the elements to `cells` and gives the tag of each, NaN where there is none.
fn elements(path: &Path, bytes: &[u8], cells: &mut Cells) -> Result<Vec<f64>, MeshError> {
    const EXPECTED: &str =
        "an element: Tr and three points, Qd and four, or Ln and two; a tag may follow";
    let mut lines = Lines::new(path, bytes);
    let n = count(&mut lines, "elements")?;
    let mut tags = vec![];
    let mut corners = vec![];
    while tags.len() < n {
        let line = lines.expect(&format!("element {} of {n}", tags.len()))?;
        let mut words = line.split_ascii_whitespace();
        let kind = words.next().unwrap_or_default();
        let n_corners = match kind {
            "Ln" | "Cx" => 2,
            "Tr" => 3,
            "Qd" => 4,
            "Tt" | "Hx" | "Oc" | "Py" | "Pr" => return Err(volume(path, tags.len(), kind)),
            _ => return Err(lines.wrong(EXPECTED, &line)),
        };
        let mut number = || words.next()?.parse::<i64>().ok();
        corners.clear();
        corners.extend((0..n_corners).map_while(|_| number()));
        if corners.len() < n_corners {
            return Err(lines.wrong(EXPECTED, &line));
        }
        let tag = words.next().map_or(Ok(f64::NAN), str::parse);
        tags.push(tag.map_err(|_| lines.wrong("a number as the tag", &line))?);
        if n_corners == 2 { cells.skip(1) } else { cells.polygon(&corners)? }
    }
    end(&mut lines, n, "elements")?;
    Ok(tags)
}

fn volume(path: &Path, element: usize, kind: &str) -> MeshError {
    let name = match kind {
        "Tt" => "a tetrahedron (Tt)",
        "Hx" => "a hexahedron (Hx)",
        _ => "a volume element",
    };
    MeshError::Unsupported {
        path: path.into(),
        what: format!("element {element} is {name}, expected triangles (Tr): the mesh is a volume"),
        help: "extract its surface first: meshtool extract surface -msh=BASE -surf=SURFACE -ofmt=vtk",
    }
}

/// One or two vectors for each of `n` elements. A line with the count of vectors may come first.
fn fibres(path: &Path, bytes: &[u8], n: usize) -> Result<Data, MeshError> {
    let mut lines = Lines::new(path, bytes);
    let mut rows: [Vec<[f64; 3]>; 2] = [vec![], vec![]];
    let (mut is_first, mut n_vectors) = (true, None);
    while let Some(line) = lines.next() {
        let n_words = line.split_ascii_whitespace().count();
        let is_count = is_first && n_words == 1;
        is_first = false;
        if is_count {
            continue;
        }
        let n_here = *n_vectors.get_or_insert(n_words / 3);
        if !matches!((n_here, n_words), (1, 3) | (2, 6)) {
            return Err(lines.wrong("one or two vectors of three numbers on every line", &line));
        }
        let mut words = line.split_ascii_whitespace();
        for row in &mut rows[..n_here] {
            row.push(lines.point(&mut words)?);
        }
    }
    if rows[0].len() != n {
        let got = format!("{} fibres", rows[0].len());
        return Err(lines.wrong(&format!("{n} fibres, one for each element"), &got));
    }
    let named = FIBRES.into_iter().zip(rows).take(n_vectors.unwrap_or(0));
    Ok(named.map(|(name, row)| (name.to_owned(), Array::from(row))).collect())
}

/// Writes a surface as `.pts`, `.elem` and, if it has fibres, `.lon`; gives the arrays that have no place
/// there.
pub(super) fn write(path: &Path, surface: &Surface) -> Result<Vec<String>, MeshError> {
    let [pts, elem, lon] = files(path);
    let mesh = &surface.mesh;
    let mut text = format!("{}\n", mesh.n_vertices());
    for p in mesh.vertices() {
        let [x, y, z] = p.map(|x| x / Units::Um.in_mm());
        let _ = writeln!(text, "{x} {y} {z}");
    }
    write_whole(&pts, text.as_bytes())?;
    text = format!("{}\n", mesh.n_triangles());
    for ([a, b, c], tag) in mesh.triangles().iter().zip(tags(surface)) {
        let _ = writeln!(text, "Tr {a} {b} {c} {tag}");
    }
    write_whole(&elem, text.as_bytes())?;
    let mut kept = vec![REGION];
    if let Some((name, fibres)) = surface.any_fibres() {
        kept.push(name);
        let sheet = surface.triangle_fibres(FIBRES[1]);
        kept.extend(sheet.is_some().then_some(FIBRES[1]));
        write_whole(&lon, lon_text(&fibres, sheet.as_deref()).as_bytes())?;
    }
    let all = surface.point_data.keys().chain(surface.cell_data.keys());
    Ok(all.filter(|name| !kept.contains(&name.as_str())).cloned().collect())
}

fn lon_text(fibres: &[[f64; 3]], sheet: Option<&[[f64; 3]]>) -> String {
    let mut text = format!("{}\n", 1 + usize::from(sheet.is_some()));
    for (i, [x, y, z]) in fibres.iter().enumerate() {
        let _ = match sheet.map(|sheet| sheet[i]) {
            None => writeln!(text, "{x} {y} {z}"),
            Some([u, v, w]) => writeln!(text, "{x} {y} {z} {u} {v} {w}"),
        };
    }
    text
}

/// The tag of each triangle: its region, else the region of two of its corners or the first, else 0.
fn tags(surface: &Surface) -> Vec<f64> {
    let of_cells = surface.cell_data.get(REGION).and_then(Array::scalars);
    if let Some(tags) = of_cells {
        return tags.to_vec();
    }
    let of_points = surface.point_data.get(REGION).and_then(Array::scalars);
    let Some(region) = of_points else { return vec![0.0; surface.mesh.n_triangles()] };
    let tag = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| region[v as usize]);
        if b.total_cmp(&c).is_eq() { b } else { a }
    };
    surface.mesh.triangles().iter().map(tag).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Reading, read};
    use std::fs;

    const PTS: &str = "4\n0 0 0\n40000 0 0\n40000 50000 0\n0 50000 0\n";
    const ELEM: &str = "3\nTr 0 1 2 11\nLn 0 1 7\nTr 0 2 3 12.0\n";

    /// Reads the three texts as a mesh; without one the file is not there.
    fn surface(elem: &str, lon: Option<&str>) -> Result<Surface, String> {
        let folder = tempfile::TempDir::new().unwrap();
        let base = folder.path().join("la.1");
        let file = |extension: &str| folder.path().join(format!("la.1.{extension}"));
        fs::write(file("pts"), PTS).unwrap();
        fs::write(file("elem"), elem).unwrap();
        if let Some(text) = lon {
            fs::write(file("lon"), text).unwrap();
        }
        let name = folder.path().to_str().unwrap().to_owned();
        read(&base, None).map_err(|error| error.to_string().replace(&name, ""))
    }

    #[test]
    fn tags_and_fibres_belong_to_their_elements() {
        for lon in
            ["2\n1 0 0 0 1 0\n9 9 9 9 9 9\n0 1 0 1 0 0\n", "1 0 0 0 1 0\n9 9 9 9 9 9\n0 1 0 1 0 0"]
        {
            let surface = surface(ELEM, Some(lon)).unwrap();
            assert_eq!(surface.cell_data["region"].values(), [11.0, 12.0]);
            assert_eq!(surface.cell_data["fibre"].values(), [1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
            assert_eq!(surface.cell_data["sheet"].row(1), [1.0, 0.0, 0.0]);
            assert_eq!((surface.units, surface.mesh.area()), (Units::Um, 2000.0));
        }
        assert!(surface(ELEM, None).unwrap().cell_data.contains_key("region"));
        let no_tags = surface("1\nTr 0 1 2\n", Some("1\n1 0 0\n")).unwrap();
        assert_eq!(no_tags.cell_data.keys().collect::<Vec<_>>(), ["fibre"]);
    }

    #[test]
    fn the_layers_of_a_bilayer_are_surfaces_to_choose_from() {
        let folder = tempfile::TempDir::new().unwrap();
        let file = |name: &str| folder.path().join(name);
        let second = PTS.lines().skip(1).map(|p| p.replace(" 0", " 3000"));
        let all: Vec<String> = PTS.lines().skip(1).map(str::to_owned).chain(second).collect();
        fs::write(file("two.pts"), format!("8\n{}\n", all.join("\n"))).unwrap();
        let elements = "8\nTr 0 1 2 1\nTr 0 2 3 1\nTr 4 5 6 2\nTr 4 6 7 2\nLn 0 4 3\nLn 1 5 3\nLn 2 6 3\nLn 3 7 3\n";
        fs::write(file("two.elem"), elements).unwrap();
        let piece = |n: usize| Reading { piece: Some(n), ..Reading::default() };
        let text = read(&file("two.pts"), None).unwrap_err().to_string();
        assert!(text.contains("several surfaces") && text.contains("--piece 1"), "{text}");
        for (n, tag) in [(1, 1.0), (2, 2.0)] {
            let layer = read(&file("two"), piece(n)).unwrap();
            assert_eq!(layer.mesh.n_vertices(), 4);
            assert_eq!(layer.cell_data["region"].values(), [tag; 2]);
            assert!(layer.notes[0].starts_with("4 cells left out"), "{:?}", layer.notes);
        }
    }

    #[test]
    fn mistakes_are_named() {
        let fails = |elem: &str, lon: Option<&str>| surface(elem, lon).unwrap_err();
        assert!(fails("1\nTt 0 1 2 3 1\n", None).contains("element 0 is a tetrahedron (Tt)"));
        assert!(fails("1\nTr 0 1 4 1\n", None).contains("la.1.elem: triangle 0 names vertex 4"));
        assert!(
            fails("2\nTr 0 1 2 1\n", None)
                .contains("line 2: the file ends here, expected element 1 of 2")
        );
        assert!(
            fails("0\nTr 0 1 2 1\n", None).contains("line 2: expected the end of the file after 0")
        );
        assert!(fails("1\nTr 0 1 x 1\n", None).contains("line 2: expected an element"));
        assert!(
            fails(ELEM, Some("1\n1 0 0\n0 1 0\n"))
                .contains("expected 3 fibres, one for each element, got \"2 fibres\"")
        );
        assert!(fails(ELEM, Some("1 0\n")).contains("one or two vectors"));
    }
}
