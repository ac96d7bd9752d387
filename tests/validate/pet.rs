//! PET: the Shows lines and speeds of PET-marker tracking.

use crate::row::{Outcome, Sheet};
use crate::tools::{bench, lumenav, metrics_of, root, run, tested};
use lumenav::report::{Metrics, Trials, read_json, read_tracks};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;

const HELIX: &str = "scenarios/helix-pet.toml";
const MATCHED: &str = "scenarios/matched-pet.toml";
const BED: &str = "scenarios/colon-pet-bed.toml";
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
    bed(sheet, out);
    misuse(sheet);
    speed(sheet);
    ten_million_lines(sheet, out);
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
        // Without a line of its own nothing is asked of a table but that it can be made.
        let asked =
            if line == "-" { "its table can be made (it has no goal)" } else { "every goal of its table" };
        sheet.row(&format!("{line} {id}"), &command, asked, || reproduction(line, id, out));
    }
}

/// One reproduction: passed where all of its goals are met.
pub(crate) fn reproduction(line: &str, id: &str, out: &Path) -> Outcome {
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
            sheet.row(&line, &command, ask, || {
                let (figure, pass) = covered(&trials()?, track)?;
                Ok((format!("{figure}; {}", flips(&folder, track)?), pass))
            });
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

/// Errors beyond which a pose is another order of the markers, not noise: 3 mm and 40 degrees.
const FLIPPED: (f64, f64) = (3.0, 40.0);

/// How many estimates of a track are flips, counted and not removed.
fn flips(folder: &Path, track: &str) -> Result<String, String> {
    let (mut flips, mut all, mut trials) = (0_u64, 0_u64, 0_u64);
    for trial in std::fs::read_dir(folder.join("trials")).map_err(|e| e.to_string())? {
        let path = trial.map_err(|e| e.to_string())?.path().join("tracks.parquet");
        let rows = read_tracks(&path).map_err(|e| e.to_string())?;
        let errors = rows.iter().filter(|row| row.track.to_string() == track).filter_map(|row| {
            Some((row.number("error_mm")?, row.number("attitude_error_deg").unwrap_or(0.0)))
        });
        let before = flips;
        for (mm, degrees) in errors {
            all += 1;
            flips += u64::from(mm > FLIPPED.0 || degrees > FLIPPED.1);
        }
        trials += u64::from(flips > before);
    }
    Ok(format!("{flips} flips of {all} in {trials} trials"))
}

/// Line 5: the recordings of the University of Birmingham.
fn real_data(sheet: &mut Sheet, out: &Path) {
    let replay = "scenarios/replay/pept-2p-static.toml";
    let ask = "172.1 +- 0.3 mm, robust sd <= 0.8 mm, outlier windows <= 3 %, of each tracer as well";
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
        let rest = metrics.expected.rest.iter().filter_map(|rest| Some((&rest.track, rest.figures?)));
        let rest: Vec<String> = rest
            .map(|(track, r)| {
                format!("{track} {} of {} outliers, farthest {:.1} mm", r.outliers, r.instants, r.farthest_mm)
            })
            .collect();
        let figure = format!("{figure}; {}", rest.join("; "));
        // Seven windows hold hardly a line of the particles and the last is cut short (the replay's file says which).
        let answered = windows - pair.instants as u64 <= 8;
        let as_expected = metrics.expected.unmet().next().is_none() && metrics.expected.rest.len() == 2;
        Ok((figure, near && answered && as_expected && pair.robust_sd_mm <= 0.8 && outliers <= 0.03))
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
    let ask = "hybrid p95 <= 3 mm in every trial, maximum printed";
    sheet.row("7 half a minute out of the field of view", &command, ask, || {
        let trials = trials()?;
        let of = |track: &str| {
            let period = trials.tracks.get(track).and_then(|t| t.periods.get("out-of-view"));
            period.ok_or_else(|| format!("no period `out-of-view` of `{track}`"))
        };
        let (hybrid, pet) = (of("hybrid")?, of("pet")?);
        let (p95, worst) = (hybrid.p95_mm.as_ref().ok_or("no p95")?, hybrid.worst_p95_mm.ok_or("no p95")?);
        let figure = format!(
            "p95 {:.2} mm (95 % CI {:.2} to {:.2}, worst trial {worst:.2}), maximum {:.2} mm, {} trials; PET sees it for {:.1} % of the time",
            p95.mean,
            p95.lower,
            p95.upper,
            hybrid.worst_mm.unwrap_or(f64::NAN),
            hybrid.trials,
            pet.availability.map_or(f64::NAN, |a| 100.0 * a.mean),
        );
        Ok((figure, worst <= 3.0))
    });
}

/// Planning: the bed keeps the capsule in view, and without it the capsule is lost.
fn bed(sheet: &mut Sheet, out: &Path) {
    let ask = "out of reach of a scanner that stands: seen >= 97 % of the time, p95 <= 3 mm";
    sheet.row("- bed control", &format!("run {BED}, with and without its [[controller]]"), ask, || {
        let text = std::fs::read_to_string(root().join(BED)).map_err(|e| e.to_string())?;
        let standing = out.join("standing.toml");
        let (without, _) = text.split_once("\n[[controller]]").ok_or("no controller to leave out")?;
        std::fs::write(&standing, without).map_err(|e| e.to_string())?;
        let standing = standing.to_str().ok_or("no UTF-8 folder")?;
        let models = root().join("models");
        let models = models.to_str().ok_or("no UTF-8 folder")?;
        let moved = metrics_of(&["run", BED], &out.join("bed"))?;
        let stood = metrics_of(&["run", standing, "--models", models], &out.join("no-bed"))?;
        let of = |metrics: &Metrics| {
            let period = metrics.tracks.get("pet-eskf").and_then(|t| t.periods.get("beyond-the-blocks").cloned());
            let period = period.ok_or("no period `beyond-the-blocks`")?;
            let seen = period.availability.ok_or("no availability")?;
            Ok::<_, String>((seen, period.position_error_mm.ok_or("no error")?.p95))
        };
        let ((seen, p95), (before, _)) = (of(&moved)?, of(&stood)?);
        let travel = moved.controllers.get("bed").ok_or("no controller")?.travel_mm;
        let figure = format!(
            "seen {:.1} % of the half minute ({:.1} % without the bed), p95 {p95:.2} mm; the bed travels {travel:.0} mm",
            100.0 * seen,
            100.0 * before
        );
        Ok((figure, seen >= 0.97 && p95 <= 3.0))
    });
}

/// Lines 6 and 8.
fn misuse(sheet: &mut Sheet) {
    tested(sheet, "6 scalene, five markers, isosceles, a triangle that is off", "tracking", "shapes::");
    tested(sheet, "8 background alone, two lines, a thousand parallel ones", "tracking", "misuse::");
}

/// What `run --save-readings` writes for ten million lines: the full ring, 20 cm of water, the path of than2015 and then at rest.
const MANY_LINES: [&str; 10] = [
    "--set",
    "sensor.scanner.installed.scanner=allegro",
    "--set",
    "sensor.scanner.reality.mode=tabulated",
    "--set",
    "scenario.duration_s=230",
    "--save-readings",
    "--record",
    "none",
    "--force",
];

fn ten_million_lines(sheet: &mut Sheet, out: &Path) {
    let command = format!("run {HELIX} {}; replay", MANY_LINES.join(" "));
    sheet.row("speed: ten million lines through mixture", &command, "<= 10 s, constant memory", || {
        let folder = out.join("many");
        let scenario = out.join("many.toml");
        std::fs::write(&scenario, with_one_track()?).map_err(|e| e.to_string())?;
        let mut command = lumenav();
        command.args(["-q", "run"]).arg(&scenario).args(MANY_LINES).arg("--models").arg(root().join("models"));
        run(command.arg("--out").arg(&folder))?;
        let readings = folder.join("readings/scanner.csv");
        let replay = |lines: &Path, name: &str| {
            let file = out.join(format!("{name}.toml"));
            std::fs::write(&file, replay_of(lines)).map_err(|e| e.to_string())?;
            let mut command = lumenav();
            command.args(["-q", "replay", "--record", "none", "--force", "--models"]).arg(root().join("models"));
            run(command.arg(&file).arg("--out").arg(out.join(name)))
        };
        let text = std::fs::read_to_string(&readings).map_err(|e| e.to_string())?;
        let count = text.lines().count() as f64;
        // A quarter of it, to the end of a line: does memory grow with the rest? (A tenth has fewer windows than the track's writer gathers before
        // it writes, 1,024.)
        let quarter = text[..text.len() / 4].rfind('\n').map_or("", |end| &text[..=end]).to_owned();
        drop(text);
        let short = out.join("quarter.csv");
        std::fs::write(&short, quarter).map_err(|e| e.to_string())?;
        let (few, all) = (replay(&short, "few-lines")?, replay(&readings, "all-lines")?);
        let seconds = all.seconds * 1e7 / count;
        let (few_mb, all_mb) = (few.peak_mb.unwrap_or(f64::NAN), all.peak_mb.unwrap_or(f64::NAN));
        let figure = format!(
            "{:.2} million lines in {:.1} s: {seconds:.1} s for ten million; {all_mb:.0} MB, {few_mb:.0} MB for a quarter",
            1e-6 * count,
            all.seconds
        );
        Ok((figure, seconds <= 10.0 && all_mb <= 1.1 * few_mb))
    });
}

/// The helix with one track, and that with a filter: the others, and a bound for every estimate, would take longer than the lines.
fn with_one_track() -> Result<String, String> {
    let text = std::fs::read_to_string(root().join(HELIX)).map_err(|e| e.to_string())?;
    let head = text.split("[[track]]").next().unwrap_or_default();
    Ok(format!("{head}{}", MIXTURE_TRACK.replace("none", "eskf")))
}

const MIXTURE_TRACK: &str = "[[track]]\nname = \"mixture\"\nsensors = [\"scanner\"]\n[track.filter]\nkind = \"none\"\n\
     [track.sensor.scanner]\nfront_end = \"mixture\"\n";

fn replay_of(lines: &Path) -> String {
    format!(
        "[scenario]\nname = \"many-lines\"\n[capsule]\nmodel = \"pet-triangle\"\n[record]\ntruth_rate_hz = 1.0\n\
         [[sensor]]\nname = \"scanner\"\nmodality = \"pet\"\n\
         [sensor.installed]\nscanner = \"allegro\"\nphantom = \"water-20\"\n[sensor.files]\nlines = {:?}\n{MIXTURE_TRACK}",
        lines.display().to_string()
    )
}

fn speed(sheet: &mut Sheet) {
    for (target, name, what, at_most_s) in [
        ("track", "rigid", "rigid, 210 lines", 25e-6),
        ("track", "mixture", "mixture, 210 lines", 40e-6),
        (
            "track",
            "mixture_with_test",
            "mixture, 210 lines, with its search and test every tenth window",
            40e-6,
        ),
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
