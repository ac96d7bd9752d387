//! A living gut: the Shows lines that there are so far.

#[path = "../../crates/anatomy/examples/import_people/people.rs"]
mod people;

use crate::gut_speed;
use crate::row::{Outcome, Sheet};
use crate::tools::{lumenav, root, run};
use lumenav::anatomy::CentreLine;
use lumenav::anatomy::generator::{BodySize, WholeGutRequest, whole_gut};
use lumenav::anatomy::import::{ImportOptions, import_surface};
use lumenav::anatomy::motility::Motility;
use lumenav::anatomy::motility::fault::{FaultConfig, FaultKind};
use lumenav::anatomy::motility::meal::MealConfig;
use lumenav::anatomy::motility_config::MotilityConfig;
use lumenav::anatomy::tract::Tract;
use lumenav::anatomy::tract_file::{self, TractOptions};
use lumenav::core::config::quantity::{Finite, Fraction, NonNegative};
use lumenav::core::{CapsuleBody, Node, RandomStreams, SimTime};
use lumenav::scenario::engine::{Engine, EngineConfig, FuzzReport, fuzz_inside_lumen};
use nalgebra::{UnitQuaternion, Vector3};
use people::{Imported, PEOPLE};
use rand::Rng as _;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// Fuzzed runs of half an hour, over the shipped guts in turn.
const FUZZED: u64 = 200;
const FUZZED_S: f64 = 1800.0;
/// Runs that are compared bit by bit.
const COMPARED: u64 = 12;
/// The capsule of all rows: a PillCam.
const CAPSULE: CapsuleBody = CapsuleBody { radius_m: 0.0055, length_m: 0.026, mass_kg: 0.0033 };
/// Seeds of generated guts, sizes in turn.
const GENERATED: u64 = 1000;

/// Mean distance of an imported line from the one given, mm, and error of a segment's length, at most.
const AWAY_MM: f64 = 3.0;
const LENGTH_ERROR: f64 = 0.05;

/// What of a reproduction's table is read here.
#[derive(Deserialize)]
struct Table {
    rows: Vec<Row>,
}

#[derive(Deserialize)]
struct Row {
    quantity: String,
    unit: String,
    published: Option<f64>,
    ours: BTreeMap<String, Option<f64>>,
    verdict: String,
}

/// Measures all rows.
pub fn rows(sheet: &mut Sheet) {
    let scratch = match tempfile::tempdir() {
        Ok(folder) => folder,
        Err(error) => return eprintln!("no temporary folder: {error}"),
    };
    for (line, ask) in [
        ("transit", "every row with a published number within the tolerance that the issue states"),
        ("colon", "median of 20 persons from 16 to 29 h, at most 2 % do not pass"),
        ("exam", "10 exams from the swallow to the way out"),
        ("speeds", "the fastest 5 % of the time make more than half of the way"),
        ("traction", "58 to 91 mN per contraction: each phase within 25 % of its own"),
        ("gastric", "3.1 contractions per minute, about 11 mm each"),
    ] {
        let id = format!("gut/{line}");
        let command = format!("reproduce {id} --json");
        sheet.row(&format!("1 {id}"), &command, ask, || reproduction(&id, scratch.path()));
    }
    gut_speed::rows(sheet, scratch.path());
    sheet.row(
        "2 import",
        "in this program: import_surface of LUMENAV_DATA/tracts, Edin unaided, Visible Human small unaided, large with nine waypoints",
        "every segment's length within 5 % and the line within 3 mm mean of the one given",
        imports,
    );
    sheet.row(
        "3 fuzzed runs",
        "in this program: 200 runs of 30 min spread over the shipped guts, each with rates, speeds, amplitudes, posture, meals and faults of its own",
        "inside the lumen (3 mm), all finite, no stall that is not an event",
        fuzzed,
    );
    sheet.row(
        "3 same bytes",
        "in this program: 12 runs of 30 min on one thread, on two, and across a checkpoint after ten minutes",
        "the last state is the same, bit by bit",
        same_bytes,
    );
    sheet.row(
        "4 generated tracts",
        "in this program: whole guts of seeds 1000 to 1999, three sizes in turn",
        "no overlap over 1,000 seeds, or the seed refused with the reason",
        generated,
    );
}

