//! Numbers at the vertices or the triangles of a mesh.

use std::collections::BTreeMap;

/// Arrays by name: one row per vertex, or one per triangle.
pub type Data = BTreeMap<String, Array>;

/// An array of rows of the same width: 1 for scalars, 3 for vectors, 9 for tensors.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    width: usize,
    values: Vec<f64>,
}

impl Array {
    /// An array `(values.len() / width, width)`, row after row.
    ///
    /// # Panics
    /// If `width` is 0 or the values are no whole number of rows.
    pub fn new(width: usize, values: Vec<f64>) -> Self {
        assert!(width > 0 && values.len().is_multiple_of(width), "rows of {width} numbers");
        Self { width, values }
    }

    /// Numbers in a row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Number of rows.
    pub fn n_rows(&self) -> usize {
        self.values.len() / self.width
    }

    /// All numbers, row after row.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Row `index`.
    ///
    /// # Panics
    /// If there is no such row.
    pub fn row(&self, index: usize) -> &[f64] {
        &self.values[index * self.width..(index + 1) * self.width]
    }

    /// The numbers, if there is one in each row.
    pub fn scalars(&self) -> Option<&[f64]> {
        (self.width == 1).then_some(&self.values[..])
    }

    /// The rows, if each is a vector of three numbers.
    pub fn vectors(&self) -> Option<&[[f64; 3]]> {
        (self.width == 3).then(|| self.values.as_chunks().0)
    }

    /// The rows with these numbers, in their order.
    ///
    /// # Panics
    /// If there is no such row.
    pub(super) fn pick(&self, rows: &[u32]) -> Self {
        let values = rows.iter().flat_map(|row| self.row(*row as usize)).copied().collect();
        Self { width: self.width, values }
    }

    /// What the columns are called: `name`, or `name_0`, `name_1`, … if there are several.
    pub(super) fn names(&self, name: &str) -> Vec<String> {
        match self.width {
            1 => vec![name.to_owned()],
            width => (0..width).map(|k| format!("{name}_{k}")).collect(),
        }
    }

    /// Column `k`.
    pub(super) fn column(&self, k: usize) -> Vec<f64> {
        self.values.iter().skip(k).step_by(self.width).copied().collect()
    }

    /// The columns with their names.
    pub(super) fn columns(&self, name: &str) -> impl Iterator<Item = (String, Vec<f64>)> {
        self.names(name).into_iter().enumerate().map(|(k, name)| (name, self.column(k)))
    }
}

impl From<Vec<f64>> for Array {
    fn from(values: Vec<f64>) -> Self {
        Self { width: 1, values }
    }
}

impl From<Vec<[f64; 3]>> for Array {
    fn from(vectors: Vec<[f64; 3]>) -> Self {
        Self { width: 3, values: vectors.into_flattened() }
    }
}

/// Every array's rows with these numbers.
pub(super) fn pick(data: &Data, rows: &[u32]) -> Data {
    data.iter().map(|(name, array)| (name.clone(), array.pick(rows))).collect()
}

/// Every column of every array, by name.
pub(super) fn columns(data: &Data) -> BTreeMap<String, Vec<f64>> {
    data.iter().flat_map(|(name, array)| array.columns(name)).collect()
}

/// Joins `name_0`, `name_1` and `name_2` to the vectors `name`, for formats that know only scalars.
pub(super) fn join_vectors(data: &mut Data) {
    let first = data.keys().filter_map(|name| name.strip_suffix("_0").map(str::to_owned));
    for name in first.collect::<Vec<_>>() {
        let part = |k: usize| data.get(&format!("{name}_{k}"))?.scalars();
        if let (Some(x), Some(y), Some(z), None) = (part(0), part(1), part(2), part(3))
            && !data.contains_key(&name)
        {
            let vectors: Vec<[f64; 3]> = (0..x.len()).map(|i| [x[i], y[i], z[i]]).collect();
            data.retain(|key, _| (0..3).all(|k| *key != format!("{name}_{k}")));
            data.insert(name, vectors.into());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_join_to_the_vectors_they_came_from() {
        let vectors = Array::from(vec![[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
        let mut data: Data = vectors.columns("a_b").map(|(name, c)| (name, c.into())).collect();
        data.insert("lone_0".into(), vec![7.0, 8.0].into());
        assert_eq!(data["a_b_1"].scalars(), Some(&[2.0, 5.0][..]));
        join_vectors(&mut data);
        assert_eq!(data.keys().collect::<Vec<_>>(), ["a_b", "lone_0"]);
        assert_eq!(data["a_b"], vectors);
        assert_eq!(vectors.pick(&[1, 1]).vectors(), Some(&[[4.0, 5.0, 6.0]; 2][..]));
    }
}
