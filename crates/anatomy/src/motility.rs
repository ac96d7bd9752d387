//! Motility: when, where and how strongly the wall contracts.
//!
//! A contraction is a travelling [`Wave`]: it starts at arc length `s_j` at time `t_j`, travels with the signed speed `v_j` for
//! the time `T_j` and narrows the lumen by the fraction
//!
//! ```text
//! a_j(x) G((s - s_j - v_j (t - t_j)) / w_j) E(x)        x = (t - t_j) / T_j
//! G(u) = exp(-u²/2)    E(x) = S(x/ρ) S((1 - x)/ρ)    S(y) = 3 y² - 2 y³ on [0, 1]    ρ = 0.15
//! ```
//!
//! A mass movement forms where it arises before it travels: `s_j` for the time `F` it takes, with `E(x) = S((t - t_j) / F) S((1 - x)/ρ)`, and acts in the
//! colon alone. `a_j` goes linearly from the first to the last amplitude, both times a strength that is drawn for each wave, evenly within the rhythm's
//! spread about 1. [`crate::lumen`] sums the waves to a radius.
//!
//! Waves are scheduled (`[[motility.wave]]`, also the first swallow) or spontaneous (also the swallows that follow). Spontaneous waves come from *cells*: a segment
//! is cut into cells of the mean run of its waves, and each cell is a renewal process with dead time `r/f` and an exponential
//! remainder of mean `(1 - r)/f`, so that every place sees contractions at the published frequency `f`; in the colon, where contractions come in
//! bursts, during one. In the small bowel the tissue itself
//! is refractory ([`tissue`](self)), the cells are Poisson processes, and an event is kept with the probability that the migrating motor
//! complex (MMC, [`complex`](self)) gives its phase at that place and time; the phase travels aborally with the MMC front.
//!
//! The draws of event `n` of a cell come from the stream (cell's name, `n`) of [`RandomStreams`] alone. The waves are thus a
//! pure function of seed and time: no step size, no order of asking and no pause changes them, and memory is constant.
//!
//! Antral waves start at the pacemaker, a run before the pylorus, and may open it ([`crate::pylorus`]). At the oral end of the small bowel a place sees
//! as many waves as elsewhere: some come in from before, with what is left of their run.
//!
//! Neglected: coordination between neighbouring cells beyond the MMC and refractory tissue, the circadian rhythm of the colon,
//! and the three speeds along the oesophagus (one mean speed here).
//!
//! Numbers: (S) stated by a source, (B) believed. Sources: Kerlin and Phillips 1982 (small-bowel rates, MMC), Boiron et al.
//! (antral wave speed), Rao et al. (colon), Humphries and Castell 1977 (oesophagus).

use crate::error::AnatomyError;
use crate::motility_config::MotilityConfig;
use crate::pylorus::Gate;
use crate::tract::Tract;
use cell::{Cell, site_cells};
pub(crate) use cell::{Growth, Origins, Site};
use complex::MotorComplex;
use fault::{FaultConfig, Impairment};
use lumenav_core::{RandomStream, RandomStreams};
use rand::Rng as _;

mod cell;
mod complex;
pub mod fault;
pub mod meal;
pub(crate) mod tissue;

/// Part of a wave's duration that each smooth switch takes, ρ.
pub(crate) const RAMP_FRACTION: f64 = 0.15;
/// Runs that end at a segment's border sooner than this are not started, m.
const SHORTEST_RUN_M: f64 = 1e-3;

/// One travelling contraction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wave {
    /// When it starts, s.
    pub start_time_s: f64,
    /// Where its centre starts, arc length, m.
    pub start_arc_length_m: f64,
    /// Speed of its centre, m/s; positive is aboral.
    pub speed_m_s: f64,
    /// How long it lasts, s.
    pub duration_s: f64,
    /// Standard width w of its Gaussian, m.
    pub width_m: f64,
    /// Fraction of the radius it takes at its start and at its end.
    pub amplitude: [f64; 2],
    /// How far ahead of it haustra flatten, m; 0 for none.
    pub flattens_ahead_m: f64,
    /// Whether it is a haustral contraction, which relaxes where another wave flattens the haustra.
    pub yields: bool,
    /// How long it forms in one place before it travels, s; 0: it rises on its way.
    pub forms_s: f64,
    /// It acts from this arc length on, m: a contraction of the colon stops at the valve.
    pub acts_from_m: f64,
}

/// A wave at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WaveInstant {
    /// Arc length of the centre, m.
    pub centre_m: f64,
    /// Speed of the centre, m/s.
    pub speed_m_s: f64,
    /// 1/w, 1/m.
    pub per_width_per_m: f64,
    /// Fraction of the radius that it takes at its centre now.
    pub weight: f64,
    /// Rate of that fraction, 1/s.
    pub weight_rate_per_s: f64,
    /// The envelope E alone.
    pub envelope: f64,
    /// Its rate, 1/s.
    pub envelope_rate_per_s: f64,
    /// As [`Wave::flattens_ahead_m`].
    pub flattens_ahead_m: f64,
    /// As [`Wave::yields`].
    pub yields: bool,
    /// As [`Wave::acts_from_m`].
    pub acts_from_m: f64,
}

