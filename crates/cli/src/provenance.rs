//! Where a run comes from: program, command, settings, and the fingerprint of every file that was read.

use crate::args::Record;
use anyhow::Context as _;
use lumenav::core::Node;
use lumenav::report::{Provenance, fingerprint};
use std::collections::{BTreeMap, BTreeSet};
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

/// SHA-256 of every file that a scenario or replay reads: the scenario, its models, and the data that their tables name.
///
/// To be called when everything has been built once, so that the log knows every file. Names do not depend on how the files were
/// spelled or from where the program was called: `$LUMENAV_DATA/…` for recorded data, for the others the way from the deepest
/// folder that holds them all (`scenarios/colon-magnetic.toml`, `models/tracts/colon.toml`).
///
/// # Errors
/// A file that cannot be read.
pub fn inputs(root: &Node) -> anyhow::Result<BTreeMap<String, String>> {
    let mut files = BTreeSet::new();
    for path in root.log().files() {
        let full = path.canonicalize().with_context(|| format!("input {}", path.display()))?;
        // A folder is named by those of its files that are read.
        if full.is_file() {
            files.insert(full);
        }
    }
    let data = std::env::var_os("LUMENAV_DATA").and_then(|folder| Path::new(&folder).canonicalize().ok());
    let mut inputs = BTreeMap::new();
    for (name, path) in named(files, data.as_deref()) {
        let entry = fingerprint(&path).with_context(|| format!("input {name}"))?;
        inputs.insert(name, entry.sha256);
    }
    Ok(inputs)
}

/// Names of files (canonical paths), see [`inputs`].
fn named(files: BTreeSet<PathBuf>, data: Option<&Path>) -> BTreeMap<String, PathBuf> {
    let in_data = |path: &Path| data.and_then(|data| path.strip_prefix(data).ok().map(Path::to_path_buf));
    let (recorded, own): (Vec<PathBuf>, Vec<PathBuf>) =
        files.into_iter().partition(|path| in_data(path).is_some());
    let common = common_folder(&own);
    let spelled = |path: &Path| path.to_string_lossy().replace('\\', "/");
    let of_recorded = recorded.into_iter().filter_map(|path| {
        let rest = in_data(&path)?;
        Some((format!("$LUMENAV_DATA/{}", spelled(&rest)), path))
    });
    let of_own = own.into_iter().map(|path| (spelled(path.strip_prefix(&common).unwrap_or(&path)), path));
    of_recorded.chain(of_own.collect::<Vec<_>>()).collect()
}

/// The deepest folder that holds all of these files.
fn common_folder(files: &[PathBuf]) -> PathBuf {
    let mut folders = files.iter().filter_map(|path| path.parent());
    let first = folders.next().unwrap_or_else(|| Path::new("")).to_path_buf();
    folders.fold(first, |common, folder| {
        let same = common.components().zip(folder.components()).take_while(|(a, b)| a == b);
        same.map(|(component, _)| component).collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn law_names_are_ways_from_the_common_folder_or_the_data() {
        let files = ["/a/scenarios/smoke/s.toml", "/a/models/tracts/colon.toml", "/data/magnet/series.csv"];
        let names = |files: &[&str], data: Option<&str>| -> Vec<String> {
            let files = files.iter().map(PathBuf::from).collect();
            named(files, data.map(Path::new)).into_keys().collect()
        };
        let expected =
            ["$LUMENAV_DATA/magnet/series.csv", "models/tracts/colon.toml", "scenarios/smoke/s.toml"];
        assert_eq!(names(&files, Some("/data")), expected);
        assert_eq!(names(&files[..1], None), ["s.toml"]);
        // Nothing in common but the root: no two files get one name.
        assert_eq!(names(&["/a/s.toml", "/b/s.toml"], None), ["a/s.toml", "b/s.toml"]);
    }
}
