//! The law that neither the capsule nor what is loose beside it leaves the lumen, tried over random motility.

use super::{Engine, EngineError, EventKind};
use lumenav_anatomy::lumen::Lumen;
use lumenav_anatomy::tract::Tract;
use lumenav_core::{CapsuleBody, SimTime};
use nalgebra::Point3;

/// How far a capsule that touches the resting wall may press into it, m: the wall gives way by 2 to 3 mm by design.
pub const TOLERANCE_M: f64 = 3e-3;

/// What is loose is looked at every so many steps.
const LOOSE_EVERY: u64 = 24;
/// The lumen is looked for so far up and down the tract from where a loose thing's centre projects, m, in steps of the second.
const NEARBY_M: [f64; 2] = [0.02, 5e-4];

/// What a fuzzing run found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FuzzReport {
    /// Runs made.
    pub runs: u64,
    /// Steps made.
    pub steps: u64,
    /// Largest offset minus `max(R_rest - r, 0)`, m: has to stay below [`TOLERANCE_M`].
    pub worst_excess_m: f64,
    /// Seed of the run that had it.
    pub worst_seed: u64,
    /// Where, m, and when.
    pub worst_arc_length_m: f64,
    /// When.
    pub worst_at: SimTime,
    /// The same of what is loose: how far a centre is from the nearest place that a body of its radius can have at rest, m. Below 0 where
    /// nothing is.
    pub worst_loose_m: f64,
    /// Largest speed met, m/s.
    pub fastest_m_s: f64,
    /// Steps whose state was not finite: has to be 0.
    pub not_finite: u64,
    /// Stalls that were told as events, and those that were not: the latter have to be 0.
    pub stalls: u64,
    /// See [`FuzzReport::stalls`].
    pub untold_stalls: u64,
    /// Capsules that left the tract.
    pub left: u64,
}

impl FuzzReport {
    /// Whether the capsule stayed inside in every step of every run, and what is loose whenever it was looked at (every 0.1 s at 240 Hz).
    pub fn inside(&self) -> bool {
        self.not_finite == 0 && self.worst_excess_m <= TOLERANCE_M && self.worst_loose_m <= TOLERANCE_M
    }

    /// The same of two halves of a fuzzing.
    #[must_use]
    pub fn and(self, other: &Self) -> Self {
        let worst = if other.worst_excess_m > self.worst_excess_m { other } else { &self };
        Self {
            runs: self.runs + other.runs,
            steps: self.steps + other.steps,
            worst_loose_m: self.worst_loose_m.max(other.worst_loose_m),
            fastest_m_s: self.fastest_m_s.max(other.fastest_m_s),
            not_finite: self.not_finite + other.not_finite,
            stalls: self.stalls + other.stalls,
            untold_stalls: self.untold_stalls + other.untold_stalls,
            left: self.left + other.left,
            ..*worst
        }
    }
}

/// A capsule's rest, measured from its states alone.
struct Rest {
    anchor_m: f64,
    since: SimTime,
    told: bool,
    counted: bool,
}

impl Rest {
    /// Counts a stall that the engine did not tell.
    fn look(&mut self, engine: &Engine, report: &mut FuzzReport) {
        let (state, config) = (engine.state(), &engine.config);
        if (state.arc_length_m - self.anchor_m).abs() > config.stalled_distance_m.0 {
            *self = Self { anchor_m: state.arc_length_m, since: state.at, told: false, counted: false };
        }
        let told = engine.events().iter().any(|event| event.kind == EventKind::Stalled);
        report.stalls += u64::from(told);
        self.told |= told;
        // The end of the step in which it is due tells it.
        if !self.told
            && !self.counted
            && state.at.since_s(self.since) > config.stalled_after_s.0 + engine.step_s
        {
            self.counted = true;
            report.untold_stalls += 1;
        }
    }
}

