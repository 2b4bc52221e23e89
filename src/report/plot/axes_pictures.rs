//! Panels with error bars as pictures.

use super::super::{ErrorBars, Panel};
use super::picture::Picture;

/// More panels than this in a row would make texts too small.
const COLUMNS: usize = 3;

/// The picture; rows of many panels are broken.
pub fn error_bars(name: impl Into<String>, shows: impl Into<String>, bars: &ErrorBars) -> Picture {
    let broken = bars.rows.iter().flat_map(|row| {
        let label = row.first().map_or("", |panel| panel.y_label.as_str());
        row.chunks(COLUMNS).map(move |panels| {
            let labelled = |panel: &Panel| Panel { y_label: label.to_owned(), ..panel.clone() };
            panels.iter().map(labelled).collect()
        })
    });
    let (size, drawing) = ErrorBars { rows: broken.collect(), ..bars.clone() }.drawing();
    Picture::of(name, shows, size, drawing)
}
