//! A surface from six sides, once for each array on it, with colour bars, sites and openings.

use std::fmt::Write as _;

use super::super::axes::{Scale, group};
use super::super::text::escape;
use super::isolines;
use super::opening::{Opening, draw, openings};
use super::palette::{Colour, Palette, VOID, hex};
use super::picture::{FONT, MOST, Picture, WIDTH};
use super::raster::{At, Seen, Shape, bar, faded};
use super::view::{Frame, views};
use crate::mesh::TriMesh;

const COLUMNS: usize = 3;
/// A view's cell: width, and most height.
const CELL: [f64; 2] = [206.0, 186.0];
/// Room in a cell for labels at its sides, and for the view's name at its top.
const MARGIN: [f64; 2] = [26.0, 14.0];
const LEFT: f64 = 6.0;
/// Above the views of a block: its title.
const TITLE: f64 = 22.0;
/// Below all blocks: what the marks are.
const LEGEND: f64 = 24.0;
/// The colour bar.
const BAR: [f64; 3] = [640.0, 14.0, 170.0];
/// Of a site, and of more than so many sites together as much area as these would have.
const RADIUS: f64 = 2.6;
const FULL_SIZE: f64 = 60.0;
/// Of a site that is coloured by a number of its own.
const LARGE: f64 = 4.5;
/// Lengths of the bar that tells the scale, mm.
const RULERS: [f64; 8] = [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0];

/// A surface as a finished folder has it.
#[derive(Debug)]
pub(super) struct Ground {
    pub(super) mesh: TriMesh,
    /// Whether it is the embedded atrium, whose axes and openings have names.
    pub(super) is_atrium: bool,
    /// Vertices with a measurement.
    pub(super) sites: Vec<u32>,
}

/// One array over the surface.
#[derive(Debug)]
pub(super) struct Block<'a> {
    pub(super) title: String,
    /// Of the bar's numbers; empty for shares.
    pub(super) unit: String,
    /// One value per vertex; NaN where there is none. `None` for a grey surface.
    pub(super) values: Option<&'a [f64]>,
    pub(super) palette: Palette,
    /// Values of the bar's ends.
    pub(super) range: [f64; 2],
    /// Standard deviations, and the one from which on a vertex is grey.
    pub(super) fades: Option<(&'a [f64], f64)>,
    /// Lines at every multiple of this.
    pub(super) lines: Option<f64>,
    /// Places with a value each, mm, drawn in its colour instead of the sites.
    pub(super) dots: &'a [([f64; 3], f64)],
}

/// The range of all finite values of these arrays; symmetric for differences.
pub(super) fn range(palette: Palette, arrays: &[&[f64]]) -> [f64; 2] {
    let finite = || arrays.iter().flat_map(|array| array.iter()).filter(|x| x.is_finite());
    let [low, high] =
        finite().fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], x| [a.min(*x), b.max(*x)]);
    if palette == Palette::Difference {
        let most = low.abs().max(high.abs());
        let most = if most.is_finite() && most > 0.0 { most } else { 1.0 };
        return [-most, most];
    }
    match low <= high {
        true if low < high => [low, high],
        // one value is in the middle of its bar
        true => [low - 0.5, low + 0.5],
        false => [0.0, 1.0],
    }
}

impl<'a> Block<'a> {
    /// An array over its whole range, with the sites.
    pub(super) fn new(title: String, unit: &str, values: &'a [f64], palette: Palette) -> Self {
        let range = range(palette, &[values]);
        Self {
            title,
            unit: unit.into(),
            values: Some(values),
            palette,
            range,
            fades: None,
            lines: None,
            dots: &[],
        }
    }

    fn share(&self, value: f64) -> f64 {
        let [low, high] = self.range;
        (value - low) / (high - low)
    }

    /// Colour of a place, of whose arrays `at` tells the values.
    fn colour(&self, at: &At<'_>) -> Colour {
        let Some(values) = self.values else { return [222, 226, 230] };
        let colour = self.palette.colour(self.share(at(values)));
        self.fades.map_or(colour, |(sd, most)| faded(colour, at(sd) / most))
    }
}

