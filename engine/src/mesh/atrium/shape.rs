//! The left atrium as a smooth signed distance: a body, four veins and an appendage blended
//! together, and the planes that cut the veins and the mitral valve open.
//!
//! Millimetres; x points to the patient's left, y to the back, z to the head.  Not the anatomy of a
//! person: dimensions are those of textbooks (body about 54 × 40 × 50 mm, veins 11–14 mm wide).

use nalgebra::{Vector3, vector};

type Point = Vector3<f64>;

/// A building block with a closed-form (approximate) distance.
#[derive(Debug)]
enum Primitive {
    Ellipsoid {
        centre: Point,
        radii: Point,
    },
    /// Everything within a radius of a line, the radius going linearly from one end to the other.
    Tube {
        from: Point,
        to: Point,
        radius_from: f64,
        radius_to: f64,
    },
}

impl Primitive {
    fn distance(&self, p: &Point) -> f64 {
        match self {
            Self::Ellipsoid { centre, radii } => {
                let q = (p - centre).component_div(radii);
                let gradient = q.component_div(radii).norm();
                if gradient > 0.0 { q.norm() * (q.norm() - 1.0) / gradient } else { -radii.min() }
            }
            Self::Tube { from, to, radius_from, radius_to } => {
                let axis = to - from;
                let along = ((p - from).dot(&axis) / axis.norm_squared()).clamp(0.0, 1.0);
                (p - from - axis * along).norm() - (radius_from + (radius_to - radius_from) * along)
            }
        }
    }
}

/// A named piece of anatomy: primitives blended over `inner_blend` mm, and together blended into
/// the rest over `blend` mm.
#[derive(Debug)]
struct Part {
    region: u8,
    primitives: Vec<Primitive>,
    inner_blend: f64,
    blend: f64,
}

impl Part {
    fn distance(&self, p: &Point) -> f64 {
        let distances = self.primitives.iter().map(|primitive| primitive.distance(p));
        distances.reduce(|a, b| smooth_min(a, b, self.inner_blend)).unwrap_or(f64::INFINITY)
    }
}

/// A plane that opens the surface: what lies beyond it, within `reach` of `point`, is removed.
#[derive(Debug)]
struct Cut {
    point: Point,
    normal: Point,
    reach: f64,
}

/// Region numbers: indices of [`super::REGION_NAMES`].
pub(super) const BODY: u8 = 0;
const LSPV: u8 = 1;
const LIPV: u8 = 2;
const RSPV: u8 = 3;
const RIPV: u8 = 4;
const LAA: u8 = 5;
const MITRAL_RIM: u8 = 6;

/// Width of the mitral rim region, mm.
const RIM_WIDTH: f64 = 3.0;

/// The blended surface `distance = 0` and its cuts.
#[derive(Debug)]
pub(super) struct Shape {
    parts: Vec<Part>,
    cuts: Vec<Cut>,
}

impl Shape {
    /// The left atrium.
    pub(super) fn left_atrium() -> Self {
        let mut shape = Self { parts: vec![body()], cuts: Vec::new() };
        shape.vein(LSPV, vector![15.0, 8.0, 10.0], vector![0.80, 0.38, 0.55], 6.0, 23.0);
        shape.vein(LIPV, vector![15.0, 9.0, -7.0], vector![0.85, 0.50, -0.35], 5.6, 22.0);
        shape.vein(RSPV, vector![-15.0, 6.0, 10.0], vector![-0.85, 0.20, 0.55], 6.8, 23.0);
        shape.vein(RIPV, vector![-15.0, 9.0, -7.0], vector![-0.82, 0.55, -0.35], 6.2, 22.0);
        shape.parts.push(appendage());
        let normal = vector![0.30, -0.62, -0.72].normalize();
        let point = vector![2.0, -4.0, -6.0] + normal * 14.0;
        shape.cuts.push(Cut { point, normal, reach: 26.0 });
        shape
    }

    /// A vein from inside the body at `from`, cut open after `length`; it narrows by a sixth.
    fn vein(&mut self, region: u8, from: Point, direction: Point, radius: f64, length: f64) {
        let normal = direction.normalize();
        let point = from + normal * length;
        // The tube goes on past the cut, so that its round end is cut away.
        let to = point + normal * 4.5;
        let tube =
            Primitive::Tube { from, to, radius_from: 1.15 * radius, radius_to: 0.95 * radius };
        self.parts.push(Part { region, primitives: vec![tube], inner_blend: 0.0, blend: 11.0 });
        self.cuts.push(Cut { point, normal, reach: 2.2 * radius });
    }

    /// A box that holds the whole surface with room to spare.
    pub(super) fn bounds() -> [Point; 2] {
        [vector![-48.0, -50.0, -38.0], vector![50.0, 38.0, 42.0]]
    }

    /// Number of openings.
    pub(super) fn n_cuts(&self) -> usize {
        self.cuts.len()
    }

