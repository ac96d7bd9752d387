//! Two parallel planes, as the University of Birmingham shares its recordings: free text with `Separation= 712`, then rows
//! `t_ms x1 y1 x2 y2` in millimetres on the planes z = 0 and z = separation.

use super::line_file::CUT;
use super::{FilesTable, LineRow, LineSource, check};
use crate::Scanner;
use lumenav_core::ModalityError;
use lumenav_records::rows::{Cells, RawRow, RowReader, Separator, shown};
use nalgebra::Vector3;
use std::path::Path;

/// The free text is at most so many lines long.
const MAX_HEADER_LINES: u64 = 1000;
const COLUMNS: [&str; 5] = ["t_ms", "x1", "y1", "x2", "y2"];
/// The scanner's planes may differ from the file's separation by this much, mm: half a crystal's depth, and rounding.
const SEPARATION_SLACK_MM: f64 = 10.0;

/// Whether the beginning of a text names a separation.
pub(super) fn has_separation(path: &Path) -> Result<bool, ModalityError> {
    let mut rows = RowReader::open(path)?;
    while let Some(row) = rows.next_row()? {
        if separation(row.bytes).is_some() {
            return Ok(true);
        }
        if row.line > MAX_HEADER_LINES {
            break;
        }
    }
    Ok(false)
}

/// The number behind `Separation=`, mm; an error for one that is no separation.
fn separation(row: &[u8]) -> Option<Result<f64, String>> {
    let text = String::from_utf8_lossy(row).to_ascii_lowercase();
    let behind = text.split_once("separation")?.1.trim_start();
    let number = behind.strip_prefix(['=', ':'])?.split_whitespace().next().unwrap_or_default();
    let allowed = |v: &f64| *v > 0.0 && *v < super::MAX_COORDINATE_MM;
    let parsed = number.parse::<f64>().ok().filter(allowed);
    Some(parsed.ok_or_else(|| {
        format!("`Separation={}` is no distance of two planes in mm", shown(number.as_bytes()))
    }))
}

fn numbers(row: &[u8]) -> Option<[f64; 5]> {
    let mut cells = Cells::new(row, Separator::of(row));
    let mut values = [0.0; 5];
    for value in &mut values {
        *value = cells.number()?.ok()?;
    }
    cells.text().is_none().then_some(values)
}

/// A two-plane file.
pub(super) struct TwoPlaneFile {
    rows: RowReader,
    separation_mm: f64,
    centre_mm: [f64; 2],
    /// The first row of numbers, read while looking for it.
    ahead: Option<[f64; 5]>,
}

impl TwoPlaneFile {
    pub(super) fn open(path: &Path, files: &FilesTable, scanner: &Scanner) -> Result<Self, ModalityError> {
        let mut rows = RowReader::open(path)?;
        let (mut separation_mm, mut ahead) = (None, None);
        while ahead.is_none() {
            let found = match rows.next_row()? {
                Some(row) if row.line <= MAX_HEADER_LINES => {
                    if let Some(found) = separation(row.bytes) {
                        found.map(|v| separation_mm = Some(v))
                    } else {
                        ahead = numbers(row.bytes);
                        Ok(())
                    }
                }
                _ => Err(format!(
                    "no row of five numbers ({}) within {MAX_HEADER_LINES} lines",
                    COLUMNS.join(" ")
                )),
            };
            found.map_err(|message| rows.error(&message))?;
        }
        let Some(separation_mm) = separation_mm else {
            return Err(rows.error("the text before the numbers does not say `Separation= …`"));
        };
        check_planes(scanner, separation_mm).map_err(|message| rows.error(&message))?;
        Ok(Self { rows, separation_mm, centre_mm: files.plane_centre_mm.map(|v| v.0), ahead })
    }

    fn line(&self, [t, x1, y1, x2, y2]: [f64; 5]) -> Result<LineRow, String> {
        let ([cx, cy], half) = (self.centre_mm, 0.5 * self.separation_mm);
        let row = [t, x1 - cx, y1 - cy, -half, x2 - cx, y2 - cy, half];
        check(&row).map(|()| row)
    }
}

/// The scanner's blocks must be the two planes, or its noise would be another's.
fn check_planes(scanner: &Scanner, separation_mm: f64) -> Result<(), String> {
    let at = |block: usize| scanner.blocks[block].centre_world_m.z * 1e3;
    let along = |block: usize| scanner.blocks[block].outward.cross(&Vector3::z()).norm() < 1e-6;
    if scanner.blocks.len() != 2 || !along(0) || !along(1) {
        return Err(format!("scanner `{}` is not two planes across the z axis", scanner.name));
    }
    let (low, high) = (at(0).min(at(1)), at(0).max(at(1)));
    let half = 0.5 * separation_mm;
    if (low + half).abs() > SEPARATION_SLACK_MM || (high - half).abs() > SEPARATION_SLACK_MM {
        return Err(format!(
            "the planes are {separation_mm} mm apart, those of scanner `{}` stand at z = {low:.1} and {high:.1} mm; expected -{half} and \
             {half}, or another scanner",
            scanner.name
        ));
    }
    Ok(())
}

fn parse(row: &RawRow<'_>) -> Result<[f64; 5], String> {
    let cut = if row.is_complete { "" } else { ", and no line end: the file is cut" };
    let mut cells = Cells::new(row.bytes, Separator::of(row.bytes));
    let mut values = [0.0; 5];
    for (i, value) in values.iter_mut().enumerate() {
        *value = match cells.number() {
            Some(Ok(value)) => value,
            Some(Err(cell)) => {
                return Err(format!(
                    "column {} (`{}`) holds `{}`; a finite number is allowed",
                    i + 1,
                    COLUMNS[i],
                    shown(cell)
                ));
            }
            None => return Err(format!("{i} columns, expected 5: {}{cut}", COLUMNS.join(" "))),
        };
    }
    if cells.text().is_some() {
        return Err(format!("more than 5 columns; expected {}", COLUMNS.join(" ")));
    }
    if row.is_complete { Ok(values) } else { Err(CUT.to_owned()) }
}

impl LineSource for TwoPlaneFile {
    fn next_line(&mut self) -> Result<Option<LineRow>, ModalityError> {
        let values = match self.ahead.take() {
            Some(values) => Ok(values),
            None => match self.rows.next_row()? {
                None => return Ok(None),
                Some(row) => parse(&row),
            },
        };
        values.and_then(|v| self.line(v)).map(Some).map_err(|message| self.rows.error(&message))
    }

    fn error(&self, message: &str) -> ModalityError {
        self.rows.error(message)
    }
}
