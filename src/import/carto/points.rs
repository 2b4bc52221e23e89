//! The points of a map of CARTO 3: `NAME_car.txt`, `NAME_Points_Export.xml` and the files that each
//! point has of its own.

use std::collections::BTreeMap;

use roxmltree::{Document, Node};

use super::{MISSING, valid};
use crate::import::bundle::Bundle;
use crate::import::{ImportError, Map, Point, Site};
use crate::table::decode;

/// What the study file says of the points of a map.
#[derive(Clone, Debug, Default)]
pub(super) struct Listed {
    /// Place of each point, mm, by number.
    pub(super) places: BTreeMap<String, [f64; 3]>,
    /// Names of its tags.
    pub(super) tags: BTreeMap<String, Vec<String>>,
}

/// A tag of points that have no electrogram.
const PLACE_ALONE: &str = "Location Only";

/// Adds the points of the map to it.
///
/// # Errors
/// A damaged list of points. What is missing or damaged of one point is a remark.
pub(super) fn add(
    map: &mut Map,
    folder: &str,
    listed: &Listed,
    bundle: &mut Bundle,
) -> Result<(), ImportError> {
    let rows = match bundle.find(&format!("{folder}{}_car.txt", map.name)) {
        Some(file) => car_rows(&file, &decode(&bundle.read(&file)?))?,
        None => listed.places.iter().map(|(id, place)| (id.clone(), Row::at(*place))).collect(),
    };
    let files = point_files(&map.name, folder, bundle)?;
    let mut missing = Missing::default();
    for (id, row) in rows {
        let mut point = Point::at(format!("P{id}"), Site::At(row.place));
        let tags = listed.tags.get(&id).cloned().unwrap_or_default();
        if tags.iter().any(|tag| tag == PLACE_ALONE) {
            map.leave_out("points tagged `Location Only`");
            continue;
        }
        if !tags.is_empty() {
            point.cells.insert("tag".into(), tags.join(" + "));
        }
        let own = files.get(&id).and_then(|file| bundle.find(&format!("{folder}{file}")));
        let read = own.map(|file| exported(&mut point, &row, &file, map, bundle));
        if !matches!(read, Some(Ok(()))) {
            match read {
                Some(Err(error)) => missing.damaged.push(super::first_line(&error)),
                _ => missing.exports += 1,
            }
            point.measure("bipolar", valid(row.bipolar));
            point.measure("unipolar", valid(row.unipolar));
            point.measure("lat", valid(row.lat));
            point.know("impedance_ohm", valid(row.impedance));
        }
        let force = format!("{folder}{}_{}_ContactForce.txt", map.name, point.name);
        match bundle.find(&force) {
            Some(file) => {
                let text = decode(&bundle.read(&file)?).into_owned();
                point.know("force_g", force_at_zero(&text));
            }
            None => missing.forces += 1,
        }
        if point.readings.is_empty() {
            map.leave_out("points without any measurement");
        } else {
            map.points.push(point);
        }
    }
    missing.say(map);
    Ok(())
}

/// Files of points that are not there, or cannot be read.
#[derive(Default)]
struct Missing {
    exports: usize,
    /// What is wrong with those that are there and cannot be read.
    damaged: Vec<String>,
    forces: usize,
}

impl Missing {
    fn say(&self, map: &mut Map) {
        let n = map.points.len();
        if self.exports > 0 {
            map.remarks.push(format!(
                "{} points have no file of their own (NAME_P*_Point_Export.xml): their values are those of NAME_car.txt, and no window of interest is known",
                self.exports
            ));
        }
        if let Some(first) = self.damaged.first() {
            map.remarks.push(format!(
                "the own files of {} points cannot be read ({first}): their values are those of NAME_car.txt",
                self.damaged.len()
            ));
        }
        if self.forces > 0 && self.forces < n {
            map.remarks.push(format!("{} of {n} points have no contact force file", self.forces));
        } else if self.forces > 0 {
            map.remarks.push("no contact force was exported".into());
        }
    }
}

/// A line of `NAME_car.txt`.
#[derive(Clone, Copy, Debug)]
struct Row {
    place: [f64; 3],
    unipolar: f64,
    bipolar: f64,
    lat: f64,
    impedance: f64,
}

impl Row {
    fn at(place: [f64; 3]) -> Self {
        Self { place, unipolar: MISSING, bipolar: MISSING, lat: MISSING, impedance: MISSING }
    }
}

/// The lines that begin with P: number, place, unipolar and bipolar voltage, LAT, impedance.
fn car_rows(file: &str, text: &str) -> Result<Vec<(String, Row)>, ImportError> {
    let mut rows = vec![];
    for (number, line) in text.lines().enumerate().skip(1) {
        let cells: Vec<&str> = line.split('\t').map(str::trim).collect();
        if cells[0] != "P" {
            continue;
        }
        let cell = |k: usize| cells.get(k).and_then(|cell| cell.parse::<f64>().ok());
        let place = || Some([cell(4)?, cell(5)?, cell(6)?]);
        let row = || {
            let place = place()?;
            let [unipolar, bipolar, lat, impedance] = [cell(10)?, cell(11)?, cell(12)?, cell(13)?];
            Some(Row { place, unipolar, bipolar, lat, impedance })
        };
        let row = row().ok_or_else(|| {
            let expected = "a point: P, …, number, …, x, y, z, three angles, unipolar, bipolar, LAT, impedance, …, with tabs between";
            ImportError::line(file, number + 1, expected, line)
        })?;
        rows.push((cells[2].to_owned(), row));
    }
    Ok(rows)
}

