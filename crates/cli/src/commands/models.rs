//! `lumenav models` and `lumenav plugins`: what there is to build scenarios from; new tracts, from a seed or from a person's surface.

mod generate;
mod import;
mod statistics;

use super::scenarios::toml_files;
use crate::args::{GenerateCommand, ModelsCommand, PluginsOptions};
use crate::exit::WrongFiles;
use anyhow::bail;
use comfy_table::presets;
use lumenav::anatomy::phantom::Phantom;
use lumenav::anatomy::tract_file::{self, TractOptions};
use lumenav::control::CONTROLLERS;
use lumenav::core::{ConfigError, Node, Registry};
use lumenav::magnetic::array::SensorArray;
use lumenav::pet::simulation::{Isotope, Scintillator};
use lumenav::pet::{MarkerSet, Scanner};
use lumenav::scenario::file::CapsuleModelTable;
use serde::Serialize;
use std::path::Path;

/// A reader that says in a line what a model is.
type Reader = fn(&Node) -> Result<String, ConfigError>;

/// The kinds of models (folders below `models`) that this program can read.
const KINDS: [(&str, Reader); 7] = [
    ("capsules", capsule),
    ("isotopes", isotope),
    ("phantoms", phantom),
    ("scanners", scanner),
    ("scintillators", scintillator),
    ("sensor-arrays", sensor_array),
    ("tracts", tract),
];

/// Lists, shows or checks models.
pub fn models(what: &ModelsCommand) -> anyhow::Result<()> {
    match what {
        ModelsCommand::List { models, json } => list(models, *json),
        ModelsCommand::Show { model, models, json } => show(model, models, *json),
        ModelsCommand::Check { models, json } => check(models, *json),
        ModelsCommand::Generate { what: GenerateCommand::Tract(options) } => generate::tract(options),
        ModelsCommand::Import(options) => import::import(options),
        ModelsCommand::Statistics { tracts } => statistics::statistics(tracts),
    }
}

/// A model by name, with the line at its head.
#[derive(Serialize)]
struct Listed {
    model: String,
    about: String,
}

/// `kind/name` of a file below the models folder.
fn name_of(path: &Path, root: &Path) -> String {
    path.strip_prefix(root).unwrap_or(path).with_extension("").display().to_string().replace('\\', "/")
}

fn list(root: &Path, json: bool) -> anyhow::Result<()> {
    let files = toml_files(root);
    if files.is_empty() {
        bail!("no model below {}", root.display());
    }
    let mut all = Vec::new();
    for path in files {
        let first = std::fs::read_to_string(&path).unwrap_or_default();
        let about = first.lines().next().unwrap_or_default().trim_start_matches('#').trim().to_owned();
        all.push(Listed { model: name_of(&path, root), about });
    }
    if json {
        return crate::output::json(&all);
    }
    let mut table = crate::table::fitting(presets::NOTHING);
    table.set_header(["model", "what"]);
    for Listed { model, about } in all {
        table.add_row([model, about]);
    }
    say!("{table}")
}

fn show(model: &str, root: &Path, json: bool) -> anyhow::Result<()> {
    let model = &full_name(model, root)?;
    let node = Node::open(&root.join(format!("{model}.toml")))?;
    let summary = summary(&node, model)?;
    if json {
        let tables = node.to_toml();
        return crate::output::json(
            &serde_json::json!({ "model": model, "summary": summary, "tables": tables }),
        );
    }
    crate::output::print(format_args!("{}", node.text()))?;
    say!("# {summary}")
}

/// `kind/name` of a model given in full or, where only one model is called so, by its name alone.
fn full_name(model: &str, root: &Path) -> anyhow::Result<String> {
    let all: Vec<String> = toml_files(root).iter().map(|path| name_of(path, root)).collect();
    let called = |full: &&String| full.rsplit('/').next() == Some(model);
    let same: Vec<&String> = all.iter().filter(called).collect();
    if all.iter().any(|full| full == model) {
        return Ok(model.to_owned());
    }
    match same[..] {
        [one] => Ok(one.clone()),
        [] => bail!("no model `{model}` below {}; there are: {}", root.display(), all.join(", ")),
        _ => {
            let same: Vec<&str> = same.iter().map(|full| full.as_str()).collect();
            bail!("`{model}` is more than one model: {}", same.join(", "))
        }
    }
}

/// Reads a model as the program would and says what it is.
fn summary(node: &Node, model: &str) -> Result<String, ConfigError> {
    let kind = model.split('/').next().unwrap_or_default();
    if let Some((_, reader)) = KINDS.iter().find(|(known, _)| *known == kind) {
        return reader(node);
    }
    let known: Vec<&str> = KINDS.iter().map(|(known, _)| *known).collect();
    let known = known.join(", ");
    Err(node.error(&format!("unknown kind of model `{kind}`; this program reads: {known}")))
}

