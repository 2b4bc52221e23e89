//! OpenEP: the struct `userdata` in a MATLAB file.
//!
//! # Source
//! How openep-py reads it: `surface.triRep`, `surface.act_bip`, `surface.uni_imp_frc`, and `electric`.

use super::matlab::{Found, Mat, Matrix};
use super::{Ground, ImportError, Map, Point, Shell, Site, Study};

/// Samples per second where the file does not say: that of CARTO.
const SAMPLES: f64 = 1000.0;

/// Reads a `.mat` file.
///
/// # Errors
/// It is damaged, holds no `userdata`, or its triangulation is an object.
pub(super) fn read(file: &str, bytes: Vec<u8>) -> Result<Study, ImportError> {
    let openep = OpenEp { file, mat: Mat::open(file, bytes)? };
    if openep.mat.find(&["userdata"])?.is_none() {
        return Err(openep.unusable(
            "no variable `userdata`",
            "give a file that OpenEP has written: save(FILE, 'userdata')",
        ));
    }
    let name = file.rsplit_once('.').map_or(file, |(stem, _)| stem);
    let mut map = Map { name: name.into(), ..Map::default() };
    map.ground = Some(Ground::Shell(openep.shell(&mut map)?));
    openep.add_points(&mut map)?;
    let format = format!("OpenEP, MATLAB file of version {}", openep.mat.version());
    Ok(Study { format, maps: vec![map], remarks: vec![] })
}

struct OpenEp<'f> {
    file: &'f str,
    mat: Mat,
}

