//! What the numbers of `[motility]` may be: wide of any gut, narrow enough that the waves of a tract can be counted.
//!
//! Nothing in a gut contracts faster than its slow waves, 12 per minute in the duodenum; 2 Hz is ten times that. Without a bound
//! a slip of the pen (a rate of 1e9) would make the renewal processes enumerate for ever.

use crate::error::AnatomyError;
use crate::motility::tissue;
use crate::motility_config::{MotilityConfig, Rhythm, WaveConfig};

/// Largest amplitude of one wave: the radius law closes the lumen by 98 % at most.
pub(crate) const LARGEST_AMPLITUDE: f64 = 0.98;
/// Fastest rate at one place, 1/s.
const FASTEST_HZ: f64 = 2.0;
/// Fastest growth of waves, 1/s: to twice within a second.
const FASTEST_GROWTH_PER_S: f64 = 1.0;
/// Speeds of a travelling wave, m/s. The slowest wave known creeps at a millimetre a second.
const SPEEDS_M_S: [f64; 2] = [1e-5, 1.0];
/// Widths, m.
const WIDTHS_M: [f64; 2] = [1e-3, 0.5];
/// Runs, m: to the length of a cadaver's bowel.
const RUNS_M: [f64; 2] = [1e-3, 10.0];
/// Durations, s: the longest run at the slowest speed.
const DURATIONS_S: [f64; 2] = [1e-3, 1e6];
/// Times of scheduled waves, s.
const LATEST_S: f64 = 1e9;
/// Periods of the migrating motor complex, s.
const PERIODS_S: [f64; 2] = [60.0, 1e6];
/// No cycle is shorter than a twentieth of the mean.
const LARGEST_PERIOD_SPREAD: f64 = 0.95;
/// Part of the time in bursts: for none there is the rate; and their length, s.
const LEAST_BURSTS: f64 = 1e-3;
const BURSTS_S: [f64; 2] = [1.0, 1e6];
/// What a defecation runs at most, m.
const LONGEST_COLON_M: f64 = 3.0;
/// Defecations per day: one runs for a minute or two.
const MOST_DEFECATIONS: f64 = 100.0;
/// Waves of one cell that may run at a time, on average: a stomach has three.
const MOST_AT_ONCE: f64 = 20.0;

pub(crate) fn in_range(name: &'static str, value: f64, low: f64, high: f64) -> Result<(), AnatomyError> {
    if (low..=high).contains(&value) {
        Ok(())
    } else {
        Err(AnatomyError::OutOfRange { name, value, low, high })
    }
}

fn among(name: &'static str, value: f64, [low, high]: [f64; 2]) -> Result<(), AnatomyError> {
    in_range(name, value, low, high)
}

pub(crate) fn positive(name: &'static str, value: f64) -> Result<(), AnatomyError> {
    if value > 0.0 { Ok(()) } else { Err(AnatomyError::NotPositive { name, value }) }
}

/// Keys of one rhythm, under `[motility]`.
struct Keys {
    rate: &'static str,
    speed: &'static str,
    amplitude: &'static str,
    width: &'static str,
    run: &'static str,
}

macro_rules! keys {
    ($table:literal) => {
        Keys {
            rate: concat!($table, ".rate_hz"),
            speed: concat!($table, ".speed_m_s"),
            amplitude: concat!($table, ".amplitude"),
            width: concat!($table, ".width_m"),
            run: concat!($table, ".run_m"),
        }
    };
}

const OESOPHAGUS: Keys = Keys {
    rate: "oesophagus.further_rate_hz",
    speed: "oesophagus.speed_m_s",
    amplitude: "oesophagus.amplitude",
    width: "oesophagus.width_m",
    run: "oesophagus.speed_m_s",
};

const HAUSTRAL: Keys = Keys {
    rate: "colon.haustral_rate_hz",
    speed: "colon.haustral_speed_m_s",
    amplitude: "colon.haustral_amplitude",
    width: "colon.haustral_width_m",
    run: "colon.haustral_run_m",
};

const MASS: Keys = Keys {
    rate: "colon.mass_rate_per_day",
    speed: "colon.mass_speed_m_s",
    amplitude: "colon.mass_amplitude",
    width: "colon.mass_width_m",
    run: "colon.mass_run_m",
};

const RETROGRADE: Keys = Keys {
    rate: "colon.retrograde_rectosigmoid_rate_hz",
    speed: "colon.retrograde_speed_m_s",
    amplitude: "colon.retrograde_amplitude",
    width: "colon.haustral_width_m",
    run: "colon.retrograde_run_m",
};

fn check_rhythm(keys: &Keys, rhythm: &Rhythm) -> Result<(), AnatomyError> {
    for rate_hz in rhythm.rate_hz {
        in_range(keys.rate, rate_hz, 0.0, FASTEST_HZ)?;
    }
    among(keys.speed, rhythm.speed_m_s, SPEEDS_M_S)?;
    for amplitude in rhythm.amplitude {
        in_range(keys.amplitude, amplitude, 0.0, LARGEST_AMPLITUDE)?;
    }
    among(keys.width, rhythm.width_m, WIDTHS_M)?;
    for run_m in rhythm.run_m {
        among(keys.run, run_m, RUNS_M)?;
    }
    let at_once =
        rhythm.rate_hz[0].max(rhythm.rate_hz[1]) * rhythm.run_m[0].max(rhythm.run_m[1]) / rhythm.speed_m_s;
    if at_once > MOST_AT_ONCE {
        return Err(AnatomyError::TooManyWaves { name: keys.speed, at_once, limit: MOST_AT_ONCE });
    }
    Ok(())
}

