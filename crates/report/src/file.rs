//! Files that are written piece by piece, with errors that name them.

use crate::error::ReportError;
use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};

/// A buffered file that knows its name.
#[derive(Debug)]
pub(crate) struct OutputFile {
    writer: BufWriter<File>,
    path: PathBuf,
    /// Set where the file is written beside its name and renamed at the end.
    part: Option<PathBuf>,
}

impl OutputFile {
    /// Writes under the name itself: for files of a folder that appears as a whole.
    pub(crate) fn in_place(path: &Path) -> Result<Self, ReportError> {
        let file = File::create(path).map_err(ReportError::file("cannot create", path))?;
        Ok(Self { writer: BufWriter::new(file), path: path.to_owned(), part: None })
    }

    /// Writes beside the name and renames at the end: the file appears whole or not at all.
    pub(crate) fn beside(path: &Path) -> Result<Self, ReportError> {
        let name = path.file_name().ok_or_else(|| ReportError::NoName(path.to_owned()))?;
        let mut part = name.to_owned();
        part.push(".part");
        let part = path.with_file_name(part);
        let file = File::create(&part).map_err(ReportError::file("cannot create", &part))?;
        Ok(Self { writer: BufWriter::new(file), path: path.to_owned(), part: Some(part) })
    }

    /// Appends bytes.
    pub(crate) fn write(&mut self, bytes: &[u8]) -> Result<(), ReportError> {
        self.writer.write_all(bytes).map_err(ReportError::file("cannot write", &self.path))
    }

    /// Appends a line.
    pub(crate) fn line(&mut self, line: &str) -> Result<(), ReportError> {
        self.write(line.as_bytes())?;
        self.write(b"\n")
    }

    /// Flushes to the disk; a file beside its name gets it.
    pub(crate) fn finish(&mut self) -> Result<(), ReportError> {
        self.writer.flush().map_err(ReportError::file("cannot write", &self.path))?;
        self.writer
            .get_ref()
            .sync_all()
            .or_else(ignore_no_disk)
            .map_err(ReportError::file("cannot write", &self.path))?;
        if let Some(part) = self.part.take() {
            std::fs::rename(&part, &self.path)
                .map_err(ReportError::file("cannot rename into", &self.path))?;
        }
        Ok(())
    }
}

impl Drop for OutputFile {
    fn drop(&mut self) {
        if let Some(part) = &self.part {
            std::fs::remove_file(part).ok();
        }
    }
}

/// Devices and pipes (`/dev/stdout`) cannot be synchronised; that is no loss.
fn ignore_no_disk(error: std::io::Error) -> std::io::Result<()> {
    if error.kind() == std::io::ErrorKind::InvalidInput { Ok(()) } else { Err(error) }
}

/// Writes a whole document in place.
pub(crate) fn write_json<T: serde::Serialize>(path: &Path, document: &T) -> Result<(), ReportError> {
    let text = serde_json::to_string_pretty(document)
        .map_err(|source| ReportError::Json { path: path.to_owned(), source })?;
    let mut file = OutputFile::in_place(path)?;
    file.line(&text)?;
    file.finish()
}

/// Nanoseconds as seconds with nine decimals, exactly.
pub(crate) fn seconds_text(nanoseconds: i64) -> String {
    let sign = if nanoseconds < 0 { "-" } else { "" };
    let magnitude = nanoseconds.unsigned_abs();
    format!("{sign}{}.{:09}", magnitude / 1_000_000_000, magnitude % 1_000_000_000)
}

/// A CSV cell; quoted where it must be.
pub(crate) fn csv_cell(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lumenav_core::SimTime;

    #[test]
    fn law_times_round_trip_to_the_nanosecond() {
        for ns in [0, 1, -1, 999_999_999, -5_000_000_007, 28_800_000_000_001, 1_700_000_000_123_456_789] {
            assert_eq!(SimTime::parse_seconds(&seconds_text(ns)), Some(SimTime(ns)));
        }
        assert_eq!(seconds_text(-5_000_000_007), "-5.000000007");
    }

    #[test]
    fn law_a_full_disk_is_an_error_that_names_the_file() {
        let full = Path::new("/dev/full");
        if !full.exists() {
            return;
        }
        let mut file = OutputFile::in_place(full).unwrap();
        let error = file.line("something").and_then(|()| file.finish()).unwrap_err();
        assert!(error.to_string().starts_with("cannot write /dev/full: "), "{error}");
    }

    #[test]
    fn law_an_unfinished_file_does_not_appear() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
        let mut file = OutputFile::beside(&path).unwrap();
        file.line("half").unwrap();
        drop(file);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
        let mut file = OutputFile::beside(&path).unwrap();
        file.line("whole").unwrap();
        file.finish().unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "whole\n");
    }
}
