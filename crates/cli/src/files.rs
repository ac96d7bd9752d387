//! Result files that appear whole or not at all.

use anyhow::{Context as _, bail};
use std::path::{Path, PathBuf};

/// Refuses to overwrite, before the work.
///
/// # Errors
/// The first file that exists, unless `force`.
pub fn check_free(out: &Path, names: &[&str], force: bool) -> anyhow::Result<()> {
    match names.iter().map(|name| out.join(name)).find(|path| path.exists() && !force) {
        Some(there) => bail!("{} exists already; --force replaces it", there.display()),
        None => Ok(()),
    }
}

/// The folder and the name of a file that is asked for.
///
/// # Errors
/// A path without a file's name, or one that is not UTF-8.
pub fn folder_and_name(path: &Path) -> anyhow::Result<(PathBuf, String)> {
    let name = path.file_name().and_then(|name| name.to_str());
    let name = name.with_context(|| format!("{} names no file", path.display()))?;
    Ok((path.parent().unwrap_or_else(|| Path::new("")).to_owned(), name.to_owned()))
}

/// Writes files of a folder, each under another name first; their paths.
///
/// # Errors
/// What cannot be written.
pub fn write(out: &Path, files: &[(&str, String)]) -> anyhow::Result<Vec<PathBuf>> {
    std::fs::create_dir_all(out).with_context(|| format!("cannot create {}", out.display()))?;
    let mut written = Vec::new();
    for (name, text) in files {
        let path = out.join(name);
        let part = path.with_added_extension("part");
        let done = std::fs::write(&part, text).and_then(|()| std::fs::rename(&part, &path));
        if done.is_err() {
            std::fs::remove_file(&part).ok();
        }
        done.with_context(|| format!("cannot write {}", path.display()))?;
        written.push(path);
    }
    Ok(written)
}
