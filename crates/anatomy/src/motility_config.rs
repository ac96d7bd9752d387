//! The `[motility]` table of a scenario: every number with a default and its source.
//!
//! (S) stated by a source, (B) believed, (T) tuned here (to what stands beside it). Rates are what one place sees.

use crate::error::AnatomyError;
use crate::motility::fault::{FaultConfig, Organ};
use crate::motility::meal::MealConfig;
use crate::motility::{Growth, RAMP_FRACTION, Site, Wave};
use crate::motility_limits::{LARGEST_AMPLITUDE, check_wave, in_range, positive};
use crate::segment::SegmentKey;
use crate::tract::Tract;
use lumenav_core::config::quantity::{Finite, Fraction, NonNegative, Positive};
use serde::{Deserialize, Serialize};

pub use colon::ColonConfig;

mod colon;

/// `[motility]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MotilityConfig {
    /// Factor on every amplitude, 0 to 1; 0 is a resting bowel. Default 1.
    pub amplitude_scale: Fraction,
    /// Whether segments contract by themselves; `false` leaves the scheduled waves alone. Default true.
    pub spontaneous: bool,
    /// Relief of the colon's folds at the three taeniae, 0 (rings, default: the published law has no angle) to 1.
    pub taenia_relief: Fraction,
    /// Scheduled waves, `[[motility.wave]]`.
    pub wave: Vec<WaveConfig>,
    /// What is out of order, `[[motility.fault]]`.
    pub fault: Vec<FaultConfig>,
    /// When the gut is fed, `[[motility.meal]]`; fasted without.
    pub meal: Vec<MealConfig>,
    /// The migrating motor complex of the small bowel.
    pub mmc: MmcConfig,
    /// The bolus wave of a swallow.
    pub oesophagus: OesophagusConfig,
    /// Antral waves.
    pub stomach: StomachConfig,
    /// The gate behind them.
    pub pylorus: PylorusConfig,
    /// Contractions of the duodenum.
    pub duodenum: DuodenumConfig,
    /// Contractions of the jejunum.
    pub jejunum: JejunumConfig,
    /// Contractions of the ileum.
    pub ileum: IleumConfig,
    /// Contractions of the terminal ileum.
    pub terminal_ileum: TerminalIleumConfig,
    /// Haustral contractions, mass movements and the retrograde pattern of the colon.
    pub colon: ColonConfig,
}

impl Default for MotilityConfig {
    fn default() -> Self {
        Self {
            amplitude_scale: Fraction(1.0),
            spontaneous: true,
            taenia_relief: Fraction(0.0),
            wave: Vec::new(),
            fault: Vec::new(),
            meal: Vec::new(),
            mmc: MmcConfig::default(),
            oesophagus: OesophagusConfig::default(),
            stomach: StomachConfig::default(),
            pylorus: PylorusConfig::default(),
            duodenum: DuodenumConfig::default(),
            jejunum: JejunumConfig::default(),
            ileum: IleumConfig::default(),
            terminal_ileum: TerminalIleumConfig::default(),
            colon: ColonConfig::default(),
        }
    }
}

/// `[[motility.wave]]`: one contraction at a given time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WaveConfig {
    /// When it starts, s.
    pub start_time_s: NonNegative,
    /// The segment from whose oral end `start_m` counts; the tract's start where it is not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub segment: Option<SegmentKey>,
    /// Where its centre starts, m. Default 0.
    #[serde(default = "zero")]
    pub start_m: Finite,
    /// Speed of its centre, m/s, positive aboral. Default 0.022, a propulsive sequence of the colon (S).
    #[serde(default = "mass_speed")]
    pub speed_m_s: Finite,
    /// How far it runs, m. Default 0.41, a propulsive sequence of the colon (S). A standing wave takes `duration_s` instead.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub run_m: Option<Positive>,
    /// How long it lasts, s, where `run_m` is not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub duration_s: Option<Positive>,
    /// Standard width of the Gaussian, m. Default 0.02, that of a mass movement (T).
    #[serde(default = "mass_width")]
    pub width_m: Positive,
    /// Fraction of the radius at its centre, at most 0.98. Default 0.95, a mass movement (T).
    #[serde(default = "mass_amplitude")]
    pub amplitude: Fraction,
    /// How far ahead of it the haustra of the colon flatten, m. Default 0.2, as before a mass movement (B).
    #[serde(default = "mass_flattening")]
    pub flattens_ahead_m: NonNegative,
}

