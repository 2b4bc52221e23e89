//! The bytes of an array in an XML file: raw or base64, plain or in blocks that zlib compressed.
//!
//! Every length is checked against the bytes that are there before anything is allocated.

use flate2::read::ZlibDecoder;
use std::io::Read as _;

/// Bytes of which each can be taken once.
#[derive(Clone, Debug)]
pub(super) enum Bytes<'a> {
    Raw(&'a [u8]),
    /// Text, and what was decoded of it but not taken. Each part of the text may end with its own `=`.
    Base64 {
        text: &'a [u8],
        decoded: Vec<u8>,
    },
}

impl<'a> Bytes<'a> {
    pub(super) fn base64(text: &'a [u8]) -> Self {
        Self::Base64 { text, decoded: vec![] }
    }

    /// At most this many bytes are left.
    fn at_most(&self) -> usize {
        match self {
            Self::Raw(bytes) => bytes.len(),
            Self::Base64 { text, decoded } => decoded.len() + text.len() / 4 * 3 + 3,
        }
    }

    /// The next `n` bytes.
    ///
    /// # Errors
    /// What is there instead.
    fn take(&mut self, n: usize) -> Result<Vec<u8>, String> {
        if n > self.at_most() {
            return Err(format!("at most {} bytes", self.at_most()));
        }
        match self {
            Self::Raw(bytes) => {
                let (taken, rest) = bytes.split_at(n);
                *bytes = rest;
                Ok(taken.to_vec())
            }
            Self::Base64 { text, decoded } => {
                let mut taken = std::mem::take(decoded);
                taken.reserve(n.saturating_sub(taken.len()) + 3);
                while taken.len() < n {
                    quantum(text, &mut taken)?;
                }
                *decoded = taken.split_off(n);
                Ok(taken)
            }
        }
    }

    /// An unsigned number of `size` bytes.
    fn number(&mut self, size: usize, is_big_endian: bool) -> Result<usize, String> {
        let mut bytes = self.take(size)?;
        if !is_big_endian {
            bytes.reverse();
        }
        let number = bytes.iter().fold(0_u64, |sum, byte| sum << 8 | u64::from(*byte));
        usize::try_from(number).map_err(|_| format!("a length of {number} bytes"))
    }
}

/// Decodes the next four characters of base64, less than three bytes if they end with `=`.
fn quantum(text: &mut &[u8], decoded: &mut Vec<u8>) -> Result<(), String> {
    let (mut bits, mut n, mut n_padding) = (0_u32, 0, 0);
    while n < 4 {
        let Some((&byte, rest)) = text.split_first() else {
            return Err("the end of the base64 text".into());
        };
        *text = rest;
        let digit = match byte {
            b'A'..=b'Z' => byte - b'A',
            b'a'..=b'z' => byte - b'a' + 26,
            b'0'..=b'9' => byte - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            b'=' => {
                n_padding += 1;
                0
            }
            _ if byte.is_ascii_whitespace() => continue,
            _ => return Err(format!("{:?} in base64 text", char::from(byte))),
        };
        bits = bits << 6 | u32::from(digit);
        n += 1;
    }
    if n_padding > 2 {
        return Err("=== in base64 text".into());
    }
    decoded.extend(&bits.to_be_bytes()[1..4 - n_padding]);
    Ok(())
}

/// How the arrays of a file are packed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Packing {
    /// Bytes of a length.
    pub(super) header: usize,
    pub(super) is_big_endian: bool,
    pub(super) is_zlib: bool,
}

