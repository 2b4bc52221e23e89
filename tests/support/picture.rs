//! Pictures that `eplat plot` wrote, as a reader sees them.
#![allow(dead_code, clippy::unwrap_used, reason = "tests; each uses a part of it")]

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

/// Pixels from left to right: 180 mm at 300 dpi.
pub(crate) const WIDTH: usize = 2126;
/// Pixels of a page's height, 240 mm.
const PAGE: usize = 2835;
/// Pixels at the rim of a picture where nothing is.
const RIM: usize = 3;

/// Pixels, row after row from the top.
pub(crate) struct Picture {
    pub(crate) width: usize,
    pub(crate) pixels: Vec<[u8; 3]>,
}

impl Picture {
    pub(crate) fn read(path: &Path) -> Self {
        let file = File::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        let mut reader = png::Decoder::new(BufReader::new(file)).read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut bytes).unwrap();
        assert_eq!(info.color_type, png::ColorType::Rgb, "{}", path.display());
        Self { width: info.width as usize, pixels: bytes.as_chunks().0.to_vec() }
    }

    pub(crate) fn height(&self) -> usize {
        self.pixels.len() / self.width
    }

    pub(crate) fn at(&self, x: usize, y: usize) -> [u8; 3] {
        self.pixels[y * self.width + x]
    }

    /// What is wrong with it: its size, that it is blank, that something is cut off at its rim.
    pub(crate) fn faults(&self) -> Vec<String> {
        let (width, height) = (self.width, self.height());
        let mut faults = vec![];
        if width != WIDTH || !(200..=PAGE).contains(&height) {
            faults.push(format!("{width} × {height} pixels"));
        }
        let is_ink = |pixel: &&[u8; 3]| pixel.iter().any(|channel| *channel < 200);
        let n_ink = self.pixels.iter().filter(is_ink).count();
        if n_ink * 400 < self.pixels.len() {
            faults.push(format!("all but blank: {n_ink} pixels"));
        }
        let is_rim =
            |x: usize, y: usize| x < RIM || y < RIM || x + RIM >= width || y + RIM >= height;
        let places = (0..self.pixels.len()).map(|i| (i % width, i / width));
        let cut = places.filter(|(x, y)| is_rim(*x, *y)).find(|(x, y)| is_ink(&&self.at(*x, *y)));
        if let Some((x, y)) = cut {
            faults.push(format!("ink at the rim: ({x}, {y})"));
        }
        faults
    }
}

/// Both files of every picture that the command's standard output names, without a fault.
pub(crate) fn checked(folder: &Path, stdout: &str) -> Vec<String> {
    let files: Vec<PathBuf> =
        stdout.lines().map(|line| folder.join(line.split("  ").next().unwrap())).collect();
    let mut names = vec![];
    for pair in files.chunks(2) {
        let [svg, png] = pair else { panic!("an odd number of files: {stdout}") };
        assert_eq!(svg.with_extension("png"), *png);
        let picture = Picture::read(png);
        assert_eq!(picture.faults(), [""; 0], "{}", png.display());
        let text = std::fs::read_to_string(svg).unwrap();
        let document = roxmltree::Document::parse(&text).unwrap();
        let root = document.root_element();
        assert_eq!(root.attribute("width"), Some("180mm"), "{}", svg.display());
        let height =
            root.attribute("height").unwrap().trim_end_matches("mm").parse::<f64>().unwrap();
        let dots = height / 25.4 * 300.0;
        assert!((dots - picture.height() as f64).abs() < 1.5, "{}: {dots}", svg.display());
        // nothing from elsewhere
        let is_inside = |href: &str| href.starts_with("data:image/png;base64,");
        let mut links = document.descendants().filter_map(|node| node.attribute("href"));
        assert!(links.all(is_inside), "{}", svg.display());
        names.push(png.file_stem().unwrap().to_str().unwrap().to_owned());
    }
    names
}
