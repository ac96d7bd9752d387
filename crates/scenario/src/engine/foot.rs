//! Where a ring of the capsule is in the lumen: arc length, directions and offset.
//!
//! Either in the tube around the centre line, or in the one around the chord of a bend that gives way ([`super::bends`]), or
//! blended between the two.

use super::bends::Chord;
use lumenav_anatomy::centre_line::{QuickFoot, Station};
use nalgebra::{Point3, Vector3};

/// The place of a ring in the lumen.
#[derive(Debug, Clone, Copy)]
pub(super) struct Foot {
    pub(super) arc_length_m: f64,
    pub(super) tangent: Vector3<f64>,
    /// From where angles are counted; where the lumen is round, some direction.
    pub(super) normal: Vector3<f64>,
    /// From the lumen's centre to the ring's, across the tangent, m.
    pub(super) across: Vector3<f64>,
    /// From the capsule's centre to the ring's, m.
    pub(super) lever: Vector3<f64>,
}

impl Foot {
    pub(super) fn at(station: &Station, point: &Point3<f64>, lever: Vector3<f64>) -> Self {
        let Station { arc_length_m, position_m, tangent, normal, .. } = *station;
        Self::of(&QuickFoot { arc_length_m, position_m, tangent }, normal, point, lever)
    }

    pub(super) fn of(
        foot: &QuickFoot,
        normal: Vector3<f64>,
        point: &Point3<f64>,
        lever: Vector3<f64>,
    ) -> Self {
        let QuickFoot { arc_length_m, position_m, tangent } = *foot;
        let away = point - position_m;
        // Beyond the ends the tube goes on straight: what lies along the tangent is not an offset.
        let across = away - tangent * tangent.dot(&away);
        Self { arc_length_m, tangent, normal, across, lever }
    }

    /// The normal across the tangent, for a ring whose offset has no direction.
    pub(super) fn sideways(&self) -> Vector3<f64> {
        across_from(&self.normal, &self.tangent)
    }

    /// In the tube around the chord through the middle's station.
    pub(super) fn on(chord: &Chord, middle: &Station, point: &Point3<f64>, lever: Vector3<f64>) -> Self {
        let away = point - middle.position_m;
        let tangent = chord.direction;
        let along_m = tangent.dot(&away);
        Self {
            arc_length_m: middle.arc_length_m + along_m,
            tangent,
            normal: middle.normal,
            across: away - tangent * along_m,
            lever,
        }
    }

    pub(super) fn blend(&self, other: &Self, part: f64) -> Self {
        let rest = 1.0 - part;
        let mixed = self.tangent * rest + other.tangent * part;
        // In a hairpin the two may be opposite: then the chord's holds.
        let tangent = if mixed.norm() > 0.1 { mixed.normalize() } else { other.tangent };
        let across = self.across * rest + other.across * part;
        Self {
            arc_length_m: self.arc_length_m * rest + other.arc_length_m * part,
            tangent,
            normal: across_from(&other.normal, &tangent),
            across: across - tangent * tangent.dot(&across),
            lever: self.lever,
        }
    }
}

/// What of a direction lies across the tangent, normalised; some direction where that is nothing.
fn across_from(direction: &Vector3<f64>, tangent: &Vector3<f64>) -> Vector3<f64> {
    let across = direction - tangent * tangent.dot(direction);
    across.try_normalize(1e-6).unwrap_or_else(|| perpendicular(tangent))
}

fn perpendicular(direction: &Vector3<f64>) -> Vector3<f64> {
    let axis = if direction.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
    direction.cross(&axis).normalize()
}