fn sensor_array(node: &Node) -> Result<String, ConfigError> {
    let array = SensorArray::from_node(node)?;
    let channels = array.labels().len();
    Ok(format!("{} sensors, {channels} channels, noise {} T", array.sensors.len(), array.noise_tesla))
}

fn capsule(node: &Node) -> Result<String, ConfigError> {
    let capsule: CapsuleModelTable = node.child_or_empty("capsule").parse()?;
    let size = format!("{} x {} mm, {} g", capsule.diameter_mm.0, capsule.length_mm.0, capsule.mass_g.0);
    if node.children("marker").is_ok_and(|markers| !markers.is_empty()) {
        let markers = MarkerSet::from_capsule(node, "models check", 1)?;
        return Ok(format!("{size}, {} positron markers", markers.len()));
    }
    Ok(size)
}

fn isotope(node: &Node) -> Result<String, ConfigError> {
    let isotope = Isotope::from_node(node)?;
    let per_cent = 100.0 * isotope.positrons_per_decay();
    Ok(format!("half-life {:.4e} s, {per_cent:.1} positrons per 100 decays", isotope.half_life_s))
}

fn phantom(node: &Node) -> Result<String, ConfigError> {
    let phantom = Phantom::from_node(node)?;
    Ok(format!("densest {:.4} /cm at 511 keV", 1e-2 * phantom.largest_attenuation_511_per_m()))
}

fn scanner(node: &Node) -> Result<String, ConfigError> {
    let scanner = Scanner::from_node(node)?;
    Ok(format!("{} blocks, {} crystals", scanner.blocks.len(), scanner.crystals()))
}

fn scintillator(node: &Node) -> Result<String, ConfigError> {
    let [total, compton] = Scintillator::from_node(node)?.attenuation_per_m(511e3).map(|per_m| 1e-2 * per_m);
    Ok(format!("{total:.3} /cm at 511 keV, {compton:.3} of it Compton"))
}

fn tract(node: &Node) -> Result<String, ConfigError> {
    let (tract, report) = tract_file::load(node, &TractOptions::default())?;
    let warnings = report.warnings.join("; ");
    let keys: Vec<String> = tract.segments.iter().map(|s| s.key.to_string()).collect();
    let text = format!("{:.3} m: {}", tract.length_m(), keys.join(", "));
    Ok(if warnings.is_empty() { text } else { format!("{text}; {warnings}") })
}

/// A model that was read.
#[derive(Serialize)]
struct Checked {
    model: String,
    ok: bool,
    summary: Option<String>,
    error: Option<String>,
}

fn check(root: &Path, json: bool) -> anyhow::Result<()> {
    let files = toml_files(root);
    if files.is_empty() {
        bail!("no model below {}", root.display());
    }
    let all: Vec<Checked> = files
        .iter()
        .map(|path| {
            let model = name_of(path, root);
            match Node::open(path).and_then(|node| summary(&node, &model)) {
                Ok(text) => Checked { model, ok: true, summary: Some(text), error: None },
                Err(error) => Checked { model, ok: false, summary: None, error: Some(error.to_string()) },
            }
        })
        .collect();
    if json {
        crate::output::json(&all)?;
    }
    for Checked { model, summary, error, .. } in all.iter().filter(|_| !json) {
        match (summary, error) {
            (Some(text), _) => say!("{model}: ok ({text})")?,
            (None, error) => complain!("{}", error.as_deref().unwrap_or_default()),
        }
    }
    let wrong = all.iter().filter(|c| !c.ok).count();
    if wrong > 0 {
        return Err(WrongFiles(format!("{wrong} of {} models are not right", all.len())).into());
    }
    Ok(())
}

/// Lists the modalities.
pub fn plugins(options: &PluginsOptions, registry: &Registry) -> anyhow::Result<()> {
    if options.json {
        let modalities = registry.modalities().map(
            |m| serde_json::json!({ "kind": m.kind(), "about": m.about(), "front_ends": m.front_ends() }),
        );
        let controllers = CONTROLLERS
            .iter()
            .map(|c| serde_json::json!({ "kind": c.name, "about": c.about, "is_controller": true }));
        let all: Vec<_> = modalities.chain(controllers).collect();
        return crate::output::json(&all);
    }
    for modality in registry.modalities() {
        say!("{}  {} (front ends: {})", modality.kind(), modality.about(), modality.front_ends().join(", "))?;
    }
    for controller in CONTROLLERS {
        say!("{}  {} (controller)", controller.name, controller.about)?;
    }
    Ok(())
}
