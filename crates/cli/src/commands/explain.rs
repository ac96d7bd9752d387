//! `lumenav explain`: why a track lost the capsule, in words.
//!
//! Reads `manifest.json` (who may use which sensor, faults, what the world did to the sensors), `metrics.json`,
//! `tracks.parquet` and `events.jsonl` of a run. A *gap* is a stretch without updates much longer than the track's usual
//! period, the time before the first and after the last update included; a *burst* a stretch of refusals. For both it says
//! when, how many, why, and along which direction the position was weakest then.

mod bursts;
mod gaps;
mod meanwhile;
mod words;

use crate::args::ExplainOptions;
use anyhow::{Context as _, bail};
use bursts::{Burst, bursts};
use gaps::{Gap, Span, gaps};
use lumenav::report::{
    Logged, LoggedEvent, Manifest, Metrics, TrackMetrics, TrackRow, read_events, read_json, read_tracks,
};
use meanwhile::{Coincidence, coincidences, passages};
use serde::Serialize;
use std::collections::BTreeMap;
use words::{Weakness, weakest};

/// Half width of the window of `--at`.
const AT_WINDOW_S: f64 = 5.0;

/// All that is said of a run.
#[derive(Serialize)]
struct Explanation {
    scenario: String,
    seed: u64,
    duration_s: f64,
    /// What happened in the world and to the readings.
    world: Vec<Happening>,
    tracks: BTreeMap<String, OfTrack>,
}

/// Something that happened, for an instant or a while.
#[derive(Serialize)]
struct Happening {
    from_s: f64,
    to_s: f64,
    source: String,
    text: String,
}

/// What is said of a track.
#[derive(Serialize)]
struct OfTrack {
    updates: u64,
    refused: BTreeMap<String, u64>,
    failed_updates: u64,
    weakest: Option<Weakness>,
    gaps: Vec<Gap>,
    bursts: Vec<Burst>,
    notes: Vec<Happening>,
    /// Where it was furthest off, where there is a truth.
    largest_error: Option<LargestError>,
    /// What of the world lasted into gaps, refusals and the largest error.
    coincidences: Vec<Coincidence>,
}

/// The largest error of a track.
#[derive(Serialize)]
struct LargestError {
    t_s: f64,
    error_mm: f64,
}

/// Explains a run.
pub fn explain(options: &ExplainOptions) -> anyhow::Result<()> {
    let folder = &options.run;
    let metrics: Metrics = read_json(&folder.join("metrics.json"))
        .with_context(|| format!("{} is no run's folder", folder.display()))?;
    let manifest: Manifest = read_json(&folder.join("manifest.json"))?;
    let scenario: toml::Table = manifest
        .scenario_toml
        .parse()
        .with_context(|| format!("{}: the scenario in it", folder.join("manifest.json").display()))?;
    let rows = read_tracks(&folder.join("tracks.parquet"))?;
    let events = read_events(&folder.join("events.jsonl"))?;
    if let Some(track) = options.track.as_ref().filter(|t| !metrics.tracks.contains_key(*t)) {
        let known: Vec<&str> = metrics.tracks.keys().map(String::as_str).collect();
        bail!("no track `{track}`; the run has: {}", known.join(", "));
    }
    let span = span_of(&metrics, &scenario, &rows, &events);
    if let Some(at) = options.at.filter(|at| *at < span.from_s || *at > span.to_s) {
        bail!("{at} s is outside the run, which goes from {:.1} to {:.1} s", span.from_s, span.to_s);
    }
    let window = options.at.map(|at| (at - AT_WINDOW_S, at + AT_WINDOW_S));
    let wanted = |name: &str| options.track.as_ref().is_none_or(|t| t == name);
    let happened = of_world(&scenario, &events, span);
    let around = Around { span, window, world: &happened };
    let explanation = Explanation {
        scenario: metrics.scenario.clone(),
        seed: metrics.seed,
        duration_s: metrics.duration_s,
        tracks: metrics
            .tracks
            .iter()
            .filter(|(name, _)| wanted(name))
            .map(|(name, figures)| {
                let own: Vec<&TrackRow> = rows.iter().filter(|r| *r.track == **name).collect();
                let sensors = sensors_of(&scenario, name);
                (name.clone(), of_track(name, figures, own, &events, &sensors, &around))
            })
            .collect(),
        world: happened.into_iter().filter(|h| touches(h.from_s, h.to_s, window)).collect(),
    };
    if options.json { crate::output::json(&explanation) } else { print(&explanation, window) }
}

fn seconds(t_ns: i64) -> f64 {
    t_ns as f64 * 1e-9
}

