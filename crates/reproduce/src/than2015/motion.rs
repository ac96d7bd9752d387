//! The paths of than2015.
//!
//! **Helix** (chapter 4): from (-57, 0, -45) to (57, 0, 45) mm in 36 s, 5 mm/s around the axis and 2.5 mm/s along it, 720 windows of
//! 50 ms. The midpoint of the two base markers (the capsule's origin here) runs along it. Text: at the start the apex lies along +y of
//! the base's midpoint and the base along z; the capsule turns with its way round. Our frame: x forward, apex at -x, base along y, so
//!
//! ```text
//! p = (57 cos φ, 57 sin φ, z) mm,  φ = π + ω t,  ω = π/36 s⁻¹,  z = -45 + 2.5 t
//! R = Rz(ω t) [-y, z, -x]          (columns: where x, y, z of the capsule point at the start)
//! ```
//!
//! (The thesis' simulation macros leave the text's rotation out and put the apex along z; the text is followed.)
//!
//! **Jump** (figure 4.11): 50 mm at the start of run 300, along +y here (the direction has no record); the helix goes on from there,
//! inside the cylinder of 20 cm.
//!
//! **Track** (chapter 5): three half circles of 116, 112 and 116 mm in the planes YZ, XZ and YZ, 540.4 mm in all, forward and back at
//! five speeds with six pauses, 480 s. How the half circles are joined has no record: here smoothly, and so that the third runs back
//! beside the first, since a track of 232 mm (`models/tracts/than2015-track.toml`) would not fit into the phantom of 216 mm; centred
//! on the phantom. Nor have speeds and pauses: 5, 10, 20, 30 and 40 mm/s (the range of figure 4.12), a trip forward and back each, and
//! what is left of 480 s in six equal pauses before, between and after them.

use crate::ReproduceError;
use lumenav_anatomy::centre_line::CentreLine;
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use std::f64::consts::PI;

/// A path over time.
pub trait Motion: Sync {
    /// The pose at a time after the start, s.
    fn world_from_capsule(&self, t_s: f64) -> Isometry3<f64>;

    /// How long it lasts, s.
    fn duration_s(&self) -> f64;

    /// How many whole windows of this length it has.
    fn windows(&self, window_s: f64) -> usize {
        // A millionth of a window is rounding: 36 s are 720 windows of 50 ms.
        (self.duration_s() / window_s + 1e-6).floor() as usize
    }
}

/// Radius of the helix, m.
pub const HELIX_RADIUS_M: f64 = 0.057;
/// Half its length along z, m.
pub const HELIX_HALF_LENGTH_M: f64 = 0.045;
/// Its duration at the speed of table 4.2, s.
pub const HELIX_DURATION_S: f64 = 36.0;

/// The helix, at a multiple of its speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Helix {
    /// Speed over that of table 4.2 (5 mm/s around, 2.5 mm/s along).
    pub times_faster: f64,
}

impl Motion for Helix {
    fn world_from_capsule(&self, t_s: f64) -> Isometry3<f64> {
        let share = t_s / self.duration_s();
        let turned = PI * share;
        let (sin, cos) = (PI + turned).sin_cos();
        let z = HELIX_HALF_LENGTH_M * (2.0 * share - 1.0);
        let at = Vector3::new(HELIX_RADIUS_M * cos, HELIX_RADIUS_M * sin, z);
        let start = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[
            -Vector3::y(),
            Vector3::z(),
            -Vector3::x(),
        ]));
        let rotation = Rotation3::from_axis_angle(&Vector3::z_axis(), turned) * start;
        Isometry3::from_parts(Translation3::from(at), UnitQuaternion::from_rotation_matrix(&rotation))
    }

    fn duration_s(&self) -> f64 {
        HELIX_DURATION_S / self.times_faster
    }
}

/// A path that jumps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jump<M> {
    /// The path without the jump.
    pub along: M,
    /// When, s.
    pub at_s: f64,
    /// How far and where, m.
    pub by_world_m: Vector3<f64>,
}

impl<M: Motion> Motion for Jump<M> {
    fn world_from_capsule(&self, t_s: f64) -> Isometry3<f64> {
        let mut pose = self.along.world_from_capsule(t_s);
        if t_s >= self.at_s {
            pose.translation.vector += self.by_world_m;
        }
        pose
    }

