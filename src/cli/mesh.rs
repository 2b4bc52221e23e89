//! `eplat mesh …`

use super::reading::ReadingArgs;
use super::voice::{note, stdout};
use crate::anatomy::{Coordinates, Opening, Openings, around, carry_fibres, middle, openings};
use crate::error::Failure;
use crate::manifold::{eigenpairs, maximin, random_maximin};
use crate::mesh::{
    self, Atrium, Data, Encoding, Format, REGION_NAMES, Reading, Surface, TriMesh, Units,
    continue_fibres,
};
use clap::Subcommand;
use std::io::Write;
use std::path::{Path, PathBuf};

/// `eplat mesh …`
#[derive(Debug, Subcommand)]
pub(super) enum Command {
    /// Print size, topology and quality of a mesh
    Info {
        /// Mesh: .vtp, .vtu, .vtk, .ply, .stl, .obj, .pts (openCARP) or .npz
        file: PathBuf,
        #[command(flatten)]
        reading: ReadingArgs,
    },
    /// Write a mesh in another format, in mm, with its data as far as the format has a place for them
    Convert {
        /// Mesh: .vtp, .vtu, .vtk, .ply, .stl, .obj, .pts (openCARP) or .npz
        input: PathBuf,
        /// File to write: an extension as above; openCARP's are three files, in µm
        output: PathBuf,
        #[command(flatten)]
        reading: ReadingArgs,
        /// Write .vtk, .ply and .stl as text instead of bytes
        #[arg(long)]
        ascii: bool,
    },
    /// Join equal vertices, drop degenerate and double triangles, orient all alike, keep the largest piece
    Repair {
        /// Mesh: .vtp, .vtu, .vtk, .ply, .stl, .obj, .pts (openCARP) or .npz
        input: PathBuf,
        /// File to write, in mm: an extension as above
        output: PathBuf,
        #[command(flatten)]
        reading: ReadingArgs,
        /// Vertices closer than this are joined, mm
        #[arg(long, default_value_t = 1e-6)]
        tolerance: f64,
    },
    /// Write a surface with fewer vertices, and say how far it moves and its fields are off; `run` does the
    /// same with a mesh of more than 100,000 vertices
    Decimate {
        /// Mesh: .vtp, .vtu, .vtk, .ply, .stl, .obj, .pts (openCARP) or .npz
        input: PathBuf,
        /// File to write, in mm: an extension as above
        output: PathBuf,
        #[command(flatten)]
        reading: ReadingArgs,
        /// Vertices that are left
        #[arg(long, value_name = "N", default_value_t = 20_000)]
        vertices: usize,
    },
    /// Compute the smallest eigenpairs of the Laplace–Beltrami operator, in the file's unit
    Basis {
        /// Mesh: .vtp, .vtu, .vtk, .ply, .stl, .obj, .pts (openCARP) or .npz
        file: PathBuf,
        #[command(flatten)]
        reading: ReadingArgs,
        /// Number of modes
        #[arg(long, default_value_t = 32)]
        modes: usize,
        /// File to write (.npz): eigenvalues (K), eigenfunctions (vertices of the largest piece, K)
        #[arg(long)]
        out: PathBuf,
    },
    /// Choose measurement sites spread over the surface, away from its openings
    Sites {
        /// Mesh: .vtp, .vtu, .vtk, .ply, .stl, .obj, .pts (openCARP) or .npz
        file: PathBuf,
        #[command(flatten)]
        reading: ReadingArgs,
        /// Number of sites
        #[arg(long, short, default_value_t = 10)]
        n: usize,
        /// Distance that sites keep from openings, mm
        #[arg(long, default_value_t = 6.0)]
        exclude: f64,
        /// The paper's rule instead: the best of 100,000 random designs
        #[arg(long)]
        random: bool,
        /// Seed of the design
        #[arg(long, default_value_t = 1)]
        seed: u64,
    },
    /// Write universal coordinates of a left atrium beside its other data: `uac_ls` from its right to its left wall,
    /// `uac_pa` from the mitral valve behind over the roof to the valve in front, both from 0 to 1
    Coordinates {
        /// Mesh: .vtp, .vtu, .vtk, .ply, .stl, .obj, .pts (openCARP) or .npz
        input: PathBuf,
        /// File to write, in mm: an extension as above
        output: PathBuf,
        #[command(flatten)]
        reading: ReadingArgs,
        /// Which opening is which, by the numbers of `mesh info`: mv=1,lspv=2,lipv=3,rspv=4,ripv=5 [default: found by their
        /// places]
        #[arg(long, value_name = "LIST")]
        openings: Option<String>,
    },
    /// Write a left atrium with the fibres of another one, carried over by universal coordinates
    Fibres {
        /// Mesh: .vtp, .vtu, .vtk, .ply, .stl, .obj, .pts (openCARP) or .npz
        input: PathBuf,
        /// File to write, in mm: an extension as above
        output: PathBuf,
        /// The atrium that has fibres, such as one of an atlas
        #[arg(long, value_name = "MESH")]
        from: PathBuf,
        #[command(flatten)]
        reading: ReadingArgs,
        /// Which opening is which, by the numbers of `mesh info`: mv=1,lspv=2,lipv=3,rspv=4,ripv=5 [default: found by their
        /// places]
        #[arg(long, value_name = "LIST")]
        openings: Option<String>,
        /// The same of the atrium that has fibres
        #[arg(long, value_name = "LIST")]
        from_openings: Option<String>,
        /// Unit of its coordinates: mm, cm, um or m [default: what the file says, or guessed from the size]
        #[arg(long, value_name = "UNIT")]
        from_units: Option<Units>,
    },
    /// Make the procedural left atrium
    Atrium {
        /// Length of the edges, mm
        #[arg(long, default_value_t = 1.5)]
        edge: f64,
        /// File to write: .vtp, .vtu, .vtk, .ply, .stl, .obj, .pts (openCARP) or .npz
        #[arg(long)]
        out: PathBuf,
    },
}

