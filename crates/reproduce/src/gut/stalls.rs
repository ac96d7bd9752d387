//! Whether every stall of a capsule was told, seen from its places alone.
//!
//! The engine tells a stall when the capsule has stayed within `D` of an anchor for the time `T`. A capsule that stays within `D/2` of a place for `2T`
//! has then been told, whatever the anchor was before: in that time the anchor is set anew at most once.

use lumenav_scenario::engine::{EngineConfig, EngineEvent, EventKind};

/// Watches the places of a capsule and the events of its engine.
#[derive(Clone, Debug)]
pub(super) struct StallAudit {
    distance_m: f64,
    after_s: f64,
    /// Where it stays, and since when.
    stays: (f64, f64),
    /// Whether the present stay was counted.
    counted: bool,
    /// Where it was told as stalled last, while it has stayed there.
    told_m: Option<f64>,
    /// Stalls that were told.
    pub(super) told: u64,
    /// Stays that no told stall covers.
    pub(super) untold: u64,
}

impl StallAudit {
    pub(super) fn new(config: &EngineConfig, arc_length_m: f64) -> Self {
        Self {
            distance_m: config.stalled_distance_m.0,
            after_s: config.stalled_after_s.0,
            stays: (arc_length_m, 0.0),
            counted: false,
            told_m: None,
            told: 0,
            untold: 0,
        }
    }

    /// The capsule is here now, and this was told since the last look.
    pub(super) fn look(&mut self, time_s: f64, arc_length_m: f64, events: &[EngineEvent]) {
        if self.told_m.is_some_and(|told_m| (arc_length_m - told_m).abs() > 2.0 * self.distance_m) {
            self.told_m = None;
        }
        for event in events.iter().filter(|event| event.kind == EventKind::Stalled) {
            (self.told, self.told_m) = (self.told + 1, Some(event.arc_length_m));
        }
        if (arc_length_m - self.stays.0).abs() > 0.5 * self.distance_m {
            (self.stays, self.counted) = ((arc_length_m, time_s), false);
        }
        if !self.counted && self.told_m.is_none() && time_s - self.stays.1 > 2.0 * self.after_s {
            (self.untold, self.counted) = (self.untold + 1, true);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lumenav_core::SimTime;

    fn audit(told_after_s: Option<f64>) -> StallAudit {
        let mut audit = StallAudit::new(&EngineConfig::default(), 0.0);
        for k in 0..400_u32 {
            let time_s = 10.0 * f64::from(k);
            // On its way for a quarter of the time, then at rest for an hour, trembling by 2 mm.
            let arc_length_m = 0.001 * f64::from(k.min(100)) + 0.002 * f64::from(k % 2);
            let told = told_after_s.filter(|after_s| time_s == 1000.0 + after_s);
            let stalled =
                told.map(|_| EngineEvent { at: SimTime::ZERO, arc_length_m, kind: EventKind::Stalled });
            audit.look(time_s, arc_length_m, stalled.as_slice());
        }
        audit
    }

    #[test]
    fn law_a_stall_that_nobody_tells_is_counted_once() {
        let [told, untold] = [audit(Some(600.0)), audit(None)];
        assert_eq!((told.told, told.untold), (1, 0));
        assert_eq!((untold.told, untold.untold), (0, 1));
        assert_eq!(audit(Some(1500.0)).untold, 1, "told too late");
    }
}
