//! A tract: segments from mouth to anus along one centre line, with a radius profile and two ends.
//!
//! Built from a [`TractDraft`], the points of each segment. Building
//!
//! 1. keeps the segments asked for (consecutive ones),
//! 2. joins them: the gap between two segments belongs to the segment before it, is bridged by the spline itself (and so
//!    is twice differentiable) when below 50 mm, and is named in the [`TractReport`]; end points closer than 0.2 mm
//!    are one point,
//! 3. refuses a centre line that comes within 2 mm of itself, and counts overlapping lumina. Both look at pairs more
//!    than 6 cm apart along the line; for lumina the pair also has to be 1.5 times the sum of both radii apart, so that
//!    a tight bend is not taken for an overlap.
//!
//! Everything is in the torso frame. Neglected: overlaps shorter than the sampling step of 2 mm.

use crate::centre_line::{CentreLine, Station};
use crate::error::AnatomyError;
use crate::radius::RadiusProfile;
use crate::segment::{Landmark, Segment, SegmentKey, Wall};
use lumenav_core::Name;
use lumenav_core::path_map::{PathMap, PathProjection};
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

/// Largest gap that is bridged, m.
pub const BRIDGE_LIMIT_M: f64 = 0.05;
/// The centre line may not come closer to itself, m.
pub const APPROACH_LIMIT_M: f64 = 0.002;
/// Pairs closer than this along the line are neighbours, m.
pub const NEIGHBOUR_M: f64 = 0.06;
/// End points of segments closer than this are one point, m.
const SAME_POINT_M: f64 = 0.2e-3;
/// Sampling step of the self-approach check, m.
const SAMPLE_M: f64 = 0.002;
/// Radii and lengths beyond which a file's unit is doubted, m: the narrowest lumen that a capsule passes and a filled stomach, and three times the longest gut.
const ODD_RADII_M: [f64; 2] = [1e-3, 0.1];
const ODD_LENGTH_M: f64 = 30.0;
/// Places at which that is looked at.
const ODD_SAMPLES: usize = 500;
/// Samples of that check at most.
const SAMPLE_LIMIT: f64 = 4000.0;

/// What an end of a tract does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum End {
    /// A wall: a capsule cannot pass.
    Closed,
    /// The way out: a capsule that passes has left.
    Exit,
}

/// One segment before it is joined to the others.
#[derive(Debug, Clone, PartialEq)]
pub struct SegmentPoints {
    /// Which segment.
    pub key: SegmentKey,
    /// Points of the centre line from oral to anal, torso frame, m.
    pub points_m: Vec<Point3<f64>>,
    /// Resting radius at each point, m.
    pub radii_m: Vec<f64>,
    /// Its wall.
    pub wall: Wall,
    /// Where the numbers come from.
    pub source: String,
}

/// A tract before it is built.
#[derive(Debug, Clone, PartialEq)]
pub struct TractDraft {
    /// Name.
    pub name: String,
    /// Segments in order from mouth to anus.
    pub segments: Vec<SegmentPoints>,
    /// Oral and anal end.
    pub ends: (End, End),
    /// Half the box around the torso, m, where the file states it.
    pub torso_half_extents_m: Option<Vector3<f64>>,
    /// Where the numbers come from.
    pub source: String,
}

/// A gap that was bridged.
#[derive(Debug, Clone, PartialEq)]
pub struct Bridge {
    /// The segment before, to which the bridge belongs.
    pub before: SegmentKey,
    /// The segment after.
    pub after: SegmentKey,
    /// Distance of the two end points, m.
    pub gap_m: f64,
}

/// A stretch along which the lumen overlaps another part of itself.
#[derive(Debug, Clone, PartialEq)]
pub struct Overlap {
    /// The oral segment of the two.
    pub first: SegmentKey,
    /// The anal one.
    pub second: SegmentKey,
    /// Arc lengths of the deepest pair, m.
    pub at_m: (f64, f64),
    /// Deepest overlap: sum of the radii less the distance, m.
    pub depth_m: f64,
    /// Length of the stretch along the oral segment, m.
    pub length_m: f64,
}