impl Command {
    pub(super) fn run(self) -> Result<(), Failure> {
        match self {
            Self::Info { file, reading } => info(&mesh::read(&file, reading.of(&file))?),
            Self::Convert { input, output, reading, ascii } => {
                Format::of(&output)?;
                let encoding = if ascii { Encoding::Ascii } else { Encoding::Binary };
                write_surface(&output, &mesh::read(&input, reading.of(&input))?, encoding)
            }
            Self::Repair { input, output, reading, tolerance } => {
                Format::of(&output)?;
                if !(0.0..=10.0).contains(&tolerance) {
                    return Err(Failure::usage(format_args!(
                        "--tolerance {tolerance}: expected 0 to 10 mm\nhelp: 0 joins only vertices that are equal"
                    )));
                }
                let reading = Reading { tolerance: Some(tolerance), ..reading.of(&input) };
                write_surface(&output, &mesh::read(&input, reading)?, Encoding::Binary)
            }
            Self::Decimate { input, output, reading, vertices } => {
                Format::of(&output)?;
                let surface = mesh::read(&input, reading.of(&input))?.decimated(vertices)?;
                write_surface(&output, &surface, Encoding::Binary)
            }
            Self::Basis { file, reading, modes, out } => {
                let surface = mesh::read(&file, reading.of(&file))?;
                print_notes(&surface);
                let units = surface.units;
                let basis = eigenpairs(&surface.mesh, modes)?.in_unit_of(1.0 / units.in_mm());
                basis.write_npz(&out)?;
                note(format_args!("wrote {} ({modes} modes, lengths in {units})", out.display()));
                Ok(())
            }
            Self::Sites { file, reading, n, exclude, random, seed } => {
                let surface = mesh::read(&file, reading.of(&file))?;
                print_notes(&surface);
                let choose = if random { random_maximin } else { maximin };
                let sites = choose(&surface.mesh, n, exclude, seed)?;
                print_sites(&surface, &sites)
            }
            Self::Coordinates { input, output, reading, openings } => {
                Format::of(&output)?;
                let mut surface = mesh::read(&input, reading.of(&input))?;
                let [first, second] = coordinates(&surface, openings.as_deref())?.at_vertices();
                surface.point_data.insert("uac_ls".into(), first.into());
                surface.point_data.insert("uac_pa".into(), second.into());
                write_surface(&output, &surface, Encoding::Binary)
            }
            Self::Fibres { input, output, from, reading, openings, from_openings, from_units } => {
                Format::of(&output)?;
                let mut surface = mesh::read(&input, reading.of(&input))?;
                let from_reading = ReadingArgs { units: from_units, piece: None };
                let other = mesh::read(&from, from_reading.of(&from))?;
                let Some((_, fibres)) = other.any_fibres() else {
                    return Err(Failure::new(format_args!(
                        "{} has no fibres: expected an array named fibre, fibres, fiber or fibers of three numbers\n\
                         help: give the mesh of an atlas that has them; `eplat mesh info` lists the arrays of a mesh",
                        from.display()
                    )));
                };
                print_notes(&other);
                let there = coordinates(&other, from_openings.as_deref())?;
                let here = coordinates(&surface, openings.as_deref())?;
                let mut carried = carry_fibres(&there, &fibres, &here);
                let n_continued = continue_fibres(&surface.mesh, &mut carried);
                surface.cell_data.insert("fibre".into(), carried.into());
                if n_continued > 0 {
                    note(format_args!(
                        "{n_continued} triangles take theirs from those around them: none could be carried there"
                    ));
                }
                write_surface(&output, &surface, Encoding::Binary)
            }
            Self::Atrium { edge, out } => atrium(edge, &out),
        }
    }
}

