//! From a drawing, the part of SVG that this program writes, to pixels. What is not of that part is refused.

use roxmltree::{Document, Node};
use tiny_skia::{
    Color, FillRule, LineCap, LineJoin, Paint, Path, PathBuilder, Pixmap, PixmapPaint, Rect,
    Stroke, StrokeDash, Transform,
};

use super::png::Image;
use super::{font, path_data};

/// Paints `svg`, whose images are called `#0`, `#1`, …, at this many pixels per unit; in words what it cannot paint.
pub(super) fn paint(svg: &str, images: &[Image], scale: f64) -> Result<Image, String> {
    let document = Document::parse(svg).map_err(|error| error.to_string())?;
    let root = document.root_element();
    let numbers = numbers(root.attribute("viewBox").unwrap_or_default());
    let Some([left, top, width, height]) = numbers.as_deref() else {
        return Err("a drawing without a viewBox of four numbers".into());
    };
    let pixels = [width, height].map(|size| (f64::from(*size) * scale).round() as u32);
    let mut pixmap = Pixmap::new(pixels[0], pixels[1]).ok_or("a drawing without a size")?;
    pixmap.fill(Color::WHITE);
    let scale = scale as f32;
    let transform = Transform::from_scale(scale, scale).pre_translate(-left, -top);
    let mut painter = Painter { pixmap, images, size: [*width, *height] };
    let style = Style { transform, ..Style::default() }.of(root)?;
    painter.children(root, &style)?;
    let pixels = painter.pixmap.pixels().iter().map(|p| [p.red(), p.green(), p.blue()]);
    Ok(Image {
        width: painter.pixmap.width() as usize,
        height: painter.pixmap.height() as usize,
        pixels: pixels.collect(),
    })
}

/// What elements inherit.
#[derive(Clone)]
struct Style {
    transform: Transform,
    fill: Option<Color>,
    stroke: Option<Color>,
    stroke_width: f32,
    dashes: Vec<f32>,
    is_round: bool,
    font_size: f64,
    /// Share of a text's width that lies before its place.
    anchor: f64,
    opacity: f32,
}

impl Default for Style {
    fn default() -> Self {
        Self {
            transform: Transform::identity(),
            fill: Some(Color::BLACK),
            stroke: None,
            stroke_width: 1.0,
            dashes: vec![],
            is_round: false,
            font_size: 16.0,
            anchor: 0.0,
            opacity: 1.0,
        }
    }
}

/// Attributes that are no matter of style.
const PLACES: [&str; 18] = [
    "x",
    "y",
    "cx",
    "cy",
    "r",
    "width",
    "height",
    "d",
    "href",
    "viewBox",
    "font-family",
    "role",
    "aria-label",
    "paint-order",
    "image-rendering",
    "preserveAspectRatio",
    "id",
    "version",
];

impl Style {
    /// That of an element in a group with this style.
    fn of(&self, node: Node<'_, '_>) -> Result<Self, String> {
        let mut style = self.clone();
        for attribute in node.attributes() {
            let value = attribute.value();
            let bad = || format!("{}=\"{value}\"", attribute.name());
            let number = || value.parse::<f32>().map_err(|_| bad());
            match attribute.name() {
                "fill" => style.fill = colour(value).ok_or_else(bad)?,
                "stroke" => style.stroke = colour(value).ok_or_else(bad)?,
                "stroke-width" => style.stroke_width = number()?,
                "stroke-dasharray" => style.dashes = numbers(value).ok_or_else(bad)?,
                "stroke-linecap" | "stroke-linejoin" => style.is_round = value == "round",
                "font-size" => style.font_size = f64::from(number()?),
                "opacity" => style.opacity *= number()?,
                "text-anchor" => {
                    let shares = [("start", 0.0), ("middle", 0.5), ("end", 1.0)];
                    let known = shares.into_iter().find(|(name, _)| *name == value);
                    style.anchor = known.ok_or_else(bad)?.1;
                }
                "transform" => {
                    let own = transform(value).ok_or_else(bad)?;
                    style.transform = style.transform.pre_concat(own);
                }
                name if PLACES.contains(&name) => {}
                _ => return Err(bad()),
            }
        }
        Ok(style)
    }
}

