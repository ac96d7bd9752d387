//! A seeded generator of whole guts, mouth to rectum, inside a torso of given size.
//!
//! The colon ([`super::colon()`]) is the frame; oesophagus, stomach and duodenum (`upper.rs`) stand in it, the small bowel
//! (`small_bowel.rs`) fills the room between: a path on a lattice, drawn evenly at 6 mm, relaxed as an elastic rod
//! (`relaxation.rs`) until its bends are those measured. With `f` the size of the frame, `L` the length from the flexure of the
//! duodenum to the ileocaecal valve,
//!
//! ```text
//! f = body · sqrt(total / 1.35 m),   jejunum 2/5 L,   ileum 3/5 L, the last 0.05 to 0.12 m of it terminal
//! ```
//!
//! Torso: an elliptic cylinder; that of the average man is the body surface of GCA-Models EdinGCA_3D_00090 (0.426 x 0.246 m).
//! That a small woman is 0.90 and a large man 1.08 of it, and the height, are believed, not measured. `length_scale` lengthens the
//! small bowel alone, in the same torso: a cadaver's 7 m have lost their tone and are packed closer.
//!
//! An attempt is kept when every figure of [`crate::statistics`] lies in its measured range and no lumina overlap. A request with another
//! `length_scale` or `radius_scale` than 1 asks for what was not measured: there the overlaps are counted in the report, and only
//! what no tract may have (a centre line within 2 mm of itself) refuses it.
//!
//! Neglected: the ileum enters the caecum at its blind end (the tract is one line); no mesentery pulls; sex and age beyond size.

use super::relaxation::Chain;
use super::small_bowel::{LEAST_PITCH_M, Room, folded_path};
use super::upper::upper;
use super::{ColonRequest, Draws, Generated, Line, STEP_M, colon};
use crate::error::AnatomyError;
use crate::segment::SegmentKey;
use crate::statistics::{PolylineBends, TractStatistics};
use crate::tract::{End, Tract, TractDraft, TractReport};
use lumenav_core::RandomStreams;
use nalgebra::{Point3, Vector3};
use std::f64::consts::TAU;

/// Attempts before giving up.
const ATTEMPTS: u32 = 120;
/// Small bowels tried in one frame of colon, stomach and duodenum, which cost more to make.
const BOWELS_PER_FRAME: u32 = 4;
/// Half extents of the average man's torso, m: breadth and depth measured (GCA-Models EdinGCA_3D_00090), height believed.
const TORSO_M: [f64; 3] = [0.213, 0.123, 0.42];
/// Thickness of the abdominal wall, m; believed.
const WALL_M: f64 = 0.018;
/// The room of the small bowel in the colon's frame, m: between the two flanks, in front of the spine.
const ROOM_M: ([f64; 3], [f64; 3]) = ([-0.078, -0.032, -0.138], [0.078, 0.084, 0.064]);
/// Distance between lumina aimed at, m.
const GAP_M: f64 = 0.0012;
/// Longest small bowel from the duodenum's flexure on, m: the cadaver's.
const LONGEST_M: f64 = 7.0;
/// Bends of the small bowel aimed at: median and 5th percentile of the radius (m), mean curvature (1/m), length per turn (m). The
/// reference's ranges (20 to 24 mm, 6.5 to 9 mm, 48 to 62 /m, 80 to 90 mm) less what a spline through the points differs.
const BENDS: [(f64, f64); 4] = [(0.0202, 0.0238), (0.0067, 0.0088), (48.5, 61.5), (0.0803, 0.0897)];
/// Bending stiffness, sweeps between two looks at the bends, and looks at most.
const STIFFNESS: f64 = 0.09;
const SWEEPS: usize = 4;
const LOOKS: usize = 30;
/// After so many looks a bowel whose turns are too far from those measured is given up, with the range of length per turn, m.
const PATIENT_LOOKS: usize = 4;
const HOPELESS_TURN_M: (f64, f64) = (0.077, 0.093);
/// The same for stomach and duodenum giving way to the colon.
const WAY_STIFFNESS: f64 = 0.03;
const WAY_SWEEPS: usize = 60;
/// Median radius of jejunum and ileum, m, and depth of its variation.
const RADIUS_M: ((f64, f64), (f64, f64)) = ((0.0073, 0.0081), (0.0070, 0.0080));
const RIPPLE: f64 = 0.06;
/// Length of the terminal ileum, m.
const TERMINAL_M: (f64, f64) = (0.05, 0.12);

const SOURCE: &str = "generated; lengths, radii, bend radii and turns within those measured on CT and Visible Human surfaces \
(GCA-Models, doi:10.1186/s12911-023-02111-9) and in the literature (lumenav_anatomy::statistics::MEASURED)";

