//! One `NumPy` array, .npy: written, and read without trusting its header.
//!
//! The format, of which numbers in row order are written and numbers in either order are read:
//! <https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>.

use std::io::{self, Write};

use super::kind::Kind;

/// An array of numbers, row after row.
#[derive(Clone, Debug, PartialEq)]
pub struct Npy {
    /// Its lengths.
    pub shape: Vec<usize>,
    /// Its numbers, as reals: integers beyond 2⁵³ are rounded.
    pub values: Vec<f64>,
}

/// A number that is written as it is.
pub trait Element: Copy {
    /// Its type as `NumPy` writes it.
    const DESCR: &'static str;
    /// Appends its bytes, the least significant first.
    fn append(self, bytes: &mut Vec<u8>);
}

macro_rules! elements {
    ($($T:ty: $descr:literal),*) => {$(
        impl Element for $T {
            const DESCR: &'static str = $descr;
            fn append(self, bytes: &mut Vec<u8>) {
                bytes.extend(self.to_le_bytes());
            }
        }
    )*};
}
elements!(f64: "<f8", i64: "<i8", u32: "<u4", u8: "|u1");

/// Bytes that are written at a time.
const CHUNK: usize = 1 << 16;

/// Writes `values`, row after row in this `shape`.
///
/// # Errors
/// What the writer says.
pub(super) fn write<T: Element>(
    writer: &mut impl Write,
    shape: &[u64],
    values: &[T],
) -> io::Result<()> {
    let lengths: Vec<String> = shape.iter().map(|length| format!("{length},")).collect();
    let descr = T::DESCR;
    let header = format!(
        "{{'descr': '{descr}', 'fortran_order': False, 'shape': ({}), }}",
        lengths.join(" ")
    );
    // with its end, and what stands before it, it fills whole lines of 64 bytes
    let length = (header.len() + 11).next_multiple_of(64) - 10;
    writer.write_all(b"\x93NUMPY\x01\x00")?;
    writer.write_all(&(length as u16).to_le_bytes())?;
    writeln!(writer, "{header:0$}", length - 1)?;
    let mut bytes = Vec::with_capacity(CHUNK);
    for some in values.chunks(CHUNK / size_of::<T>()) {
        bytes.clear();
        for value in some {
            value.append(&mut bytes);
        }
        writer.write_all(&bytes)?;
    }
    Ok(())
}

/// Reads an array of numbers; `None` for one of anything else.
///
/// # Errors
/// What is there instead of an array.
pub fn parse(bytes: &[u8]) -> Result<Option<Npy>, String> {
    let rest = bytes.strip_prefix(b"\x93NUMPY").ok_or("no NumPy array")?;
    // Version 1 has a length of two bytes, the later ones of four.
    let (version, rest) = (rest.first().copied(), rest.get(2..).unwrap_or_default());
    let width = if version == Some(1) { 2 } else { 4 };
    let length = rest.get(..width).ok_or("a header cut short")?;
    let length = length.iter().rev().fold(0, |sum, byte| sum << 8 | usize::from(*byte));
    let header =
        rest.get(width..).and_then(|rest| rest.get(..length)).ok_or("a header cut short")?;
    let (header, data) = (String::from_utf8_lossy(header), &rest[width + length..]);
    let Some((kind, is_big_endian)) = kind(value(&header, "descr").ok_or("no descr")?) else {
        return Ok(None);
    };
    let is_fortran = value(&header, "fortran_order").is_some_and(|v| v.starts_with("True"));
    let shape = shape(&header).ok_or("no shape")?;
    let n = shape.iter().try_fold(1, |n: usize, length| n.checked_mul(*length));
    if n.and_then(|n| n.checked_mul(kind.size())) != Some(data.len()) {
        return Err(format!("{} bytes for a shape of {shape:?}", data.len()));
    }
    let numbers = data.chunks_exact(kind.size()).map(|number| kind.read(number, is_big_endian));
    let values: Vec<f64> = numbers.collect();
    let values = match (is_fortran, shape.as_slice()) {
        (true, &[n_rows, n_columns]) => (0..n_rows * n_columns)
            .map(|i| values[i % n_columns * n_rows + i / n_columns])
            .collect(),
        (true, [_, _, _, ..]) => return Ok(None),
        _ => values,
    };
    Ok(Some(Npy { shape, values }))
}

