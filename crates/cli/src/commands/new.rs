//! `lumenav new scenario`: a file that works from the first minute.
//!
//! The new file is one that works under another name: the `name` in its `[scenario]` table is replaced and nothing else, and
//! the text is opened and checked *as it will stand* (paths in it are relative to its new place) before anything is written.
//! The shipped scenarios are part of the program, so that a name is enough, also outside a checkout.

use super::replay::is_replay;
use crate::args::{NewCommand, Verbosity};
use anyhow::{Context as _, bail};
use lumenav::core::{ModelFolder, Node, Registry};
use lumenav::scenario::ScenarioFile;
use std::path::{Path, PathBuf};

/// The shipped scenarios by name (about 10 kB in all).
const SHIPPED: [(&str, &str); 31] = [
    ("colon-magnetic", include_str!("../../../../scenarios/colon-magnetic.toml")),
    ("colon-pet-bed", include_str!("../../../../scenarios/colon-pet-bed.toml")),
    ("colon-pet-magnetic", include_str!("../../../../scenarios/colon-pet-magnetic.toml")),
    ("colon-pet", include_str!("../../../../scenarios/colon-pet.toml")),
    ("cough-and-turn", include_str!("../../../../scenarios/cough-and-turn.toml")),
    ("duodenum-reflux", include_str!("../../../../scenarios/duodenum-reflux.toml")),
    ("helix-magnetic", include_str!("../../../../scenarios/helix-magnetic.toml")),
    ("helix-pet", include_str!("../../../../scenarios/helix-pet.toml")),
    ("layout/belt-helix", include_str!("../../../../scenarios/layout/belt-helix.toml")),
    ("layout/cylinder", include_str!("../../../../scenarios/layout/cylinder.toml")),
    ("layout/one-plane", include_str!("../../../../scenarios/layout/one-plane.toml")),
    ("layout/pet-pairs", include_str!("../../../../scenarios/layout/pet-pairs.toml")),
    ("layout/planes-candidates", include_str!("../../../../scenarios/layout/planes-candidates.toml")),
    ("layout/two-planes", include_str!("../../../../scenarios/layout/two-planes.toml")),
    ("matched-magnetic", include_str!("../../../../scenarios/matched-magnetic.toml")),
    ("matched-pet", include_str!("../../../../scenarios/matched-pet.toml")),
    ("replay/magnet-patch", include_str!("../../../../scenarios/replay/magnet-patch.toml")),
    ("replay/pept-1p-fluidised", include_str!("../../../../scenarios/replay/pept-1p-fluidised.toml")),
    ("replay/pept-2p-static", include_str!("../../../../scenarios/replay/pept-2p-static.toml")),
    ("retention-stricture", include_str!("../../../../scenarios/retention-stricture.toml")),
    ("self-calibration", include_str!("../../../../scenarios/self-calibration.toml")),
    ("small-bowel", include_str!("../../../../scenarios/small-bowel.toml")),
    ("smoke/colon", include_str!("../../../../scenarios/smoke/colon.toml")),
    ("smoke/faults", include_str!("../../../../scenarios/smoke/faults.toml")),
    ("smoke/helix", include_str!("../../../../scenarios/smoke/helix.toml")),
    ("smoke/pet", include_str!("../../../../scenarios/smoke/pet.toml")),
    ("stomach", include_str!("../../../../scenarios/stomach.toml")),
    ("tethered", include_str!("../../../../scenarios/tethered.toml")),
    ("torso-belt-study", include_str!("../../../../scenarios/torso-belt-study.toml")),
    ("turning-patient", include_str!("../../../../scenarios/turning-patient.toml")),
    ("whole-exam", include_str!("../../../../scenarios/whole-exam.toml")),
];

/// Makes something new.
pub fn new(what: &NewCommand, registry: &Registry, verbosity: Verbosity) -> anyhow::Result<()> {
    match what {
        NewCommand::Scenario { file, from, models } => {
            scenario(file, from, models.as_deref(), registry, verbosity)
        }
    }
}

fn scenario(
    file: &Path,
    from: &str,
    models: Option<&Path>,
    registry: &Registry,
    verbosity: Verbosity,
) -> anyhow::Result<()> {
    if file.symlink_metadata().is_ok() {
        bail!("{} exists already", file.display());
    }
    let Some(name) = file.file_stem().map(|s| s.to_string_lossy().into_owned()) else {
        bail!("{} is no file name", file.display());
    };
    let (origin, original) = original(from)?;
    let renamed = with_name(&original, &name).with_context(|| format!("{origin} has no `scenario.name`"))?;
    let text = format!("# Made from {origin} by `lumenav new scenario`.\n{renamed}");
    let is_replay = check(&text, file, lumenav::models_folder(models, file), registry)
        .with_context(|| format!("{origin} does not work as {}; nothing was written", file.display()))?;
    write_beside(file, &text)?;
    if verbosity != Verbosity::Quiet {
        let command = if is_replay { "replay" } else { "run" };
        say!("wrote {}; try: lumenav {command} {}", file.display(), file.display())?;
    }
    Ok(())
}

