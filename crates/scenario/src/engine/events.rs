//! What an engine tells beside the state: borders crossed, contact lost, no progress.

use super::EngineConfig;
use lumenav_anatomy::segment::SegmentKey;
use lumenav_anatomy::tract::Tract;
use lumenav_core::SimTime;
use lumenav_core::time::nanoseconds;

/// Contact is lost when nothing touched for so long, ns: a bounce is not a loss.
const CONTACT_LOST_NS: i64 = 100_000_000;
/// How far beyond a border the centre has to be, m: on the border itself it would be announced at every tremor.
const BORDER_HYSTERESIS_M: f64 = 1e-3;

/// Something that happened to the capsule.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EngineEvent {
    /// When (end of the step).
    pub at: SimTime,
    /// Arc length of the capsule's centre, m.
    pub arc_length_m: f64,
    /// What.
    pub kind: EventKind,
}

/// Kinds of events.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum EventKind {
    /// The centre is in another segment than before.
    SegmentEntered(SegmentKey),
    /// The centre passed a landmark.
    LandmarkPassed {
        /// Its name.
        name: &'static str,
        /// Towards the anus.
        aboral: bool,
    },
    /// Nothing touches the capsule any more.
    ContactLost,
    /// It has not moved for `stalled_after_s`.
    Stalled,
    /// It has not moved for `retained_after_s`.
    Retained,
    /// It left through an open end; its truth stays as it is from here on.
    Left,
    /// The tether has taken a short cut between two loops that lie against each other, which no wall of theirs holds it from: from here on it is
    /// shorter than the bowel that it runs through. Told once.
    TetherCrossed {
        /// Where the short cut begins, arc length, m.
        from_m: f64,
    },
}

/// What a step showed.
pub(super) struct Seen {
    pub(super) at: SimTime,
    pub(super) arc_length_m: f64,
    pub(super) segment_index: usize,
    pub(super) touching: bool,
    pub(super) left: bool,
    /// Where a tether takes a short cut, m.
    pub(super) crossed_m: Option<f64>,
}

/// Memory of the events told so far.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Watch {
    pub(super) segment_index: usize,
    pub(super) last_touch: SimTime,
    pub(super) lost: bool,
    pub(super) anchor_m: f64,
    pub(super) anchored: SimTime,
    pub(super) stalled: bool,
    pub(super) retained: bool,
    /// Where the short cut of the tether is that has been told, m.
    pub(super) crossed_m: Option<f64>,
}

impl Watch {
    pub(super) fn new(arc_length_m: f64, segment_index: usize) -> Self {
        Self {
            segment_index,
            last_touch: SimTime::ZERO,
            // It starts on the centre line, touching nothing: that is not a loss.
            lost: true,
            anchor_m: arc_length_m,
            anchored: SimTime::ZERO,
            stalled: false,
            retained: false,
            crossed_m: None,
        }
    }

    pub(super) fn look(
        &mut self,
        seen: &Seen,
        tract: &Tract,
        config: &EngineConfig,
        events: &mut Vec<EngineEvent>,
    ) {
        let mut tell = |kind| events.push(EngineEvent { at: seen.at, arc_length_m: seen.arc_length_m, kind });
        self.borders(seen, tract, &mut tell);
        if seen.touching {
            (self.last_touch, self.lost) = (seen.at, false);
        } else if !self.lost && seen.at - self.last_touch >= CONTACT_LOST_NS {
            self.lost = true;
            tell(EventKind::ContactLost);
        }
        if (seen.arc_length_m - self.anchor_m).abs() > config.stalled_distance_m.0 {
            (self.anchor_m, self.anchored) = (seen.arc_length_m, seen.at);
            (self.stalled, self.retained) = (false, false);
        }
        let resting_ns: i64 = seen.at - self.anchored;
        if !self.stalled && resting_ns >= nanoseconds(config.stalled_after_s.0) {
            self.stalled = true;
            tell(EventKind::Stalled);
        }
        if !self.retained && resting_ns >= nanoseconds(config.retained_after_s.0) {
            self.retained = true;
            tell(EventKind::Retained);
        }
        if let (Some(from_m), None) = (seen.crossed_m, self.crossed_m) {
            self.crossed_m = Some(from_m);
            tell(EventKind::TetherCrossed { from_m });
        }
        if seen.left {
            tell(EventKind::Left);
        }
    }

    /// When a capsule that goes on resting is told next as stalled or retained.
    pub(super) fn next(&self, config: &EngineConfig) -> Option<SimTime> {
        let due = |told: bool, after_s: f64| (!told).then(|| self.anchored + nanoseconds(after_s));
        let stalled = due(self.stalled, config.stalled_after_s.0);
        let retained = due(self.retained, config.retained_after_s.0);
        stalled.into_iter().chain(retained).min()
    }

    /// Tells every border between the segment told last and the present one.
    fn borders(&mut self, seen: &Seen, tract: &Tract, tell: &mut impl FnMut(EventKind)) {
        let segments = &tract.segments;
        while self.segment_index < seen.segment_index {
            let next = &segments[self.segment_index + 1];
            if seen.arc_length_m < next.start_m + BORDER_HYSTERESIS_M {
                return;
            }
            self.segment_index += 1;
            if let Some(name) = next.key.oral_landmark() {
                tell(EventKind::LandmarkPassed { name, aboral: true });
            }
            tell(EventKind::SegmentEntered(next.key));
        }
        while self.segment_index > seen.segment_index {
            let present = &segments[self.segment_index];
            if seen.arc_length_m > present.start_m - BORDER_HYSTERESIS_M {
                return;
            }
            self.segment_index -= 1;
            if let Some(name) = present.key.oral_landmark() {
                tell(EventKind::LandmarkPassed { name, aboral: false });
            }
            tell(EventKind::SegmentEntered(segments[self.segment_index].key));
        }
    }
}
