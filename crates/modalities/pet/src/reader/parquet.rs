//! Lines and list mode as Parquet.

use super::line_file::{Crystals, wanted};
use super::{Format, LineRow, LineSource, check};
use crate::Scanner;
use lumenav_core::ModalityError;
use lumenav_records::columns::ColumnReader;
use std::path::Path;

/// What a file holds, by its columns.
pub(super) fn format_of(path: &Path) -> Result<Format, ModalityError> {
    let is_list_mode = ColumnReader::open(path)?.names().iter().any(|name| name == "xa");
    Ok(if is_list_mode { Format::ListMode } else { Format::Lines })
}

/// A Parquet file of lines or list mode.
pub(super) struct ParquetLines {
    reader: ColumnReader,
    wanted: &'static [&'static str],
    crystals: Option<Crystals>,
    batch: Vec<Vec<f64>>,
    rows: usize,
    /// The next row of the batch.
    next: usize,
    /// Rows handed out before and in this batch.
    row: u64,
}

impl ParquetLines {
    pub(super) fn open(path: &Path, format: Format, scanner: &Scanner) -> Result<Self, ModalityError> {
        let wanted = wanted(format);
        let mut reader = ColumnReader::open(path)?;
        reader.choose(wanted)?;
        let crystals = (format == Format::ListMode).then(|| Crystals::new(scanner));
        Ok(Self { reader, wanted, crystals, batch: Vec::new(), rows: 0, next: 0, row: 0 })
    }

    fn line(&self, values: &LineRow) -> Result<LineRow, String> {
        if let Some(bad) = values[..self.wanted.len()].iter().position(|v| !v.is_finite()) {
            return Err(format!("column `{}` holds no finite number", self.wanted[bad]));
        }
        match &self.crystals {
            Some(crystals) => crystals.line(values),
            None => check(values).map(|()| *values),
        }
    }
}

impl LineSource for ParquetLines {
    fn next_line(&mut self) -> Result<Option<LineRow>, ModalityError> {
        if self.next == self.rows {
            self.rows = self.reader.next_batch(&mut self.batch)?;
            self.next = 0;
            if self.rows == 0 {
                return Ok(None);
            }
        }
        let mut values = [0.0; 7];
        for (value, column) in values.iter_mut().zip(&self.batch) {
            *value = column[self.next];
        }
        self.next += 1;
        self.row += 1;
        self.line(&values).map(Some).map_err(|message| self.error(&message))
    }

    /// The place is the row, from 1.
    fn error(&self, message: &str) -> ModalityError {
        let message = format!("row {}: {message}", self.row);
        ModalityError::Row { file: self.reader.file().to_owned(), line: self.row, message }
    }
}
