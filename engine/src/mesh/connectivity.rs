//! Triangles that change: edges are split, collapsed and flipped, neighbours are found at once.
//!
//! Knows no coordinates.  The surface stays a manifold with the orientation it had, provided the
//! caller collapses only where [`Connectivity::may_collapse`].

/// Triangles and, for every vertex, the triangles around it.
#[derive(Debug)]
pub(super) struct Connectivity {
    /// `None` where a triangle was removed.
    faces: Vec<Option<[u32; 3]>>,
    around: Vec<Vec<u32>>,
}

impl Connectivity {
    pub(super) fn new(n_vertices: usize, triangles: &[[u32; 3]]) -> Self {
        let mut around = vec![Vec::new(); n_vertices];
        for (face, triangle) in (0..).zip(triangles) {
            for &v in triangle {
                around[v as usize].push(face);
            }
        }
        Self { faces: triangles.iter().copied().map(Some).collect(), around }
    }

    /// All triangles.
    pub(super) fn triangles(&self) -> impl Iterator<Item = [u32; 3]> {
        self.faces.iter().copied().flatten()
    }

    /// The triangles at vertex `v`.
    pub(super) fn around(&self, v: u32) -> impl Iterator<Item = [u32; 3]> {
        self.around[v as usize].iter().filter_map(|&face| self.faces[face as usize])
    }

    /// Number of triangles at vertex `v`.
    pub(super) fn n_around(&self, v: u32) -> usize {
        self.around[v as usize].len()
    }

    /// The vertices that share an edge with `v`, in no particular but reproducible order.
    pub(super) fn neighbours(&self, v: u32) -> Vec<u32> {
        let mut found = Vec::with_capacity(8);
        for w in self.around(v).flatten() {
            if w != v && !found.contains(&w) {
                found.push(w);
            }
        }
        found
    }

    /// The one or two faces at the edge `a`–`b`; both `None` if there is no such edge.
    fn faces_at(&self, a: u32, b: u32) -> [Option<u32>; 2] {
        let has_b = |&face: &u32| self.faces[face as usize].is_some_and(|t| t.contains(&b));
        let mut faces = self.around[a as usize].iter().copied().filter(has_b);
        [faces.next(), faces.next()]
    }

    /// The vertices across the edge `a`–`b`: one on a border, two inside, none without such an edge.
    pub(super) fn opposite(&self, a: u32, b: u32) -> [Option<u32>; 2] {
        self.faces_at(a, b).map(|face| {
            let triangle = self.faces[face? as usize]?;
            triangle.into_iter().find(|&v| v != a && v != b)
        })
    }

    /// Whether `a`–`b` is an edge with one triangle only.
    pub(super) fn is_border(&self, a: u32, b: u32) -> bool {
        matches!(self.faces_at(a, b), [Some(_), None])
    }

    /// Every edge once.
    pub(super) fn edges(&self) -> Vec<[u32; 2]> {
        let mut edges = Vec::with_capacity(2 * self.faces.len());
        for [a, b, c] in self.triangles() {
            // Inside, the neighbour has the edge the other way round.
            for [from, to] in [[a, b], [b, c], [c, a]] {
                if from < to || self.is_border(from, to) {
                    edges.push([from.min(to), from.max(to)]);
                }
            }
        }
        edges
    }

    /// Puts a new vertex, whose number is returned, on the edge `a`–`b`.
    pub(super) fn split(&mut self, a: u32, b: u32) -> u32 {
        let middle = self.around.len() as u32;
        self.around.push(Vec::new());
        for face in self.faces_at(a, b).into_iter().flatten() {
            let Some(triangle) = self.faces[face as usize] else { continue };
            self.remove(face);
            self.insert(face, triangle.map(|v| if v == b { middle } else { v }));
            let second = self.faces.len() as u32;
            self.faces.push(None);
            self.insert(second, triangle.map(|v| if v == a { middle } else { v }));
        }
        middle
    }

    /// Whether joining the ends of the edge `a`–`b` leaves a manifold: only the vertices across the edge
    /// are neighbours of both, and each of these keeps a whole fan (`min_left` triangles).
    pub(super) fn may_collapse(&self, a: u32, b: u32, min_left: impl Fn(u32) -> usize) -> bool {
        let across: Vec<u32> = self.opposite(a, b).into_iter().flatten().collect();
        let near_b = self.neighbours(b);
        let n_common = self.neighbours(a).iter().filter(|v| near_b.contains(v)).count();
        !across.is_empty()
            && n_common == across.len()
            && across.iter().all(|&v| self.n_around(v) > min_left(v))
    }

