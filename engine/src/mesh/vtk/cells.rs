//! Cells of a legacy VTK file, in the old list form and in the offsets form of version 5.

use super::super::MeshError;
use super::super::content;
use super::scanner::Scanner;
use super::types::named;
use crate::store::Kind;
use std::path::Path;

/// Cells as lists of point numbers.
#[derive(Debug, Default)]
pub(super) struct Cells {
    /// Cell `i` is `points[starts[i]..starts[i + 1]]`.
    starts: Vec<usize>,
    points: Vec<i64>,
}

impl Cells {
    /// Reads the cells after a header line `KEYWORD first second`.
    ///
    /// Until version 4.2 these are the number of cells and of integers (`n i j k …` for each cell); from
    /// 5.0 on the lengths of the arrays OFFSETS (one more than cells) and CONNECTIVITY.
    pub(super) fn read(
        scan: &mut Scanner,
        section: &str,
        first: usize,
        second: usize,
    ) -> Result<Self, MeshError> {
        if scan.next_is("OFFSETS") {
            return Self::read_offsets(scan, section, first, second);
        }
        let list = scan.integers(second, Kind::I32, section)?;
        let mut cells = Self { starts: vec![0], points: Vec::with_capacity(second) };
        let mut rest = list.as_slice();
        for cell in 0..first {
            let (&n, tail) = rest.split_first().unwrap_or((&0, &[]));
            let points =
                usize::try_from(n).ok().filter(|&n| n > 0).and_then(|n| tail.split_at_checked(n));
            let Some((points, tail)) = points else {
                let expected = format!("{section}: {first} cells in {second} integers");
                return Err(scan.error(
                    &expected,
                    format!("cell {cell} of {n} points, {} integers left", tail.len()),
                ));
            };
            cells.points.extend_from_slice(points);
            cells.starts.push(cells.points.len());
            rest = tail;
        }
        if rest.is_empty() {
            Ok(cells)
        } else {
            let expected = format!("{section}: {first} cells in {second} integers");
            Err(scan.error(&expected, format!("{} integers too many", rest.len())))
        }
    }

    fn read_offsets(
        scan: &mut Scanner,
        section: &str,
        n_offsets: usize,
        n_points: usize,
    ) -> Result<Self, MeshError> {
        let offsets = integer_array(scan, "OFFSETS", n_offsets)?;
        let points = integer_array(scan, "CONNECTIVITY", n_points)?;
        let starts: Option<Vec<usize>> =
            offsets.iter().map(|&start| usize::try_from(start).ok()).collect();
        let starts = starts.filter(|starts| {
            starts.is_sorted()
                && starts.first().is_none_or(|&first| first == 0)
                && starts.last().copied().unwrap_or(0) == n_points
        });
        match starts {
            Some(starts) => Ok(Self { starts, points }),
            None => Err(scan.error(
                &format!("{section}: offsets that rise from 0 to {n_points}"),
                "offsets that do not",
            )),
        }
    }

    /// The cells in file order.
    pub(super) fn iter(&self) -> impl Iterator<Item = &[i64]> {
        self.starts.windows(2).map(|ends| &self.points[ends[0]..ends[1]])
    }

    /// Number of cells.
    pub(super) fn len(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }
}

/// Adds a cell of an unstructured grid, whose type is `kind`, to the triangles of the file `path`.
///
/// # Errors
/// `NotATriangle` for a cell that is no triangle, polygon, strip, line or point.
pub(super) fn add_typed(
    cells: &mut content::Cells,
    kind: i64,
    corners: &[i64],
    path: &Path,
) -> Result<(), MeshError> {
    match (kind, corners) {
        (1..=4, _) => cells.skip(1),
        (5, [_, _, _]) | (7, [_, _, _, ..]) | (9, [_, _, _, _]) => cells.polygon(corners)?,
        (6, [_, _, _, ..]) => cells.strip(corners)?,
        // A pixel's corners stand row by row.
        (8, &[a, b, c, d]) => cells.polygon(&[a, b, d, c])?,
        _ => {
            let got = format!("{} with {} points", cell_type(kind), corners.len());
            return Err(MeshError::NotATriangle { path: path.into(), cell: cells.len(), got });
        }
    }
    Ok(())
}

fn cell_type(number: i64) -> String {
    let name = match number {
        5 => "a triangle",
        6 => "a triangle strip",
        7 => "a polygon",
        8 => "a pixel",
        9 => "a quadrilateral",
        10 => "a tetrahedron",
        12 => "a hexahedron",
        22 => "a quadratic triangle",
        _ => return format!("of VTK type {number}"),
    };
    format!("{name} (VTK type {number})")
}

fn integer_array(scan: &mut Scanner, keyword: &str, n: usize) -> Result<Vec<i64>, MeshError> {
    let expected = format!("{keyword} and an integer type");
    let words = scan.words_of(&expected)?;
    match words.as_slice() {
        [word, kind] if word.eq_ignore_ascii_case(keyword) => match named(kind) {
            Some(kind) if !matches!(kind, Kind::F32 | Kind::F64) => scan.integers(n, kind, keyword),
            _ => Err(scan.error(&expected, format!("type {kind:?}"))),
        },
        _ => Err(scan.error(&expected, format!("{:?}", words.join(" ")))),
    }
}