/// What `of` makes of the numbers below `count`, on two threads.
fn on_two_threads<T: Send>(
    count: u64,
    of: impl Fn(u64) -> Result<T, String> + Sync,
) -> Result<Vec<T>, String> {
    let half = |first: u64| (first..count).step_by(2).map(&of).collect::<Result<Vec<T>, String>>();
    let (even, odd) = std::thread::scope(|scope| {
        let other = scope.spawn(|| half(1));
        (half(0), other.join())
    });
    let mut all = even?;
    all.extend(odd.map_err(|_| "a thread stopped".to_owned())??);
    Ok(all)
}

fn shipped(size: BodySize) -> Result<Arc<Tract>, String> {
    let path = root().join(format!("models/tracts/whole-gut-{}.toml", size.as_str()));
    let all = TractOptions { segments: Vec::new(), length_scale: 1.0, radius_scale: 1.0 };
    let node = Node::open(&path).map_err(|e| e.to_string())?;
    Ok(Arc::new(tract_file::load(&node, &all).map_err(|e| e.to_string())?.0))
}

/// A number in [0, 1) for a seed and a use of it.
fn drawn(seed: u64, which: u64) -> f64 {
    (RandomStreams::new(seed, which, "fuzz").stream("number", 0).next_u64() >> 11) as f64
        / (1_u64 << 53) as f64
}

/// Motility of a seed: rates, amplitudes, speeds and widths around the usual; every third fed, every fourth with a fault, phases of the motor
/// complex as they come; mass movements every few minutes in every second.
fn fuzzy(seed: u64) -> MotilityConfig {
    let mut config = MotilityConfig::default();
    let about = |which: u64, low: f64, high: f64| low + (high - low) * drawn(seed, which);
    let [rate, speed, amplitude] = [about(1, 0.5, 1.5), about(2, 0.5, 2.0), about(3, 0.5, 1.3)];
    macro_rules! scale {
        ($($table:ident),*) => {$(
            for value in &mut config.$table.rate_hz {
                value.0 *= rate;
            }
            config.$table.speed_m_s.0 *= speed;
            for value in &mut config.$table.amplitude {
                value.0 = (value.0 * amplitude).min(0.95);
            }
        )*};
    }
    scale!(stomach, duodenum, jejunum, ileum, terminal_ileum);
    config.colon.haustral_amplitude.0 = about(4, 0.0, 0.8);
    config.colon.burst_fraction.0 = about(5, 0.1, 1.0);
    if seed.is_multiple_of(2) {
        config.colon.mass_rate_per_day.0 = about(6, 100.0, 1000.0);
    }
    if seed.is_multiple_of(3) {
        config
            .meal
            .push(MealConfig { start_s: NonNegative(about(7, 0.0, FUZZED_S)), ..MealConfig::default() });
    }
    if seed.is_multiple_of(4) {
        config.fault.push(FaultConfig {
            kind: if seed.is_multiple_of(8) { FaultKind::Ileus } else { FaultKind::Gastroparesis },
            start_s: NonNegative(about(8, 0.0, FUZZED_S)),
            end_s: None,
            remaining: Fraction(about(9, 0.0, 1.0)),
        });
    }
    config
}

fn imports() -> Outcome {
    let data = std::env::var_os("LUMENAV_DATA").ok_or("LUMENAV_DATA is not set")?;
    let tracts = Path::new(&data).join("tracts");
    let mut told = Vec::new();
    let mut holds = true;
    // The first person's surfaces are asked for unaided, the second's may be helped; a third was never given.
    let unaided = |one: Imported| Imported { waypoints_mm: &[], ..one };
    let as_asked = |one: Imported| if one.person == PEOPLE[0].person { unaided(one) } else { one };
    for one in PEOPLE.map(as_asked) {
        let (person, organ) = (one.person, one.organ);
        let name = format!("{person} {organ} ({} waypoints)", one.waypoints_mm.len());
        let surface = tracts.join(format!("{person}_{organ}.stl"));
        if !surface.is_file() {
            told.push(format!("{name}: not measured"));
            holds = false;
            continue;
        }
        let given = tracts.join(format!("{person}_centerline.csv"));
        match imported(&one, &surface, &given) {
            Ok((figure, meets)) => {
                told.push(format!("{name}: {figure}"));
                holds &= meets;
            }
            Err(why) => {
                told.push(format!("{name}: {why}"));
                holds = false;
            }
        }
    }
    told.push("a third person: not measured (no surface of one is there)".to_owned());
    Ok((told.join("; "), holds))
}

