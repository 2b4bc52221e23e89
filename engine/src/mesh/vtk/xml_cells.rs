//! The cells of an XML file: points, lines, polygons and strips, or cells with a type each.

use super::cells::add_typed;
use super::xml_array::Reader;
use crate::mesh::MeshError;
use crate::mesh::content::Cells;
use roxmltree::Node;

/// The cells of a piece of `PolyData`, in VTK's order: points, lines, polygons, strips.
pub(super) fn poly_data<'a>(
    reader: &Reader<'a>,
    piece: Node<'a, 'a>,
    cells: &mut Cells,
) -> Result<(), MeshError> {
    for name in ["Verts", "Lines", "Polys", "Strips"] {
        let Some(node) = piece.children().find(|n| n.has_tag_name(name)) else { continue };
        let Some((corners, offsets)) = lists(reader, node)? else { continue };
        reader.is_count(piece, &format!("NumberOf{name}"), offsets.len())?;
        match name {
            "Polys" => split(reader, node, &corners, &offsets, |c| cells.polygon(c))?,
            "Strips" => split(reader, node, &corners, &offsets, |c| cells.strip(c))?,
            _ => cells.skip(offsets.len()),
        }
    }
    Ok(())
}

/// The cells of a piece of `UnstructuredGrid`.
pub(super) fn unstructured_grid<'a>(
    reader: &Reader<'a>,
    piece: Node<'a, 'a>,
    cells: &mut Cells,
) -> Result<(), MeshError> {
    let node = reader.child(piece, "Cells")?;
    let Some((corners, offsets)) = lists(reader, node)? else { return Ok(()) };
    reader.is_count(piece, "NumberOfCells", offsets.len())?;
    let types = reader.named(node, "types")?;
    if types.len() != offsets.len() {
        let expected = format!("{} types, one per cell", offsets.len());
        return Err(reader.wrong(node, &expected, types.len().to_string()));
    }
    let mut types = types.into_iter();
    split(reader, node, &corners, &offsets, |corners| {
        let kind = types.next().unwrap_or(0.0) as i64;
        add_typed(cells, kind, corners, reader.path())
    })
}

/// Corners of all cells, and where each cell ends.
type Lists = (Vec<f64>, Vec<f64>);

/// The arrays `connectivity` and `offsets`; `None` if the element has none.
fn lists<'a>(reader: &Reader<'a>, node: Node<'a, 'a>) -> Result<Option<Lists>, MeshError> {
    if !node.children().any(|n| n.has_tag_name("DataArray")) {
        return Ok(None);
    }
    Ok(Some((reader.named(node, "connectivity")?, reader.named(node, "offsets")?)))
}

/// Gives the corners of each cell to `add`; cell `i` ends before corner `offsets[i]`.
fn split(
    reader: &Reader<'_>,
    node: Node,
    corners: &[f64],
    offsets: &[f64],
    mut add: impl FnMut(&[i64]) -> Result<(), MeshError>,
) -> Result<(), MeshError> {
    let mut begin = 0;
    let mut cell = vec![];
    if let Some(number) = corners.iter().chain(offsets).find(|number| number.fract() != 0.0) {
        return Err(reader.wrong(node, "whole numbers", number.to_string()));
    }
    for end in offsets {
        let Some(points) = corners.get(begin..*end as usize).filter(|_| *end >= 0.0) else {
            let expected = format!("offsets that rise to {}", corners.len());
            return Err(reader.wrong(node, &expected, format!("{end} after {begin}")));
        };
        cell.clear();
        cell.extend(points.iter().map(|point| *point as i64));
        add(&cell)?;
        begin = *end as usize;
    }
    if begin == corners.len() {
        return Ok(());
    }
    let expected = format!("{begin} corners, as many as the last offset says");
    Err(reader.wrong(node, &expected, corners.len().to_string()))
}