/// The torso a gut is made for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BodySize {
    /// `small-woman`
    SmallWoman,
    /// `average-man`
    AverageMan,
    /// `large-man`
    LargeMan,
}

impl BodySize {
    /// All sizes.
    pub const ALL: [Self; 3] = [Self::SmallWoman, Self::AverageMan, Self::LargeMan];

    /// The name on command lines and in files.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::SmallWoman => "small-woman",
            Self::AverageMan => "average-man",
            Self::LargeMan => "large-man",
        }
    }

    /// The size of a name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|size| size.as_str() == name)
    }

    /// Half extents of the torso, m.
    pub fn torso_half_extents_m(self) -> Vector3<f64> {
        Vector3::from(TORSO_M) * self.scale()
    }

    /// Size by the average man's.
    fn scale(self) -> f64 {
        match self {
            Self::SmallWoman => 0.90,
            Self::AverageMan => 1.0,
            Self::LargeMan => 1.08,
        }
    }

    /// Range of the length from the duodenum's flexure to the ileocaecal valve, m: measured are 1.60 to 3.45 m; how that
    /// divides over sizes is believed.
    fn small_bowel_m(self) -> (f64, f64) {
        match self {
            Self::SmallWoman => (1.65, 2.30),
            Self::AverageMan => (2.10, 3.00),
            Self::LargeMan => (2.50, 3.40),
        }
    }
}

/// What to generate.
#[derive(Debug, Clone, PartialEq)]
pub struct WholeGutRequest {
    /// The torso.
    pub size: BodySize,
    /// Factor on the length of jejunum and ileum, 0.5 to 4; what comes out may be 7 m at most.
    pub length_scale: f64,
    /// Factor on all radii, 0.5 to 2.
    pub radius_scale: f64,
}

impl WholeGutRequest {
    /// A gut as measured, in a torso of this size.
    pub fn new(size: BodySize) -> Self {
        Self { size, length_scale: 1.0, radius_scale: 1.0 }
    }

    fn check(&self) -> Result<(), AnatomyError> {
        let factors =
            [("length_scale", self.length_scale, 0.5, 4.0), ("radius_scale", self.radius_scale, 0.5, 2.0)];
        for (name, value, low, high) in factors {
            if !(low..=high).contains(&value) {
                return Err(AnatomyError::OutOfRange { name, value, low, high });
            }
        }
        Ok(())
    }

    fn is_as_measured(&self) -> bool {
        (self.length_scale - 1.0).abs() < 1e-12 && (self.radius_scale - 1.0).abs() < 1e-12
    }
}

/// Generates a whole gut from the streams of one seed.
///
/// # Errors
/// [`AnatomyError::OutOfRange`] for factors out of range or a small bowel of more than 7 m; [`AnatomyError::NoGutFound`] when no attempt
/// meets the measured ranges, with the reason of the last.
pub fn whole_gut(request: &WholeGutRequest, streams: &RandomStreams) -> Result<Generated, AnatomyError> {
    request.check()?;
    let (low, high) = request.size.small_bowel_m();
    // Drawn once: the length a seed stands for does not depend on which attempt succeeds.
    let drawn_m = Draws::new(streams, "small bowel length", 0).between(low, high);
    let length_m = drawn_m * request.length_scale;
    if length_m > LONGEST_M {
        let name = "small bowel (m): length drawn times length_scale";
        return Err(AnatomyError::OutOfRange { name, value: length_m, low: 0.0, high: LONGEST_M });
    }
    let mut reason = String::new();
    let mut frame: Result<Frame, String> = Err(String::new());
    for attempt in 0..ATTEMPTS {
        if attempt % BOWELS_PER_FRAME == 0 {
            frame = Frame::draw(request, streams, attempt)?;
        }
        let made = frame.as_ref().map_err(Clone::clone);
        match made.and_then(|frame| try_once(request, frame, length_m, streams, attempt)) {
            Ok((draft, tract, report)) => {
                return Ok(Generated { draft, tract, report, attempts: attempt + 1 });
            }
            Err(failed) => reason = failed,
        }
    }
    Err(AnatomyError::NoGutFound { attempts: ATTEMPTS, reason })
}

/// The parts of one attempt before the small bowel is there.
struct Frame {
    upper: Line,
    colon: Line,
    /// Size of the frame.
    size: f64,
    torso_m: Vector3<f64>,
}

