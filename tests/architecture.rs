//! The house rules that a compiler does not hold: which crate may know which, and who may see the truth.

use cargo_metadata::{DependencyKind, MetadataCommand};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Allowed arrows between our own crates. The same table stands in ARCHITECTURE.md, and a test compares the two.
const ALLOWED: [(&str, &[&str]); 18] = [
    ("core", &[]),
    ("fields", &[]),
    ("records", &["core"]),
    ("anatomy", &["core"]),
    ("scenario", &["core", "records", "anatomy", "fields"]),
    ("magnetic", &["core", "records", "fields"]),
    ("pet", &["core", "records", "anatomy"]),
    ("fusion", &["core"]),
    ("control", &["core"]),
    ("evaluation", &["core"]),
    ("pipeline", &["core", "scenario", "fusion", "control", "evaluation"]),
    ("figures", &[]),
    ("layout", &["core"]),
    (
        "reproduce",
        &["core", "fields", "anatomy", "scenario", "magnetic", "pet", "fusion", "evaluation", "figures"],
    ),
    ("recording", &["core", "figures", "pipeline"]),
    ("report", &["core", "pipeline", "evaluation"]),
    (
        "lumenav",
        &[
            "core",
            "fields",
            "records",
            "anatomy",
            "scenario",
            "magnetic",
            "pet",
            "fusion",
            "control",
            "layout",
            "evaluation",
            "pipeline",
            "recording",
            "report",
            "figures",
            "reproduce",
        ],
    ),
    ("cli", &["lumenav"]),
];

/// Heavy dependencies and who owns each: one crate, but for Parquet, which one crate writes and another reads (behind a feature).
const OWNERS: [(&str, &[&str]); 8] = [
    ("rapier3d-f64", &["scenario"]),
    ("rerun", &["recording"]),
    ("parquet", &["records", "report"]),
    ("arrow", &["report"]),
    ("plotters", &["figures"]),
    ("rayon", &["cli"]),
    ("clap", &["cli"]),
    ("indicatif", &["cli"]),
];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn short(name: &str) -> String {
    name.strip_prefix("lumenav-").unwrap_or(name).to_owned()
}

/// Normal dependencies of each of our crates.
fn arrows() -> BTreeMap<String, BTreeSet<String>> {
    let metadata = MetadataCommand::new()
        .manifest_path(root().join("Cargo.toml"))
        .no_deps()
        .exec()
        .expect("cargo metadata runs where cargo test runs");
    metadata
        .packages
        .iter()
        .map(|package| {
            let normal = package.dependencies.iter().filter(|d| d.kind == DependencyKind::Normal);
            (short(&package.name), normal.map(|d| d.name.clone()).collect())
        })
        .collect()
}

#[test]
fn law_crates_know_only_what_they_may() {
    let allowed: BTreeMap<&str, BTreeSet<&str>> =
        ALLOWED.iter().map(|(name, of)| (*name, of.iter().copied().collect())).collect();
    let found = arrows();
    assert_eq!(
        found.keys().map(String::as_str).collect::<Vec<_>>(),
        allowed.keys().copied().collect::<Vec<_>>(),
        "a crate was added or removed: bring the table here and in ARCHITECTURE.md up to date"
    );
    for (crate_name, dependencies) in &found {
        for dependency in dependencies.iter().filter(|d| d.as_str() == "lumenav" || d.starts_with("lumenav-"))
        {
            let dependency = short(dependency);
            assert!(
                allowed[crate_name.as_str()].contains(dependency.as_str()),
                "forbidden arrow: {crate_name} -> {dependency}"
            );
        }
    }
}

#[test]
fn law_heavy_dependencies_have_their_owners() {
    for (crate_name, dependencies) in arrows() {
        for (heavy, owners) in OWNERS {
            assert!(
                !dependencies.contains(heavy) || owners.contains(&crate_name.as_str()),
                "{heavy} belongs to {} alone, {crate_name} depends on it",
                owners.join(" and ")
            );
        }
    }
}

#[test]
fn law_reading_parquet_stands_behind_a_feature() {
    let metadata = MetadataCommand::new()
        .manifest_path(root().join("Cargo.toml"))
        .no_deps()
        .exec()
        .expect("cargo metadata runs where cargo test runs");
    let records =
        metadata.packages.iter().find(|p| p.name.as_str() == "lumenav-records").expect("a crate of ours");
    let parquet = records.dependencies.iter().find(|d| d.name == "parquet").expect("records reads Parquet");
    assert!(parquet.optional, "a reader of CSV alone must not build Parquet");
}

#[test]
fn law_architecture_md_shows_the_same_arrows() {
    let text = std::fs::read_to_string(root().join("ARCHITECTURE.md")).expect("ARCHITECTURE.md exists");
    for (name, of) in ALLOWED {
        let wanted = if of.is_empty() { "–".to_owned() } else { of.join(", ") };
        let row = text
            .lines()
            .find(|line| line.starts_with(&format!("| `{name}` |")))
            .unwrap_or_else(|| panic!("ARCHITECTURE.md has no row for `{name}`"));
        assert!(
            row.contains(&format!("| {wanted} |")),
            "ARCHITECTURE.md, `{name}`: expected `{wanted}` in `{row}`"
        );
    }
}

/// Files of the world side: they may name the truth. Everything else may not, and clippy's `disallowed_types` holds that.
const WORLD_SIDE: [&str; 15] = [
    "crates/core/src/laws.rs",
    "crates/core/src/lib.rs",
    "crates/core/src/sensor.rs",
    "crates/core/src/truth.rs",
    "crates/lumenav/src/replay.rs",
    "crates/modalities/magnetic/src/sensor.rs",
    "crates/modalities/pet/src/sensor.rs",
    "crates/pipeline/src/events.rs",
    "crates/pipeline/src/judge.rs",
    "crates/pipeline/src/run.rs",
    "crates/recording/src/recorder.rs",
    "crates/report/src/tum.rs",
    "crates/scenario/src/engine_world.rs",
    "crates/scenario/src/kinematic.rs",
    "crates/scenario/src/world.rs",
];

fn rust_files(folder: &Path, out: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().filter_map(Result::ok) {
        let path = entry.path();
        if path.is_dir() {
            rust_files(&path, out);
        } else if path.extension().is_some_and(|e| e == "rs") {
            out.push(path);
        }
    }
}

#[test]
fn law_only_the_world_side_may_name_the_truth() {
    let root = root();
    let mut files = Vec::new();
    rust_files(&root.join("crates"), &mut files);
    let mut found = BTreeSet::new();
    for path in files.iter().filter(|p| p.components().any(|c| c.as_os_str() == "src")) {
        let text = std::fs::read_to_string(path).expect("a source file is UTF-8");
        let name = path.strip_prefix(&root).expect("below the root").display().to_string();
        let names_truth = text.lines().any(|line| {
            let code = line.split("//").next().unwrap_or_default();
            ["TruthView", "CapsuleTruth", "Observation"].iter().any(|word| code.contains(word))
        });
        let in_tests_only = text.find("#[cfg(test)]").is_some_and(|tests| {
            !text[..tests].lines().any(|line| {
                let code = line.split("//").next().unwrap_or_default();
                ["TruthView", "CapsuleTruth", "Observation"].iter().any(|word| code.contains(word))
            })
        });
        if names_truth && !in_tests_only {
            found.insert(name);
        }
    }
    let allowed: BTreeSet<String> = WORLD_SIDE.iter().map(ToString::to_string).collect();
    let stray: Vec<&String> = found.difference(&allowed).collect();
    assert!(stray.is_empty(), "these files name the truth but are not on the world side's list: {stray:?}");
}
