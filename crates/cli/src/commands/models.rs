//! `lumenav models` and `lumenav plugins`: what there is to build scenarios from.

use super::scenarios::toml_files;
use crate::args::{ModelsCommand, PluginsOptions};
use anyhow::bail;
use comfy_table::{Table, presets};
use lumenav::anatomy::tract_file::{self, TractOptions};
use lumenav::core::{ConfigError, Node};
use lumenav::default_registry;
use lumenav::magnetic::array::SensorArray;
use lumenav::scenario::file::CapsuleModelTable;
use std::path::Path;

/// Lists, shows or checks models.
pub fn models(what: &ModelsCommand) -> anyhow::Result<()> {
    match what {
        ModelsCommand::List { models } => list(models),
        ModelsCommand::Show { model, models } => show(model, models),
        ModelsCommand::Check { models } => check(models),
    }
}

fn list(root: &Path) -> anyhow::Result<()> {
    let files = toml_files(root);
    if files.is_empty() {
        bail!("no model below {}", root.display());
    }
    let mut table = Table::new();
    table.load_preset(presets::NOTHING).set_header(["model", "what"]);
    for path in files {
        let first = std::fs::read_to_string(&path).unwrap_or_default();
        let what = first.lines().next().unwrap_or_default().trim_start_matches('#').trim().to_owned();
        let name = path.strip_prefix(root).unwrap_or(&path).with_extension("");
        table.add_row([name.display().to_string(), what]);
    }
    println!("{table}");
    Ok(())
}

fn show(model: &str, root: &Path) -> anyhow::Result<()> {
    let path = root.join(model).with_extension("toml");
    let node = Node::open(&path)?;
    print!("{}", node.text());
    println!("# {}", summary(&node, model)?);
    Ok(())
}

/// Reads a model as the program would and says what it is.
fn summary(node: &Node, model: &str) -> Result<String, ConfigError> {
    let kind = model.split('/').next().unwrap_or_default();
    match kind {
        "sensor-arrays" => {
            let array = SensorArray::from_node(node)?;
            let channels = array.labels().len();
            Ok(format!("{} sensors, {channels} channels, noise {} T", array.sensors.len(), array.noise_tesla))
        }
        "capsules" => {
            let capsule: CapsuleModelTable = node.child_or_empty("capsule").parse()?;
            Ok(format!("{} x {} mm, {} g", capsule.diameter_mm.0, capsule.length_mm.0, capsule.mass_g.0))
        }
        "tracts" => {
            let (tract, report) = tract_file::load(node, &TractOptions::default())?;
            let warnings = report.warnings.join("; ");
            let keys: Vec<String> = tract.segments.iter().map(|s| s.key.to_string()).collect();
            let text = format!("{:.3} m: {}", tract.length_m(), keys.join(", "));
            Ok(if warnings.is_empty() { text } else { format!("{text}; {warnings}") })
        }
        _ => Ok(String::new()),
    }
}

fn check(root: &Path) -> anyhow::Result<()> {
    let mut wrong = 0;
    for path in toml_files(root) {
        let name = path.strip_prefix(root).unwrap_or(&path).with_extension("").display().to_string();
        match Node::open(&path).and_then(|node| summary(&node, &name)) {
            Ok(text) => println!("{name}: ok ({text})"),
            Err(error) => {
                wrong += 1;
                eprintln!("{error}");
            }
        }
    }
    if wrong > 0 {
        bail!("{wrong} models are not right");
    }
    Ok(())
}

/// Lists the modalities.
pub fn plugins(options: &PluginsOptions) -> anyhow::Result<()> {
    let registry = default_registry();
    if options.json {
        let all: Vec<_> = registry
            .modalities()
            .map(
                |m| serde_json::json!({ "kind": m.kind(), "about": m.about(), "front_ends": m.front_ends() }),
            )
            .collect();
        println!("{}", serde_json::to_string_pretty(&all)?);
        return Ok(());
    }
    for modality in registry.modalities() {
        println!(
            "{}  {} (front ends: {})",
            modality.kind(),
            modality.about(),
            modality.front_ends().join(", ")
        );
    }
    Ok(())
}