    fn duration_s(&self) -> f64 {
        self.along.duration_s()
    }
}

/// Speeds of the trips along the track, m/s: chosen, see the head of this file.
pub const TRACK_SPEEDS_M_S: [f64; 5] = [0.005, 0.010, 0.020, 0.030, 0.040];
/// Duration of the experiment, s.
pub const TRACK_DURATION_S: f64 = 480.0;

/// Diameters of its half circles, m.
pub const TRACK_DIAMETERS_M: [f64; 3] = [0.116, 0.112, 0.116];
/// Points per half circle: a spline through points 3 mm apart is a circle to a micrometre.
const POINTS_PER_HALF: u32 = 60;

/// The three half circles.
fn half_circles() -> Vec<Point3<f64>> {
    let [first, second, third] = TRACK_DIAMETERS_M.map(|diameter| 0.5 * diameter);
    let (y, z) = (Vector3::y(), Vector3::z());
    let joint = [Vector3::x() * -second, Vector3::x() * second];
    // Middle, direction from the middle to the start, direction of the top, radius. Seen along z the joints lie at y = +radius of the
    // outer two, so that the whole is centred; along z it reaches from -56 to 58 mm.
    let halves = [
        (joint[0], -y, z, first),
        (y * first, -Vector3::x(), -z, second),
        (joint[1] + y * (first - third), y, z, third),
    ];
    let mut points = Vec::new();
    for (middle, to_start, to_top, radius) in halves {
        let skip = usize::from(!points.is_empty());
        points.extend((0..=POINTS_PER_HALF).skip(skip).map(|k| {
            let (sin, cos) = (PI * f64::from(k) / f64::from(POINTS_PER_HALF)).sin_cos();
            Point3::from(middle + (to_start * cos + to_top * sin) * radius)
        }));
    }
    points
}

/// Forward and back along a centre line, once at each speed, resting before, between and after.
#[derive(Clone, Debug)]
pub struct Track {
    line: CentreLine,
    speeds_m_s: Vec<f64>,
    duration_s: f64,
    pause_s: f64,
}

impl Track {
    /// The track of chapter 5.
    ///
    /// # Errors
    /// A centre line that cannot be drawn.
    pub fn than2015() -> Result<Self, ReproduceError> {
        let line = CentreLine::through(&half_circles()).map_err(ReproduceError::of_part("track"))?;
        let moving_s: f64 = TRACK_SPEEDS_M_S.iter().map(|speed| 2.0 * line.length_m() / speed).sum();
        let pause_s = (TRACK_DURATION_S - moving_s) / (TRACK_SPEEDS_M_S.len() + 1) as f64;
        Ok(Self { line, speeds_m_s: TRACK_SPEEDS_M_S.to_vec(), duration_s: TRACK_DURATION_S, pause_s })
    }

    /// Length of a pause, s.
    pub fn pause_s(&self) -> f64 {
        self.pause_s
    }

    /// Arc length at a time, m.
    pub fn arc_length_m(&self, t_s: f64) -> f64 {
        let length_m = self.line.length_m();
        let mut left_s = t_s;
        for speed in &self.speeds_m_s {
            left_s -= self.pause_s;
            let one_way_s = length_m / speed;
            if left_s < 2.0 * one_way_s {
                let way_m = speed * left_s.max(0.0);
                return if way_m <= length_m { way_m } else { 2.0 * length_m - way_m };
            }
            left_s -= 2.0 * one_way_s;
        }
        0.0
    }
}

impl Motion for Track {
    /// The capsule's camera side looks down the track on the way back, too: it is drawn back as it was pushed.
    fn world_from_capsule(&self, t_s: f64) -> Isometry3<f64> {
        along(&self.line, self.arc_length_m(t_s))
    }

    fn duration_s(&self) -> f64 {
        self.duration_s
    }
}