/// What building a tract has to tell.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TractReport {
    /// Gaps that were bridged.
    pub bridges: Vec<Bridge>,
    /// Stretches that overlap.
    pub overlaps: Vec<Overlap>,
    /// The same and anything else, in words.
    pub warnings: Vec<String>,
}

/// Resting, contracted and distended radius at one place, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Radii {
    /// At rest.
    pub resting_m: f64,
    /// Fully contracted.
    pub contracted_m: f64,
    /// Distended.
    pub distended_m: f64,
}

/// A tract, torso frame, m. As a [`PathMap`] it stands in a world that is its torso frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Tract {
    /// Name.
    pub name: String,
    /// The centre line.
    pub centre_line: CentreLine,
    /// Resting radius by arc length.
    pub radius: RadiusProfile,
    /// Segments from mouth to anus: the first starts at 0, each ends where the next starts, the last at the length.
    pub segments: Vec<Segment>,
    /// Oral and anal end.
    pub ends: (End, End),
    /// Half the box around the torso, m, where known.
    pub torso_half_extents_m: Option<Vector3<f64>>,
    /// Where the numbers come from.
    pub source: String,
    names: Vec<Name>,
}

/// Points of all chosen segments in one row.
struct Joined {
    points_m: Vec<Point3<f64>>,
    radii_m: Vec<f64>,
    /// Index of the first point of each segment.
    first: Vec<usize>,
    bridges: Vec<Bridge>,
}

impl TractDraft {
    /// One straight segment of an even radius along z from the origin, points 20 mm apart: an organ by itself.
    pub fn straight(key: SegmentKey, radius_m: f64, length_m: f64, ends: (End, End)) -> Self {
        const SPACING_M: f64 = 0.02;
        let count = (length_m / SPACING_M).round().max(2.0) as u32;
        let spacing_m = length_m / f64::from(count);
        let points_m: Vec<_> = (0..=count).map(|i| Point3::new(0.0, 0.0, spacing_m * f64::from(i))).collect();
        let radii_m = vec![radius_m; points_m.len()];
        let segment =
            SegmentPoints { key, points_m, radii_m, wall: key.default_wall(), source: String::new() };
        let name = format!("straight {}", key.as_str());
        Self { name, segments: vec![segment], ends, torso_half_extents_m: None, source: String::new() }
    }

    /// Segments there are, in order.
    pub fn keys(&self) -> Vec<SegmentKey> {
        self.segments.iter().map(|segment| segment.key).collect()
    }

    /// Scales the centre line (not the radii) about the torso's origin, and the radii by themselves.
    ///
    /// # Errors
    /// [`AnatomyError::OutOfRange`] for factors outside 0.1 to 10.
    pub fn scaled(mut self, length_scale: f64, radius_scale: f64) -> Result<Self, AnatomyError> {
        for (name, value) in [("length_scale", length_scale), ("radius_scale", radius_scale)] {
            if !(0.1..=10.0).contains(&value) {
                return Err(AnatomyError::OutOfRange { name, value, low: 0.1, high: 10.0 });
            }
        }
        for segment in &mut self.segments {
            segment.points_m.iter_mut().for_each(|point| point.coords *= length_scale);
            segment.radii_m.iter_mut().for_each(|radius| *radius *= radius_scale);
        }
        Ok(self)
    }

    /// Keeps only these segments; all where `keys` is empty.
    ///
    /// # Errors
    /// [`AnatomyError`]: a segment that is not there (with those that are), or segments that do not follow each other.
    pub fn select(mut self, keys: &[SegmentKey]) -> Result<Self, AnatomyError> {
        let available = self.keys();
        let mut places = Vec::new();
        for key in keys {
            let Some(place) = available.iter().position(|a| a == key) else {
                return Err(AnatomyError::NoSuchSegment { asked: key.to_string(), available });
            };
            if places.last().is_some_and(|last: &usize| last + 1 != place) {
                let before = available[places[places.len() - 1]];
                return Err(AnatomyError::NotConsecutive { before, after: *key, available });
            }
            places.push(place);
        }
        if let (Some(first), Some(last)) = (places.first(), places.last()) {
            // Where a tract is cut open there is a way on.
            if last + 1 < available.len() {
                self.ends.1 = End::Exit;
            }
            self.segments = self.segments.drain(*first..=*last).collect();
        }
        Ok(self)
    }

