//! Shows  how measured data become tables for `eplat loop`: S1S2 recordings of an optically mapped heart, and the
//!        arrival times on a clinical left atrium.
//! Run    `cargo run --release --example measured_tables -- restitution cos_s1s2.csv train.csv`
//!        `cargo run --release --example measured_tables -- lat la_lat.vtk train.csv`
//! Expect one row per site and recording; or 420 sites far apart, each with its patch as a fold, and the earliest
//!        of them as the source of activation.

use std::error::Error;
use std::fmt::Write as _;
use std::path::Path;

use eplat::manifold::Geodesic;
use eplat::mesh::{self, Units};

/// Sites of the thinned map.
const SITES: usize = 420;
/// Patches that are left out as a whole.
const PATCHES: usize = 12;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [what, from, to] = &arguments[..] else {
        return Err("expected: restitution|lat FROM TO.csv".into());
    };
    let table = match what.as_str() {
        "restitution" => restitution(Path::new(from))?,
        "lat" => arrival_times(Path::new(from))?,
        _ => return Err(format!("expected restitution or lat, got {what}").into()),
    };
    std::fs::write(to, table)?;
    Ok(())
}

/// Columns of the recordings that are kept.
const KEPT: [&str; 5] = ["rec", "S1", "S2", "amp_s1", "amp_s2"];

/// One row per site and recording; the site is the pixel. `run_order` is made up: a decoy.
fn restitution(path: &Path) -> Result<String, Box<dyn Error>> {
    let mut reader = csv::Reader::from_path(path)?;
    let header = reader.headers()?.clone();
    let at = |name: &str| {
        header.iter().position(|h| h == name).ok_or_else(|| format!("no column {name}"))
    };
    let (row, column, recording) = (at("row")?, at("col")?, at("rec")?);
    let kept = KEPT.iter().map(|name| at(name)).collect::<Result<Vec<_>, _>>()?;
    let mut text = format!("site,{},run_order\n", KEPT.join(","));
    let mut recordings: Vec<String> = vec![];
    for record in reader.records() {
        let record = record?;
        if !recordings.contains(&record[recording].to_owned()) {
            recordings.push(record[recording].into());
        }
        let order = recordings.iter().position(|r| *r == record[recording]).unwrap_or(0);
        let cells: Vec<&str> = kept.iter().map(|c| &record[*c]).collect();
        let run = [5, 2, 8, 1, 6, 3, 7, 4][order % 8];
        writeln!(text, "{}_{},{},{run}", &record[row], &record[column], cells.join(","))?;
    }
    Ok(text)
}

/// Arrival times at sites as far apart as can be, in patches about the first of them.
fn arrival_times(path: &Path) -> Result<String, Box<dyn Error>> {
    let surface = mesh::read(path, Units::Mm)?;
    let lat = surface.scalar("LAT").or_else(|| surface.scalar("lat"));
    let lat = lat.ok_or("no point data LAT")?;
    let geodesic = Geodesic::new(&surface.mesh)?;
    let measured = |v: &usize| lat[*v].is_finite();
    let earliest = (0..lat.len()).filter(measured).min_by(|a, b| lat[*a].total_cmp(&lat[*b]));
    let mut sites = vec![earliest.ok_or("every LAT is missing")?];
    let mut to_sites = vec![f64::INFINITY; lat.len()];
    let mut patch = vec![0; lat.len()];
    for k in 0..SITES {
        let to_this = geodesic.distance(&[sites[k] as u32]);
        for (v, d) in to_this.into_iter().enumerate() {
            if d < to_sites[v] {
                to_sites[v] = d;
                if k < PATCHES {
                    patch[v] = k;
                }
            }
        }
        let next = (0..lat.len()).filter(measured);
        let next = next.max_by(|a, b| to_sites[*a].total_cmp(&to_sites[*b]));
        sites.extend(next.filter(|_| k + 1 < SITES));
    }
    let in_file = |v: usize| surface.source_vertex[v];
    let mut text = "site,vertex,source,fold,lat\n".to_owned();
    for (k, v) in sites.iter().enumerate() {
        let (vertex, source) = (in_file(*v), in_file(sites[0]));
        writeln!(text, "{k},{vertex},{source},P{},{}", patch[*v], lat[*v])?;
    }
    Ok(text)
}
