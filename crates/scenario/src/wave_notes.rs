//! Notes on scheduled contractions: when one starts, reaches the capsule, and leaves it. What carries a capsule is also what makes it
//! hard to track; `lumenav explain` puts these notes beside gaps, refusals and large errors.

use crate::world::WorldNote;
use lumenav_anatomy::motility::{Motility, Wave};
use lumenav_core::SimTime;

/// A contraction is at the capsule when its centre is nearer than so many widths: there it narrows the lumen by more than 1 %
/// (`exp(-3²/2)`).
const REACHED_WIDTHS: f64 = 3.0;
/// And leaves it beyond so many: one that pushes the capsule ahead of it does not come and go.
const LEFT_WIDTHS: f64 = 4.0;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    Waiting,
    Away,
    AtCapsule,
    Over,
}

const STAGES: [Stage; 4] = [Stage::Waiting, Stage::Away, Stage::AtCapsule, Stage::Over];

/// The scheduled contractions, each with where it stands.
pub(crate) struct WaveWatch {
    waves: Vec<(Wave, Stage)>,
}

impl WaveWatch {
    pub(crate) fn new(motility: &Motility) -> Self {
        Self { waves: motility.scheduled().iter().map(|wave| (*wave, Stage::Waiting)).collect() }
    }

    /// Where each stands, in the order in which they are scheduled.
    pub(crate) fn stages(&self) -> Vec<u8> {
        self.waves
            .iter()
            .map(|(_, stage)| STAGES.iter().position(|one| one == stage).unwrap_or(0) as u8)
            .collect()
    }

    /// Takes back what [`Self::stages`] told; `None`, and nothing changed, where those are of other waves.
    pub(crate) fn recall(&mut self, stages: &[u8]) -> Option<()> {
        let known: Vec<Stage> =
            stages.iter().map(|stage| STAGES.get(usize::from(*stage)).copied()).collect::<Option<_>>()?;
        if known.len() != self.waves.len() {
            return None;
        }
        self.waves.iter_mut().zip(known).for_each(|((_, stage), known)| *stage = known);
        Some(())
    }

    /// Tells what has changed until `at`, with the capsule at an arc length.
    pub(crate) fn look(&mut self, at: SimTime, capsule_m: f64, notes: &mut Vec<WorldNote>) {
        let time_s = at.seconds();
        for (wave, stage) in &mut self.waves {
            let centre_m = wave.at(time_s).centre_m;
            let away_widths = (centre_m - capsule_m).abs() / wave.width_m;
            let mut tell = |text: String| {
                let text = format!("wave of {:.1} s {text}", wave.start_time_s);
                notes.push(WorldNote { at, text, standing: false });
            };
            if *stage == Stage::Waiting && time_s >= wave.start_time_s {
                let (way_mm, side) = (
                    1e3 * (capsule_m - centre_m).abs(),
                    if centre_m < capsule_m { "oral" } else { "aboral" },
                );
                tell(format!("starts at {:.0} mm, {way_mm:.0} mm {side} of the capsule", 1e3 * centre_m));
                *stage = Stage::Away;
            }
            let running = time_s < wave.end_time_s();
            if *stage == Stage::Away && running && away_widths < REACHED_WIDTHS {
                tell(format!("reaches the capsule at {:.0} mm", 1e3 * capsule_m));
                *stage = Stage::AtCapsule;
            }
            if *stage == Stage::AtCapsule && (!running || away_widths > LEFT_WIDTHS) {
                let how = if running { "leaves" } else { "ends and leaves" };
                tell(format!("{how} the capsule at {:.0} mm", 1e3 * capsule_m));
                *stage = Stage::Away;
            }
            if *stage == Stage::Away && !running {
                *stage = Stage::Over;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_form_a_wave_passes_a_capsule_that_stands_still() {
        // 10 mm/s from 0 over 200 mm, width 10 mm, capsule at 100 mm: near from 70 to 140 mm.
        let wave = Wave {
            start_time_s: 2.0,
            start_arc_length_m: 0.0,
            speed_m_s: 0.01,
            duration_s: 20.0,
            width_m: 0.01,
            amplitude: [0.9; 2],
            flattens_ahead_m: 0.0,
            yields: false,
            forms_s: 0.0,
            acts_from_m: f64::NEG_INFINITY,
        };
        let mut watch = WaveWatch { waves: vec![(wave, Stage::Waiting)] };
        let mut notes = Vec::new();
        for i in 0..300 {
            watch.look(SimTime::from_seconds(0.1 * f64::from(i)), 0.1, &mut notes);
        }
        let told: Vec<(f64, &str)> = notes.iter().map(|n| (n.at.seconds(), n.text.as_str())).collect();
        assert_eq!(told.len(), 3, "{told:?}");
        for ((at_s, text), (expected_s, expected)) in told.into_iter().zip([
            (2.0, "wave of 2.0 s starts at 0 mm, 100 mm oral of the capsule"),
            (9.0, "wave of 2.0 s reaches the capsule at 100 mm"),
            (16.0, "wave of 2.0 s leaves the capsule at 100 mm"),
        ]) {
            assert!((at_s - expected_s).abs() < 0.11, "{text} at {at_s} s");
            assert_eq!(text, expected);
        }
    }
}
