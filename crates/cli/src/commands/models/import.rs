//! `models import`: a person's own gut, from a surface or a label volume to a tract file.

use crate::args::ImportTract;
use crate::exit::WrongFiles;
use crate::files;
use anyhow::{Context as _, bail};
use indicatif::{ProgressBar, ProgressStyle};
use lumenav::anatomy::SegmentKey;
use lumenav::anatomy::import::{
    ImportOptions, ImportedTract, Organ, Progress, SegmentStart, import_surface, tract_file_text,
};
use lumenav::anatomy::tract_file::Axes;

/// A place `x,y,z` given in mm of the surface's frame, m.
fn place(text: &str) -> anyhow::Result<[f64; 3]> {
    let numbers: Vec<f64> = text.split(',').filter_map(|n| n.trim().parse().ok()).collect();
    match numbers[..] {
        [x, y, z] => Ok([x, y, z].map(|v| 1e-3 * v)),
        _ => bail!("`{text}` is no place; give x,y,z in mm"),
    }
}

fn segment_start(text: &str) -> anyhow::Result<SegmentStart> {
    let (name, at) = text.split_once('=').with_context(|| format!("`{text}`: give SEGMENT=x,y,z"))?;
    let key = SegmentKey::from_name(name)
        .with_context(|| format!("no segment `{name}`; allowed: {}", SegmentKey::allowed()))?;
    Ok(SegmentStart { key, at_m: place(at)?.into() })
}

fn options_of(asked: &ImportTract) -> anyhow::Result<ImportOptions> {
    let axes = match asked.axes.as_deref() {
        None => None,
        Some("ras") => Some(Axes::Ras),
        Some("lps") => Some(Axes::Lps),
        Some(other) => bail!("axes `{other}`; allowed: ras, lps"),
    };
    let organ = match asked.organ.as_deref() {
        None => None,
        Some("small-bowel") => Some(Organ::SmallBowel),
        Some("colon") => Some(Organ::Colon),
        Some(other) => bail!("organ `{other}`; allowed: small-bowel, colon"),
    };
    if let Some(option) = asked.waypoints.iter().find(|text| text.starts_with("--")) {
        bail!(
            "`{option}` stands among the waypoints: give other options before --waypoints, or end these with the file's name after `--`"
        );
    }
    let is_volume =
        [".nii", ".nii.gz", ".mha", ".mhd"].iter().any(|end| asked.file.to_string_lossy().ends_with(end));
    if !asked.label.is_empty() && !is_volume {
        bail!("{}: a surface has no labels; leave --label out", asked.file.display());
    }
    Ok(ImportOptions {
        factor: asked.factor,
        labels: asked.label.clone(),
        axes,
        organ,
        name: asked.name.clone(),
        waypoints_m: asked
            .waypoints
            .iter()
            .map(|text| Ok(place(text)?.into()))
            .collect::<anyhow::Result<_>>()?,
        starts: asked.start.iter().map(|text| segment_start(text)).collect::<anyhow::Result<_>>()?,
    })
}

/// A tract whose middle is further than this from the origin is not where the shipped arrays are, m.
const FAR_M: f64 = 0.1;

pub(super) fn import(asked: &ImportTract) -> anyhow::Result<()> {
    let options = options_of(asked)?;
    let (folder, name) = files::folder_and_name(&asked.out)?;
    files::check_free(&folder, &[&name], asked.force)?;
    let bar = ProgressBar::new(100);
    if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} {pos} %") {
        bar.set_style(style);
    }
    let mut progress = |p: Progress| {
        bar.set_message(p.stage);
        bar.set_position((100.0 * p.done) as u64);
    };
    let imported = import_surface(&asked.file, &options, &mut progress);
    bar.finish_and_clear();
    let imported = imported.map_err(|error| WrongFiles(error.to_string()))?;
    let made_by = std::env::args().skip(1).collect::<Vec<_>>().join(" ");
    let text = tract_file_text(&imported, &format!("lumenav {made_by}"), asked.centre);
    let written = files::write(&folder, &[(&name, text)])?;
    tell(&imported)?;
    let middle_m = imported.middle_m();
    if !asked.centre && middle_m.iter().any(|m| m.abs() > FAR_M) {
        let [x, y, z] = middle_m.map(|m| 1e3 * m);
        say!(
            "its middle is at {x:.0}, {y:.0}, {z:.0} mm; the shipped arrays and scanners stand around the origin: --centre moves it there"
        )?;
    }
    written.iter().try_for_each(|path| say!("{}", path.display()))
}

fn tell(imported: &ImportedTract) -> anyhow::Result<()> {
    say!("{} repairs", imported.repairs.len())?;
    imported.repairs.iter().try_for_each(|repair| say!("  {repair}"))?;
    say!("{} warnings", imported.warnings.len())?;
    imported.warnings.iter().try_for_each(|warning| say!("  {warning}"))?;
    let fused = imported.self_contacts.iter().filter(|contact| contact.is_fused).count();
    say!("{} places where loops touch, {fused} where they are fused", imported.self_contacts.len() - fused)?;
    say!(
        "length {:.4} m, median radius {:.2} mm, voxels of {:.3} mm",
        imported.length_m,
        1e3 * imported.median_radius_m,
        1e3 * imported.voxel_m
    )
}
