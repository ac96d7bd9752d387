//! `[motility.colon]`: haustra in bursts, mass movements, defecations, retrograde waves.

use crate::motility::fault::Organ;
use crate::motility::{Origins, Site};
use crate::motility_config::{Rhythm, span_of};
use crate::segment::SegmentKey;
use crate::tract::{End, Tract};
use lumenav_core::config::quantity::{Fraction, NonNegative, Positive};
use serde::{Deserialize, Serialize};

/// What a defecation empties (S, PMID 12780911): at most this part of caecum and ascending colon with all that lies behind; in the median
/// sigmoid and rectum; at least that part of these.
const MOST_EMPTIED: f64 = 0.19;
const LEAST_EMPTIED: f64 = 0.6;

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
    pub(crate) fn defecation(&self) -> Rhythm {
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

    pub(super) fn sites(&self, tract: &Tract, sites: &mut Vec<Site>) {
        use SegmentKey::{Ascending, Caecum, Descending, Rectum, Sigmoid, Transverse};
        let all = [Caecum, Ascending, Transverse, Descending, Sigmoid, Rectum];
        let Some(limits_m) = span_of(tract, &all) else { return };
        let site = |name: &str, span_m, rhythm| Site {
            limits_m,
            acts_from_m: limits_m[0],
            ..Site::new(name, Organ::Colon, span_m, rhythm)
        };
        let bursts = Some([self.burst_s.0, self.burst_s.0 / self.burst_fraction.0]);
        let bursts = bursts.filter(|_| self.burst_fraction.0 < 1.0);
        for segment in tract.segments.iter().filter(|s| s.key.is_colon() && s.key != Rectum) {
            let name = format!("haustra/{}", segment.key);
            let haustra = site(&name, [segment.start_m, segment.end_m], self.haustral());
            sites.push(Site { bursts, ..haustra });
        }
        // Mass movements arise before the sigmoid, three quarters of them before the splenic flexure, and run over what lies behind.
        let [start_m, end_m] =
            span_of(tract, &[Caecum, Ascending, Transverse, Descending]).unwrap_or(limits_m);
        let origins = Origins {
            first_m: start_m,
            middle_m: start_m,
            last_m: end_m,
            first_part: self.mass_caecal_fraction.0,
            run_out: false,
        };
        let mass = site("mass", [start_m, end_m], self.mass());
        sites.push(Site { whole: true, origins: Some(origins), ..mass });
        if let Some(origins) = Self::defecations(tract, limits_m[0]) {
            let defecation = site("defecation", limits_m, self.defecation());
            sites.push(Site { whole: true, origins: Some(origins), ..defecation });
        }
        if let Some(span_m) = span_of(tract, &[Sigmoid, Rectum]) {
            sites.push(Site { bursts, ..site("retrograde", span_m, self.retrograde()) });
        }
    }

    /// Where defecations begin, in a tract with a way out; `first_m`: where the colon does.
    fn defecations(tract: &Tract, first_m: f64) -> Option<Origins> {
        use SegmentKey::{Ascending, Caecum, Rectum, Sigmoid};
        let [sigmoid_m, end_m] = span_of(tract, &[Sigmoid, Rectum])?;
        if tract.ends.1 != End::Exit || end_m < tract.length_m() {
            return None;
        }
        let highest_m = span_of(tract, &[Caecum, Ascending])
            .map_or(first_m, |[start_m, end_m]| end_m - MOST_EMPTIED * (end_m - start_m));
        Some(Origins {
            first_m: highest_m.min(sigmoid_m),
            middle_m: sigmoid_m,
            last_m: end_m - LEAST_EMPTIED * (end_m - sigmoid_m),
            first_part: 0.5,
            run_out: true,
        })
    }
}