impl Frame {
    /// In words, where upper gut or colon would leave the torso.
    ///
    /// # Errors
    /// [`AnatomyError`] where no colon can be made, which another attempt would not change.
    fn draw(
        request: &WholeGutRequest,
        streams: &RandomStreams,
        attempt: u32,
    ) -> Result<Result<Self, String>, AnatomyError> {
        let body = request.size.scale();
        let colon_request =
            ColonRequest { total_length_m: None, length_scale: body, radius_scale: request.radius_scale };
        let colon_streams = streams.for_component(&format!("colon {attempt}"));
        let made = colon(&colon_request, &colon_streams)?;
        let size = body * (made.tract.length_m() / body / colon::FRAME_TOTAL_M).powf(colon::SIZE_EXPONENT);
        let mut draws = Draws::new(streams, "upper", attempt);
        let upper = upper(&mut draws, size, body, request.radius_scale)?;
        let mut frame =
            Self { upper, colon: line_of(&made.draft), size, torso_m: request.size.torso_half_extents_m() };
        frame.make_way();
        let all = frame.upper.points_m.iter().chain(&frame.colon.points_m);
        let outside = all.copied().find(|point| !frame.is_in_torso(point));
        Ok(match outside {
            Some(point) => Err(format!("the gut would leave the torso at {point}")),
            None => Ok(frame),
        })
    }

    /// Stomach and duodenum give way to the colon; the oesophagus and the flexure at the duodenum's end stay.
    fn make_way(&mut self) {
        let count = self.upper.points_m.len();
        let points_m: Vec<_> = self.upper.points_m.iter().chain(&self.colon.points_m).copied().collect();
        let rest_m = points_m.windows(2).map(|pair| (pair[1] - pair[0]).norm()).collect();
        let stays = |i: usize| i + 1 >= count || self.upper.keys[i] == SegmentKey::Oesophagus;
        let mut chain = Chain {
            radii_m: self.upper.radii_m.iter().chain(&self.colon.radii_m).copied().collect(),
            fixed: (0..points_m.len()).map(stays).collect(),
            points_m,
            rest_m,
            gap_m: GAP_M,
            stiffness: WAY_STIFFNESS,
        };
        chain.relax(WAY_SWEEPS, &|_, point| point);
        self.upper.points_m.copy_from_slice(&chain.points_m[..count]);
    }

    fn is_in_torso(&self, point: &Point3<f64>) -> bool {
        let (x, y) = (point.x / self.torso_m.x, point.y / self.torso_m.y);
        x * x + y * y < 1.0 && point.z.abs() < self.torso_m.z
    }

    fn room_m(&self) -> (Point3<f64>, Point3<f64>) {
        (Point3::from(Vector3::from(ROOM_M.0) * self.size), Point3::from(Vector3::from(ROOM_M.1) * self.size))
    }

    /// The place nearest to a point at which a lumen of this radius lies in the room, behind the abdominal wall.
    fn in_room(&self, point: Point3<f64>, radius_m: f64) -> Point3<f64> {
        let (low, high) = self.room_m();
        let mut point = Point3::from(point.coords.sup(&low.coords).inf(&high.coords));
        let axes = [self.torso_m.x, self.torso_m.y].map(|half| half - WALL_M - radius_m);
        let out = (point.x / axes[0]).hypot(point.y / axes[1]);
        if out > 1.0 {
            point.x /= out;
            point.y /= out;
        }
        point
    }

    /// Whether the centre line of a bowel of this radius may be at a point.
    fn is_free(&self, point: &Point3<f64>, radius_m: f64) -> bool {
        let clear = |line: &Line| {
            line.points_m
                .iter()
                .zip(&line.radii_m)
                .all(|(other, radius)| (other - point).norm() > radius + radius_m + GAP_M)
        };
        (self.in_room(*point, radius_m) - point).norm() < 1e-12 && clear(&self.upper) && clear(&self.colon)
    }
}

/// All points of a draft in one line; a shared point belongs to the anal side.
fn line_of(draft: &TractDraft) -> Line {
    let mut line = Line::default();
    for (i, segment) in draft.segments.iter().enumerate() {
        let count = segment.points_m.len() - usize::from(i + 1 < draft.segments.len());
        for (point, radius) in segment.points_m.iter().zip(&segment.radii_m).take(count) {
            line.push(segment.key, *point, *radius);
        }
    }
    line
}

fn try_once(
    request: &WholeGutRequest,
    frame: &Frame,
    length_m: f64,
    streams: &RandomStreams,
    attempt: u32,
) -> Result<(TractDraft, Tract, TractReport), String> {
    let mut draws = Draws::new(streams, "small bowel", attempt);
    let middle = 0.5 * (RADIUS_M.0.0 + RADIUS_M.0.1) * request.radius_scale;
    let (low, high) = frame.room_m();
    let is_free = |point: &Point3<f64>| frame.is_free(point, middle);
    let room = Room { low, high, is_free: &is_free };
    let (start, end) = (frame.upper.points_m[frame.upper.points_m.len() - 1], frame.colon.points_m[0]);
    let least_m = if request.is_as_measured() { LEAST_PITCH_M.0 } else { LEAST_PITCH_M.1 };
    let path = folded_path(&room, start, end, length_m, least_m, &mut draws)?;
    let bowel = bowel_line(&path, length_m, request.radius_scale, &mut draws);
    let line = settled(frame, &bowel, length_m, request)?;
    let draft = TractDraft {
        name: format!("whole gut, {}", request.size.as_str()),
        segments: line.segments(),
        ends: (End::Closed, End::Exit),
        torso_half_extents_m: Some(frame.torso_m),
        source: SOURCE.to_owned(),
    };
    let (tract, report) = draft.clone().build().map_err(|error| error.to_string())?;
    if request.is_as_measured() {
        judge(&tract, &report)?;
    }
    Ok((draft, tract, report))
}

