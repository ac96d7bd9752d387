//! The pylorus: a sphincter that stands closed until an antral wave opens it.
//!
//! It narrows the lumen like a standing contraction at the stomach's end, by the fraction
//!
//! ```text
//! a G((s - s_p)/w) [1 - Σ_k O((t - t_k)/T)]        O(x) = S(4 (x + ½)) S(4 (½ - x))
//! ```
//!
//! with t_k when the k-th wave that opens it has come within `ahead_m` of it (what the wave pushes arrives before the wave) and T how long it is
//! open. Which waves do is drawn from the stream (`pylorus`, number of
//! the wave): with a fixed part p of them a capsule that is carried to the pylorus by every wave leaves after a geometrically distributed number.
//!
//! While a meal is digested ([`crate::motility::meal`]) no wave opens it to something as large as a capsule.
//!
//! In reflux ([`crate::motility::fault`]) it is held open: its closure then goes, and comes back, within a quarter of T.
//!
//! Neglected: coordination with the duodenum, that it lets small things through while it is closed.

use crate::motility::{Wave, WaveInstant, smooth_step, uniform};
use crate::motility_config::PylorusConfig;
use crate::segment::SegmentKey;
use crate::tract::Tract;
use lumenav_core::RandomStreams;
use std::collections::VecDeque;

/// The sphincter and when it is open.
#[derive(Debug, Clone)]
pub struct Gate {
    place_m: f64,
    closure: f64,
    width_m: f64,
    opening_fraction: f64,
    open_s: f64,
    ahead_m: f64,
    /// While contents come back through it, s.
    held_open_s: Vec<[f64; 2]>,
    /// Middles of the openings to come and present, s.
    pub(crate) openings_s: VecDeque<f64>,
}

impl Gate {
    /// `None` where no stomach opens into something.
    pub(crate) fn new(config: &PylorusConfig, scale: f64, tract: &Tract) -> Option<Self> {
        let stomach = tract.segments.iter().position(|segment| segment.key == SegmentKey::Stomach)?;
        tract.segments.get(stomach + 1)?;
        Some(Self {
            place_m: tract.segments[stomach].end_m,
            closure: config.closure.0 * scale,
            width_m: config.width_m.0,
            opening_fraction: config.opening_fraction.0,
            open_s: config.open_s.0,
            ahead_m: config.ahead_m.0,
            held_open_s: Vec::new(),
            openings_s: VecDeque::with_capacity(8),
        })
    }

    /// The same, held open at these times.
    pub(crate) fn held_open(self, times_s: impl Iterator<Item = [f64; 2]>) -> Self {
        Self { held_open_s: times_s.collect(), ..self }
    }

    /// An antral wave has started: it opens the gate before it arrives, or does not (never while a meal is digested).
    pub(crate) fn schedule_opening(
        &mut self,
        wave: &Wave,
        sequence: u64,
        streams: &RandomStreams,
        is_fed: bool,
    ) {
        let over_s = wave.start_time_s - self.open_s;
        while self.openings_s.front().is_some_and(|middle_s| *middle_s < over_s) {
            self.openings_s.pop_front();
        }
        if !is_fed && uniform(&mut streams.stream("pylorus", sequence)) < self.opening_fraction {
            let way_m = self.place_m - self.ahead_m - wave.start_arc_length_m;
            self.openings_s.push_back(wave.start_time_s + way_m / wave.speed_m_s);
        }
    }

    /// The closure at a time, as a wave that stands.
    pub fn at(&self, time_s: f64) -> WaveInstant {
        let (mut open, mut rate) = (0.0, 0.0);
        for middle_s in &self.openings_s {
            let x = (time_s - middle_s) / self.open_s;
            let (on, on_rate) = smooth_step(4.0 * (x + 0.5));
            let (off, off_rate) = smooth_step(4.0 * (0.5 - x));
            open += on * off;
            rate += 4.0 * (on_rate * off - on * off_rate) / self.open_s;
        }
        let edge_s = 0.25 * self.open_s;
        for [from_s, to_s] in &self.held_open_s {
            let (on, on_rate) = smooth_step((time_s - from_s) / edge_s);
            let (off, off_rate) = smooth_step((to_s - time_s) / edge_s);
            open += on * off;
            rate += (on_rate * off - on * off_rate) / edge_s;
        }
        // Two waves may open it at a time.
        let (open, rate) = if open >= 1.0 { (1.0, 0.0) } else { (open, rate) };
        WaveInstant {
            centre_m: self.place_m,
            speed_m_s: 0.0,
            per_width_per_m: 1.0 / self.width_m,
            weight: self.closure * (1.0 - open),
            weight_rate_per_s: -self.closure * rate,
            envelope: 1.0 - open,
            envelope_rate_per_s: -rate,
            flattens_ahead_m: 0.0,
            yields: false,
            acts_from_m: f64::NEG_INFINITY,
        }
    }

