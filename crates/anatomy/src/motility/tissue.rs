//! Refractory tissue: contractions of the small bowel keep clear of each other, as slow waves pace them.
//!
//! A place that contracts does not contract again within the refractory time τ = r/f. A wave of speed v therefore keeps the distance
//! d = τ v to the centre of every other: it does not start nearer to one that runs, and it ends where it would come nearer to one that
//! started before it. Two contractions then neither add up in one place nor run through each other.
//!
//! So that a place still sees waves with its rate, more are proposed than start. Waves of the density f m/v (m: what the migrating
//! motor complex leaves) that keep d apart are hard rods on a line, and of rods in equilibrium (Tonks, Phys. Rev. 50, 955, 1936) one
//! more finds room with the probability
//!
//! ```text
//! P(x) = (1 - x) exp(-x / (1 - x))        x = r m
//! ```
//!
//! Waves that end early because they meet another are made up for by 1 + 0.4 x more proposals (T: the rate that a place sees, within 3 % for
//! m from 0.2 to 1). Neglected: what a wave leaves behind when it ends.

use super::{SHORTEST_RUN_M, Wave};

/// Largest refractory part of the interval that is proposed for: 34 proposals a wave.
pub(crate) const LARGEST_PART: f64 = 0.7;

/// More proposals for waves that are cut short, per x.
const CUT_SHORT: f64 = 0.4;

/// Proposals per wave that starts, (1 + 0.4 x)/P, where the tissue is refractory for the part `x` of the time.
pub(super) fn proposals(x: f64) -> f64 {
    let x = x.clamp(0.0, LARGEST_PART);
    let free = 1.0 - x;
    (1.0 + CUT_SHORT * x) * (x / free).exp() / free
}

/// Part of the refractory time for which a wave that came in keeps the next one out (T): some end before they are clear.
const KEPT_OUT: f64 = 0.8;

/// Proposals per wave that starts where all start in one place: it is free but for the refractory part `x` after each.
pub(super) fn proposals_at_a_place(x: f64) -> f64 {
    1.0 / (1.0 - KEPT_OUT * x.clamp(0.0, LARGEST_PART))
}

/// What the waves that run leave of a new one; `None`: it does not start.
pub(super) fn admit(mut wave: Wave, refractory_s: f64, running: &[Wave]) -> Option<Wave> {
    let start_s = wave.start_time_s;
    // What does not act where this one starts, a mass movement of the colon, is no matter.
    let acts = |other: &&Wave| other.end_time_s() > start_s && other.acts_from_m <= wave.start_arc_length_m;
    for other in running.iter().filter(acts) {
        let clear_m = refractory_s * wave.speed_m_s.abs().max(other.speed_m_s.abs());
        let ahead_m = other.at(start_s).centre_m - wave.start_arc_length_m;
        if ahead_m.abs() < clear_m {
            return None;
        }
        // They close in where the one that is behind is the faster one.
        let closing_m_s = (wave.speed_m_s - other.speed_m_s) * ahead_m.signum();
        if closing_m_s > 0.0 {
            let meeting_s = (ahead_m.abs() - clear_m) / closing_m_s;
            if start_s + meeting_s < other.end_time_s() {
                wave.duration_s = wave.duration_s.min(meeting_s);
            }
        }
    }
    (wave.duration_s * wave.speed_m_s.abs() >= SHORTEST_RUN_M).then_some(wave)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(start_time_s: f64, start_arc_length_m: f64, speed_m_s: f64) -> Wave {
        Wave {
            start_time_s,
            start_arc_length_m,
            speed_m_s,
            duration_s: 10.0,
            width_m: 0.01,
            amplitude: [0.5; 2],
            flattens_ahead_m: 0.0,
            yields: false,
            forms_s: 0.0,
            acts_from_m: f64::NEG_INFINITY,
        }
    }

    #[test]
    fn closed_form_a_wave_ends_where_it_meets_an_earlier_one() {
        let running = [wave(0.0, 0.0, 0.01)];
        // At 2 s the other is at 20 mm; one that comes from 60 mm at 10 mm/s has 40 mm to it, of which 20 stay clear.
        let met = admit(wave(2.0, 0.06, -0.01), 2.0, &running).unwrap();
        assert!((met.duration_s - 1.0).abs() < 1e-12, "{}", met.duration_s);
        // One that runs away or follows as fast is not touched; one within 20 mm does not start.
        for free in [wave(2.0, 0.041, 0.01), wave(2.0, -0.001, 0.01), wave(2.0, -0.001, -0.01)] {
            assert_eq!(admit(free, 2.0, &running), Some(free));
        }
        assert_eq!(admit(wave(2.0, 0.039, 0.01), 2.0, &running), None);
        assert_eq!(admit(wave(2.0, 0.001, -0.01), 2.0, &running), None);
        // What is over hinders nobody.
        let late = wave(10.5, 0.1, 0.01);
        assert_eq!(admit(late, 2.0, &running), Some(late));
    }

    #[test]
    fn closed_form_hard_rods() {
        assert_eq!(proposals(0.0), 1.0);
        assert!((proposals(0.5) - 1.2 * 2.0 * 1.0_f64.exp()).abs() < 1e-12);
    }
}