    /// Moves all that vertex `from` has to its neighbour `into`; their common triangles vanish.
    pub(super) fn collapse(&mut self, from: u32, into: u32) {
        for face in self.faces_at(from, into).into_iter().flatten() {
            self.remove(face);
        }
        for face in std::mem::take(&mut self.around[from as usize]) {
            if let Some(triangle) = &mut self.faces[face as usize] {
                *triangle = triangle.map(|v| if v == from { into } else { v });
                self.around[into as usize].push(face);
            }
        }
    }

    /// The two triangles that would take the place of those at the inner edge `a`–`b`, with the other
    /// diagonal; `None` on a border or where that diagonal is an edge already.
    pub(super) fn flipped(&self, a: u32, b: u32) -> Option<[[u32; 3]; 2]> {
        let [Some(left), Some(right)] = self.opposite(a, b) else { return None };
        if left == right || self.faces_at(left, right)[0].is_some() {
            return None;
        }
        let first = self.faces[self.faces_at(a, b)[0]? as usize]?;
        let runs_forward = (0..3).any(|k| first[k] == a && first[(k + 1) % 3] == b);
        let [left, right] = if runs_forward { [left, right] } else { [right, left] };
        Some([[a, right, left], [right, b, left]])
    }

    /// Replaces the two triangles at the edge `a`–`b` by `triangles`.
    pub(super) fn replace(&mut self, a: u32, b: u32, triangles: [[u32; 3]; 2]) {
        let faces = self.faces_at(a, b);
        for (face, triangle) in faces.into_iter().flatten().zip(triangles) {
            self.remove(face);
            self.insert(face, triangle);
        }
    }

    fn insert(&mut self, face: u32, triangle: [u32; 3]) {
        self.faces[face as usize] = Some(triangle);
        for v in triangle {
            self.around[v as usize].push(face);
        }
    }

    fn remove(&mut self, face: u32) {
        let triangle = self.faces[face as usize].take();
        for v in triangle.into_iter().flatten() {
            self.around[v as usize].retain(|&other| other != face);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn octahedron() -> Connectivity {
        let triangles = [
            [0, 1, 2],
            [0, 2, 3],
            [0, 3, 4],
            [0, 4, 1],
            [5, 2, 1],
            [5, 3, 2],
            [5, 4, 3],
            [5, 1, 4],
        ];
        Connectivity::new(6, &triangles)
    }

    /// Every edge is run once each way: closed, oriented, manifold.
    fn is_closed_and_oriented(surface: &Connectivity) -> bool {
        let mut sides: Vec<[u32; 2]> =
            surface.triangles().flat_map(|[a, b, c]| [[a, b], [b, c], [c, a]]).collect();
        sides.sort_unstable();
        let n = sides.len();
        sides.dedup();
        n == sides.len() && sides.iter().all(|&[a, b]| sides.binary_search(&[b, a]).is_ok())
    }

    #[test]
    fn split_flip_and_collapse_keep_a_closed_oriented_surface() {
        let mut surface = octahedron();
        assert_eq!(surface.edges().len(), 12);
        let middle = surface.split(0, 1);
        assert!(is_closed_and_oriented(&surface));
        assert_eq!((surface.triangles().count(), surface.n_around(middle)), (10, 4));
        let new = surface.flipped(0, 3).unwrap();
        surface.replace(0, 3, new);
        assert!(is_closed_and_oriented(&surface));
        assert!(surface.opposite(2, 4).iter().all(Option::is_some));
        assert!(surface.may_collapse(middle, 1, |_| 3));
        surface.collapse(middle, 1);
        assert!(is_closed_and_oriented(&surface));
        assert_eq!((surface.triangles().count(), surface.n_around(middle)), (8, 0));
    }

    #[test]
    fn a_collapse_that_would_pinch_is_refused() {
        let tetrahedron = Connectivity::new(4, &[[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]);
        assert!(!tetrahedron.may_collapse(0, 1, |_| 3));
        assert!(tetrahedron.flipped(0, 1).is_none());
    }

    #[test]
    fn a_border_edge_splits_into_two_border_edges() {
        let mut triangle = Connectivity::new(3, &[[0, 1, 2]]);
        let middle = triangle.split(0, 1);
        assert!(triangle.is_border(0, middle) && triangle.is_border(middle, 1));
        assert!(!triangle.is_border(middle, 2));
    }
}