/// The picture: a block of views below the other for each array.
pub(super) fn picture(
    name: impl Into<String>,
    shows: impl Into<String>,
    ground: &Ground,
    blocks: &[Block<'_>],
) -> Picture {
    let views = views(&ground.mesh, ground.is_atrium);
    let rows = views.len().div_ceil(COLUMNS) * blocks.len();
    let room = (MOST - LEGEND - TITLE * blocks.len() as f64) / rows as f64;
    // one view alone may be larger
    let is_alone = views.len() == 1;
    let cell = if is_alone {
        [CELL[0] * COLUMNS as f64, room.min(2.0 * CELL[1]).floor()]
    } else {
        [CELL[0], room.min(CELL[1]).floor()]
    };
    let per_block = TITLE + cell[1] * (rows / blocks.len().max(1)) as f64;
    let height = per_block * blocks.len() as f64 + LEGEND;
    let mut picture = Picture::new(name, shows, height);
    let shape = Shape::new(&ground.mesh);
    let openings = openings(&ground.mesh, ground.is_atrium);
    let frames = Frame::all(&views, &ground.mesh, cell, MARGIN);
    let scale = frames.first().map_or(1.0, |frame| frame.scale);
    for (number, frame) in frames.into_iter().enumerate() {
        let seen = Seen::new(&shape, frame);
        let (column, row) = (number % COLUMNS, number / COLUMNS);
        for (k, block) in blocks.iter().enumerate() {
            let x = LEFT + column as f64 * cell[0];
            let y = k as f64 * per_block + TITLE + row as f64 * cell[1];
            picture.place([x, y], seen.image(&|at| block.colour(at)));
            picture.draw(&(group(x, y) + &marks(&seen, ground, &openings, block) + "</g>"));
        }
    }
    for (k, block) in blocks.iter().enumerate() {
        let top = k as f64 * per_block;
        let title = escape(&block.title);
        picture
            .draw(&format!(r#"<text x="{LEFT}" y="{}" font-size="12">{title}</text>"#, top + 13.0));
        let middle = top + TITLE + 0.5 * (per_block - TITLE);
        colour_bar(&mut picture, block, middle);
    }
    let bottom = height - 8.0;
    picture.draw(&legend(ground, &openings, blocks, scale, bottom));
    picture
}

/// Name of the view, openings and sites, in the cell.
fn marks(seen: &Seen<'_>, ground: &Ground, openings: &[Opening], block: &Block<'_>) -> String {
    let mut svg = format!(r##"<text x="2" y="11" fill="#555">{}</text>"##, seen.frame().name());
    if let Some((values, step)) = block.values.zip(block.lines) {
        svg += &isolines::draw(values, step, seen);
    }
    svg += &draw(openings, seen);
    if block.dots.is_empty() {
        let radius = RADIUS * (FULL_SIZE / ground.sites.len().max(1) as f64).sqrt().min(1.0);
        for vertex in ground.sites.iter().filter(|vertex| seen.shows(**vertex)) {
            let at = seen.frame().project(ground.mesh.vertices()[*vertex as usize]);
            svg += &dot(at, radius, "#fff");
        }
    }
    for (at, value) in block.dots.iter().filter(|dot| dot.1.is_finite()) {
        let place = seen.frame().project(*at);
        if seen.is_visible(place) {
            svg += &dot(place, LARGE, &hex(block.palette.colour(block.share(*value))));
        }
    }
    svg
}

fn dot([x, y, _]: [f64; 3], radius: f64, fill: &str) -> String {
    let width = 0.36 * radius;
    format!(
        r##"<circle cx="{x:.1}" cy="{y:.1}" r="{radius:.1}" fill="{fill}" stroke="#000" stroke-width="{width:.2}"/>"##
    )
}

/// Right of the views, its middle at this height: colours with round ticks.
fn colour_bar(picture: &mut Picture, block: &Block<'_>, middle: f64) {
    let [x, width, height] = BAR;
    // a wider bar begins farther left, so that its numbers have the same room
    let (x, width) = if block.fades.is_some() { (x - width, 2.0 * width) } else { (x, width) };
    let top = (middle - 0.5 * height).round();
    let colour = |share: f64, across: f64| {
        let colour = block.palette.colour(share);
        block.fades.map_or(colour, |_| faded(colour, across))
    };
    picture.place([x, top], bar([width, height], &colour));
    let mut svg = group(x, top);
    let _ = write!(
        svg,
        r##"<rect width="{width}" height="{height}" fill="none" stroke="#444" stroke-width=".7"/><text x="0" y="-7">{}</text>"##,
        escape(&block.unit)
    );
    for (share, label) in Scale::within(block.range[0], block.range[1], 7.0) {
        let y = height * (1.0 - share);
        let _ = write!(
            svg,
            r##"<path d="M{width} {y:.1}h3" stroke="#444" stroke-width=".7"/><text x="{}" y="{:.1}">{label}</text>"##,
            width + 6.0,
            y + 4.0
        );
    }
    if let Some((_, most)) = block.fades {
        let (y, most) = (height + 13.0, super::super::text::tick(most));
        let _ = write!(
            svg,
            r#"<text x="0" y="{y}" text-anchor="middle">0</text><text x="12" y="{y}">≥ {most}</text><text x="{}" y="{}" text-anchor="middle">sd</text>"#,
            0.5 * width,
            y + 13.0
        );
    }
    picture.draw(&(svg + "</g>"));
}

/// What the marks are, and how long a millimetre is.
fn legend(
    ground: &Ground,
    openings: &[Opening],
    blocks: &[Block<'_>],
    scale: f64,
    y: f64,
) -> String {
    let ruler = RULERS.into_iter().rfind(|mm| mm * scale < 0.4 * CELL[0]).unwrap_or(RULERS[0]);
    let mut x = LEFT + 2.0 + ruler * scale + 6.0;
    let mut svg = format!(
        r##"<path d="M{} {}h{:.1}" stroke="#000" stroke-width="2"/>"##,
        LEFT + 2.0,
        y - 4.0,
        ruler * scale
    );
    let mut item = |mark: &str, shift: f64, text: &str| {
        let _ = write!(
            svg,
            r#"{}{mark}</g><text x="{}" y="{y}">{text}</text>"#,
            group(x, y - 4.0),
            x + shift
        );
        x += shift + super::font::width(text, FONT) + 18.0;
    };
    item("", 0.0, &format!("{ruler} mm"));
    if blocks.iter().all(|block| block.dots.is_empty()) && !ground.sites.is_empty() {
        let n = ground.sites.len();
        let text = format!("{n} measurement site{}", if n == 1 { "" } else { "s" });
        item(&dot([4.0, 0.0, 0.0], RADIUS, "#fff"), 12.0, &text);
    }
    if !openings.is_empty() {
        let line = r##"<path d="M0 0h14" stroke="#111" stroke-width="1.2"/>"##;
        item(line, 19.0, "opening");
    }
    if let Some((block, step)) = blocks.iter().find_map(|block| Some((block, block.lines?))) {
        let line = r##"<path d="M0 0h14" stroke="#000" stroke-width=".5"/>"##;
        item(line, 19.0, &format!("every {step} {}", block.unit));
    }
    let is_void =
        |block: &Block<'_>| block.values.is_some_and(|v| v.iter().any(|x| !x.is_finite()));
    if blocks.iter().any(is_void) {
        let square = format!(r#"<rect y="-5" width="10" height="10" fill="{}"/>"#, hex(VOID));
        item(&square, 15.0, "no value");
    }
    svg
}

/// For the picture's description: `from six sides`, or of a sheet one.
pub(super) fn sides(ground: &Ground) -> &'static str {
    let n = views(&ground.mesh, ground.is_atrium).len();
    if n == 1 { "from above" } else { "from six sides" }
}

/// Right of the views there is room for the bar and its ticks.
const _: () =
    assert!(LEFT + COLUMNS as f64 * CELL[0] < BAR[0] - BAR[1] && BAR[0] + BAR[1] < WIDTH - 50.0);
