//! Recorded lines of response.
//!
//! | `format` | rows | told apart by |
//! |---|---|---|
//! | `lines` | `t_ms,x1_mm,y1_mm,z1_mm,x2_mm,y2_mm,z2_mm`, in any order under a header; in this order without one, as the `pept` library writes them (more columns may follow) | a header with `x1_mm`; seven numbers or more |
//! | `list-mode` | `t_ms,xa,za,xb,zb`: indices of the crystals that fired, with the scanner's file | a header with `xa` |
//! | `two-plane` | free text with `Separation= 712`, then `t_ms x1 y1 x2 y2` on the planes z = 0 and z = separation, mm | the free text |
//! | `readings` | what `run --save-readings` writes: `t_s,sequence,start_s,end_s,arrival_s` and the columns of `lines` | a header with `sequence` |
//!
//! Text (also `.gz`; separated by commas, semicolons or white space, `#` comments) or, for the first two, Parquet with the same
//! columns. Lines become readings by windows: so many lines, or so many milliseconds; `readings` have their own. A window without
//! lines is a reading without lines; the last window holds what is left. Memory does not grow with the file.
//!
//! Bad rows: `strict` stops at the first; `skip` passes over the row, not over its window, and hands out what it passed over. A text
//! file whose last line has no end counts as cut: its last number may lack digits. `two-plane` lines are moved to the scanner's
//! frame: the planes stand at z = ± separation / 2, `plane_centre_mm` on the axis. An end that lies at no block of the installed scanner is a
//! bad row: another unit, another frame or another scanner.

mod line_file;
mod parquet;
mod saved;
mod two_plane;
mod windows;

use crate::Scanner;
use crate::line::SHORTEST_LINE_M;
use lumenav_core::config::quantity::{Finite, NonNegative, Positive};
use lumenav_core::{ModalityError, Node, ReadingStream, Setup};
use lumenav_records::BadRows;
use lumenav_records::columns::is_parquet;
use lumenav_records::rows::{Cells, RowReader, Separator};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// `[sensor.files]` of a replay.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FilesTable {
    /// The lines' file.
    pub lines: String,
    /// What its rows are; see the head of this file.
    #[serde(default)]
    pub format: Format,
    /// Lines in a window.
    pub window_lines: Option<u32>,
    /// Length of a window, ms.
    pub window_ms: Option<Positive>,
    /// Share of a window that the next one repeats.
    #[serde(default)]
    pub overlap: NonNegative,
    /// Time that becomes 0, ms.
    #[serde(default)]
    pub time_zero_ms: Finite,
    /// The longest pause between two lines, s.
    #[serde(default = "a_minute")]
    pub max_gap_s: Positive,
    /// Added to all places, mm: puts the scanner's centre on the world's origin.
    #[serde(default)]
    pub origin_mm: [Finite; 3],
    /// The place on the planes of a `two-plane` file that lies on the scanner's axis, mm.
    #[serde(default = "middle_of_the_screens")]
    pub plane_centre_mm: [Finite; 2],
    /// `strict` or `skip`.
    #[serde(default)]
    pub bad_rows: BadRows,
    /// Poses that encoders told (`scanner = "pet.scanner.tum"`: where a bed has put it), beside saved readings.
    #[serde(default)]
    pub poses: BTreeMap<String, String>,
}

/// What the rows of a file are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Format {
    /// Told apart by the file's beginning.
    #[default]
    Auto,
    /// Both ends of each line.
    Lines,
    /// Crystal indices.
    ListMode,
    /// Places on two parallel planes.
    TwoPlane,
    /// Saved readings.
    Readings,
}

/// Window where a file of lines names none, ms (than2015: one localization run).
const WINDOW_MS: f64 = 50.0;

fn a_minute() -> Positive {
    Positive(60.0)
}

fn middle_of_the_screens() -> [Finite; 2] {
    [Finite(301.75); 2]
}

/// Where the defaults of this table come from: key and source.
pub const FILES_SOURCES: [(&str, &str); 11] = [
    ("format", "chosen: told apart by the file's beginning"),
    ("window_lines", "chosen: windows by time"),
    ("window_ms", "than2015, chapter 3: 50 ms; saved readings have their own windows"),
    ("overlap", "chosen: every line counts once"),
    ("time_zero_ms", "chosen: the file's own zero"),
    ("max_gap_s", "chosen: after a minute without a line it is another recording"),
    ("origin_mm", "chosen: the file's frame is the scanner's"),
    (
        "plane_centre_mm",
        "middle of the coordinates 109.7 to 493.8 and 44.8 to 558.7 mm in the University of Birmingham's ADAC Forte samples",
    ),
    ("bad_rows", "chosen: stop at the first"),
    ("poses", "chosen: nothing moves but the capsule"),
    ("scanner", "the sensor's [installed] table"),
];

