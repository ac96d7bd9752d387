//! How the capsule moved along the tract, by the truth: transit times, speeds, and each track's errors, segment by segment.
//!
//! *Time* goes to the segment in which the capsule is at the earlier of two truths. *Speed* is the way along the centre line in a second (or
//! in the interval of the truths, where that is longer) over its time, to and fro; a capsule that shakes on the spot makes no way in it.
//! *Bursts* are the fastest twentieth of those seconds. A capsule that has left the tract is in no segment.

use lumenav_core::SimTime;
use lumenav_evaluation::bounded::BoundedQuantiles;
use lumenav_evaluation::summary::{Quantiles, ScalarSummary};
use serde::{Deserialize, Serialize};

/// Least time over which a speed is taken, s.
const SPEED_SPAN_S: f64 = 1.0;
/// Part of the time that makes the bursts.
const BURSTS: f64 = 0.05;
/// Classes of speed: their upper ends, mm/s. A last class holds what is faster.
pub const SPEED_CLASSES_MM_S: [f64; 12] = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0];
/// A way below this is no motion of which bursts could be told, mm.
const LEAST_WAY_MM: f64 = 5.0;
/// Points of a distribution function.
const CDF_POINTS: usize = 41;

/// The motion of a run in a tract.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MotionFigures {
    /// Upper ends of the classes of speed, mm/s; a last class holds what is faster.
    pub speed_classes_mm_s: Vec<f64>,
    /// In the order in which they were first entered.
    pub segments: Vec<SegmentMotion>,
    /// When the capsule left the tract, s; absent where it did not. From then on it rests at the end, and errors are those of a capsule at rest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub left_s: Option<f64>,
}

/// The motion in one segment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SegmentMotion {
    /// The segment.
    pub segment: String,
    /// When the capsule was first seen in it, s.
    pub entered_s: f64,
    /// When it was last seen in it, s.
    pub last_s: f64,
    /// Whether `time_s` is a transit time: the capsule came in from the segment before and is beyond it at the end. Otherwise it is as long as the
    /// run let it be.
    pub is_transit: bool,
    /// Time in it, s.
    pub time_s: f64,
    /// Way along the centre line, to and fro, mm.
    pub way_mm: f64,
    /// The same, what goes back taken off, mm.
    pub advance_mm: f64,
    /// Speed, mm/s.
    pub speed_mm_s: Option<ScalarSummary>,
    /// Part of the way that the fastest twentieth of the time makes; `null` for less than 20 speeds or 5 mm of way.
    pub burst_share: Option<f64>,
    /// Speed (mm/s) and the part of the time that is not faster.
    pub speed_distribution: Vec<(f64, f64)>,
    /// Part of the time in each class of speed.
    pub speed_density: Vec<f64>,
}

/// A segment being watched.
struct Passage {
    segment: String,
    entered_s: f64,
    last_s: f64,
    time_s: f64,
    /// Where it was first seen, and furthest aborally, m.
    first_m: f64,
    furthest_m: f64,
    advance_mm: f64,
    speed_mm_s: Quantiles,
    way_mm: f64,
    classes: [u64; SPEED_CLASSES_MM_S.len() + 1],
}

impl Passage {
    fn new(segment: &str, at_s: f64, arc_length_m: f64) -> Self {
        Self {
            segment: segment.to_owned(),
            entered_s: at_s,
            last_s: at_s,
            time_s: 0.0,
            first_m: arc_length_m,
            furthest_m: arc_length_m,
            advance_mm: 0.0,
            speed_mm_s: Quantiles::new(),
            way_mm: 0.0,
            classes: [0; SPEED_CLASSES_MM_S.len() + 1],
        }
    }

    fn go(&mut self, way_mm: f64, time_s: f64) {
        self.advance_mm += way_mm;
        self.way_mm += way_mm.abs();
        let speed_mm_s = way_mm.abs() / time_s;
        self.speed_mm_s.push(speed_mm_s);
        self.classes[SPEED_CLASSES_MM_S.partition_point(|limit| *limit < speed_mm_s)] += 1;
    }

    fn figures(&mut self, is_transit: bool) -> SegmentMotion {
        let count: u64 = self.classes.iter().sum();
        SegmentMotion {
            segment: self.segment.clone(),
            entered_s: self.entered_s,
            last_s: self.last_s,
            is_transit,
            time_s: self.time_s,
            way_mm: self.way_mm,
            advance_mm: self.advance_mm,
            speed_mm_s: self.speed_mm_s.summary(),
            burst_share: (self.way_mm >= LEAST_WAY_MM)
                .then(|| self.speed_mm_s.share_of_largest(BURSTS))
                .flatten(),
            speed_distribution: self.speed_mm_s.cumulative_distribution(CDF_POINTS),
            speed_density: self.classes.iter().map(|n| *n as f64 / count.max(1) as f64).collect(),
        }
    }
}

