//! `lumenav explain`: why a track lost the capsule, in words.
//!
//! Reads `metrics.json`, `tracks.parquet` and `events.jsonl` of a run. A *gap* is a stretch without updates much longer than
//! the track's usual period; a *burst* a stretch of refusals. For both it says when, how many, why, what happened at the
//! same time, and along which direction the position was weakest.

use crate::args::ExplainOptions;
use anyhow::{Context as _, bail};
use lumenav::report::{
    Logged, LoggedEvent, Metrics, TrackMetrics, TrackRow, read_events, read_json, read_tracks,
};
use std::collections::BTreeMap;

/// A gap is this many times the usual period, and at least [`MIN_GAP_S`].
const GAP_PERIODS: f64 = 5.0;
/// Shorter silences are no gap.
const MIN_GAP_S: f64 = 0.5;
/// Refusals further apart than this are two bursts.
const BURST_PAUSE_S: f64 = 2.0;
/// Half width of the window of `--at`.
const AT_WINDOW_S: f64 = 5.0;

/// Explains a run.
pub fn explain(options: &ExplainOptions) -> anyhow::Result<()> {
    let folder = &options.run;
    let metrics: Metrics = read_json(&folder.join("metrics.json"))
        .with_context(|| format!("{} is no run's folder", folder.display()))?;
    let rows = read_tracks(&folder.join("tracks.parquet"))?;
    let events = read_events(&folder.join("events.jsonl"))?;
    if let Some(track) = options.track.as_ref().filter(|t| !metrics.tracks.contains_key(*t)) {
        let known: Vec<&str> = metrics.tracks.keys().map(String::as_str).collect();
        bail!("no track `{track}`; the run has: {}", known.join(", "));
    }
    let window = options.at.map(|at| (at - AT_WINDOW_S, at + AT_WINDOW_S));
    println!("{} (seed {}), {:.1} s", metrics.scenario, metrics.seed, metrics.duration_s);
    for line in world_lines(&events, window) {
        println!("  {line}");
    }
    for (name, track) in &metrics.tracks {
        if options.track.as_ref().is_some_and(|t| t != name) {
            continue;
        }
        let own: Vec<&TrackRow> = rows.iter().filter(|r| *r.track == **name).collect();
        println!("\n{name}");
        for line in track_lines(name, track, &own, &events, window) {
            println!("  {line}");
        }
    }
    Ok(())
}

fn seconds(t_ns: i64) -> f64 {
    t_ns as f64 * 1e-9
}

fn inside(t_s: f64, window: Option<(f64, f64)>) -> bool {
    window.is_none_or(|(from, to)| t_s >= from && t_s <= to)
}

/// What the world and the faults did.
fn world_lines(events: &[LoggedEvent], window: Option<(f64, f64)>) -> Vec<String> {
    events
        .iter()
        .filter(|e| inside(seconds(e.t_ns), window))
        .filter_map(|e| match &e.what {
            Logged::Note { source, text } if source == "world" || source == "fault" => {
                Some(format!("{:8.2} s  {source}: {text}", seconds(e.t_ns)))
            }
            _ => None,
        })
        .collect()
}

fn track_lines(
    name: &str,
    metrics: &TrackMetrics,
    rows: &[&TrackRow],
    events: &[LoggedEvent],
    window: Option<(f64, f64)>,
) -> Vec<String> {
    let mut lines = vec![counters(metrics)];
    lines.extend(weakest(rows, window));
    for gap in gaps(rows) {
        if window.is_none_or(|(from, to)| gap.to_s >= from && gap.from_s <= to) {
            lines.extend(gap_lines(&gap, name, rows, events));
        }
    }
    for burst in bursts(name, events) {
        if window.is_none_or(|(from, to)| burst.to_s >= from && burst.from_s <= to) {
            lines.push(burst.describe());
        }
    }
    for event in events.iter().filter(|e| inside(seconds(e.t_ns), window)) {
        if let Logged::Note { source, text } = &event.what
            && source == name
        {
            lines.push(format!("{:8.2} s  {text}", seconds(event.t_ns)));
        }
    }
    if lines.len() == 1 {
        lines.push("nothing unusual: no gap, no refusal".to_owned());
    }
    lines
}

fn counters(metrics: &TrackMetrics) -> String {
    let refused: Vec<String> = metrics.refused.iter().map(|(why, n)| format!("{n} {why}")).collect();
    let refused = if refused.is_empty() { "none".to_owned() } else { refused.join(", ") };
    format!("{} updates, refused: {refused}; {} failed", metrics.updates, metrics.failed_updates)
}

/// A direction in the world in a patient's words (RAS: x right, y anterior, z superior).
fn in_words(x: f64, y: f64, z: f64) -> &'static str {
    let axes = [(x.abs(), "left-right (x)"), (y.abs(), "front-back (y)"), (z.abs(), "head-foot (z)")];
    let largest = axes.iter().max_by(|a, b| a.0.total_cmp(&b.0));
    match largest {
        Some((share, words)) if *share > 0.8 => words,
        _ if z.abs() < 0.4 => "oblique in the transverse plane (x and y)",
        _ if y.abs() < 0.4 => "oblique in the coronal plane (x and z)",
        _ if x.abs() < 0.4 => "oblique in the sagittal plane (y and z)",
        _ => "oblique to all axes",
    }
}

/// Where the position was weakest, over the window.
fn weakest(rows: &[&TrackRow], window: Option<(f64, f64)>) -> Option<String> {
    let row = rows
        .iter()
        .filter(|r| inside(seconds(r.t_ns), window))
        .filter_map(|r| r.number("weakest_sigma_mm").map(|s| (s, r)))
        .max_by(|a, b| a.0.total_cmp(&b.0))?;
    Some(format!("weakest: {}", weakness(row.1)?))
}

