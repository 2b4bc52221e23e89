//! The attribute arrays of a legacy VTK file: `POINT_DATA` and `CELL_DATA`.

use super::super::MeshError;
use super::super::names::decoded;
use super::scanner::Scanner;
use super::types::named;
use crate::store::Kind;

/// A named array of `n_components` numbers per point or cell; empty if the numbers were skipped.
#[derive(Debug)]
pub(super) struct Array {
    pub(super) name: String,
    pub(super) n_components: usize,
    pub(super) values: Vec<f64>,
}

/// Reads the attribute whose header line is `words`, for `n` points or cells.
///
/// `None` if the line is no attribute's.
pub(super) fn read(
    scan: &mut Scanner,
    words: &[String],
    n: usize,
) -> Option<Result<Vec<Array>, MeshError>> {
    let keyword = words.first()?.to_ascii_uppercase();
    Some(match keyword.as_str() {
        "SCALARS" => scalars(scan, words, n).map(|array| vec![array]),
        "VECTORS" | "NORMALS" => typed(scan, words, 2, n, 3),
        "TENSORS" => typed(scan, words, 2, n, 9),
        "TENSORS6" => typed(scan, words, 2, n, 6),
        "GLOBAL_IDS" | "PEDIGREE_IDS" | "EDGE_FLAGS" => typed(scan, words, 2, n, 1),
        "TEXTURE_COORDINATES" => match count(scan, words, 2) {
            Ok(n_components) => typed(scan, words, 3, n, n_components),
            Err(error) => Err(error),
        },
        "COLOR_SCALARS" => colours(scan, words, 2, n),
        "LOOKUP_TABLE" => match count(scan, words, 2) {
            Ok(n_colours) => colour_table(scan, n_colours),
            Err(error) => Err(error),
        },
        "FIELD" => field(scan, words),
        _ => return None,
    })
}

/// `SCALARS name type [n_components]`, then `LOOKUP_TABLE name`.
fn scalars(scan: &mut Scanner, words: &[String], n: usize) -> Result<Array, MeshError> {
    let n_components = if words.len() > 3 { count(scan, words, 3)? } else { 1 };
    if scan.next_is("LOOKUP_TABLE") {
        scan.words();
    }
    array(scan, &word(scan, words, 1)?, &word(scan, words, 2)?, n, n_components)
}

/// `KEYWORD name … type` with the type at position `kind`.
fn typed(
    scan: &mut Scanner,
    words: &[String],
    kind: usize,
    n: usize,
    n_components: usize,
) -> Result<Vec<Array>, MeshError> {
    let (name, kind) = (word(scan, words, 1)?, word(scan, words, kind)?);
    Ok(vec![array(scan, &name, &kind, n, n_components)?])
}

/// `COLOR_SCALARS name n_components`: bytes, or numbers from 0 to 1 in text.  They are skipped.
fn colours(
    scan: &mut Scanner,
    words: &[String],
    at: usize,
    n: usize,
) -> Result<Vec<Array>, MeshError> {
    let n_components = count(scan, words, at)?;
    scan.reals(n.saturating_mul(n_components), Kind::U8, "COLOR_SCALARS")?;
    Ok(Vec::new())
}

/// `LOOKUP_TABLE name n`: `n` colours of four bytes, or four numbers in text.  They are skipped.
fn colour_table(scan: &mut Scanner, n: usize) -> Result<Vec<Array>, MeshError> {
    scan.reals(n.saturating_mul(4), Kind::U8, "LOOKUP_TABLE")?;
    Ok(Vec::new())
}

/// `FIELD name n_arrays`, then for each `name n_components n_tuples type`.
pub(super) fn field(scan: &mut Scanner, words: &[String]) -> Result<Vec<Array>, MeshError> {
    const HEADER: &str = "a field array: name, number of components, number of tuples, type";
    let n_arrays = count(scan, words, 2)?;
    let mut arrays = Vec::new();
    while arrays.len() < n_arrays {
        let words = scan.words_of(HEADER)?;
        if words[0].eq_ignore_ascii_case("METADATA") {
            skip_metadata(scan);
            continue;
        }
        let (n_components, n_tuples) = (count(scan, &words, 1)?, count(scan, &words, 2)?);
        arrays.push(array(
            scan,
            &word(scan, &words, 0)?,
            &word(scan, &words, 3)?,
            n_tuples,
            n_components,
        )?);
    }
    Ok(arrays)
}

/// A METADATA block ends at the first blank line.
pub(super) fn skip_metadata(scan: &mut Scanner) {
    while scan.line().is_some_and(|line| !line.trim().is_empty()) {}
}

fn array(
    scan: &mut Scanner,
    name: &str,
    kind: &str,
    n: usize,
    n_components: usize,
) -> Result<Array, MeshError> {
    let name = decoded(name);
    let n_values = n.saturating_mul(n_components);
    let values = match (named(kind), kind.to_ascii_lowercase().as_str()) {
        (Some(kind), _) => scan.reals(n_values, kind, &name)?,
        (None, "bit") if scan.is_binary => {
            scan.take(n_values.div_ceil(8), &name).map(|_| Vec::new())?
        }
        (None, "bit") => scan.reals(n_values, Kind::U8, &name)?,
        (None, "string") => skip_strings(scan, n_values, &name).map(|()| Vec::new())?,
        _ => {
            return Err(
                scan.error("a VTK number type such as float, double or int", format!("{kind:?}"))
            );
        }
    };
    Ok(Array { name, n_components, values })
}

/// Strings: one to a line, or in binary a length (its top two bits say how wide it is) and bytes.
fn skip_strings(scan: &mut Scanner, n: usize, name: &str) -> Result<(), MeshError> {
    for _ in 0..n {
        if !scan.is_binary {
            scan.line().ok_or_else(|| scan.truncated(&format!("{n} lines of text for {name}")))?;
            continue;
        }
        let first = scan.take(1, name)?[0];
        let n_more = match first >> 6 {
            3 => 0,
            2 => 1,
            1 => 3,
            _ => 7,
        };
        let more = scan.take(n_more, name)?;
        let length =
            more.iter().fold(usize::from(first & 0x3f), |length, &b| length << 8 | usize::from(b));
        scan.take(length, name)?;
    }
    Ok(())
}

/// The word at `index` of a header line.
pub(super) fn word(scan: &Scanner, words: &[String], index: usize) -> Result<String, MeshError> {
    words.get(index).cloned().ok_or_else(|| {
        let expected = format!("at least {} words on the line", index + 1);
        scan.error(&expected, format!("{:?}", words.join(" ")))
    })
}

/// The word at `index` of a header line as a count.
pub(super) fn count(scan: &Scanner, words: &[String], index: usize) -> Result<usize, MeshError> {
    let word = word(scan, words, index)?;
    word.parse().map_err(|_| scan.error("a count", format!("{word:?} in {:?}", words.join(" "))))
}
