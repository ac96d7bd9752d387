//! `manifest.json`: what was run, with what, and the fingerprints of what came out.
//!
//! Wall times are in `timing.json`, which therefore is not among the fingerprints: on one machine equal runs of one program
//! give equal manifests.

use crate::error::ReportError;
use crate::file::write_json;
use lumenav_pipeline::RunHeader;
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Read as _;
use std::path::Path;

/// `manifest.json`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Manifest {
    /// Version of the keys.
    pub schema: u32,
    /// Name of the scenario or replay.
    pub scenario: String,
    /// Seed of all random streams.
    pub seed: u64,
    /// Trial within a Monte Carlo.
    pub trial: u64,
    /// Version of the program.
    pub lumenav_version: String,
    /// Revision of the sources, where the build was told (`LUMENAV_GIT_REVISION`).
    pub git_revision: Option<String>,
    /// The command as it was typed.
    pub command_line: Vec<String>,
    /// The machine.
    pub machine: Machine,
    /// SHA-256 of every file but this one and `timing.json`, by path with `/`.
    pub files: BTreeMap<String, FileEntry>,
    /// The scenario file as it was run, overrides applied.
    pub scenario_toml: String,
}

/// What the program ran on.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Machine {
    /// Operating system.
    pub os: String,
    /// Processor architecture.
    pub arch: String,
    /// Cores that the program may use.
    pub cores: usize,
}

/// A file of the run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileEntry {
    /// SHA-256, hexadecimal.
    pub sha256: String,
    /// Size in bytes.
    pub bytes: u64,
}

impl Machine {
    /// This machine.
    pub fn here() -> Self {
        Self {
            os: std::env::consts::OS.to_owned(),
            arch: std::env::consts::ARCH.to_owned(),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
        }
    }
}

/// Fingerprints all files of `folder` and writes `manifest.json` into it. To be called when all observers have finished.
///
/// # Errors
/// [`ReportError::File`].
pub fn write_manifest(
    folder: &Path,
    header: &RunHeader,
    command_line: &[String],
) -> Result<Manifest, ReportError> {
    let mut files = BTreeMap::new();
    fingerprint_folder(folder, "", &mut files)?;
    files.retain(|name, _| name != "manifest.json" && name != "timing.json");
    let manifest = Manifest {
        schema: 1,
        scenario: header.scenario.clone(),
        seed: header.seed,
        trial: header.trial,
        lumenav_version: env!("CARGO_PKG_VERSION").to_owned(),
        git_revision: option_env!("LUMENAV_GIT_REVISION").map(str::to_owned),
        command_line: command_line.to_vec(),
        machine: Machine::here(),
        files,
        scenario_toml: header.scenario_toml.clone(),
    };
    write_json(&folder.join("manifest.json"), &manifest)?;
    Ok(manifest)
}

/// Adds the files below `folder` under `prefix`.
fn fingerprint_folder(
    folder: &Path,
    prefix: &str,
    files: &mut BTreeMap<String, FileEntry>,
) -> Result<(), ReportError> {
    for entry in std::fs::read_dir(folder).map_err(ReportError::file("cannot list", folder))? {
        let entry = entry.map_err(ReportError::file("cannot list", folder))?;
        let path = entry.path();
        let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
        if path.is_dir() {
            fingerprint_folder(&path, &format!("{name}/"), files)?;
        } else {
            files.insert(name, fingerprint(&path)?);
        }
    }
    Ok(())
}

/// SHA-256 and size of a file.
fn fingerprint(path: &Path) -> Result<FileEntry, ReportError> {
    let mut file = std::fs::File::open(path).map_err(ReportError::file("cannot open", path))?;
    let mut hash = Sha256::new();
    let mut bytes = 0_u64;
    let mut buffer = vec![0_u8; 1 << 16];
    loop {
        let n = file.read(&mut buffer).map_err(ReportError::file("cannot read", path))?;
        if n == 0 {
            break;
        }
        bytes += n as u64;
        hash.update(&buffer[..n]);
    }
    let mut sha256 = String::with_capacity(64);
    for byte in hash.finalize() {
        // Writing to a string cannot fail.
        write!(sha256, "{byte:02x}").ok();
    }
    Ok(FileEntry { sha256, bytes })
}

/// Reads a document of the run's folder (`manifest.json`, `metrics.json`, `timing.json`).
///
/// # Errors
/// [`ReportError::File`], [`ReportError::Json`] where it is not such a document.
pub fn read_json<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T, ReportError> {
    let text = std::fs::read_to_string(path).map_err(ReportError::file("cannot open", path))?;
    serde_json::from_str(&text).map_err(|source| ReportError::Json { path: path.to_owned(), source })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Test vectors of FIPS 180-2, appendix B.
    #[test]
    fn published_sha_256_of_abc() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("readings")).unwrap();
        std::fs::write(folder.path().join("readings/a.csv"), "abc").unwrap();
        std::fs::write(folder.path().join("empty"), "").unwrap();
        let mut files = BTreeMap::new();
        fingerprint_folder(folder.path(), "", &mut files).unwrap();
        let entry = &files["readings/a.csv"];
        assert_eq!(entry.bytes, 3);
        assert_eq!(entry.sha256, "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
        assert_eq!(files["empty"].sha256, "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
    }
}