/// Whether a stretch touches the window of `--at`.
fn touches(from_s: f64, to_s: f64, window: Option<(f64, f64)>) -> bool {
    window.is_none_or(|(from, to)| to_s >= from && from_s <= to)
}

/// From when to when there could have been updates: from where it is observed to the end in a scenario, the recorded time in a replay.
fn span_of(metrics: &Metrics, scenario: &toml::Table, rows: &[TrackRow], events: &[LoggedEvent]) -> Span {
    let duration = scenario.get("scenario").and_then(|s| s.get("duration_s"));
    if duration.is_some() && !is_replay(scenario) {
        return Span { from_s: metrics.observe_from_s, to_s: metrics.duration_s };
    }
    let times = || rows.iter().map(|r| r.t_ns).chain(events.iter().map(|e| e.t_ns));
    let from_s = times().min().map_or(0.0, seconds);
    Span { from_s, to_s: times().max().map_or(metrics.duration_s, seconds) }
}

fn is_replay(scenario: &toml::Table) -> bool {
    named(scenario, "sensor").any(|sensor| sensor.get("files").is_some())
}

/// The entries of an array of tables.
fn named<'t>(scenario: &'t toml::Table, key: &str) -> impl Iterator<Item = &'t toml::Value> {
    scenario.get(key).and_then(|v| v.as_array()).into_iter().flatten()
}

fn text_of<'v>(value: &'v toml::Value, key: &str) -> &'v str {
    value.get(key).and_then(|v| v.as_str()).unwrap_or_default()
}

/// The sensors that a track may use.
fn sensors_of(scenario: &toml::Table, track: &str) -> Vec<String> {
    named(scenario, "track")
        .filter(|entry| text_of(entry, "name") == track)
        .filter_map(|entry| entry.get("sensors").and_then(|s| s.as_array()))
        .flatten()
        .filter_map(|sensor| sensor.as_str().map(str::to_owned))
        .collect()
}

/// `start_s` and `end_s` of a table.
fn stretch(value: &toml::Value) -> Option<(f64, f64)> {
    let number = |key: &str| {
        let value = value.get(key)?;
        value.as_float().or_else(|| value.as_integer().map(|i| i as f64))
    };
    Some((number("start_s")?, number("end_s")?))
}

/// What the world did, the faults, and what `reality` did to the sensors for a while.
fn of_world(scenario: &toml::Table, events: &[LoggedEvent], span: Span) -> Vec<Happening> {
    let mut faults = named(scenario, "fault");
    let notes = events.iter().filter_map(|event| match &event.what {
        Logged::Note { source, text } if source == "world" => Some((seconds(event.t_ns), text.as_str())),
        _ => None,
    });
    let mut all = passages(notes, span.to_s);
    for event in events {
        let Logged::Note { source, text } = &event.what else { continue };
        let at_s = seconds(event.t_ns);
        let to_s = match source.as_str() {
            // Told as passages.
            "world" if text.contains(" the capsule at ") && text.starts_with("wave of ") => continue,
            "world" => at_s,
            // The faults are announced in the order of the file.
            "fault" => faults.next().and_then(stretch).map_or(at_s, |(_, end)| end),
            _ => continue,
        };
        all.push(Happening { from_s: at_s, to_s, source: source.clone(), text: text.clone() });
    }
    for sensor in named(scenario, "sensor") {
        let Some(toml::Value::Table(reality)) = sensor.get("reality") else { continue };
        for (what, entries) in reality {
            let entries = entries.as_array().map_or(std::slice::from_ref(entries), Vec::as_slice);
            for (from_s, to_s) in entries.iter().filter_map(stretch) {
                let name = text_of(sensor, "name");
                let text = format!("sensor `{name}`: {what} from {from_s} to {to_s} s");
                all.push(Happening { from_s, to_s, source: "reality".to_owned(), text });
            }
        }
    }
    all.sort_by(|a, b| a.from_s.total_cmp(&b.from_s));
    all
}

/// What stands around all tracks of a run.
struct Around<'a> {
    /// When there could have been updates.
    span: Span,
    /// The window of `--at`.
    window: Option<(f64, f64)>,
    /// What happened in the world.
    world: &'a [Happening],
}

