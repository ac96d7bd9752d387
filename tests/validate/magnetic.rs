//! Magnetic sensing and layout design: the Shows lines and speeds.

use crate::pet::reproduction;
use crate::row::{Outcome, Sheet};
use crate::tools::{bench, lumenav, root, run, tested};
use lumenav::report::{Metrics, Trials, read_json};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;

const BELT: &str = "scenarios/layout/belt-helix.toml";
const TRIALS: &str = "50";

/// Measures all rows.
pub fn rows(sheet: &mut Sheet) {
    let scratch = match tempfile::tempdir() {
        Ok(folder) => folder,
        Err(error) => return eprintln!("no temporary folder: {error}"),
    };
    let out = scratch.path();
    claims(sheet, out);
    recorded(sheet, out);
    layouts(sheet, out);
    predicted(sheet, out);
    calibration(sheet, out);
    turning(sheet, out);
    speed(sheet, out);
    peer(sheet);
}

/// Line 1: the tables of moussakhani2012, and the fixtures.
fn claims(sheet: &mut Sheet, out: &Path) {
    for (line, id) in [
        ("1", "moussakhani2012/sensors"),
        ("-", "moussakhani2012/distance"),
        ("-", "moussakhani2012/rotation"),
        ("-", "moussakhani2012/planes"),
        ("-", "moussakhani2012/versus-rss"),
    ] {
        let command = format!("reproduce {id} --json");
        let ask = "each claim with a verdict; error over bound: norm 0.97 to 1.03, axes 0.96 to 1.04; 2,000 of 2,000 poses found";
        sheet.row(&format!("{line} {id}"), &command, ask, || reproduction(line, id, out));
    }
    tested(sheet, "1 fixtures", "bound", "cross_every_number_of_the_independent_study");
}

/// Line 2: the recorded series.
fn recorded(sheet: &mut Sheet, out: &Path) {
    const PATCH: &str = "scenarios/replay/magnet-patch.toml";
    let command = format!("replay {PATCH}, each series by itself");
    for (name, track, at_most) in [
        ("2 recorded series, cylinder", "cylinder", 0.10),
        ("2 recorded series, strength and field unknown", "cylinder-unknown", 0.12),
    ] {
        sheet.row(
            name,
            &command,
            &format!("mean <= {at_most:.2} mm in each of three series, every reading; NEES reported"),
            || {
                if std::env::var_os("LUMENAV_DATA").is_none() {
                    return Err("LUMENAV_DATA is not set".to_owned());
                }
                let (mut said, mut worst, mut all_refused) = (Vec::new(), 0.0_f64, 0);
                for series in ["series1", "series2", "series3"] {
                    let folder = out.join("patch");
                    let only = one_series(PATCH, track, series, &out.join(format!("{series}.toml")))?;
                    run(lumenav()
                        .args(["-q", "replay"])
                        .arg(only)
                        .args(["--force", "--models", "models", "--out"])
                        .arg(&folder))?;
                    let metrics: Metrics =
                        read_json(&folder.join("metrics.json")).map_err(|e| e.to_string())?;
                    let track = metrics.tracks.get(track).ok_or("no such track")?;
                    let mean = track.position_error_mm.as_ref().ok_or("no error")?.mean;
                    let nees = track.nees.as_ref().map_or(f64::NAN, |n| n.mean / n.dof as f64);
                    said.push(format!("{mean:.4} mm (NEES/dof {nees:.2})"));
                    worst = worst.max(mean);
                    all_refused += track.refused.values().sum::<u64>();
                }
                let figure = format!("{}; {all_refused} readings refused", said.join(", "));
                Ok((figure, worst <= at_most && all_refused == 0))
            },
        );
    }
}

/// The replay of one track on one series alone, as a file.
fn one_series(scenario: &str, track: &str, series: &str, to: &Path) -> Result<PathBuf, String> {
    let text = std::fs::read_to_string(scenario).map_err(|e| e.to_string())?;
    let mut file: toml::Table = text.parse().map_err(|e: toml::de::Error| e.to_string())?;
    let keep = |file: &mut toml::Table, list: &str, name: &str| {
        if let Some(toml::Value::Array(all)) = file.get_mut(list) {
            all.retain(|entry| entry.get("name").and_then(toml::Value::as_str) == Some(name));
        }
    };
    keep(&mut file, "sensor", series);
    keep(&mut file, "track", track);
    for table in file.get_mut("track").and_then(toml::Value::as_array_mut).into_iter().flatten() {
        if let Some(table) = table.as_table_mut() {
            table.insert("sensors".to_owned(), vec![series].into());
            if let Some(toml::Value::Table(of)) = table.get_mut("sensor") {
                of.retain(|name, _| name == series);
            }
        }
    }
    std::fs::write(to, file.to_string()).map_err(|e| e.to_string())?;
    Ok(to.to_owned())
}

