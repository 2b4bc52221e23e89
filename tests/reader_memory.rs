//! How much memory the readers take, whatever a file claims: damaged files of every format, counted by the allocator.
//!
//! One test alone in its program, so that nothing else is counted.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a test")]

#[path = "support/carto.rs"]
mod carto;
#[path = "support/encodings.rs"]
mod encodings;
#[path = "support/mat.rs"]
mod mat;

use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use eplat::import::{Given, read};
use eplat::mesh;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use peak_alloc::PeakAlloc;
use rand::{Rng, RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use tempfile::TempDir;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

#[global_allocator]
static COUNTED: PeakAlloc = PeakAlloc;

/// Bytes that a reader may take for each byte of a file.
const MOST: f64 = 10.0;
/// What it may take beside, for any file: messages, lists of names, the test's own folder.
const BESIDE: f64 = 256.0 * 1024.0;
/// Damages of each file.
const DAMAGES: usize = 60;

/// What `of` takes at its peak beyond what is held now.
fn peak<T>(of: impl FnOnce() -> T) -> f64 {
    COUNTED.reset_peak_usage();
    let before = COUNTED.current_usage();
    drop(of());
    COUNTED.peak_usage().saturating_sub(before) as f64
}

/// Other bytes, other digits, all bits set in a row as of a huge count, or an early end.
fn damaged(bytes: &[u8], rng: &mut impl Rng) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    for _ in 0..rng.random_range(1..6) {
        // half of them where headers are
        let reach = if rng.random() { bytes.len().min(600) } else { bytes.len() };
        let at = rng.random_range(0..reach);
        match bytes[at] {
            b'0'..=b'9' => bytes[at] = b'0' + rng.random_range(0..10u8),
            _ if rng.random() => bytes[at] = rng.random(),
            _ => bytes.iter_mut().skip(at).take(8).for_each(|byte| *byte = 0xff),
        }
    }
    if rng.random_range(0..4) == 0 {
        bytes.truncate(rng.random_range(0..bytes.len()));
    }
    bytes
}

/// A digit more in each number of the first lines: counts that the file cannot hold.
fn longer(bytes: &[u8]) -> Vec<Vec<u8>> {
    let ends = (1..bytes.len().min(600))
        .filter(|i| bytes[i - 1].is_ascii_digit() && !bytes[*i].is_ascii_digit());
    let put = |at: usize| [&bytes[..at], b"99999", &bytes[at..]].concat();
    ends.map(put).collect()
}

/// Damages `file`, one of those that `path` stands for, and reads; the most that was taken of what is allowed.
fn worst(path: &Path, file: &Path, rng: &mut ChaCha8Rng, read: &dyn Fn(&Path)) -> (f64, f64) {
    let bytes = fs::read(file).unwrap();
    let n_others =
        mesh::files(path).iter().filter(|own| *own != file).map(|own| size(own)).sum::<f64>();
    let whole = peak(|| read(path)) / (bytes.len() as f64 + n_others);
    let mut worst = 0.0f64;
    let hostile = (0..DAMAGES).map(|_| damaged(&bytes, rng)).collect::<Vec<_>>();
    for hostile in hostile.into_iter().chain(longer(&bytes)) {
        fs::write(file, &hostile).unwrap();
        let n = hostile.len() as f64 + n_others;
        drop(hostile);
        worst = worst.max(peak(|| read(path)) / (MOST * n + BESIDE));
    }
    fs::write(file, bytes).unwrap();
    (whole, worst)
}

fn size(path: &Path) -> f64 {
    fs::metadata(path).map_or(0.0, |file| file.len() as f64)
}

/// The triangulation of an OpenEP file.
fn large_surface() -> mat::Value {
    let mesh = mesh::left_atrium(2.5).mesh;
    let corners = |t: &[u32; 3]| t.iter().map(|v| f64::from(v + 1)).collect();
    let places = mat::Value::Rows(mesh.vertices().iter().map(|p| p.to_vec()).collect());
    let corners = mat::Value::Rows(mesh.triangles().iter().map(corners).collect());
    mat::Value::Struct(vec![("X", places), ("Triangulation", corners)])
}