/// A scheduled wave, once its duration is known.
pub(crate) fn check_wave(wave: &WaveConfig, duration_s: f64) -> Result<(), AnatomyError> {
    in_range("start_time_s", wave.start_time_s.0, 0.0, LATEST_S)?;
    in_range("speed_m_s", wave.speed_m_s.0, -SPEEDS_M_S[1], SPEEDS_M_S[1])?;
    if let Some(run_m) = wave.run_m {
        among("run_m", run_m.0, RUNS_M)?;
    }
    let name = if wave.duration_s.is_some() { "duration_s" } else { "speed_m_s (run_m / speed_m_s, s)" };
    among(name, duration_s, DURATIONS_S)?;
    among("width_m", wave.width_m.0, WIDTHS_M)?;
    in_range("flattens_ahead_m", wave.flattens_ahead_m.0, 0.0, RUNS_M[1])
}

impl MotilityConfig {
    /// Refuses what lies outside its range; scheduled waves are looked at when they are resolved.
    pub(crate) fn check(&self) -> Result<(), AnatomyError> {
        for (index, fault) in self.fault.iter().enumerate() {
            let in_fault = |error| AnatomyError::InFault { index, error: Box::new(error) };
            fault.check().map_err(in_fault)?;
            if self.fault[..index].iter().any(|other| other.overlaps(fault)) {
                return Err(in_fault(AnatomyError::Overlap { name: "start_s" }));
            }
        }
        for (index, meal) in self.meal.iter().enumerate() {
            let in_meal = |error| AnatomyError::InMeal { index, error: Box::new(error) };
            meal.check().map_err(in_meal)?;
            if self.meal[..index].iter().any(|other| other.overlaps(meal)) {
                return Err(in_meal(AnatomyError::Overlap { name: "start_s" }));
            }
        }
        among("mmc.period_s", self.mmc.period_s.0, PERIODS_S)?;
        in_range("mmc.period_spread", self.mmc.period_spread.0, 0.0, LARGEST_PERIOD_SPREAD)?;
        let sum: f64 = self.mmc.fractions.iter().map(|fraction| fraction.0).sum();
        in_range("mmc.fractions (their sum)", sum, 0.999, 1.001)?;
        in_range("oesophagus.swallow_time_s", self.oesophagus.swallow_time_s.0, 0.0, LATEST_S)?;
        in_range(
            "oesophagus.further_growth_per_s",
            self.oesophagus.further_growth_per_s.0,
            0.0,
            FASTEST_GROWTH_PER_S,
        )?;
        among("oesophagus.speed_m_s", self.oesophagus.speed_m_s.0, SPEEDS_M_S)?;
        in_range("oesophagus.amplitude", self.oesophagus.amplitude.0, 0.0, LARGEST_AMPLITUDE)?;
        among("oesophagus.width_m", self.oesophagus.width_m.0, WIDTHS_M)?;
        check_rhythm(&OESOPHAGUS, &self.oesophagus.further())?;
        in_range("pylorus.closure", self.pylorus.closure.0, 0.0, LARGEST_AMPLITUDE)?;
        among("pylorus.width_m", self.pylorus.width_m.0, WIDTHS_M)?;
        in_range("pylorus.ahead_m", self.pylorus.ahead_m.0, 0.0, RUNS_M[1])?;
        among("pylorus.open_s", self.pylorus.open_s.0, DURATIONS_S)?;
        check_rhythm(&keys!("stomach"), &self.stomach.rhythm())?;
        check_rhythm(&keys!("duodenum"), &self.duodenum.rhythm())?;
        check_rhythm(&keys!("jejunum"), &self.jejunum.rhythm())?;
        check_rhythm(&keys!("ileum"), &self.ileum.rhythm())?;
        check_rhythm(&keys!("terminal_ileum"), &self.terminal_ileum.rhythm())?;
        for (key, rhythm) in [
            ("duodenum.refractory_fraction", self.duodenum.rhythm()),
            ("jejunum.refractory_fraction", self.jejunum.rhythm()),
            ("ileum.refractory_fraction", self.ileum.rhythm()),
            ("terminal_ileum.refractory_fraction", self.terminal_ileum.rhythm()),
        ] {
            in_range(key, rhythm.refractory_fraction, 0.0, tissue::LARGEST_PART)?;
        }
        let colon = &self.colon;
        check_rhythm(&HAUSTRAL, &colon.haustral())?;
        in_range(MASS.rate, colon.mass_rate_per_day.0, 0.0, 86_400.0 * FASTEST_HZ)?;
        check_rhythm(&MASS, &colon.mass())?;
        in_range("colon.mass_flattens_ahead_m", colon.mass_flattens_ahead_m.0, 0.0, RUNS_M[1])?;
        let defecation = Rhythm { run_m: [LONGEST_COLON_M; 2], ..colon.defecation() };
        check_rhythm(&Keys { rate: "colon.defecation_rate_per_day", ..MASS }, &defecation)?;
        in_range("colon.burst_fraction", colon.burst_fraction.0, LEAST_BURSTS, 1.0)?;
        among("colon.burst_s", colon.burst_s.0, BURSTS_S)?;
        in_range("colon.defecation_rate_per_day", colon.defecation_rate_per_day.0, 0.0, MOST_DEFECATIONS)?;
        check_rhythm(&RETROGRADE, &colon.retrograde())
    }
}