fn weakness(row: &TrackRow) -> Option<String> {
    let get = |name: &str| row.number(name);
    let (x, y, z) = (get("weakest_x")?, get("weakest_y")?, get("weakest_z")?);
    let sigma = get("weakest_sigma_mm")?;
    let error = get("error_mm").map_or(String::new(), |e| format!("; error then {e:.2} mm"));
    Some(format!("{sigma:.2} mm (1 sigma) {} at {:.2} s{error}", in_words(x, y, z), seconds(row.t_ns)))
}

/// A stretch without updates.
struct Gap {
    from_s: f64,
    to_s: f64,
    before: usize,
    after: usize,
}

fn gaps(rows: &[&TrackRow]) -> Vec<Gap> {
    let mut steps: Vec<f64> = rows.windows(2).map(|w| seconds(w[1].t_ns - w[0].t_ns)).collect();
    steps.sort_by(f64::total_cmp);
    let Some(usual) = steps.get(steps.len() / 2) else { return Vec::new() };
    let limit = (GAP_PERIODS * usual).max(MIN_GAP_S);
    rows.windows(2)
        .enumerate()
        .map(|(i, w)| Gap { from_s: seconds(w[0].t_ns), to_s: seconds(w[1].t_ns), before: i, after: i + 1 })
        .filter(|g| g.to_s - g.from_s > limit)
        .collect()
}

fn gap_lines(gap: &Gap, track: &str, rows: &[&TrackRow], events: &[LoggedEvent]) -> Vec<String> {
    let mut why: BTreeMap<String, u64> = BTreeMap::new();
    for event in events {
        let t = seconds(event.t_ns);
        if t <= gap.from_s || t >= gap.to_s {
            continue;
        }
        match &event.what {
            Logged::Missing { sensor, text } => {
                *why.entry(format!("no reading of `{sensor}` ({text})")).or_default() += 1;
            }
            Logged::Refused { track: of, reason, .. } if of == track => {
                *why.entry(format!("refused: {reason}")).or_default() += 1;
            }
            _ => {}
        }
    }
    let reasons: Vec<String> = why.iter().map(|(what, n)| format!("{n} x {what}")).collect();
    let reasons = if reasons.is_empty() { "no reading was due".to_owned() } else { reasons.join("; ") };
    let mut lines = vec![format!(
        "{:8.2} s  no update for {:.1} s (until {:.2} s): {reasons}",
        gap.from_s,
        gap.to_s - gap.from_s,
        gap.to_s
    )];
    let (before, after) = (weakness(rows[gap.before]), weakness(rows[gap.after]));
    lines.extend(before.map(|w| format!("            before: weakest {w}")));
    lines.extend(after.map(|w| format!("            after:  weakest {w}")));
    lines
}

/// A stretch of refusals.
struct Burst {
    from_s: f64,
    to_s: f64,
    count: u64,
    reasons: BTreeMap<String, u64>,
    /// Largest chi-square, with its degrees of freedom and threshold.
    largest: Option<(f64, f64, f64)>,
    /// How often a channel was among the worst.
    channels: BTreeMap<String, u64>,
}

fn bursts(track: &str, events: &[LoggedEvent]) -> Vec<Burst> {
    let mut all: Vec<Burst> = Vec::new();
    for event in events {
        let Logged::Refused { track: of, reason, text, chi_square, dof, threshold, worst, .. } = &event.what
        else {
            continue;
        };
        if of != track {
            continue;
        }
        let t = seconds(event.t_ns);
        if all.last().is_none_or(|last| t - last.to_s > BURST_PAUSE_S) {
            let (reasons, channels) = (BTreeMap::new(), BTreeMap::new());
            all.push(Burst { from_s: t, to_s: t, count: 0, reasons, largest: None, channels });
        }
        // Just pushed, if it was not there.
        let Some(burst) = all.last_mut() else { continue };
        burst.to_s = burst.to_s.max(t);
        burst.count += 1;
        let why = text.as_ref().map_or_else(|| reason.clone(), |text| format!("{reason}: {}", stem(text)));
        *burst.reasons.entry(why).or_default() += 1;
        if let (Some(c), Some(d), Some(limit)) = (chi_square, dof, threshold)
            && burst.largest.is_none_or(|(old, _, _)| *c > old)
        {
            burst.largest = Some((*c, *d, *limit));
        }
        for channel in worst {
            let label = channel.label.clone().unwrap_or_else(|| format!("channel {}", channel.channel));
            *burst.channels.entry(label).or_default() += 1;
        }
    }
    all
}

/// A reason without its trailing number, so that equal reasons count together.
fn stem(text: &str) -> &str {
    text.trim_end_matches(|c: char| c.is_ascii_digit() || c == '.' || c == ' ')
}

impl Burst {
    fn describe(&self) -> String {
        let reasons: Vec<String> = self.reasons.iter().map(|(why, n)| format!("{n} x {why}")).collect();
        let mut line = format!(
            "{:8.2} s  {} refused until {:.2} s: {}",
            self.from_s,
            self.count,
            self.to_s,
            reasons.join("; ")
        );
        if let Some((chi_square, dof, threshold)) = self.largest {
            line = format!("{line}; chi-square up to {chi_square:.0} for {dof:.0} dof (gate {threshold:.0})");
        }
        let mut channels: Vec<(&String, &u64)> = self.channels.iter().collect();
        channels.sort_by(|a, b| b.1.cmp(a.1).then(a.0.cmp(b.0)));
        if !channels.is_empty() {
            let names: Vec<&str> = channels.iter().take(4).map(|(name, _)| name.as_str()).collect();
            line = format!("{line}; loudest channels: {}", names.join(", "));
        }
        line
    }
}
