//! Recorded data, read row by row: CSV with a header line, `#` comments, `.gz` as it is.
//!
//! Shared by the readers of all modalities, so that a bad row is always reported the same way: file, line, column, what is
//! allowed. The policy is `strict` (stop at the first) or `skip` (count and go on), never silence. Memory does not grow with
//! the file.

use lumenav_core::ModalityError;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::Read;
use std::path::Path;

pub mod columns;
pub mod place;
pub mod rows;
pub mod tum;

/// What to do with a bad row.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BadRows {
    /// Stop with an error.
    #[default]
    Strict,
    /// Count it and go on.
    Skip,
}

/// A CSV file being read.
pub struct Table {
    file: String,
    reader: csv::Reader<Box<dyn Read + Send>>,
    headers: Vec<String>,
    record: csv::StringRecord,
}

/// One row, with its place.
pub struct Row<'a> {
    file: &'a str,
    headers: &'a [String],
    record: &'a csv::StringRecord,
}

/// Opens a file for reading, unpacking `.gz`.
///
/// # Errors
/// [`ModalityError::File`] with the path.
pub fn open(path: &Path) -> Result<Box<dyn Read + Send>, ModalityError> {
    let file = File::open(path)
        .map_err(|source| ModalityError::File { file: path.display().to_string(), source })?;
    let packed = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("gz"));
    Ok(if packed { Box::new(flate2::read::MultiGzDecoder::new(file)) } else { Box::new(file) })
}

impl Table {
    /// Opens a file with a header line.
    ///
    /// # Errors
    /// [`ModalityError::File`] or [`ModalityError::Row`] with file and line.
    pub fn open(path: &Path) -> Result<Self, ModalityError> {
        let file = path.display().to_string();
        let mut reader =
            csv::ReaderBuilder::new().comment(Some(b'#')).trim(csv::Trim::All).from_reader(open(path)?);
        let headers =
            reader.headers().map_err(|error| row_error(&file, &error))?.iter().map(str::to_owned).collect();
        Ok(Self { file, reader, headers, record: csv::StringRecord::new() })
    }

    /// The file's name, for messages.
    pub fn file(&self) -> &str {
        &self.file
    }

    /// Names of the columns.
    pub fn headers(&self) -> &[String] {
        &self.headers
    }

    /// Index of a column.
    ///
    /// # Errors
    /// [`ModalityError::Row`] at line 1 with the columns that there are.
    pub fn column(&self, name: &str) -> Result<usize, ModalityError> {
        self.headers.iter().position(|h| h == name).ok_or_else(|| ModalityError::Row {
            file: self.file.clone(),
            line: 1,
            message: format!("no column `{name}`; the file has: {}", self.headers.join(", ")),
        })
    }

    /// The next row; `None` at the end of the file.
    ///
    /// # Errors
    /// [`ModalityError::Row`] for a row with another number of cells than the header, or text that is not UTF-8.
    pub fn next_row(&mut self) -> Option<Result<Row<'_>, ModalityError>> {
        match self.reader.read_record(&mut self.record) {
            Ok(true) => Some(Ok(Row { file: &self.file, headers: &self.headers, record: &self.record })),
            Ok(false) => None,
            Err(error) => Some(Err(row_error(&self.file, &error))),
        }
    }
}

/// A bad row, or a file that cannot be read on (a packed file cut short): the latter is no row that could be skipped.
fn row_error(file: &str, error: &csv::Error) -> ModalityError {
    if let csv::ErrorKind::Io(source) = error.kind() {
        let source = std::io::Error::new(source.kind(), source.to_string());
        return ModalityError::File { file: file.to_owned(), source };
    }
    let line = error.position().map_or(1, csv::Position::line);
    let message = match error.kind() {
        csv::ErrorKind::UnequalLengths { expected_len, len, .. } => {
            format!("{len} cells, the header has {expected_len}")
        }
        csv::ErrorKind::Utf8 { .. } => "not UTF-8 text".to_owned(),
        _ => error.to_string(),
    };
    ModalityError::Row { file: file.to_owned(), line, message }
}

impl Row<'_> {
    /// The line in the file, from 1.
    pub fn line(&self) -> u64 {
        self.record.position().map_or(0, csv::Position::line)
    }

    /// A cell as text.
    pub fn text(&self, column: usize) -> &str {
        self.record.get(column).unwrap_or_default()
    }

    /// A number that must be there and finite.
    ///
    /// # Errors
    /// [`ModalityError::Row`] with file, line and column.
    pub fn number(&self, column: usize) -> Result<f64, ModalityError> {
        self.optional(column)?
            .ok_or_else(|| self.error(&format!("column `{}` is empty", self.headers[column])))
    }

    /// A finite number, or `None` for an empty cell (a lost reading).
    ///
    /// # Errors
    /// [`ModalityError::Row`] where the cell holds something else.
    pub fn optional(&self, column: usize) -> Result<Option<f64>, ModalityError> {
        let text = self.text(column);
        if text.is_empty() {
            return Ok(None);
        }
        match text.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(Some(value)),
            _ => Err(self.error(&format!(
                "column `{}` holds `{text}`; a finite number is allowed",
                self.headers[column]
            ))),
        }
    }

    /// An error at this row.
    pub fn error(&self, message: &str) -> ModalityError {
        ModalityError::Row { file: self.file.to_owned(), line: self.line(), message: message.to_owned() }
    }
}
