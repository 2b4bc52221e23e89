//! Writes a .ply file, as text or little-endian bytes in double precision.

use crate::mesh::bytes::Encoding;
use crate::mesh::geometry::{Geometry, Rows};
use crate::mesh::names::encoded;
use std::fmt::Write as _;
use std::io::Write as _;

/// The file of a surface with its arrays.
pub(in crate::mesh) fn written(geometry: &Geometry, encoding: Encoding) -> Vec<u8> {
    let mut bytes = header(geometry, encoding).into_bytes();
    for (i, vertex) in geometry.vertices.iter().enumerate() {
        let numbers = vertex.iter().chain(row(&geometry.point_data, i));
        match encoding {
            Encoding::Binary => bytes.extend(numbers.flat_map(|x| x.to_le_bytes())),
            Encoding::Ascii => text_row(&mut bytes, "", numbers),
        }
    }
    for (i, [a, b, c]) in geometry.triangles.iter().enumerate() {
        let numbers = row(&geometry.cell_data, i);
        match encoding {
            Encoding::Binary => {
                bytes.push(3);
                bytes.extend([a, b, c].iter().flat_map(|v| v.to_le_bytes()));
                bytes.extend(numbers.flat_map(|x| x.to_le_bytes()));
            }
            Encoding::Ascii => text_row(&mut bytes, &format!("3 {a} {b} {c}"), numbers),
        }
    }
    bytes
}

fn header(geometry: &Geometry, encoding: Encoding) -> String {
    let format = match encoding {
        Encoding::Ascii => "ascii",
        Encoding::Binary => "binary_little_endian",
    };
    let mut text = format!(
        "ply\nformat {format} 1.0\ncomment lengths in mm\nelement vertex {}\n\
         property double x\nproperty double y\nproperty double z\n",
        geometry.vertices.len()
    );
    properties(&mut text, &geometry.point_data);
    let n = geometry.triangles.len();
    let _ = writeln!(text, "element face {n}\nproperty list uchar uint vertex_indices");
    properties(&mut text, &geometry.cell_data);
    text + "end_header\n"
}

fn properties(text: &mut String, arrays: &[Rows]) {
    for Rows { name, width, .. } in arrays {
        // x, y and z are the place.
        let name = match encoded(name).as_str() {
            axis @ ("x" | "y" | "z") => format!("%{:02X}", axis.as_bytes()[0]),
            name => name.to_owned(),
        };
        for k in 0..*width {
            let part = if *width == 1 { String::new() } else { format!("_{k}") };
            let _ = writeln!(text, "property double {name}{part}");
        }
    }
}

/// Row `i` of every array.
fn row<'a>(arrays: &'a [Rows<'a>], i: usize) -> impl Iterator<Item = &'a f64> {
    arrays.iter().flat_map(move |rows| &rows.values[i * rows.width..(i + 1) * rows.width])
}

fn text_row<'a>(bytes: &mut Vec<u8>, first: &str, numbers: impl Iterator<Item = &'a f64>) {
    let words = (!first.is_empty()).then(|| first.to_owned()).into_iter();
    let words: Vec<String> = words.chain(numbers.map(ToString::to_string)).collect();
    let _ = writeln!(bytes, "{}", words.join(" "));
}
