//! The foundation's Shows lines and speeds.

use crate::figures::{trajectory, transported_m};
use crate::row::{Outcome, Sheet};
use crate::tools::{Ended, bench, lumenav, metrics_of, root, run, test, tested};
use lumenav::evaluation::trajectory::absolute::absolute_pose_error;
use lumenav::evaluation::trajectory::relative::{Delta, PairRule, relative_pose_error};
use lumenav::evaluation::trajectory::{Relation, associate};
use lumenav::report::{Metrics, Trials, TrialsCollector, read_json};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{SystemTime, UNIX_EPOCH};

const COLON: &str = "scenarios/colon-magnetic.toml";
const HELIX: &str = "scenarios/helix-magnetic.toml";
const EDIN: &str = "tracts/gi_tract_edin00090.toml";

/// Measures all rows.
pub fn rows(sheet: &mut Sheet) {
    let scratch = match tempfile::tempdir() {
        Ok(folder) => folder,
        Err(error) => return eprintln!("no temporary folder: {error}"),
    };
    let out = scratch.path();
    main_job(sheet, out);
    accuracy(sheet, out);
    consistency(sheet, out);
    engine(sheet, out);
    real_data(sheet, out);
    recording(sheet, out);
    trajectories(sheet, out);
    faults_and_seam(sheet);
    properties(sheet);
    speed(sheet);
}

fn within(value: f64, low: f64, high: f64) -> bool {
    (low..=high).contains(&value)
}

fn mean_mm(metrics: &Metrics, track: &str) -> Result<f64, String> {
    let figures = metrics.tracks.get(track).and_then(|t| t.position_error_mm);
    figures.map(|f| f.mean).ok_or_else(|| format!("no error of track `{track}`"))
}

fn text(path: &Path) -> String {
    path.display().to_string()
}

/// Line 1 and the time and memory of the main job.
fn main_job(sheet: &mut Sheet, out: &Path) {
    let job = |out: PathBuf, extra: &[&str]| -> Result<Ended, String> {
        run(lumenav().args(["-q", "run", COLON, "--force", "--out"]).arg(out).args(extra))
    };
    let described = |ended: &Ended| {
        let memory = ended.peak_mb.map_or("memory unknown".to_owned(), |mb| format!("{mb:.0} MB"));
        format!("{:.1} s, {memory}", ended.seconds)
    };
    let mut ten_minutes_mb = None;
    sheet.row("1 main job: time and memory", &format!("run {COLON}"), "<= 10 s, <= 300 MB", || {
        let ended = job(out.join("colon"), &[])?;
        ten_minutes_mb = ended.peak_mb;
        Ok((described(&ended), ended.seconds <= 10.0 && ended.peak_mb.is_some_and(|mb| mb <= 300.0)))
    });
    let hour = "scenario.duration_s=3600";
    sheet.row(
        "1 main job: 60 minutes",
        &format!("run {COLON} --set {hour}"),
        "memory of ten minutes, +10 %",
        || {
            if ten_minutes_mb.is_none() {
                ten_minutes_mb = job(out.join("colon"), &[])?.peak_mb;
            }
            let ended = job(out.join("hour"), &["--set", hour])?;
            let (Some(short), Some(long)) = (ten_minutes_mb, ended.peak_mb) else {
                return Err("this system does not tell a process's memory".to_owned());
            };
            Ok((format!("{}; ten minutes: {short:.0} MB", described(&ended)), long <= 1.1 * short))
        },
    );
}

