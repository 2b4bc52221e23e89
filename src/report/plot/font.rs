//! The embedded font: outlines and widths of texts. A picture looks the same on a machine without fonts.

use std::sync::LazyLock;

use tiny_skia::{Path, PathBuilder};
use ttf_parser::{Face, FaceParsingError, GlyphId, OutlineBuilder};

/// The font; its licence is in `assets/font/LICENSE`.
static FACE: LazyLock<Result<Face<'static>, FaceParsingError>> =
    LazyLock::new(|| Face::parse(include_bytes!("../../../assets/font/DejaVuSans-subset.ttf"), 0));
/// Fonts of an SVG file, the first that a machine has.
pub(super) const FAMILY: &str = "DejaVu Sans, Verdana, Arial, Helvetica, sans-serif";
/// Stands for a sign that the font lacks.
const UNKNOWN: char = '\u{fffd}';

/// Advance of a text, in units of its size.
pub(super) fn width(text: &str, size: f64) -> f64 {
    let Ok(face) = FACE.as_ref() else { return 0.0 }; // then nothing is drawn: see `outline`
    let advance = |sign: char| f64::from(face.glyph_hor_advance(glyph(face, sign)).unwrap_or(0));
    text.chars().map(advance).sum::<f64>() * size / f64::from(face.units_per_em())
}

/// The outline of a text of this size that begins at `x` on the baseline 0, y downwards; `None` for one without ink.
///
/// # Errors
/// The embedded font is damaged.
pub(super) fn outline(text: &str, size: f64, x: f64) -> Result<Option<Path>, FaceParsingError> {
    let face = FACE.as_ref().map_err(|error| *error)?;
    let scale = size as f32 / f32::from(face.units_per_em());
    let mut pen = Pen { path: PathBuilder::new(), x: x as f32, scale };
    for sign in text.chars() {
        let glyph = glyph(face, sign);
        face.outline_glyph(glyph, &mut pen);
        pen.x += scale * f32::from(face.glyph_hor_advance(glyph).unwrap_or(0));
    }
    Ok(pen.path.finish())
}

fn glyph(face: &Face<'_>, sign: char) -> GlyphId {
    face.glyph_index(sign).or_else(|| face.glyph_index(UNKNOWN)).unwrap_or_default()
}

struct Pen {
    path: PathBuilder,
    x: f32,
    scale: f32,
}

impl Pen {
    fn at(&self, x: f32, y: f32) -> (f32, f32) {
        (self.x + self.scale * x, -self.scale * y)
    }
}

impl OutlineBuilder for Pen {
    fn move_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.at(x, y);
        self.path.move_to(x, y);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.at(x, y);
        self.path.line_to(x, y);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        let ((x1, y1), (x, y)) = (self.at(x1, y1), self.at(x, y));
        self.path.quad_to(x1, y1, x, y);
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        let ((x1, y1), (x2, y2), (x, y)) = (self.at(x1, y1), self.at(x2, y2), self.at(x, y));
        self.path.cubic_to(x1, y1, x2, y2, x, y);
    }

    fn close(&mut self) {
        self.path.close();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_font_has_every_sign_that_pictures_use() {
        let face = FACE.as_ref().unwrap();
        for sign in "aZäß09−±×²³⁻₂°%→↑ρτσμÅ ".chars() {
            assert!(face.glyph_index(sign).is_some(), "{sign}");
        }
        // 0.636 em a digit: DejaVu Sans, by fontTools
        assert!((width("00", 10.0) - 12.72).abs() < 0.01, "{}", width("00", 10.0));
        assert!((width("漢", 10.0) - width("\u{fffd}", 10.0)).abs() < 1e-9);
    }
}