fn zero() -> Finite {
    Finite(0.0)
}

fn mass_speed() -> Finite {
    Finite(ColonConfig::default().mass_speed_m_s.0)
}

fn mass_width() -> Positive {
    ColonConfig::default().mass_width_m
}

fn mass_amplitude() -> Fraction {
    ColonConfig::default().mass_amplitude
}

fn mass_flattening() -> NonNegative {
    ColonConfig::default().mass_flattens_ahead_m
}

impl WaveConfig {
    /// The wave along `tract`.
    pub(crate) fn resolve(&self, tract: &Tract) -> Result<Wave, AnatomyError> {
        let origin_m = match self.segment {
            None => 0.0,
            Some(key) => {
                span_of(tract, &[key]).map(|span| span[0]).ok_or_else(|| AnatomyError::NoSuchSegment {
                    asked: key.to_string(),
                    available: tract.segments.iter().map(|segment| segment.key).collect(),
                })?
            }
        };
        let start_arc_length_m = origin_m + self.start_m.0;
        in_range("start_m", start_arc_length_m, 0.0, tract.length_m())?;
        in_range("amplitude", self.amplitude.0, 0.0, LARGEST_AMPLITUDE)?;
        let speed_m_s = self.speed_m_s.0;
        let duration_s = match (self.duration_s, self.run_m) {
            (Some(duration), None) => duration.0,
            (None, run) => {
                let run_m = run.map_or(ColonConfig::default().mass_run_m.0, |run| run.0);
                positive("speed_m_s (without duration_s, its size)", speed_m_s.abs())?;
                run_m / speed_m_s.abs()
            }
            (Some(_), Some(run)) => {
                // Both given: the run has to be zero, which it is not; say which one to leave.
                return Err(AnatomyError::OutOfRange {
                    name: "run_m (beside duration_s: give one of the two)",
                    value: run.0,
                    low: 0.0,
                    high: 0.0,
                });
            }
        };
        check_wave(self, duration_s)?;
        Ok(Wave {
            start_time_s: self.start_time_s.0,
            start_arc_length_m,
            speed_m_s,
            duration_s,
            width_m: self.width_m.0,
            amplitude: [self.amplitude.0; 2],
            flattens_ahead_m: self.flattens_ahead_m.0,
            yields: false,
            forms_s: 0.0,
            acts_from_m: f64::NEG_INFINITY,
        })
    }
}

/// `[motility.mmc]`: the migrating motor complex.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MmcConfig {
    /// Mean period, s. Default 5820, 97 min (S).
    pub period_s: Positive,
    /// A cycle's length is drawn evenly from 1 less to 1 more this, times the mean period. Default 0.85: 15 to 179 min [S: 15 to 195 min].
    pub period_spread: Fraction,
    /// Part of the cycle at t = 0 that has passed at the start of the small bowel, 0 to 1; drawn from the seed where it is not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub start_phase: Option<Fraction>,
    /// Parts of the mean period in phases I, II and III; III lasts as long in every cycle. Default 0.55, 0.38, 0.07 [B: I 50 to 60 %, II 30 to 40 %, III 5 to 10 min].
    pub fractions: [Fraction; 3],
    /// Part of the full rate in phases I, II and III. Default 0 [S: no contractions in phase I], 0.2 [S: 2.5 per minute], 1.
    pub rate_factor: [Fraction; 3],
}

