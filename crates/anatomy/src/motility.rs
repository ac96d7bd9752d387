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
//! `a_j` goes linearly from the first to the last amplitude, both times a strength that is drawn for each wave, evenly within the rhythm's
//! spread about 1. [`crate::lumen`] sums the waves to a radius.
//!
//! Waves are scheduled (`[[motility.wave]]`, also the first swallow) or spontaneous (also the swallows that follow). Spontaneous waves come from *cells*: a segment
//! is cut into cells of the mean run of its waves, and each cell is a renewal process with dead time `r/f` and an exponential
//! remainder of mean `(1 - r)/f`, so that every place sees contractions at the published frequency `f`; in the colon, where contractions come in
//! bursts, during one. In the small bowel the tissue itself
//! is refractory ([`tissue`](self)), the cells are Poisson processes, and an event is kept with the probability that the migrating motor
//! complex (MMC) gives its phase at that place and time; the phase travels aborally with the MMC front.
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
use crate::motility_config::{MotilityConfig, Rhythm};
use crate::motility_limits::LARGEST_AMPLITUDE;
use crate::pylorus::Gate;
use crate::tract::Tract;
use fault::{Impairment, Organ};
use lumenav_core::{RandomStream, RandomStreams};
use meal::MealConfig;
use rand::Rng as _;

pub mod fault;
pub mod meal;
pub(crate) mod tissue;

/// Part of a wave's duration that each smooth switch takes, ρ.
pub(crate) const RAMP_FRACTION: f64 = 0.15;
/// Runs that end at a segment's border sooner than this are not started, m.
const SHORTEST_RUN_M: f64 = 1e-3;
/// Cells of one rhythm: enough for 7 m of bowel in cells of 2 cm.
const MOST_CELLS: usize = 400;

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
}

impl Wave {
    /// When it is over, s.
    pub fn end_time_s(&self) -> f64 {
        self.start_time_s + self.duration_s
    }