/// Line 2: the tracker at its bound, the filter against the tracker.
fn accuracy(sheet: &mut Sheet, out: &Path) {
    for seed in ["1", "2", "3", "4", "5"] {
        let line = format!("2 tracker over bound on the helix, seed {seed}");
        sheet.row(&line, &format!("run {HELIX} --seed {seed}"), "0.95 to 1.1", || {
            let metrics =
                metrics_of(&["run", HELIX, "--seed", seed, "--record", "none"], &out.join("helix"))?;
            let track = &metrics.tracks["magnetic"];
            let whole = track.rmse_over_bound.ok_or("no bound")?;
            let each = track.rms_of_error_over_bound.ok_or("no bound")?;
            let figure = format!("rms of error/bound {each:.4}; rmse over rms bound {whole:.4}");
            Ok((figure, within(whole, 0.95, 1.1) && within(each, 0.95, 1.1)))
        });
    }
    let line = "2 filter better than tracker in the colon, paired over seeds 1 to 20";
    sheet.row(line, &format!("run {COLON} --seed 1..20"), "interval above 0, NEES/dof <= 1.5", || {
        let mut collector = TrialsCollector::default();
        let mut over = 0.0_f64;
        for seed in 1..=20_u64 {
            let (number, folder) = (seed.to_string(), out.join("paired"));
            let metrics = metrics_of(&["run", COLON, "--seed", &number, "--record", "none"], &folder)?;
            let nees = metrics.tracks["magnetic-eskf"].nees.ok_or("no NEES")?;
            over = over.max(nees.mean / nees.dof as f64);
            collector.push(&metrics, &folder).map_err(|e| e.to_string())?;
        }
        let trials = collector.finish().map_err(|e| e.to_string())?;
        let pair = trials.comparisons.first().ok_or("no comparison")?;
        let (compared, instants) = (&pair.comparison, &pair.instants);
        let words = format!(
            "{}; {} common instants, {} of one track alone; largest mean NEES/dof {over:.2}",
            pair.sentence, instants.common, instants.single
        );
        // Tracks are in order of their names: `magnetic` is the first.
        let better = compared.first == "magnetic" && compared.advantage_of_first.upper < 0.0;
        Ok((words, better && compared.is_decided() && over <= 1.5))
    });
}

/// Line 2: does the filter know how wrong it is?
fn consistency(sheet: &mut Sheet, out: &Path) {
    let scenario = "scenarios/matched-magnetic.toml";
    let ask = "mean NEES/dof 0.85 to 1.25 at >= 90 % of the steps, 90 % region covers 85 to 95 %";
    for track in ["flux", "pose"] {
        let line = format!("2 consistency, nonlinear matched case, track {track}");
        let set = "scenario.duration_s=60";
        let command = format!("run {scenario} --trials 400 --seed 11 --set {set}");
        sheet.row(&line, &command, ask, || {
            let folder = out.join(format!("matched-{track}"));
            run(lumenav()
                .args([
                    "-q", "run", scenario, "--trials", "400", "--seed", "11", "--set", set, "--force",
                    "--out",
                ])
                .arg(&folder))?;
            let trials: Trials = read_json(&folder.join("trials.json")).map_err(|e| e.to_string())?;
            let nees = trials.tracks[track].nees.as_ref().ok_or("no NEES")?;
            let figure = format!(
                "{:.1} % of {} steps, coverage {:.1} %, mean {:.3}, {} failed",
                100.0 * nees.share_within_085_125,
                nees.across.steps,
                100.0 * nees.across.coverage_90,
                nees.across.mean_per_dof,
                trials.failed
            );
            let pass = nees.share_within_085_125 >= 0.9 && within(nees.across.coverage_90, 0.85, 0.95);
            Ok((figure, pass && trials.failed == 0))
        });
    }
    tested(sheet, "2 consistency, linear-Gaussian matched case", "it", "consistency::");
    tested(sheet, "3 bound tables of the reference study", "bound", "");
}

