//! What was read, with every default filled in and its source: for `show --resolved` and manifests.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// One table as it was understood: with every default filled in.
#[derive(Clone, Debug)]
pub struct Resolved {
    /// The file it came from.
    pub file: String,
    /// Path of keys.
    pub path: String,
    /// All keys with their values.
    pub values: toml::Table,
    /// Keys that the file sets, dotted for tables within this one (and those tables themselves); the others are defaults.
    pub set: Vec<String>,
    /// Where a key's default comes from: key (dotted for tables within this one) and source in words. Empty where the reader of
    /// the table gives none.
    pub sources: Vec<(String, String)>,
}

/// One key of a [`Resolved`] table.
#[derive(Clone, Debug, PartialEq)]
pub struct ResolvedRow {
    /// The key, dotted for tables within the table, with `[i]` for arrays of tables.
    pub key: String,
    /// Its value; never a table.
    pub value: toml::Value,
    /// Whether the file sets it.
    pub set: bool,
    /// Where its default comes from, where the reader of the table says so.
    pub source: Option<String>,
}

impl Resolved {
    /// All keys, one a row, tables within the table taken apart.
    pub fn rows(&self) -> Vec<ResolvedRow> {
        let mut rows = Vec::new();
        for (key, value) in &self.values {
            self.add_rows(key.clone(), value, &mut rows);
        }
        rows
    }

    fn add_rows(&self, key: String, value: &toml::Value, rows: &mut Vec<ResolvedRow>) {
        match value {
            toml::Value::Table(table) => {
                for (inner, value) in table {
                    self.add_rows(format!("{key}.{inner}"), value, rows);
                }
            }
            toml::Value::Array(items) if items.iter().any(toml::Value::is_table) => {
                for (i, item) in items.iter().enumerate() {
                    self.add_rows(format!("{key}[{i}]"), item, rows);
                }
            }
            _ => {
                // A source stands for all entries of an array of tables.
                let plain: String =
                    key.split('[').map(|part| part.split(']').next_back().unwrap_or(part)).collect();
                let source =
                    self.sources.iter().find(|(name, _)| *name == plain).map(|(_, text)| text.clone());
                rows.push(ResolvedRow { set: self.set.contains(&key), key, value: value.clone(), source });
            }
        }
    }
}

/// What was parsed so far, in order, and from which files. Shared by all nodes of a scenario.
#[derive(Clone, Debug, Default)]
pub struct ResolvedLog(Arc<Mutex<Noted>>);

#[derive(Debug, Default)]
struct Noted {
    entries: Vec<Resolved>,
    files: BTreeSet<PathBuf>,
}

impl ResolvedLog {
    /// The tables parsed so far.
    pub fn entries(&self) -> Vec<Resolved> {
        self.noted().entries.clone()
    }

    /// Every file opened so far, and every path of data that a key led to ([`super::Node::existing_path`]); sorted, as opened.
    pub fn files(&self) -> Vec<PathBuf> {
        self.noted().files.iter().cloned().collect()
    }

    pub(super) fn push(&self, entry: Resolved) {
        self.noted().entries.push(entry);
    }

    pub(super) fn add_file(&self, path: &Path) {
        self.noted().files.insert(path.to_path_buf());
    }

    /// Takes on the files of another log.
    pub(super) fn add_files_of(&self, other: &Self) {
        // One lock after the other: the two may be the same.
        let files = other.files();
        self.noted().files.extend(files);
    }

    fn noted(&self) -> MutexGuard<'_, Noted> {
        // A poisoned lock means another thread panicked while pushing; what was pushed is still whole.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