fn info(surface: &Surface) -> Result<(), Failure> {
    let mesh = &surface.mesh;
    let [low, high] = mesh.bounding_box();
    let mut out = stdout();
    let mut row =
        |name: &str, value: String| writeln!(out, "{name:<22}{value}").map_err(Failure::from);
    row(
        "vertices",
        format!("{} (of {} in the file)", mesh.n_vertices(), surface.n_source_vertices),
    )?;
    row("triangles", mesh.n_triangles().to_string())?;
    row("bounding box", format!("{low:.2?} to {high:.2?} mm"))?;
    row("area", format!("{:.1} cm²", mesh.area() / 100.0))?;
    row("mean edge", format!("{:.3} mm", mesh.mean_edge_length()))?;
    row("smallest angle", format!("{:.2}°", mesh.min_angle()))?;
    row("Euler characteristic", mesh.euler_characteristic().to_string())?;
    let openings = openings(mesh);
    row("openings", openings.len().to_string())?;
    for (number, ring) in (1..).zip(&openings) {
        let (length, middle) = (around(mesh, ring), place(mesh, ring));
        row(
            &format!("  {number}"),
            format!("{} edges, {length:.0} mm around, at {middle} mm", ring.len()),
        )?;
    }
    row("point data", or_none(&arrays(&surface.point_data)).into())?;
    if !surface.cell_data.is_empty() {
        row("cell data", arrays(&surface.cell_data))?;
    }
    print_notes(surface);
    Ok(())
}

/// The middle of an opening.
fn place(mesh: &TriMesh, ring: &[u32]) -> String {
    let [x, y, z] = middle(mesh, ring).into();
    format!("({x:.1}, {y:.1}, {z:.1})")
}

/// Universal coordinates, by these openings or those that are found; tells which is which.
fn coordinates(surface: &Surface, given: Option<&str>) -> Result<Coordinates, Failure> {
    let mesh = &surface.mesh;
    let openings = match given {
        Some(given) => Openings::named(mesh, given)?,
        None => Openings::guess(mesh)?,
    };
    let one = |opening: Opening| format!("{opening} at {}", place(mesh, openings.of(opening)));
    let all: Vec<String> = Opening::ALL.into_iter().map(one).collect();
    let said = if given.is_some() { "as said" } else { "by their places (another: --openings)" };
    note(format_args!("openings, {said}: {} mm", all.join(", ")));
    Ok(Coordinates::new(mesh, &openings)?)
}

/// Names of arrays, with the width of those that are not scalars.
fn arrays(data: &Data) -> String {
    let name = |(name, array): (&String, &mesh::Array)| match array.width() {
        1 => name.clone(),
        width => format!("{name} ({width})"),
    };
    data.iter().map(name).collect::<Vec<_>>().join(", ")
}

/// Sites as the first columns of a table of measurements: vertex and x, y, z as in the file.
fn print_sites(surface: &Surface, sites: &[u32]) -> Result<(), Failure> {
    let mut out = stdout();
    writeln!(out, "site,vertex,x,y,z")?;
    for (site, &vertex) in sites.iter().enumerate() {
        let [x, y, z] = surface.mesh.vertices()[vertex as usize].map(|x| x / surface.units.in_mm());
        let source = surface.source_vertex[vertex as usize];
        writeln!(out, "{site},{source},{x},{y},{z}")?;
    }
    Ok(())
}

fn or_none(list: &str) -> &str {
    if list.is_empty() { "none" } else { list }
}

fn print_notes(surface: &Surface) {
    for said in &surface.notes {
        note(said);
    }
}

fn write_surface(path: &Path, surface: &Surface, encoding: Encoding) -> Result<(), Failure> {
    print_notes(surface);
    let left_out = surface.write(path, encoding)?;
    if !left_out.is_empty() {
        note(format_args!(
            "left out, as the format has no place for them: {}",
            left_out.join(", ")
        ));
    }
    let units = if Format::of(path)? == Format::Carp { "um" } else { "mm" };
    note(format_args!(
        "wrote {} ({} vertices, {units})",
        path.display(),
        surface.mesh.n_vertices()
    ));
    Ok(())
}

fn atrium(edge: f64, out: &Path) -> Result<(), Failure> {
    Format::of(out)?;
    let range = Atrium::EDGE_RANGE;
    if !range.contains(&edge) {
        return Err(Failure::usage(format_args!(
            "--edge {edge}: expected {} to {} mm\nhelp: 1.5 gives about 5,200 vertices, 0.3 about 124,000",
            range.start(),
            range.end()
        )));
    }
    let surface = Surface::left_atrium(edge);
    write_surface(out, &surface, Encoding::Binary)?;
    let regions = surface.point_data["region"].values();
    for (region, name) in (0_u8..).zip(REGION_NAMES) {
        let n = regions.iter().filter(|r| r.total_cmp(&f64::from(region)).is_eq()).count();
        note(format_args!("region {region}: {name}, {n} vertices"));
    }
    Ok(())
}