fn of_track(
    name: &str,
    figures: &TrackMetrics,
    mut rows: Vec<&TrackRow>,
    events: &[LoggedEvent],
    sensors: &[String],
    around: &Around<'_>,
) -> OfTrack {
    let Around { span, window, world } = *around;
    // A late measurement gives a row of an earlier instant.
    rows.sort_by_key(|row| row.t_ns);
    // A prediction that stands in for a refused measurement is no update.
    let updates: Vec<&TrackRow> = rows.iter().filter(|row| row.accepted).copied().collect();
    let mut gaps = gaps(name, &updates, events, sensors, span);
    gaps.retain(|gap| touches(gap.from_s, gap.to_s, window));
    let mut bursts = bursts(name, &rows, events);
    bursts.retain(|burst| touches(burst.from_s, burst.to_s, window));
    let notes = events
        .iter()
        .filter(|e| touches(seconds(e.t_ns), seconds(e.t_ns), window))
        .filter_map(|event| match &event.what {
            Logged::Note { source, text } if source == name => Some(Happening {
                from_s: seconds(event.t_ns),
                to_s: seconds(event.t_ns),
                source: source.clone(),
                text: text.clone(),
            }),
            _ => None,
        })
        .collect();
    let (from, to) = window.unwrap_or((f64::NEG_INFINITY, f64::INFINITY));
    let largest_error = largest_error(&rows, from, to);
    let of_error = largest_error.iter().map(|e| ("largest error", e.t_s, e.t_s));
    let of_gaps = gaps.iter().map(|gap| ("gap", gap.from_s, gap.to_s));
    let of_bursts = bursts.iter().map(|burst| ("refusals", burst.from_s, burst.to_s));
    let coincidences = of_error
        .chain(of_gaps)
        .chain(of_bursts)
        .flat_map(|(during, from_s, to_s)| coincidences(world, during, from_s, to_s))
        .collect();
    OfTrack {
        updates: figures.updates,
        refused: figures.refused.clone(),
        failed_updates: figures.failed_updates,
        weakest: weakest(&rows, from, to),
        gaps,
        bursts,
        notes,
        largest_error,
        coincidences,
    }
}

fn largest_error(rows: &[&TrackRow], from_s: f64, to_s: f64) -> Option<LargestError> {
    rows.iter()
        .filter(|row| (from_s..=to_s).contains(&seconds(row.t_ns)))
        .filter_map(|row| Some(LargestError { t_s: seconds(row.t_ns), error_mm: row.number("error_mm")? }))
        .max_by(|a, b| a.error_mm.total_cmp(&b.error_mm))
}

fn print(explanation: &Explanation, window: Option<(f64, f64)>) -> anyhow::Result<()> {
    let Explanation { scenario, seed, duration_s, world, tracks } = explanation;
    say!("{scenario} (seed {seed}), {duration_s:.1} s")?;
    for happening in world {
        say!("  {:8.2} s  {}: {}", happening.from_s, happening.source, happening.text)?;
    }
    for (name, track) in tracks {
        say!("\n{name}: {}", track.counters(window))?;
        for (_, line) in track.lines() {
            say!("  {line}")?;
        }
        match &track.weakest {
            Some(weakest) => say!("  weakest: {}", weakest.text())?,
            None if window.is_some() => say!("  no estimate within {AT_WINDOW_S:.0} s of that instant")?,
            None => {}
        }
        if track.is_usual() {
            say!("  nothing unusual: no gap, no refusal")?;
        }
    }
    Ok(())
}

impl OfTrack {
    fn counters(&self, window: Option<(f64, f64)>) -> String {
        let whole = if window.is_some() { "in the whole run " } else { "" };
        let refused: Vec<String> =
            self.refused.iter().map(|(why, n)| format!("{n} {}", words::refusal(why))).collect();
        let refused = if refused.is_empty() { "none".to_owned() } else { refused.join(", ") };
        format!("{whole}{} updates; refused: {refused}; {} updates failed", self.updates, self.failed_updates)
    }

    /// Everything with its time, in order.
    fn lines(&self) -> Vec<(f64, String)> {
        let mut lines: Vec<(f64, String)> = Vec::new();
        lines.extend(self.gaps.iter().flat_map(Gap::lines));
        lines.extend(self.bursts.iter().flat_map(Burst::lines));
        lines.extend(self.notes.iter().map(|n| (n.from_s, format!("{:8.2} s  {}", n.from_s, n.text))));
        lines.extend(
            self.largest_error
                .iter()
                .map(|e| (e.t_s, format!("{:8.2} s  largest error, {:.2} mm", e.t_s, e.error_mm))),
        );
        lines.extend(self.coincidences.iter().map(Coincidence::line));
        // Stable: what belongs together stays together.
        lines.sort_by(|a, b| a.0.total_cmp(&b.0));
        lines
    }

    fn is_usual(&self) -> bool {
        let given_up = self.notes.iter().any(|note| note.text.starts_with("belief given up"));
        self.gaps.is_empty() && self.bursts.is_empty() && !given_up
    }
}
