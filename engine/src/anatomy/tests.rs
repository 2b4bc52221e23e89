use super::*;
use crate::mesh::{Atrium, REGION_NAMES, TriMesh, left_atrium};
use nalgebra::Vector3;

/// The region that most vertices of an opening lie in.
fn region(atrium: &Atrium, ring: &[u32]) -> &'static str {
    let count = |name: usize| {
        ring.iter().filter(|v| usize::from(atrium.region[**v as usize]) == name).count()
    };
    REGION_NAMES[(0..REGION_NAMES.len()).max_by_key(|name| count(*name)).unwrap()]
}

fn moved(mesh: &TriMesh, by: impl Fn(Vector3<f64>) -> Vector3<f64>) -> TriMesh {
    let points = mesh.vertices().iter().map(|p| by(Vector3::from(*p)).into()).collect();
    TriMesh::new(points, mesh.triangles().to_vec()).unwrap()
}

#[test]
fn openings_are_told_however_an_atrium_lies_and_its_mirror_image_has_left_for_right() {
    let atrium = left_atrium(3.0);
    let names = |mesh: &TriMesh| {
        let openings = Openings::guess(mesh).unwrap();
        Opening::ALL.map(|o| region(&atrium, openings.of(o)))
    };
    let expected = ["mitral rim", "LSPV", "LIPV", "RSPV", "RIPV"];
    assert_eq!(names(&atrium.mesh), expected);
    let turn = nalgebra::Rotation3::from_euler_angles(0.7, -2.0, 1.1);
    assert_eq!(names(&moved(&atrium.mesh, |p| turn * p * 1.2)), expected);
    let mirrored = names(&moved(&atrium.mesh, |p| Vector3::new(-p.x, p.y, p.z)));
    assert_eq!(mirrored, ["mitral rim", "RSPV", "RIPV", "LSPV", "LIPV"]);
}