/// Root mean square of the posterior bound from so many seconds on, mm: what a filter that knows a perfect array can reach at best.
fn posterior_from(
    scenario: &str,
    set: &[&str],
    seed: &str,
    from_s: f64,
    folder: &Path,
) -> Result<f64, String> {
    let mut command = lumenav();
    command.args(["-q", "layout", "evaluate", scenario, "--force", "--out"]).arg(folder);
    command.arg("--set").arg(format!("scenario.seed={seed}"));
    command.args(set.iter().flat_map(|set| ["--set", set]));
    run(&mut command)?;
    let text = std::fs::read_to_string(folder.join("posterior.csv")).map_err(|e| e.to_string())?;
    let rows = text.lines().skip(1).filter_map(|line| {
        let mut cells = line.split(',');
        let (t_s, with_a_filter) = (cells.next()?, cells.nth(1)?);
        Some((t_s.parse::<f64>().ok()?, with_a_filter.parse::<f64>().ok()?))
    });
    let (count, sum) =
        rows.filter(|(t, _)| *t >= from_s).fold((0.0, 0.0), |(n, sum), (_, mm)| (n + 1.0, sum + mm * mm));
    if count == 0.0 { Err("no posterior bound".to_owned()) } else { Ok(f64::sqrt(sum / count)) }
}

/// Seeds that nothing was tuned on.
const SEEDS: [&str; 5] = ["1", "2", "3", "4", "5"];

/// Figures of one stretch of one track in one run.
fn period(scenario: &str, set: &[&str], seed: &str, folder: &Path) -> Result<Metrics, String> {
    let mut command = lumenav();
    command.args(["-q", "run", scenario, "--record", "none", "--force", "--seed", seed, "--out"]).arg(folder);
    command.args(set.iter().flat_map(|set| ["--set", set]));
    run(&mut command)?;
    read_json(&folder.join("metrics.json")).map_err(|e| e.to_string())
}

fn mean_in(metrics: &Metrics, track: &str, name: &str) -> Result<(f64, f64), String> {
    let period = metrics.tracks.get(track).and_then(|t| t.periods.get(name));
    let period = period.ok_or_else(|| format!("no period `{name}` of `{track}`"))?;
    let error = period.position_error_mm.as_ref().map_or(f64::NAN, |e| e.mean);
    Ok((error, period.availability.unwrap_or(0.0)))
}

/// Root mean square error, mm.
fn rmse_in(metrics: &Metrics, track: &str, name: &str) -> Result<f64, String> {
    let period = metrics.tracks.get(track).and_then(|t| t.periods.get(name));
    let error = period.and_then(|p| p.position_error_mm.as_ref());
    error.map(|e| e.rmse).ok_or_else(|| format!("no error in `{name}` of `{track}`"))
}

/// Mean and largest.
fn mean_and_worst(values: &[f64]) -> (f64, f64) {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    (mean, values.iter().copied().fold(f64::NEG_INFINITY, f64::max))
}

/// Line 5: an uncalibrated array, before and after a minute, over the same seconds with a perfect array.
fn calibration(sheet: &mut Sheet, out: &Path) {
    const SCENARIO: &str = "scenarios/self-calibration.toml";
    const PERFECT: [&str; 3] = [
        "sensor.belt.reality.gain_sigma=0",
        "sensor.belt.reality.axis_sigma_deg=0",
        "track.nominal.sensor.belt.relative_error=0",
    ];
    let command = format!("run {SCENARIO}, seeds 1 to 5; the same with a perfect array, known as such");
    let ask = "after 60 s rmse within 1.3 of the posterior bound with noise alone, each seed; before and after printed";
    sheet.row("5 self-calibration", &command, ask, || {
        let (mut ratios, mut before, mut after, mut alone, mut paired) = (vec![], vec![], vec![], vec![], vec![]);
        for seed in SEEDS {
            let flawed = period(SCENARIO, &[], seed, &out.join("flawed"))?;
            let perfect = period(SCENARIO, &PERFECT, seed, &out.join("perfect"))?;
            let bound = posterior_from(SCENARIO, &[], seed, 60.0, &out.join("bound"))?;
            let calibrated = rmse_in(&flawed, "calibrating", "calibrated")?;
            before.push(rmse_in(&flawed, "nominal", "calibrated")?);
            after.push(calibrated);
            alone.push(bound);
            ratios.push(calibrated / bound);
            paired.push(calibrated / rmse_in(&perfect, "nominal", "calibrated")?);
        }
        let (mean, worst) = mean_and_worst(&ratios);
        let figure = format!(
            "rmse of 60 to 120 s: as installed {:.3} mm, calibrated {:.3} mm, bound with noise alone {:.3} mm; over the bound mean {mean:.3}, worst {worst:.3}; over the same filter that knows a perfect array mean {:.3}, worst {:.3}",
            mean_and_worst(&before).0,
            mean_and_worst(&after).0,
            mean_and_worst(&alone).0,
            mean_and_worst(&paired).0,
            mean_and_worst(&paired).1,
        );
        Ok((figure, worst <= 1.3))
    });
}