    /// The segment (index) and row of a point of the joined line, for messages.
    pub fn locate(&self, index: usize) -> Option<(usize, usize)> {
        let joined = self.join().ok()?;
        let segment = joined.first.partition_point(|first| *first <= index).checked_sub(1)?;
        let kept =
            joined.first.get(segment + 1).copied().unwrap_or(joined.points_m.len()) - joined.first[segment];
        let dropped = self.segments[segment].points_m.len() - kept;
        Some((segment, index - joined.first[segment] + dropped))
    }

    fn join(&self) -> Result<Joined, AnatomyError> {
        let (mut points_m, mut radii_m) = (Vec::<Point3<f64>>::new(), Vec::new());
        let (mut first, mut bridges) = (Vec::new(), Vec::new());
        let mut before: Option<SegmentKey> = None;
        for segment in &self.segments {
            let mut skip = 0;
            if let (Some(before), Some(last), Some(next)) =
                (before, points_m.last(), segment.points_m.first())
            {
                let gap_m = (next - last).norm();
                if gap_m > BRIDGE_LIMIT_M {
                    let (after, limit_m) = (segment.key, BRIDGE_LIMIT_M);
                    return Err(AnatomyError::Gap { before, after, gap_m, limit_m });
                }
                if gap_m < SAME_POINT_M {
                    skip = 1;
                } else {
                    bridges.push(Bridge { before, after: segment.key, gap_m });
                }
            }
            // A segment of which only the shared point would be left still needs a place of its own.
            if segment.points_m.len() < 2 {
                return Err(AnatomyError::TooFewPoints { count: segment.points_m.len() });
            }
            first.push(points_m.len());
            points_m.extend_from_slice(&segment.points_m[skip..]);
            radii_m.extend(segment.radii_m.iter().skip(skip));
            before = Some(segment.key);
        }
        Ok(Joined { points_m, radii_m, first, bridges })
    }

    /// Builds the tract.
    ///
    /// # Errors
    /// [`AnatomyError`]: no segments, segments out of order, gaps of 50 mm or more, points the centre line refuses, radii that are not
    /// positive, a centre line that comes within 2 mm of itself.
    pub fn build(self) -> Result<(Tract, TractReport), AnatomyError> {
        if self.segments.is_empty() {
            return Err(AnatomyError::NoSegments);
        }
        if let Some(pair) = self.segments.windows(2).find(|pair| pair[0].key >= pair[1].key) {
            let (before, after) = (pair[0].key, pair[1].key);
            return Err(AnatomyError::NotConsecutive { before, after, available: self.keys() });
        }
        let joined = self.join()?;
        let centre_line = CentreLine::through(&joined.points_m)?;
        let knots_m = centre_line.knots_m();
        let entries: Vec<(f64, f64)> = knots_m.iter().copied().zip(joined.radii_m.iter().copied()).collect();
        let radius = RadiusProfile::through(&entries)?;
        // A shared point belongs to the segment before in the list, but is where the next one starts.
        let start_of = |i: usize| {
            let first = joined.first[i];
            let bridged = joined.bridges.iter().any(|b| b.after == self.segments[i].key);
            knots_m[if i == 0 || bridged { first } else { first - 1 }]
        };
        let length_m = centre_line.length_m();
        let segments: Vec<Segment> = (0..self.segments.len())
            .map(|i| Segment {
                key: self.segments[i].key,
                start_m: start_of(i),
                end_m: if i + 1 < self.segments.len() { start_of(i + 1) } else { length_m },
                wall: self.segments[i].wall,
                source: self.segments[i].source.clone(),
            })
            .collect();
        let names = segments.iter().map(|segment| Name::from(segment.key.as_str())).collect();
        let tract = Tract {
            name: self.name,
            centre_line,
            radius,
            segments,
            ends: self.ends,
            torso_half_extents_m: self.torso_half_extents_m,
            source: self.source,
            names,
        };
        let report = tract.examine(joined.bridges)?;
        Ok((tract, report))
    }
}

