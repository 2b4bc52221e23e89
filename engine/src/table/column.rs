//! One column of a table. Its cells are parsed once, when the column is made.

use std::collections::BTreeMap;

use csv::StringRecord;
use eplat_language::as_name;

/// What the cells of a column hold. A missing value is an empty cell.
#[derive(Clone, Debug)]
pub enum Content {
    /// Every filled cell is a number. One value per row, NaN where the cell is empty.
    Numbers(Vec<f64>),
    /// No filled cell is a number.
    Labels,
    /// Some filled cells are numbers and others are not. The column counts as labels.
    Mixed {
        /// The number in each row, NaN where the cell is empty, `None` where it is no number.
        numbers: Vec<Option<f64>>,
        /// The first row whose cell is no number.
        first: usize,
    },
}

/// A column: its name, the distinct texts of its cells, and what these mean.
#[derive(Clone, Debug)]
pub struct TypedColumn {
    name: String,
    /// Its name in a model file.
    read_as: String,
    /// Distinct texts in order of appearance, the empty text among them.
    texts: StringRecord,
    /// Which of these stands in each row.
    text_of: Vec<u32>,
    content: Content,
}

impl TypedColumn {
    /// From the texts of the cells, one per row.
    pub fn parse<'t>(name: &str, cells: impl Iterator<Item = &'t str>) -> Self {
        let mut texts = StringRecord::new();
        let mut index: BTreeMap<&'t str, u32> = BTreeMap::new();
        let text_of: Vec<u32> = cells
            .map(|cell| {
                *index.entry(cell).or_insert_with(|| {
                    texts.push_field(cell);
                    (texts.len() - 1) as u32
                })
            })
            .collect();
        let content = content(&texts, &text_of);
        Self { name: name.into(), read_as: as_name(name), texts, text_of, content }
    }

    /// From numbers, one per row; NaN makes an empty cell.
    pub fn of_numbers(name: &str, values: &[f64]) -> Self {
        let text = |x: &f64| if x.is_nan() { String::new() } else { x.to_string() };
        let texts: Vec<String> = values.iter().map(text).collect();
        Self::parse(name, texts.iter().map(String::as_str))
    }

    /// Its name in the header.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its name in a model file: `contact_force_g` for `contact force (g)`.
    pub fn read_as(&self) -> &str {
        &self.read_as
    }

    /// What its cells hold.
    pub fn content(&self) -> &Content {
        &self.content
    }

    /// The values, one per row and NaN where a cell is empty, if this is a column of numbers.
    pub fn numbers(&self) -> Option<&[f64]> {
        match &self.content {
            Content::Numbers(values) => Some(values),
            Content::Labels | Content::Mixed { .. } => None,
        }
    }

    /// The number in a row: NaN where the cell is empty, `None` where it holds something else.
    pub fn number(&self, row: usize) -> Option<f64> {
        match &self.content {
            Content::Numbers(values) => Some(values[row]),
            Content::Labels => self.text(row).is_empty().then_some(f64::NAN),
            Content::Mixed { numbers, .. } => numbers[row],
        }
    }

    /// The text of a cell.
    pub fn text(&self, row: usize) -> &str {
        &self.texts[self.text_of[row] as usize]
    }

    /// The first row whose cell is empty.
    pub fn first_empty(&self) -> Option<usize> {
        let empty = self.texts.iter().position(str::is_empty)? as u32;
        self.text_of.iter().position(|text| *text == empty)
    }

    /// The distinct labels in order of appearance; empty cells have none.
    pub fn labels(&self) -> Vec<String> {
        self.texts.iter().filter(|text| !text.is_empty()).map(String::from).collect()
    }

    /// For each row, the number of its text among the distinct texts, in order of appearance. An empty
    /// cell has a number of its own.
    pub fn groups(&self) -> impl Iterator<Item = usize> {
        self.text_of.iter().map(|text| *text as usize)
    }

    /// Number of distinct texts, the empty one among them.
    pub fn n_groups(&self) -> usize {
        self.texts.len()
    }
}

/// Parses every distinct text once.
fn content(texts: &StringRecord, text_of: &[u32]) -> Content {
    let number = |text: &str| if text.is_empty() { Some(f64::NAN) } else { text.parse().ok() };
    let parsed: Vec<Option<f64>> = texts.iter().map(number).collect();
    let numbers: Vec<Option<f64>> = text_of.iter().map(|text| parsed[*text as usize]).collect();
    let is_filled = |row: usize| !texts[text_of[row] as usize].is_empty();
    let Some(first) = numbers.iter().position(Option::is_none) else {
        return Content::Numbers(numbers.into_iter().flatten().collect());
    };
    if (0..numbers.len()).any(|row| numbers[row].is_some() && is_filled(row)) {
        Content::Mixed { numbers, first }
    } else {
        Content::Labels
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn column(cells: &[&str]) -> TypedColumn {
        TypedColumn::parse("c", cells.iter().copied())
    }

    #[test]
    fn a_column_is_numbers_labels_or_mixed() {
        let numbers = column(&["1.5", "", "2e1"]);
        let values = numbers.numbers().unwrap();
        assert!((values[0] + values[2] - 21.5).abs() < 1e-12 && values[1].is_nan());
        assert!(matches!(column(&["A", "", "B"]).content(), Content::Labels));
        assert!(matches!(column(&["1", "NA", "2"]).content(), Content::Mixed { first: 1, .. }));
        assert!(column(&["", ""]).numbers().is_some());
    }

    #[test]
    fn labels_are_distinct_and_in_order() {
        let c = column(&["B", "", "A", "B"]);
        assert_eq!(c.labels(), ["B", "A"]);
        assert_eq!(c.groups().collect::<Vec<_>>(), [0, 1, 2, 0]);
        assert_eq!(c.first_empty(), Some(1));
    }

    #[test]
    fn numbers_keep_their_value_as_text() {
        let c = TypedColumn::of_numbers("c", &[0.1, f64::NAN, 200.0]);
        assert_eq!([c.text(0), c.text(1), c.text(2)], ["0.1", "", "200"]);
    }
}
