//! The migrating motor complex: phases that travel aborally, one cycle after the other.
//!
//! At the oral end of the small bowel cycle `k` lasts `L_k`, drawn evenly from `P (1 - x)` to `P (1 + x)` with the mean `P` of all; a place where the front
//! arrives `d` late sees at `t` what the oral end sees at `t - d`. Of a cycle
//!
//! ```text
//! phase III lasts q3 P at its end, in every cycle; phases I and II share the rest, I : II = q1 : q2
//! ```
//!
//! (where a cycle is that short, phase III takes half of it, or the part q3 if that is more). The complex has always run: t = 0 lies anywhere in the sequence of cycles, and thus more often in a
//! long one than in a short one.
//!
//! The sequence repeats after [`CYCLES`] cycles, nine days at a period of 97 min: so the complex is a pure function of time.
//!
//! Neglected: cycles that end before they reach the ileum.

use super::meal::MealConfig;
use super::uniform;
use crate::motility_config::MmcConfig;
use lumenav_core::RandomStreams;

/// Cycles after which their sequence repeats.
const CYCLES: usize = 128;

/// Cycles and phases, but for the time of a meal.
#[derive(Debug, Clone)]
pub(super) struct MotorComplex {
    meals: Vec<MealConfig>,
    /// Where each cycle begins in the sequence, and where the last one ends, s.
    borders_s: Vec<f64>,
    /// Where in the sequence the oral end is at t = 0, s.
    start_s: f64,
    /// Of phase III, s.
    front_s: f64,
    /// Largest part of a cycle that phase III takes.
    most_front: f64,
    /// Part of what precedes phase III that is phase I.
    quiet_part: f64,
    rate_factors: [f64; 3],
}

impl MotorComplex {
    pub(super) fn new(config: &MmcConfig, meals: &[MealConfig], streams: &RandomStreams) -> Self {
        let mut borders_s = vec![0.0];
        for cycle in 0..CYCLES {
            let part = 2.0 * uniform(&mut streams.stream("mmc/cycle", cycle as u64)) - 1.0;
            borders_s.push(borders_s[cycle] + config.period_s.0 * (1.0 + config.period_spread.0 * part));
        }
        let start_s = match config.start_phase {
            Some(phase) => phase.0 * borders_s[1],
            None => uniform(&mut streams.stream("mmc", 0)) * borders_s[CYCLES],
        };
        let [quiet, irregular, front] = config.fractions.map(|fraction| fraction.0);
        // Without phases I and II there is nothing but phase III, however long a cycle lasts.
        let front = if quiet + irregular > 0.0 { front } else { f64::INFINITY };
        Self {
            meals: meals.to_vec(),
            borders_s,
            start_s,
            front_s: front * config.period_s.0,
            most_front: front.clamp(0.5, 1.0),
            quiet_part: if quiet > 0.0 { quiet / (quiet + irregular) } else { 0.0 },
            rate_factors: config.rate_factor.map(|factor| factor.0),
        }
    }

    /// The meal that is digested at `time_s`; there is one at a time.
    pub(super) fn meal_at(&self, time_s: f64) -> Option<&MealConfig> {
        self.meals.iter().find(|meal| meal.lasts_at(time_s))
    }

    /// Rate factor at `time_s` where the front arrives `delay_s` late.
    pub(super) fn factor(&self, time_s: f64, delay_s: f64) -> f64 {
        if let Some(meal) = self.meal_at(time_s) {
            return meal.rate_factor.0;
        }
        self.rate_factors[self.phase(time_s - delay_s)]
    }

