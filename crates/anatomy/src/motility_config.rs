//! The `[motility]` table of a scenario: every number with a default and its source.
//!
//! (S) stated by a source, (B) believed, (T) tuned here (to what stands beside it). Rates are what one place sees.

use crate::error::AnatomyError;
use crate::motility::fault::{FaultConfig, Organ};
use crate::motility::meal::MealConfig;
use crate::motility::{Origins, RAMP_FRACTION, Site, Wave};
use crate::motility_limits::{LARGEST_AMPLITUDE, check_wave, in_range, positive};
use crate::segment::SegmentKey;
use crate::tract::Tract;
use lumenav_core::config::quantity::{Finite, Fraction, NonNegative, Positive};
use serde::{Deserialize, Serialize};

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
        })
    }
}

/// `[motility.mmc]`: the migrating motor complex.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MmcConfig {
    /// Period, s. Default 5820 (97 min; 15 to 195 min across people) (S).
    pub period_s: Positive,
    /// Phase at t = 0 at the start of the small bowel, 0 to 1; drawn from the seed where it is not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub start_phase: Option<Fraction>,
    /// Parts of the period in phases I, II and III. Default 0.55, 0.38, 0.07 [B: I 50 to 60 %, II 30 to 40 %, III 5 to 10 min].
    pub fractions: [Fraction; 3],
    /// Part of the full rate in phases I, II and III. Default 0 [S: no contractions in phase I], 0.2 [S: 2.5 per minute], 1.
    pub rate_factor: [Fraction; 3],
}