impl Wave {
    /// When it is over, s.
    pub fn end_time_s(&self) -> f64 {
        self.start_time_s + self.duration_s
    }

    /// Where its centre is at `time_s`, m.
    pub fn centre_m(&self, time_s: f64) -> f64 {
        self.start_arc_length_m + self.speed_m_s * (time_s - self.start_time_s - self.forms_s).max(0.0)
    }

    /// The wave at `time_s`; outside its time its weight is exactly zero.
    pub fn at(&self, time_s: f64) -> WaveInstant {
        let since_s = time_s - self.start_time_s;
        let x = since_s / self.duration_s;
        let rise_s = if self.forms_s > 0.0 { self.forms_s } else { RAMP_FRACTION * self.duration_s };
        let fall_s = RAMP_FRACTION * self.duration_s;
        let (on, on_rate) = smooth_step(since_s / rise_s);
        let (off, off_rate) = smooth_step((1.0 - x) / RAMP_FRACTION);
        let (envelope, envelope_rate_per_s) = (on * off, on_rate * off / rise_s - on * off_rate / fall_s);
        let [first, last] = self.amplitude;
        let amplitude = first + (last - first) * x;
        WaveInstant {
            centre_m: self.centre_m(time_s),
            speed_m_s: if since_s > self.forms_s { self.speed_m_s } else { 0.0 },
            per_width_per_m: 1.0 / self.width_m,
            weight: amplitude * envelope,
            weight_rate_per_s: (last - first) * envelope / self.duration_s + amplitude * envelope_rate_per_s,
            envelope,
            envelope_rate_per_s,
            flattens_ahead_m: self.flattens_ahead_m,
            yields: self.yields,
            acts_from_m: self.acts_from_m,
        }
    }
}

