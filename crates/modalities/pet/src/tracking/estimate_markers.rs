//! Where the markers are in the capsule, learnt from the windows themselves.
//!
//! A marker that sits 0.5 mm beside its drawing bends every pose. Each window adds what its lines say about the markers' places:
//! with K_j = [J_j | R e_j] the derivative of marker j's place by pose and by its own position in the capsule, the normal equations
//! `Σ K_jᵀ C_j K_j`, `Σ K_jᵀ f_j` (C, f: complete-data information and force of a pass over the window at its pose), the pose taken out
//! by its Schur complement. That information has no say on how the set as a whole is shifted or turned: a prior at the drawn places
//! (standard deviation [`DRAWN_SD_M`] per coordinate) does, so the estimate keeps the drawing's frame.

use super::likelihood::{Likelihood, MAX_MARKERS, OfPoints, Placed, Weights, pass, symmetric};
use super::window::Window;
use lumenav_core::pose::skew;
use nalgebra::{DMatrix, DVector, Isometry3, Matrix6, Matrix6x3, Vector3};
use serde::{Deserialize, Serialize};

/// How far a marker is expected from its drawn place, per coordinate, m: the thesis' own capsules were 0.5 to 0.9 mm off per side.
pub const DRAWN_SD_M: f64 = 0.7e-3;

/// The estimate and what it rests on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MarkerEstimate {
    markers_m: Vec<Vector3<f64>>,
    information: DMatrix<f64>,
    side: DVector<f64>,
}

impl MarkerEstimate {
    /// Starts at the drawn places.
    pub fn new(drawn_m: &[Vector3<f64>]) -> Self {
        let n = 3 * drawn_m.len();
        let weight = 1.0 / (DRAWN_SD_M * DRAWN_SD_M);
        let places = DVector::from_iterator(n, drawn_m.iter().flat_map(|m| m.iter().copied()));
        Self {
            markers_m: drawn_m.to_vec(),
            information: DMatrix::identity(n, n) * weight,
            side: places * weight,
        }
    }

    /// The places, capsule frame, m.
    pub fn markers_m(&self) -> &[Vector3<f64>] {
        &self.markers_m
    }

    /// Adds a window at its pose, with the share of its lines' information that counts.
    pub(crate) fn add(
        &mut self,
        window: &Window,
        likelihood: &Likelihood,
        pose: &Isometry3<f64>,
        weights: &Weights,
        share: f64,
    ) {
        let mut placed = [Placed::default(); MAX_MARKERS];
        let used = likelihood.place(pose, &window.origin_world_m, weights, &mut placed);
        let r = pose.rotation.to_rotation_matrix().into_inner();
        let n = 3 * used;
        let (mut own, mut mixed) = (DMatrix::zeros(n, n), DMatrix::zeros(n, 6));
        let mut of_pose = Matrix6::zeros();
        let mut pull = DVector::zeros(n);
        let mut pose_pull = nalgebra::Vector6::zeros();
        let mut j = 0;
        pass::<OfPoints, _>(&window.shapes, &placed[..used], weights.background, |p, s| {
            let (c, f) = (symmetric(&s.curvature), Vector3::from(s.force));
            let turn = -(skew(&p.arm_m) * r);
            let mut jacobian = Matrix6x3::zeros();
            jacobian.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
            jacobian.fixed_view_mut::<3, 3>(3, 0).copy_from(&turn.transpose());
            of_pose += jacobian * c * jacobian.transpose();
            pose_pull += jacobian * f;
            own.view_mut((3 * j, 3 * j), (3, 3)).copy_from(&(r.transpose() * c * r));
            mixed.view_mut((3 * j, 0), (3, 6)).copy_from(&(r.transpose() * c * jacobian.transpose()));
            pull.rows_mut(3 * j, 3).copy_from(&(r.transpose() * f));
            j += 1;
        });
        let Some(root) = of_pose.cholesky() else { return };
        let inverse = root.inverse();
        let taken = &mixed * inverse;
        let information = own - &taken * mixed.transpose();
        let pull = pull - taken * pose_pull;
        let now =
            DVector::from_iterator(n, likelihood.markers_capsule_m.iter().flat_map(|m| m.iter().copied()));
        self.side += (&information * now + pull) * share;
        self.information += information * share;
        if let Some(root) = self.information.clone().cholesky() {
            let places = root.solve(&self.side);
            for (j, m) in self.markers_m.iter_mut().enumerate() {
                *m = places.fixed_rows::<3>(3 * j).into_owned();
            }
        }
    }
}