impl Packing {
    /// The bytes of one array; `budget` is how many more there may be, and falls.
    ///
    /// # Errors
    /// What is there instead of them.
    pub(super) fn unpack(&self, mut bytes: Bytes, budget: &mut usize) -> Result<Vec<u8>, String> {
        let number = |bytes: &mut Bytes| bytes.number(self.header, self.is_big_endian);
        if !self.is_zlib {
            let length = number(&mut bytes)?;
            let taken = bytes.take(length)?;
            *budget =
                budget.checked_sub(length).ok_or("more than the file has, in several arrays")?;
            return Ok(taken);
        }
        let (n_blocks, size, last) =
            (number(&mut bytes)?, number(&mut bytes)?, number(&mut bytes)?);
        if n_blocks > bytes.at_most() / self.header {
            return Err(format!("{n_blocks} blocks, more than there is room for"));
        }
        let lengths: Vec<usize> =
            (0..n_blocks).map(|_| number(&mut bytes)).collect::<Result<_, _>>()?;
        let mut inflated = vec![];
        for (block, length) in lengths.into_iter().enumerate() {
            let is_last = block + 1 == n_blocks;
            let size = if is_last && last > 0 { last } else { size };
            *budget = budget.checked_sub(size).ok_or("more than an honest file inflates to")?;
            let packed = bytes.take(length)?;
            let before = inflated.len();
            // One byte more would show that the block is longer than it says.
            ZlibDecoder::new(&packed[..])
                .take(size as u64 + 1)
                .read_to_end(&mut inflated)
                .map_err(|error| format!("a zlib block that cannot be read: {error}"))?;
            if inflated.len() - before != size {
                let got = inflated.len() - before;
                return Err(format!("a zlib block of {got} bytes that should have {size}"));
            }
        }
        Ok(inflated)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use base64::Engine as _;
    use base64::engine::general_purpose::STANDARD;
    use flate2::{Compression, write::ZlibEncoder};
    use std::io::Write as _;

    const PLAIN: Packing = Packing { header: 4, is_big_endian: false, is_zlib: false };

    #[test]
    fn base64_may_be_in_one_part_or_with_the_header_apart() {
        let (header, data) = (5_u32.to_le_bytes(), *b"eplat");
        let joint = STANDARD.encode([&header[..], &data].concat());
        let apart = format!("{}\n {}", STANDARD.encode(header), STANDARD.encode(data));
        for text in [joint, apart] {
            let unpacked = PLAIN.unpack(Bytes::base64(text.as_bytes()), &mut 1000);
            assert_eq!(unpacked.unwrap(), data);
        }
        for wrong in ["", "BQA", "BQAAAA==", "BQAAAA==ZX", "B*AA", "=AAA", "//////////8="] {
            assert!(PLAIN.unpack(Bytes::base64(wrong.as_bytes()), &mut 1000).is_err(), "{wrong}");
        }
    }

    fn zlib(blocks: &[&[u8]], size: u64, last: u64) -> Vec<u8> {
        let packed: Vec<Vec<u8>> = blocks
            .iter()
            .map(|block| {
                let mut encoder = ZlibEncoder::new(vec![], Compression::default());
                encoder.write_all(block).unwrap();
                encoder.finish().unwrap()
            })
            .collect();
        let mut header = vec![blocks.len() as u64, size, last];
        header.extend(packed.iter().map(|p| p.len() as u64));
        [header.iter().flat_map(|n| n.to_be_bytes()).collect(), packed.concat()].concat()
    }

    #[test]
    fn zlib_blocks_are_joined_and_kept_in_bounds() {
        let packing = Packing { header: 8, is_big_endian: true, is_zlib: true };
        let unpack = |bytes: &[u8], mut budget| packing.unpack(Bytes::Raw(bytes), &mut budget);
        let file = zlib(&[b"abcd", b"ef"], 4, 2);
        assert_eq!(unpack(&file, 6).unwrap(), b"abcdef");
        assert_eq!(unpack(&zlib(&[b"abcd", b"efgh"], 4, 0), 8).unwrap(), b"abcdefgh");
        assert!(unpack(&file, 5).is_err(), "over budget");
        assert!(unpack(&zlib(&[b"abcde"], 4, 0), 99).is_err(), "a block longer than it says");
        assert!(unpack(&zlib(&[b"abc"], 4, 0), 99).is_err(), "a block shorter than it says");
        let mut many = file;
        many[..8].copy_from_slice(&u64::MAX.to_be_bytes());
        assert!(unpack(&many, 99).is_err());
    }
}
