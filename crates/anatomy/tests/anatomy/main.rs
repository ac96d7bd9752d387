//! Tracts from files and from the generator: closed forms, laws, other programs, real people, bad files.

mod bad_files;
mod generated;
mod import_volumes;
mod import_walls;
mod imports;
mod real_people;
mod shapes;
mod splines;
mod whole_guts;

use lumenav_anatomy::tract_file::{TractOptions, load};
use lumenav_anatomy::{Tract, TractReport};
use lumenav_core::{ConfigError, Node};
use real_people::data;
use std::path::{Path, PathBuf};

/// The committed models.
fn models() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/tracts")
}

fn load_model(name: &str) -> (Tract, TractReport) {
    let node = Node::open(&models().join(format!("{name}.toml"))).unwrap();
    load(&node, &TractOptions::default()).unwrap()
}

fn load_text(text: &str) -> Result<(Tract, TractReport), ConfigError> {
    let node = Node::parse_text(text, "tract.toml", Path::new("."), &[])?;
    load(&node, &TractOptions::default())
}
