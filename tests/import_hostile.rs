//! Damaged studies: every reader of `eplat::import` gives a study or an error, and never panics.
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/carto.rs"]
mod carto;
#[path = "support/ensite.rs"]
mod ensite;
#[path = "support/mat.rs"]
mod mat;

use std::path::Path;

use eplat::import::{Given, Options, read, select};
use proptest::prelude::*;
use tempfile::TempDir;

/// What is done to a file: bytes are changed, and it is cut.
#[derive(Clone, Debug)]
struct Damage {
    changes: Vec<(prop::sample::Index, u8)>,
    cut: Option<prop::sample::Index>,
}

fn damage() -> impl Strategy<Value = Damage> {
    let changes = prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6);
    (changes, prop::option::weighted(0.3, any::<prop::sample::Index>()))
        .prop_map(|(changes, cut)| Damage { changes, cut })
}

impl Damage {
    fn of(&self, bytes: &[u8]) -> Vec<u8> {
        let mut bytes = bytes.to_vec();
        for (at, byte) in &self.changes {
            let at = at.index(bytes.len());
            // digits become other digits half of the time, so that more than the first check is reached
            bytes[at] = match bytes[at] {
                b'0'..=b'9' if byte % 2 == 0 => b'0' + byte / 2 % 10,
                _ => *byte,
            };
        }
        if let Some(cut) = self.cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        bytes
    }
}

/// Imports it as the command does, short of writing; a panic fails the test.
fn import(path: &Path, given: &Given) {
    for mesh_values in [false, true] {
        if let Ok((mut study, sources)) = read(path, given) {
            let options = Options { mesh_values, thin: Some(5.0), ..Options::default() };
            if let Ok(selected) = select(&mut study, &options) {
                selected.record(path, &study, &sources, &options);
            }
        }
    }
}

/// Writes a study of several files, the one of index `which` damaged, and imports it.
fn import_folder(files: &[(String, Vec<u8>)], which: prop::sample::Index, damage: &Damage) {
    let folder = TempDir::new().unwrap();
    let which = which.index(files.len());
    for (k, (name, bytes)) in files.iter().enumerate() {
        let bytes = if k == which { damage.of(bytes) } else { bytes.clone() };
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }
    import(folder.path(), &Given::default());
}

fn import_file(name: &str, bytes: &[u8], damage: &Damage) {
    let folder = TempDir::new().unwrap();
    let sheet = "# vtk DataFile Version 3.0\ns\nASCII\nDATASET POLYDATA\nPOINTS 4 double\n0 0 0 6 0 0 0 6 0 6 6 0\nPOLYGONS 2 8\n3 0 1 2\n3 1 3 2\n";
    std::fs::write(folder.path().join("sheet.vtk"), sheet).unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, damage.of(bytes)).unwrap();
    let given = Given {
        mesh: Some(folder.path().join("sheet.vtk")),
        quantity: Some("lat".into()),
        ..Given::default()
    };
    import(&path, &given);
}

fn igb() -> Vec<u8> {
    let mut bytes = b"x:4 y:1 z:1 t:1 type:float systeme:little_endian facteur:1 zero:0 ".to_vec();
    bytes.resize(1023, b' ');
    bytes.push(0x0c);
    bytes.extend([1.0_f32, 2.0, 3.0, 4.0].iter().flat_map(|x| x.to_le_bytes()));
    bytes
}

const LOG: &str = "Site;X [mm];Y [mm];Z [mm];S1 [ms];S2 [ms];S3 [ms];Captured;Force [g]\r
A;0,5;0,2;0;600;280;;yes;12,5\r
A;0,5;0,2;0;600;270;;no;12,5\r
A;0,5;0,2;0;600;300;220;yes;12,5\r
";

/// The first two points of the study, which are enough.
fn small_carto() -> Vec<(String, Vec<u8>)> {
    let is_small = |name: &str| !(3..=12).any(|k| name.contains(&format!("_P{k}_")));
    carto::files().into_iter().filter(|(name, _)| is_small(name)).collect()
}

fn ensite_files() -> Vec<(String, Vec<u8>)> {
    vec![
        ("a/DxLandmarkGeo.xml".into(), ensite::surface("P-P Voltage (bi)").into_bytes()),
        ("a/DxL_1.csv".into(), ensite::cp1252(&ensite::dxl(1))),
        ("a/DxL_2.csv".into(), ensite::cp1252(&ensite::dxl(2))),
        ("b/Contact_Mapping_Model.xml".into(), ensite::surface("LAT (bi)").into_bytes()),
        ("b/Map_LAT_bi.csv".into(), ensite::MAP_X.into()),
        ("b/Wave_rov.csv".into(), ensite::WAVE_X.into()),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn carto(which in any::<prop::sample::Index>(), damage in damage()) {
        import_folder(&small_carto(), which, &damage);
    }

    #[test]
    fn ensite(which in any::<prop::sample::Index>(), damage in damage()) {
        import_folder(&ensite_files(), which, &damage);
    }

    #[test]
    fn openep_5(damage in damage()) {
        import_file("case.mat", &mat::openep(None), &damage);
    }

    #[test]
    fn openep_73(damage in damage()) {
        import_file("case.mat", include_bytes!("studies/openep_v73_texts.mat"), &damage);
    }

    #[test]
    fn opencarp(damage in damage()) {
        import_file("a.igb", &igb(), &damage);
        import_file("a.dat", b"1\n2.5\n-1\n4\n", &damage);
    }

    #[test]
    fn pacing_log(damage in damage()) {
        import_file("log.csv", LOG.as_bytes(), &damage);
    }

    #[test]
    fn anything(name in "[a-z]{1,3}\\.(csv|mat|igb|dat|mesh|zip|xml)", bytes in prop::collection::vec(any::<u8>(), 0..2000)) {
        import_file(&name, &bytes, &Damage { changes: vec![], cut: None });
    }
}