#[test]
fn openings_can_be_named() {
    let mesh = left_atrium(3.0).mesh;
    let guessed = Openings::guess(&mesh).unwrap();
    let all = openings(&mesh);
    let number = |o: &Opening| 1 + all.iter().position(|ring| ring == guessed.of(*o)).unwrap();
    let text: Vec<String> = Opening::ALL.iter().map(|o| format!("{o}={}", number(o))).collect();
    assert_eq!(Openings::named(&mesh, &text.join(", ")).unwrap(), guessed);
    for (given, expected) in [
        ("mv=1,lspv=2", "lipv is missing"),
        ("mv=1,lspv=1", "`lspv=1` is said of two"),
        ("mv=1,mv=2", "`mv=2` is said of two"),
        ("mv=9", "there is no opening 9, expected 1 to 5"),
        ("valve=1", "`valve=1` is no opening and its number"),
    ] {
        let error = Openings::named(&mesh, given).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
}

fn coordinates(mesh: &TriMesh) -> Coordinates {
    Coordinates::new(mesh, &Openings::guess(mesh).unwrap()).unwrap()
}

#[test]
fn coordinates_are_those_of_the_places() {
    let atrium = left_atrium(1.5);
    let of = coordinates(&atrium.mesh);
    let [first, second] = of.at_vertices();
    assert!(first.iter().chain(&second).all(|x| (-1e-6..=1.0 + 1e-6).contains(x)));
    let mean = |name: &str| {
        let n = |v: &usize| REGION_NAMES[usize::from(atrium.region[*v])] == name;
        let all: Vec<usize> = (0..first.len()).filter(n).collect();
        [&first, &second].map(|of| all.iter().map(|v| of[*v]).sum::<f64>() / all.len() as f64)
    };
    for (name, expected) in [
        ("LSPV", [0.885, 0.55]),
        ("LIPV", [0.87, 0.315]),
        ("RSPV", [0.115, 0.55]),
        ("RIPV", [0.13, 0.315]),
        // nothing holds it
        ("LAA", [0.75, 0.84]),
    ] {
        let found = mean(name);
        let gap = (found[0] - expected[0]).hypot(found[1] - expected[1]);
        assert!(gap < 0.12, "{name}: {found:.3?}");
    }
    // no triangle of a half lies on another: all have the same orientation
    for half in &of.halves {
        let area = |corners: &[u32; 3]| {
            let [a, b, c] = corners.map(|v| half.at.each_ref().map(|of| of[v as usize]));
            (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        };
        let areas: Vec<f64> = half.mesh.triangles().iter().map(area).collect();
        let sum = |sign: f64| areas.iter().map(|a| (sign * a).max(0.0)).sum::<f64>();
        let folded = sum(1.0).min(sum(-1.0)) / (sum(1.0) + sum(-1.0));
        assert!(folded < 0.02, "{folded}");
    }
}

/// Around the axis through the body, in the surface.
fn turning(mesh: &TriMesh) -> Vec<[f64; 3]> {
    let one = |corners: &[u32; 3]| {
        let [a, b, c] = corners.map(|v| Vector3::from(mesh.vertices()[v as usize]));
        let normal = (b - a).cross(&(c - a)).normalize();
        let axis = Vector3::new(0.3, 0.5, 0.8);
        normal.cross(&axis).normalize().into()
    };
    mesh.triangles().iter().map(one).collect()
}

/// By how much the directions differ, in degrees: the median, and what a tenth is above.
fn apart(a: &[[f64; 3]], b: &[[f64; 3]]) -> [f64; 2] {
    let angle = |(a, b): (&[f64; 3], &[f64; 3])| {
        Vector3::from(*a).dot(&Vector3::from(*b)).abs().min(1.0).acos().to_degrees()
    };
    let mut all: Vec<f64> = a.iter().zip(b).map(angle).collect();
    all.sort_by(f64::total_cmp);
    [0.5, 0.9].map(|p| all[(p * all.len() as f64) as usize])
}

/// To the same shape with other triangles, turned and larger; and to one that is longer and flatter.
#[test]
fn fibres_are_carried_to_the_same_places() {
    let atrium = left_atrium(1.5);
    let (coarse, fine) = (&atrium.mesh, left_atrium(1.0).mesh);
    let from = coordinates(&fine);
    let carried = |mesh: &TriMesh| carry_fibres(&from, &turning(&fine), &coordinates(mesh));
    let turn = nalgebra::Rotation3::from_euler_angles(0.7, -2.0, 1.1);
    let turned = moved(coarse, |p| turn * p * 1.2);
    let all = |by: &dyn Fn(Vector3<f64>) -> Vector3<f64>| -> Vec<[f64; 3]> {
        turning(coarse).iter().map(|f| by(Vector3::from(*f)).normalize().into()).collect()
    };
    let (found, expected) = (carried(&turned), all(&|f| turn * f));
    let [half, most] = apart(&found, &expected);
    println!("half within {half:.1}°, nine tenths within {most:.1}°");
    assert!(half < 3.0 && most < 20.0);
    let is_appendage = |t: usize| {
        REGION_NAMES[usize::from(atrium.region[coarse.triangles()[t][0] as usize])] == "LAA"
    };
    let own: Vec<usize> = (0..found.len()).filter(|t| is_appendage(*t)).collect();
    let pick = |of: &[[f64; 3]]| own.iter().map(|t| of[*t]).collect::<Vec<_>>();
    let [half, most] = apart(&pick(&found), &pick(&expected));
    println!("in the appendage half within {half:.1}°, nine tenths within {most:.1}°");
    assert!(half < 10.0);
    let stretch = |p: Vector3<f64>| Vector3::new(1.2 * p.x, 0.9 * p.y, p.z);
    let longer = moved(coarse, stretch);
    let [half, most] = apart(&carried(&longer), &all(&stretch));
    assert!(half < 6.0 && most < 40.0, "{half:.1}° {most:.1}°");
}