/// Studies of one file each, with many rows.
fn studies(folder: &Path) -> Vec<PathBuf> {
    let row = |i: usize| {
        let (site, s2, force) = (i / 8, 300 - 10 * (i % 8), i % 30);
        format!("S{site};{site},5;0;0;600;{s2};yes;{force},5\n")
    };
    let log = (0..4000).map(row).collect::<Vec<_>>().concat();
    let log = format!("site;x [mm];y [mm];z [mm];S1 [ms];S2 [ms];captured;force [g]\n{log}");
    let number = |i: usize| format!("{}.5\n", i % 977);
    let numbers = (0..20_000).map(number).collect::<Vec<_>>().concat();
    let mut igb = b"x:20000 y:1 z:1 t:1 type:float systeme:little_endian ".to_vec();
    igb.resize(1024, b' ');
    igb.extend((0..20_000).flat_map(|i| (i as f32).to_le_bytes()));
    let all: [(&str, Vec<u8>); 5] = [
        ("log.csv", log.into()),
        ("map.dat", numbers.into()),
        ("map.igb", igb),
        ("case.mat", mat::openep(Some(large_surface()))),
        ("new.mat", include_bytes!("studies/openep_v73_texts.mat").to_vec()),
    ];
    let written = |(name, bytes): (&str, Vec<u8>)| {
        fs::write(folder.join(name), bytes).unwrap();
        folder.join(name)
    };
    all.into_iter().map(written).collect()
}

fn zlib(bytes: &[u8]) -> Vec<u8> {
    let mut packed = ZlibEncoder::new(vec![], Compression::default());
    packed.write_all(bytes).unwrap();
    packed.finish().unwrap()
}

/// A surface whose points are these bytes, in one block.
fn packed_vtp(bytes: &[u8]) -> Vec<u8> {
    let (n, packed) = (u32::try_from(bytes.len()).unwrap(), zlib(bytes));
    let head = format!(
        "<VTKFile type=\"PolyData\" header_type=\"UInt32\" compressor=\"vtkZLibDataCompressor\"><PolyData>\
         <Piece NumberOfPoints=\"{}\"><Points><DataArray type=\"Float32\" NumberOfComponents=\"3\" \
         format=\"appended\" offset=\"0\"/></Points></Piece></PolyData><AppendedData encoding=\"raw\">_",
        n / 12
    );
    let lengths = [1, n, 0, u32::try_from(packed.len()).unwrap()].map(u32::to_le_bytes).concat();
    [head.as_bytes(), &lengths, &packed, b"</AppendedData></VTKFile>"].concat()
}

/// A MATLAB file of `n` variables that hold these bytes.
fn packed_mat(bytes: &[u8], n: usize) -> Vec<u8> {
    let tag =
        |kind: u32, n: usize| [kind, u32::try_from(n).unwrap()].map(u32::to_le_bytes).concat();
    let packed = zlib(&[&tag(14, bytes.len())[..], bytes].concat());
    let mut head = b"MATLAB 5.0 MAT-file".to_vec();
    head.resize(124, b' ');
    let variables = [tag(15, packed.len()), packed].concat().repeat(n);
    [&head[..], &[0, 1], b"IM", &variables].concat()
}