struct Painter<'a> {
    pixmap: Pixmap,
    images: &'a [Image],
    size: [f32; 2],
}

impl Painter<'_> {
    fn children(&mut self, node: Node<'_, '_>, style: &Style) -> Result<(), String> {
        node.children().filter(Node::is_element).try_for_each(|child| self.element(child, style))
    }

    fn element(&mut self, node: Node<'_, '_>, style: &Style) -> Result<(), String> {
        let style = style.of(node)?;
        let [width, height] = self.size;
        let length = |name: &str, whole: f32| match node.attribute(name) {
            None => Ok(0.0),
            Some("100%") => Ok(whole),
            Some(text) => text.parse::<f32>().map_err(|_| format!("{name}=\"{text}\"")),
        };
        let [x, y] = [length("x", width)?, length("y", height)?];
        let size = [length("width", width)?, length("height", height)?];
        match node.tag_name().name() {
            "g" => self.children(node, &style)?,
            "title" => {}
            "path" => {
                let data = node.attribute("d").unwrap_or_default();
                if let Some(path) = path_data::parse(data)? {
                    self.draw(&path, &style);
                }
            }
            "rect" => {
                // an empty one has nothing to draw
                if let Some(rect) = Rect::from_xywh(x, y, size[0], size[1]) {
                    self.draw(&PathBuilder::from_rect(rect), &style);
                }
            }
            "circle" => {
                let [x, y, r] = ["cx", "cy", "r"].map(|name| length(name, 0.0));
                let circle = PathBuilder::from_circle(x?, y?, r?);
                if let Some(circle) = circle {
                    self.draw(&circle, &style);
                }
            }
            "text" => {
                let text: String = node.text().unwrap_or_default().into();
                let before = style.anchor * font::width(&text, style.font_size);
                let outline = font::outline(&text, style.font_size, f64::from(x) - before);
                let outline = outline.map_err(|error| format!("the embedded font: {error}"))?;
                let transform = style.transform.pre_translate(0.0, y);
                let style = Style { transform, ..style };
                if let Some(outline) = outline {
                    self.text(&outline, &style);
                }
            }
            "image" => self.image(node.attribute("href"), [x, y], size, &style)?,
            other => return Err(format!("<{other}>")),
        }
        Ok(())
    }

    /// A text's line is around it, not over it.
    fn text(&mut self, outline: &Path, style: &Style) {
        self.draw(outline, &Style { fill: None, is_round: true, ..style.clone() });
        self.draw(outline, &Style { stroke: None, ..style.clone() });
    }

    fn draw(&mut self, path: &Path, style: &Style) {
        let paint = |mut colour: Color| {
            colour.apply_opacity(style.opacity);
            let mut paint = Paint { anti_alias: true, ..Paint::default() };
            paint.set_color(colour);
            paint
        };
        if let Some(fill) = style.fill {
            let paint = paint(fill);
            self.pixmap.fill_path(path, &paint, FillRule::Winding, style.transform, None);
        }
        if let Some(colour) = style.stroke {
            let stroke = Stroke {
                width: style.stroke_width,
                line_cap: if style.is_round { LineCap::Round } else { LineCap::Butt },
                line_join: if style.is_round { LineJoin::Round } else { LineJoin::Miter },
                dash: StrokeDash::new(style.dashes.clone(), 0.0),
                ..Stroke::default()
            };
            self.pixmap.stroke_path(path, &paint(colour), &stroke, style.transform, None);
        }
    }

    fn image(
        &mut self,
        href: Option<&str>,
        [x, y]: [f32; 2],
        size: [f32; 2],
        style: &Style,
    ) -> Result<(), String> {
        let number = href.and_then(|href| href.strip_prefix('#')?.parse::<usize>().ok());
        let image = number.and_then(|number| self.images.get(number));
        let image = image.ok_or_else(|| format!("an image {href:?}"))?;
        let mut pixmap = Pixmap::new(image.width as u32, image.height as u32)
            .ok_or("an image without pixels")?;
        for (to, [r, g, b]) in pixmap.data_mut().chunks_exact_mut(4).zip(&image.pixels) {
            to.copy_from_slice(&[*r, *g, *b, 255]);
        }
        let [wide, high] = [size[0] / image.width as f32, size[1] / image.height as f32];
        let transform = style.transform.pre_translate(x, y).pre_scale(wide, high);
        let paint = PixmapPaint::default();
        self.pixmap.draw_pixmap(0, 0, pixmap.as_ref(), &paint, transform, None);
        Ok(())
    }
}

