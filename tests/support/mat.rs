//! A writer of MATLAB files of version 5, as small as its tests need it.
#![allow(dead_code, clippy::unwrap_used, reason = "tests; each uses a part of it")]

/// What a field holds.
pub(crate) enum Value {
    /// Rows of numbers.
    Rows(Vec<Vec<f64>>),
    /// Whole numbers in a column.
    Int32(Vec<i32>),
    Struct(Vec<(&'static str, Value)>),
    /// A column of cells with a text each.
    Texts(Vec<&'static str>),
    /// An object of a class.
    Object(&'static str),
}

fn element(kind: u32, bytes: &[u8]) -> Vec<u8> {
    let mut out = [kind.to_le_bytes(), (bytes.len() as u32).to_le_bytes()].concat();
    out.extend(bytes);
    out.resize(out.len().next_multiple_of(8), 0);
    out
}

fn matrix(class: u8, dimensions: [i32; 2], name: &str, body: &[u8]) -> Vec<u8> {
    let flags = [u32::from(class).to_le_bytes(), [0; 4]].concat();
    let dimensions = dimensions.map(i32::to_le_bytes).concat();
    let head = [element(6, &flags), element(5, &dimensions), element(1, name.as_bytes())].concat();
    element(14, &[&head, body].concat())
}

impl Value {
    fn bytes(&self, name: &str) -> Vec<u8> {
        match self {
            Self::Rows(rows) => {
                let n_columns = rows[0].len();
                let columns = (0..n_columns).flat_map(|k| rows.iter().map(move |row| row[k]));
                let body: Vec<u8> = columns.flat_map(f64::to_le_bytes).collect();
                matrix(6, [rows.len() as i32, n_columns as i32], name, &element(9, &body))
            }
            Self::Int32(column) => {
                let body: Vec<u8> = column.iter().flat_map(|x| x.to_le_bytes()).collect();
                matrix(12, [column.len() as i32, 1], name, &element(5, &body))
            }
            Self::Struct(fields) => {
                // the length of names stands in a small element
                let mut body = [(4_u32 << 16 | 5).to_le_bytes(), 32_u32.to_le_bytes()].concat();
                let names: Vec<u8> = fields
                    .iter()
                    .flat_map(|(name, _)| {
                        let mut own = name.as_bytes().to_vec();
                        own.resize(32, 0);
                        own
                    })
                    .collect();
                body.extend(element(1, &names));
                body.extend(fields.iter().flat_map(|(_, value)| value.bytes("")));
                matrix(2, [1, 1], name, &body)
            }
            Self::Texts(texts) => {
                let cell = |text: &&str| {
                    let units: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
                    let n = text.encode_utf16().count() as i32;
                    matrix(4, [i32::from(n > 0), n], "", &element(4, &units))
                };
                let cells: Vec<u8> = texts.iter().flat_map(cell).collect();
                matrix(1, [texts.len() as i32, 1], name, &cells)
            }
            Self::Object(class) => {
                let flags = [17_u32.to_le_bytes(), [0; 4]].concat();
                let parts = [
                    element(6, &flags),
                    element(1, name.as_bytes()),
                    element(1, b"MCOS"),
                    element(1, class.as_bytes()),
                ];
                element(14, &parts.concat())
            }
        }
    }
}

/// A file with one variable.
pub(crate) fn file(name: &str, value: &Value) -> Vec<u8> {
    let mut out = b"MATLAB 5.0 MAT-file".to_vec();
    out.resize(124, b' ');
    out.extend([0x00, 0x01]);
    out.extend(b"IM");
    out.extend(value.bytes(name));
    out
}

/// A data set of OpenEP: a sheet of 3 × 3 vertices, 6 mm apart, and four points, the same as
/// `tests/python/openep_v73.py` writes.
pub(crate) fn openep(tri_rep: Option<Value>) -> Vec<u8> {
    openep_with(tri_rep, vec![])
}

/// The same with further fields of `electric`.
pub(crate) fn openep_with(tri_rep: Option<Value>, more: Vec<(&'static str, Value)>) -> Vec<u8> {
    use Value::{Int32, Rows, Struct};
    let vertex = |v: usize| vec![6.0 * (v % 3) as f64, 6.0 * (v / 3) as f64, 0.0];
    let corners = |v: usize| {
        let v = v as f64;
        [vec![v + 1.0, v + 2.0, v + 4.0], vec![v + 2.0, v + 5.0, v + 4.0]]
    };
    let value = |v: usize| match v {
        1 => vec![f64::NAN; 2],
        v => vec![vertex(v)[0], 1.0 + 0.05 * vertex(v)[0]],
    };
    let tri_rep = tri_rep.unwrap_or_else(|| {
        Struct(vec![
            ("X", Rows((0..9).map(vertex).collect())),
            ("Triangulation", Rows([0, 1, 3, 4].into_iter().flat_map(corners).collect())),
        ])
    });
    let place = |v| {
        let mut place = vertex(v);
        place[2] = 0.5;
        place
    };
    let mut electric = vec![
        ("egmX", Rows((0..4).map(place).collect())),
        (
            "annotations",
            Struct(vec![
                ("mapAnnot", Int32(vec![2000, 2010, 2020, 2900])),
                ("referenceAnnot", Int32(vec![2000; 4])),
                ("woi", Rows(vec![vec![-50.0, 200.0]; 4])),
            ]),
        ),
        (
            "voltages",
            Struct(vec![("bipolar", Rows([1.0, 1.5, f64::NAN, 2.0].map(|x| vec![x]).to_vec()))]),
        ),
    ];
    electric.extend(more);
    let electric = Struct(electric);
    let surface = Struct(vec![("triRep", tri_rep), ("act_bip", Rows((0..9).map(value).collect()))]);
    file("userdata", &Struct(vec![("surface", surface), ("electric", electric)]))
}
