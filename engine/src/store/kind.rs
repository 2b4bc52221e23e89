//! The number types that a binary file may hold, and their bytes.

/// A number type: integers with a sign or without, floats, of so many bits.
#[allow(missing_docs, reason = "their names say all")]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Kind {
    /// Bytes of one number.
    pub fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    /// The big-endian number in `bytes` ([`Self::size`] of them), as a real.
    pub fn real(self, bytes: &[u8]) -> f64 {
        match self {
            Self::F64 => f64::from_bits(self.bits(bytes)),
            Self::F32 => f64::from(f32::from_bits(self.bits(bytes) as u32)),
            Self::U64 => self.bits(bytes) as f64,
            _ => self.integer(bytes) as f64,
        }
    }

    /// The number in `bytes` ([`Self::size`] of them) in either order, as a real.
    pub fn read(self, bytes: &[u8], is_big_endian: bool) -> f64 {
        if is_big_endian {
            return self.real(bytes);
        }
        let mut reversed = [0; 8];
        let reversed = &mut reversed[..self.size().min(bytes.len())];
        reversed.copy_from_slice(&bytes[..reversed.len()]);
        reversed.reverse();
        self.real(reversed)
    }

    /// The big-endian number in `bytes` ([`Self::size`] of them) of an integer type; a number that does not
    /// fit becomes −1, which is no index.
    pub fn integer(self, bytes: &[u8]) -> i64 {
        let bits = self.bits(bytes);
        match self {
            Self::I8 => i64::from(bits as i8),
            Self::I16 => i64::from(bits as i16),
            Self::I32 => i64::from(bits as i32),
            Self::I64 => bits as i64,
            Self::U8 | Self::U16 | Self::U32 | Self::U64 => i64::try_from(bits).unwrap_or(-1),
            Self::F32 | Self::F64 => -1,
        }
    }

    fn bits(self, bytes: &[u8]) -> u64 {
        bytes.iter().take(self.size()).fold(0, |bits, &byte| bits << 8 | u64::from(byte))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[allow(clippy::float_cmp, reason = "bytes must come back exactly")]
    fn big_endian_numbers_come_back() {
        assert_eq!(Kind::F64.real(&(-2.5f64).to_be_bytes()), -2.5);
        assert_eq!(Kind::F64.read(&(-2.5f64).to_le_bytes(), false), -2.5);
        assert_eq!(Kind::U16.read(&[1, 2], false), 513.0);
        assert_eq!(Kind::U16.read(&[1, 2], true), 258.0);
        assert_eq!(Kind::F32.real(&1.25f32.to_be_bytes()), 1.25);
        assert_eq!(Kind::I16.real(&(-3i16).to_be_bytes()), -3.0);
        assert_eq!(Kind::U8.real(&[200]), 200.0);
        assert_eq!(Kind::I8.real(&[0xff]), -1.0);
        assert_eq!(Kind::U64.real(&u64::MAX.to_be_bytes()), u64::MAX as f64);
        assert_eq!(Kind::I64.integer(&(-7i64).to_be_bytes()), -7);
        assert_eq!(Kind::U32.integer(&u32::MAX.to_be_bytes()), i64::from(u32::MAX));
        assert!(Kind::F64.real(&f64::NAN.to_be_bytes()).is_nan());
    }
}
