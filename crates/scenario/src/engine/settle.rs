//! Before t = 0 the capsule comes to rest.
//!
//! An engine is built with the capsule on the centre line, where in a wide lumen nothing holds it. [`Engine::settle`] steps it with
//! the clock and the wall standing still as they are at t = 0: first held in the plane across the tract in which it was put, until it
//! rests on the wall there; then let go, which shows whether the wall holds it. What this leaves is an engine at t = 0 with an ordinary
//! state: snapshots hold it, and it takes no random numbers.
//!
//! At rest: the faster end of the capsule, `|v| + |ω x axis| L/2`, stays below [`RESTING_M_S`] for [`RESTING_FOR_S`]. A capsule that only
//! trembles when its time is over, below [`TREMBLING_M_S`], is taken as it is.
//!
//! Measured over 400 starts along each tract: 95 % rest, within 0.03 mm (median) of where they were put, in the shipped colon, another
//! generated one and a whole measured tract. The others lie on the crest of a fold or in a steep stretch, and fall.

use super::events::Watch;
use super::system::Twist;
use super::{CAPSULE, Engine, EngineError};
use nalgebra::{Point3, Vector3};

/// Speed of the capsule's faster end below which it rests, m/s: a fiftieth of what it has when it falls.
const RESTING_M_S: f64 = 2e-3;
/// And what is taken for rest when time is over, m/s: in a tight bend of the small bowel, where the wall presses from all sides, and
/// between two folds a capsule trembles and never stands still.
const TREMBLING_M_S: f64 = 5e-3;
/// For so long, s: longer than a bounce (3.3 g on a wall of 100 N/m swing within 36 ms).
const RESTING_FOR_S: f64 = 0.25;
/// Part of its velocities that a held capsule keeps at each step: it sinks at about 15 mm/s, and neither bounces nor trembles against
/// what holds it.
const HELD_KEEPS: f64 = 0.5;
/// How long it is held at most, s: it sinks through the widest lumen within this. Against a fold a held capsule may never rest.
const HELD_AT_MOST_S: f64 = 3.0;
/// How far along the tract the capsule may be from where it was put when it rests, in lengths of the capsule: it still covers the
/// place. What was put on the crest of a fold slides into the haustrum beside it.
pub(super) const SETTLED_WITHIN_LENGTHS: f64 = 0.5;

/// How a capsule came to rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settled {
    /// Time that it took, s; it is no part of the run.
    pub took_s: f64,
    /// How far along the tract it rests from where it was put, m, aboral positive; at most half of the capsule's length.
    pub moved_m: f64,
}

/// The plane across the tract in which the capsule is held.
struct Plane {
    point_m: Point3<f64>,
    normal: Vector3<f64>,
}

impl Engine {
    /// Lets the capsule of an engine at t = 0 come to rest, for at most `settle_s` of the configuration
    /// (and three more seconds in which it is held); 0 leaves it where it is.
    ///
    /// # Errors
    /// [`EngineError::Unsettled`]: it does not rest within that time, or not within half of its length from where it was put.
    pub fn settle(&mut self) -> Result<Settled, EngineError> {
        let most_s = self.config.settle_s.0;
        let mut settled = Settled { took_s: 0.0, moved_m: 0.0 };
        if most_s == 0.0 {
            return Ok(settled);
        }
        let put = self.capsule().station;
        let put_m = put.arc_length_m;
        let plane = Plane { point_m: put.position_m, normal: put.tangent };
        let held_s = HELD_AT_MOST_S.min(most_s);
        settled.took_s = self.await_rest(put_m, held_s, Some(&plane)).unwrap_or(held_s);
        let free_s = self.await_rest(put_m, most_s, None);
        settled.moved_m = self.capsule().station.arc_length_m - put_m;
        settled.took_s += free_s.ok_or_else(|| EngineError::Unsettled {
            put_m,
            reached_m: self.capsule().station.arc_length_m,
            within_m: self.settled_within_m(),
            speed_m_s: self.fastest_end_m_s(),
        })?;
        self.watch = Watch::new(self.capsule().station.arc_length_m, self.capsule().segment_index);
        self.watch.lost = self.touching == 0;
        self.events.clear();
        Ok(settled)
    }

    /// Steps with the clock at t = 0 until the capsule rests and returns the time that it took, s; `None` where it does not, or gets
    /// too far from where it was put.
    fn await_rest(&mut self, put_m: f64, within_s: f64, held: Option<&Plane>) -> Option<f64> {
        let steps_of = |seconds: f64| (seconds / self.step_s).ceil() as u64;
        let (most, wanted) = (steps_of(within_s), steps_of(RESTING_FOR_S));
        let (mut resting, mut trembling) = (0, 0);
        for step in 1..=most {
            self.step_at(0.0, 0.0);
            if let Some(plane) = held {
                self.hold_in(plane);
            }
            if self.capsule().left
                || (self.capsule().station.arc_length_m - put_m).abs() > self.settled_within_m()
            {
                return None;
            }
            let fastest_m_s = self.fastest_end_m_s();
            resting = if fastest_m_s < RESTING_M_S { resting + 1 } else { 0 };
            trembling = if fastest_m_s < TREMBLING_M_S { trembling + 1 } else { 0 };
            if resting >= wanted {
                return Some(step as f64 * self.step_s);
            }
        }
        (trembling >= wanted).then_some(within_s)
    }

    /// Takes back what the last step did along the plane's normal.
    fn hold_in(&mut self, plane: &Plane) {
        let mut pose = self.bodies.pose(CAPSULE);
        let mut twist: Twist = self.bodies.twist(CAPSULE);
        let along_m = plane.normal.dot(&(Point3::from(pose.translation.vector) - plane.point_m));
        pose.translation.vector -= plane.normal * along_m;
        twist.linear = (twist.linear - plane.normal * plane.normal.dot(&twist.linear)) * HELD_KEEPS;
        twist.angular *= HELD_KEEPS;
        self.bodies.set_pose(CAPSULE, &pose);
        self.bodies.set_twist(CAPSULE, &twist);
        let centre = Point3::from(pose.translation.vector);
        self.movers[CAPSULE].follow(&centre, &twist, &self.tract, self.step_s);
    }

    fn settled_within_m(&self) -> f64 {
        SETTLED_WITHIN_LENGTHS * self.capsule().shape.length_m
    }

    /// Speed of the faster end of the capsule, at most, m/s. Turning about the own axis does not count: rolling to and fro at the bottom
    /// of a wide lumen is hardly damped, and by itself moves nothing.
    pub(super) fn fastest_end_m_s(&self) -> f64 {
        let twist = self.bodies.twist(CAPSULE);
        let axis = self.bodies.pose(CAPSULE).rotation * Vector3::x();
        twist.linear.norm() + 0.5 * self.capsule().shape.length_m * axis.cross(&twist.angular).norm()
    }
}