/// Line 4.
fn engine(sheet: &mut Sheet, out: &Path) {
    for (what, name) in [
        ("shipped colon", "law_the_capsule_stays_inside_the_shipped_colon"),
        ("a person's colon", "law_the_capsule_stays_inside_a_measured_colon"),
        ("a person's whole tract", "law_the_capsule_stays_inside_a_measured_tract"),
    ] {
        tested(sheet, &format!("4 inside the lumen, 200 seeds of 60 s, {what}"), "engine", name);
    }
    tested(
        sheet,
        "4 zero waves, 240 against 1,000 Hz, snapshot and the other laws of the engine",
        "engine",
        "law_",
    );
    sheet.row("4 distance in the colon", &format!("run {COLON}"), ">= 0.5 m", || {
        let folder = out.join("colon");
        if !folder.exists() {
            metrics_of(&["run", COLON, "--record", "none"], &folder)?;
        }
        let metres = transported_m(&folder.join("truth.parquet"))?;
        Ok((format!("{metres:.3} m"), metres >= 0.5))
    });
    sheet.row(
        "4 same bytes for 1 and 2 threads",
        &format!("run {COLON} --trials 2 --threads 1|2"),
        "equal",
        || {
            let names = [
                "trials.json",
                "trials/001/tracks.parquet",
                "trials/001/metrics.json",
                "trials/001/truth.tum",
            ];
            let mut files = Vec::new();
            for threads in ["1", "2"] {
                let folder = out.join(format!("threads-{threads}"));
                run(lumenav()
                    .args(["-q", "run", COLON, "--trials", "2", "--threads", threads, "--force", "--out"])
                    .arg(&folder))?;
                for name in names {
                    files.push(std::fs::read(folder.join(name)).map_err(|e| format!("{name}: {e}"))?);
                }
            }
            let equal = files[..names.len()] == files[names.len()..];
            Ok((if equal { "equal".to_owned() } else { "different".to_owned() }, equal))
        },
    );
}

/// Lines 5 and 6: what real people and real magnets give.
fn real_data(sheet: &mut Sheet, out: &Path) {
    let data = std::env::var("LUMENAV_DATA").map_err(|_| "LUMENAV_DATA unset".to_owned());
    let segments = "tract.segments=[\"ascending\",\"transverse\",\"descending\"]";
    let command = format!("run {COLON} --set tract.model=$LUMENAV_DATA/{EDIN} --set '{segments}'");
    sheet.row("5 a person's colon", &command, ">= 0.3 m", || {
        let model = format!("tract.model={}/{EDIN}", data.clone()?);
        let metrics = metrics_of(&["run", COLON, "--set", &model, "--set", segments], &out.join("edin"))?;
        let metres = transported_m(&out.join("edin/truth.parquet"))?;
        let error = mean_mm(&metrics, "magnetic-eskf")?;
        Ok((format!("{metres:.3} m; mean error of the filter {error:.3} mm"), metres >= 0.3))
    });
    let replay = "scenarios/replay/magnet-patch.toml";
    for (track, limit) in [("cylinder", 0.10), ("dipole", 0.17)] {
        let line = format!("6 recorded series, {track}");
        sheet.row(&line, &format!("replay {replay}"), &format!("<= {limit} mm mean"), || {
            data.clone()?;
            let metrics = metrics_of(&["replay", replay], &out.join("patch"))?;
            let mean = mean_mm(&metrics, track)?;
            Ok((format!("{mean:.4} mm over {} poses", metrics.tracks[track].updates), mean <= limit))
        });
    }
}

/// Line 7, by the Rerun command-line tool of the same version.
fn recording(sheet: &mut Sheet, out: &Path) {
    let recorded = || -> Result<PathBuf, String> {
        let file = out.join("colon/recording.rrd");
        if !file.exists() {
            metrics_of(&["run", COLON], &out.join("colon"))?;
        }
        Ok(file)
    };
    sheet.row("7 rerun rrd verify", "rerun rrd verify recording.rrd", "passes", || {
        run(Command::new("rerun").args(["rrd", "verify"]).arg(recorded()?))?;
        Ok(("passes".to_owned(), true))
    });
    sheet.row("7 documented entities", "rerun rrd stats recording.rrd", "all there", || {
        let ended = run(Command::new("rerun").args(["rrd", "stats"]).arg(recorded()?))?;
        let missing: Vec<&str> =
            DOCUMENTED.iter().copied().filter(|entity| !ended.stdout.contains(entity)).collect();
        let figure = if missing.is_empty() {
            format!("{} of {} entities", DOCUMENTED.len(), DOCUMENTED.len())
        } else {
            format!("missing: {}", missing.join(", "))
        };
        Ok((figure, missing.is_empty()))
    });
    let command = "rerun --headless recording.rrd --screenshot-to docs/pictures/colon-magnetic.png";
    sheet.row("7 headless screenshot", command, "written and looked at", || {
        let picture = root().join("docs/pictures/colon-magnetic.png");
        std::fs::remove_file(&picture).ok();
        run(Command::new("rerun")
            .args(["--headless", "--bind", "127.0.0.1", "--port", "9988"])
            .arg(recorded()?)
            .args(["--window-size", "1400x900", "--hide-welcome-screen", "--screenshot-to"])
            .arg(&picture)
            .env_remove("DISPLAY")
            // Its notes would stand in the picture.
            .env("RUST_LOG", "error")
            .env("RERUN_ANALYTICS", "0"))?;
        let bytes = std::fs::metadata(&picture).map_err(|e| format!("no picture: {e}"))?.len();
        // A window without content compresses to a few kilobytes.
        Ok((format!("{} kB", bytes / 1000), bytes > 60_000))
    });
}