/// Line 6: the patient turns under the Earth's field.
fn turning(sheet: &mut Sheet, out: &Path) {
    const SCENARIO: &str = "scenarios/turning-patient.toml";
    let command = format!("run {SCENARIO}, seeds 1 to 5; the same without the turn");
    let ask = "lost without cancellation from the turn on; with each of the three within 2 of the quiet case, each seed";
    sheet.row("6 turning patient", &command, ask, || {
        let mut ratios = vec![];
        let mut seen: f64 = 0.0;
        let mut available: f64 = 1.0;
        for seed in SEEDS {
            let quiet = period(SCENARIO, &["sensor.belt.reality.earth_tesla=[0,0,0]"], seed, &out.join("quiet"))?;
            let turned = period(SCENARIO, &[], seed, &out.join("turned"))?;
            for stretch in ["turning", "turned"] {
                let reference = mean_in(&quiet, "none", stretch)?.0;
                seen = seen.max(mean_in(&turned, "none", stretch)?.1);
                for track in ["reference", "differences", "estimated"] {
                    let (error, fresh) = mean_in(&turned, track, stretch)?;
                    ratios.push(error / reference);
                    available = available.min(fresh);
                }
            }
        }
        let (mean, worst) = mean_and_worst(&ratios);
        let figure = format!(
            "without cancellation seen {:.1} % of the time at most; with it {:.1} % at least, error over that of the quiet case mean {mean:.3}, worst {worst:.3}",
            100.0 * seen,
            100.0 * available
        );
        Ok((figure, seen < 0.15 && available > 0.99 && worst <= 2.0))
    });
}

fn optimized(study: &str, set: &[&str], folder: &Path) -> Result<Value, String> {
    let mut command = lumenav();
    command.args(["-q", "layout", "optimize", study, "--json", "--force", "--out"]).arg(folder);
    command.args(set.iter().flat_map(|set| ["--set", set]));
    serde_json::from_str(&run(&mut command)?.stdout).map_err(|e| e.to_string())
}

fn number(value: &Value, key: &str) -> Result<f64, String> {
    value[key].as_f64().ok_or_else(|| format!("no number `{key}`"))
}

/// Line 3: what the optimizer finds.
fn layouts(sheet: &mut Sheet, out: &Path) {
    const RMS: &str = "layout.optimize.criterion=\"rms\"";
    const WORST: &str = "layout.optimize.criterion=\"worst\"";
    for (name, study, set, at_most) in [
        ("two planes, rms", "two-planes", RMS, 1.085),
        ("two planes, worst", "two-planes", WORST, 2.40),
        ("one plane, rms", "one-plane", RMS, 8.811 * 1.005),
        ("cylinder, candidates, rms", "cylinder", RMS, 0.676),
    ] {
        let study = format!("scenarios/layout/{study}.toml");
        let command = format!("layout optimize {study} --set {set}");
        sheet.row(&format!("3 {name}"), &command, &format!("<= {at_most:.3} mm"), || {
            let found = optimized(&study, &[set], &out.join(name))?;
            let (value, before) = (number(&found, "found")?, number(&found, "installed")?);
            let bound =
                found["lower_bound"].as_f64().map_or(String::new(), |b| format!(", lower bound {b:.4} mm"));
            Ok((format!("{value:.4} mm, as installed {before:.4} mm{bound}"), value <= at_most))
        });
    }
    let study = "scenarios/torso-belt-study.toml";
    let ask = "better than the regular belt, with the relaxation's gap";
    sheet.row("3 torso, 30 mm clearance", &format!("layout optimize {study}"), ask, || {
        let found = optimized(study, &[], &out.join("torso"))?;
        let (value, before) = (number(&found, "found")?, number(&found, "installed")?);
        let bound = number(&found, "lower_bound")?;
        let gained = 100.0 * (1.0 - value / before);
        let left = 100.0 * (1.0 - bound / value);
        let figure = format!(
            "{value:.4} mm, the belt {before:.4} mm: {gained:.1} % better; no choice below {bound:.4} mm: at most {left:.1} % left"
        );
        Ok((figure, value < before && bound <= value))
    });
}

/// Line 4: the ratio of errors that the bound predicts, and the one that trackers have.
fn predicted(sheet: &mut Sheet, out: &Path) {
    let ask = "predicted ratio of errors within 10 % of the measured one, 50 paired trials";
    let command =
        format!("layout optimize {BELT}; run {BELT} --trials {TRIALS}, belt-16 and the found array");
    sheet.row("4 predicted against measured", &command, ask, || ratio(out));
}

