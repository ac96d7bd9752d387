//! `lumenav new scenario`: a file that works from the first minute.

use crate::args::NewCommand;
use anyhow::{Context as _, bail};
use lumenav::open_scenario;
use std::path::Path;

/// Makes something new.
pub fn new(what: &NewCommand) -> anyhow::Result<()> {
    match what {
        NewCommand::Scenario { file, from } => scenario(file, from),
    }
}

/// Copies a scenario under a new name, having checked that the original is right.
fn scenario(file: &Path, from: &Path) -> anyhow::Result<()> {
    if file.exists() {
        bail!("{} exists already", file.display());
    }
    let Some(name) = file.file_stem().map(|s| s.to_string_lossy().into_owned()) else {
        bail!("{} is no file name", file.display());
    };
    let original = open_scenario(from, &[], None)?;
    let old = format!("name = \"{}\"", original.scenario.name);
    let text = original.node.text().replacen(&old, &format!("name = \"{name}\""), 1);
    let text = format!("# Made from {} by `lumenav new scenario`.\n{text}", from.display());
    if let Some(parent) = file.parent().filter(|p| !p.as_os_str().is_empty()) {
        std::fs::create_dir_all(parent).with_context(|| format!("cannot create {}", parent.display()))?;
    }
    std::fs::write(file, text).with_context(|| format!("cannot write {}", file.display()))?;
    println!("wrote {}; try: lumenav run {}", file.display(), file.display());
    Ok(())
}
