//! `lumenav scenarios`: what there is, what a key means, whether a file is right.

mod resolved;

use super::replay::is_replay;
use crate::args::ScenariosCommand;
use crate::exit::WrongFiles;
use anyhow::bail;
use comfy_table::presets;
use lumenav::core::{Node, Registry};
use lumenav::{check, open_replay, open_scenario};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Lists, shows or checks scenarios.
pub fn scenarios(what: &ScenariosCommand, registry: &Registry) -> anyhow::Result<()> {
    match what {
        ScenariosCommand::List { folder, json } => list(folder, *json),
        ScenariosCommand::Show { scenario, resolved: false, set, json } => show(scenario, set, *json),
        ScenariosCommand::Show { scenario, resolved: true, set, json } => {
            show_resolved(scenario, set, *json, registry)
        }
        ScenariosCommand::Check { scenarios, json } => check_all(scenarios, *json, registry),
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

/// What a file says of itself.
#[derive(Serialize)]
struct Listed {
    file: String,
    kind: &'static str,
    duration_s: Option<f64>,
    description: String,
    error: Option<String>,
}

impl Listed {
    fn of(path: &Path) -> Self {
        let file = path.display().to_string();
        match Node::open(path) {
            Ok(node) => {
                let scenario = node.child_or_empty("scenario").to_toml().unwrap_or_default();
                let description = scenario.get("description").and_then(|v| v.as_str()).unwrap_or_default();
                let number = |v: &toml::Value| v.as_float().or_else(|| v.as_integer().map(|i| i as f64));
                Self {
                    file,
                    kind: if is_replay(&node) { "replay" } else { "scenario" },
                    duration_s: scenario.get("duration_s").and_then(number),
                    description: description.to_owned(),
                    error: None,
                }
            }
            Err(error) => Self {
                file,
                kind: "unreadable",
                duration_s: None,
                description: String::new(),
                error: Some(error.to_string()),
            },
        }
    }
}

fn list(folder: &Path, json: bool) -> anyhow::Result<()> {
    let all: Vec<Listed> = toml_files(folder).iter().map(|path| Listed::of(path)).collect();
    if all.is_empty() {
        bail!("no scenario below {}", folder.display());
    }
    if json {
        return crate::output::json(&all);
    }
    let mut table = crate::table::fitting(presets::NOTHING);
    table.set_header(["scenario", "length", "what"]);
    for one in all {
        let length = one.duration_s.map_or_else(|| one.kind.to_owned(), |d| format!("{d} s"));
        table.add_row([one.file, length, one.error.unwrap_or(one.description)]);
    }
    say!("{table}")
}

fn show(path: &Path, set: &[String], json: bool) -> anyhow::Result<()> {
    let file = open_scenario(path, set, None)?;
    if json {
        return crate::output::json(&file.node.to_toml());
    }
    crate::output::print(format_args!("{}", file.node.text()))
}

fn show_resolved(path: &Path, set: &[String], json: bool, registry: &Registry) -> anyhow::Result<()> {
    let file = open_scenario(path, set, None)?;
    // Everything is built once: then the log holds every table, the plugins' own included.
    if is_replay(&file.node) {
        lumenav::pipeline::build::readers(&file, registry)?;
        lumenav::pipeline::build::tracks(&file, registry, None)?;
    } else {
        check(&file, registry)?;
    }
    let tables = resolved::tables(&file.node, set);
    if json {
        return crate::output::json(&tables);
    }
    for table in &tables {
        say!("{}", table.text())?;
    }
    Ok(())
}

/// A file that was checked.
#[derive(Serialize)]
struct Checked {
    file: String,
    ok: bool,
    error: Option<String>,
}

fn check_all(paths: &[PathBuf], json: bool, registry: &Registry) -> anyhow::Result<()> {
    let mut all = Vec::new();
    for path in paths {
        let error = check_one(path, registry).err().map(|error| format!("{error:#}"));
        if !json {
            match &error {
                None => say!("{}: ok", path.display())?,
                Some(error) => complain!("{error}"),
            }
        }
        all.push(Checked { file: path.display().to_string(), ok: error.is_none(), error });
    }
    if json {
        crate::output::json(&all)?;
    }
    let wrong = all.iter().filter(|c| !c.ok).count();
    if wrong > 0 {
        return Err(WrongFiles(format!("{wrong} of {} files are not right", paths.len())).into());
    }
    Ok(())
}

fn check_one(path: &Path, registry: &Registry) -> anyhow::Result<()> {
    let node = Node::open(path)?;
    if is_replay(&node) {
        let (file, _) = open_replay(path, &[], None)?;
        lumenav::pipeline::build::readers(&file, registry)?;
        lumenav::pipeline::build::tracks(&file, registry, None)?;
        return Ok(());
    }
    let file = open_scenario(path, &[], None)?;
    check(&file, registry)?;
    Ok(())
}