/// The pose of a capsule on a centre line: x along the tangent, y along the normal that turns least.
pub fn along(line: &CentreLine, arc_length_m: f64) -> Isometry3<f64> {
    let station = line.station(arc_length_m);
    let columns = Matrix3::from_columns(&[station.tangent, station.normal, station.binormal]);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(columns));
    Isometry3::from_parts(Translation3::from(station.position_m.coords), rotation)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(a: &Vector3<f64>, b: [f64; 3], tolerance: f64) {
        assert!((a - Vector3::from(b)).norm() < tolerance, "{a:?} is not {b:?}");
    }

    #[test]
    fn published_helix_starts_ends_and_runs_as_stated() {
        let helix = Helix { times_faster: 1.0 };
        let (start, end) = (helix.world_from_capsule(0.0), helix.world_from_capsule(36.0));
        near(&start.translation.vector, [-0.057, 0.0, -0.045], 1e-12);
        near(&end.translation.vector, [0.057, 0.0, 0.045], 1e-12);
        assert_eq!(helix.windows(0.05), 720);
        assert_eq!(Helix { times_faster: 8.0 }.windows(0.05), 90);
        // 5 mm/s around (4.97 exactly: half of 2 pi 57 mm in 36 s) and 2.5 mm/s along.
        let step = helix.world_from_capsule(18.001).translation.vector
            - helix.world_from_capsule(18.0).translation.vector;
        assert!((step.xy().norm() / 1e-3 - 0.004974).abs() < 1e-5 && (step.z / 1e-3 - 0.0025).abs() < 1e-9);
        // The text: apex 12 mm along +y, base along z.
        near(&(start * Point3::new(-0.012, 0.0, 0.0)).coords, [-0.057, 0.012, -0.045], 1e-12);
        near(&(start * Point3::new(0.0, 0.005, 0.0)).coords, [-0.057, 0.0, -0.040], 1e-12);
    }

    #[test]
    fn law_the_capsule_looks_where_it_goes_and_turns_properly() {
        let helix = Helix { times_faster: 1.0 };
        for k in 0..36 {
            let (a, b) =
                (helix.world_from_capsule(f64::from(k)), helix.world_from_capsule(f64::from(k) + 1e-6));
            let around = (b.translation.vector - a.translation.vector).xy().normalize();
            assert!((a.rotation * Vector3::x()).xy().dot(&around) > 1.0 - 1e-6);
            assert!((a.rotation.to_rotation_matrix().matrix().determinant() - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn published_jump_is_50_mm_between_two_runs() {
        let jump = Jump { along: Helix { times_faster: 1.0 }, at_s: 15.0, by_world_m: Vector3::y() * 0.05 };
        let at = |t: f64| jump.world_from_capsule(t).translation.vector;
        assert!(((at(15.0) - at(15.0 - 1e-9)).norm() - 0.05).abs() < 1e-8);
        assert!((at(14.9) - at(14.8)).norm() < 1e-3);
    }

    #[test]
    fn published_track_is_540_mm_long_and_takes_480_s() {
        let track = Track::than2015().unwrap();
        assert!((track.line.length_m() - 0.5404).abs() < 1e-4, "{}", track.line.length_m());
        assert_eq!((track.windows(0.05), track.windows(0.1)), (9600, 4800));
        assert!(track.pause_s() > 1.0);
        // At rest in all six pauses, at the far end five times, never faster than the fastest trip.
        let steps: Vec<f64> = (0..480_000).map(|k| track.arc_length_m(f64::from(k) * 1e-3)).collect();
        let fastest = steps.windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f64::max);
        assert!((fastest / 1e-3 - 0.040).abs() < 1e-6);
        let resting = steps.windows(2).filter(|w| w[0] == w[1]).count() as f64 * 1e-3;
        assert!((resting - 6.0 * track.pause_s()).abs() < 0.1, "{resting}");
        let far = steps.windows(3).filter(|w| w[1] > w[0] && w[1] >= w[2] && w[1] > 0.5403).count();
        assert_eq!(far, 5);
        // Inside a cylinder of 216 x 186 mm with its markers.
        for s in steps.iter().step_by(1000) {
            let pose = along(&track.line, *s);
            for marker in [[-0.012, 0.0, 0.0], [0.0, 0.005, 0.0], [0.0, -0.005, 0.0]] {
                let at = (pose * Point3::from(marker)).coords;
                assert!(at.xy().norm() < 0.108 && at.z.abs() < 0.093, "{at:?}");
            }
        }
    }
}
