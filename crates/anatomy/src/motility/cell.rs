//! Cells: where spontaneous waves come from. Each is a renewal or a Poisson process of one stretch of the tract.

use super::complex::MotorComplex;
use super::fault::{Impairment, Organ};
use super::{RAMP_FRACTION, SHORTEST_RUN_M, Wave, tissue, uniform};
use crate::motility_config::Rhythm;
use crate::motility_limits::LARGEST_AMPLITUDE;
use lumenav_core::RandomStreams;

/// Cells of one rhythm: enough for 7 m of bowel in cells of 2 cm.
const MOST_CELLS: usize = 400;

/// How strong waves grow, over their strength at first (B).
const LARGEST_GROWTH: f64 = 2.0;

/// How far a wave that runs back over an organ's oral end goes beyond it, in widths: a capsule before it is then through.
const BACK_BEYOND_WIDTHS: f64 = 3.0;

/// A renewal process of contractions in one stretch of a segment.
#[derive(Debug, Clone)]
pub(super) struct Cell {
    pub(super) name: String,
    start_m: f64,
    length_m: f64,
    /// As [`Site::origins`].
    origins: Option<Origins>,
    /// The centre of a wave stays in here, m.
    limits_m: [f64; 2],
    pub(super) rate_hz: f64,
    /// Delay of the MMC front, s; `None` where the MMC has no say, and the cell rather than the tissue is refractory.
    front_delay_s: Option<f64>,
    pub(super) rhythm: Rhythm,
    /// Its waves run to the pylorus and may open it.
    pub(super) is_antral: bool,
    /// Its waves would start before the organ and come in over its end.
    comes_in: bool,
    impairments: Vec<Impairment>,
    bursts: Option<Bursts>,
    /// As [`Wave::acts_from_m`].
    acts_from_m: f64,
    growth: Option<Growth>,
    pub(super) sequence: u64,
    pub(super) next_time_s: f64,
}

/// Where the waves of a whole stretch arise and form: a part of them evenly from the first to the middle place, the others evenly from there to
/// the last, m.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Origins {
    pub(crate) first_m: f64,
    pub(crate) middle_m: f64,
    pub(crate) last_m: f64,
    pub(crate) first_part: f64,
    /// They run out of the tract in full strength, however far it is.
    pub(crate) run_out: bool,
}

impl Origins {
    /// Where a wave arises, m, from a uniform number.
    fn at(&self, uniform: f64) -> f64 {
        if uniform < self.first_part {
            self.first_m + uniform / self.first_part * (self.middle_m - self.first_m)
        } else {
            let part = (uniform - self.first_part) / (1.0 - self.first_part);
            self.middle_m + part * (self.last_m - self.middle_m)
        }
    }
}

/// Waves that grow stronger as time goes by, as those of an oesophagus in which something stays do.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Growth {
    pub(crate) from_s: f64,
    pub(crate) per_s: f64,
}

impl Growth {
    /// Strength over that at the start.
    fn at(&self, time_s: f64) -> f64 {
        (1.0 + self.per_s * (time_s - self.from_s).max(0.0)).min(LARGEST_GROWTH)
    }
}

/// When a stretch contracts at all: one burst somewhere in each period.
#[derive(Debug, Clone)]
struct Bursts {
    /// Name of their random stream.
    name: String,
    burst_s: f64,
    period_s: f64,
    /// Time in a period at t = 0, s: no hour is quiet in all people.
    phase_s: f64,
}

impl Bursts {
    /// Whether one runs at `time_s`.
    fn run_at(&self, streams: &RandomStreams, time_s: f64) -> bool {
        let time_s = time_s + self.phase_s;
        let index = (time_s / self.period_s).floor().max(0.0);
        let begins_s =
            uniform(&mut streams.stream(&self.name, index as u64)) * (self.period_s - self.burst_s);
        let since_s = time_s - index * self.period_s - begins_s;
        (0.0..self.burst_s).contains(&since_s)
    }
}

impl Cell {
    /// To the next event, s, from a uniform number.
    pub(super) fn interval_s(&self, uniform: f64) -> f64 {
        let (period_s, dead) = (1.0 / self.rate_hz, self.rhythm.refractory_fraction);
        let exponential = -(1.0 - uniform).ln();
        match self.front_delay_s {
            Some(_) => period_s * exponential / self.proposals(1.0),
            None => period_s * (dead + (1.0 - dead) * exponential),
        }
    }

    /// From t = 0 to the first event of a process that has always run, s. A Poisson process has no memory; of a renewal process with intervals
    /// of the distribution F and mean 1/f the density of the wait is f (1 - F).
    fn first_interval_s(&self, uniform: f64) -> f64 {
        let dead = self.rhythm.refractory_fraction;
        match self.front_delay_s {
            Some(_) => self.interval_s(uniform),
            None if uniform < dead => uniform / self.rate_hz,
            None => (dead - (1.0 - dead) * (1.0 - (uniform - dead) / (1.0 - dead)).ln()) / self.rate_hz,
        }
    }

