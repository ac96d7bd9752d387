//! PET: the Shows lines and speeds of PET-marker tracking.

use crate::row::{Outcome, Sheet};
use crate::tools::{bench, lumenav, metrics_of, run, tested};
use lumenav::report::{Trials, read_json};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;

const MATCHED: &str = "scenarios/matched-pet.toml";
const HYBRID: &str = "scenarios/colon-pet-magnetic.toml";

/// Measures all rows.
pub fn rows(sheet: &mut Sheet) {
    let scratch = match tempfile::tempdir() {
        Ok(folder) => folder,
        Err(error) => return eprintln!("no temporary folder: {error}"),
    };
    let out = scratch.path();
    published(sheet, out);
    consistency(sheet, out);
    real_data(sheet, out);
    fusion(sheet, out);
    misuse(sheet);
    speed(sheet);
}

/// What `reproduce --json` writes, as far as it is looked at here.
#[derive(Deserialize)]
struct Reproduced {
    rows: Vec<Published>,
}

#[derive(Deserialize)]
struct Published {
    quantity: String,
    verdict: String,
    ours: BTreeMap<String, Option<f64>>,
    #[serde(default)]
    goal: Option<Goal>,
}

#[derive(Deserialize)]
struct Goal {
    of: String,
    at_most: f64,
    met: bool,
}

/// Lines 1 to 3: one row per reproduction, passed where all of its goals are met.
fn published(sheet: &mut Sheet, out: &Path) {
    for (line, id) in [
        ("1", "than2015/rates"),
        ("2", "than2015/few-lines"),
        ("3", "than2015/jump"),
        ("3", "than2015/torso"),
        ("3", "than2015/experiment-tf64"),
        ("3", "than2015/experiment-allegro"),
        ("-", "than2015/static-cylinder"),
        ("-", "than2015/speed-and-size"),
        ("-", "than2015/window-and-activity"),
        ("-", "than2015/point-registration"),
        ("-", "than2015/dose"),
    ] {
        let command = format!("reproduce {id} --json");
        sheet.row(&format!("{line} {id}"), &command, "every goal of its table", || {
            reproduction(line, id, out)
        });
    }
}

fn reproduction(line: &str, id: &str, out: &Path) -> Outcome {
    let ended = run(lumenav().args(["-q", "reproduce", id, "--json", "--out"]).arg(out.join("reproduce")))?;
    let table: Reproduced = serde_json::from_str(&ended.stdout).map_err(|e| format!("{id}: {e}"))?;
    let mut verdicts = BTreeMap::new();
    table.rows.iter().for_each(|row| *verdicts.entry(row.verdict.as_str()).or_insert(0) += 1);
    let goals: Vec<(&Published, &Goal)> =
        table.rows.iter().filter_map(|r| Some((r, r.goal.as_ref()?))).collect();
    let missed: Vec<String> = goals
        .iter()
        .filter(|(_, goal)| !goal.met)
        .map(|(row, goal)| {
            let value = row.ours.get(&goal.of).copied().flatten().unwrap_or(f64::NAN);
            format!("{}: {value:.3} (at most {:.3})", row.quantity, goal.at_most)
        })
        .collect();
    let tally: Vec<String> = verdicts.iter().map(|(verdict, n)| format!("{n} {verdict}")).collect();
    if goals.is_empty() && line != "-" {
        return Err(format!("{id}: no row of the table has a goal"));
    }
    let mut figure =
        format!("{}; {} of {} goals met", tally.join(", "), goals.len() - missed.len(), goals.len());
    if !missed.is_empty() {
        figure = format!("{figure}; missed: {}", missed.join("; "));
    }
    Ok((figure, missed.is_empty()))
}

/// Line 4: truth drawn from the filter's own motion model, lines from the simulator; lines in the filter, and the tracker alone.
fn consistency(sheet: &mut Sheet, out: &Path) {
    for (lines, overrides) in
        [("284", &[][..]), ("80", &["--set", "sensor.scanner.installed.phantom=water-35"][..])]
    {
        let folder = out.join(format!("matched-{lines}"));
        let trials = || -> Result<Trials, String> {
            if !folder.exists() {
                let mut command = lumenav();
                command.args(["-q", "run", MATCHED, "--trials", "200", "--force"]).args(overrides);
                run(command.arg("--out").arg(&folder))?;
            }
            read_json(&folder.join("trials.json")).map_err(|e| e.to_string())
        };
        let command = format!("run {MATCHED} --trials 200 {}", overrides.join(" "));
        let ask = "mean NEES/dof 0.85 to 1.25 at >= 90 % of the windows, 90 % region covers 85 to 95 %";
        for (track, what) in [("lines", "with motion prior"), ("mixture", "alone")] {
            let line = format!("4 covariance {what}, 200 seeds, {lines} lines");
            sheet.row(&line, &command, ask, || covered(&trials()?, track));
        }
    }
}

fn covered(trials: &Trials, track: &str) -> Outcome {
    let track = trials.tracks.get(track).ok_or_else(|| format!("no track `{track}`"))?;
    let nees = track.nees.as_ref().ok_or("no NEES")?;
    let (share, coverage) = (nees.share_within_085_125, nees.across.coverage_90);
    let figure = format!(
        "{:.1} % of {} steps within 0.85 to 1.25, mean {:.3}, coverage {:.1} %, worst error {:.2} mm, available {:.1} %, {} trials failed",
        100.0 * share,
        nees.across.steps,
        nees.across.mean_per_dof,
        100.0 * coverage,
        track.worst_mm.unwrap_or(f64::NAN),
        track.availability.map_or(f64::NAN, |a| 100.0 * a.mean),
        trials.failed
    );
    Ok((figure, share >= 0.9 && (0.85..=0.95).contains(&coverage)))
}