/// `None` for a text that is no colour; `Some(None)` for `none`.
#[allow(clippy::option_option, reason = "no colour is a colour here")]
fn colour(text: &str) -> Option<Option<Color>> {
    let digits = match text {
        "none" => return Some(None),
        "white" => "fff",
        "black" => "000",
        text => text.strip_prefix('#')?,
    };
    let step = if digits.len() == 3 { 1 } else { 2 };
    let channel = |k: usize| {
        let digits = digits.get(k * step..(k + 1) * step)?;
        let value = u8::from_str_radix(digits, 16).ok()?;
        Some(if step == 1 { 17 * value } else { value })
    };
    Some(Some(Color::from_rgba8(channel(0)?, channel(1)?, channel(2)?, 255)))
}

/// `translate(x y)` and `rotate(degrees)`, one after the other.
fn transform(text: &str) -> Option<Transform> {
    text.split_inclusive(')').map(str::trim).try_fold(Transform::identity(), |before, part| {
        let (name, rest) = part.split_once('(')?;
        let numbers = numbers(rest.strip_suffix(')')?)?;
        Some(match (name, numbers.as_slice()) {
            ("translate", [x, y]) => before.pre_translate(*x, *y),
            ("rotate", [degrees]) => before.pre_concat(Transform::from_rotate(*degrees)),
            _ => return None,
        })
    })
}

fn numbers(text: &str) -> Option<Vec<f32>> {
    text.split([' ', ',']).filter(|part| !part.is_empty()).map(|part| part.parse().ok()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn painted(body: &str) -> Result<Image, String> {
        let svg =
            format!(r#"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 20 10">{body}</svg>"#);
        let dot = Image { width: 1, height: 1, pixels: vec![[1, 2, 3]] };
        paint(&svg, &[dot], 2.0)
    }

    fn pixel(image: &Image, x: usize, y: usize) -> [u8; 3] {
        image.pixels[y * image.width + x]
    }

    #[test]
    fn shapes_lie_where_they_are_drawn() {
        let image = painted(
            r##"<g transform="translate(10 0)" fill="#f00"><rect width="5" height="5"/></g>
            <g transform="translate(2 8) rotate(-90)"><path d="M0 0H4" stroke="#00f" stroke-width="2"/></g>
            <image x="16" y="6" width="4" height="4" href="#0"/>"##,
        )
        .unwrap();
        assert_eq!((image.width, image.height), (40, 20));
        assert_eq!(pixel(&image, 21, 1), [255, 0, 0]);
        assert_eq!(pixel(&image, 19, 1), [255; 3]);
        assert_eq!(pixel(&image, 4, 10), [0, 0, 255]);
        assert_eq!(pixel(&image, 4, 18), [255; 3]);
        assert_eq!(pixel(&image, 35, 15), [1, 2, 3]);
    }

    #[test]
    fn texts_have_ink_on_their_side_of_the_anchor() {
        let dark = |anchor: &str| {
            let text =
                format!(r#"<text x="10" y="8" font-size="8" text-anchor="{anchor}">I</text>"#);
            let image = painted(&text).unwrap();
            let columns = (0..40).filter(|x| (0..20).any(|y| pixel(&image, *x, y)[0] < 128));
            columns.collect::<Vec<_>>()
        };
        assert!(dark("start").iter().all(|x| *x >= 20) && !dark("start").is_empty());
        assert!(dark("end").iter().all(|x| *x < 20) && !dark("end").is_empty());
    }

    #[test]
    fn what_is_not_painted_is_refused() {
        for (body, what) in [
            ("<ellipse/>", "<ellipse>"),
            (r#"<rect class="a"/>"#, r#"class="a""#),
            (r#"<path d="M0 0Q1 1 2 2"/>"#, "M0 0Q1 1 2 2"),
            (r##"<image href="#3"/>"##, "#3"),
            (r#"<rect fill="lavender"/>"#, "lavender"),
        ] {
            let refusal = painted(body).unwrap_err();
            assert!(refusal.contains(what), "{refusal}");
        }
    }
}