    /// Until when it stands as it is, s; the present time where it moves.
    pub(crate) fn still_until_s(&self, now_s: f64) -> f64 {
        if !self.openings_s.is_empty() {
            return now_s;
        }
        let edge_s = 0.25 * self.open_s;
        let moves_s = self.held_open_s.iter().flat_map(|[from_s, to_s]| [*from_s, to_s - edge_s]);
        let next_s = moves_s.filter(|start_s| start_s + edge_s > now_s).fold(f64::INFINITY, f64::min);
        next_s.max(now_s)
    }

    /// Width of the Gaussian, m.
    pub(crate) fn width_m(&self) -> f64 {
        self.width_m
    }

    /// Where it is, arc length, m.
    pub fn place_m(&self) -> f64 {
        self.place_m
    }

    /// What its openings follow from.
    pub(crate) fn law(&self) -> ([f64; 6], &[[f64; 2]]) {
        let numbers =
            [self.place_m, self.closure, self.width_m, self.opening_fraction, self.open_s, self.ahead_m];
        (numbers, &self.held_open_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_tracts::stomach_and_duodenum;

    fn gate(opening_fraction: f64) -> Gate {
        let mut config = PylorusConfig::default();
        config.opening_fraction.0 = opening_fraction;
        Gate::new(&config, 1.0, &stomach_and_duodenum(0.015)).unwrap()
    }

    fn wave(start_time_s: f64) -> Wave {
        Wave {
            start_time_s,
            start_arc_length_m: 0.08,
            speed_m_s: 0.0024,
            duration_s: 60.0,
            width_m: 0.012,
            amplitude: [0.5, 0.9],
            flattens_ahead_m: 0.0,
            yields: false,
            forms_s: 0.0,
            acts_from_m: f64::NEG_INFINITY,
        }
    }

    #[test]
    fn law_it_opens_before_the_wave_arrives_and_its_rate_is_the_derivative() {
        let mut gate = gate(1.0);
        assert_eq!((gate.at(3.0).weight, gate.at(3.0).weight_rate_per_s), (0.9, 0.0));
        gate.schedule_opening(&wave(100.0), 1, &RandomStreams::new(1, 0, "m"), false);
        // 100 mm from the pacemaker to 20 mm before the pylorus.
        let middle_s = 100.0 + 0.1 / 0.0024;
        assert!(gate.at(middle_s).weight.abs() < 1e-12);
        assert!([-11.0, 11.0].iter().all(|after_s| gate.at(middle_s + after_s).weight == 0.9));
        for k in 0..200 {
            let t = middle_s - 12.0 + 0.12 * f64::from(k);
            let difference = (gate.at(t + 1e-6).weight - gate.at(t - 1e-6).weight) / 2e-6;
            assert!((gate.at(t).weight_rate_per_s - difference).abs() < 1e-5, "at {t} s");
        }
    }

    #[test]
    fn law_the_stated_part_of_the_waves_opens_it_whatever_is_forgotten() {
        let streams = RandomStreams::new(7, 0, "m");
        let mut gate = gate(0.1);
        let mut opened = 0;
        let waves = 4000;
        for k in 0..waves {
            let before = gate.openings_s.back().copied();
            gate.schedule_opening(&wave(19.0 * k as f64), k, &streams, false);
            opened += u32::from(gate.openings_s.back().is_some_and(|last| before != Some(*last)));
            assert!(gate.openings_s.len() < 8);
        }
        // Binomial: 400 with a standard deviation of 19.
        assert!((i64::from(opened) - 400).abs() < 76, "{opened}");
    }
}