impl OpenEp<'_> {
    fn unusable(&self, what: impl Into<String>, help: &str) -> ImportError {
        ImportError::Unusable { file: self.file.into(), what: what.into(), help: help.into() }
    }

    /// A matrix below `userdata` that is not empty.
    fn matrix(&self, path: &[&str]) -> Result<Option<Matrix>, ImportError> {
        let path = [&["userdata"], path].concat();
        match self.mat.find(&path)? {
            Some(Found::Matrix(matrix)) if !matrix.values.is_empty() => Ok(Some(matrix)),
            Some(Found::Object(class)) => Err(self.unusable(
                format!("{} is an object of the class {class}, which only MATLAB can read", path.join(".")),
                "in MATLAB: t = userdata.surface.triRep; userdata.surface.triRep = struct('X', t.X, 'Triangulation', t.Triangulation); save(FILE, 'userdata', '-v7')",
            )),
            _ => Ok(None),
        }
    }

    /// A matrix with this many columns.
    fn columns(&self, path: &[&str], n: usize) -> Result<Option<Matrix>, ImportError> {
        let Some(matrix) = self.matrix(path)? else { return Ok(None) };
        if matrix.columns() == n {
            return Ok(Some(matrix));
        }
        let what =
            format!("userdata.{} has {} columns, expected {n}", path.join("."), matrix.columns());
        Err(self.unusable(what, "this is no data set of OpenEP, or of another version"))
    }

    fn shell(&self, map: &mut Map) -> Result<Shell, ImportError> {
        let either = |names: [&str; 2]| {
            let [first, second] = names.map(|name| ["surface", "triRep", name]);
            Ok::<_, ImportError>(match self.columns(&first, 3)? {
                Some(matrix) => Some(matrix),
                None => self.columns(&second, 3)?,
            })
        };
        let places = either(["X", "Points"])?;
        let corners = either(["Triangulation", "ConnectivityList"])?;
        let Some((places, corners)) = places.zip(corners) else {
            return Err(self.unusable(
                "no surface: userdata.surface.triRep.X and .Triangulation are missing",
                "write the case again with OpenEP, with its surface",
            ));
        };
        let n = places.rows;
        let vertices = (0..n).map(|v| [0, 1, 2].map(|k| places.at(v, k))).collect();
        let mut triangles = Vec::with_capacity(corners.rows);
        for t in 0..corners.rows {
            // counted from 1
            let corner = [0, 1, 2].map(|k| corners.at(t, k) - 1.0);
            if corner.iter().any(|v| !(0.0..n as f64).contains(v) || v.fract() != 0.0) {
                let what = format!(
                    "triangle {} of userdata.surface.triRep.Triangulation names a vertex that is not there (1 to {n})",
                    t + 1
                );
                return Err(self.unusable(what, "the file is damaged; write it again with OpenEP"));
            }
            triangles.push(corner.map(|v| v as u32));
        }
        let mut shell = Shell { vertices, triangles, ..Shell::default() };
        self.add_values(&mut shell, map)?;
        Ok(shell)
    }

    /// The maps that the file has at vertices.
    fn add_values(&self, shell: &mut Shell, map: &mut Map) -> Result<(), ImportError> {
        let arrays: [(&str, &[&str]); 2] = [
            ("act_bip", &["lat", "bipolar"]),
            ("uni_imp_frc", &["unipolar", "impedance", "force"]),
        ];
        for (array, names) in arrays {
            let Some(values) = self.columns(&["surface", array], names.len())? else { continue };
            if values.rows != shell.vertices.len() {
                map.remarks.push(format!(
                    "surface.{array} has {} rows for {} vertices and is left out",
                    values.rows,
                    shell.vertices.len()
                ));
                continue;
            }
            for (column, name) in names.iter().enumerate() {
                let own: Vec<f64> = (0..values.rows).map(|v| values.at(v, column)).collect();
                if own.iter().any(|x| x.is_finite()) {
                    shell.data.insert((*name).into(), own);
                }
            }
        }
        Ok(())
    }

    /// The texts of a field of `userdata.electric`, one for each point; none if they are not there.
    fn texts(&self, field: &str, map: &mut Map) -> Result<Vec<String>, ImportError> {
        Ok(match self.mat.find(&["userdata", "electric", field])? {
            Some(Found::Texts(texts)) => texts,
            Some(Found::Other) => {
                map.remarks.push(format!(
                    "userdata.electric.{field} is left out: it is no cell array of texts"
                ));
                vec![]
            }
            _ => vec![],
        })
    }

    fn add_points(&self, map: &mut Map) -> Result<(), ImportError> {
        let electric = |path: &[&str]| self.matrix(&[&["electric"], path].concat());
        let Some(places) = self.columns(&["electric", "egmX"], 3)? else {
            map.remarks.push("no points (userdata.electric.egmX)".into());
            return Ok(());
        };
        let at = electric(&["annotations", "mapAnnot"])?;
        let reference = electric(&["annotations", "referenceAnnot"])?;
        let window = electric(&["annotations", "woi"])?;
        let bipolar = electric(&["voltages", "bipolar"])?;
        let unipolar = electric(&["voltages", "unipolar"])?;
        let include = electric(&["include"])?;
        let texts = [("tags", "tag"), ("electrodeNames_bip", "electrode")];
        let texts = texts.map(|(field, column)| Ok((column, self.texts(field, map)?)));
        let texts = texts.into_iter().collect::<Result<Vec<_>, ImportError>>()?;
        let samples = electric(&["sampleFrequency"])?.map_or(SAMPLES, |m| m.at(0, 0));
        if !(samples > 0.0) {
            let help = "set userdata.electric.sampleFrequency, in samples per second";
            return Err(self.unusable("userdata.electric.sampleFrequency is not above 0", help));
        }
        let value = |matrix: &Option<Matrix>, row: usize| {
            matrix.as_ref().map(|m| m.at(row, 0)).filter(|x| x.is_finite())
        };
        for row in 0..places.rows {
            let place = [0, 1, 2].map(|k| places.at(row, k));
            if value(&include, row).is_some_and(|x| x <= 0.0) {
                map.leave_out("points that the study does not include");
                continue;
            }
            if place.iter().any(|x| !x.is_finite()) {
                map.leave_out("points without a place");
                continue;
            }
            let mut point = Point::at(format!("P{}", row + 1), Site::At(place));
            for (column, texts) in &texts {
                if let Some(text) = texts.get(row).filter(|text| !text.is_empty()) {
                    point.cells.insert((*column).into(), text.clone());
                }
            }
            point.measure("bipolar", value(&bipolar, row));
            point.measure("unipolar", value(&unipolar, row));
            if let Some((at, reference)) = value(&at, row).zip(value(&reference, row)) {
                let lat = at - reference;
                let end =
                    |k: usize| window.as_ref().map(|m| m.at(row, k)).filter(|x| x.is_finite());
                let is_before = end(0).is_some_and(|from| lat < from);
                if is_before || end(1).is_some_and(|to| lat > to) {
                    map.leave_out("LAT outside the window of interest");
                } else {
                    point.measure("lat", Some(lat * 1000.0 / samples));
                }
            }
            if point.readings.is_empty() {
                map.leave_out("points without any measurement");
            } else {
                map.points.push(point);
            }
        }
        Ok(())
    }
}