    /// The wave at `time_s`; outside its time its weight is exactly zero.
    pub fn at(&self, time_s: f64) -> WaveInstant {
        let x = (time_s - self.start_time_s) / self.duration_s;
        let (on, on_rate) = smooth_step(x / RAMP_FRACTION);
        let (off, off_rate) = smooth_step((1.0 - x) / RAMP_FRACTION);
        let (envelope, envelope_rate) = (on * off, (on_rate * off - on * off_rate) / RAMP_FRACTION);
        let [first, last] = self.amplitude;
        let amplitude = first + (last - first) * x;
        WaveInstant {
            centre_m: self.start_arc_length_m + self.speed_m_s * (time_s - self.start_time_s),
            speed_m_s: self.speed_m_s,
            per_width_per_m: 1.0 / self.width_m,
            weight: amplitude * envelope,
            weight_rate_per_s: ((last - first) * envelope + amplitude * envelope_rate) / self.duration_s,
            envelope,
            envelope_rate_per_s: envelope_rate / self.duration_s,
            flattens_ahead_m: self.flattens_ahead_m,
            yields: self.yields,
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

/// The migrating motor complex: a phase in [0, 1) that travels aborally, but for the time of a meal.
#[derive(Debug, Clone)]
struct MotorComplex {
    meals: Vec<MealConfig>,
    period_s: f64,
    start_phase: f64,
    fractions: [f64; 3],
    rate_factors: [f64; 3],
}

impl MotorComplex {
    /// The meal that is digested at `time_s`; of several the first in the file.
    fn meal_at(&self, time_s: f64) -> Option<&MealConfig> {
        self.meals.iter().find(|meal| meal.lasts_at(time_s))
    }

    /// Rate factor at `time_s` where the front arrives `delay_s` late.
    fn factor(&self, time_s: f64, delay_s: f64) -> f64 {
        if let Some(meal) = self.meal_at(time_s) {
            return meal.rate_factor.0;
        }
        let phase = (self.start_phase + (time_s - delay_s) / self.period_s).rem_euclid(1.0);
        if phase < self.fractions[0] {
            self.rate_factors[0]
        } else if phase < self.fractions[0] + self.fractions[1] {
            self.rate_factors[1]
        } else {
            self.rate_factors[2]
        }
    }
}

/// A renewal process of contractions in one stretch of a segment.
#[derive(Debug, Clone)]
struct Cell {
    name: String,
    start_m: f64,
    length_m: f64,
    /// As [`Site::origins`].
    origins: Option<Origins>,
    /// The centre of a wave stays in here, m.
    limits_m: [f64; 2],
    rate_hz: f64,
    /// Delay of the MMC front, s; `None` where the MMC has no say, and the cell rather than the tissue is refractory.
    front_delay_s: Option<f64>,
    rhythm: Rhythm,
    /// Its waves run to the pylorus and may open it.
    is_antral: bool,
    /// Its waves would start before the organ and come in over its end.
    comes_in: bool,
    impairments: Vec<Impairment>,
    bursts: Option<Bursts>,
    sequence: u64,
    next_time_s: f64,
}

/// Places at which waves arise: a part of them evenly from the first to the middle one, the others evenly from there to the last, m.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Origins {
    pub(crate) places_m: [f64; 3],
    pub(crate) first_part: f64,
}

impl Origins {
    /// Where a wave arises, m, from a uniform number.
    fn at(&self, uniform: f64) -> f64 {
        let [first, middle, last] = self.places_m;
        if uniform < self.first_part {
            first + uniform / self.first_part * (middle - first)
        } else {
            middle + (uniform - self.first_part) / (1.0 - self.first_part) * (last - middle)
        }
    }
}

/// When a stretch contracts at all: one burst somewhere in each period.
#[derive(Debug, Clone)]
struct Bursts {
    /// Name of their random stream.
    name: String,
    burst_s: f64,
    period_s: f64,
}

impl Bursts {
    /// Whether one runs at `time_s`.
    fn run_at(&self, streams: &RandomStreams, time_s: f64) -> bool {
        let index = (time_s / self.period_s).floor().max(0.0);
        let begins_s =
            uniform(&mut streams.stream(&self.name, index as u64)) * (self.period_s - self.burst_s);
        let since_s = time_s - index * self.period_s - begins_s;
        (0.0..self.burst_s).contains(&since_s)
    }
}

impl Cell {
    /// To the next event, s, from a uniform number.
    fn interval_s(&self, uniform: f64) -> f64 {
        let (period_s, dead) = (1.0 / self.rate_hz, self.rhythm.refractory_fraction);
        let exponential = -(1.0 - uniform).ln();
        match self.front_delay_s {
            Some(_) => period_s * exponential / self.proposals(1.0),
            None => period_s * (dead + (1.0 - dead) * exponential),
        }
    }

    /// Part of the events that is kept.
    fn kept_part(&self, cycle: &MotorComplex, time_s: f64) -> f64 {
        let remaining = Impairment::remaining(&self.impairments, time_s);
        self.front_delay_s.map_or(remaining, |delay_s| {
            let factor = remaining * cycle.factor(time_s, delay_s);
            factor * self.proposals(factor) / self.proposals(1.0)
        })
    }

    /// Proposals per wave that starts, where the motor complex leaves the part `factor` of the rate.
    fn proposals(&self, factor: f64) -> f64 {
        let refractory = self.rhythm.refractory_fraction * factor;
        if self.comes_in {
            tissue::proposals_at_a_place(refractory * self.rhythm.aboral_fraction)
        } else {
            tissue::proposals(refractory)
        }
    }

    /// How long tissue does not contract again, s; `None` where it does not matter.
    fn refractory_s(&self) -> Option<f64> {
        self.front_delay_s.map(|_| self.rhythm.refractory_fraction / self.rate_hz)
    }

    /// Moves on to the next event and returns the wave of the present one, if it is kept.
    fn fire(&mut self, streams: &RandomStreams, cycle: &MotorComplex) -> Option<Wave> {
        let mut stream = streams.stream(&self.name, self.sequence);
        let [remainder, kept, place, direction, length, strength] =
            std::array::from_fn(|_| uniform(&mut stream));
        let (time_s, rhythm) = (self.next_time_s, self.rhythm);
        self.sequence += 1;
        self.next_time_s += self.interval_s(remainder);
        let rests = self.bursts.as_ref().is_some_and(|bursts| !bursts.run_at(streams, time_s));
        if rests || kept >= self.kept_part(cycle, time_s) {
            return None;
        }
        let mut strength = 1.0 + rhythm.amplitude_spread * (2.0 * strength - 1.0);
        if let Some(meal) = self.front_delay_s.and_then(|_| cycle.meal_at(time_s)) {
            strength *= meal.amplitude_factor.0;
        }
        let mut start_m =
            self.origins.map_or(self.start_m + place * self.length_m, |origins| origins.at(place));
        let aboral = direction < rhythm.aboral_fraction;
        let mut wanted_m = rhythm.run_m[0] + length * (rhythm.run_m[1] - rhythm.run_m[0]);
        // What would come in over the oral end starts there, with what is left of its run.
        let before_m = (self.limits_m[0] - start_m).max(0.0);
        if before_m > 0.0 && !aboral {
            return None;
        }
        (start_m, wanted_m) = (start_m + before_m, wanted_m - before_m);
        let free_m = if aboral { self.limits_m[1] - start_m } else { start_m - self.limits_m[0] };
        let run_m = wanted_m.min(free_m);
        (run_m >= SHORTEST_RUN_M).then(|| Wave {
            start_time_s: time_s,
            start_arc_length_m: start_m,
            speed_m_s: if aboral { rhythm.speed_m_s } else { -rhythm.speed_m_s },
            duration_s: run_m / rhythm.speed_m_s,
            width_m: rhythm.width_m,
            amplitude: rhythm.amplitude.map(|a| (a * strength).min(LARGEST_AMPLITUDE)),
            flattens_ahead_m: rhythm.flattens_ahead_m,
            yields: rhythm.yields,
        })
    }
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
        let mut scheduled = Vec::with_capacity(config.wave.len());
        for (index, wave) in config.wave.iter().enumerate() {
            let resolved = wave.resolve(tract);
            scheduled.push(resolved.map_err(|error| AnatomyError::InWave { index, error: Box::new(error) })?);
        }
        scheduled.extend(config.oesophagus.swallow(tract));
        scheduled.sort_by(|a, b| a.start_time_s.total_cmp(&b.start_time_s));
        let start_phase =
            config.mmc.start_phase.map_or_else(|| uniform(&mut streams.stream("mmc", 0)), |phase| phase.0);
        let cycle = MotorComplex {
            meals: config.meal.clone(),
            period_s: config.mmc.period_s.0,
            start_phase,
            fractions: config.mmc.fractions.map(|f| f.0),
            rate_factors: config.mmc.rate_factor.map(|f| f.0),
        };
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
                .flatten(),
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

/// A rhythm and the stretch of the tract that has it.
#[derive(Debug, Clone)]
pub(crate) struct Site {
    /// Name of its random streams.
    pub(crate) name: String,
    pub(crate) organ: Organ,
    /// The stretch, m.
    pub(crate) span_m: [f64; 2],
    /// Where waves may run, m.
    pub(crate) limits_m: [f64; 2],
    /// What happens there.
    pub(crate) rhythm: Rhythm,
    /// Delay of the MMC front at both ends of the stretch, s.
    pub(crate) front_delay_s: Option<[f64; 2]>,
    /// The whole stretch is one cell (events that seize the organ), or cells of the mean run.
    pub(crate) whole: bool,
    /// Of a whole stretch: where its waves arise, where not evenly over it.
    pub(crate) origins: Option<Origins>,
    /// Length of a burst and mean interval of bursts, s, where it does not contract all the time.
    pub(crate) bursts: Option<[f64; 2]>,
}

fn site_cells(site: &Site, impairments: &[Impairment], streams: &RandomStreams, cells: &mut Vec<Cell>) {
    let first = cells.len();
    let [shortest_m, longest_m] = site.rhythm.run_m;
    let mean_run_m = 0.5 * (shortest_m + longest_m);
    let count = |length_m: f64| ((length_m / mean_run_m).round() as usize).clamp(1, MOST_CELLS);
    let length_m = site.span_m[1] - site.span_m[0];
    if site.span_m[0] <= site.limits_m[0] && !site.whole {
        // At the oral end of an organ a place sees as many waves as elsewhere, some of which would have started as far before it as they run.
        let before_m = shortest_m.max(longest_m);
        let oral = [site.span_m[0] - before_m, before_m];
        stretch_cells(site, "before/", oral, count(before_m), streams, cells);
    }
    let wanted = if site.whole { 1 } else { count(length_m) };
    stretch_cells(site, "", [site.span_m[0], length_m], wanted, streams, cells);
    for cell in &mut cells[first..] {
        cell.impairments = impairments.to_vec();
    }
}

/// So many cells in the stretch of this start and length, m; `place` tells their names from those of other stretches.
fn stretch_cells(
    site: &Site,
    place: &str,
    [start_m, length_m]: [f64; 2],
    count: usize,
    streams: &RandomStreams,
    cells: &mut Vec<Cell>,
) {
    for index in 0..count {
        let cell_start_m = start_m + length_m * index as f64 / count as f64;
        let middle_m = cell_start_m + 0.5 * length_m / count as f64;
        let span_m = site.span_m[1] - site.span_m[0];
        let part = if span_m > 0.0 { ((middle_m - site.span_m[0]) / span_m).max(0.0) } else { 0.5 };
        let between = |ends: [f64; 2]| ends[0] + part * (ends[1] - ends[0]);
        let rate_hz = between(site.rhythm.rate_hz);
        if rate_hz <= 0.0 {
            continue;
        }
        let name = format!("{}/{place}{index}", site.name);
        let first = uniform(&mut streams.stream(&format!("{name}/first"), 0));
        let mut cell = Cell {
            name,
            start_m: cell_start_m,
            length_m: length_m / count as f64,
            origins: site.origins,
            bursts: site.bursts.map(|[burst_s, period_s]| Bursts {
                name: format!("{}/bursts", site.name),
                burst_s,
                period_s,
            }),
            limits_m: site.limits_m,
            rate_hz,
            front_delay_s: site.front_delay_s.map(between),
            rhythm: site.rhythm,
            is_antral: site.organ == Organ::Stomach,
            impairments: Vec::new(),
            comes_in: middle_m < site.limits_m[0],
            sequence: 0,
            next_time_s: 0.0,
        };
        // The first event of a renewal process that has always run is anywhere in the mean interval; a Poisson process has no memory.
        let has_memory = cell.front_delay_s.is_none();
        cell.next_time_s = if has_memory { first / rate_hz } else { cell.interval_s(first) };
        cells.push(cell);
    }
}

#[cfg(test)]
mod tests;