impl Default for MmcConfig {
    fn default() -> Self {
        Self {
            period_s: Positive(5820.0),
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
    /// Further swallows and secondary waves, 1/s. Default 0.27: one in 3.7 s [T to 23.6 s supine].
    pub further_rate_hz: NonNegative,
    /// Mean speed, m/s. Default 0.031: harmonic mean of 0.030 (upper), 0.050 (middle) and 0.0215 (lower third) (S).
    pub speed_m_s: Positive,
    /// Amplitude. Default 0.42 [T to 23.6 s supine, with its spread: many a wave slides over a capsule that lies on its side].
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
            further_rate_hz: NonNegative(0.27),
            speed_m_s: Positive(0.031),
            amplitude: Fraction(0.42),
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
        })
    }

    /// The swallows that follow, each over the whole length.
    fn site(&self, tract: &Tract) -> Option<Site> {
        let [start_m, end_m] = self.span_m(tract)?;
        Some(Site {
            name: SegmentKey::Oesophagus.to_string(),
            organ: Organ::Oesophagus,
            span_m: [start_m; 2],
            limits_m: [start_m, end_m],
            rhythm: Rhythm { run_m: [end_m - start_m; 2], ..self.further() },
            front_delay_s: None,
            whole: true,
            origins: None,
            bursts: None,
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
            #[doc = concat!("Part of the waves that travel aborally. Default ", stringify!($aboral), " (B).")]
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
    amplitude [0.555, 0.555], "Amplitude at start and end of a run. Default 0.555 [T to small-bowel transit].";
    spread 0.15; width 0.010; run [0.02, 0.107]; aboral 0.85; refractory 0.5
);
rhythm_table!(
    /// `[motility.ileum]`.
    IleumConfig,
    rate [0.182, 0.155], "Rate in phase III at both ends, 1/s. Default 10.9 to 9.3 per minute (S).";
    speed 0.006, "Speed, m/s. Default 0.006 [T to small-bowel transit].";
    amplitude [0.555, 0.555], "Amplitude at start and end of a run. Default 0.555 [T to small-bowel transit].";
    spread 0.15; width 0.010; run [0.02, 0.067]; aboral 0.8; refractory 0.5
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

/// `[motility.colon]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ColonConfig {
    /// Part of the time in which a segment's haustra contract, and its retrograde waves run; 1: always. Default 0.2 [B: scant contractions with
    /// infrequent bursts, S, doi:10.1152/ajpgi.1989.257.4.G601].
    pub burst_fraction: Fraction,
    /// Length of a burst of them, s. Default 300 (B).
    pub burst_s: Positive,
    /// Haustral contractions at one place in a burst, 1/s. Default 0.05: 3 per minute (S).
    pub haustral_rate_hz: NonNegative,
    /// Their speed, m/s. Default 0.002 (B).
    pub haustral_speed_m_s: Positive,
    /// Their amplitude. Default 0.3 (B).
    pub haustral_amplitude: Fraction,
    /// Their width, m. Default 0.010, a third of the distance between haustra (B).
    pub haustral_width_m: Positive,
    /// Their shortest and longest run, m. Default 0.01 to 0.03, up to one haustrum (B).
    pub haustral_run_m: [Positive; 2],
    /// Part of them that travels aborally. Default 0.5 (B).
    pub haustral_aboral_fraction: Fraction,
    /// Mass movements per day: propulsive sequences. Default 24 [T to colonic transit]. Those of high amplitude, above 105 mmHg, are 6.9 to 10 (S),
    /// but sequences that propelled had 50 mmHg in the mean and were a third of all (S, doi:10.1152/ajpgi.2000.278.2.G329).
    pub mass_rate_per_day: NonNegative,
    /// Their speed, m/s. Default 0.022: 2.2 ± 0.3 cm/s [S, doi:10.1152/ajpgi.2000.278.2.G329].
    pub mass_speed_m_s: Positive,
    /// Their run, m. Default 0.41: 41 ± 6 cm [S, the same].
    pub mass_run_m: Positive,
    /// Their amplitude. Default 0.95 [T, together with the width].
    pub mass_amplitude: Fraction,
    /// Their width, m. Default 0.02 [T: a sequence moves content by 0.25 m (S), in generated colons and in one measured; one of
    /// 0.9 and 0.03 slides over a capsule in bends of 20 mm. Only the pushing front is modelled: in manometry the wall stays
    /// contracted for more than 14 s behind it].
    pub mass_width_m: Positive,
    /// How far ahead of them haustra flatten, m. Default 0.2 [B; after Guyton and Hall, Textbook of Medical
    /// Physiology, where some 20 cm of colon distal to the constriction lose their haustra].
    pub mass_flattens_ahead_m: NonNegative,
    /// Part of them that arises in the caecum; the others arise evenly from there to the sigmoid. Default 0.3 [T to colonic
    /// transit; S that they arise more often proximally, doi:10.1152/ajpgi.2000.278.2.G329].
    pub mass_caecal_fraction: Fraction,
    /// Defecations per day: a mass movement that runs out. Default 1 [S, doi:10.1136/gut.33.6.818: the commonest habit]. Half of them begin
    /// before the sigmoid, the furthest in the ascending colon; the shortest take three fifths of sigmoid and rectum (S, PMID 12780911).
    pub defecation_rate_per_day: NonNegative,
    /// Retrograde waves of sigmoid and rectum at one place in a burst, 1/s. Default 0.05: 3 per minute (S).
    pub retrograde_rectosigmoid_rate_hz: NonNegative,
    /// Their speed, m/s. Default 0.005 (B).
    pub retrograde_speed_m_s: Positive,
    /// Their amplitude. Default 0.3 (B).
    pub retrograde_amplitude: Fraction,
    /// Their run, m. Default 0.05 (B).
    pub retrograde_run_m: Positive,
}

impl Default for ColonConfig {
    fn default() -> Self {
        Self {
            burst_fraction: Fraction(0.2),
            burst_s: Positive(300.0),
            haustral_rate_hz: NonNegative(0.05),
            haustral_speed_m_s: Positive(0.002),
            haustral_amplitude: Fraction(0.3),
            haustral_width_m: Positive(0.010),
            haustral_run_m: [Positive(0.01), Positive(0.03)],
            haustral_aboral_fraction: Fraction(0.5),
            mass_rate_per_day: NonNegative(24.0),
            mass_speed_m_s: Positive(0.022),
            mass_run_m: Positive(0.41),
            mass_amplitude: Fraction(0.95),
            mass_width_m: Positive(0.02),
            mass_flattens_ahead_m: NonNegative(0.2),
            mass_caecal_fraction: Fraction(0.3),
            defecation_rate_per_day: NonNegative(1.0),
            retrograde_rectosigmoid_rate_hz: NonNegative(0.05),
            retrograde_speed_m_s: Positive(0.005),
            retrograde_amplitude: Fraction(0.3),
            retrograde_run_m: Positive(0.05),
        }
    }
}

impl ColonConfig {
    pub(crate) fn haustral(&self) -> Rhythm {
        Rhythm {
            rate_hz: [self.haustral_rate_hz.0; 2],
            speed_m_s: self.haustral_speed_m_s.0,
            amplitude: [self.haustral_amplitude.0; 2],
            amplitude_spread: 0.0,
            width_m: self.haustral_width_m.0,
            run_m: self.haustral_run_m.map(|run| run.0),
            aboral_fraction: self.haustral_aboral_fraction.0,
            refractory_fraction: 0.5,
            flattens_ahead_m: 0.0,
            yields: true,
        }
    }

    pub(crate) fn mass(&self) -> Rhythm {
        Rhythm {
            rate_hz: [self.mass_rate_per_day.0 / 86_400.0; 2],
            speed_m_s: self.mass_speed_m_s.0,
            amplitude: [self.mass_amplitude.0; 2],
            amplitude_spread: 0.0,
            width_m: self.mass_width_m.0,
            run_m: [self.mass_run_m.0; 2],
            aboral_fraction: 1.0,
            refractory_fraction: 0.05,
            flattens_ahead_m: self.mass_flattens_ahead_m.0,
            yields: false,
        }
    }

    /// What empties the rectum; how far it runs is the site's matter.
    fn defecation(&self) -> Rhythm {
        Rhythm {
            rate_hz: [self.defecation_rate_per_day.0 / 86_400.0; 2],
            // A habit (B).
            refractory_fraction: 0.5,
            ..self.mass()
        }
    }

    pub(crate) fn retrograde(&self) -> Rhythm {
        Rhythm {
            rate_hz: [self.retrograde_rectosigmoid_rate_hz.0; 2],
            speed_m_s: self.retrograde_speed_m_s.0,
            amplitude: [self.retrograde_amplitude.0; 2],
            amplitude_spread: 0.0,
            width_m: self.haustral_width_m.0,
            run_m: [self.retrograde_run_m.0; 2],
            aboral_fraction: 0.0,
            refractory_fraction: 0.6,
            flattens_ahead_m: 0.0,
            yields: true,
        }
    }

    fn sites(&self, tract: &Tract, sites: &mut Vec<Site>) {
        use SegmentKey::{Ascending, Caecum, Descending, Rectum, Sigmoid, Transverse};
        let all = [Caecum, Ascending, Transverse, Descending, Sigmoid, Rectum];
        let Some(limits_m) = span_of(tract, &all) else { return };
        let site = |name: &str, span_m, rhythm, whole| Site {
            name: name.to_owned(),
            organ: Organ::Colon,
            span_m,
            limits_m,
            rhythm,
            front_delay_s: None,
            whole,
            origins: None,
            bursts: None,
        };
        let bursts = Some([self.burst_s.0, self.burst_s.0 / self.burst_fraction.0]);
        let bursts = bursts.filter(|_| self.burst_fraction.0 < 1.0);
        for segment in tract.segments.iter().filter(|s| s.key.is_colon() && s.key != Rectum) {
            let name = format!("haustra/{}", segment.key);
            let haustra = site(&name, [segment.start_m, segment.end_m], self.haustral(), false);
            sites.push(Site { bursts, ..haustra });
        }
        // Mass movements arise before the sigmoid, three quarters of them before the splenic flexure, and run over what lies behind. Those of the
        // caecum rise while their centre is still before it: a capsule at its bottom lies on the front of the whole wave.
        let [start_m, end_m] =
            span_of(tract, &[Caecum, Ascending, Transverse, Descending]).unwrap_or(limits_m);
        let caecal_m = start_m - RAMP_FRACTION * self.mass_run_m.0;
        let places_m = [caecal_m, caecal_m, end_m];
        sites.push(Site {
            origins: Some(Origins { places_m, first_part: self.mass_caecal_fraction.0 }),
            limits_m: [caecal_m, limits_m[1]],
            ..site("mass", [start_m, end_m], self.mass(), true)
        });
        sites.extend(self.defecations(tract, site("defecation", limits_m, self.defecation(), true)));
        if let Some(span_m) = span_of(tract, &[Sigmoid, Rectum]) {
            sites.push(Site { bursts, ..site("retrograde", span_m, self.retrograde(), false) });
        }
    }

    /// Defecations, of a tract with a way out: in full strength to the end, beyond which they fade.
    fn defecations(&self, tract: &Tract, site: Site) -> Option<Site> {
        use SegmentKey::{Ascending, Caecum, Rectum, Sigmoid};
        let [first_m, end_m] = span_of(tract, &[Sigmoid, Rectum])?;
        // Emptied at most: all but four fifths of caecum and ascending colon; at least: three fifths of sigmoid and rectum.
        let highest_m = match span_of(tract, &[Caecum, Ascending]) {
            Some([start_m, end_m]) => end_m - 0.19 * (end_m - start_m),
            None => site.limits_m[0].min(first_m),
        };
        let lowest_m = end_m - 0.6 * (end_m - first_m);
        // In full strength where it begins, too: it rises before.
        let run_m = (end_m - highest_m) / (1.0 - 2.0 * RAMP_FRACTION);
        let places_m = [highest_m, first_m, lowest_m].map(|place_m| place_m - RAMP_FRACTION * run_m);
        Some(Site {
            origins: Some(Origins { places_m, first_part: 0.5 }),
            limits_m: [places_m[0], places_m[0] + run_m],
            rhythm: Rhythm { run_m: [run_m; 2], ..site.rhythm },
            ..site
        })
    }
}

impl MotilityConfig {
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
            let (name, whole) = (segment.key.to_string(), false);
            let organ = Organ::SmallBowel;
            let (origins, bursts) = (None, None);
            sites.push(Site { name, organ, span_m, limits_m, rhythm, front_delay_s, whole, origins, bursts });
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
        Some(Site {
            name: SegmentKey::Stomach.to_string(),
            organ: Organ::Stomach,
            span_m: [pacemaker_m; 2],
            limits_m: [start_m, end_m + RAMP_FRACTION * run_m[1]],
            rhythm: Rhythm { run_m, ..rhythm },
            front_delay_s: None,
            whole: true,
            origins: None,
            bursts: None,
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
