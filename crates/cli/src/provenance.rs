//! Where a run comes from: program, command, settings, and the fingerprint of every file that was read.

use crate::args::Record;
use anyhow::Context as _;
use lumenav::core::{Node, Resolved};
use lumenav::report::{Provenance, fingerprint};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The program's own part, and what else decides which files appear.
pub fn of_program(record: Record, save_readings: bool) -> Provenance {
    let record = match record {
        Record::None => "none",
        Record::Bounded => "bounded",
        Record::Full => "full",
    };
    Provenance {
        git_revision: option_env!("LUMENAV_GIT_REVISION").map(str::to_owned),
        git_changes: option_env!("LUMENAV_GIT_CHANGES").map(str::to_owned),
        command_line: std::env::args().collect(),
        settings: BTreeMap::from([
            ("record".to_owned(), record.to_owned()),
            ("save_readings".to_owned(), save_readings.to_string()),
        ]),
        inputs: BTreeMap::new(),
    }
}

/// SHA-256 of every file that a scenario or replay reads, by its path as the files name it: the scenario, its models, and
/// the data that their tables name.
///
/// To be called when everything has been built once, so that the log holds every table. Data are found as a reader finds
/// them: a string of a table that, relative to its file, names a file that exists.
///
/// # Errors
/// A file that cannot be read.
pub fn inputs(root: &Node) -> anyhow::Result<BTreeMap<String, String>> {
    let mut found: BTreeMap<String, PathBuf> = BTreeMap::new();
    found.insert(root.file().to_owned(), PathBuf::from(root.file()));
    for entry in root.log().entries() {
        found.insert(entry.file.clone(), PathBuf::from(&entry.file));
        add_data(&entry, &mut found);
    }
    let mut inputs = BTreeMap::new();
    for (name, path) in found {
        let entry = fingerprint(&path).with_context(|| format!("input {name}"))?;
        inputs.insert(name.replace('\\', "/"), entry.sha256);
    }
    Ok(inputs)
}

/// Adds the files that a table's strings name.
fn add_data(entry: &Resolved, found: &mut BTreeMap<String, PathBuf>) {
    let mut open: Vec<&toml::Value> = entry.values.values().collect();
    while let Some(value) = open.pop() {
        match value {
            toml::Value::String(text) => {
                if let Some(path) = data_file(text, Path::new(&entry.file)) {
                    found.insert(text.clone(), path);
                }
            }
            toml::Value::Array(items) => open.extend(items),
            toml::Value::Table(table) => open.extend(table.values()),
            _ => {}
        }
    }
}

/// The file that a string names, where there is one: with an ending (`series.csv`, `poses.tum`, `flux.csv.gz`), beside the
/// file that names it, in the data folder, or (from `--set`) in the working folder.
fn data_file(text: &str, named_in: &Path) -> Option<PathBuf> {
    Path::new(text).extension()?;
    let candidates = match text.strip_prefix("$LUMENAV_DATA/") {
        Some(rest) => vec![PathBuf::from(std::env::var_os("LUMENAV_DATA")?).join(rest)],
        None => vec![named_in.parent().unwrap_or_else(|| Path::new("")).join(text), PathBuf::from(text)],
    };
    candidates.into_iter().find(|path| path.is_file())
}