/// A row: `t_ms` and both ends, mm.
type LineRow = [f64; 7];

/// A file of lines, one after another.
trait LineSource: Send {
    /// The next line; `None` at the end. After a [`ModalityError::Row`] the source can go on behind the row.
    fn next_line(&mut self) -> Result<Option<LineRow>, ModalityError>;

    /// An error at the line last handed out.
    fn error(&self, message: &str) -> ModalityError;
}

/// Coordinates beyond this are another unit or a wrong column, mm: no scanner is larger.
const MAX_COORDINATE_MM: f64 = 10_000.0;

/// Refuses what is no line: a place out of range, both ends at one place.
#[inline]
fn check(row: &LineRow) -> Result<(), String> {
    let [_, x1, y1, z1, x2, y2, z2] = row;
    let (dx, dy, dz) = (x2 - x1, y2 - y1, z2 - z1);
    let far = row[1..].iter().any(|v| v.abs() > MAX_COORDINATE_MM);
    let short = dx * dx + dy * dy + dz * dz < (SHORTEST_LINE_M * 1e3).powi(2);
    match (far, short) {
        (false, false) => Ok(()),
        (true, _) => Err(format!("a place beyond {MAX_COORDINATE_MM} mm; places must be in mm")),
        _ => Err("a line of length zero: both ends are at one place".to_owned()),
    }
}

/// Opens recorded lines of a scanner.
///
/// # Errors
/// [`ModalityError`] with file, line and column, of the replay or of the recorded data.
pub fn open(scanner: &Scanner, node: &Node, setup: &Setup) -> Result<ReadingStream, ModalityError> {
    let files: FilesTable = node.parse_sourced(&FILES_SOURCES)?;
    let path = node.existing_path("lines", &files.lines)?;
    let packed = is_parquet(&path);
    let format = match files.format {
        Format::Auto if packed => parquet::format_of(&path)?,
        Format::Auto => format_of(&path, node)?,
        format => format,
    };
    if packed && matches!(format, Format::TwoPlane | Format::Readings) {
        let message = "a Parquet file holds `lines` or `list-mode`";
        return Err(node.error_at("format", message).into());
    }
    if format == Format::Readings {
        return Ok(Box::new(saved::SavedReader::open(&path, scanner, node, &files, setup)?));
    }
    if !files.poses.is_empty() {
        return Err(node.error_at("poses", "only saved readings have poses beside them").into());
    }
    let source: Box<dyn LineSource> = match format {
        _ if packed => Box::new(parquet::ParquetLines::open(&path, format, scanner)?),
        Format::TwoPlane => Box::new(two_plane::TwoPlaneFile::open(&path, &files, scanner)?),
        format => Box::new(line_file::LineFile::open(&path, format, scanner)?),
    };
    Ok(Box::new(windows::Windows::new(source, scanner, node, &files, setup)?))
}

/// What a text file holds, by its first row.
fn format_of(path: &Path, node: &Node) -> Result<Format, ModalityError> {
    let mut rows = RowReader::open(path)?;
    let Some(row) = rows.next_row()? else { return Ok(Format::Lines) };
    let separator = Separator::of(row.bytes);
    let mut cells = Cells::new(row.bytes, separator);
    let numbers: Vec<bool> = std::iter::from_fn(|| cells.number()).map(|cell| cell.is_ok()).collect();
    if numbers.iter().all(|is_number| *is_number) {
        return match numbers.len() {
            5 => {
                let message =
                    format!("{} has five columns and no header: `list-mode` or `two-plane`?", path.display());
                Err(node.error_at("format", &message).into())
            }
            _ => Ok(Format::Lines),
        };
    }
    let names = header(row.bytes, separator);
    let has = |name: &str| names.iter().any(|n| n == name);
    Ok(if has("sequence") {
        Format::Readings
    } else if has("xa") {
        Format::ListMode
    } else if has("x1_mm") || has("t_ms") {
        Format::Lines
    } else if separator == Separator::Space || two_plane::has_separation(path)? {
        Format::TwoPlane
    } else {
        // The reader of lines then says which columns it misses.
        Format::Lines
    })
}

/// Names of the columns.
fn header(row: &[u8], separator: Separator) -> Vec<String> {
    let mut cells = Cells::new(row, separator);
    std::iter::from_fn(|| cells.text())
        .map(|cell| String::from_utf8_lossy(cell).trim_matches('"').trim().to_owned())
        .collect()
}