/// A uniform number in [0, 1): 53 bits of a stream, the usual way.
pub(crate) fn uniform(stream: &mut RandomStream) -> f64 {
    (stream.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
}

/// S(y) = 3y² - 2y³, clamped, and its derivative.
pub(crate) fn smooth_step(y: f64) -> (f64, f64) {
    if y <= 0.0 {
        (0.0, 0.0)
    } else if y >= 1.0 {
        (1.0, 0.0)
    } else {
        (y * y * (3.0 - 2.0 * y), 6.0 * y * (1.0 - y))
    }
}

/// The waves of a tract as time goes by.
#[derive(Debug, Clone)]
pub struct Motility {
    streams: RandomStreams,
    scheduled: Vec<Wave>,
    next_scheduled: usize,
    cells: Vec<Cell>,
    initial_cells: Vec<Cell>,
    cycle: MotorComplex,
    amplitude_scale: f64,
    taenia_relief: f64,
    gate: Option<Gate>,
    active: Vec<Wave>,
    time_s: f64,
    revision: u64,
    /// When the next event of a source is due, and when the first active wave ends, s: nothing changes before.
    next_event_s: f64,
    first_end_s: f64,
}

impl Motility {
    /// The motility of `tract` as configured; all randomness from `streams`.
    ///
    /// # Errors
    /// [`AnatomyError`]: a wave in no segment of the tract, or with values outside their range.
    pub fn new(
        config: &MotilityConfig,
        tract: &Tract,
        streams: &RandomStreams,
    ) -> Result<Self, AnatomyError> {
        config.check()?;
        for (index, fault) in config.fault.iter().enumerate() {
            let in_fault = |error| AnatomyError::InFault { index, error: Box::new(error) };
            fault.check_organs(tract).map_err(in_fault)?;
        }
        let mut scheduled = Vec::with_capacity(config.wave.len());
        for (index, wave) in config.wave.iter().enumerate() {
            let resolved = wave.resolve(tract);
            scheduled.push(resolved.map_err(|error| AnatomyError::InWave { index, error: Box::new(error) })?);
        }
        scheduled.extend(config.oesophagus.swallow(tract));
        scheduled.sort_by(|a, b| a.start_time_s.total_cmp(&b.start_time_s));
        let cycle = MotorComplex::new(&config.mmc, &config.meal, streams);
        let mut cells = Vec::new();
        if config.spontaneous && config.amplitude_scale.0 > 0.0 {
            for site in config.sites(tract) {
                site_cells(&site, &Impairment::of(&config.fault, site.organ), streams, &mut cells);
            }
        }
        let mut motility = Self {
            streams: streams.clone(),
            scheduled,
            next_scheduled: 0,
            initial_cells: cells.clone(),
            cells,
            cycle,
            amplitude_scale: config.amplitude_scale.0,
            taenia_relief: config.taenia_relief.0,
            gate: (config.spontaneous && config.amplitude_scale.0 > 0.0)
                .then(|| Gate::new(&config.pylorus, config.amplitude_scale.0, tract))
                .flatten()
                .map(|gate| gate.held_open(config.fault.iter().filter_map(FaultConfig::reflux_s))),
            active: Vec::with_capacity(256),
            time_s: 0.0,
            revision: 0,
            next_event_s: f64::NEG_INFINITY,
            first_end_s: f64::INFINITY,
        };
        motility.advance_to(0.0);
        Ok(motility)
    }

    /// Moves on to `time_s`. Earlier than before starts again from the beginning (for a resumed run).
    pub fn advance_to(&mut self, time_s: f64) {
        if time_s < self.time_s {
            self.cells.clone_from(&self.initial_cells);
            self.next_scheduled = 0;
            self.active.clear();
            if let Some(gate) = &mut self.gate {
                gate.openings_s.clear();
            }
            self.revision += 1;
            (self.next_event_s, self.first_end_s) = (f64::NEG_INFINITY, f64::INFINITY);
        }
        self.time_s = time_s;
        if time_s >= self.next_event_s {
            self.take_events(time_s);
        }
        if time_s >= self.first_end_s {
            self.active.retain(|wave| wave.end_time_s() > time_s);
            self.revision += 1;
            self.find_first_end();
        }
    }

    fn find_first_end(&mut self) {
        self.first_end_s = self.active.iter().map(Wave::end_time_s).fold(f64::INFINITY, f64::min);
    }

    /// Takes all events up to `time_s` in the order of their times.
    fn take_events(&mut self, time_s: f64) {
        loop {
            let (due_s, source) = self.earliest();
            self.next_event_s = due_s;
            if due_s > time_s {
                break;
            }
            let wave = match source {
                Source::Schedule => {
                    self.next_scheduled += 1;
                    self.scheduled.get(self.next_scheduled - 1).copied()
                }
                Source::Cell(index) => {
                    let cell = &mut self.cells[index];
                    let wave = cell.fire(&self.streams, &self.cycle);
                    let wave = match cell.refractory_s() {
                        Some(refractory_s) => {
                            wave.and_then(|wave| tissue::admit(wave, refractory_s, &self.active))
                        }
                        None => wave,
                    };
                    if let Some((gate, wave)) = self.gate.as_mut().zip(wave).filter(|_| cell.is_antral) {
                        let is_fed = self.cycle.meal_at(wave.start_time_s).is_some();
                        gate.schedule_opening(&wave, cell.sequence, &self.streams, is_fed);
                    }
                    wave
                }
            };
            // Without amplitude there is no wave: the tube is exactly the resting one.
            if let Some(mut wave) = wave.filter(|_| self.amplitude_scale > 0.0) {
                if self.active.len() >= 192 {
                    let start_s = wave.start_time_s;
                    self.active.retain(|old| old.end_time_s() > start_s);
                }
                wave.amplitude = wave.amplitude.map(|a| a * self.amplitude_scale);
                self.active.push(wave);
                self.revision += 1;
            }
        }
        self.find_first_end();
    }

    /// The earliest event to come and its source; schedule first, then cells in order.
    fn earliest(&self) -> (f64, Source) {
        let scheduled = self.scheduled.get(self.next_scheduled);
        let mut best = scheduled.map_or(f64::INFINITY, |wave| wave.start_time_s);
        let mut source = Source::Schedule;
        for (index, cell) in self.cells.iter().enumerate() {
            if cell.next_time_s < best {
                best = cell.next_time_s;
                source = Source::Cell(index);
            }
        }
        (best, source)
    }

    /// When the next event is due, s; infinite where there will be none.
    pub fn next_event_s(&self) -> f64 {
        self.next_event_s
    }

    /// The pylorus, where there is one that contracts.
    pub fn gate(&self) -> Option<&Gate> {
        self.gate.as_ref()
    }

    /// The scheduled waves, in the order in which they start; none where the amplitude is scaled to 0.
    pub fn scheduled(&self) -> &[Wave] {
        if self.amplitude_scale > 0.0 { &self.scheduled } else { &[] }
    }

    /// The waves that run now, in the order in which they started.
    pub fn active(&self) -> &[Wave] {
        &self.active
    }

    /// A number that changes whenever [`Motility::active`] does.
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// Relief of the colon's folds at the taeniae, 0 to 1.
    pub fn taenia_relief(&self) -> f64 {
        self.taenia_relief
    }

    /// Everything the waves follow from, as text (every cell with its rhythm): equal for motilities that will always agree.
    pub fn fingerprint_text(&self) -> String {
        format!(
            "{:?}{:?}{:?}{:?}{:?}{:?}{:?}",
            self.streams,
            self.gate.as_ref().map(Gate::law),
            self.scheduled,
            self.cycle,
            self.initial_cells,
            self.amplitude_scale,
            self.taenia_relief
        )
    }

    /// The time it stands at, s.
    pub fn time_s(&self) -> f64 {
        self.time_s
    }
}

/// Where the next event comes from.
enum Source {
    Schedule,
    Cell(usize),
}

#[cfg(test)]
mod tests;
