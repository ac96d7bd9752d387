//! A run's folder that appears whole or not at all.
//!
//! Everything is written into a hidden folder beside the target (same file system, so that renaming is one step), which
//! gets the target's name at the end. A run that fails or is stopped leaves no half results, and earlier ones stay.
//!
//! Replacing is deleting, so only what is surely ours is replaced: an empty folder, or one with a `manifest.json` or
//! `trials.json` that this program wrote. A slip of the keyboard (`--out . --force`) must not cost anybody's work.

use crate::error::ReportError;
use crate::manifest::{Manifest, read_json};
use crate::trials::Trials;
use std::path::{Path, PathBuf};

/// Refuses a path that may not be replaced: no folder, or a folder that is neither empty nor a run's or trials' own.
///
/// A folder of trials that was stopped before its `trials.json` counts as ours where it holds nothing but `trials/` with
/// folders of runs in it.
///
/// # Errors
/// [`ReportError::NotOurs`] with what is in the way, [`ReportError::File`] where it cannot be looked into.
pub fn check_replaceable(target: &Path) -> Result<(), ReportError> {
    let refuse = |why: &'static str| Err(ReportError::NotOurs { path: target.to_owned(), why });
    if !target.is_dir() {
        return refuse("it is no folder");
    }
    let names = names_in(target)?;
    if names.is_empty() || is_run(target) || is_trials(target)? {
        return Ok(());
    }
    refuse("it holds no manifest.json or trials.json of lumenav")
}

/// Whether a folder holds a manifest of ours; one of the same name by another program (a web page's, say) does not count.
fn is_run(folder: &Path) -> bool {
    read_json::<Manifest>(&folder.join("manifest.json")).is_ok()
}

/// Whether a folder holds trials of ours, finished or stopped.
fn is_trials(folder: &Path) -> Result<bool, ReportError> {
    if read_json::<Trials>(&folder.join("trials.json")).is_ok() {
        return Ok(true);
    }
    if names_in(folder)? != ["trials"] {
        return Ok(false);
    }
    let inside = folder.join("trials");
    Ok(names_in(&inside)?.iter().all(|name| is_partial(name) || is_run(&inside.join(name))))
}

/// What a killed run leaves: the hidden folder it was filling.
fn is_partial(name: &str) -> bool {
    name.starts_with('.') && name.contains(".partial-")
}

/// Names in a folder, sorted.
fn names_in(folder: &Path) -> Result<Vec<String>, ReportError> {
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(ReportError::file("cannot list", folder))? {
        let entry = entry.map_err(ReportError::file("cannot list", folder))?;
        names.push(entry.file_name().to_string_lossy().into_owned());
    }
    names.sort();
    Ok(names)
}

/// A folder that is being filled.
#[derive(Debug)]
pub struct RunFolder {
    temporary: PathBuf,
    target: PathBuf,
    replace: bool,
    finished: bool,
}

impl RunFolder {
    /// Makes the hidden folder. `replace` allows that `target` exists and is ours (see [`check_replaceable`]): it is
    /// replaced at [`RunFolder::commit`].
    ///
    /// # Errors
    /// [`ReportError::Exists`], [`ReportError::NotOurs`], [`ReportError::NoName`], or [`ReportError::File`] where nothing
    /// can be written there.
    pub fn create(target: &Path, replace: bool) -> Result<Self, ReportError> {
        let name = target.file_name().ok_or_else(|| ReportError::NoName(target.to_owned()))?;
        if target.symlink_metadata().is_ok() {
            if !replace {
                return Err(ReportError::Exists(target.to_owned()));
            }
            check_replaceable(target)?;
        }
        let parent = match target.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent,
            _ => Path::new("."),
        };
        std::fs::create_dir_all(parent).map_err(ReportError::file("cannot create folder", parent))?;
        let mut attempt = 0_u32;
        let temporary = loop {
            let hidden = format!(".{}.partial-{}-{attempt}", name.to_string_lossy(), std::process::id());
            let path = parent.join(hidden);
            match std::fs::create_dir(&path) {
                Ok(()) => break path,
                // Left by a run that was killed and had the same process number.
                Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists && attempt < 1000 => attempt += 1,
                Err(e) => return Err(ReportError::file("cannot create folder", &path)(e)),
            }
        };
        Ok(Self { temporary, target: target.to_owned(), replace, finished: false })
    }

    /// Where to write now.
    pub fn path(&self) -> &Path {
        &self.temporary
    }

    /// Where it will be.
    pub fn target(&self) -> &Path {
        &self.target
    }

    /// Gives the folder its name.
    ///
    /// # Errors
    /// [`ReportError::Exists`] where something has appeared there meanwhile, [`ReportError::File`].
    pub fn commit(mut self) -> Result<PathBuf, ReportError> {
        let mut old = None;
        if self.target.symlink_metadata().is_ok() {
            if !self.replace {
                return Err(ReportError::Exists(self.target.clone()));
            }
            // Looked at again: hours may have passed since the run began.
            check_replaceable(&self.target)?;
            let mut aside = self.temporary.clone().into_os_string();
            aside.push(".old");
            let aside = PathBuf::from(aside);
            std::fs::rename(&self.target, &aside)
                .map_err(ReportError::file("cannot put aside", &self.target))?;
            old = Some(aside);
        }
        if let Err(source) = std::fs::rename(&self.temporary, &self.target) {
            if let Some(aside) = &old {
                // What was there before is worth more than a clean error.
                std::fs::rename(aside, &self.target).ok();
            }
            return Err(ReportError::file("cannot rename into", &self.target)(source));
        }
        self.finished = true;
        if let Some(aside) = old {
            // A link to a run's folder: the link is replaced, what it points to stays.
            let linked = aside.symlink_metadata().is_ok_and(|m| m.is_symlink());
            let removed = if linked { std::fs::remove_file(&aside) } else { std::fs::remove_dir_all(&aside) };
            removed.map_err(ReportError::file("cannot remove", &aside))?;
        }
        Ok(self.target.clone())
    }
}

impl Drop for RunFolder {
    fn drop(&mut self) {
        if !self.finished {
            std::fs::remove_dir_all(&self.temporary).ok();
        }
    }
}