/// Entities that a magnetic run in a tract promises (`lumenav::recording`); its readings are drawn as arrows at the sensors.
const DOCUMENTED: [&str; 10] = [
    "/world/tract/lumen",
    "/world/tract/centre_line",
    "/world/capsule/truth",
    "/world/sensors/belt",
    "/world/tracks/magnetic/path",
    "/world/tracks/magnetic-eskf/pose",
    "/plots/error/magnetic-eskf",
    "/plots/nees/magnetic-eskf",
    "/plots/along_tract",
    "/events",
];

/// Line 8, by evo on the exported files.
fn trajectories(sheet: &mut Sheet, out: &Path) {
    let exported = || -> Result<PathBuf, String> {
        let (folder, to) = (out.join("helix-evo"), out.join("helix-export"));
        if !to.exists() {
            metrics_of(&["run", HELIX, "--record", "none"], &folder)?;
            run(lumenav().arg("export").arg(&folder).args(["--format", "tum", "--out"]).arg(&to))?;
        }
        Ok(to)
    };
    let ours = |folder: &Path, absolute: bool| -> Result<f64, String> {
        let (truth, track) =
            (trajectory(&folder.join("truth.tum"))?, trajectory(&folder.join("magnetic-eskf.tum"))?);
        let pairs = associate(&truth, &track, 0.01).map_err(|e| e.to_string())?;
        let statistics = if absolute {
            absolute_pose_error(&pairs, Relation::TranslationPart)
        } else {
            let rule = PairRule::consecutive(Delta::Frames(20));
            relative_pose_error(&pairs, Relation::TranslationPart, &rule).and_then(|r| r.statistics())
        };
        statistics.map(|s| s.rmse).map_err(|e| e.to_string())
    };
    for (line, program, absolute, extra) in [
        ("8 ATE of exported files against evo", "evo_ape", true, &[][..]),
        (
            "8 RPE of exported files against evo",
            "evo_rpe",
            false,
            &["--delta", "20", "--delta_unit", "f", "--pairs_from_reference"][..],
        ),
    ] {
        let command = format!("{program} tum truth.tum magnetic-eskf.tum {}", extra.join(" "));
        sheet.row(line, command.trim(), "1e-6 relative", || {
            let folder = exported()?;
            let files = [text(&folder.join("truth.tum")), text(&folder.join("magnetic-eskf.tum"))];
            let saved = out.join(format!("{program}.zip"));
            std::fs::remove_file(&saved).ok();
            run(Command::new(program)
                .arg("tum")
                .args(files)
                .args(["--t_max_diff", "0.01", "--save_results"])
                .arg(&saved)
                .args(extra))?;
            let ended = run(Command::new("unzip").arg("-p").arg(&saved).arg("stats.json"))?;
            let stats: serde_json::Value = serde_json::from_str(&ended.stdout).map_err(|e| e.to_string())?;
            let theirs = stats["rmse"].as_f64().ok_or("evo gave no rmse")?;
            let ours = ours(&folder, absolute)?;
            let apart = (ours / theirs - 1.0).abs();
            Ok((format!("{:.6} mm against {:.6} mm: {apart:.1e}", 1e3 * ours, 1e3 * theirs), apart <= 1e-6))
        });
    }
    tested(sheet, "8 ATE and RPE in all of evo's settings", "evo", "");
    tested(sheet, "8 filter checks against closed forms and other programs", "it", "");
}

