//! Points of EnSite. Precision writes `DxL_n.csv`, in which a row is an attribute and a column a point;
//! EnSite X writes `Map_*.csv`, a row per point.

use std::collections::BTreeMap;

use crate::import::bundle::{Bundle, base_of, folder_of};
use crate::import::error::shortened;
use crate::import::{ImportError, Map, Point, Site};
use crate::table::decode;

/// Adds the points of the folder to the map.
///
/// # Errors
/// A file that is there and damaged.
pub(super) fn add(map: &mut Map, folder: &str, bundle: &mut Bundle) -> Result<(), ImportError> {
    let own = |name: &String| folder_of(name) == folder;
    let named = |name: &String, start: &str| base_of(name).to_ascii_lowercase().starts_with(start);
    let files: Vec<String> = bundle.with_extension("csv").into_iter().filter(own).collect();
    let dxl: Vec<&String> = files.iter().filter(|name| named(name, "dxl")).collect();
    let maps: Vec<&String> = files.iter().filter(|name| named(name, "map_")).collect();
    if !dxl.is_empty() {
        return add_precision(map, &dxl, bundle);
    }
    let rate = rate(&files, bundle);
    let mut points: BTreeMap<String, Point> = BTreeMap::new();
    for file in maps {
        let text = decode(&bundle.read(file)?).into_owned();
        add_x(map, file, &text, rate, &mut points)?;
    }
    map.points.extend(points.into_values().filter(|point| !point.readings.is_empty()));
    Ok(())
}

/// A table with a name for each attribute.
type Attributes<'t> = BTreeMap<String, Vec<&'t str>>;

fn number(attributes: &Attributes, name: &str, k: usize) -> Option<f64> {
    let cell = attributes.get(name)?.get(k)?.trim();
    cell.parse::<f64>().ok().filter(|x| x.is_finite())
}

fn place(attributes: &Attributes, k: usize) -> Option<[f64; 3]> {
    let [x, y, z] = ["roving x", "roving y", "roving z"].map(|name| number(attributes, name, k));
    Some([x?, y?, z?])
}

/// The files of Precision, in the order of their numbers.
fn add_precision(map: &mut Map, files: &[&String], bundle: &mut Bundle) -> Result<(), ImportError> {
    let mut read: Vec<(usize, String, String)> = vec![];
    let mut n_files = files.len();
    for file in files {
        let text = decode(&bundle.read(file)?).into_owned();
        // "This is file 1 of 2 for map,NAME"
        let line = text.lines().find(|line| line.contains("This is file")).unwrap_or_default();
        let numbers: Vec<usize> =
            line.split([' ', ',']).filter_map(|word| word.parse().ok()).collect();
        if let Some((_, name)) = line.split_once(',').filter(|(_, name)| !name.trim().is_empty()) {
            map.name = name.trim().trim_end_matches(',').into();
        }
        n_files = numbers.get(1).copied().unwrap_or(n_files);
        read.push((numbers.first().copied().unwrap_or(usize::MAX), (*file).clone(), text));
    }
    read.sort();
    if read.len() != n_files {
        map.remarks.push(format!("{} of {n_files} files DxL_n.csv are there", read.len()));
    }
    for (_, file, text) in &read {
        add_file(map, file, text)?;
    }
    Ok(())
}

/// One file of Precision: lines `attribute:,value,value,…` from `pt number:` to `Seg data len:`.
fn add_file(map: &mut Map, file: &str, text: &str) -> Result<(), ImportError> {
    let lines = text.lines().skip_while(|line| !line.starts_with("pt number:"));
    let lines = lines.take_while(|line| !line.starts_with("Seg data len:"));
    let attribute = |line: &'_ str| -> Option<(String, usize)> {
        let (name, _) = line.split_once(',')?;
        Some((name.trim().trim_end_matches(':').to_owned(), name.len() + 1))
    };
    let mut attributes = Attributes::new();
    for line in lines {
        if let Some((name, from)) = attribute(line) {
            attributes.insert(name, line[from..].split(',').collect());
        }
    }
    let Some(names) = attributes.get("pt number").cloned() else {
        return Err(ImportError::Unusable {
            file: file.into(),
            what: format!(
                "no line `pt number:`; the file begins with `{}`",
                shortened(text.lines().next().unwrap_or_default())
            ),
            help: "this is no DxL file of EnSite Precision; export the map's contact mapping again"
                .into(),
        });
    };
    for (k, name) in names.iter().enumerate().filter(|(_, name)| !name.trim().is_empty()) {
        if number(&attributes, "utilized", k).is_some_and(|used| used < 0.5) {
            map.leave_out("points that the study does not use");
            continue;
        }
        let Some(place) = place(&attributes, k) else {
            map.leave_out("points without a place");
            continue;
        };
        let mut point = Point::at(format!("P{}", name.trim()), Site::At(place));
        point.measure("bipolar", number(&attributes, "peak2peak", k));
        // both in s
        let lat = number(&attributes, "rov LAT", k).zip(number(&attributes, "ref LAT", k));
        point.measure("lat", lat.map(|(at, reference)| milliseconds(at - reference)));
        if point.readings.is_empty() {
            map.leave_out("points without any measurement");
        } else {
            map.points.push(point);
        }
    }
    Ok(())
}