    /// Signed distance to the uncut surface, negative inside; exact only near it.
    pub(super) fn distance(&self, p: &Point) -> f64 {
        self.parts.iter().fold(f64::INFINITY, |d, part| smooth_min(d, part.distance(p), part.blend))
    }

    /// Height of `p` above plane `cut`, or `None` out of its reach.
    pub(super) fn height(&self, cut: usize, p: &Point) -> Option<f64> {
        let Cut { point, normal, reach } = &self.cuts[cut];
        let from_centre = p - point;
        (from_centre.norm() <= *reach).then(|| from_centre.dot(normal))
    }

    /// Distance and its gradient by tetrahedral differences.
    fn gradient(&self, p: &Point) -> (f64, Point) {
        const STEP: f64 = 1e-3;
        let corners = [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]];
        let (mut sum, mut gradient) = (0.0, Point::zeros());
        for corner in corners.map(Point::from) {
            let d = self.distance(&(p + corner * STEP));
            sum += d;
            gradient += corner * d;
        }
        (sum / 4.0, gradient / (4.0 * STEP))
    }

    /// Moves `p` onto the surface, or onto the rim where plane `cut` meets it, by `n_steps` of Newton.
    pub(super) fn project(&self, mut p: Point, cut: Option<usize>, n_steps: usize) -> Point {
        for _ in 0..n_steps {
            let (d, gradient) = self.gradient(&p);
            let g2 = gradient.norm_squared();
            let Some(Cut { point, normal, .. }) = cut.map(|cut| &self.cuts[cut]) else {
                p -= gradient * (d / g2);
                continue;
            };
            // The shortest step s with gradient·s = −d and normal·s = −height.
            let (height, slope) = ((p - point).dot(normal), gradient.dot(normal));
            let determinant = g2 - slope * slope;
            p -= gradient * ((d - slope * height) / determinant)
                + normal * ((g2 * height - slope * d) / determinant);
        }
        p
    }

    /// The region a point of the surface belongs to.
    pub(super) fn region(&self, p: &Point) -> u8 {
        let mitral = self.cuts.len() - 1;
        if self.height(mitral, p).is_some_and(|height| height > -RIM_WIDTH) {
            return MITRAL_RIM;
        }
        let body = self.parts[0].distance(p);
        let others = self.parts[1..].iter().map(|part| (part.distance(p), part.region));
        match others.min_by(|a, b| a.0.total_cmp(&b.0)) {
            // Where a part has left the body by half a millimetre it begins.
            Some((distance, region)) if body > distance + 0.5 => region,
            _ => BODY,
        }
    }
}

fn body() -> Part {
    let upper = Primitive::Ellipsoid { centre: Point::zeros(), radii: vector![27.0, 19.5, 23.0] };
    let lower =
        Primitive::Ellipsoid { centre: vector![3.0, -6.0, -8.0], radii: vector![20.0, 17.0, 19.0] };
    Part { region: BODY, primitives: vec![upper, lower], inner_blend: 10.0, blend: 0.0 }
}

fn appendage() -> Part {
    let path = [
        (vector![17.0, -10.0, 5.0], 7.5),
        (vector![27.0, -15.0, 10.0], 7.2),
        (vector![33.0, -22.0, 9.0], 6.8),
        (vector![34.0, -30.0, 5.0], 5.8),
        (vector![31.0, -36.0, -1.0], 4.2),
    ];
    let tube = |ends: &[(Point, f64)]| Primitive::Tube {
        from: ends[0].0,
        to: ends[1].0,
        radius_from: ends[0].1,
        radius_to: ends[1].1,
    };
    Part {
        region: LAA,
        primitives: path.windows(2).map(tube).collect(),
        inner_blend: 3.0,
        blend: 9.0,
    }
}

/// The smaller of two distances, rounded over `blend` (cubic, twice differentiable).
fn smooth_min(a: f64, b: f64, blend: f64) -> f64 {
    let overlap = blend - (a - b).abs();
    if overlap <= 0.0 || blend <= 0.0 {
        return a.min(b);
    }
    a.min(b) - overlap * overlap * overlap / (6.0 * blend * blend)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn projection_reaches_the_surface_and_the_rim() {
        let shape = Shape::left_atrium();
        let p = shape.project(vector![-3.0, 18.0, 4.0], None, 6);
        // The differences' own error is about STEP² times the curvature.
        assert!(shape.distance(&p).abs() < 1e-6);
        let on_vein = shape.cuts[0].point + vector![0.0, 0.0, 5.0];
        let p = shape.project(on_vein, Some(0), 8);
        assert!(shape.distance(&p).abs() < 1e-6);
        assert!(shape.height(0, &p).unwrap().abs() < 1e-6);
    }

    #[test]
    fn smooth_min_is_the_minimum_away_from_the_blend() {
        assert!((smooth_min(1.0, 9.0, 7.0) - 1.0).abs() < 1e-15);
        assert!((smooth_min(2.0, 2.0, 6.0) - 1.0).abs() < 1e-15);
    }
}
