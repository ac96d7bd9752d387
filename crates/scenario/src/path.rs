//! Paths of kinematic truth: the pose as a function of time.
//!
//! - *helix*: `than2015`, start (-57, 0, -45) mm, end (57, 0, 45) mm in 36 s: half a turn, 5 mm/s around z (4.974 exactly) and
//!   2.5 mm/s along it;
//! - *three half circles*: the track of `than2015`, diameters 116, 112 and 116 mm in the YZ, XZ and YZ planes at a constant speed
//!   (published: 7.5, 12, 17, 21 and 27 mm/s), with a rest at each of the two joints. Planes and diameters are published; the
//!   joints, the centre and the place of the rests are the project's own choice, those of the tract model `than2015-track`;
//! - *line* and *recorded trajectory*.
//!
//! The capsule's x axis follows the path's tangent. Every path but the line has an end: what happens beyond it is
//! [`AfterEnd`]'s.

use lumenav_core::SimTime;
use lumenav_core::pose::attitude_from_axis;
use nalgebra::{Isometry3, Translation3, Vector3};
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// `after_end`: what a path does beyond its ends.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AfterEnd {
    /// A scenario that lasts longer is refused.
    #[default]
    Refuse,
    /// The capsule rests at the end (and, in a recording that begins later than the scenario, at its start).
    Hold,
}

/// A pose as a function of time.
pub(crate) trait Path: Send + Sync {
    /// The pose, without any jump.
    fn pose(&self, seconds: f64) -> Isometry3<f64>;

    /// When it begins and ends, s.
    fn times_s(&self) -> [f64; 2];

    /// What a jump has added to the position until then, world, m.
    fn jumped_m(&self, _seconds: f64) -> Vector3<f64> {
        Vector3::zeros()
    }

    /// Points for the picture, world, m.
    fn outline(&self) -> Vec<Vector3<f64>>;
}

fn along(position_m: Vector3<f64>, tangent: &Vector3<f64>) -> Isometry3<f64> {
    Isometry3::from_parts(Translation3::from(position_m), attitude_from_axis(tangent))
}

/// The published helix.
pub(crate) struct Helix {
    pub(crate) speed_factor: f64,
    /// When (s) and by what (world, m) the capsule jumps.
    pub(crate) jump: Option<(f64, Vector3<f64>)>,
}

impl Helix {
    const RADIUS_M: f64 = 0.057;
    const HALF_HEIGHT_M: f64 = 0.045;
    const DURATION_S: f64 = 36.0;
}

impl Path for Helix {
    fn pose(&self, seconds: f64) -> Isometry3<f64> {
        // 5 mm/s on a radius of 57 mm makes 3.158 rad in 36 s: the half turn between the published ends.
        let progress = seconds * self.speed_factor / Self::DURATION_S;
        let angle = PI * (1.0 - progress);
        let (sine, cosine) = angle.sin_cos();
        let position = Vector3::new(
            Self::RADIUS_M * cosine,
            -Self::RADIUS_M * sine,
            Self::HALF_HEIGHT_M * (2.0 * progress - 1.0),
        );
        let around = PI * Self::RADIUS_M;
        let tangent = Vector3::new(around * sine, around * cosine, 2.0 * Self::HALF_HEIGHT_M).normalize();
        along(position, &tangent)
    }

    fn times_s(&self) -> [f64; 2] {
        [0.0, Self::DURATION_S / self.speed_factor]
    }

    fn jumped_m(&self, seconds: f64) -> Vector3<f64> {
        self.jump.filter(|(at_s, _)| seconds >= *at_s).map_or_else(Vector3::zeros, |(_, by_m)| by_m)
    }

    fn outline(&self) -> Vec<Vector3<f64>> {
        let end_s = self.times_s()[1];
        let times = (0..=90).map(|i| f64::from(i) / 90.0 * end_s);
        times.map(|t| self.pose(t).translation.vector + self.jumped_m(t)).collect()
    }
}

/// The track of three half circles.
pub(crate) struct HalfCircles {
    pub(crate) speed_m_s: f64,
    pub(crate) pause_s: f64,
}

/// A half circle: `middle + radius (to_start cos a + to_top sin a)` for `a` from 0 to π.
struct Half {
    middle_m: Vector3<f64>,
    radius_m: f64,
    to_start: Vector3<f64>,
    to_top: Vector3<f64>,
}

impl HalfCircles {
    const RADII_M: [f64; 3] = [0.058, 0.056, 0.058];

