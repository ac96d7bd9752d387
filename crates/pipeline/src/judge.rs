//! Compares an estimate with the truth at its own time stamp, and with the bound of the reading it came from.

#![expect(clippy::disallowed_types, reason = "world side: evaluation compares with the truth")]

use crate::events::UpdateError;
use lumenav_core::{CapsuleTruth, FixKind, Measurement, NominalState, PathMap, PublishedEstimate, SimTime};
use lumenav_evaluation::consistency::{ErrorBlock, nees};
use lumenav_evaluation::pose_error::PoseError;
use nalgebra::{DMatrix, Isometry3, Point3};

/// The part of the pose error that an estimate of this kind answers for.
fn block(kind: FixKind) -> ErrorBlock {
    match kind {
        FixKind::Position => ErrorBlock::Position,
        FixKind::Pointing => ErrorBlock::PositionAndPointing,
        FixKind::Full => ErrorBlock::FullPose,
    }
}

/// The tract as a map, and where it is: the patient carries it.
#[derive(Clone, Copy)]
pub struct PlacedMap<'m> {
    /// The map, in the tract's own frame.
    pub map: &'m dyn PathMap,
    /// `world_from_map` at an instant.
    pub world_from_map: &'m dyn Fn(SimTime) -> Isometry3<f64>,
}

/// Errors, NEES, along-tract error and bound of one update.
pub fn judge(
    estimate: &PublishedEstimate,
    truth: &CapsuleTruth,
    measurement: Option<&Measurement>,
    map: Option<PlacedMap<'_>>,
) -> UpdateError {
    let pose = &estimate.pose;
    let error = PoseError::between(&pose.world_from_capsule, &truth.world_from_capsule);
    let along_tract_m = map.zip(truth.arc_length_m).and_then(|(map, true_m)| {
        let p = Point3::from(pose.world_from_capsule.translation.vector);
        let p = (map.world_from_map)(estimate.at).inverse_transform_point(&p);
        map.map.nearest(&p, 1).first().map(|found| found.arc_length_m - true_m)
    });
    UpdateError {
        position_world_m: -error.position_world_m,
        heading_rad: (pose.kind != FixKind::Position).then(|| error.heading_rad()),
        attitude_rad: (pose.kind == FixKind::Full).then(|| error.attitude_rad()),
        nees: nees(&error, &pose.covariance, block(pose.kind)).ok(),
        nees_degrees_of_freedom: pose.kind.degrees_of_freedom(),
        along_tract_m,
        bound_position_m2: measurement.and_then(|m| position_bound(m, truth)),
    }
}

/// Trace of the position block of the Cramér-Rao bound of one measurement at the true pose, m²; `None` where the model has no
/// expected information or the position is not observable from it alone.
fn position_bound(measurement: &Measurement, truth: &CapsuleTruth) -> Option<f64> {
    let mut state = NominalState::at_rest(truth.world_from_capsule);
    state.velocity_world_m_s = truth.velocity_world_m_s;
    state.angular_rate_capsule_rad_s = truth.angular_rate_capsule_rad_s;
    // What else the sensor's model asks for, at its expected value; an earlier pose is not known here.
    state.blocks = measurement.model.blocks().iter().map(|b| (b.name.clone(), b.initial.clone())).collect();
    let information = measurement.model.expected_information(measurement, &state).ok()??;
    position_trace(&information)
}

/// Trace of the position block of the inverse, over the directions that the information speaks about: attitude directions
/// without information (the roll about a magnet) are left out, position directions without it make the bound infinite.
fn position_trace(information: &DMatrix<f64>) -> Option<f64> {
    if information.nrows() < 6 || information.nrows() != information.ncols() {
        return None;
    }
    let scale = information.diagonal().map(|v| if v > 0.0 { 1.0 / v.sqrt() } else { 0.0 });
    let kept: Vec<usize> = (0..information.nrows())
        .filter(|i| *i < 3 || information[(*i, *i)] > 1e-9 * information.diagonal().rows(3, 3).max())
        .collect();
    let n = kept.len();
    let scaled =
        DMatrix::from_fn(n, n, |i, j| information[(kept[i], kept[j])] * scale[kept[i]] * scale[kept[j]]);
    let inverse = scaled.cholesky()?.inverse();
    let trace: f64 = (0..3).map(|i| inverse[(i, i)] * scale[i] * scale[i]).sum();
    trace.is_finite().then_some(trace)
}

#[cfg(test)]
mod tests {
    use super::*;
    use lumenav_core::{PathProjection, PoseEstimate};
    use nalgebra::{Matrix6, Vector3};

    /// A straight tract along z.
    struct Straight;

    impl PathMap for Straight {
        fn nearest(&self, point: &Point3<f64>, _count: usize) -> Vec<PathProjection> {
            let distance_m = point.coords.xy().norm();
            let point_world_m = Point3::new(0.0, 0.0, point.z);
            vec![PathProjection {
                arc_length_m: point.z,
                point_world_m,
                radius_m: 0.02,
                distance_m,
                segment: None,
            }]
        }

        fn length_m(&self) -> f64 {
            1.0
        }
    }

    #[test]
    fn closed_form_the_tract_is_where_the_patient_has_carried_it() {
        // The patient has turned to the left, and the table has moved by 0.5 m along z: an estimate 3 mm too far along the tract.
        let at = SimTime::from_seconds(2.0);
        let turn = Vector3::z() * std::f64::consts::FRAC_PI_2;
        let world_from_map = move |asked: SimTime| {
            assert_eq!(asked, at);
            Isometry3::new(Vector3::new(0.0, 0.0, 0.5), turn)
        };
        let world_from_capsule = world_from_map(at) * Isometry3::translation(0.01, 0.0, 0.303);
        let pose = PoseEstimate { world_from_capsule, covariance: Matrix6::identity(), kind: FixKind::Full };
        let estimate = PublishedEstimate { at, available: at, pose, velocity_world_m_s: None };
        let truth = CapsuleTruth {
            at,
            world_from_capsule,
            velocity_world_m_s: Vector3::zeros(),
            angular_rate_capsule_rad_s: Vector3::zeros(),
            specific_force_capsule_m_s2: Vector3::zeros(),
            arc_length_m: Some(0.3),
            segment: None,
            wall_force_n: None,
        };
        let placed = PlacedMap { map: &Straight, world_from_map: &world_from_map };
        let along_m = judge(&estimate, &truth, None, Some(placed)).along_tract_m.unwrap();
        assert!((along_m - 3e-3).abs() < 1e-12, "{along_m}");
    }
}
