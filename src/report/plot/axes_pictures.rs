//! Panels with error bars as pictures.

use super::super::{ErrorBars, Panel};
use super::picture::{MOST, Picture, WIDTH};

/// More panels than this in a row would make texts too small.
const COLUMNS: usize = 3;

/// The pictures, each no higher than a page: `NAME`, or of several `NAME_1`, `NAME_2`, …. Rows of many panels are
/// broken.
pub fn error_bars(name: &str, shows: &str, bars: &ErrorBars) -> Vec<Picture> {
    let broken = bars.rows.iter().flat_map(|row| {
        let label = row.first().map_or("", |panel| panel.y_label.as_str());
        row.chunks(COLUMNS).map(move |panels| {
            let labelled = |panel: &Panel| Panel { y_label: label.to_owned(), ..panel.clone() };
            panels.iter().map(labelled).collect()
        })
    });
    let rows: Vec<Vec<Panel>> = broken.collect();
    let part = |rows: &[Vec<Panel>]| ErrorBars { rows: rows.to_vec(), ..bars.clone() }.drawing();
    let ([width, height], _) = part(&rows);
    let per_row = height / rows.len().max(1) as f64;
    let per_page = (MOST / WIDTH * width / per_row).floor().max(1.0) as usize;
    let pages = rows.chunks(per_page).enumerate().map(|(number, page)| {
        let several = rows.len() > per_page;
        let name = if several { format!("{name}_{}", number + 1) } else { name.to_owned() };
        let (size, drawing) = part(page);
        Picture::of(name, shows, size, drawing)
    });
    pages.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_rows_are_broken_into_pages() {
        let panel = Panel { title: "10 ms".into(), y_label: "RMSE".into(), points: vec![] };
        let names = |n_rows, n_columns| {
            let rows = vec![vec![panel.clone(); n_columns]; n_rows];
            let bars =
                ErrorBars { x_label: "sites".into(), x: vec!["5".into()], lines: vec![], rows };
            let pictures = error_bars("errors", "errors", &bars);
            pictures.into_iter().map(|picture| picture.name).collect::<Vec<_>>()
        };
        assert_eq!(names(4, 2), ["errors"]);
        // two columns and two rows for each five panels: ten rows, five to a page
        assert_eq!(names(5, 5), ["errors_1", "errors_2"]);
        assert!(names(0, 0).is_empty());
    }
}