    fn halves() -> [Half; 3] {
        let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
        let [r1, r2, r3] = Self::RADII_M;
        [
            Half { middle_m: -x * r2 - y * r1, radius_m: r1, to_start: -y, to_top: z },
            Half { middle_m: Vector3::zeros(), radius_m: r2, to_start: -x, to_top: -z },
            Half { middle_m: x * r2 + y * r3, radius_m: r3, to_start: -y, to_top: z },
        ]
    }

    fn length_m() -> f64 {
        PI * Self::RADII_M.iter().sum::<f64>()
    }

    /// Arc length at a time, m; goes on at the ends as it went inside.
    fn travelled_m(&self, seconds: f64) -> f64 {
        let [r1, r2, _] = Self::RADII_M;
        let mut moving_s = seconds;
        for joint_m in [PI * r1, PI * (r1 + r2)] {
            let reached_s = joint_m / self.speed_m_s;
            // What lies behind the rest at a joint is as if the clock had stood still.
            moving_s = if moving_s > reached_s { (moving_s - self.pause_s).max(reached_s) } else { moving_s };
        }
        moving_s * self.speed_m_s
    }

    fn at_m(arc_length_m: f64) -> Isometry3<f64> {
        let [first, second, third] = Self::halves();
        let joints_m = [PI * first.radius_m, PI * (first.radius_m + second.radius_m)];
        let (half, begin_m) = if arc_length_m < joints_m[0] {
            (first, 0.0)
        } else if arc_length_m < joints_m[1] {
            (second, joints_m[0])
        } else {
            (third, joints_m[1])
        };
        let (sine, cosine) = ((arc_length_m - begin_m) / half.radius_m).sin_cos();
        let position = half.middle_m + (half.to_start * cosine + half.to_top * sine) * half.radius_m;
        along(position, &(half.to_top * cosine - half.to_start * sine))
    }
}

impl Path for HalfCircles {
    fn pose(&self, seconds: f64) -> Isometry3<f64> {
        Self::at_m(self.travelled_m(seconds))
    }

    fn times_s(&self) -> [f64; 2] {
        [0.0, Self::length_m() / self.speed_m_s + 2.0 * self.pause_s]
    }

    fn outline(&self) -> Vec<Vector3<f64>> {
        let length_m = Self::length_m();
        (0..=270).map(|i| Self::at_m(f64::from(i) / 270.0 * length_m).translation.vector).collect()
    }
}

/// Back and forth between two points.
pub(crate) struct Line {
    pub(crate) from_m: Vector3<f64>,
    pub(crate) to_m: Vector3<f64>,
    pub(crate) speed_m_s: f64,
}

impl Path for Line {
    fn pose(&self, seconds: f64) -> Isometry3<f64> {
        let between = self.to_m - self.from_m;
        let length = between.norm();
        let travelled = (seconds * self.speed_m_s).rem_euclid(2.0 * length);
        let forward = travelled.min(2.0 * length - travelled);
        let tangent = between / length;
        along(self.from_m + tangent * forward, &tangent)
    }

    fn times_s(&self) -> [f64; 2] {
        [0.0, f64::INFINITY]
    }

    fn outline(&self) -> Vec<Vector3<f64>> {
        vec![self.from_m, self.to_m]
    }
}

/// A recorded trajectory of two poses at least, interpolated at constant twist; rests before and behind its rows.
pub(crate) struct Recorded {
    pub(crate) poses: Vec<(SimTime, Isometry3<f64>)>,
}

impl Path for Recorded {
    fn pose(&self, seconds: f64) -> Isometry3<f64> {
        let at = SimTime::from_seconds(seconds);
        let after = self.poses.partition_point(|(t, _)| *t < at);
        match (after.checked_sub(1).and_then(|i| self.poses.get(i)), self.poses.get(after)) {
            (Some((ta, a)), Some((tb, b))) => {
                lumenav_core::pose::interpolate(a, b, at.since_s(*ta) / tb.since_s(*ta))
            }
            (Some((_, a)), None) => *a,
            (None, Some((_, b))) => *b,
            (None, None) => Isometry3::identity(),
        }
    }

    fn times_s(&self) -> [f64; 2] {
        let ends = [self.poses.first(), self.poses.last()];
        ends.map(|row| row.map_or(0.0, |(at, _)| at.seconds()))
    }

