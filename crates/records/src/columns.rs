//! Columns of numbers from a Parquet file, a few thousand rows at a time.
//!
//! Read are `DOUBLE`, `FLOAT`, `INT32` and `INT64` columns, flat, in any of the usual packings. A cell without a value is NaN. Behind
//! the cargo feature `parquet`; without it every file is refused with a message that says so.

use lumenav_core::ModalityError;
use std::path::Path;

/// Rows that are read at a time.
pub const BATCH_ROWS: usize = 8192;

/// Whether a file is Parquet, by its first four bytes.
pub fn is_parquet(path: &Path) -> bool {
    let mut magic = [0; 4];
    let read = std::fs::File::open(path).and_then(|mut f| std::io::Read::read_exact(&mut f, &mut magic));
    read.is_ok() && magic == *b"PAR1"
}

/// Names of a file's columns, and the numbers of the wanted ones.
pub struct ColumnReader {
    file: String,
    inner: implementation::Columns,
}

impl ColumnReader {
    /// Opens a file.
    ///
    /// # Errors
    /// [`ModalityError::File`]: not there, no Parquet, cut short.
    pub fn open(path: &Path) -> Result<Self, ModalityError> {
        let file = path.display().to_string();
        match implementation::Columns::open(path) {
            Ok(inner) => Ok(Self { file, inner }),
            Err(message) => Err(cannot_read(&file, message)),
        }
    }

    /// The file's name, for messages.
    pub fn file(&self) -> &str {
        &self.file
    }

    /// Names of the columns, in the file's order.
    pub fn names(&self) -> Vec<String> {
        self.inner.names()
    }

    /// Chooses the columns that [`Self::next_batch`] reads.
    ///
    /// # Errors
    /// [`ModalityError::Row`] at row 1 for a column that is not there or holds no numbers.
    pub fn choose(&mut self, names: &[&str]) -> Result<(), ModalityError> {
        self.inner.choose(names).map_err(|message| ModalityError::Row {
            file: self.file.clone(),
            line: 1,
            message,
        })
    }

    /// Reads the next rows, at most [`BATCH_ROWS`], into one vector per chosen column; the number of rows, 0 at the end.
    ///
    /// # Errors
    /// [`ModalityError::File`] for a damaged file.
    pub fn next_batch(&mut self, out: &mut Vec<Vec<f64>>) -> Result<usize, ModalityError> {
        self.inner.next_batch(out).map_err(|message| cannot_read(&self.file, message))
    }
}

fn cannot_read(file: &str, message: String) -> ModalityError {
    let source = std::io::Error::new(std::io::ErrorKind::InvalidData, message);
    ModalityError::File { file: file.to_owned(), source }
}

#[cfg(not(feature = "parquet"))]
mod implementation {
    use std::path::Path;

    /// No file can be opened, so there is no value of this type.
    pub(super) enum Columns {}

    impl Columns {
        pub(super) fn open(_: &Path) -> Result<Self, String> {
            Err("this program was built without the feature `parquet`; save the file as CSV".to_owned())
        }

        pub(super) fn names(&self) -> Vec<String> {
            match *self {}
        }

        pub(super) fn choose(&mut self, _: &[&str]) -> Result<(), String> {
            match *self {}
        }

        pub(super) fn next_batch(&mut self, _: &mut Vec<Vec<f64>>) -> Result<usize, String> {
            match *self {}
        }
    }
}

#[cfg(feature = "parquet")]
mod implementation {
    use super::BATCH_ROWS;
    use parquet::basic::Type;
    use parquet::column::reader::{ColumnReader as PageReader, ColumnReaderImpl};
    use parquet::data_type::DataType;
    use parquet::file::reader::{FileReader as _, SerializedFileReader};
    use std::fs::File;
    use std::panic::{AssertUnwindSafe, catch_unwind};
    use std::path::Path;

    pub(super) struct Columns {
        reader: SerializedFileReader<File>,
        chosen: Vec<usize>,
        /// The next row group.
        group: usize,
        /// Readers of the chosen columns in the row group at hand, and the rows that are left in it.
        pages: Vec<PageReader>,
        rows_left: usize,
    }