/// The path drawn evenly, with the segments and radii of jejunum and ileum; without its first point (the duodenum's last) and its
/// last (the caecum's first).
fn bowel_line(path: &[Point3<f64>], length_m: f64, radius_scale: f64, draws: &mut Draws) -> Line {
    let mut along = vec![0.0];
    for pair in path.windows(2) {
        along.push(along[along.len() - 1] + (pair[1] - pair[0]).norm());
    }
    let total = along[along.len() - 1];
    let count = (length_m / STEP_M).round() as usize;
    let radii = [RADIUS_M.0, RADIUS_M.1].map(|(low, high)| draws.between(low, high));
    let (wave_m, phase) = (draws.between(0.05, 0.08), draws.between(0.0, TAU));
    let terminal_m = draws.between(TERMINAL_M.0, TERMINAL_M.1);
    let mut line = Line::default();
    for i in 1..count {
        let (at, s) = (total * i as f64 / count as f64, length_m * i as f64 / count as f64);
        let j = along.partition_point(|a| *a <= at).clamp(1, along.len() - 1) - 1;
        let share = (at - along[j]) / (along[j + 1] - along[j]);
        let key = if s < 0.4 * length_m {
            SegmentKey::Jejunum
        } else if s < length_m - terminal_m {
            SegmentKey::Ileum
        } else {
            SegmentKey::TerminalIleum
        };
        let median = radii[usize::from(key != SegmentKey::Jejunum)];
        let radius_m = median * radius_scale * (1.0 + RIPPLE * (TAU * s / wave_m + phase).sin());
        line.push(key, path[j] + (path[j + 1] - path[j]) * share, radius_m);
    }
    line
}

/// Relaxes the small bowel (and what is above it, but for the mouth) until it bends as measured.
fn settled(frame: &Frame, bowel: &Line, length_m: f64, request: &WholeGutRequest) -> Result<Line, String> {
    let (before, count) = (frame.upper.points_m.len(), bowel.points_m.len());
    let mut line = frame.upper.clone();
    for part in [bowel, &frame.colon] {
        line.keys.extend(&part.keys);
        line.points_m.extend(&part.points_m);
        line.radii_m.extend(&part.radii_m);
    }
    let rest_m = (0..line.points_m.len() - 1)
        .map(|i| {
            let own = (before - 1..before + count).contains(&i);
            if own { length_m / (count + 1) as f64 } else { (line.points_m[i + 1] - line.points_m[i]).norm() }
        })
        .collect();
    let mut chain = Chain {
        points_m: line.points_m.clone(),
        radii_m: line.radii_m.clone(),
        fixed: (0..line.points_m.len()).map(|i| !(before..before + count).contains(&i)).collect(),
        rest_m,
        gap_m: GAP_M,
        stiffness: STIFFNESS,
    };
    let cavity = |i: usize, point: Point3<f64>| frame.in_room(point, line.radii_m[i]);
    let duodenum = frame.upper.keys.iter().position(|key| *key == SegmentKey::Duodenum).unwrap_or(0);
    let (mut last, mut settled) = (String::new(), false);
    for look in 0..LOOKS {
        chain.relax(SWEEPS, &cavity);
        let bends = PolylineBends::of(&chain.points_m[duodenum..=before + count]);
        let per_turn_m = bends.length_per_turn_m();
        let hopeless =
            look >= PATIENT_LOOKS && !(HOPELESS_TURN_M.0..=HOPELESS_TURN_M.1).contains(&per_turn_m);
        if request.is_as_measured() {
            if bends.within(&BENDS) {
                settled = true;
                break;
            }
            last = bends.to_string();
            if hopeless {
                break;
            }
        }
    }
    if request.is_as_measured() && !settled {
        return Err(format!("the small bowel would not bend as measured: {last}"));
    }
    line.points_m = chain.points_m;
    Ok(line)
}

/// Whether a tract is as measured; in words, where not.
fn judge(tract: &Tract, report: &TractReport) -> Result<(), String> {
    if let Some(warning) = report.warnings.first() {
        return Err(warning.clone());
    }
    let outside = TractStatistics::of(tract, report).verdicts().into_iter().find(|verdict| !verdict.inside());
    outside.map_or(Ok(()), |verdict| Err(verdict.to_string()))
}
