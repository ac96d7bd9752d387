//! `lumenav scenarios`: what there is, what a key means, whether a file is right.

use super::replay::is_replay;
use crate::args::ScenariosCommand;
use anyhow::bail;
use comfy_table::{Table, presets};
use lumenav::core::{Node, Resolved};
use lumenav::{check, default_registry, open_replay, open_scenario};
use std::path::{Path, PathBuf};

/// Lists, shows or checks scenarios.
pub fn scenarios(what: &ScenariosCommand) -> anyhow::Result<()> {
    match what {
        ScenariosCommand::List { folder } => list(folder),
        ScenariosCommand::Show { scenario, resolved, set } => show(scenario, *resolved, set),
        ScenariosCommand::Check { scenarios } => check_all(scenarios),
    }
}

/// All TOML files below a folder, sorted.
pub fn toml_files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut open = vec![folder.to_path_buf()];
    while let Some(next) = open.pop() {
        let Ok(entries) = std::fs::read_dir(&next) else { continue };
        for path in entries.filter_map(Result::ok).map(|e| e.path()) {
            if path.is_dir() {
                open.push(path);
            } else if path.extension().is_some_and(|e| e == "toml") {
                found.push(path);
            }
        }
    }
    found.sort();
    found
}

fn list(folder: &Path) -> anyhow::Result<()> {
    let files = toml_files(folder);
    if files.is_empty() {
        bail!("no scenario below {}", folder.display());
    }
    let mut table = Table::new();
    table.load_preset(presets::NOTHING).set_header(["scenario", "length", "what"]);
    for path in files {
        let (length, what) = match Node::open(&path) {
            Ok(node) => {
                let scenario = node.child_or_empty("scenario").to_toml().unwrap_or_default();
                let text = |key: &str| scenario.get(key).map(|v| v.as_str().unwrap_or_default().to_owned());
                let length = scenario.get("duration_s").map_or("replay".to_owned(), |d| format!("{d} s"));
                (length, text("description").unwrap_or_default())
            }
            Err(error) => ("-".to_owned(), error.to_string()),
        };
        table.add_row([path.display().to_string(), length, what]);
    }
    println!("{table}");
    Ok(())
}

fn show(path: &Path, resolved: bool, set: &[String]) -> anyhow::Result<()> {
    let file = open_scenario(path, set, None)?;
    if !resolved {
        print!("{}", file.node.text());
        return Ok(());
    }
    if is_replay(&file.node) {
        let registry = default_registry();
        lumenav::pipeline::build::tracks(&file, &registry, None)?;
    } else {
        check(&file, &default_registry())?;
    }
    let mut seen = std::collections::BTreeSet::new();
    for entry in file.node.log().entries() {
        if seen.insert((entry.file.clone(), entry.path.clone())) {
            print_resolved(&entry);
        }
    }
    Ok(())
}

/// One table with every key: value, unit (from its suffix), default or set, and where the default comes from.
fn print_resolved(entry: &Resolved) {
    println!("[{}]  # {}", entry.path, entry.file);
    for row in entry.rows() {
        let origin = if row.set { "set" } else { "default" };
        let unit = unit_of(&row.key).map_or(String::new(), |u| format!(", {u}"));
        let source = row.source.filter(|_| !row.set).map_or(String::new(), |s| format!("; {s}"));
        println!("{} = {}  # {origin}{unit}{source}", row.key, row.value);
    }
    println!();
}

/// Units by the suffix of a key, longest first.
const UNITS: [(&str, &str); 20] = [
    ("_m_s_per_sqrt_s", "m/s per sqrt(s)"),
    ("_rad_s_per_sqrt_s", "rad/s per sqrt(s)"),
    ("_kg_m3", "kg/m^3"),
    ("_n_s_m", "N s/m"),
    ("_rad_s", "rad/s"),
    ("_mm_s", "mm/s"),
    ("_m_s", "m/s"),
    ("_n_m", "N/m"),
    ("_a_m2", "A m^2"),
    ("_a_m", "A/m"),
    ("_tesla", "T"),
    ("_deg", "degrees"),
    ("_rad", "rad"),
    ("_mm", "mm"),
    ("_ms", "ms"),
    ("_hz", "Hz"),
    ("_m", "m"),
    ("_s", "s"),
    ("_g", "g"),
    ("_n", "N"),
];

fn unit_of(key: &str) -> Option<&'static str> {
    UNITS.iter().find(|(suffix, _)| key.ends_with(suffix)).map(|(_, unit)| *unit)
}

fn check_all(paths: &[PathBuf]) -> anyhow::Result<()> {
    let mut wrong = 0;
    for path in paths {
        match check_one(path) {
            Ok(()) => println!("{}: ok", path.display()),
            Err(error) => {
                wrong += 1;
                eprintln!("{error:#}");
            }
        }
    }
    if wrong > 0 {
        bail!("{wrong} of {} files are not right", paths.len());
    }
    Ok(())
}

fn check_one(path: &Path) -> anyhow::Result<()> {
    let node = Node::open(path)?;
    if is_replay(&node) {
        let registry = default_registry();
        let (file, _) = open_replay(path, &[], None)?;
        lumenav::pipeline::build::readers(&file, &registry)?;
        lumenav::pipeline::build::tracks(&file, &registry, None)?;
        return Ok(());
    }
    let file = open_scenario(path, &[], None)?;
    check(&file, &default_registry())?;
    Ok(())
}
