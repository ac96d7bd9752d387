//! Configuration that still knows where it stands.
//!
//! A [`Node`] is a table of a user's TOML file with its file, its line numbers and its path of keys. Plugins get nodes, so
//! that an error of theirs names file, line and key as well as one of ours. `--set key=value` overrides keep their own
//! origin. Every parsed table is noted in a [`ResolvedLog`], from which `scenarios show --resolved` prints each key with its
//! value and whether it was set or is a default.
//!
//! Values with a range use the number types of [`quantity`]: a negative radius or a NaN is refused while parsing, at its
//! line.

mod node;
mod overrides;
pub mod quantity;
mod resolved;

pub use node::Node;
pub use resolved::{Resolved, ResolvedLog, ResolvedRow};

/// Something in a user's file that is not allowed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}", self.render())]
pub struct ConfigError {
    /// The file, or `--set …` for an override.
    pub file: String,
    /// Line and column from 1; `None` where the file as a whole is meant.
    pub position: Option<(usize, usize)>,
    /// Path of keys, for example `sensor[0].installed.array`; empty at the top.
    pub key: String,
    /// What is wrong and what is allowed.
    pub message: String,
}

impl ConfigError {
    fn render(&self) -> String {
        let mut text = self.file.clone();
        if let Some((line, column)) = self.position {
            text = format!("{text}:{line}:{column}");
        }
        if !self.key.is_empty() {
            text = format!("{text}: `{}`", self.key);
        }
        format!("{text}: {}", self.message)
    }
}