impl Tract {
    /// Length, m.
    pub fn length_m(&self) -> f64 {
        self.centre_line.length_m()
    }

    /// The place at an arc length, torso frame.
    pub fn station(&self, arc_length_m: f64) -> Station {
        self.centre_line.station(arc_length_m)
    }

    /// Index of the segment at an arc length (clamped); a boundary belongs to the anal side.
    pub fn segment_index_at(&self, arc_length_m: f64) -> usize {
        self.segments.partition_point(|segment| segment.start_m <= arc_length_m).saturating_sub(1)
    }

    /// The segment at an arc length (clamped).
    pub fn segment_at(&self, arc_length_m: f64) -> &Segment {
        &self.segments[self.segment_index_at(arc_length_m)]
    }

    /// The segment of a key.
    pub fn segment(&self, key: SegmentKey) -> Option<&Segment> {
        self.segments.iter().find(|segment| segment.key == key)
    }

    /// The segment's shared name at an arc length.
    pub fn segment_name_at(&self, arc_length_m: f64) -> Name {
        self.names[self.segment_index_at(arc_length_m)].clone()
    }

    /// Resting, contracted and distended radius, m.
    pub fn radii(&self, arc_length_m: f64) -> Radii {
        let resting_m = self.radius.radius_m(arc_length_m);
        let wall = &self.segment_at(arc_length_m).wall;
        Radii {
            resting_m,
            contracted_m: resting_m * wall.contracted_factor,
            distended_m: resting_m * wall.distended_factor,
        }
    }

    /// The named places, in order. The ends of a part of the gut have no landmark unless it is there in life.
    pub fn landmarks(&self) -> Vec<Landmark> {
        let mut landmarks: Vec<Landmark> = self
            .segments
            .iter()
            .filter_map(|segment| {
                let name = segment.key.oral_landmark()?;
                Some(Landmark { name, arc_length_m: segment.start_m })
            })
            .collect();
        if self.segments.last().is_some_and(|last| last.key == SegmentKey::Rectum) {
            landmarks.push(Landmark { name: "anus", arc_length_m: self.length_m() });
        }
        landmarks
    }

    /// What no gut measures: a file in another unit.
    fn odd_sizes(&self) -> Vec<String> {
        let mut odd = Vec::new();
        let samples = (0..=ODD_SAMPLES).map(|k| self.length_m() * k as f64 / ODD_SAMPLES as f64);
        let radii = samples.map(|s| self.radii(s).resting_m);
        let (least_m, most_m) =
            radii.fold((f64::INFINITY, 0.0_f64), |(least, most), r| (least.min(r), most.max(r)));
        if least_m < ODD_RADII_M[0] || most_m > ODD_RADII_M[1] {
            odd.push(format!(
                "its radii go from {:.3} to {:.1} mm; is the unit right?",
                1e3 * least_m,
                1e3 * most_m
            ));
        }
        if self.length_m() > ODD_LENGTH_M {
            odd.push(format!("it is {:.1} m long; is the unit right?", self.length_m()));
        }
        odd
    }

    fn examine(&self, bridges: Vec<Bridge>) -> Result<TractReport, AnatomyError> {
        let overlaps = self.overlaps()?;
        let mut warnings: Vec<String> = bridges
            .iter()
            .map(|b| {
                format!(
                    "a gap of {:.1} mm between `{}` and `{}` was bridged",
                    1e3 * b.gap_m,
                    b.before,
                    b.after
                )
            })
            .collect();
        warnings.extend(self.odd_sizes());
        if let Some(deepest) = overlaps.iter().max_by(|a, b| a.depth_m.total_cmp(&b.depth_m)) {
            warnings.push(format!(
                "the lumen overlaps itself in {} places, by {:.1} mm where `{}` meets `{}` (at {:.3} m and {:.3} m)",
                overlaps.len(),
                1e3 * deepest.depth_m,
                deepest.first,
                deepest.second,
                deepest.at_m.0,
                deepest.at_m.1
            ));
        }
        Ok(TractReport { bridges, overlaps, warnings })
    }

