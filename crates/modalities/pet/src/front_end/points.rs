//! The front end of one of several independent points: a position, no attitude.
//!
//! Every track of a recording with several points has a front end of its own, which follows all of them and answers with the one that
//! its table names; they see the same lines, so they number the points alike.

use super::{UNKNOWN_ANGLE_RAD2, refused, scene};
use crate::line::Line;
use crate::payload;
use crate::tracking::Role;
use crate::tracking::points::{PointMemory, Points, TrackedPoint};
use lumenav_core::fix::FixModel;
use lumenav_core::{
    FixKind, FrontEnd, Measurement, ModalityError, Name, Outcome, PoseEstimate, PosePrior, Primitive,
    PriorUse, Reading,
};
use nalgebra::{Isometry3, Matrix6, Vector3};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// What is written to a snapshot.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
struct Kept {
    points: Vec<PointMemory>,
}

/// The estimator side of a scanner, for one of several independent points.
pub struct PointFrontEnd {
    sensor: Name,
    points: Points,
    /// Which of them, counted from 0.
    which: usize,
    lines: Vec<Line>,
    roles: Vec<Role>,
    /// The points of the last window that were found.
    found: Vec<Option<TrackedPoint>>,
}

impl PointFrontEnd {
    /// Answers with point `which`, counted from 0.
    pub fn new(sensor: Name, points: Points, which: usize) -> Self {
        Self { sensor, points, which, lines: Vec::new(), roles: Vec::new(), found: Vec::new() }
    }

    fn fix(point: &TrackedPoint) -> PoseEstimate {
        let mut covariance = Matrix6::identity() * UNKNOWN_ANGLE_RAD2;
        covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&point.covariance_m2);
        let world_from_capsule = Isometry3::translation(
            point.position_world_m.x,
            point.position_world_m.y,
            point.position_world_m.z,
        );
        PoseEstimate { world_from_capsule, covariance, kind: FixKind::Position }
    }
}

impl FrontEnd for PointFrontEnd {
    fn process(&mut self, reading: &Reading, _prior: Option<&PosePrior>) -> Result<Outcome, ModalityError> {
        payload::lines(&reading.payload, &mut self.lines)?;
        let scanner = reading.known_poses.get(payload::SCANNER);
        self.points.scanner_at(&scanner.map_or_else(Vector3::zeros, |pose| pose.translation.vector));
        let (found, roles) = self.points.track(&self.lines);
        self.roles = roles;
        self.found = found.iter().map(|point| point.as_ref().ok().copied()).collect();
        let fix = match &found[self.which] {
            Ok(point) => Self::fix(point),
            Err(why) => return Ok(refused(&why.to_string())),
        };
        Ok(Outcome::Measured(vec![Measurement {
            sensor: self.sensor.clone(),
            sequence: reading.sequence,
            at: reading.at(),
            arrival: reading.arrival,
            since: None,
            value: Arc::new(fix.to_frame()),
            model: Arc::new(FixModel),
            prior_use: PriorUse::None,
            fix: Some(fix),
            motion: None,
        }]))
    }

    fn resolves(&self) -> FixKind {
        FixKind::Position
    }

    fn snapshot(&self) -> Vec<u8> {
        let kept = Kept { points: self.points.memory().to_vec() };
        // TOML reads every number back to the same bits. A memory of numbers always has a text.
        toml::to_string(&kept).unwrap_or_default().into_bytes()
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), ModalityError> {
        let kept: Kept = toml::from_slice(bytes).map_err(|_| ModalityError::Snapshot)?;
        self.points.recall(&kept.points);
        Ok(())
    }

    fn scene(&self, out: &mut Vec<Primitive>) {
        let Some(Some(point)) = self.found.get(self.which) else { return };
        out.push(scene::lines(&self.lines, &self.roles, &point.position_world_m));
        out.push(scene::markers(&[point.position_world_m]));
    }
}