impl Default for MmcConfig {
    fn default() -> Self {
        Self {
            period_s: Positive(5820.0),
            period_spread: Fraction(0.85),
            start_phase: None,
            fractions: [Fraction(0.55), Fraction(0.38), Fraction(0.07)],
            rate_factor: [Fraction(0.0), Fraction(0.2), Fraction(1.0)],
        }
    }
}

/// `[motility.oesophagus]`: the wave that follows the swallow of the capsule, and those that follow it as long as something is felt.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OesophagusConfig {
    /// When the capsule is swallowed, s. Default 0.
    pub swallow_time_s: NonNegative,
    /// Further swallows and secondary waves, 1/s. Default 0.2: one in 5 s [T to 23.6 s supine, together with the next three].
    pub further_rate_hz: NonNegative,
    /// How much stronger they are for each second since the swallow, 1/s, up to twice as strong: what stays makes the oesophagus contract
    /// harder (S). Default 0.02 (T).
    pub further_growth_per_s: NonNegative,
    /// Mean speed, m/s. Default 0.031: about the harmonic mean of 0.030 (upper), 0.050 (middle) and 0.0215 (lower third) (S), which is 0.0301.
    pub speed_m_s: Positive,
    /// Amplitude. Default 0.36 [T: many a wave slides over a capsule that lies on its side].
    pub amplitude: Fraction,
    /// A wave's amplitude is drawn evenly from 1 less to 1 more this, times the usual. Default 0.6 (T).
    pub amplitude_spread: Fraction,
    /// Width, m. Default 0.018 (B).
    pub width_m: Positive,
}

impl Default for OesophagusConfig {
    fn default() -> Self {
        Self {
            swallow_time_s: NonNegative(0.0),
            further_rate_hz: NonNegative(0.2),
            further_growth_per_s: NonNegative(0.02),
            speed_m_s: Positive(0.031),
            amplitude: Fraction(0.36),
            amplitude_spread: Fraction(0.6),
            width_m: Positive(0.018),
        }
    }
}

impl OesophagusConfig {
    /// From a width before the mouth's end, so that a capsule there lies on the wave's front, to a width behind the cardia.
    fn span_m(&self, tract: &Tract) -> Option<[f64; 2]> {
        let [start_m, end_m] = span_of(tract, &[SegmentKey::Oesophagus])?;
        Some([start_m - self.width_m.0, end_m + self.width_m.0])
    }

    /// The wave of the swallow, `None` where the tract has no oesophagus.
    pub(crate) fn swallow(&self, tract: &Tract) -> Option<Wave> {
        let [start_m, end_m] = self.span_m(tract)?;
        Some(Wave {
            start_time_s: self.swallow_time_s.0,
            start_arc_length_m: start_m,
            speed_m_s: self.speed_m_s.0,
            duration_s: (end_m - start_m) / self.speed_m_s.0,
            width_m: self.width_m.0,
            amplitude: [self.amplitude.0; 2],
            flattens_ahead_m: 0.0,
            yields: false,
            forms_s: 0.0,
            acts_from_m: f64::NEG_INFINITY,
        })
    }

    /// The swallows that follow, each over the whole length.
    fn site(&self, tract: &Tract) -> Option<Site> {
        let [start_m, end_m] = self.span_m(tract)?;
        let rhythm = Rhythm { run_m: [end_m - start_m; 2], ..self.further() };
        let name = SegmentKey::Oesophagus.to_string();
        Some(Site {
            limits_m: [start_m, end_m],
            whole: true,
            growth: Some(Growth { from_s: self.swallow_time_s.0, per_s: self.further_growth_per_s.0 }),
            ..Site::new(name, Organ::Oesophagus, [start_m; 2], rhythm)
        })
    }

    pub(crate) fn further(&self) -> Rhythm {
        Rhythm {
            rate_hz: [self.further_rate_hz.0; 2],
            speed_m_s: self.speed_m_s.0,
            amplitude: [self.amplitude.0; 2],
            amplitude_spread: self.amplitude_spread.0,
            width_m: self.width_m.0,
            // An oesophagus of the size measured; that of the tract is put in its place.
            run_m: [0.23; 2],
            aboral_fraction: 1.0,
            refractory_fraction: 0.5,
            flattens_ahead_m: 0.0,
            yields: false,
        }
    }
}