    fn outline(&self) -> Vec<Vector3<f64>> {
        let step = (self.poses.len() / 2000).max(1);
        self.poses.iter().step_by(step).map(|(_, p)| p.translation.vector).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place(path: &dyn Path, seconds: f64) -> Vector3<f64> {
        path.pose(seconds).translation.vector + path.jumped_m(seconds)
    }

    #[test]
    fn closed_form_three_half_circles_at_their_ends_tops_and_joints() {
        // Quarter by quarter: start, top, joint, bottom, joint, top, end; a quarter of 58 mm at 7.5 mm/s takes 12.15 s.
        let path = HalfCircles { speed_m_s: 7.5e-3, pause_s: 4.0 };
        let quarter = |radius_mm: f64| 0.5 * PI * radius_mm / 7.5;
        let (a, b) = (quarter(58.0), quarter(56.0));
        for (t, [x, y, z]) in [
            (0.0, [-56.0, -116.0, 0.0]),
            (a, [-56.0, -58.0, 58.0]),
            (2.0 * a, [-56.0, 0.0, 0.0]),
            (2.0 * a + 3.9, [-56.0, 0.0, 0.0]),
            (2.0 * a + 4.0 + b, [0.0, 0.0, -56.0]),
            (2.0 * a + 4.0 + 2.0 * b, [56.0, 0.0, 0.0]),
            (2.0 * a + 8.0 + 2.0 * b, [56.0, 0.0, 0.0]),
            (3.0 * a + 8.0 + 2.0 * b, [56.0, 58.0, 58.0]),
            (4.0 * a + 8.0 + 2.0 * b, [56.0, 116.0, 0.0]),
        ] {
            let off = place(&path, t) - Vector3::new(x, y, z) * 1e-3;
            assert!(off.norm() < 1e-12, "at {t} s: {off}");
        }
        let end_s = path.times_s()[1];
        assert!((end_s - (4.0 * a + 8.0 + 2.0 * b)).abs() < 1e-9, "{end_s}");
        assert!((end_s - (540.354 / 7.5 + 8.0)).abs() < 1e-3, "the track is 540.354 mm long: {end_s}");
    }

    #[test]
    fn closed_form_three_half_circles_keep_their_speed_and_point_along_it() {
        for speed_mm_s in [7.5, 12.0, 17.0, 21.0, 27.0] {
            let path = HalfCircles { speed_m_s: speed_mm_s * 1e-3, pause_s: 0.0 };
            let end_s = path.times_s()[1];
            for i in 1..300 {
                let t = end_s * f64::from(i) / 300.0;
                let way = place(&path, t + 1e-4) - place(&path, t - 1e-4);
                assert!((way.norm() / 2e-4 / (speed_mm_s * 1e-3) - 1.0).abs() < 1e-4, "at {t} s");
                let forward = path.pose(t).rotation * Vector3::x();
                assert!((forward - way.normalize()).norm() < 1e-4, "at {t} s");
            }
        }
    }

    #[test]
    fn cross_three_half_circles_are_the_tract_of_the_same_name() {
        use lumenav_anatomy::tract_file::{TractOptions, load};
        let model = concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/tracts/than2015-track.toml");
        let node = lumenav_core::Node::open(std::path::Path::new(model)).unwrap();
        let (tract, _) = load(&node, &TractOptions::default()).unwrap();
        let path = HalfCircles { speed_m_s: 0.01, pause_s: 0.0 };
        for i in 0..=540 {
            let s = 1e-3 * f64::from(i);
            // The spline rounds off the jumps of the curvature at the joints.
            let off = (place(&path, s / 0.01) - tract.station(s).position_m.coords).norm();
            assert!(off < 1e-4, "{off} m apart at {s} m");
        }
    }

    #[test]
    fn closed_form_a_jump_displaces_the_helix_from_its_time_on() {
        let by_m = Vector3::new(0.0, 0.03, 0.04);
        let (plain, jumps) =
            (Helix { speed_factor: 1.0, jump: None }, Helix { speed_factor: 1.0, jump: Some((15.0, by_m)) });
        assert!((by_m.norm() - 0.05).abs() < 1e-15);
        for (t, off_m) in [(0.0, 0.0), (14.999, 0.0), (15.0, 0.05), (36.0, 0.05)] {
            let off = (place(&jumps, t) - place(&plain, t)).norm();
            assert!((off - off_m).abs() < 1e-15, "{off} at {t} s");
            assert_eq!(jumps.pose(t).rotation, plain.pose(t).rotation);
        }
    }
}