/// What follows `'name':` in a header such as `{'descr': '<f8', 'fortran_order': False, 'shape': (3,)}`.
fn value<'h>(header: &'h str, name: &str) -> Option<&'h str> {
    let (_, rest) = header.split_once(&format!("'{name}'"))?;
    Some(rest.trim_start().strip_prefix(':')?.trim_start())
}

fn shape(header: &str) -> Option<Vec<usize>> {
    let (inside, _) = value(header, "shape")?.strip_prefix('(')?.split_once(')')?;
    let lengths = inside.split(',').map(str::trim).filter(|length| !length.is_empty());
    lengths.map(|length| length.parse().ok()).collect()
}

/// The type of the numbers, and whether they are big-endian.
fn kind(descr: &str) -> Option<(Kind, bool)> {
    let (descr, _) = descr.strip_prefix('\'')?.split_once('\'')?;
    let (order, name) = descr.split_at_checked(1)?;
    let kind = match name {
        "f8" => Kind::F64,
        "f4" => Kind::F32,
        "i8" => Kind::I64,
        "i4" => Kind::I32,
        "i2" => Kind::I16,
        "i1" => Kind::I8,
        "u8" => Kind::U64,
        "u4" => Kind::U32,
        "u2" => Kind::U16,
        "u1" | "b1" => Kind::U8,
        _ => return None,
    };
    Some((kind, order == ">"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn npy(header: &str, data: &[u8]) -> Vec<u8> {
        let length = (header.len() as u16).to_le_bytes();
        [b"\x93NUMPY\x01\x00", &length[..], header.as_bytes(), data].concat()
    }

    #[test]
    fn arrays_in_either_order_are_read_row_after_row() {
        let header = |order: &str| {
            format!("{{'descr': '>i2', 'fortran_order': {order}, 'shape': (2, 3), }}\n")
        };
        let data: Vec<u8> = (1..=6_i16).flat_map(i16::to_be_bytes).collect();
        let c = parse(&npy(&header("False"), &data)).unwrap().unwrap();
        assert_eq!((c.shape, c.values), (vec![2, 3], vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0]));
        let fortran = parse(&npy(&header("True"), &data)).unwrap().unwrap();
        assert_eq!(fortran.values, [1.0, 3.0, 5.0, 2.0, 4.0, 6.0]);
    }

    #[test]
    fn what_is_written_is_read_back() {
        let written = |shape: &[u64], values: &[f64]| {
            let mut bytes = vec![];
            write(&mut bytes, shape, values).unwrap();
            assert_eq!((bytes.len() - 8 * values.len()) % 64, 0);
            parse(&bytes).unwrap().unwrap()
        };
        let values = [1.0, -2.5, 1.0 / 3.0, f64::MAX, 0.0, 1e-300];
        assert_eq!(written(&[3, 2], &values), Npy { shape: vec![3, 2], values: values.to_vec() });
        assert_eq!(written(&[6], &values).shape, [6]);
        assert_eq!(written(&[], &values[..1]).shape, [0; 0]);
        let mut bytes = vec![];
        write(&mut bytes, &[2], &[-1_i64, 7]).unwrap();
        assert_eq!(parse(&bytes).unwrap().unwrap().values, [-1.0, 7.0]);
        bytes.pop();
        assert_eq!(parse(&bytes), Err("15 bytes for a shape of [2]".into()));
    }

    #[test]
    fn what_is_no_array_of_numbers_is_told() {
        let text = "{'descr': '<U5', 'fortran_order': False, 'shape': (1,)}";
        assert_eq!(parse(&npy(text, &[])), Ok(None));
        let huge = "{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999, 99999999999)}";
        assert!(parse(&npy(huge, &[0; 8])).unwrap_err().starts_with("8 bytes for a shape"));
        assert!(parse(b"PK").is_err() && parse(&npy("{}", &[])).is_err());
        assert!(parse(b"\x93NUMPY\x02\x00\xff\xff\xff\xff{").is_err());
    }
}
