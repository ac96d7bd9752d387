//! What an exam costs: time, memory, size of its recording; and import and generator.

use crate::row::{Outcome, Sheet};
use crate::tools::{lumenav, root, run};
use lumenav::anatomy::generator::{BodySize, WholeGutRequest, whole_gut};
use lumenav::anatomy::import::{ImportOptions, import_surface};
use lumenav::core::{ModelFolder, Node, RandomStreams, SimTime};
use lumenav::report::{Metrics, read_json};
use lumenav::scenario::{ScenarioFile, build_world};
use std::path::Path;
use std::time::Instant;

/// The exam that is timed.
const EXAM: &str = "scenarios/whole-exam.toml";
/// Bounds: engine, its memory, its recording, import and generator.
const ENGINE_S: f64 = 25.0;
const MEMORY_MB: f64 = 500.0;
const RECORDING_MB: f64 = 60.0;
const IMPORT_S: f64 = 10.0;
const GENERATOR_S: f64 = 5.0;
/// Seeds of generated guts, each in three sizes.
const SEEDS: std::ops::Range<u64> = 1000..1003;

/// Measures these rows.
pub fn rows(sheet: &mut Sheet, scratch: &Path) {
    sheet.row(
        "5 whole exam",
        &format!("run {EXAM}"),
        "a row per segment for the motion and for each track, <= 500 MB, recording <= 60 MB",
        || whole_exam(&scratch.join("whole-exam")),
    );
    sheet.row(
        "speed: eight hours of exam, engine only",
        &format!("in this program: the world of {EXAM}, one thread"),
        "<= 25 s",
        engine_only,
    );
    sheet.row(
        "speed: import",
        "in this program: import_surface of LUMENAV_DATA/tracts, small bowel of 24,000 triangles",
        "<= 10 s",
        import,
    );
    sheet.row(
        "speed: generator",
        "in this program: whole guts of seeds 1000 to 1002 in three sizes",
        "<= 5 s each",
        || Ok(generator()),
    );
}

fn whole_exam(out: &Path) -> Outcome {
    let ended = run(lumenav().args(["-q", "run", EXAM, "--out"]).arg(out))?;
    let metrics: Metrics = read_json(&out.join("metrics.json")).map_err(|e| e.to_string())?;
    let motion = metrics.motion.as_ref().ok_or("metrics.json tells no motion")?;
    let bytes = std::fs::metadata(out.join("recording.rrd")).map_err(|e| e.to_string())?.len();
    let recording_mb = 1e-6 * bytes as f64;
    let peak_mb = ended.peak_mb.ok_or("this system does not tell a process's memory")?;
    let minutes = |segment: &lumenav::report::SegmentMotion| {
        format!("{} {:.1} min", segment.segment, segment.time_s / 60.0)
    };
    let segments: Vec<String> = motion.segments.iter().map(minutes).collect();
    let tracks = metrics.tracks.iter().map(|(name, track)| {
        let error = track.position_error_mm.as_ref();
        error.map_or(format!("{name} no error"), |e| {
            format!("{name} {:.2} mm mean, {:.2} worst", e.mean, e.max)
        })
    });
    let figure = format!(
        "{}; {}; {:.0} s with sensors, tracks and recording, {peak_mb:.0} MB, recording {recording_mb:.1} MB",
        segments.join(", "),
        tracks.collect::<Vec<_>>().join("; "),
        ended.seconds
    );
    let is_whole = segments.len() > 5
        && !metrics.tracks.is_empty()
        && metrics.tracks.values().all(|track| track.segments.len() == segments.len());
    Ok((figure, is_whole && peak_mb <= MEMORY_MB && recording_mb <= RECORDING_MB))
}

fn engine_only() -> Outcome {
    let models = ModelFolder::new(root().join("models"));
    let node = Node::open(&root().join(EXAM)).map_err(|e| e.to_string())?;
    let file = ScenarioFile::from_node(node, models).map_err(|e| e.to_string())?;
    let end_s = file.scenario.duration_s.ok_or("an exam has a duration")?.0;
    let mut world = build_world(&file, file.scenario.seed, 0).map_err(|e| e.to_string())?.world;
    let begin = Instant::now();
    let mut time_s = 0.0;
    while time_s < end_s {
        time_s += 1.0;
        let at = SimTime::from_seconds(time_s);
        world.advance_to(at).map_err(|e| e.to_string())?;
        world.forget_before(at);
    }
    let seconds = begin.elapsed().as_secs_f64();
    let hours = end_s / 3600.0;
    Ok((format!("{seconds:.1} s for {hours:.0} h"), seconds * 8.0 <= ENGINE_S * hours))
}

fn import() -> Outcome {
    let data = std::env::var_os("LUMENAV_DATA").ok_or("LUMENAV_DATA is not set")?;
    let surface = Path::new(&data).join("tracts/EdinGCA_3D_00090_small_intestine.stl");
    let begin = Instant::now();
    import_surface(&surface, &ImportOptions::default(), &mut |_| {}).map_err(|e| e.to_string())?;
    let seconds = begin.elapsed().as_secs_f64();
    Ok((format!("{seconds:.1} s"), seconds <= IMPORT_S))
}

fn generator() -> (String, bool) {
    let mut worst_s = 0.0_f64;
    let mut made = 0;
    for size in BodySize::ALL {
        for seed in SEEDS {
            let begin = Instant::now();
            // A seed that is refused costs its time, too.
            made += u32::from(
                whole_gut(&WholeGutRequest::new(size), &RandomStreams::new(seed, 0, "whole-gut")).is_ok(),
            );
            worst_s = worst_s.max(begin.elapsed().as_secs_f64());
        }
    }
    (format!("{worst_s:.1} s at most, {made} of 9 made"), worst_s <= GENERATOR_S)
}