/// The file of each point, by its number.
fn point_files(
    map: &str,
    folder: &str,
    bundle: &mut Bundle,
) -> Result<BTreeMap<String, String>, ImportError> {
    let Some(file) = bundle.find(&format!("{folder}{map}_Points_Export.xml")) else {
        return Ok(BTreeMap::new());
    };
    let bytes = bundle.read(&file)?;
    let text = decode(&bytes);
    let document = super::xml(&file, &text)?;
    let points = document.descendants().filter(|node| node.has_tag_name("Point"));
    let pair =
        |node: Node| Some((node.attribute("ID")?.into(), node.attribute("File_Name")?.into()));
    Ok(points.filter_map(pair).collect())
}

/// What stands in the file of a point: annotations, window of interest, voltages, impedances, catheter.
/// Nothing is taken of a file that cannot be read.
fn exported(
    point: &mut Point,
    row: &Row,
    file: &str,
    map: &mut Map,
    bundle: &mut Bundle,
) -> Result<(), ImportError> {
    let bytes = bundle.read(file)?;
    let text = decode(&bytes);
    let document = super::xml(file, &text)?;
    let voltage = |name: &str| number(&document, "Voltages", name).and_then(valid);
    point.measure("bipolar", voltage("Bipolar").or(valid(row.bipolar)));
    point.measure("unipolar", voltage("Unipolar").or(valid(row.unipolar)));
    match lat(&document) {
        Lat::At(ms) => point.measure("lat", Some(ms)),
        Lat::NotAnnotated => map.leave_out("LAT of points without an annotation"),
        Lat::OutsideWindow => map.leave_out("LAT outside the window of interest"),
    }
    point.know("impedance_ohm", impedance(&document).or(valid(row.impedance)));
    let connector = document.descendants().find(|node| node.has_tag_name("Connector"));
    if let Some(name) = connector.and_then(|node| node.attributes().next()) {
        point.cells.insert("catheter".into(), name.name().to_owned());
    }
    Ok(())
}

/// The time of activation.
#[derive(Debug, PartialEq)]
enum Lat {
    /// Relative to the reference, ms.
    At(f64),
    NotAnnotated,
    OutsideWindow,
}

/// Map annotation minus reference annotation (samples of 1 ms), where both are there and the first
/// lies in the window of interest, which is relative to the reference.
fn lat(document: &Document) -> Lat {
    let annotation = |name: &str| number(document, "Annotations", name);
    let both = annotation("Map_Annotation").zip(annotation("Reference_Annotation"));
    let Some((at, reference)) = both else { return Lat::NotAnnotated };
    let ms = at - reference;
    // a map annotation that is missing is written as −10000 from the reference
    if reference <= MISSING || at <= MISSING || ms <= MISSING {
        return Lat::NotAnnotated;
    }
    let end = |name: &str, open: f64| number(document, "WOI", name).unwrap_or(open);
    let (from, to) = (end("From", f64::NEG_INFINITY), end("To", f64::INFINITY));
    if (from..=to).contains(&ms) { Lat::At(ms) } else { Lat::OutsideWindow }
}

/// The impedance that was read nearest to the time of the point, ohm.
fn impedance(document: &Document) -> Option<f64> {
    let read = document.descendants().filter(|node| node.has_tag_name("Impedance"));
    let pair = |node: Node| {
        let number = |name: &str| node.attribute(name)?.trim().parse::<f64>().ok();
        Some((number("Time")?.abs(), number("Value").and_then(valid)?))
    };
    read.filter_map(pair).min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, value)| value)
}

/// The contact force that was read nearest to the time of the point, g: columns `Time` and `ForceValue`.
fn force_at_zero(text: &str) -> Option<f64> {
    let mut lines = text.lines().skip_while(|line| !line.starts_with("Index"));
    let header: Vec<&str> = lines.next()?.split('\t').map(str::trim).collect();
    let column = |name: &str| header.iter().position(|own| *own == name);
    let (time, force) = (column("Time")?, column("ForceValue")?);
    let pair = |line: &str| {
        let cells: Vec<&str> = line.split('\t').collect();
        let number = |k: usize| cells.get(k)?.trim().replace(',', ".").parse::<f64>().ok();
        Some((number(time)?.abs(), number(force).and_then(valid)?))
    };
    lines.filter_map(pair).min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, force)| force)
}

fn number(document: &Document, tag: &str, attribute: &str) -> Option<f64> {
    let node = document.descendants().find(|node| node.has_tag_name(tag))?;
    node.attribute(attribute)?.trim().parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(map: i32, reference: i32) -> Lat {
        let text = format!(
            r#"<Point><Annotations Reference_Annotation="{reference}" Map_Annotation="{map}" /><WOI From="-20" To="180" /></Point>"#
        );
        lat(&Document::parse(&text).unwrap())
    }

    #[test]
    fn lat_is_relative_to_the_reference_and_within_its_window() {
        assert_eq!(of(2100, 2000), Lat::At(100.0));
        assert_eq!(of(2000, 2000), Lat::At(0.0));
        assert_eq!(of(2181, 2000), Lat::OutsideWindow);
        assert_eq!(of(-8000, 2000), Lat::NotAnnotated);
        assert_eq!(of(2100, -10000), Lat::NotAnnotated);
        assert_eq!(lat(&Document::parse("<Point/>").unwrap()), Lat::NotAnnotated);
    }

    #[test]
    fn force_is_that_of_the_point_s_time() {
        let text = "X_ContactForce.txt_2.0\r\nRate=50\r\nIndex\tTime\tTimestamp\tForceValue\r\n1\t-50\t0\t3\r\n2\t-10\t0\t7,5\r\n3\t40\t0\t9\r\n";
        assert_eq!(force_at_zero(text), Some(7.5));
        assert_eq!(force_at_zero("no table"), None);
    }
}
