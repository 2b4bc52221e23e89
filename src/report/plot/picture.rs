//! A picture for print: a drawing of a stated width with its images, as SVG and as PNG.

use std::fmt::Write as _;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use base64::{Engine as _, engine::general_purpose::STANDARD as BASE64};
use rayon::prelude::*;

use super::super::ReportError;
use super::super::text::escape;
use super::font;
use super::paint::paint;
use super::png::Image;
use crate::store::write_file;

/// Printed width of every picture, mm.
pub const WIDTH_MM: f64 = 180.0;
/// Of the PNG, and of the images in the SVG.
pub const DOTS_PER_INCH: f64 = 300.0;
/// Pixels of the PNG from left to right.
pub(super) const PIXELS: f64 = 2126.0;
/// Pixels in a unit of a drawing of full width: where images begin at whole units, pixels meet pixels.
pub(super) const PER_UNIT: f64 = 3.0;
/// Units from left to right; one is 0.72 points.
pub(super) const WIDTH: f64 = PIXELS / PER_UNIT;
/// Most units from top to bottom: 240 mm, a page.
pub(super) const MOST: f64 = WIDTH * 240.0 / WIDTH_MM;
/// Of all texts, units: 7.9 points.
pub(super) const FONT: f64 = 11.0;

/// A picture and what it shows.
#[derive(Clone, Debug)]
pub struct Picture {
    /// Name of its files, without the ending.
    pub name: String,
    /// What it shows, in words.
    pub shows: String,
    size: [f64; 2],
    body: String,
    images: Vec<Image>,
}

impl Picture {
    /// An empty one of full width.
    pub(super) fn new(name: impl Into<String>, shows: impl Into<String>, height: f64) -> Self {
        Self::of(name, shows, [WIDTH, height], String::new())
    }

    /// One whose drawing has another size in units of its own; it is printed at full width.
    pub(super) fn of(
        name: impl Into<String>,
        shows: impl Into<String>,
        size: [f64; 2],
        body: String,
    ) -> Self {
        Self { name: name.into(), shows: shows.into(), size, body, images: vec![] }
    }

    /// Appends elements.
    pub(super) fn draw(&mut self, elements: &str) {
        self.body += elements;
    }

    /// Appends an image at a place, one pixel a dot of the PNG.
    pub(super) fn place(&mut self, [x, y]: [f64; 2], image: Image) {
        let [width, height] = [image.width, image.height].map(|n| n as f64 / PER_UNIT);
        let number = self.images.len();
        let _ = write!(
            self.body,
            r##"<image x="{x}" y="{y}" width="{width}" height="{height}" href="#{number}"/>"##
        );
        self.images.push(image);
    }

    /// The drawing; images are called `#0`, `#1`, ….
    fn drawing(&self) -> String {
        let ([width, height], family) = (self.size, font::FAMILY);
        format!(
            r#"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="{family}" font-size="{FONT}"><rect width="100%" height="100%" fill="white"/>{}</svg>"#,
            self.body
        )
    }

    /// The SVG file, with its images in it.
    fn svg(&self) -> io::Result<String> {
        let [width, height] = self.size;
        let mm = format!(
            r#"<svg width="{WIDTH_MM}mm" height="{:.2}mm" role="img" aria-label="{}""#,
            WIDTH_MM * height / width,
            escape(&self.shows)
        );
        let mut svg = self.drawing().replacen("<svg", &mm, 1);
        let files: Vec<io::Result<Vec<u8>>> =
            self.images.par_iter().map(|image| image.png(DOTS_PER_INCH)).collect();
        for (number, file) in files.into_iter().enumerate() {
            let data = BASE64.encode(file?);
            let (name, data) =
                (format!("href=\"#{number}\""), format!("data:image/png;base64,{data}"));
            svg = svg.replacen(&name, &format!("href=\"{data}\""), 1);
        }
        Ok(svg + "\n")
    }

    /// The names of its files.
    pub fn files(&self) -> [String; 2] {
        ["svg", "png"].map(|ending| format!("{}.{ending}", self.name))
    }

    /// Writes `NAME.svg` and `NAME.png` into a folder that is there; gives their places.
    ///
    /// # Errors
    /// [`ReportError::Write`]; [`ReportError::Drawing`], which is a mistake of this program.
    pub fn write(&self, folder: &Path) -> Result<[PathBuf; 2], ReportError> {
        let files = self.files().map(|name| folder.join(name));
        let pixels = paint(&self.drawing(), &self.images, PIXELS / self.size[0]);
        let pixels = pixels.map_err(|what| {
            let picture = self.name.clone();
            ReportError::Drawing { picture, what }
        })?;
        let save = |path: &Path, bytes: io::Result<Vec<u8>>| {
            let written = bytes.and_then(|bytes| write_file(path, |file| file.write_all(&bytes)));
            written.map_err(ReportError::write(path))
        };
        let (svg, png) = rayon::join(|| self.svg(), || pixels.png(DOTS_PER_INCH));
        save(&files[0], svg.map(String::into_bytes))?;
        save(&files[1], png)?;
        Ok(files)
    }
}