/// Mean distance and length error of each segment of one surface, and whether all meet both.
fn imported(one: &Imported, surface: &Path, given: &Path) -> Outcome {
    let waypoints_m = one.waypoints_mm.iter().map(|place| place.map(|mm| 1e-3 * mm).into()).collect();
    let options = ImportOptions { waypoints_m, ..ImportOptions::default() };
    let tract = import_surface(surface, &options, &mut |_| {}).map_err(|e| e.to_string())?;
    let stations: Vec<_> = tract.stations.iter().map(|station| station.point_m).collect();
    let line = CentreLine::through(&stations).map_err(|e| e.to_string())?;
    let text = std::fs::read_to_string(given).map_err(|e| format!("{}: {e}", given.display()))?;
    let mut told = Vec::new();
    let mut holds = true;
    for segment in one.segments {
        let of_segment = |row: &&str| row.split(',').next() == Some(*segment);
        // Columns: segment, s, x, y, z, radius.
        let number =
            |text: &str| text.parse::<f64>().map_err(|e| format!("{}: `{text}`: {e}", given.display()));
        let mut points = Vec::new();
        for row in text.lines().filter(of_segment) {
            let columns: Vec<&str> = row.split(',').collect();
            let [_, _, x, y, z, ..] = columns[..] else {
                return Err(format!("{}: `{row}` has no place", given.display()));
            };
            points.push([number(x)?, number(y)?, number(z)?].into());
        }
        let feet: Vec<_> = points.iter().map(|point| line.nearest(point, 1)[0]).collect();
        let (Some(first), Some(last)) = (feet.first(), feet.last()) else {
            return Err(format!("{} has no `{segment}`", given.display()));
        };
        let given_m: f64 = points.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum();
        let error = (last.arc_length_m - first.arc_length_m).abs() / given_m - 1.0;
        let away_mm = 1e3 * feet.iter().map(|foot| foot.distance_m).sum::<f64>() / feet.len() as f64;
        told.push(format!("{segment} {away_mm:.2} mm {:+.1} %", 100.0 * error));
        holds &= error.abs() <= LENGTH_ERROR && away_mm <= AWAY_MM;
    }
    Ok((told.join(", "), holds))
}

/// A capsule at this arc length of a patient who lies or stands in any way.
fn posture(seed: u64, start_m: f64) -> EngineConfig {
    let turn =
        UnitQuaternion::from_scaled_axis(Vector3::from_fn(|i, _| 3.0 * drawn(seed, 20 + i as u64) - 1.5));
    let gravity = turn * Vector3::new(0.0, 0.0, -9.81);
    EngineConfig {
        gravity_torso_m_s2: [gravity.x, gravity.y, gravity.z].map(Finite),
        start_arc_length_m: NonNegative(start_m),
        ..EngineConfig::default()
    }
}

fn fuzzed() -> Outcome {
    let tracts = BodySize::ALL.map(shipped).into_iter().collect::<Result<Vec<_>, _>>()?;
    let reports = on_two_threads(FUZZED, |seed| {
        let tract = &tracts[(seed % 3) as usize];
        // The shipped guts are of the kinds that the default motility knows, and `fuzzy` stays within its limits.
        let build = |seed, start_m| {
            let streams = RandomStreams::new(seed, 0, "motility");
            let motility = Motility::new(&fuzzy(seed), tract, &streams).unwrap_or_else(|e| panic!("{e}"));
            Engine::new(posture(seed, start_m), tract.clone(), motility, CAPSULE)
        };
        fuzz_inside_lumen(seed..seed + 1, FUZZED_S, tract, &CAPSULE, build).map_err(|e| e.to_string())
    })?;
    let all = reports.iter().skip(1).fold(reports[0], FuzzReport::and);
    let FuzzReport {
        runs, steps, worst_excess_m, worst_seed, not_finite, stalls, untold_stalls, left, ..
    } = all;
    let figure = format!(
        "{runs} runs, {steps} steps, {:.3} mm into the wall at most (seed {worst_seed}), {not_finite} not finite, {stalls} stalls told, \
         {untold_stalls} not, {left} left the tract",
        1e3 * worst_excess_m
    );
    Ok((figure, all.inside() && untold_stalls == 0))
}

/// A capsule somewhere in a shipped gut with motility of its own.
fn engine(tracts: &[Arc<Tract>], seed: u64) -> Result<Engine, String> {
    let tract = &tracts[(seed % 3) as usize];
    let mut config = EngineConfig::default();
    config.start_arc_length_m.0 = tract.length_m() * (seed as f64 + 0.5) / COMPARED as f64;
    let streams = RandomStreams::new(seed, 0, "motility");
    let motility = Motility::new(&MotilityConfig::default(), tract, &streams).map_err(|e| e.to_string())?;
    Engine::new(config, tract.clone(), motility, CAPSULE).map_err(|e| e.to_string())
}

