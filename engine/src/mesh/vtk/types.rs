//! The number types of the format, by their names.

use crate::store::Kind;

/// The type with this name; upper and lower case do not matter.
pub(super) fn named(name: &str) -> Option<Kind> {
    Some(match name.to_ascii_lowercase().as_str() {
        "char" | "signed_char" | "vtktypeint8" => Kind::I8,
        "unsigned_char" | "vtktypeuint8" => Kind::U8,
        "short" | "vtktypeint16" => Kind::I16,
        "unsigned_short" | "vtktypeuint16" => Kind::U16,
        // VTK writes its vtkIdType as 32 bits in this format.
        "int" | "vtkidtype" | "vtktypeint32" => Kind::I32,
        "unsigned_int" | "vtktypeuint32" => Kind::U32,
        "long" | "vtktypeint64" => Kind::I64,
        "unsigned_long" | "vtktypeuint64" => Kind::U64,
        "float" => Kind::F32,
        "double" => Kind::F64,
        _ => return None,
    })
}
