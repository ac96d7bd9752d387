//! A table's files: `<out>/<id>.json` and its figures beside it, `<out>/<id>.svg` or `<out>/<id>-<name>.svg`.
//!
//! All are written under hidden names first and renamed when the last one stands, the JSON last: who finds the JSON finds the figures
//! it names.

use crate::Table;
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// What keeps a table's files from being written.
#[derive(Debug, thiserror::Error)]
pub enum FilesError {
    /// There is such a file already.
    #[error("{} exists already; give another --out, or --force to replace it", .0.display())]
    Exists(PathBuf),
    /// There is a file of that name that no reproduction wrote.
    #[error("{} is not of `{id}`, so it is not replaced; give another --out", path.display())]
    NotOurs {
        /// The file.
        path: PathBuf,
        /// The reproduction.
        id: String,
    },
    /// The file system said no.
    #[error("cannot write {}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The table is no JSON.
    #[error("cannot write the table as JSON: {0}")]
    Json(#[from] serde_json::Error),
}

fn at(path: &Path) -> impl FnOnce(std::io::Error) -> FilesError + use<'_> {
    move |source| FilesError::File { path: path.to_owned(), source }
}

/// Where the table of a reproduction is written.
pub fn table_path(out: &Path, id: &str) -> PathBuf {
    out.join(format!("{id}.json"))
}

/// Refuses to write over what is there: asked before the work is done. With `force` a table of the same id may be replaced.
///
/// # Errors
/// [`FilesError::Exists`], [`FilesError::NotOurs`].
pub fn check_free(out: &Path, id: &str, force: bool) -> Result<(), FilesError> {
    let path = table_path(out, id);
    if path.symlink_metadata().is_err() {
        return Ok(());
    }
    if !force {
        return Err(FilesError::Exists(path));
    }
    let text = fs::read_to_string(&path).unwrap_or_default();
    match serde_json::from_str::<Table>(&text) {
        Ok(table) if table.id == id => Ok(()),
        _ => Err(FilesError::NotOurs { path, id: id.to_owned() }),
    }
}

impl Table {
    /// The table as JSON, a line break at its end.
    ///
    /// # Errors
    /// Numbers are finite and keys are text: none.
    pub fn to_json(&self) -> Result<String, serde_json::Error> {
        serde_json::to_string_pretty(self).map(|text| format!("{text}\n"))
    }

    /// Writes the table and its figures and says which files they are, the table first.
    ///
    /// # Errors
    /// As [`check_free`], or what the file system says; then nothing of it appears.
    pub fn write(&self, out: &Path, force: bool) -> Result<Vec<PathBuf>, FilesError> {
        check_free(out, &self.id, force)?;
        let table = table_path(out, &self.id);
        let figure_path = |name: &str| {
            let tail = if name.is_empty() { String::new() } else { format!("-{name}") };
            out.join(format!("{}{tail}.svg", self.id))
        };
        let mut files: Vec<(PathBuf, String)> =
            self.figures.iter().map(|figure| (figure_path(&figure.name), figure.svg.clone())).collect();
        files.push((table.clone(), self.to_json()?));
        let folder = table.parent().unwrap_or(out);
        fs::create_dir_all(folder).map_err(at(folder))?;
        let mut parts = Parts(Vec::new());
        for (path, text) in &files {
            let part = hidden(path);
            parts.0.push(part.clone());
            let written = fs::File::create(&part).and_then(|mut file| {
                file.write_all(text.as_bytes())?;
                file.sync_all()
            });
            written.map_err(at(path))?;
        }
        for ((path, _), part) in files.iter().zip(&parts.0) {
            fs::rename(part, path).map_err(at(path))?;
        }
        Ok(files.into_iter().rev().map(|(path, _)| path).collect())
    }
}

fn hidden(path: &Path) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!(".{name}.part"))
}

/// Removes what was not renamed.
struct Parts(Vec<PathBuf>);

impl Drop for Parts {
    fn drop(&mut self) {
        for part in &self.0 {
            // Gone where it was renamed.
            let _ = fs::remove_file(part);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::NamedFigure;

    fn table() -> Table {
        let mut table = Table::new("a/b", "source", &[1]);
        table.figures = ["", "errors"]
            .map(|name| NamedFigure { name: name.to_owned(), svg: "<svg/>".to_owned() })
            .to_vec();
        table
    }

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> = fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn law_files_appear_together_and_are_not_written_over() {
        let out = tempfile::tempdir().unwrap();
        let written = table().write(out.path(), false).unwrap();
        assert_eq!(written[0], out.path().join("a/b.json"));
        assert_eq!(names(&out.path().join("a")), ["b-errors.svg", "b.json", "b.svg"]);
        let error = table().write(out.path(), false).unwrap_err().to_string();
        assert!(error.contains("b.json exists already"), "{error}");
        table().write(out.path(), true).unwrap();
        fs::write(out.path().join("a/b.json"), "{\"mine\": 1}").unwrap();
        let error = table().write(out.path(), true).unwrap_err().to_string();
        assert!(error.contains("is not of `a/b`"), "{error}");
        assert_eq!(fs::read_to_string(out.path().join("a/b.json")).unwrap(), "{\"mine\": 1}");
    }

    #[test]
    fn law_a_figure_that_cannot_be_written_leaves_nothing() {
        let out = tempfile::tempdir().unwrap();
        // A folder stands where the second figure's hidden file would be.
        fs::create_dir_all(out.path().join("a/.b-errors.svg.part/x")).unwrap();
        let error = table().write(out.path(), false).unwrap_err().to_string();
        assert!(error.contains("cannot write") && error.contains("b-errors.svg"), "{error}");
        assert_eq!(names(&out.path().join("a")), [".b-errors.svg.part"]);
    }
}
