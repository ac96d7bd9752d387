//! `lumenav view`: open a recording in the Rerun viewer, or say how to get it.

use crate::args::ViewOptions;
use anyhow::bail;
use std::process::Command;

/// The viewer's version that matches the recordings.
const VIEWER: &str = "0.36.3";

/// Opens a recording.
pub fn view(options: &ViewOptions) -> anyhow::Result<()> {
    let path = if options.recording.is_dir() {
        options.recording.join("recording.rrd")
    } else {
        options.recording.clone()
    };
    if !path.is_file() {
        bail!("no recording at {}", path.display());
    }
    match Command::new("rerun").arg(&path).status() {
        Ok(status) if status.success() => Ok(()),
        Ok(status) => bail!("the viewer ended with {status}"),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => bail!(
            "the Rerun viewer is not installed; get it with `pip install rerun-sdk=={VIEWER}` (or `cargo install \
             rerun-cli --version {VIEWER}`), then `rerun {}`",
            path.display()
        ),
        Err(error) => Err(error.into()),
    }
}