    /// Part of the events that is kept.
    pub(super) fn kept_part(&self, cycle: &MotorComplex, time_s: f64) -> f64 {
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
    pub(super) fn refractory_s(&self) -> Option<f64> {
        self.front_delay_s.map(|_| self.rhythm.refractory_fraction / self.rate_hz)
    }

    /// Moves on to the next event and returns the wave of the present one, if it is kept.
    pub(super) fn fire(&mut self, streams: &RandomStreams, cycle: &MotorComplex) -> Option<Wave> {
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
        strength *= self.growth.map_or(1.0, |growth| growth.at(time_s));
        if let Some(meal) = self.front_delay_s.and_then(|_| cycle.meal_at(time_s)) {
            strength *= meal.amplitude_factor.0;
        }
        let aboral = direction < rhythm.aboral_fraction * Impairment::aboral(&self.impairments, time_s);
        let beyond_m = if Impairment::turns(&self.impairments, time_s) {
            BACK_BEYOND_WIDTHS * rhythm.width_m
        } else {
            0.0
        };
        let drawn_run_m = rhythm.run_m[0] + length * (rhythm.run_m[1] - rhythm.run_m[0]);
        let way = match self.origins {
            Some(origins) => self.way_from(&origins, place, drawn_run_m),
            None => self.way_of(self.start_m + place * self.length_m, aboral, drawn_run_m, beyond_m)?,
        };
        (way.run_m >= SHORTEST_RUN_M).then(|| Wave {
            start_time_s: time_s,
            start_arc_length_m: way.start_m,
            speed_m_s: if aboral { rhythm.speed_m_s } else { -rhythm.speed_m_s },
            duration_s: way.forms_s + way.run_m / rhythm.speed_m_s,
            width_m: rhythm.width_m,
            amplitude: rhythm.amplitude.map(|a| (a * strength).min(LARGEST_AMPLITUDE)),
            flattens_ahead_m: rhythm.flattens_ahead_m,
            yields: rhythm.yields,
            forms_s: way.forms_s,
            acts_from_m: self.acts_from_m,
        })
    }

    /// The way of a wave that rises as it goes. What would come in over the oral end starts there, with what is left of its run.
    /// What runs back ends there, or `beyond_m` before it.
    fn way_of(&self, start_m: f64, aboral: bool, wanted_m: f64, beyond_m: f64) -> Option<Way> {
        let before_m = (self.limits_m[0] - start_m).max(0.0);
        if before_m > 0.0 && !aboral {
            return None;
        }
        let (start_m, wanted_m) = (start_m + before_m, wanted_m - before_m);
        let back_m = start_m - self.limits_m[0];
        if !aboral && back_m < wanted_m {
            return Some(Way { start_m, run_m: back_m + beyond_m, forms_s: 0.0 });
        }
        let free_m = if aboral { self.limits_m[1] - start_m } else { back_m };
        Some(Way { start_m, run_m: wanted_m.min(free_m), forms_s: 0.0 })
    }

    /// The aboral way of a wave that forms where it arises.
    fn way_from(&self, origins: &Origins, place: f64, run_m: f64) -> Way {
        let start_m = origins.at(place);
        let speed_m_s = self.rhythm.speed_m_s;
        let forms_s = RAMP_FRACTION * run_m / speed_m_s;
        let free_m = self.limits_m[1] - start_m;
        // What runs out begins to fade there: with the time T of it all, (1 - ρ) T - F takes it to the end.
        let out_m = (free_m + RAMP_FRACTION * forms_s * speed_m_s) / (1.0 - RAMP_FRACTION);
        Way { start_m, run_m: if origins.run_out { out_m } else { run_m.min(free_m) }, forms_s }
    }
}

/// Where a wave goes.
struct Way {
    start_m: f64,
    run_m: f64,
    /// As [`Wave::forms_s`].
    forms_s: f64,
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
    /// As [`Wave::acts_from_m`].
    pub(crate) acts_from_m: f64,
    /// How its waves grow stronger, if they do.
    pub(crate) growth: Option<Growth>,
}

impl Site {
    /// Cells of waves that rise on their way, all the time, wherever they run.
    pub(crate) fn new(name: impl Into<String>, organ: Organ, span_m: [f64; 2], rhythm: Rhythm) -> Self {
        Self {
            name: name.into(),
            organ,
            span_m,
            limits_m: span_m,
            rhythm,
            front_delay_s: None,
            whole: false,
            origins: None,
            bursts: None,
            acts_from_m: f64::NEG_INFINITY,
            growth: None,
        }
    }
}

pub(super) fn site_cells(
    site: &Site,
    impairments: &[Impairment],
    streams: &RandomStreams,
    cells: &mut Vec<Cell>,
) {
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
            acts_from_m: site.acts_from_m,
            growth: site.growth,
            bursts: site.bursts.map(|[burst_s, period_s]| {
                let name = format!("{}/bursts", site.name);
                let phase_s = period_s * uniform(&mut streams.stream(&format!("{name}/phase"), 0));
                Bursts { name, burst_s, period_s, phase_s }
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
        cell.next_time_s = cell.first_interval_s(first);
        cells.push(cell);
    }
}
