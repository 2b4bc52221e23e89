//! Values at the vertices of an openCARP mesh: `.dat`, a number a line, and `.igb`, binary frames.

use super::ImportError;
use crate::mesh::Place;

/// The header of an `.igb` file fills blocks of this size.
const BLOCK: usize = 1024;
/// More blocks than any header has.
const MOST_BLOCKS: usize = 16;

const HELP: &str = "the file is damaged or of another version; write it again with openCARP";

/// The numbers of a `.dat` file.
///
/// # Errors
/// A line that is no number.
pub(super) fn dat(file: &str, text: &str) -> Result<Vec<f64>, ImportError> {
    let filled = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let number = |(k, line): (usize, &str)| {
        let number = line.trim().parse::<f64>();
        number.map_err(|_| ImportError::line(file, k + 1, "one number a line", line))
    };
    filled.map(number).collect()
}

/// The numbers of one frame of an `.igb` file, counted from 0.
///
/// # Errors
/// No header, a type that is no number, fewer bytes than the header says, no such frame.
pub(super) fn igb(file: &str, bytes: &[u8], frame: Option<usize>) -> Result<Vec<f64>, ImportError> {
    let header = Header::read(file, bytes)?;
    let wrong = |what: String, help: &str| ImportError::Unusable {
        file: file.into(),
        what,
        help: help.into(),
    };
    let frame = match (frame, header.n_frames) {
        (None, 1) => 0,
        (None, n) => {
            let what = format!("{n} frames, one for each time; which is the map?");
            return Err(wrong(what, "say --frame N, from 0"));
        }
        (Some(frame), n) if frame < n => frame,
        (Some(frame), n) => {
            let what = format!("no frame {frame}: there are {n}");
            return Err(wrong(what, "frames are counted from 0"));
        }
    };
    let size = header.kind.size();
    let length = header.n.checked_mul(size);
    let begin = length.and_then(|l| l.checked_mul(frame)?.checked_add(header.end));
    let end = begin.zip(length).and_then(|(begin, length)| begin.checked_add(length));
    let data = begin.zip(end).and_then(|(begin, end)| bytes.get(begin..end));
    let data = data.ok_or_else(|| {
        let what = format!(
            "the file ends before frame {frame} of {} numbers does (it has {} bytes)",
            header.n,
            bytes.len()
        );
        wrong(what, "the simulation was stopped or the file cut; take an earlier frame")
    })?;
    let numbers = data.chunks_exact(size).map(|bytes| header.kind.number(bytes, header.is_big));
    Ok(numbers.map(|x| x * header.factor + header.zero).collect())
}

/// What the header of an `.igb` file says.
struct Header {
    /// Numbers of a frame.
    n: usize,
    n_frames: usize,
    kind: Kind,
    is_big: bool,
    /// A number is what is stored, times `factor`, plus `zero`.
    factor: f64,
    zero: f64,
    /// Where the data begin.
    end: usize,
}

#[derive(Clone, Copy)]
enum Kind {
    I8,
    I16,
    I32,
    F32,
    F64,
}

