//! Tiny studies written as EnSite Precision and EnSite X are described to export theirs: a sheet of 3 × 3
//! vertices, 6 mm apart.
#![allow(dead_code, clippy::unwrap_used, reason = "tests; each uses a part of it")]

use std::fmt::Write as _;

/// The surface with a map whose kind the comment tells; the last vertex is not mapped.
pub(crate) fn surface(kind: &str) -> String {
    let mut vertices = String::new();
    let mut values = String::new();
    for v in 0..9 {
        let (x, y) = (6.0 * f64::from(v % 3), 6.0 * f64::from(v / 3));
        writeln!(vertices, "{x} {y} 0").unwrap();
        writeln!(values, "{}", 1.0 + x).unwrap();
    }
    let polygons = "1 2 4\n2 5 4\n2 3 5\n3 6 5\n4 5 7\n5 8 7\n5 6 8\n6 9 8\n";
    format!(
        "<?xml version=\"1.0\"?>
<!-- Exported from study -->
<DIF><DIFHeader><Version>SJM_DIF_5.0</Version></DIFHeader><DIFBody><Volumes number=\"1\"><Volume name=\"LA\">
<Vertices number=\"9\">\n{vertices}</Vertices>
<!-- Data values at each vertex of DxL map {kind} -->
<Map_data number=\"9\">\n{values}</Map_data>
<!-- Map_status for each vertex: 0 = good, 1 = scar, 2 = none -->
<Map_status number=\"9\">0 0 0 0 0 0 0 0 2</Map_status>
<Polygons number=\"8\">\n{polygons}</Polygons>
</Volume></Volumes><Labels number=\"0\" /><ObjectMap><Rotation>1 0 0 0</Rotation></ObjectMap></DIFBody></DIF>\n"
    )
}

/// File `k` of two, with two points each: the second of file 2 is not used.
pub(crate) fn dxl(k: usize) -> String {
    let used = i32::from(k != 2);
    format!(
        "St. Jude Medical. File Revision : 5.2\nExport Data Element : DxL\nTotal number of data points (columns):,2\nThis is file {k} of 2 for map,SR µV\nBegin data\npt number:,{0},{1}\nroving x:,{2},{3}\nroving y:,0,6\nroving z:,0.5,0.5\nrov LAT:,3.51,3.525\nref LAT:,3.5,3.5\nend time:,4,4\npeak2peak:,1.5,0.25\nutilized:,1,{used}\ndisplayed:,1,1\nSeg data len:,8\nExported seconds:,8\nSample rate:,2034.5\nrov trace:,A,B\n0,0\nEOF\n",
        2 * k - 1,
        2 * k,
        6 * (k - 1),
        6 * (k - 1) + 1,
    )
}

/// A table of EnSite X with three points; the last is not used, and the force of the second is invalid.
pub(crate) const MAP_X: &str = "Abbott EnSite X\nExport Data Element :,Map\nMap name:,SR\nNumber of points:,3\n****,\n(Point #),Electrodes,utilized,displayed,roving x,roving y,roving z,surface x,surface y,surface z,Ref Tick,# rov ticks,Rov Tick 1,Rov Tick 2,adjTime (ms),LAT,pp_Vmax,pp_Valong,force (g)\n1,A1-A2,1,1,0,0,0.5,0,0,0,1000,2,1020,1400,3,10,2.5,1.25,12.5\n2,A2-A3,1,1,6,6,0.5,6,6,0,1000,1,1050,,3,25,2,0.75,invalid\n3,A3-A4,0,1,12,6,0.5,12,6,0,1000,1,1050,,3,25,2,0.75,9\nEOF\n";

/// A wave file, which tells the sample rate.
pub(crate) const WAVE_X: &str = "Abbott EnSite X\nExport Data Element :,Wave\nSample rate:,2000\n****,\n(Point #),0,1,2\n1,0,0,0\nEOF\n";

/// As the systems write them.
pub(crate) fn cp1252(text: &str) -> Vec<u8> {
    text.chars().map(|c| u8::try_from(u32::from(c)).unwrap()).collect()
}
