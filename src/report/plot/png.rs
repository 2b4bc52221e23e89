//! Pixels as a PNG file.

use std::io::{self, Write as _};

use flate2::write::ZlibEncoder;
use flate2::{Compression, Crc};

/// Opaque pixels, row after row from the top, (red, green, blue).
#[derive(Clone, Debug)]
pub(super) struct Image {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) pixels: Vec<[u8; 3]>,
}

const SIGNATURE: [u8; 8] = [0x89, b'P', b'N', b'G', b'\r', b'\n', 0x1a, b'\n'];
/// Eight bits of red, green and blue; deflate; filters of type 0 to 4; not interlaced.
const KIND: [u8; 5] = [8, 2, 0, 0, 0];
/// Filter: each byte less the one above it.
const UP: u8 = 2;

impl Image {
    /// The file, printed at `dots_per_inch`.
    ///
    /// # Source
    /// W3C, Portable Network Graphics (third edition).
    pub(super) fn png(&self, dots_per_inch: f64) -> io::Result<Vec<u8>> {
        let mut file = SIGNATURE.to_vec();
        let size = [self.width, self.height].map(|n| (n as u32).to_be_bytes()).concat();
        chunk(&mut file, *b"IHDR", &[&size[..], &KIND].concat());
        let per_metre = ((dots_per_inch / 0.0254).round() as u32).to_be_bytes();
        chunk(&mut file, *b"pHYs", &[&per_metre[..], &per_metre, &[1]].concat());
        chunk(&mut file, *b"IDAT", &self.packed()?);
        chunk(&mut file, *b"IEND", &[]);
        Ok(file)
    }

    fn packed(&self) -> io::Result<Vec<u8>> {
        let mut packer = ZlibEncoder::new(vec![], Compression::new(6));
        let mut above = vec![0; 3 * self.width];
        for row in self.pixels.chunks(self.width.max(1)) {
            let row = row.as_flattened();
            let differences = row.iter().zip(&above).map(|(own, above)| own.wrapping_sub(*above));
            packer.write_all(&[UP])?;
            packer.write_all(&differences.collect::<Vec<u8>>())?;
            above.copy_from_slice(row);
        }
        packer.finish()
    }
}

/// Appends length, name, content and check sum.
fn chunk(file: &mut Vec<u8>, name: [u8; 4], content: &[u8]) {
    let mut check = Crc::new();
    check.update(&name);
    check.update(content);
    file.extend((content.len() as u32).to_be_bytes());
    file.extend(name);
    file.extend(content);
    file.extend(check.sum().to_be_bytes());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn another_reader_sees_the_same_pixels() {
        let pixels: Vec<[u8; 3]> =
            (0..35_u8).map(|i| [7 * i, 255 - i, i.wrapping_mul(i)]).collect();
        let image = Image { width: 7, height: 5, pixels };
        let file = image.png(300.0).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(file)).read_info().unwrap();
        let mut seen = vec![0; 3 * 35];
        let info = reader.next_frame(&mut seen).unwrap();
        assert_eq!((info.width, info.height, info.color_type), (7, 5, png::ColorType::Rgb));
        assert_eq!(seen, image.pixels.as_flattened());
        let density = reader.info().pixel_dims.unwrap();
        assert_eq!((density.xppu, density.unit), (11811, png::Unit::Meter));
    }
}
