//! A run's folder that appears whole or not at all.
//!
//! Everything is written into a hidden folder beside the target (same file system, so that renaming is one step), which
//! gets the target's name at the end. A run that fails or is stopped leaves no half results, and earlier ones stay.

use crate::error::ReportError;
use std::path::{Path, PathBuf};

/// A folder that is being filled.
#[derive(Debug)]
pub struct RunFolder {
    temporary: PathBuf,
    target: PathBuf,
    replace: bool,
    finished: bool,
}

impl RunFolder {
    /// Makes the hidden folder. `replace` allows that `target` exists: it is replaced at [`RunFolder::commit`].
    ///
    /// # Errors
    /// [`ReportError::Exists`], [`ReportError::NoName`], or [`ReportError::File`] where nothing can be written there.
    pub fn create(target: &Path, replace: bool) -> Result<Self, ReportError> {
        let name = target.file_name().ok_or_else(|| ReportError::NoName(target.to_owned()))?;
        if !replace && target.symlink_metadata().is_ok() {
            return Err(ReportError::Exists(target.to_owned()));
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
            let removed =
                if aside.is_dir() { std::fs::remove_dir_all(&aside) } else { std::fs::remove_file(&aside) };
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