    /// The library checks most of what a damaged file can do to it, not all: a panic of its own is an error like the others.
    fn guarded<T>(work: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
        catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|_| Err("damaged Parquet file".to_owned()))
    }

    impl Columns {
        pub(super) fn open(path: &Path) -> Result<Self, String> {
            let file = File::open(path).map_err(|error| error.to_string())?;
            let reader = guarded(|| SerializedFileReader::new(file).map_err(|error| error.to_string()))?;
            Ok(Self { reader, chosen: Vec::new(), group: 0, pages: Vec::new(), rows_left: 0 })
        }

        pub(super) fn names(&self) -> Vec<String> {
            let schema = self.reader.metadata().file_metadata().schema_descr();
            schema.columns().iter().map(|column| column.path().string()).collect()
        }

        pub(super) fn choose(&mut self, names: &[&str]) -> Result<(), String> {
            let schema = self.reader.metadata().file_metadata().schema_descr();
            let there = self.names();
            let mut chosen = Vec::new();
            for name in names {
                let Some(index) = there.iter().position(|n| n == name) else {
                    return Err(format!("no column `{name}`; the file has: {}", there.join(", ")));
                };
                let column = schema.column(index);
                let is_number =
                    matches!(column.physical_type(), Type::DOUBLE | Type::FLOAT | Type::INT32 | Type::INT64);
                if !is_number || column.max_rep_level() > 0 || column.max_def_level() > 1 {
                    return Err(format!(
                        "column `{name}` is {}; a flat column of DOUBLE, FLOAT, INT32 or INT64 is allowed",
                        column.physical_type()
                    ));
                }
                chosen.push(index);
            }
            self.chosen = chosen;
            Ok(())
        }

        pub(super) fn next_batch(&mut self, out: &mut Vec<Vec<f64>>) -> Result<usize, String> {
            out.resize_with(self.chosen.len(), Vec::new);
            guarded(|| {
                while self.rows_left == 0 {
                    if self.group == self.reader.num_row_groups() {
                        return Ok(0);
                    }
                    self.open_group()?;
                }
                let rows = self.rows_left.min(BATCH_ROWS);
                for (pages, out) in self.pages.iter_mut().zip(out.iter_mut()) {
                    read_column(pages, rows, out)?;
                }
                self.rows_left -= rows;
                Ok(rows)
            })
        }

        fn open_group(&mut self) -> Result<(), String> {
            let group = self.reader.get_row_group(self.group).map_err(|error| error.to_string())?;
            let metadata = group.metadata();
            for index in &self.chosen {
                let size = metadata.column(*index).uncompressed_size();
                let values = metadata.column(*index).num_values();
                if size < 0 || values < 0 || values != metadata.num_rows() {
                    return Err(format!("row group {}: damaged metadata", self.group));
                }
            }
            self.pages = self
                .chosen
                .iter()
                .map(|index| group.get_column_reader(*index).map_err(|error| error.to_string()))
                .collect::<Result<_, _>>()?;
            self.rows_left = usize::try_from(metadata.num_rows()).map_err(|error| error.to_string())?;
            self.group += 1;
            Ok(())
        }
    }

    fn read_column(pages: &mut PageReader, rows: usize, out: &mut Vec<f64>) -> Result<(), String> {
        out.clear();
        match pages {
            PageReader::DoubleColumnReader(reader) => read_values(reader, rows, out, |v| v),
            PageReader::FloatColumnReader(reader) => read_values(reader, rows, out, f64::from),
            PageReader::Int32ColumnReader(reader) => read_values(reader, rows, out, f64::from),
            PageReader::Int64ColumnReader(reader) => read_values(reader, rows, out, |v| v as f64),
            _ => Err("a column changes its type".to_owned()),
        }
    }

    fn read_values<T: DataType>(
        reader: &mut ColumnReaderImpl<T>,
        rows: usize,
        out: &mut Vec<f64>,
        number: impl Fn(T::T) -> f64,
    ) -> Result<(), String>
    where
        T::T: Copy,
    {
        let (mut values, mut levels) = (Vec::with_capacity(rows), Vec::with_capacity(rows));
        let (records, _, _) = reader
            .read_records(rows, Some(&mut levels), None, &mut values)
            .map_err(|error| error.to_string())?;
        if records != rows {
            return Err(format!("{records} values where {rows} were announced"));
        }
        if levels.is_empty() {
            out.extend(values.iter().map(|v| number(*v)));
        } else {
            let mut values = values.iter();
            out.extend(levels.iter().map(|level| {
                if *level > 0 { values.next().map_or(f64::NAN, |v| number(*v)) } else { f64::NAN }
            }));
        }
        Ok(())
    }
}
