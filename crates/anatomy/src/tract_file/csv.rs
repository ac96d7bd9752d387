//! Centre-line CSVs: columns `segment, s, x, y, z, radius` in metres, in order from mouth to anus.

use super::TractTable;
use crate::segment::SegmentKey;
use crate::tract::SegmentPoints;
use lumenav_core::{ConfigError, Node};
use nalgebra::Point3;

/// Larger files are no centre lines.
const MAX_FILE_BYTES: u64 = 16 * 1024 * 1024;

/// Where the columns are.
struct Columns {
    segment: usize,
    position: [usize; 3],
    radius: Option<usize>,
}

/// A file's name, for messages.
struct Place<'a> {
    file: &'a str,
}

impl Place<'_> {
    fn error(&self, line: usize, key: &str, message: String) -> ConfigError {
        ConfigError { file: self.file.to_owned(), position: Some((line, 1)), key: key.to_owned(), message }
    }
}

/// The segments of the CSV that `node.centre_line_csv` names.
pub(super) fn read(node: &Node, file: &str, table: &TractTable) -> Result<Vec<SegmentPoints>, ConfigError> {
    let path = node.existing_path("centre_line_csv", file)?;
    let refuse =
        |message: String| node.error_at("centre_line_csv", &format!("{}: {message}", path.display()));
    let size = std::fs::metadata(&path).map_err(|error| refuse(format!("cannot be read: {error}")))?.len();
    if size > MAX_FILE_BYTES {
        return Err(refuse(format!("{size} bytes is too large for a centre line (16 MiB at most)")));
    }
    let text = std::fs::read_to_string(&path).map_err(|error| refuse(format!("cannot be read: {error}")))?;
    parse(&text, &path.display().to_string(), table)
}

/// The segments of a CSV's text.
pub(super) fn parse(text: &str, file: &str, table: &TractTable) -> Result<Vec<SegmentPoints>, ConfigError> {
    let place = Place { file };
    let mut columns: Option<Columns> = None;
    let mut segments: Vec<SegmentPoints> = Vec::new();
    for (index, line) in text.lines().enumerate() {
        let number = index + 1;
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let cells: Vec<&str> = line.split(',').map(str::trim).collect();
        let Some(columns) = &columns else {
            columns = Some(header(&place, number, &cells)?);
            continue;
        };
        let key =
            segment_key(&place, number, cell(&place, number, &cells, "segment", columns.segment)?, table)?;
        if segments.last().is_none_or(|last| last.key != key) {
            if let Some(last) = segments.last().filter(|last| last.key > key) {
                let message =
                    format!("`{key}` cannot follow `{}`; the order is: {}", last.key, SegmentKey::allowed());
                return Err(place.error(number, "segment", message));
            }
            let (wall, source) = (key.default_wall(), String::new());
            segments.push(SegmentPoints { key, points_m: Vec::new(), radii_m: Vec::new(), wall, source });
        }
        let mut position = [0.0; 3];
        for ((axis, name), column) in position.iter_mut().zip(["x", "y", "z"]).zip(columns.position) {
            *axis = finite(&place, number, name, cell(&place, number, &cells, name, column)?)?;
        }
        let radius = radius_m(&place, number, &cells, columns, table)?;
        // The loop pushed a segment if there was none.
        if let Some(segment) = segments.last_mut() {
            segment.points_m.push(table.frame.torso_from_file(Point3::from(position)));
            segment.radii_m.push(radius);
        }
    }
    if segments.is_empty() {
        return Err(place.error(1, "", "there are no points in this file".to_owned()));
    }
    Ok(segments)
}

fn header(place: &Place<'_>, line: usize, cells: &[&str]) -> Result<Columns, ConfigError> {
    const ALLOWED: &str = "segment, s, x, y, z, radius (in metres; s and radius may be missing)";
    let find =
        |name: &str| cells.iter().position(|cell| cell.trim_end_matches("_m").eq_ignore_ascii_case(name));
    if let Some(unknown) = cells
        .iter()
        .find(|cell| !["segment", "s", "x", "y", "z", "radius"].contains(&cell.trim_end_matches("_m")))
    {
        return Err(place.error(line, unknown, format!("unknown column; allowed: {ALLOWED}")));
    }
    let need = |name: &str| {
        find(name)
            .ok_or_else(|| place.error(line, name, format!("the column is missing; allowed: {ALLOWED}")))
    };
    Ok(Columns {
        segment: need("segment")?,
        position: [need("x")?, need("y")?, need("z")?],
        radius: find("radius"),
    })
}

fn cell<'a>(
    place: &Place<'_>,
    line: usize,
    cells: &[&'a str],
    name: &str,
    column: usize,
) -> Result<&'a str, ConfigError> {
    cells
        .get(column)
        .copied()
        .ok_or_else(|| place.error(line, name, "the line ends before this column".to_owned()))
}

fn segment_key(
    place: &Place<'_>,
    line: usize,
    name: &str,
    table: &TractTable,
) -> Result<SegmentKey, ConfigError> {
    table.segment_names.get(name).copied().or_else(|| SegmentKey::from_name(name)).ok_or_else(|| {
        let message = format!(
            "no segment is called `{name}`; allowed: {}; or say which one it is in the TOML: segment_names = {{ {name} = \"…\" }}",
            SegmentKey::allowed()
        );
        place.error(line, "segment", message)
    })
}

fn finite(place: &Place<'_>, line: usize, name: &str, text: &str) -> Result<f64, ConfigError> {
    text.parse::<f64>()
        .ok()
        .filter(|value| value.is_finite())
        .ok_or_else(|| place.error(line, name, format!("`{text}` is not a finite number")))
}

fn radius_m(
    place: &Place<'_>,
    line: usize,
    cells: &[&str],
    columns: &Columns,
    table: &TractTable,
) -> Result<f64, ConfigError> {
    let text = columns.radius.and_then(|column| cells.get(column)).copied().unwrap_or("");
    if text.is_empty() {
        return table.default_radius_mm.map(|radius| 1e-3 * radius.0).ok_or_else(|| {
            let message = "no radius here: give one, or `default_radius_mm` in the TOML".to_owned();
            place.error(line, "radius", message)
        });
    }
    let radius = finite(place, line, "radius", text)?;
    if radius > 0.0 {
        Ok(radius)
    } else {
        Err(place.error(line, "radius", format!("a radius of {radius} is not allowed; it must be above 0")))
    }
}
