//! What is moved: the capsule, and what is loose in the tract beside it. Each meets the wall ([`super::wall`]) and the others
//! ([`super::together`]).

use super::body::Inertia;
use super::system::{System, Twist};
use super::valve::Valve;
use super::wall::{Rings, WallContacts};
use lumenav_anatomy::centre_line::Station;
use lumenav_anatomy::tract::Tract;
use lumenav_core::CapsuleBody;
use nalgebra::{Isometry3, Point3};

/// How fast the centre's projection may move: this factor of its speed (on the inner side of a bend the projection is faster), and
/// this much more, m/s, to catch up.
const STATION_FACTOR: f64 = 3.0;
const STATION_SPEED_M_S: f64 = 0.1;

/// A body in the tract; its pose and velocities are rapier's.
#[derive(Clone)]
pub(super) struct Mover {
    pub(super) shape: CapsuleBody,
    pub(super) inertia: Inertia,
    pub(super) contacts: WallContacts,
    /// Where its centre is along the tract, and how far from the centre line, m.
    pub(super) station: Station,
    pub(super) offset_m: f64,
    pub(super) segment_index: usize,
    pub(super) valve: Option<Valve>,
    /// It has left the tract, and rests where it left.
    pub(super) left: bool,
    /// Of the present step: where it begins, and all that it feels but wall and others.
    pub(super) pose: Isometry3<f64>,
    pub(super) twist: Twist,
    pub(super) system: System,
    /// Friction of the wall where it is.
    pub(super) friction: f64,
}

impl Mover {
    /// At a station, on the centre line. `surface`: its surface over that of the capsule.
    pub(super) fn new(shape: &CapsuleBody, station: Station, tract: &Tract, surface: f64) -> Self {
        Self {
            shape: *shape,
            inertia: Inertia::of(shape),
            contacts: WallContacts::new(Rings::of(shape), tract, surface),
            segment_index: tract.segment_index_at(station.arc_length_m),
            valve: Valve::of(tract),
            station,
            offset_m: 0.0,
            left: false,
            pose: Isometry3::identity(),
            twist: Twist::REST,
            system: System::default(),
            friction: 0.0,
        }
    }

    /// The same body elsewhere.
    pub(super) fn at(&self, station: Station, tract: &Tract) -> Self {
        let segment_index = tract.segment_index_at(station.arc_length_m);
        Self { station, segment_index, offset_m: 0.0, ..self.clone() }
    }

    /// The ends of its cylinder's axis in the present step, gut frame, m.
    pub(super) fn axis_m(&self) -> [Point3<f64>; 2] {
        let half_m = 0.5 * self.shape.length_m - self.shape.radius_m;
        [-half_m, half_m].map(|x| self.pose * Point3::new(x, 0.0, 0.0))
    }

    /// Speed that no point of its axis exceeds, m/s.
    pub(super) fn fastest_m_s(&self) -> f64 {
        self.twist.linear.norm() + 0.5 * self.shape.length_m * self.twist.angular.norm()
    }

    /// Takes on where the centre is, as far as its projection can have moved in a step, and in which segment.
    pub(super) fn move_on(&mut self, centre: &Point3<f64>, twist: &Twist, tract: &Tract, step_s: f64) {
        self.follow(centre, twist, tract, step_s);
        let arc_length_m = self.station.arc_length_m;
        if let Some(valve) = &mut self.valve {
            valve.look(arc_length_m, 0.5 * self.shape.length_m);
        }
        let segments = &tract.segments;
        while self.segment_index + 1 < segments.len() && arc_length_m >= segments[self.segment_index].end_m {
            self.segment_index += 1;
        }
        while self.segment_index > 0 && arc_length_m < segments[self.segment_index].start_m {
            self.segment_index -= 1;
        }
    }

    /// Takes on the centre's projection, as far as it can have moved in a step: where the centre crosses the evolute of a tight bend
    /// the projection jumps, the body does not.
    pub(super) fn follow(&mut self, centre: &Point3<f64>, twist: &Twist, tract: &Tract, step_s: f64) {
        let line = &tract.centre_line;
        let before_m = self.station.arc_length_m;
        let foot = line.project_near(centre, before_m);
        let most_m = step_s * (STATION_FACTOR * twist.linear.norm_squared().sqrt() + STATION_SPEED_M_S);
        let arc_length_m = foot.arc_length_m.clamp(before_m - most_m, before_m + most_m);
        if arc_length_m == foot.arc_length_m {
            (self.station, self.offset_m) = (foot.station, foot.distance_m);
        } else {
            self.station = line.station(arc_length_m);
            self.offset_m = (centre - self.station.position_m).norm();
        }
    }
}