/// A truth along the tract.
#[derive(Clone, Copy)]
struct Seen {
    at_s: f64,
    arc_length_m: f64,
    /// Index of the segment's passage.
    passage: usize,
}

/// Collects the motion of a run; 8 bytes per simulated second.
#[derive(Default)]
pub(crate) struct Motion {
    passages: Vec<Passage>,
    last: Option<Seen>,
    /// When it left the tract, s.
    left_s: Option<f64>,
    /// Where the present span of speed began.
    since: Option<Seen>,
}

impl Motion {
    /// A truth; those that know no place along a tract are no motion along it.
    pub(crate) fn see(&mut self, at: SimTime, arc_length_m: Option<f64>, segment: Option<&str>) {
        let (Some(arc_length_m), Some(segment)) = (arc_length_m, segment) else {
            if self.last.is_some() {
                self.left_s.get_or_insert(at.seconds());
            }
            return;
        };
        let at_s = at.seconds();
        let passage = self.passages.iter().position(|p| p.segment == segment).unwrap_or_else(|| {
            self.passages.push(Passage::new(segment, at_s, arc_length_m));
            self.passages.len() - 1
        });
        let seen = Seen { at_s, arc_length_m, passage };
        if let Some(last) = self.last {
            self.passages[last.passage].time_s += at_s - last.at_s;
        }
        let since = *self.since.get_or_insert(seen);
        // Instants are whole nanoseconds: a second less rounding is a second.
        if at_s - since.at_s >= SPEED_SPAN_S - 1e-6 {
            self.passages[since.passage].go(1e3 * (arc_length_m - since.arc_length_m), at_s - since.at_s);
            self.since = Some(seen);
        }
        let here = &mut self.passages[passage];
        (here.last_s, here.furthest_m) = (at_s, here.furthest_m.max(arc_length_m));
        self.last = Some(seen);
    }

    /// The figures; `None` where no truth knew its place along a tract.
    pub(crate) fn figures(&mut self) -> Option<MotionFigures> {
        let last = self.last?;
        // The oral one of those it was in is where it began, or what it went back into.
        let oral_m = self.passages.iter().map(|p| p.first_m).fold(f64::INFINITY, f64::min);
        let left = self.left_s.is_some();
        let figures = |(k, passage): (usize, &mut Passage)| {
            let is_beyond = k != last.passage && last.arc_length_m >= passage.furthest_m;
            let came_in = k > 0 && passage.first_m > oral_m;
            passage.figures(came_in && (is_beyond || (left && k == last.passage)))
        };
        let segments = self.passages.iter_mut().enumerate().map(figures).collect();
        Some(MotionFigures { speed_classes_mm_s: SPEED_CLASSES_MM_S.to_vec(), segments, left_s: self.left_s })
    }
}

/// A track's errors in one segment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SegmentErrors {
    /// The segment.
    pub segment: String,
    /// Estimates about instants in it that were judged.
    pub judged: u64,
    /// Norm of the position error.
    pub position_error_mm: Option<ScalarSummary>,
    /// Angle between estimated and true x axis.
    pub heading_error_deg: Option<ScalarSummary>,
}

/// Errors in one segment being collected.
struct Errors {
    segment: String,
    judged: u64,
    position_mm: BoundedQuantiles,
    heading_deg: BoundedQuantiles,
}

/// Collects a track's errors segment by segment.
#[derive(Default)]
pub(crate) struct ErrorsBySegment(Vec<Errors>);

impl ErrorsBySegment {
    pub(crate) fn see(&mut self, segment: Option<&str>, position_mm: f64, heading_deg: Option<f64>) {
        let Some(segment) = segment else { return };
        let place = self.0.iter().position(|one| one.segment == segment).unwrap_or_else(|| {
            self.0.push(Errors {
                segment: segment.to_owned(),
                judged: 0,
                position_mm: BoundedQuantiles::new(),
                heading_deg: BoundedQuantiles::new(),
            });
            self.0.len() - 1
        });
        let errors = &mut self.0[place];
        errors.judged += 1;
        errors.position_mm.push(position_mm);
        errors.heading_deg.extend(heading_deg);
    }

