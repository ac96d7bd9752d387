//! Records a minute of a capsule on a helix: what a recording looks like, without any simulation behind it.
//!
//! ```text
//! cargo run -p lumenav-recording --example helix -- helix.rrd
//! rerun helix.rrd
//! ```
//!
//! With `--connect host:port` in place of the file it is sent to a viewer that runs there (`rerun --port PORT`).

#![expect(clippy::disallowed_types, reason = "world side: the example plays a world")]

#[path = "../../pipeline/tests/synthetic/mod.rs"]
mod synthetic;

use lumenav_recording::{RecorderOptions, RrdRecorder, inspect};
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if let [flag, address] = arguments.as_slice()
        && flag == "--connect"
    {
        let mut recorder = RrdRecorder::to_viewer(address, RecorderOptions::default())?;
        return Ok(synthetic::play(&mut recorder, 60.0, 50.0, &["magnetic", "pet"])?);
    }
    let path = PathBuf::from(arguments.first().map_or("helix.rrd", String::as_str));
    let mut recorder = RrdRecorder::to_file(&path, RecorderOptions::default())?;
    synthetic::play(&mut recorder, 60.0, 50.0, &["magnetic", "pet"])?;
    for (entity, rows) in inspect(&path)?.rows {
        println!("{rows:6} {entity}");
    }
    println!("{} kB", std::fs::metadata(&path)?.len() / 1000);
    Ok(())
}