impl Kind {
    fn size(self) -> usize {
        match self {
            Self::I8 => 1,
            Self::I16 => 2,
            Self::I32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    fn number(self, bytes: &[u8], is_big: bool) -> f64 {
        let mut own = [0; 8];
        for (k, byte) in bytes.iter().enumerate() {
            own[if is_big { bytes.len() - 1 - k } else { k }] = *byte;
        }
        let [a, b, c, d, ..] = own;
        match self {
            Self::I8 => f64::from(a as i8),
            Self::I16 => f64::from(i16::from_le_bytes([a, b])),
            Self::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
            Self::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
            Self::F64 => f64::from_le_bytes(own),
        }
    }
}

impl Header {
    fn read(file: &str, bytes: &[u8]) -> Result<Self, ImportError> {
        let wrong = |expected: &str, got: &str| ImportError::Parse {
            file: file.into(),
            place: Place::Byte(0),
            expected: expected.into(),
            got: format!("`{got}`"),
            help: HELP,
        };
        let ends = (1..=MOST_BLOCKS).map(|n| n * BLOCK);
        let end = ends.into_iter().find(|end| bytes.get(end - 1) == Some(&0x0c));
        let end =
            end.ok_or_else(|| wrong("a header of 1024 bytes that ends in a form feed", "none"))?;
        let text = String::from_utf8_lossy(&bytes[..end - 1]).replace('\0', " ");
        let word = |name: &str| {
            text.split_whitespace().find_map(|word| word.strip_prefix(name)?.strip_prefix(':'))
        };
        let whole = |name: &str, default: usize| match word(name) {
            None => Ok(default),
            Some(text) => text.parse::<usize>().map_err(|_| wrong("a whole number", text)),
        };
        let real = |name: &str, default: f64| match word(name) {
            None => Ok(default),
            Some(text) => text.parse::<f64>().map_err(|_| wrong("a number", text)),
        };
        let kind = match word("type").unwrap_or("none") {
            "char" | "byte" => Kind::I8,
            "short" => Kind::I16,
            "int" => Kind::I32,
            "float" => Kind::F32,
            "double" => Kind::F64,
            other => return Err(wrong("type:float, double, int, short or char", other)),
        };
        let is_big = match word("systeme").unwrap_or("little_endian") {
            "little_endian" => false,
            "big_endian" => true,
            other => return Err(wrong("systeme:little_endian or big_endian", other)),
        };
        let [x, y, z] = [whole("x", 1)?, whole("y", 1)?, whole("z", 1)?];
        let n = x.checked_mul(y).and_then(|xy| xy.checked_mul(z)).unwrap_or(usize::MAX);
        let (factor, zero) = (real("facteur", 1.0)?, real("zero", 0.0)?);
        Ok(Self { n, n_frames: whole("t", 1)?, kind, is_big, factor, zero, end })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(words: &str, data: &[u8]) -> Vec<u8> {
        let mut bytes = words.as_bytes().to_vec();
        bytes.resize(BLOCK - 1, b' ');
        bytes.push(0x0c);
        bytes.extend(data);
        bytes
    }

    #[test]
    fn frames_of_either_end_are_read() {
        let little: Vec<u8> =
            [1.5_f32, -1.0, 3.0, 4.0].iter().flat_map(|x| x.to_le_bytes()).collect();
        let big: Vec<u8> = [1_i16, -2].iter().flat_map(|x| x.to_be_bytes()).collect();
        let bytes = file("x:2 y:1 z:1 t:2 type:float systeme:little_endian\r\ninc_t:5 ", &little);
        assert_eq!(igb("a.igb", &bytes, Some(1)).unwrap(), [3.0, 4.0]);
        assert_eq!(igb("a.igb", &bytes, Some(0)).unwrap(), [1.5, -1.0]);
        let error = igb("a.igb", &bytes, None).unwrap_err().to_string();
        assert!(error.contains("2 frames") && error.contains("--frame N"), "{error}");
        let bytes = file("x:2 type:short systeme:big_endian facteur:0.5 zero:10", &big);
        assert_eq!(igb("b.igb", &bytes, None).unwrap(), [10.5, 9.0]);
    }

    #[test]
    fn what_the_header_promises_must_be_there() {
        let cases = [
            (
                file("x:1000000000 y:1000000000 z:1000000000 type:double", &[]),
                "ends before frame 0",
            ),
            (file("x:9 type:vec3f", &[]), "expected type:float"),
            (file("x:nine type:float", &[]), "expected a whole number, got `nine`"),
            (b"x:9 type:float".to_vec(), "ends in a form feed"),
        ];
        for (bytes, expected) in cases {
            let error = igb("a.igb", &bytes, None).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
    }

    #[test]
    fn a_list_of_numbers_is_read_with_its_lines() {
        assert_eq!(dat("a.dat", "1\n\n-1.5\n").unwrap(), [1.0, -1.5]);
        let error = dat("a.dat", "1\nx\n").unwrap_err().to_string();
        assert!(error.starts_with("a.dat, line 2: expected one number a line, got `x`"), "{error}");
    }
}
