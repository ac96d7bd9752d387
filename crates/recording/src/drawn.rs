//! A capsule in the scene, true or estimated: its solid, its pose and its path.

use crate::error::RecordingError;
use crate::geometry::{point_m, solid, transform};
use crate::output::Output;
use crate::pacing::Gate;
use crate::palette;
use crate::store::{Store, entity, row_bytes, time_point};
use crate::trail::{Piece, Trail};
use lumenav_core::{FixKind, SimTime};
use lumenav_pipeline::RunHeader;
use rerun::external::re_log_types::TimePoint;
use rerun::{AsComponents, Color, SerializedComponentBatch};

/// A capsule that is drawn: the truth or a track's estimate.
pub(crate) struct Drawn {
    /// Path of its entities below `/world`.
    pub(crate) root: String,
    /// Path of the pose below it.
    pub(crate) pose: &'static str,
    pub(crate) colour: u32,
    /// Whether its path shows how fast it was, in place of its colour.
    pub(crate) shows_speed: bool,
    pub(crate) gate: Gate,
    pub(crate) trail: Trail,
    /// What its solid shows, once it is drawn.
    pub(crate) solid: Option<FixKind>,
    /// Whether the style of its covariance is written.
    pub(crate) region: bool,
    /// Time of its last update, kept or not.
    pub(crate) last: Option<SimTime>,
    /// Whether a gap in its updates came before its next row.
    pub(crate) gap: bool,
}

impl Drawn {
    pub(crate) fn new(root: String, pose: &'static str, colour: u32) -> Self {
        Self {
            root,
            pose,
            colour,
            shows_speed: false,
            gate: Gate::new(),
            trail: Trail::default(),
            solid: None,
            region: false,
            last: None,
            gap: false,
        }
    }

    /// Puts the solid at a pose; draws it first where that has not happened, or where more is known than before.
    pub(crate) fn move_to(
        &mut self,
        store: &mut Store,
        output: &mut Output,
        header: &RunHeader,
        time: &TimePoint,
        world_from_capsule: &nalgebra::Isometry3<f64>,
        kind: FixKind,
    ) -> Result<usize, RecordingError> {
        let path = entity(&format!("{}/{}", self.root, self.pose));
        if self.solid.is_none_or(|drawn| drawn < kind) {
            self.solid = Some(kind);
            let (rgba, mode) = if self.pose == "truth" {
                (self.colour, rerun::FillMode::Solid)
            } else {
                (palette::with_alpha(self.colour, 0x90), rerun::FillMode::TransparentFillMajorWireframe)
            };
            let mut batches: Vec<SerializedComponentBatch> = solid(&header.capsule, kind, rgba, mode);
            if self.pose == "truth" {
                // The axes of the estimates would only hide it.
                let length_m = 0.75 * header.capsule.length_m as f32;
                batches.extend(rerun::TransformAxes3D::new(length_m).as_serialized_batches());
            }
            store.log_batches(output, &path, TimePoint::default(), batches)?;
        }
        let batches = transform(world_from_capsule, kind).as_serialized_batches();
        let bytes = row_bytes(&batches);
        store.log_batches(output, &path, time.clone(), batches)?;
        Ok(bytes)
    }

    /// Adds a point to the path.
    pub(crate) fn walk(
        &mut self,
        store: &mut Store,
        output: &mut Output,
        at: SimTime,
        world_from_capsule: &nalgebra::Isometry3<f64>,
        full: bool,
    ) -> Result<usize, RecordingError> {
        let piece = self.trail.push(at, point_m(&world_from_capsule.translation.vector), full);
        self.draw_piece(store, output, at, piece)
    }

    /// Ends the path.
    pub(crate) fn lift(
        &mut self,
        store: &mut Store,
        output: &mut Output,
        at: SimTime,
    ) -> Result<(), RecordingError> {
        let piece = self.trail.lift();
        self.draw_piece(store, output, at, piece).map(|_| ())
    }

    fn draw_piece(
        &self,
        store: &mut Store,
        output: &mut Output,
        at: SimTime,
        piece: Option<Piece>,
    ) -> Result<usize, RecordingError> {
        let Some(piece) = piece else { return Ok(0) };
        let rgba = if self.shows_speed { palette::speed(piece.speed_m_s()) } else { self.colour };
        let strip = rerun::LineStrips3D::new([piece.points_m])
            .with_colors([Color::from_u32(rgba)])
            .with_radii([rerun::Radius::new_ui_points(if self.pose == "truth" { 2.2 } else { 1.4 })]);
        let batches = strip.as_serialized_batches();
        let bytes = row_bytes(&batches);
        store.log_batches(output, &entity(&format!("{}/path", self.root)), time_point(at, None), batches)?;
        Ok(bytes)
    }
}
