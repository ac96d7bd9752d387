//! Stretches of refusals.

use super::seconds;
use super::words::{self, Weakness, count, weakest};
use lumenav::report::{Logged, LoggedEvent, TrackRow};
use serde::Serialize;
use std::collections::BTreeMap;

/// Refusals further apart than this are two bursts.
const BURST_PAUSE_S: f64 = 2.0;
/// How many of the channels that fit worst are named.
const CHANNELS_NAMED: usize = 4;

/// A stretch of refusals.
#[derive(Serialize)]
pub struct Burst {
    pub from_s: f64,
    pub to_s: f64,
    pub count: u64,
    /// Reasons with their counts.
    pub reasons: BTreeMap<String, Reason>,
    /// What the gate saw at its worst.
    pub worst_innovation: Option<Innovation>,
    /// How often a channel was among those that fit worst.
    pub channels: BTreeMap<String, u64>,
    /// The weakest instant meanwhile.
    pub weakest: Option<Weakness>,
}

/// How often something was a reason, and how large the figure in it became.
#[derive(Clone, Default, Serialize)]
pub struct Reason {
    pub count: u64,
    pub largest: Option<f64>,
    /// The first of them in full; absent where it has no other figures.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub first: Option<String>,
}

/// A refused innovation.
#[derive(Clone, Copy, Serialize)]
pub struct Innovation {
    pub chi_square: f64,
    pub degrees_of_freedom: f64,
    pub threshold: f64,
}

/// The bursts of a track whose rows are in order of time.
pub fn bursts(track: &str, rows: &[&TrackRow], events: &[LoggedEvent]) -> Vec<Burst> {
    let mut refusals: Vec<&LoggedEvent> = events
        .iter()
        .filter(|event| matches!(&event.what, Logged::Refused { track: of, .. } if of == track))
        .collect();
    refusals.sort_by_key(|event| event.t_ns);
    let mut all: Vec<Burst> = Vec::new();
    for event in refusals {
        let t = seconds(event.t_ns);
        if let Some(burst) = all.last_mut().filter(|last| t - last.to_s <= BURST_PAUSE_S) {
            burst.add(event);
            continue;
        }
        let mut burst = Burst {
            from_s: t,
            to_s: t,
            count: 0,
            reasons: BTreeMap::new(),
            worst_innovation: None,
            channels: BTreeMap::new(),
            weakest: None,
        };
        burst.add(event);
        all.push(burst);
    }
    for burst in &mut all {
        // The update just before or after counts where none came meanwhile.
        burst.weakest = weakest(rows, burst.from_s - BURST_PAUSE_S, burst.to_s + BURST_PAUSE_S);
    }
    all
}

impl Burst {
    fn add(&mut self, event: &LoggedEvent) {
        let Logged::Refused { sensor, reason, text, chi_square, dof, threshold, worst, .. } = &event.what
        else {
            return;
        };
        self.to_s = self.to_s.max(seconds(event.t_ns));
        self.count += 1;
        let said = text.clone().unwrap_or_default();
        let (text, number) = words::stem_and_number(&said);
        let first = text.contains('…').then_some(said);
        let text = if text.is_empty() { String::new() } else { format!(": {text}") };
        let of = self.reasons.entry(format!("of `{sensor}` {}{text}", words::refusal(reason))).or_default();
        of.count += 1;
        of.first = of.first.take().or(first);
        of.largest = of.largest.into_iter().chain(number).reduce(f64::max);
        if let (Some(chi_square), Some(degrees_of_freedom), Some(threshold)) = (*chi_square, *dof, *threshold)
            && self.worst_innovation.is_none_or(|old| chi_square > old.chi_square)
        {
            self.worst_innovation = Some(Innovation { chi_square, degrees_of_freedom, threshold });
        }
        for channel in worst {
            let label = channel.label.clone().unwrap_or_else(|| format!("channel {}", channel.channel));
            *self.channels.entry(label).or_default() += 1;
        }
    }

    /// Lines with the time they are sorted by.
    pub fn lines(&self) -> Vec<(f64, String)> {
        let reason = |(why, reason): (&String, &Reason)| {
            let largest = reason.largest.map_or(String::new(), |largest| format!(" up to {largest:.0}"));
            let first = reason.first.as_ref().map_or(String::new(), |first| format!(" (first: {first})"));
            format!("{} {why}{largest}{first}", reason.count)
        };
        let reasons: Vec<String> = self.reasons.iter().map(reason).collect();
        let when = if self.to_s > self.from_s {
            format!("refused until {:.2} s", self.to_s)
        } else {
            "refused".to_owned()
        };
        let mut lines = vec![format!(
            "{:8.2} s  {} {when}: {}",
            self.from_s,
            count(self.count, "reading"),
            reasons.join("; ")
        )];
        if let Some(worst) = self.worst_innovation {
            let Innovation { chi_square, degrees_of_freedom, threshold } = worst;
            lines.push(format!(
                "            the gate saw a chi-square of up to {chi_square:.0}; it lets {threshold:.0} pass ({degrees_of_freedom:.0} \
                 degrees of freedom)"
            ));
        }
        let mut channels: Vec<(&String, &u64)> = self.channels.iter().collect();
        channels.sort_by(|a, b| b.1.cmp(a.1).then(a.0.cmp(b.0)));
        if !channels.is_empty() {
            let names: Vec<&str> =
                channels.iter().take(CHANNELS_NAMED).map(|(name, _)| name.as_str()).collect();
            lines.push(format!("            channels that fit worst: {}", names.join(", ")));
        }
        lines.extend(self.weakest.as_ref().map(|w| format!("            weakest meanwhile: {}", w.text())));
        lines.into_iter().map(|line| (self.from_s, line)).collect()
    }
}