/// `[motility.pylorus]`: the sphincter behind the stomach, closed but when an antral wave opens it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PylorusConfig {
    /// Fraction of the radius that it takes while closed. Default 0.9 (B).
    pub closure: Fraction,
    /// Its width (of a Gaussian), m. Default 0.004 (B).
    pub width_m: Positive,
    /// Part of the antral waves that open it. Default 0.012 [T to gastric emptying of a fasting capsule, median 22 min].
    pub opening_fraction: Fraction,
    /// How long it is open, s. Default 20 (B).
    pub open_s: Positive,
    /// How far before it the wave is in the middle of that time, m. Default 0.02 [B: a wave carries a capsule in front of it].
    pub ahead_m: NonNegative,
}

impl Default for PylorusConfig {
    fn default() -> Self {
        Self {
            closure: Fraction(0.9),
            width_m: Positive(0.004),
            opening_fraction: Fraction(0.012),
            open_s: Positive(20.0),
            ahead_m: NonNegative(0.02),
        }
    }
}

/// Contractions that recur at every place of a stretch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Rhythm {
    pub(crate) rate_hz: [f64; 2],
    pub(crate) speed_m_s: f64,
    pub(crate) amplitude: [f64; 2],
    /// A wave's amplitude is drawn evenly from 1 less to 1 more this of the usual.
    pub(crate) amplitude_spread: f64,
    pub(crate) width_m: f64,
    pub(crate) run_m: [f64; 2],
    pub(crate) aboral_fraction: f64,
    pub(crate) refractory_fraction: f64,
    pub(crate) flattens_ahead_m: f64,
    pub(crate) yields: bool,
}