/// Runs one engine per seed for `duration_s`, starting at places that cover the tract, and tests the offset after each step. `build` makes the engine of
/// a seed in the tract, with the capsule at this arc length, m.
///
/// # Errors
/// [`EngineError`] of an engine that cannot be built.
pub fn fuzz_inside_lumen(
    seeds: std::ops::Range<u64>,
    duration_s: f64,
    tract: &Tract,
    capsule: &CapsuleBody,
    mut build: impl FnMut(u64, f64) -> Result<Engine, EngineError>,
) -> Result<FuzzReport, EngineError> {
    let mut report = FuzzReport {
        runs: 0,
        steps: 0,
        worst_excess_m: f64::NEG_INFINITY,
        worst_seed: 0,
        worst_arc_length_m: 0.0,
        worst_at: SimTime::ZERO,
        worst_loose_m: f64::NEG_INFINITY,
        fastest_m_s: 0.0,
        not_finite: 0,
        stalls: 0,
        untold_stalls: 0,
        left: 0,
    };
    for seed in seeds {
        // The golden ratio spreads the starts evenly over the tract for any number of seeds.
        let place = (0.5 + seed as f64 * 0.618_033_988_749_894_9).fract();
        let margin_m = capsule.length_m.min(0.4 * tract.length_m());
        let mut engine = build(seed, margin_m + place * (tract.length_m() - 2.0 * margin_m))?;
        let steps = (duration_s * f64::from(engine.config.step_rate_hz)).round() as u64;
        report.runs += 1;
        let start = engine.state();
        let mut rest = Rest { anchor_m: start.arc_length_m, since: start.at, told: false, counted: false };
        for step in 0..steps {
            engine.step();
            report.note(seed, &engine, capsule.radius_m);
            if step % LOOSE_EVERY == 0 {
                report.note_loose(&engine);
            }
            rest.look(&engine, &mut report);
            if engine.capsule().left {
                report.left += 1;
                break;
            }
        }
    }
    Ok(report)
}

impl FuzzReport {
    fn note(&mut self, seed: u64, engine: &Engine, radius_m: f64) {
        self.steps += 1;
        let state = engine.state();
        let finite = state.world_from_capsule.translation.vector.iter().all(|v| v.is_finite());
        self.not_finite += u64::from(!finite);
        self.fastest_m_s = self.fastest_m_s.max(state.velocity_world_m_s.norm());
        let free_m = (rest_m(engine.lumen(), state.arc_length_m) - radius_m).max(0.0);
        let excess_m = state.offset_m - free_m;
        if excess_m > self.worst_excess_m {
            self.worst_excess_m = excess_m;
            self.worst_seed = seed;
            self.worst_arc_length_m = state.arc_length_m;
            self.worst_at = state.at;
        }
    }

    fn note_loose(&mut self, engine: &Engine) {
        for (shape, pose, arc_length_m) in engine.loose() {
            let centre = Point3::from(pose.translation.vector);
            self.not_finite += u64::from(!centre.coords.iter().all(|v| v.is_finite()));
            let excess_m = beyond_m(engine.lumen(), &centre, arc_length_m, shape.radius_m);
            self.worst_loose_m = self.worst_loose_m.max(excess_m);
        }
    }
}

/// How far a centre near an arc length is from where a body of this radius can rest, m. On the inner side of a bend that is tighter than the lumen
/// is wide the nearest such place is not at the nearest foot.
pub fn beyond_m(lumen: &Lumen, centre: &Point3<f64>, near_m: f64, radius_m: f64) -> f64 {
    let [reach_m, spacing_m] = NEARBY_M;
    let count = (reach_m / spacing_m) as i32;
    let length_m = lumen.tract().length_m();
    let beyond = |k: i32| {
        let s_m = (near_m + spacing_m * f64::from(k)).clamp(0.0, length_m);
        let distance_m = (centre - lumen.tract().station(s_m).position_m).norm();
        distance_m - (rest_m(lumen, s_m) - radius_m).max(0.0)
    };
    (-count..=count).map(beyond).fold(f64::INFINITY, f64::min)
}

/// R_rest is the tract's own resting radius; folds stand inside it.
fn rest_m(lumen: &Lumen, s_m: f64) -> f64 {
    lumen.tract().radius.radius_m(s_m)
}