fn same_bytes() -> Outcome {
    let tracts = BodySize::ALL.map(shipped).into_iter().collect::<Result<Vec<_>, _>>()?;
    let end = SimTime::from_seconds(FUZZED_S);
    let through = |seed| {
        let mut engine = engine(&tracts, seed)?;
        engine.advance_to(end);
        Ok(engine.snapshot())
    };
    let resumed = |seed| {
        let mut before = engine(&tracts, seed)?;
        before.advance_to(SimTime::from_seconds(FUZZED_S / 3.0));
        let mut after = engine(&tracts, seed)?;
        after.restore(&before.snapshot()).map_err(|e| e.to_string())?;
        after.advance_to(end);
        Ok(after.snapshot())
    };
    let one: Vec<Vec<u8>> = (0..COMPARED).map(through).collect::<Result<_, String>>()?;
    let two = on_two_threads_in_order(COMPARED, through)?;
    let again = on_two_threads_in_order(COMPARED, resumed)?;
    // Runs in which nothing happens would be alike whatever is wrong.
    let places_m = on_two_threads(COMPARED, |seed| {
        let mut engine = engine(&tracts, seed)?;
        let start_m = engine.state().arc_length_m;
        engine.advance_to(end);
        Ok((engine.state().arc_length_m - start_m).abs())
    })?;
    let moved = places_m.iter().filter(|way_m| **way_m > 1e-3).count();
    let same = |other: &[Vec<u8>]| one.iter().zip(other).filter(|(a, b)| a == b).count();
    let figure = format!(
        "of {COMPARED} runs {} end alike on two threads, {} across a checkpoint; {moved} went further than a millimetre",
        same(&two),
        same(&again)
    );
    Ok((figure, one == two && one == again && 2 * moved >= one.len()))
}

/// As [`on_two_threads`], in the order of the numbers.
fn on_two_threads_in_order<T: Send>(
    count: u64,
    of: impl Fn(u64) -> Result<T, String> + Sync,
) -> Result<Vec<T>, String> {
    let mut all = on_two_threads(count, |k| Ok((k, of(k)?)))?;
    all.sort_by_key(|(k, _)| *k);
    Ok(all.into_iter().map(|(_, one)| one).collect())
}

fn generated() -> Outcome {
    let made = on_two_threads(GENERATED, |k| {
        let size = BodySize::ALL[(k % 3) as usize];
        let seed = 1000 + k;
        Ok(match whole_gut(&WholeGutRequest::new(size), &RandomStreams::new(seed, 0, "whole-gut")) {
            Ok(generated) => Ok(generated.report.overlaps.len()),
            Err(error) => Err(format!("{} {seed}: {error}", size.as_str())),
        })
    })?;
    let overlaps: usize = made.iter().filter_map(|one| one.as_ref().ok()).sum();
    let refused: Vec<&str> = made.iter().filter_map(|one| one.as_ref().err().map(String::as_str)).collect();
    let figure = format!(
        "{} made, {overlaps} overlaps, {} refused: {}",
        made.len() - refused.len(),
        refused.len(),
        refused.join("; ")
    );
    Ok((figure, overlaps == 0))
}

/// Every row in words; passes where each that has a published number is met.
fn reproduction(id: &str, out: &Path) -> Outcome {
    let ended = run(lumenav().args(["-q", "reproduce", id, "--json", "--out"]).arg(out))?;
    let table: Table = serde_json::from_str(&ended.stdout).map_err(|e| format!("{id}: {e}"))?;
    let mut told = Vec::new();
    let mut holds = true;
    for row in &table.rows {
        let ours = row.ours.values().copied().flatten().next().unwrap_or(f64::NAN);
        let published = row.published.map_or_else(String::new, |p| format!(" ({p})"));
        told.push(format!("{}: {ours:.2}{published} {}: {}", row.quantity, row.unit, row.verdict));
        // What has a published number and came to none of ours (a median among those that did not pass) is not comparable, and no pass.
        let is_met = matches!(row.verdict.as_str(), "reproduced" | "better" | "holds");
        holds &= row.published.is_none() || is_met;
    }
    Ok((told.join("; "), holds))
}
