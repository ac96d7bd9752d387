//! `lumenav export`: truth and tracks of a run in others' formats.
//!
//! Every file appears whole or not at all, outside the run's folder: a run is the record of what was computed, and an export
//! with a file of the same name (`truth.tum`, `tracks.parquet`) would replace it by a copy of itself.

use crate::args::{ExportFormat, ExportOptions, Verbosity};
use anyhow::{Context as _, bail};
use lumenav::records::tum;
use lumenav::report::{
    Manifest, StampedPose, TrackRow, read_json, read_tracks, write_csv, write_kitti, write_mcap, write_tum,
};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What is exported: the truth where there is one, and the rows of each track.
struct Content {
    truth: Option<Vec<StampedPose>>,
    tracks: BTreeMap<String, Vec<TrackRow>>,
}

/// Exports a run.
pub fn export(options: &ExportOptions, verbosity: Verbosity) -> anyhow::Result<()> {
    if options.format == ExportFormat::Parquet && options.track.is_some() {
        bail!("--format parquet copies whole tables; --track goes with tum, kitti, csv and mcap");
    }
    let content = read(options)?;
    refuse_inside_the_run(options)?;
    let files = planned(&content, options);
    for path in &files {
        if path.exists() && !options.force {
            bail!("{} exists already; --force replaces it", path.display());
        }
    }
    std::fs::create_dir_all(&options.out)
        .with_context(|| format!("cannot create {}", options.out.display()))?;
    match options.format {
        ExportFormat::Parquet => {
            for name in tables(options) {
                copy(&options.run.join(format!("{name}.parquet")), &in_out(options, name, "parquet"))?;
            }
        }
        ExportFormat::Mcap => mcap(&content, options)?,
        ExportFormat::Csv => {
            for (name, rows) in &content.tracks {
                write_csv(&in_out(options, name, "csv"), rows)?;
            }
        }
        ExportFormat::Tum | ExportFormat::Kitti => trajectories(&content, options)?,
    }
    let names: Vec<String> = files.iter().map(|path| path.display().to_string()).collect();
    if options.json {
        return crate::output::json(&serde_json::json!({ "run": options.run, "files": names }));
    }
    if verbosity != Verbosity::Quiet {
        for name in names {
            say!("{name}")?;
        }
    }
    Ok(())
}

fn read(options: &ExportOptions) -> anyhow::Result<Content> {
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
    let truth = options.run.join("truth.tum");
    let truth = truth.is_file().then(|| tum::read(&truth)).transpose()?;
    let stamped = |(at, world_from_capsule)| StampedPose { at, world_from_capsule };
    let truth = truth.map(|poses| poses.into_iter().map(stamped).collect());
    Ok(Content { truth, tracks })
}

/// Refuses an `--out` that is the run's folder or lies in it, under whatever name.
fn refuse_inside_the_run(options: &ExportOptions) -> anyhow::Result<()> {
    let run =
        options.run.canonicalize().with_context(|| format!("cannot look at {}", options.run.display()))?;
    let out = std::path::absolute(&options.out)?;
    // The part of the path that exists decides where the rest will be.
    let real = out.ancestors().find_map(|part| {
        let rest = out.strip_prefix(part).ok()?;
        Some(part.canonicalize().ok()?.join(rest))
    });
    if real.unwrap_or(out).starts_with(&run) {
        bail!(
            "{} lies in the run's own folder {}, whose files would be replaced; choose another --out",
            options.out.display(),
            options.run.display()
        );
    }
    Ok(())
}

fn in_out(options: &ExportOptions, name: &str, ending: &str) -> PathBuf {
    options.out.join(format!("{name}.{ending}"))
}

/// All files that will be written.
fn planned(content: &Content, options: &ExportOptions) -> Vec<PathBuf> {
    let truth = content.truth.as_ref().map(|_| "truth");
    let tracks = || content.tracks.keys().map(|name| stem(name));
    let (names, ending): (Vec<&str>, &str) = match options.format {
        ExportFormat::Parquet => (tables(options), "parquet"),
        ExportFormat::Mcap => (vec!["run"], "mcap"),
        ExportFormat::Csv => (content.tracks.keys().map(String::as_str).collect(), "csv"),
        ExportFormat::Tum => (truth.into_iter().chain(tracks()).collect(), "tum"),
        ExportFormat::Kitti => (truth.into_iter().chain(tracks()).collect(), "kitti"),
    };
    names.into_iter().map(|name| in_out(options, name, ending)).collect()
}

/// The tables of a run: the tracks', and the truth's where there is one.
fn tables(options: &ExportOptions) -> Vec<&'static str> {
    let truth = options.run.join("truth.parquet").is_file().then_some("truth");
    ["tracks"].into_iter().chain(truth).collect()
}

/// A track called like the truth's file must not replace it.
fn stem(track: &str) -> &str {
    if track == "truth" { "track-truth" } else { track }
}

/// The poses of a track in order of time, one per instant.
fn poses(rows: &[TrackRow]) -> Vec<StampedPose> {
    let mut poses: Vec<StampedPose> = rows.iter().filter_map(TrackRow::stamped_pose).collect();
    // A late measurement refines an instant that was written before: the last word counts.
    poses.reverse();
    poses.sort_by_key(|p| p.at);
    poses.dedup_by_key(|p| p.at);
    poses
}

fn trajectories(content: &Content, options: &ExportOptions) -> anyhow::Result<()> {
    let write = |name: &str, poses: &[StampedPose]| match options.format {
        ExportFormat::Kitti => write_kitti(&in_out(options, name, "kitti"), poses),
        _ => write_tum(&in_out(options, name, "tum"), poses),
    };
    if let Some(truth) = &content.truth {
        write("truth", truth)?;
    }
    for (name, rows) in &content.tracks {
        write(stem(name), &poses(rows))?;
    }
    Ok(())
}

fn mcap(content: &Content, options: &ExportOptions) -> anyhow::Result<()> {
    let manifest: Manifest = read_json(&options.run.join("manifest.json"))?;
    let about = BTreeMap::from([
        ("scenario".to_owned(), manifest.scenario.clone()),
        ("seed".to_owned(), manifest.seed.to_string()),
        ("trial".to_owned(), manifest.trial.to_string()),
        ("lumenav_version".to_owned(), manifest.lumenav_version.clone()),
        ("git_revision".to_owned(), manifest.provenance.git_revision.clone().unwrap_or_default()),
        ("frame".to_owned(), "world, RAS: x right, y anterior, z superior; metres".to_owned()),
    ]);
    let mut channels = Vec::new();
    channels.extend(content.truth.as_ref().map(|truth| ("/truth".to_owned(), truth.clone())));
    for (name, rows) in &content.tracks {
        channels.push((format!("/tracks/{name}"), poses(rows)));
    }
    write_mcap(&in_out(options, "run", "mcap"), &about, &channels)?;
    Ok(())
}

/// Copies a file beside its new name and renames it.
fn copy(source: &Path, target: &Path) -> anyhow::Result<()> {
    let part = target.with_extension("parquet.part");
    let copied = std::fs::copy(source, &part).and_then(|_| std::fs::rename(&part, target));
    if copied.is_err() {
        std::fs::remove_file(&part).ok();
    }
    copied.with_context(|| format!("cannot copy {} to {}", source.display(), target.display()))
}
