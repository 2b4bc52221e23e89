//! A first, rough triangulation of a shape: marching tetrahedra, then cut open at the planes.

use super::shape::Shape;
use nalgebra::Vector3;
use rayon::prelude::*;
use std::collections::BTreeMap;

type Point = Vector3<f64>;

/// Triangles with their vertices; `rim[v]` is the cut whose rim vertex `v` lies on.
#[derive(Debug, Default)]
pub(super) struct Soup {
    pub(super) positions: Vec<Point>,
    pub(super) rim: Vec<Option<usize>>,
    pub(super) triangles: Vec<[u32; 3]>,
}

/// The surface of `shape`, open at its cuts, with triangles of about `cell` mm.
pub(super) fn polygonise(shape: &Shape, cell: f64) -> Soup {
    let mut soup = march(shape, cell);
    for cut in 0..shape.n_cuts() {
        soup.open(shape, cut);
    }
    soup
}

/// A regular grid of sampled distances.
struct Grid {
    origin: Point,
    cell: f64,
    n: [usize; 3],
    distance: Vec<f64>,
}

impl Grid {
    fn new(shape: &Shape, cell: f64) -> Self {
        let [low, high] = Shape::bounds();
        let n: [usize; 3] =
            std::array::from_fn(|k| ((high[k] - low[k]) / cell).ceil() as usize + 1);
        let mut grid = Self { origin: low, cell, n, distance: Vec::new() };
        grid.distance = (0..n[0] * n[1] * n[2])
            .into_par_iter()
            .map(|node| shape.distance(&grid.position(node)))
            .collect();
        grid
    }

    fn node(&self, [i, j, k]: [usize; 3]) -> usize {
        (k * self.n[1] + j) * self.n[0] + i
    }

    fn position(&self, node: usize) -> Point {
        let [nx, ny, _] = self.n;
        let index = [node % nx, node / nx % ny, node / (nx * ny)];
        self.origin + Point::from(index.map(|i| i as f64)) * self.cell
    }

    fn is_inside(&self, node: usize) -> bool {
        self.distance[node] < 0.0
    }

    /// The six tetrahedra around the diagonal of the cube whose lowest corner is `corner`: each
    /// steps along the three axes in another order, so that neighbouring cubes fit.
    fn tetrahedra(&self, corner: [usize; 3]) -> [[usize; 4]; 6] {
        [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]].map(|axes| {
            let mut at = corner;
            let mut nodes = [self.node(at); 4];
            for (node, axis) in nodes[1..].iter_mut().zip(axes) {
                at[axis] += 1;
                *node = self.node(at);
            }
            nodes
        })
    }
}

/// Marching tetrahedra over the shape's bounding box.
fn march(shape: &Shape, cell: f64) -> Soup {
    let grid = Grid::new(shape, cell);
    let mut marcher = Marcher { grid: &grid, on_edge: BTreeMap::new(), soup: Soup::default() };
    for k in 0..grid.n[2] - 1 {
        for j in 0..grid.n[1] - 1 {
            for i in 0..grid.n[0] - 1 {
                for tetrahedron in grid.tetrahedra([i, j, k]) {
                    marcher.add(tetrahedron);
                }
            }
        }
    }
    marcher.soup.rim = vec![None; marcher.soup.positions.len()];
    marcher.soup
}

struct Marcher<'a> {
    grid: &'a Grid,
    on_edge: BTreeMap<[usize; 2], u32>,
    soup: Soup,
}

impl Marcher<'_> {
    /// Adds the triangle or two that separate the tetrahedron's inner from its outer nodes.
    fn add(&mut self, tetrahedron: [usize; 4]) {
        let (inner, outer): (Vec<usize>, Vec<usize>) =
            tetrahedron.iter().partition(|&&node| self.grid.is_inside(node));
        let corners: Vec<u32> = match (inner.as_slice(), outer.as_slice()) {
            ([a], [b, c, d]) | ([b, c, d], [a]) => {
                [b, c, d].map(|end| self.crossing(*a, *end)).to_vec()
            }
            ([a, b], [c, d]) => {
                [[a, c], [a, d], [b, d], [b, c]].map(|[u, v]| self.crossing(*u, *v)).to_vec()
            }
            _ => return,
        };
        let centre = |nodes: &[usize]| {
            nodes.iter().map(|&node| self.grid.position(node)).sum::<Point>() / nodes.len() as f64
        };
        let outwards = centre(&outer) - centre(&inner);
        for i in 2..corners.len() {
            let mut triangle = [corners[0], corners[i - 1], corners[i]];
            let at = triangle.map(|v| self.soup.positions[v as usize]);
            if crate::mesh::area_vector(at).dot(&outwards) < 0.0 {
                triangle.swap(1, 2);
            }
            self.soup.triangles.push(triangle);
        }
    }

    /// The vertex where the surface crosses the grid edge `a`–`b`, kept a little off its ends.
    fn crossing(&mut self, a: usize, b: usize) -> u32 {
        let (grid, positions) = (self.grid, &mut self.soup.positions);
        *self.on_edge.entry([a.min(b), a.max(b)]).or_insert_with(|| {
            let (da, db) = (grid.distance[a], grid.distance[b]);
            let along = (da / (da - db)).clamp(0.05, 0.95);
            positions.push(grid.position(a).lerp(&grid.position(b), along));
            positions.len() as u32 - 1
        })
    }
}

impl Soup {
    /// Removes what lies beyond plane `cut`; new vertices lie on its rim.
    fn open(&mut self, shape: &Shape, cut: usize) {
        // Out of reach counts as far below; a vertex in the plane is moved off it.
        let height = |p: &Point| match shape.height(cut, p) {
            Some(height) if height.abs() < 1e-3 => -1e-3,
            Some(height) => height,
            None => f64::NEG_INFINITY,
        };
        let heights: Vec<f64> = self.positions.iter().map(height).collect();
        let mut on_edge = BTreeMap::new();
        for triangle in std::mem::take(&mut self.triangles) {
            let above = triangle.map(|v| heights[v as usize] > 0.0);
            match above.iter().filter(|&&above| above).count() {
                0 => self.triangles.push(triangle),
                3 => {}
                n_above => {
                    // Start at the corner that is alone on its side.
                    let alone = above.iter().position(|&a| a == (n_above == 1)).unwrap_or(0);
                    let [a, b, c] = std::array::from_fn(|k| triangle[(alone + k) % 3]);
                    let ab = self.cut_edge(&mut on_edge, &heights, cut, [a, b]);
                    let ac = self.cut_edge(&mut on_edge, &heights, cut, [a, c]);
                    if n_above == 1 {
                        self.triangles.extend([[ab, b, c], [ab, c, ac]]);
                    } else {
                        self.triangles.push([a, ab, ac]);
                    }
                }
            }
        }
    }

    fn cut_edge(
        &mut self,
        on_edge: &mut BTreeMap<[u32; 2], u32>,
        heights: &[f64],
        cut: usize,
        [a, b]: [u32; 2],
    ) -> u32 {
        *on_edge.entry([a.min(b), a.max(b)]).or_insert_with(|| {
            let [low, high] = if heights[a as usize] < 0.0 { [a, b] } else { [b, a] };
            let (below, above) = (heights[low as usize].max(-1e3), heights[high as usize]);
            let ends = [low, high].map(|v| self.positions[v as usize]);
            self.positions.push(ends[0].lerp(&ends[1], below / (below - above)));
            self.rim.push(Some(cut));
            self.positions.len() as u32 - 1
        })
    }
}