/// Line 5: the recordings of the University of Birmingham.
fn real_data(sheet: &mut Sheet, out: &Path) {
    let replay = "scenarios/replay/pept-2p-static.toml";
    let ask = "172.1 +- 0.3 mm, robust sd <= 0.8 mm, outlier windows <= 3 %";
    sheet.row("5 two resting tracers", &format!("replay {replay}"), ask, || {
        let metrics = metrics_of(&["replay", replay], &out.join("pept-2p"))?;
        let pair = metrics.expected.distance.first().and_then(|pair| pair.figures).ok_or("no distance")?;
        let windows: u64 = metrics.sensors.values().map(|sensor| sensor.readings).sum();
        let outliers = pair.outliers as f64 / pair.instants as f64;
        let figure = format!(
            "{:.2} mm, median {:.2}, robust sd {:.2} mm, {} of {} windows outliers; {windows} windows given",
            pair.mean_without_outliers_mm, pair.median_mm, pair.robust_sd_mm, pair.outliers, pair.instants
        );
        let near = (pair.mean_without_outliers_mm - 172.1).abs() <= 0.3;
        // Seven windows hold no line of the particles, or are cut short (the replay's file says which).
        let answered = windows - pair.instants as u64 <= 7;
        Ok((figure, near && answered && pair.robust_sd_mm <= 0.8 && outliers <= 0.03))
    });
    let replay = "scenarios/replay/pept-1p-fluidised.toml";
    sheet.row(
        "5 a tracer in a fluidised bed",
        &format!("replay {replay}"),
        "<= 2 m/s in >= 98 % of the steps",
        || {
            let metrics = metrics_of(&["replay", replay], &out.join("pept-1p"))?;
            let speed = metrics.expected.speed.get("particle").ok_or("no speeds")?;
            let fast: Vec<String> = speed
                .beyond
                .iter()
                .map(|step| format!("{:.3} s: {:.1} m/s", step.to_s, step.speed_m_s))
                .collect();
            let listed = if fast.is_empty() {
                "none faster".to_owned()
            } else {
                format!("faster: {}", fast.join(", "))
            };
            let figure = format!("{:.1} % of {} steps; {listed}", 100.0 * speed.share_within, speed.steps);
            Ok((figure, speed.share_within >= 0.98))
        },
    );
}

/// Line 7: does fusion pay?
fn fusion(sheet: &mut Sheet, out: &Path) {
    let folder = out.join("hybrid");
    let trials = || -> Result<Trials, String> {
        if !folder.exists() {
            run(lumenav().args(["-q", "run", HYBRID, "--trials", "50", "--force", "--out"]).arg(&folder))?;
        }
        read_json(&folder.join("trials.json")).map_err(|e| e.to_string())
    };
    let command = format!("run {HYBRID} --trials 50");
    for single in ["pet", "magnetic"] {
        let line = format!("7 hybrid against {single}, 50 paired trials");
        sheet.row(&line, &command, "interval above 0", || {
            let trials = trials()?;
            let pair = trials
                .comparisons
                .iter()
                .find(|c| {
                    let names = [c.comparison.first.as_str(), c.comparison.second.as_str()];
                    names.contains(&"hybrid") && names.contains(&single)
                })
                .ok_or("no comparison")?;
            let gain = &pair.comparison.advantage_of_first;
            let better = if pair.comparison.first == "hybrid" { gain.lower > 0.0 } else { gain.upper < 0.0 };
            Ok((pair.sentence.clone(), better && pair.comparison.is_decided()))
        });
    }
    sheet.row(
        "7 half a minute out of the field of view",
        &format!("run {HYBRID}"),
        "hybrid p95 <= 3 mm",
        || {
            let metrics = metrics_of(&["run", HYBRID, "--record", "none"], &out.join("hybrid-one"))?;
            let error = metrics.tracks["hybrid"].position_error_mm.ok_or("no error")?;
            Ok((format!("p95 {:.2} mm, maximum {:.2} mm", error.p95, error.max), error.p95 <= 3.0))
        },
    );
}

/// Lines 6 and 8.
fn misuse(sheet: &mut Sheet) {
    tested(sheet, "6 scalene, five markers, isosceles, a triangle that is off", "tracking", "shapes::");
    tested(sheet, "8 background alone, two lines, a thousand parallel ones", "tracking", "misuse::");
}

fn speed(sheet: &mut Sheet) {
    for (target, name, what, at_most_s) in [
        ("track", "rigid", "rigid, 210 lines", 25e-6),
        ("track", "mixture", "mixture, 210 lines", 40e-6),
        ("track", "initialize", "global initialization, 210 lines", 2e-3),
        ("simulate", "forced/reduced", "forced, 50 ms of the reduced scanner", 15e-3),
        ("simulate", "tabulated/reduced", "tabulated, 50 ms of the reduced scanner", 1e-3),
    ] {
        let command = format!("cargo bench --workspace --bench {target}");
        sheet.row(&format!("speed: {what}"), &command, &format!("<= {at_most_s:e} s"), || {
            let found = bench(target)?;
            let bench = found
                .iter()
                .find(|b| b.name.starts_with(name))
                .ok_or_else(|| format!("no bench `{name}`"))?;
            Ok((format!("median {:.3e} s", bench.median_s), bench.median_s <= at_most_s))
        });
    }
}
