//! The picture of a mesh that cannot be mended: a VTP file in which the places are marked.

use super::bytes::write_whole;
use super::content::Content;
use super::geometry::{Geometry, Rows};
use super::mend::Refusal;
use super::pieces::Pieces;
use super::vtk;
use std::path::Path;

/// Writes what was read to `file` (mm), with point data `fault`, 1 at the vertices at fault, or `piece`,
/// the number of the piece; gives the line that tells where the picture is. Without a file, or with
/// nothing to mark, it is empty.
pub(super) fn mark(
    file: Option<&Path>,
    content: &Content,
    refusal: &Refusal,
    pieces: Option<&Pieces>,
) -> String {
    let Some(file) = file.filter(|_| pieces.is_some() || !refusal.vertices.is_empty()) else {
        return String::new();
    };
    let n = content.vertices.len() as u32;
    let (name, marked): (&str, Vec<f64>) = if let Some(pieces) = pieces {
        let number = |v: u32| pieces.rank_of(v).map_or(0.0, |rank| rank as f64 + 1.0);
        ("piece", (0..n).map(number).collect())
    } else {
        let mut fault = vec![0.0; content.vertices.len()];
        for v in &refusal.vertices {
            fault[*v as usize] = 1.0;
        }
        ("fault", fault)
    };
    let geometry = Geometry {
        vertices: &content.vertices,
        triangles: &content.triangles,
        point_data: vec![Rows { name, width: 1, values: &marked }],
        cell_data: vec![],
    };
    match write_whole(file, &vtk::vtp(&geometry)) {
        Ok(()) => format!("\nhelp: {} shows where, as point data `{name}`", file.display()),
        Err(error) => format!("\nhelp: the picture of where it is could not be written: {error}"),
    }
}
