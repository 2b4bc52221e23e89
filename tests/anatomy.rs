//! Universal coordinates and carried fibres, as a user gets them.
//!
//! Not in the repository: `opencarp_atrium/`, an atrium of an atlas with coordinates of its own, and `fibernet/LA_model.vtk`.
//! Without them the tests that need them say so.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests")]

#[path = "support/program.rs"]
mod program;

use eplat::mesh::{Encoding, Reading, Surface, read};
use program::{Workplace, shared, text};

/// Along the mesh's second axis, in the triangles.
fn fibres(surface: &Surface) -> Vec<[f64; 3]> {
    let mesh = &surface.mesh;
    let one = |corners: &[u32; 3]| {
        let [a, b, c] = corners.map(|v| nalgebra::Vector3::from(mesh.vertices()[v as usize]));
        let normal = (b - a).cross(&(c - a)).normalize();
        (nalgebra::Vector3::y() - normal * normal.y).normalize().into()
    };
    mesh.triangles().iter().map(one).collect()
}

/// The angle between the directions that half of the triangles are below, in degrees.
fn apart(a: &[[f64; 3]], b: &[[f64; 3]]) -> f64 {
    let cosine = |(a, b): (&[f64; 3], &[f64; 3])| {
        let [length, other] = [a, b].map(|f| f.iter().map(|x| x * x).sum::<f64>().sqrt());
        a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>().abs() / (length * other)
    };
    let mut all: Vec<f64> = a.iter().zip(b).map(cosine).collect();
    all.sort_by(f64::total_cmp);
    all[all.len() / 2].min(1.0).acos().to_degrees()
}

fn has_direction(fibre: &[f64; 3]) -> bool {
    fibre.iter().any(|x| *x != 0.0)
}

#[test]
fn a_shell_gets_the_fibres_of_another() {
    let place = Workplace::new();
    let mut atlas = Surface::left_atrium(1.5);
    atlas.cell_data.insert("fibre".into(), fibres(&atlas).into());
    atlas.write(&place.path("atlas.pts"), Encoding::Binary).unwrap();
    assert!(place.eplat("mesh atrium --edge 2 --out shell.vtk").status.success());
    let made = place.eplat("mesh fibres shell.vtk shell.vtp --from atlas.pts");
    assert!(made.status.success(), "{}", text(&made.stderr));
    assert!(
        text(&made.stderr).contains("openings, by their places (another: --openings): mv at (")
    );
    let shell = read(&place.path("shell.vtp"), Reading::default()).unwrap();
    let (name, carried) = shell.any_fibres().unwrap();
    assert_eq!(name, "fibre");
    assert!(shell.point_data.contains_key("region"), "its own data stay");
    assert!(carried.iter().all(has_direction));
    assert!(apart(&carried, &fibres(&shell)) < 4.0);
    // a model of fibres takes them: in the tip of the appendage, where coordinates do not grow, they are those around it
    let note = "triangles take theirs from those around them: none could be carried there";
    assert!(text(&made.stderr).contains(note), "{}", text(&made.stderr));
    let rows = "protocol,vertex,source,value\nlat,7,3,20\nlat,70,3,30\nlat,700,3,40\n";
    place.file("lat.csv", rows);
    let checked = place.eplat("check lat_fibres --mesh shell.vtp --data lat.csv");
    assert!(checked.status.success(), "{}", text(&checked.stderr));
}

#[test]
fn what_cannot_be_done_is_told() {
    let place = Workplace::new();
    assert!(place.eplat("mesh atrium --edge 3 --out la.vtk").status.success());
    // a strip: one opening
    place.file("strip.obj", "v 0 0 0\nv 40 0 0\nv 0 40 0\nv 40 40 0\nf 1 2 3\nf 2 4 3\n");
    let all = [
        "mesh fibres la.vtk out.vtp --from la.vtk",
        "mesh coordinates strip.obj out.vtp --units mm",
        "mesh coordinates la.vtk out.vtp --openings mv=1,lspv=2",
        "mesh coordinates la.vtk out.docx",
    ]
    .map(|arguments| {
        let failed = place.eplat(arguments);
        assert!(!failed.status.success() && !place.path("out.vtp").exists());
        format!("$ eplat {arguments}\n{}\n", text(&failed.stderr))
    });
    insta::assert_snapshot!(all.concat());
}

/// The atlas has coordinates whose walls are landmarks that were set by hand; ours follow from the openings.
#[test]
fn coordinates_are_near_those_of_an_atlas() {
    let (Some(points), Some(file)) =
        (shared("opencarp_atrium/la_endo_1.pts"), shared("opencarp_atrium/la_endo_1_uac.pts"))
    else {
        return;
    };
    let place = Workplace::new();
    let made = place.eplat(&format!("mesh coordinates {} uac.vtp", points.display()));
    assert!(made.status.success(), "{}", text(&made.stderr));
    let surface = read(&place.path("uac.vtp"), Reading::default()).unwrap();
    let [first, second] = ["uac_ls", "uac_pa"].map(|name| surface.scalar(name).unwrap());
    let all = std::fs::read_to_string(file).unwrap();
    let expected: Vec<[f64; 2]> = all
        .lines()
        .skip(1)
        .map(|line| {
            let mut numbers = line.split_whitespace().map(|x| x.parse::<f64>().unwrap());
            [numbers.next().unwrap(), numbers.next().unwrap()]
        })
        .collect();
    assert_eq!(expected.len(), first.len());
    let gaps = first
        .iter()
        .zip(&second)
        .zip(&expected)
        .map(|((x, y), [a, b])| [(x - a).abs(), (y - b).abs()]);
    let gaps: Vec<[f64; 2]> = gaps.collect();
    // what lies on the other side of a seam is far off
    let same: Vec<&[f64; 2]> = gaps.iter().filter(|gap| gap[1] < 0.4).collect();
    let share = same.len() as f64 / gaps.len() as f64;
    let [x, y] = [0, 1].map(|k| same.iter().map(|gap| gap[k]).sum::<f64>() / same.len() as f64);
    println!("in the same half {:.1} %, off by {x:.3} and {y:.3} in the mean", 100.0 * share);
    assert!(share > 0.93 && x < 0.08 && y < 0.05);
}

/// How far the fibres of one real atrium tell those of another. It is not known how alike they are, so the bound is that of
/// chance.
#[test]
fn fibres_of_an_atlas_on_another_atrium() {
    let (Some(atlas), Some(shell)) =
        (shared("opencarp_atrium/la_endo_1.pts"), shared("fibernet/LA_model.vtk"))
    else {
        return;
    };
    let place = Workplace::new();
    let [shell, atlas] = [shell, atlas].map(|path| path.display().to_string());
    let made = place.eplat(&format!("mesh fibres {shell} carried.vtp --from {atlas}"));
    assert!(made.status.success(), "{}", text(&made.stderr));
    let surface = read(&place.path("carried.vtp"), Reading::default()).unwrap();
    let [own, carried] = ["fibers", "fibre"].map(|name| surface.triangle_fibres(name).unwrap());
    assert!(carried.iter().all(has_direction));
    let angle = apart(&own, &carried);
    println!("half of the fibres are within {angle:.0}°; by chance 45°");
    assert!(angle < 45.0, "{angle}");
}