macro_rules! rhythm_table {
    ($(#[$doc:meta])* $name:ident, rate $rate:expr, $rate_doc:literal; speed $speed:expr, $speed_doc:literal;
     amplitude $amplitude:expr, $amplitude_doc:literal; spread $spread:expr; width $width:expr; run $run:expr; aboral $aboral:expr;
     refractory $refractory:expr) => {
        $(#[$doc])*
        #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields, default)]
        pub struct $name {
            #[doc = $rate_doc]
            pub rate_hz: [NonNegative; 2],
            #[doc = $speed_doc]
            pub speed_m_s: Positive,
            #[doc = $amplitude_doc]
            pub amplitude: [Fraction; 2],
            #[doc = concat!("A wave's amplitude is drawn evenly from 1 less to 1 more this, times the usual. Default ", stringify!($spread), ".")]
            pub amplitude_spread: Fraction,
            #[doc = concat!("Width of the Gaussian, m. Default ", stringify!($width), " (B).")]
            pub width_m: Positive,
            #[doc = concat!("Shortest and longest run, m. Default ", stringify!($run), " [B; T to transit in jejunum and ileum].")]
            pub run_m: [Positive; 2],
            #[doc = concat!("Part of the waves that travel aborally. Default ", stringify!($aboral), " [B; T to transit in jejunum and ileum].")]
            pub aboral_fraction: Fraction,
            #[doc = concat!("Dead time as a part of the mean interval (of a place in the small bowel, at most 0.7; of a wave's source in the stomach). Default ", stringify!($refractory), " [B: slow waves pace it].")]
            pub refractory_fraction: Fraction,
        }

        impl Default for $name {
            fn default() -> Self {
                Self {
                    rate_hz: $rate.map(NonNegative),
                    speed_m_s: Positive($speed),
                    amplitude: $amplitude.map(Fraction),
                    amplitude_spread: Fraction($spread),
                    width_m: Positive($width),
                    run_m: $run.map(Positive),
                    aboral_fraction: Fraction($aboral),
                    refractory_fraction: Fraction($refractory),
                }
            }
        }

        impl $name {
            pub(crate) fn rhythm(&self) -> Rhythm {
                Rhythm {
                    rate_hz: self.rate_hz.map(|rate| rate.0),
                    speed_m_s: self.speed_m_s.0,
                    amplitude: self.amplitude.map(|a| a.0),
                    amplitude_spread: self.amplitude_spread.0,
                    width_m: self.width_m.0,
                    run_m: self.run_m.map(|run| run.0),
                    aboral_fraction: self.aboral_fraction.0,
                    refractory_fraction: self.refractory_fraction.0,
                    flattens_ahead_m: 0.0,
                    yields: false,
                }
            }
        }
    };
}

rhythm_table!(
    /// `[motility.stomach]`: antral waves, which grow on their way to the pylorus.
    StomachConfig,
    rate [0.0517, 0.0517], "Rate at the oral and the aboral end, 1/s. Default 0.0517: 3.1 per minute (S).";
    speed 0.0024, "Speed, m/s. Default 0.0024 (0 to 0.014) (S).";
    amplitude [0.5, 0.95], "Amplitude at start and end of a run. Default 0.5 (corpus) to 0.95 (antrum) [T to a capsule that reaches the pylorus].";
    spread 0.0; width 0.012; run [0.12, 0.12]; aboral 1.0; refractory 0.9
);
rhythm_table!(
    /// `[motility.duodenum]`.
    DuodenumConfig,
    rate [0.208, 0.208], "Rate in phase III at both ends, 1/s. Default 0.208: 12.5 per minute [S, upper bound].";
    speed 0.008, "Speed, m/s. Default 0.008 [T to small-bowel transit].";
    amplitude [0.72, 0.72], "Amplitude at start and end of a run. Default 0.72 [T: to the radius of a contracted jejunum, in a wider lumen].";
    spread 0.15; width 0.010; run [0.02, 0.15]; aboral 0.85; refractory 0.5
);
rhythm_table!(
    /// `[motility.jejunum]`.
    JejunumConfig,
    rate [0.208, 0.175], "Rate in phase III at both ends, 1/s. Default 12.5 to 10.5 per minute (S).";
    speed 0.008, "Speed, m/s. Default 0.008 [T to small-bowel transit].";
    amplitude [0.55, 0.55], "Amplitude at start and end of a run. Default 0.55 [T to small-bowel transit].";
    spread 0.15; width 0.010; run [0.02, 0.071]; aboral 0.76; refractory 0.5
);
rhythm_table!(
    /// `[motility.ileum]`.
    IleumConfig,
    rate [0.182, 0.155], "Rate in phase III at both ends, 1/s. Default 10.9 to 9.3 per minute (S).";
    speed 0.006, "Speed, m/s. Default 0.006 [T to small-bowel transit].";
    amplitude [0.55, 0.55], "Amplitude at start and end of a run. Default 0.55 [T to small-bowel transit].";
    spread 0.15; width 0.010; run [0.02, 0.043]; aboral 0.72; refractory 0.5
);
rhythm_table!(
    /// `[motility.terminal_ileum]`.
    TerminalIleumConfig,
    rate [0.167, 0.143], "Rate in phase III at both ends, 1/s. Default 10.0 to 8.6 per minute (S).";
    speed 0.005, "Speed, m/s. Default 0.005 [T to small-bowel transit].";
    amplitude [0.65, 0.65], "Amplitude at start and end of a run. Default 0.65 [T to small-bowel transit: the lumen widens towards the valve].";
    spread 0.15; width 0.010; run [0.02, 0.05]; aboral 0.8; refractory 0.5
);

/// Speed of the MMC front in duodenum and jejunum, ileum and terminal ileum, m/s: 4.7, 1.3 and 0.9 cm/min (S).
const MMC_FRONT_M_S: [(SegmentKey, f64); 4] = [
    (SegmentKey::Duodenum, 7.8e-4),
    (SegmentKey::Jejunum, 7.8e-4),
    (SegmentKey::Ileum, 2.2e-4),
    (SegmentKey::TerminalIleum, 1.5e-4),
];

impl MotilityConfig {
    /// What begins and ends at times that are set, s, in words: faults and meals.
    pub fn announcements(&self) -> Vec<(f64, String)> {
        let faults = self.fault.iter().flat_map(|fault| {
            let name = fault.kind.as_str();
            let begins =
                format!("{name} begins, {:.0} % of the contractions are left", 100.0 * fault.remaining.0);
            let ends = fault.end_s.map(|end_s| (end_s.0, format!("{name} ends")));
            std::iter::once((fault.start_s.0, begins)).chain(ends)
        });
        let meals = self.meal.iter().flat_map(|meal| {
            [
                (meal.start_s.0, "a meal is digested".to_owned()),
                (meal.end_s(), "the meal is digested, fasted again".to_owned()),
            ]
        });
        faults.chain(meals).collect()
    }

    /// Everything that contracts by itself in `tract`.
    pub(crate) fn sites(&self, tract: &Tract) -> Vec<Site> {
        let mut sites: Vec<Site> = self.oesophagus.site(tract).into_iter().collect();
        sites.extend(self.antrum(tract));
        let mut delay_s = 0.0;
        for segment in &tract.segments {
            let rhythm = match segment.key {
                SegmentKey::Duodenum => self.duodenum.rhythm(),
                SegmentKey::Jejunum => self.jejunum.rhythm(),
                SegmentKey::Ileum => self.ileum.rhythm(),
                SegmentKey::TerminalIleum => self.terminal_ileum.rhythm(),
                _ => continue,
            };
            let front_delay_s =
                MMC_FRONT_M_S.iter().find(|(key, _)| *key == segment.key).map(|(_, speed)| {
                    let start_s = delay_s;
                    delay_s += segment.length_m() / speed;
                    [start_s, delay_s]
                });
            let span_m = [segment.start_m, segment.end_m];
            // Waves of the small bowel run on into the next part of it.
            let limits_m = small_bowel(tract).unwrap_or(span_m);
            let organ = if segment.key == SegmentKey::Duodenum { Organ::Duodenum } else { Organ::SmallBowel };
            let site = Site::new(segment.key.to_string(), organ, span_m, rhythm);
            sites.push(Site { limits_m, front_delay_s, ..site });
        }
        self.colon.sites(tract, &mut sites);
        sites
    }

    /// Antral waves: from the pacemaker, a run before the pylorus, and beyond the pylorus only while they fade.
    fn antrum(&self, tract: &Tract) -> Option<Site> {
        let [start_m, end_m] = span_of(tract, &[SegmentKey::Stomach])?;
        let rhythm = self.stomach.rhythm();
        let run_m = rhythm.run_m.map(|run_m| run_m.min(end_m - start_m) / (1.0 - RAMP_FRACTION));
        let pacemaker_m = end_m - run_m[0] * (1.0 - RAMP_FRACTION);
        let name = SegmentKey::Stomach.to_string();
        Some(Site {
            limits_m: [start_m, end_m + RAMP_FRACTION * run_m[1]],
            whole: true,
            ..Site::new(name, Organ::Stomach, [pacemaker_m; 2], Rhythm { run_m, ..rhythm })
        })
    }
}

fn small_bowel(tract: &Tract) -> Option<[f64; 2]> {
    use SegmentKey::{Duodenum, Ileum, Jejunum, TerminalIleum};
    span_of(tract, &[Duodenum, Jejunum, Ileum, TerminalIleum])
}

/// From the start of the first to the end of the last of these segments that the tract has.
pub(crate) fn span_of(tract: &Tract, keys: &[SegmentKey]) -> Option<[f64; 2]> {
    let mut found = tract.segments.iter().filter(|segment| keys.contains(&segment.key));
    let first = found.next()?;
    let last = found.next_back().unwrap_or(first);
    Some([first.start_m, last.end_m])
}