fn ratio(out: &Path) -> Outcome {
    let folder = out.join("belt-helix");
    let found = optimized(BELT, &[], &folder)?;
    let predicted = number(&found["after"], "rms_mm")? / number(&found["before"], "rms_mm")?;
    let rmse = |array: Option<&Path>, name: &str| -> Result<(f64, u64), String> {
        let trials = out.join(name);
        let mut command = lumenav();
        command.args(["-q", "run", BELT, "--trials", TRIALS, "--force", "--out"]).arg(&trials);
        if let Some(array) = array {
            command.arg("--set").arg(format!("sensor.belt.installed.array={}", array.display()));
        }
        run(&mut command)?;
        let trials: Trials = read_json(&trials.join("trials.json")).map_err(|e| e.to_string())?;
        let track = trials.tracks.get("magnetic").ok_or("no track `magnetic`")?;
        Ok((track.rmse_mm.ok_or("no error")?.mean, trials.failed))
    };
    let (by_hand, failed) = rmse(None, "by-hand")?;
    let (optimized, also_failed) = rmse(Some(&folder.join("array.toml")), "found")?;
    let measured = optimized / by_hand;
    let figure = format!(
        "predicted {predicted:.4}, measured {measured:.4} (rmse {optimized:.4} against {by_hand:.4} mm): {:.1} % apart; {} trials failed",
        100.0 * (predicted / measured - 1.0).abs(),
        failed + also_failed
    );
    Ok((figure, (predicted / measured - 1.0).abs() <= 0.10 && failed + also_failed == 0))
}

/// Speeds: whole commands, reading and writing included.
fn speed(sheet: &mut Sheet, out: &Path) {
    let set = [
        "sensor.planes.installed.array=cube",
        "layout.dead=0",
        "layout.workspace.x_mm={ from = -200, to = 200, count = 26 }",
        "layout.workspace.y_mm={ from = -200, to = 200, count = 25 }",
        "layout.workspace.z_mm={ from = 100, to = 400, count = 22 }",
    ];
    let study = "scenarios/layout/two-planes.toml";
    sheet.row(
        "speed: evaluate, 64 sensors x 100,100 poses",
        &format!("layout evaluate {study} (cube, 26 x 25 x 22 x 7)"),
        "<= 1 s",
        || {
            let mut command = lumenav();
            command.args(["-q", "layout", "evaluate", study, "--out"]).arg(out.join("big"));
            command.args(set.iter().flat_map(|set| ["--set", set]));
            let seconds = run(&mut command)?.seconds;
            Ok((format!("{seconds:.2} s with its map of 100,100 rows"), seconds <= 1.0))
        },
    );
    let study = "scenarios/layout/planes-candidates.toml";
    sheet.row("speed: optimize, 16 of 9 x 9 x 2", &format!("layout optimize {study}"), "<= 10 s", || {
        let mut command = lumenav();
        command.args(["-q", "layout", "optimize", study, "--out"]).arg(out.join("candidates"));
        let seconds = run(&mut command)?.seconds;
        Ok((format!("{seconds:.2} s, eight starts and the lower bound"), seconds <= 10.0))
    });
}

/// The same solves with magpylib's field and SciPy's least squares, in the same run (Python with both; see the script).
fn peer(sheet: &mut Sheet) {
    let command = "cargo bench --workspace --bench solve; python3 tests/cross/magnetic_bench.py";
    sheet.row("speed: solve beside magpylib and SciPy", command, "ratio printed, above 1", || {
        let found = bench("solve")?;
        let of = |name: &str| {
            let found = found.iter().find(|b| b.name.starts_with(name));
            let rate = found.and_then(|b| b.items_per_s).ok_or_else(|| format!("no bench `{name}`"))?;
            Ok::<_, String>(1e6 / rate)
        };
        let (dipole, cylinder) = (of("warm_dipole")?, of("warm_cylinder")?);
        let script = root().join("tests/cross/magnetic_bench.py");
        let said = run(Command::new("python3").arg(script).env("OMP_NUM_THREADS", "1"))?.stdout;
        let per_solve = said.split(": ").nth(1).and_then(|rest| rest.split(' ').next());
        let theirs: f64 = per_solve
            .and_then(|us| us.parse().ok())
            .ok_or_else(|| format!("the script said: {said}"))?;
        let ratio = theirs / dipole;
        let figure = format!(
            "warm dipole solve {dipole:.1} us, theirs {theirs:.0} us: {ratio:.0} times; warm cylinder {cylinder:.1} us"
        );
        Ok((figure, ratio > 1.0))
    });
}