/// Lines 9 and 10.
fn faults_and_seam(sheet: &mut Sheet) {
    tested(sheet, "9 explain", "it", "law_explain");
    tested(sheet, "10 the four witnesses", "it", "seam::");
    tested(sheet, "10 filters start from data", "it", "truth_leak::");
    tested(sheet, "10 allowed arrows, and who may name the truth", "it", "architecture::");
    sheet.row(
        "1 both commands in a fresh clone",
        "git clone; cargo run --release …; .ci/run",
        "exit code 0",
        fresh_clone,
    );
}

/// The README's first command and what CI runs, in a clone of the last commit.
fn fresh_clone() -> Outcome {
    let scratch = tempfile::tempdir().map_err(|e| e.to_string())?;
    let clone = scratch.path().join("lumenav");
    run(Command::new("git").args(["clone", "--quiet"]).arg(root()).arg(&clone))?;
    let here = |program: &str| {
        let mut command = Command::new(program);
        command.current_dir(&clone).env_remove("LUMENAV_MODELS");
        command
    };
    let first = run(here("cargo").args(["run", "--release", "--quiet", "--", "-q", "run", COLON]))?;
    let second = run(here("bash").arg(".ci/run").env_remove("CARGO_TARGET_DIR"))?;
    let last = second.stdout.lines().rev().find(|line| line.starts_with("real-data tests")).unwrap_or("");
    Ok((format!("{:.0} s and {:.0} s; {last}", first.seconds, second.seconds), true))
}

/// Property tests with cases that no run has drawn before; the seed is in the command, and a failure is kept beside the test.
fn properties(sheet: &mut Sheet) {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    let seed = since.to_string();
    for (what, target, name) in [
        ("scenarios, models, recorded files", "it", "bad_input::law_"),
        ("tracts", "anatomy", "bad_files::law_"),
        ("arrays and capsules", "magnetic", "files::law_"),
        ("recorded fluxes", "magnetic", "reader::law_"),
    ] {
        let line = format!("bad input: property tests, freely drawn, {what}");
        let command =
            format!("PROPTEST_RNG_SEED={seed} cargo test --release --workspace --test {target} -- {name}");
        sheet.row(&line, &command, "passes", || test(target, name, &[("PROPTEST_RNG_SEED", &seed)]));
    }
}

/// Speeds; run them on a machine that does nothing else.
fn speed(sheet: &mut Sheet) {
    speed_row(sheet, "engine", "ten_seconds_of_colon/1", "engine, simulated s per s", 10.0, 500.0);
    speed_row(sheet, "solve", "warm_cylinder", "warm solves per s", 0.0, 30_000.0);
    speed_row(sheet, "fields", "cylinder_flux_batch/2", "cylinder field, evaluations per s", 0.0, 2.5e7);
    speed_row(sheet, "eskf", "predict_update_6_ranges", "eskf, 6 ranges, updates per s", 1.0, 2e5);
    speed_row(sheet, "eskf", "predict_update_48_flux", "eskf, 48 flux readings, updates per s", 1.0, 4e4);
}

/// A bench's median as a rate: `per_run` pieces per run, or the bench's own count of items where that is 0. The best of
/// three runs: neighbours on a shared machine only ever slow it down.
fn speed_row(sheet: &mut Sheet, target: &str, name: &str, what: &str, per_run: f64, at_least: f64) {
    let measure = || -> Outcome {
        let mut rates = Vec::new();
        for _ in 0..3 {
            let found = bench(target)?;
            let bench = found
                .iter()
                .find(|b| b.name.starts_with(name))
                .ok_or_else(|| format!("no bench `{name}`"))?;
            rates.push(if per_run > 0.0 {
                per_run / bench.median_s
            } else {
                bench.items_per_s.unwrap_or(0.0)
            });
        }
        rates.sort_by(f64::total_cmp);
        let best = rates.last().copied().unwrap_or(0.0);
        let all: Vec<String> = rates.iter().map(|rate| format!("{rate:.0}")).collect();
        Ok((format!("{best:.0} (medians of three runs: {})", all.join(", ")), best >= at_least))
    };
    let command = format!("cargo bench --workspace --bench {target}");
    sheet.row(&format!("speed: {what}"), &command, &format!(">= {at_least:.0}"), measure);
}