/// Where the text comes from, and the text: a file, a file in a `scenarios` folder here or above, or a shipped one.
fn original(from: &str) -> anyhow::Result<(String, String)> {
    let mut candidates = vec![PathBuf::from(from)];
    let here = std::env::current_dir().unwrap_or_default();
    candidates.extend(here.ancestors().map(|folder| folder.join("scenarios").join(format!("{from}.toml"))));
    if let Some(path) = candidates.iter().find(|path| path.is_file()) {
        // As a person would name it: relative to the working folder where it lies below.
        let shown = path.strip_prefix(&here).unwrap_or(path).display().to_string();
        let node = Node::open(path)?;
        return Ok((shown, node.text().to_owned()));
    }
    if let Some((name, text)) = SHIPPED.iter().find(|(name, _)| *name == from) {
        return Ok((format!("the shipped scenario `{name}`"), (*text).to_owned()));
    }
    let names: Vec<&str> = SHIPPED.iter().map(|(name, _)| *name).collect();
    bail!(
        "no scenario `{from}`: no such file, none in a folder `scenarios` here or above; shipped are: {}",
        names.join(", ")
    )
}

/// The text with another `scenario.name`, whatever its spelling; `None` where it has none.
fn with_name(text: &str, name: &str) -> Option<String> {
    let table = toml::de::DeTable::parse(text).ok()?;
    let span = table.get_ref().get("scenario")?.get_ref().as_table()?.get("name")?.span();
    let quoted = toml::Value::String(name.to_owned()).to_string();
    Some(format!("{}{quoted}{}", text.get(..span.start)?, text.get(span.end..)?))
}

/// Reads the text as if it stood in `file` already and checks it; whether it is a replay.
fn check(text: &str, file: &Path, models: ModelFolder, registry: &Registry) -> anyhow::Result<bool> {
    let folder = file.parent().unwrap_or_else(|| Path::new(""));
    let node = Node::parse_text(text, &file.display().to_string(), folder, &[])?;
    let is_replay = is_replay(&node);
    let scenario = ScenarioFile::from_node(node, models)?;
    if is_replay {
        lumenav::pipeline::build::readers(&scenario, registry)?;
        lumenav::pipeline::build::tracks(&scenario, registry, None)?;
    } else {
        lumenav::check(&scenario, registry)?;
    }
    Ok(is_replay)
}

/// Writes the file beside its name and gives it the name at the end.
fn write_beside(file: &Path, text: &str) -> anyhow::Result<()> {
    if let Some(parent) = file.parent().filter(|p| !p.as_os_str().is_empty()) {
        std::fs::create_dir_all(parent).with_context(|| format!("cannot create {}", parent.display()))?;
    }
    let mut part = file.as_os_str().to_owned();
    part.push(".part");
    let part = PathBuf::from(part);
    let written = std::fs::write(&part, text).and_then(|()| std::fs::rename(&part, file));
    if written.is_err() {
        std::fs::remove_file(&part).ok();
    }
    written.with_context(|| format!("cannot write {}", file.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_form_the_name_is_replaced_in_any_spelling() {
        for text in [
            "[scenario]\nname = \"old\"\n[tract]\nname = \"old\"\n",
            "[scenario]\n  name=\"old\" # name = \"old\"\n[tract]\nname = \"old\"\n",
            "scenario.name = 'old'\n[tract]\nname = \"old\"\n",
            "scenario = { duration_s = 1, name   =   \"\"\"old\"\"\" }\n[tract]\nname = \"old\"\n",
        ] {
            let table: toml::Table = with_name(text, "a \"b\"").unwrap().parse().unwrap();
            assert_eq!(table["scenario"]["name"].as_str(), Some("a \"b\""), "{text}");
            assert_eq!(table["tract"]["name"].as_str(), Some("old"), "{text}");
        }
        assert_eq!(with_name("[tract]\nname = \"old\"\n", "new"), None);
    }

    #[test]
    fn law_the_program_ships_every_scenario() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios");
        let files: Vec<String> = super::super::scenarios::toml_files(&root)
            .iter()
            .map(|path| path.strip_prefix(&root).unwrap().with_extension("").display().to_string())
            .collect();
        let shipped: Vec<&str> = SHIPPED.iter().map(|(name, _)| *name).collect();
        assert_eq!(files, shipped);
    }
}
