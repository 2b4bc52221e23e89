//! Six standard views of a surface, orthographic and on one scale.

use nalgebra::Vector3;

use crate::mesh::TriMesh;

/// A surface thinner than this share of its length is a sheet: one view shows all of it.
const SHEET: f64 = 1e-3;

/// A direction to look from. Right, up and towards the viewer are unit vectors.
#[derive(Clone, Debug)]
pub(super) struct View {
    pub(super) name: &'static str,
    pub(super) right: Vector3<f64>,
    pub(super) up: Vector3<f64>,
    pub(super) towards: Vector3<f64>,
}

/// Name by anatomy, name by axis, towards the viewer, up.
type Side = (&'static str, &'static str, [f64; 3], [f64; 3]);

/// In the order of a grid of two rows. Of the embedded atrium x points to the patient's left, y to the back, z to the
/// head; from above and below the front is where it is seen after tilting the anterior view.
const SIDES: [Side; 6] = [
    ("anterior", "from −y", [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]),
    ("left", "from +x", [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]),
    ("superior", "from +z", [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]),
    ("posterior", "from +y", [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]),
    ("right", "from −x", [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]),
    ("inferior", "from −z", [0.0, 0.0, -1.0], [0.0, -1.0, 0.0]),
];

/// The views of a surface, by anatomy if its axes are known; of a flat one only the view onto it.
pub(super) fn views(mesh: &TriMesh, is_anatomical: bool) -> Vec<View> {
    let [low, high] = mesh.bounding_box().map(Vector3::from);
    let extent = high - low;
    let is_flat =
        |towards: [f64; 3]| extent.dot(&Vector3::from(towards)).abs() < SHEET * extent.max();
    let all = || {
        SIDES.into_iter().map(|(anatomy, axis, towards, up)| {
            let (towards, up) = (Vector3::from(towards), Vector3::from(up));
            let name = if is_anatomical { anatomy } else { axis };
            View { name, right: up.cross(&towards), up, towards }
        })
    };
    let flat = SIDES.iter().position(|side| side.2.iter().sum::<f64>() > 0.0 && is_flat(side.2));
    all()
        .enumerate()
        .filter(|(at, _)| flat.is_none_or(|flat| flat == *at))
        .map(|(_, v)| v)
        .collect()
}

/// A surface seen in a cell of this many units: where its points lie there.
#[derive(Clone, Debug)]
pub(super) struct Frame {
    view: View,
    centre: Vector3<f64>,
    /// Units per mm.
    pub(super) scale: f64,
    pub(super) size: [f64; 2],
}

impl Frame {
    /// For every view, on the largest scale on which each fits its cell with these margins at the sides and at top and
    /// bottom, units.
    pub(super) fn all(
        views: &[View],
        mesh: &TriMesh,
        size: [f64; 2],
        margin: [f64; 2],
    ) -> Vec<Self> {
        let [low, high] = mesh.bounding_box().map(Vector3::from);
        let (centre, extent) = (0.5 * (low + high), high - low);
        let fits = |view: &View| {
            let along = |axis: &Vector3<f64>| extent.dot(&axis.abs()).max(f64::MIN_POSITIVE);
            let [wide, high] = [0, 1].map(|k| size[k] - 2.0 * margin[k]);
            (wide / along(&view.right)).min(high / along(&view.up))
        };
        let scale = views.iter().map(fits).fold(f64::INFINITY, f64::min);
        views.iter().map(|view| Self { view: view.clone(), centre, scale, size }).collect()
    }

    pub(super) fn name(&self) -> &'static str {
        self.view.name
    }

    /// Place in the cell, y downwards, and nearness to the viewer; all in units.
    pub(super) fn project(&self, at: [f64; 3]) -> [f64; 3] {
        let from_centre = self.scale * (Vector3::from(at) - self.centre);
        [
            0.5 * self.size[0] + from_centre.dot(&self.view.right),
            0.5 * self.size[1] - from_centre.dot(&self.view.up),
            from_centre.dot(&self.view.towards),
        ]
    }

    /// Share of a direction that points to the viewer.
    pub(super) fn facing(&self, direction: &Vector3<f64>) -> f64 {
        direction.dot(&self.view.towards)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::left_atrium;

    fn sheet(z: f64) -> TriMesh {
        let corners = vec![[0.0, 0.0, 0.0], [30.0, 0.0, z], [0.0, 20.0, 0.0]];
        TriMesh::new(corners, vec![[0, 1, 2]]).unwrap()
    }

    #[test]
    fn views_are_right_handed_and_name_what_they_show() {
        let mesh = left_atrium(3.0).mesh;
        let names: Vec<_> = views(&mesh, true).iter().map(|view| view.name).collect();
        assert_eq!(names, ["anterior", "left", "superior", "posterior", "right", "inferior"]);
        for view in views(&mesh, false) {
            assert_eq!(view.right.cross(&view.up), view.towards, "{}", view.name);
            let axis = 2.0 * f64::from(u8::from(view.name.contains('+'))) - 1.0;
            let k = ["x", "y", "z"].iter().position(|axis| view.name.ends_with(axis)).unwrap();
            assert!((view.towards[k] - axis).abs() < 1e-15, "{}", view.name);
        }
        // the patient faces the viewer of the anterior view: his left is on its right
        assert_eq!(views(&mesh, true)[0].right, Vector3::x());
    }

    #[test]
    fn a_flat_sheet_has_one_view() {
        let names = |z| views(&sheet(z), false).iter().map(|v| v.name).collect::<Vec<_>>();
        assert_eq!(names(0.0), ["from +z"]);
        assert_eq!(names(5.0).len(), 6);
    }

    #[test]
    fn every_view_fits_its_cell_on_one_scale() {
        let mesh = left_atrium(3.0).mesh;
        let frames = Frame::all(&views(&mesh, true), &mesh, [200.0, 100.0], [4.0, 6.0]);
        let mut most = 0.0_f64;
        for frame in &frames {
            assert!((frame.scale - frames[0].scale).abs() < 1e-15);
            for vertex in mesh.vertices() {
                let [x, y, _] = frame.project(*vertex);
                assert!(x > 3.99 && x < 196.01 && y > 5.99 && y < 94.01);
                most = most.max((x - 100.0).abs() / 96.0).max((y - 50.0).abs() / 44.0);
            }
        }
        assert!(most > 0.999, "{most}");
    }
}
