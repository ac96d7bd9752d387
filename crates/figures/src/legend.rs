//! The legend: one line or several above the panels, in the order of appearance.

use crate::figure::{Figure, Kind, Style};

/// One entry, with its place in units of the canvas.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Entry {
    pub(crate) name: String,
    pub(crate) style: Style,
    pub(crate) kind: Kind,
    pub(crate) x: i32,
    pub(crate) row: i32,
}

/// Width of a letter over the height of the text: the mean of Helvetica's lower case is 0.5; capitals and digits are wider.
const LETTER: f64 = 0.56;

/// Width of a text in units, as wide as any common sans-serif sets it.
pub(crate) fn text_width(text: &str, size: f64) -> f64 {
    text.chars().count() as f64 * LETTER * size
}

/// Entries that fill rows of at most `width`, each `sample` wide before its text, and the number of rows. One entry alone needs no
/// legend.
pub(crate) fn lay_out(figure: &Figure, width: f64, size: f64, sample: f64) -> (Vec<Entry>, i32) {
    let mut entries: Vec<Entry> = Vec::new();
    for series in figure.panels.iter().flat_map(|panel| &panel.series) {
        if !series.name.is_empty() && entries.iter().all(|e| e.name != series.name) {
            let name = series.name.clone();
            entries.push(Entry { name, style: series.style, kind: series.kind, x: 0, row: 0 });
        }
    }
    if entries.len() < 2 {
        return (Vec::new(), 0);
    }
    let (mut x, mut row) = (0.0, 0);
    for entry in &mut entries {
        let needs = sample + text_width(&entry.name, size) + size;
        if x > 0.0 && x + needs > width {
            (x, row) = (0.0, row + 1);
        }
        (entry.x, entry.row) = (x as i32, row);
        x += needs + size;
    }
    (entries, row + 1)
}