/// What is compressed grows by less than its limit allows: arrays of zeros that zlib packs a thousandfold.
fn bombs(folder: &Path) {
    let zeros = vec![0_u8; 64 << 20];
    for (name, inside, growth) in [("z.npz", "points.npy", 32.0), ("z.zip", "1-LA.mesh", 64.0)] {
        let path = folder.join(name);
        let mut archive = ZipWriter::new(fs::File::create(&path).unwrap());
        let packed = SimpleFileOptions::default().compression_method(CompressionMethod::Deflated);
        // of a study, the others are as they should be
        let others =
            carto::files().into_iter().filter(|(file, _)| name == "z.zip" && file != inside);
        for (file, bytes) in others.chain([(inside.to_owned(), zeros.clone())]) {
            archive.start_file(file, packed).unwrap();
            archive.write_all(&bytes).unwrap();
        }
        archive.finish().unwrap();
        let n = size(&path);
        let taken = peak(|| match name {
            "z.npz" => mesh::read(&path, None).is_err(),
            _ => read(&path, &Given::default()).is_err(),
        });
        // a vector that grows has room for twice what is in it
        let allowed = 2.0 * (growth * n).max(f64::from(1 << 20)) + MOST * n + BESIDE;
        println!("{name:10} {:5.1} times the file", taken / n);
        assert!(taken > growth * n / 4.0, "{name} is not read: {taken}");
        assert!(taken < allowed, "{name} of {n} bytes takes {taken}, {allowed} are allowed");
    }
    // what zlib packs inside of a file: of a mesh, and of MATLAB
    for (name, bytes, growth) in [
        ("z.vtp", packed_vtp(&zeros), 32.0),
        ("z.mat", packed_mat(&zeros, 1), 200.0),
        // each of them is small
        ("many.mat", packed_mat(&zeros[..1_000_000], 400), 200.0),
    ] {
        let (path, n) = (folder.join(name), bytes.len() as f64);
        fs::write(&path, bytes).unwrap();
        let taken = peak(|| match name {
            "z.vtp" => mesh::read(&path, None).is_err(),
            _ => read(&path, &Given::default()).is_err(),
        });
        let allowed = 2.0 * (growth * n).max(f64::from(1 << 20)) + MOST * n + BESIDE;
        println!("{name:10} {:5.1} times the file", taken / n);
        let inflated = if name == "many.mat" { 4e8 } else { zeros.len() as f64 };
        assert!(inflated > 1.5 * allowed, "{name} is no bomb");
        assert!(taken < allowed, "{name} of {n} bytes takes {taken}, {allowed} are allowed");
    }
    // many arrays that name the same appended bytes
    let array = "<DataArray type=\"UInt8\" Name=\"NAME\" format=\"appended\" offset=\"0\"/>";
    let arrays: String = (0..2000).map(|i| array.replace("NAME", &format!("a{i}"))).collect();
    let n = 100_000_u32;
    let points = "<Points><DataArray type=\"Float32\" NumberOfComponents=\"3\" format=\"appended\" offset=\"0\"/></Points>";
    let head = format!(
        "<VTKFile type=\"PolyData\" header_type=\"UInt32\"><PolyData><Piece NumberOfPoints=\"{n}\"><PointData>{arrays}</PointData>{points}</Piece></PolyData><AppendedData encoding=\"raw\">_"
    );
    let bytes =
        [head.as_bytes(), &n.to_le_bytes(), &vec![1; n as usize], b"</AppendedData></VTKFile>"]
            .concat();
    let path = folder.join("same.vtp");
    fs::write(&path, &bytes).unwrap();
    let taken = peak(|| mesh::read(&path, None).is_err());
    println!("{:10} {:5.1} times the file", "same.vtp", taken / bytes.len() as f64);
    assert!(taken < MOST * bytes.len() as f64 + 2.0 * 1024.0 * 1024.0, "{taken}");
}

#[test]
fn no_reader_takes_more_than_ten_times_the_file() {
    let folder = TempDir::new().unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(18);
    let mut failed = vec![];
    let mut judge = |name: &str, (whole, worst): (f64, f64)| {
        println!(
            "{name:10} {whole:5.1} times the file; damaged at most {:3.0} % of what is allowed",
            100.0 * worst
        );
        assert!(whole > 0.5, "{name} is not read");
        if worst > 1.0 {
            failed.push(name.to_owned());
        }
    };
    let read_mesh = |path: &Path| drop(mesh::read(path, None));
    for path in encodings::written(mesh::left_atrium(2.0).mesh, folder.path()) {
        for file in mesh::files(&path) {
            let name = file.file_name().unwrap().to_string_lossy().into_owned();
            judge(&name, worst(&path, &file, &mut rng, &read_mesh));
        }
    }
    let read_study = |path: &Path| {
        // what the values of a bare file are must be said; an export tells it, and refuses to be told
        let is_bare = path.extension().is_none_or(|e| e != "mat");
        let quantity = is_bare.then(|| "lat".into());
        let given = Given { mesh: None, quantity, ..Given::default() };
        drop(read(path, &given));
    };
    for path in studies(folder.path()) {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        judge(&name, worst(&path, &path, &mut rng, &read_study));
    }
    // a file of a study of CARTO, the largest, beside the others
    let carto_folder = folder.path().join("carto");
    fs::create_dir(&carto_folder).unwrap();
    for (name, bytes) in carto::files() {
        let path = carto_folder.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    }
    let all: f64 = carto::files().iter().map(|(_, bytes)| bytes.len() as f64).sum();
    let taken = peak(|| drop(read(&carto_folder, &Given::default())));
    judge("CARTO", (taken / all, taken / (MOST * all + BESIDE)));
    bombs(folder.path());
    assert!(failed.is_empty(), "{failed:?} take more than ten times their size");
    // a program that counts nothing would pass as well
    let seen = peak(|| vec![1u8; 1 << 20]);
    assert!(seen >= f64::from(1 << 20), "{seen}");
}
