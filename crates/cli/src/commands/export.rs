//! `lumenav export`: truth and tracks of a run in others' formats.

use crate::args::{ExportFormat, ExportOptions};
use anyhow::{Context as _, bail};
use lumenav::report::{StampedPose, TrackRow, read_tracks, read_tum, write_csv, write_kitti, write_tum};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Exports a run.
pub fn export(options: &ExportOptions) -> anyhow::Result<()> {
    let rows = read_tracks(&options.run.join("tracks.parquet"))
        .with_context(|| format!("{} is no run's folder", options.run.display()))?;
    let mut tracks: BTreeMap<String, Vec<TrackRow>> = BTreeMap::new();
    for row in rows {
        tracks.entry(row.track.to_string()).or_default().push(row);
    }
    if let Some(wanted) = &options.track {
        if !tracks.contains_key(wanted) {
            let known: Vec<&str> = tracks.keys().map(String::as_str).collect();
            bail!("no track `{wanted}`; the run has: {}", known.join(", "));
        }
        tracks.retain(|name, _| name == wanted);
    }
    std::fs::create_dir_all(&options.out)
        .with_context(|| format!("cannot create {}", options.out.display()))?;
    if options.format == ExportFormat::Parquet {
        let source = options.run.join("tracks.parquet");
        std::fs::copy(&source, target("tracks", "parquet", options)?)
            .with_context(|| format!("cannot copy {}", source.display()))?;
        return Ok(());
    }
    let truth = options.run.join("truth.tum");
    if truth.is_file() && matches!(options.format, ExportFormat::Tum | ExportFormat::Kitti) {
        write_poses(&read_tum(&truth)?, "truth", options)?;
    }
    for (name, rows) in &tracks {
        write_track(name, rows, options)?;
    }
    Ok(())
}

fn target(name: &str, ending: &str, options: &ExportOptions) -> anyhow::Result<PathBuf> {
    let path = options.out.join(format!("{name}.{ending}"));
    if path.exists() && !options.force {
        bail!("{} exists already; --force replaces it", path.display());
    }
    println!("{}", path.display());
    Ok(path)
}

fn write_poses(poses: &[StampedPose], name: &str, options: &ExportOptions) -> anyhow::Result<()> {
    match options.format {
        ExportFormat::Kitti => write_kitti(&target(name, "kitti", options)?, poses)?,
        _ => write_tum(&target(name, "tum", options)?, poses)?,
    }
    Ok(())
}

fn write_track(name: &str, rows: &[TrackRow], options: &ExportOptions) -> anyhow::Result<()> {
    match options.format {
        ExportFormat::Csv => write_csv(&target(name, "csv", options)?, rows)?,
        // One file for all tracks: written by `export` itself.
        ExportFormat::Parquet => {}
        ExportFormat::Tum | ExportFormat::Kitti => {
            let mut poses: Vec<StampedPose> = rows.iter().filter_map(TrackRow::stamped_pose).collect();
            // A late measurement refines an instant that was written before: the last word counts.
            poses.reverse();
            poses.sort_by_key(|p| p.at);
            poses.dedup_by_key(|p| p.at);
            write_poses(&poses, name, options)?;
        }
    }
    Ok(())
}