    /// Overlapping stretches; refuses a centre line too close to itself.
    fn overlaps(&self) -> Result<Vec<Overlap>, AnatomyError> {
        let length_m = self.length_m();
        let step_m = SAMPLE_M.max(length_m / SAMPLE_LIMIT);
        let count = (length_m / step_m).ceil() as usize;
        let samples: Vec<(f64, Point3<f64>, f64)> = (0..=count)
            .map(|i| length_m * i as f64 / count as f64)
            .map(|s| (s, self.station(s).position_m, self.radius.radius_m(s)))
            .collect();
        let mut found: Vec<(usize, Overlap)> = Vec::new();
        let first_apart = (NEIGHBOUR_M / length_m * count as f64).floor() as usize;
        for (i, (s, point, radius)) in samples.iter().enumerate() {
            let mut closest = (f64::INFINITY, 0.0);
            let mut deepest = (0.0, 0.0);
            for (other_s, other, other_radius) in samples.iter().skip(i + first_apart.max(1)) {
                let apart = other_s - s;
                let distance = (other - point).norm();
                if apart > NEIGHBOUR_M && distance < closest.0 {
                    closest = (distance, *other_s);
                }
                let sum = radius + other_radius;
                if apart > NEIGHBOUR_M.max(1.5 * sum) && sum - distance > deepest.0 {
                    deepest = (sum - distance, *other_s);
                }
            }
            if closest.0 < APPROACH_LIMIT_M + 2.0 * step_m {
                self.refuse_approach(*s, closest.1)?;
            }
            if deepest.0 > 0.0 {
                self.note_overlap(&mut found, i, *s, deepest, step_m);
            }
        }
        Ok(found.into_iter().map(|(_, overlap)| overlap).collect())
    }

    /// Extends the overlap that ended at the sample before, or begins one.
    fn note_overlap(
        &self,
        found: &mut Vec<(usize, Overlap)>,
        sample: usize,
        s: f64,
        (depth_m, other_s): (f64, f64),
        step_m: f64,
    ) {
        let (first, second) = (self.segment_at(s).key, self.segment_at(other_s).key);
        match found.last_mut() {
            Some((last, overlap))
                if *last + 1 == sample && (overlap.first, overlap.second) == (first, second) =>
            {
                *last = sample;
                overlap.length_m += step_m;
                if depth_m > overlap.depth_m {
                    (overlap.depth_m, overlap.at_m) = (depth_m, (s, other_s));
                }
            }
            _ => {
                found
                    .push((sample, Overlap { first, second, at_m: (s, other_s), depth_m, length_m: step_m }));
            }
        }
    }

    /// Refines a close pair by alternating projections and refuses it where it is too close.
    fn refuse_approach(&self, s: f64, other_s: f64) -> Result<(), AnatomyError> {
        let line = &self.centre_line;
        let (mut a, mut b) = (s, other_s);
        for _ in 0..8 {
            b = line.project_near(&line.station(a).position_m, b).arc_length_m;
            a = line.project_near(&line.station(b).position_m, a).arc_length_m;
        }
        let distance_m = (line.station(a).position_m - line.station(b).position_m).norm();
        let (first_m, second_m) = (a.min(b), a.max(b));
        if second_m - first_m > NEIGHBOUR_M && distance_m < APPROACH_LIMIT_M {
            return Err(AnatomyError::SelfApproach {
                first_m,
                first: self.segment_at(first_m).key,
                second_m,
                second: self.segment_at(second_m).key,
                distance_m,
                limit_m: APPROACH_LIMIT_M,
            });
        }
        Ok(())
    }
}

impl PathMap for Tract {
    fn nearest(&self, point_world_m: &Point3<f64>, count: usize) -> Vec<PathProjection> {
        let feet = self.centre_line.nearest(point_world_m, count);
        feet.into_iter()
            .map(|foot| PathProjection {
                arc_length_m: foot.arc_length_m,
                point_world_m: foot.station.position_m,
                radius_m: self.radius.radius_m(foot.arc_length_m),
                distance_m: foot.distance_m,
                segment: Some(self.segment_name_at(foot.arc_length_m)),
            })
            .collect()
    }

    fn length_m(&self) -> f64 {
        self.centre_line.length_m()
    }
}