    pub(crate) fn figures(&mut self) -> Vec<SegmentErrors> {
        let figures = |errors: &mut Errors| SegmentErrors {
            segment: errors.segment.clone(),
            judged: errors.judged,
            position_error_mm: errors.position_mm.summary(),
            heading_error_deg: errors.heading_deg.summary(),
        };
        self.0.iter_mut().map(figures).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_form_ten_seconds_in_one_segment_and_five_in_the_next() {
        let mut motion = Motion::default();
        assert_eq!(motion.figures(), None);
        // 4 truths a second; rests for 8 s, then 10 mm in a second, then 1 mm/s, and back by 2 mm at the end.
        let place_mm = |t: f64| match t {
            t if t < 8.0 => 0.0,
            t if t < 9.0 => 10.0 * (t - 8.0),
            t if t < 13.0 => 10.0 + (t - 9.0),
            t => 14.0 - 2.0 * (t - 13.0),
        };
        for k in 0..=56 {
            let t = 0.25 * f64::from(k);
            let segment = if t < 9.0 { "stomach" } else { "duodenum" };
            motion.see(SimTime::from_seconds(t), Some(1e-3 * place_mm(t)), Some(segment));
        }
        let found = motion.figures().unwrap();
        let [stomach, duodenum] = &found.segments[..] else { panic!("two segments") };
        // It began in the stomach and is still in the duodenum.
        assert_eq!((stomach.segment.as_str(), stomach.is_transit, stomach.time_s), ("stomach", false, 9.0));
        assert_eq!((duodenum.entered_s, duodenum.last_s, duodenum.is_transit), (9.0, 14.0, false));
        assert_eq!((stomach.burst_share, duodenum.burst_share), (None, None), "a few seconds have no bursts");
        assert_eq!(duodenum.time_s, 5.0);
        assert!((stomach.way_mm - 10.0).abs() < 1e-9 && (stomach.advance_mm - 10.0).abs() < 1e-9);
        assert!((duodenum.way_mm - 6.0).abs() < 1e-9 && (duodenum.advance_mm - 2.0).abs() < 1e-9);
        let speed = stomach.speed_mm_s.unwrap();
        assert!((speed.max - 10.0).abs() < 1e-9 && speed.median == 0.0);
        // Eight of nine seconds at rest; one of 10 mm/s, of which rounding decides on which side of the class's end it is.
        assert_eq!(stomach.speed_density[0], 8.0 / 9.0);
        assert_eq!(stomach.speed_density[9] + stomach.speed_density[10], 1.0 / 9.0);
        assert_eq!(stomach.speed_distribution.last().map(|p| p.1), Some(1.0));
    }

    /// Segments of 10 mm: which of them is a transit after a way along these places, mm, a second each.
    fn transits(places_mm: &[f64], left: bool) -> Vec<(String, bool)> {
        let mut motion = Motion::default();
        for (k, mm) in places_mm.iter().enumerate() {
            let name = ["a", "b", "c"][(mm / 10.0) as usize];
            motion.see(SimTime::from_seconds(k as f64), Some(1e-3 * mm), Some(name));
        }
        if left {
            for k in 0..100 {
                motion.see(SimTime::from_seconds((places_mm.len() + k) as f64), Some(0.029), None);
            }
        }
        let figures = motion.figures().unwrap();
        let times: f64 = figures.segments.iter().map(|s| s.time_s).sum();
        assert_eq!(times, places_mm.len() as f64 - 1.0, "no time after it has left");
        figures.segments.into_iter().map(|s| (s.segment, s.is_transit)).collect()
    }

    #[test]
    fn law_a_transit_begins_and_ends_at_the_borders() {
        let names = |found: Vec<(String, bool)>| -> String {
            found.into_iter().filter(|(_, transit)| *transit).map(|(name, _)| name).collect()
        };
        assert_eq!(names(transits(&[5.0, 12.0, 18.0, 22.0], false)), "b");
        assert_eq!(names(transits(&[5.0, 12.0, 18.0, 22.0, 29.0], true)), "bc");
        // Back again: none of them is passed.
        assert_eq!(names(transits(&[15.0, 22.0, 15.0, 8.0], false)), "");
        assert_eq!(names(transits(&[5.0, 12.0, 22.0, 12.0], false)), "");
        assert_eq!(names(transits(&[5.0, 12.0, 22.0, 12.0, 25.0], false)), "b");
    }

    #[test]
    fn law_a_capsule_that_shakes_on_the_spot_makes_no_way() {
        let mut motion = Motion::default();
        for k in 0..=1000 {
            let t = 0.01 * f64::from(k);
            let place_m = 1e-3 * (2.0 * std::f64::consts::TAU * t).sin();
            motion.see(SimTime::from_seconds(t), Some(place_m), Some("ileum"));
        }
        let found = motion.figures().unwrap();
        assert!(found.segments[0].way_mm < 1e-6, "{}", found.segments[0].way_mm);
        // Without a place along a tract there is nothing to tell.
        let mut motion = Motion::default();
        motion.see(SimTime::ZERO, None, None);
        assert_eq!(motion.figures(), None);
    }
}