/// Seconds as ms, to the microsecond.
fn milliseconds(seconds: f64) -> f64 {
    (seconds * 1e6).round() / 1e3
}

/// Samples per second, from the first file that says so in its first lines.
fn rate(files: &[String], bundle: &mut Bundle) -> Option<f64> {
    files.iter().find_map(|file| {
        let head = bundle.head(file, 20_000).ok()?;
        let text = decode(&head).into_owned();
        let line = text.lines().find(|line| {
            let line = line.to_ascii_lowercase();
            line.contains("sampl") && (line.contains("rate") || line.contains("freq"))
        })?;
        let words = line.split([',', ':', ' ', '\t']);
        words.filter_map(|word| word.parse::<f64>().ok()).find(|rate| *rate >= 100.0)
    })
}

/// One table of EnSite X: a header line that names `roving x`, and a line per point.
fn add_x(
    map: &mut Map,
    file: &str,
    text: &str,
    rate: Option<f64>,
    points: &mut BTreeMap<String, Point>,
) -> Result<(), ImportError> {
    let mut lines = text.lines().skip_while(|line| !line.contains("roving x"));
    let Some(header) = lines.next() else {
        return Err(ImportError::Unusable {
            file: file.into(),
            what: "no header line with `roving x`".into(),
            help: "this is no table of points of EnSite X; export the map again".into(),
        });
    };
    let names: Vec<&str> = header.split(',').map(str::trim).collect();
    let mut is_without_rate = false;
    for line in lines.take_while(|line| !line.trim_start().starts_with("EOF")) {
        let cells: Vec<&str> = line.split(',').collect();
        if cells.len() < names.len().min(4) {
            continue;
        }
        let own: Attributes = names
            .iter()
            .zip(&cells)
            .map(|(name, cell)| ((*name).to_owned(), vec![*cell]))
            .collect();
        let cell = |name: &str| own.get(name).map_or("", |cells| cells[0].trim());
        if ["0", "false", "no"].contains(&cell("utilized").to_ascii_lowercase().as_str()) {
            map.leave_out("points that the study does not use");
            continue;
        }
        let Some(place) = place(&own, 0) else {
            map.leave_out("points without a place");
            continue;
        };
        let name = format!("P{}", cell("(Point #)"));
        let point = points.entry(name.clone()).or_insert_with(|| Point::at(name, Site::At(place)));
        let has =
            |point: &Point, protocol: &str| point.readings.iter().any(|r| r.protocol == protocol);
        let value = |name: &str| number(&own, name, 0);
        if !has(point, "bipolar") {
            point.measure("bipolar", value("pp_Valong"));
        }
        if !has(point, "unipolar") {
            point.measure("unipolar", value("pp_Vmax"));
        }
        // both ticks are shifted by `adjTime (ms)`, so that their difference is not
        let ticks = value("Rov Tick 1").zip(value("Ref Tick"));
        let lat = match (ticks, rate) {
            (Some((at, reference)), Some(rate)) => Some((at - reference) * 1000.0 / rate),
            (ticks, _) => {
                is_without_rate |= ticks.is_some();
                value("LAT")
            }
        };
        if !has(point, "lat") {
            point.measure("lat", lat);
        }
        if !point.cells.contains_key("force_g") {
            point.know("force_g", value("force (g)")); // `invalid` is no number
        }
        let electrodes = cell("Electrodes");
        if !electrodes.is_empty() {
            point.cells.insert("electrodes".into(), electrodes.into());
        }
    }
    if is_without_rate {
        map.remarks.push(format!(
            "{file}: no sample rate is known, so LAT is from the column `LAT` (ms), if there is one"
        ));
    }
    Ok(())
}
