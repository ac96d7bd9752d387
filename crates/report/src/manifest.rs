//! `manifest.json`: what was run, with what, and the fingerprints of what came out.
//!
//! Wall times are in `timing.json`, which therefore is not among the fingerprints: on one machine equal runs of one program
//! give equal manifests.
//!
//! Two runs are *the same* where scenario (overrides applied), seed, trial, version and revision of the program, rule of the
//! random streams, machine type, settings and every input file agree ([`Manifest::first_difference`]): then nothing needs to
//! be computed again.

use crate::error::ReportError;
use crate::file::write_json;
use lumenav_core::random::RANDOM_STREAMS_VERSION;
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
    /// Version of the rule that derives random streams from the seed.
    #[serde(default)]
    pub random_streams_version: u32,
    /// Where the program came from and what it was given.
    #[serde(flatten)]
    pub provenance: Provenance,
    /// The machine.
    pub machine: Machine,
    /// SHA-256 of every file but this one and `timing.json`, by path with `/`.
    pub files: BTreeMap<String, FileEntry>,
    /// The scenario file as it was run, overrides applied.
    pub scenario_toml: String,
}

/// Where the program came from and what it was given; filled by whoever calls the library.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Provenance {
    /// Revision of the program's sources; `null` where it was built outside a checkout.
    pub git_revision: Option<String>,
    /// Fingerprint of what was changed in the sources and not committed; `null` where nothing was.
    #[serde(default)]
    pub git_changes: Option<String>,
    /// The command as it was typed.
    pub command_line: Vec<String>,
    /// What else decides which files appear (`record`, `save_readings`).
    #[serde(default)]
    pub settings: BTreeMap<String, String>,
    /// SHA-256 of every file that was read, by a name that does not depend on the working folder or on how the path was spelled.
    #[serde(default)]
    pub inputs: BTreeMap<String, String>,
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

impl Manifest {
    /// The manifest of a run, before its files are fingerprinted.
    pub fn of(header: &RunHeader, provenance: &Provenance) -> Self {
        Self {
            schema: 1,
            scenario: header.scenario.clone(),
            seed: header.seed,
            trial: header.trial,
            lumenav_version: env!("CARGO_PKG_VERSION").to_owned(),
            random_streams_version: RANDOM_STREAMS_VERSION,
            provenance: provenance.clone(),
            machine: Machine::here(),
            files: BTreeMap::new(),
            scenario_toml: header.scenario_toml.clone(),
        }
    }

    /// In what the run described by `other` would differ from this one; `None` where it would be the same.
    ///
    /// The command's wording, the number of cores and the files that came out do not count.
    pub fn first_difference(&self, other: &Self) -> Option<String> {
        let (ours, theirs) = (&self.provenance, &other.provenance);
        let version = |m: &Self| (m.lumenav_version.clone(), m.random_streams_version);
        let revision = |p: &Provenance| (p.git_revision.clone(), p.git_changes.clone());
        let machine = |m: &Machine| (m.os.clone(), m.arch.clone());
        let what = if self.scenario_toml != other.scenario_toml {
            "another scenario".to_owned()
        } else if self.seed != other.seed {
            format!("another seed ({})", self.seed)
        } else if self.trial != other.trial {
            format!("another trial ({})", self.trial)
        } else if version(self) != version(other) {
            format!("another version of lumenav ({})", self.lumenav_version)
        } else if revision(ours) != revision(theirs) {
            "another revision of lumenav".to_owned()
        } else if machine(&self.machine) != machine(&other.machine) {
            format!("another kind of machine ({} {})", self.machine.os, self.machine.arch)
        } else if ours.settings != theirs.settings {
            "other outputs (--record, --save-readings)".to_owned()
        } else {
            let changed = |(path, hash): &(&String, &String)| theirs.inputs.get(*path) != Some(*hash);
            let missing = |(path, _): &(&String, &String)| !ours.inputs.contains_key(*path);
            let path = ours.inputs.iter().find(changed).or_else(|| theirs.inputs.iter().find(missing))?.0;
            format!("another content of {path}")
        };
        Some(what)
    }

    /// Whether all files stand in `folder` with the sizes noted here.
    pub fn is_whole(&self, folder: &Path) -> bool {
        self.files
            .iter()
            .all(|(name, entry)| std::fs::metadata(folder.join(name)).is_ok_and(|m| m.len() == entry.bytes))
    }
}

/// Fingerprints all files of `folder` and writes `manifest.json` into it. To be called when all observers have finished.
///
/// # Errors
/// [`ReportError::File`].
pub fn write_manifest(
    folder: &Path,
    header: &RunHeader,
    provenance: &Provenance,
) -> Result<Manifest, ReportError> {
    let mut files = BTreeMap::new();
    fingerprint_folder(folder, "", &mut files)?;
    files.retain(|name, _| name != "manifest.json" && name != "timing.json");
    let manifest = Manifest { files, ..Manifest::of(header, provenance) };
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
///
/// # Errors
/// [`ReportError::File`].
pub fn fingerprint(path: &Path) -> Result<FileEntry, ReportError> {
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
