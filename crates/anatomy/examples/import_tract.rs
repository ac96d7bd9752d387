//! Imports a person's gut: prints repairs, warnings and length, writes the tract file.
//!
//! `cargo run --release -p lumenav-anatomy --example import_tract -- FILE [options]`; the usage below tells the options.

use lumenav_anatomy::SegmentKey;
use lumenav_anatomy::import::{
    ImportOptions, ImportStation, Organ, Progress, SegmentStart, import_surface, tract_file_text,
};
use lumenav_anatomy::tract_file::Axes;
use nalgebra::Point3;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

const USAGE: &str = "usage: import_tract FILE.stl|obj|ply [--out TRACT.toml] [--stations STATIONS.csv] [--factor METRES_PER_UNIT] [--axes ras|lps] \
[--organ small-bowel|colon] [--name NAME] [--start SEGMENT=x,y,z]… [--waypoints x,y,z x,y,z …]   (places in mm, surface frame)";

struct Arguments {
    file: PathBuf,
    out: Option<PathBuf>,
    stations: Option<PathBuf>,
    options: ImportOptions,
}

fn point(text: &str) -> Result<Point3<f64>, String> {
    let numbers: Vec<f64> = text.split(',').filter_map(|n| n.trim().parse().ok()).collect();
    match numbers[..] {
        [x, y, z] => Ok(Point3::new(x, y, z) * 1e-3),
        _ => Err(format!("`{text}` is no place x,y,z in mm")),
    }
}

fn start(text: &str) -> Result<SegmentStart, String> {
    let (name, place) = text.split_once('=').ok_or_else(|| format!("`{text}`: SEGMENT=x,y,z is needed"))?;
    let key = SegmentKey::from_name(name)
        .ok_or_else(|| format!("no segment `{name}`; allowed: {}", SegmentKey::allowed()))?;
    Ok(SegmentStart { key, at_m: point(place)? })
}

fn arguments() -> Result<Arguments, String> {
    let mut words = std::env::args().skip(1).peekable();
    let file = words.next().ok_or(USAGE)?.into();
    let mut arguments = Arguments { file, out: None, stations: None, options: ImportOptions::default() };
    let options = &mut arguments.options;
    while let Some(word) = words.next() {
        let mut value = || words.next().ok_or_else(|| format!("{word} needs a value\n{USAGE}"));
        match &word[..] {
            "--out" => arguments.out = Some(value()?.into()),
            "--stations" => arguments.stations = Some(value()?.into()),
            "--name" => options.name = Some(value()?),
            "--factor" => options.factor = value()?.parse().map_err(|_| "--factor needs a number")?,
            "--axes" => options.axes = Some(axes(&value()?)?),
            "--organ" => options.organ = Some(organ(&value()?)?),
            "--start" => options.starts.push(start(&value()?)?),
            "--waypoints" => {
                while let Some(word) = words.next_if(|word| !word.starts_with("--")) {
                    options.waypoints_m.push(point(&word)?);
                }
            }
            _ => return Err(format!("`{word}` is not understood\n{USAGE}")),
        }
    }
    Ok(arguments)
}

fn axes(word: &str) -> Result<Axes, String> {
    match word {
        "ras" => Ok(Axes::Ras),
        "lps" => Ok(Axes::Lps),
        _ => Err(format!("axes `{word}`; allowed: ras, lps")),
    }
}

fn organ(word: &str) -> Result<Organ, String> {
    match word {
        "small-bowel" => Ok(Organ::SmallBowel),
        "colon" => Ok(Organ::Colon),
        _ => Err(format!("organ `{word}`; allowed: small-bowel, colon")),
    }
}

fn run() -> Result<(), String> {
    let Arguments { file, out, stations, options } = arguments()?;
    let begin = Instant::now();
    let mut stage = "";
    let mut progress = |p: Progress| {
        if p.stage != stage {
            stage = p.stage;
            eprintln!("{:6.2} s  {stage}", begin.elapsed().as_secs_f64());
        }
    };
    let imported = import_surface(&file, &options, &mut progress).map_err(|error| error.to_string())?;
    println!("{} repairs", imported.repairs.len());
    imported.repairs.iter().for_each(|repair| println!("  {repair}"));
    println!("{} warnings", imported.warnings.len());
    imported.warnings.iter().for_each(|warning| println!("  {warning}"));
    let touching = imported.self_contacts.iter().filter(|c| !c.is_fused).count();
    println!(
        "{touching} places where loops touch, {} where they are fused",
        imported.self_contacts.len() - touching
    );
    println!(
        "length {:.4} m, median radius {:.2} mm, voxels of {:.3} mm, {:.2} s",
        imported.length_m,
        1e3 * imported.median_radius_m,
        1e3 * imported.voxel_m,
        begin.elapsed().as_secs_f64()
    );
    if let Some(file) = stations {
        let row = |s: &ImportStation| {
            format!("{:.6},{:.6},{:.6},{:.6}\n", s.point_m.x, s.point_m.y, s.point_m.z, s.radius_m)
        };
        let text: String = imported.stations.iter().map(row).collect();
        std::fs::write(&file, format!("x_m,y_m,z_m,radius_m\n{text}"))
            .map_err(|error| format!("{}: {error}", file.display()))?;
    }
    let out =
        out.unwrap_or_else(|| Path::new(file.file_stem().unwrap_or_default()).with_extension("tract.toml"));
    let made_by = std::env::args().skip(1).collect::<Vec<_>>().join(" ");
    let text = tract_file_text(&imported, &format!("import_tract {made_by}"));
    std::fs::write(&out, text).map_err(|error| format!("{}: {error}", out.display()))?;
    println!("written: {}", out.display());
    Ok(())
}

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("{message}");
            ExitCode::FAILURE
        }
    }
}