    /// Phase at the oral end, 0 to 2.
    fn phase(&self, time_s: f64) -> usize {
        let place_s = (self.start_s + time_s).rem_euclid(self.borders_s[CYCLES]);
        // The first border is 0, and rounding may give the last one.
        let cycle = (self.borders_s.partition_point(|border_s| *border_s <= place_s) - 1).min(CYCLES - 1);
        let [begin_s, end_s] = [self.borders_s[cycle], self.borders_s[cycle + 1]];
        let (lasts_s, since_s) = (end_s - begin_s, place_s - begin_s);
        let before_front_s = lasts_s - self.front_s.min(self.most_front * lasts_s);
        if since_s >= before_front_s { 2 } else { usize::from(since_s >= self.quiet_part * before_front_s) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lumenav_core::config::quantity::Fraction;

    /// Phases at the oral end every ten seconds, in runs: phase and how long it lasted, s. The first and the last one are cut.
    fn phases(config: &MmcConfig, seed: u64, hours: f64) -> Vec<(usize, f64)> {
        let complex = MotorComplex::new(config, &[], &RandomStreams::new(seed, 0, "motility"));
        let mut runs: Vec<(usize, f64)> = Vec::new();
        for i in 0..(360.0 * hours) as u32 {
            let phase = complex.phase(10.0 * f64::from(i));
            match runs.last_mut() {
                Some((last, lasts_s)) if *last == phase => *lasts_s += 10.0,
                _ => runs.push((phase, 10.0)),
            }
        }
        runs[1..runs.len() - 1].to_vec()
    }

    #[test]
    fn published_intervals_between_fronts() {
        // 97 min in the mean, single ones 15 to 195 min (Kerlin and Phillips 1982).
        let mut intervals_min = Vec::new();
        for seed in 1..=10 {
            let runs = phases(&MmcConfig::default(), seed, 150.0);
            let first = runs.iter().position(|run| run.0 == 0).unwrap();
            for cycle in runs[first..].chunks_exact(3) {
                let [one, two, three] = [cycle[0], cycle[1], cycle[2]];
                assert_eq!([one.0, two.0, three.0], [0, 1, 2]);
                // Phase III takes 5 to 10 min in every cycle.
                assert!((300.0..=600.0).contains(&three.1), "{}", three.1);
                assert!((one.1 / (one.1 + two.1) - 0.55 / 0.93).abs() < 0.03);
                intervals_min.push((one.1 + two.1 + three.1) / 60.0);
            }
        }
        let mean = intervals_min.iter().sum::<f64>() / intervals_min.len() as f64;
        let [least, most] = [f64::min, f64::max].map(|of| intervals_min.iter().copied().reduce(of).unwrap());
        println!("{} intervals: {least:.0} to {most:.0} min, mean {mean:.1}", intervals_min.len());
        // The standard error of the mean is 48 min / sqrt(900).
        assert!((mean - 97.0).abs() < 5.0, "{mean}");
        assert!((14.0..25.0).contains(&least) && (165.0..195.0).contains(&most), "{least} to {most}");
    }

    #[test]
    fn closed_form_without_spread_the_complex_is_periodic() {
        let config = MmcConfig {
            period_spread: Fraction(0.0),
            start_phase: Some(Fraction(0.25)),
            ..MmcConfig::default()
        };
        let complex = MotorComplex::new(&config, &[], &RandomStreams::new(1, 0, "motility"));
        for (phase, at) in [(0, 0.0), (0, 0.54), (1, 0.56), (1, 0.92), (2, 0.94), (2, 0.99)] {
            for cycle in [-3.0, 0.0, 2.0, 400.0] {
                assert_eq!(complex.phase(5820.0 * (cycle + at - 0.25)), phase, "{at} of cycle {cycle}");
            }
        }
    }

    #[test]
    fn closed_form_a_phase_that_is_alone_lasts_for_ever() {
        for alone in 0..3 {
            let fractions = std::array::from_fn(|phase| Fraction(f64::from(u8::from(phase == alone))));
            let config = MmcConfig { fractions, ..MmcConfig::default() };
            let complex = MotorComplex::new(&config, &[], &RandomStreams::new(1, 0, "motility"));
            assert!((0..4000).all(|i| complex.phase(30.0 * f64::from(i)) == alone), "{alone}");
        }
    }

    #[test]
    fn law_a_complex_that_has_always_run_starts_in_long_cycles_more_often() {
        // The cycle around t = 0 has the mean P (1 + x²/3) where cycles are drawn evenly from P (1 - x) to P (1 + x).
        let config = MmcConfig::default();
        let of = |seed| {
            let complex = MotorComplex::new(&config, &[], &RandomStreams::new(seed, 0, "motility"));
            let after = complex.borders_s.partition_point(|border_s| *border_s <= complex.start_s);
            complex.borders_s[after] - complex.borders_s[after - 1]
        };
        let mean = (0..2000).map(of).sum::<f64>() / 2000.0 / 5820.0;
        let expected = 1.0 + config.period_spread.0.powi(2) / 3.0;
        // Standard error: 0.43 / sqrt(2000).
        assert!((mean - expected).abs() < 0.03, "{mean}, not {expected}");
    }
}
