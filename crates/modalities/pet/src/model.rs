//! The raw model: a window of unlabelled lines explained by a capsule's pose.
//!
//! Log-likelihood, gradient and observed information (Louis 1982) are those of [`crate::tracking::likelihood`], by
//! `[δp_world, δθ_capsule]` at the capsule's origin. Where labels are uncertain the observed information need not be positive
//! definite; a filter cannot take a negative one, so directions in which the likelihood curves upwards count as unknown: with
//! translations measured in the markers' own size, negative eigenvalues are set to zero. The step that follows is shorter than
//! Newton's and still leads uphill, for the gradient is exact.
//!
//! Of both, and of the log-likelihood, the share that counts is handed over ([`LineNoise::information_share`]); the expected information
//! of it is what a filter's covariance will be, and a bound (Cramér-Rao) only as far as the law of a line is exact.

use crate::tracking::likelihood::{Evaluation, Likelihood, Weights};
use crate::tracking::noise::LineNoise;
use crate::tracking::window::Window;
use lumenav_core::fix::FixModel;
use lumenav_core::{Instant, Linearization, Measurement, MeasurementModel, ModalityError, Part, StateView};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix6, Vector6};
use std::sync::Arc;

/// One window of lines, prepared about a point near the capsule.
#[derive(Clone)]
pub struct LinesModel {
    /// Where the markers are in the capsule.
    pub likelihood: Arc<Likelihood>,
    /// The scanner's noise.
    pub noise: Arc<LineNoise>,
    /// The window's lines.
    pub window: Arc<Window>,
    /// Shares of markers and background.
    pub weights: Weights,
}

impl LinesModel {
    /// The likelihood at a pose.
    pub fn evaluate(&self, pose: &Isometry3<f64>) -> Evaluation {
        let mut out = Evaluation::default();
        self.likelihood.evaluate(&self.window, pose, &self.weights, &mut out);
        out
    }

    fn pose(at: &dyn StateView) -> Result<Isometry3<f64>, ModalityError> {
        at.world_from_capsule(Instant::Now).ok_or(ModalityError::MissingState("the pose now"))
    }

    /// Root mean square distance of the markers from the capsule's origin, m: the unit of length in which a turn of one radian and a
    /// shift are alike.
    fn size_m(&self) -> f64 {
        let markers = &self.likelihood.markers_capsule_m;
        let square =
            markers.iter().map(nalgebra::Vector3::norm_squared).sum::<f64>() / markers.len().max(1) as f64;
        square.sqrt().max(1e-3)
    }
}

/// The nearest positive semidefinite matrix, with the first three rows and columns measured in `size_m`.
pub(crate) fn without_negative_curvature(information: &Matrix6<f64>, size_m: f64) -> Matrix6<f64> {
    let scale = Vector6::from_fn(|i, _| if i < 3 { size_m } else { 1.0 });
    let scaled = Matrix6::from_fn(|i, j| information[(i, j)] * scale[i] * scale[j]);
    let mut eigen = scaled.symmetric_eigen();
    if eigen.eigenvalues.min() >= 0.0 {
        return *information;
    }
    eigen.eigenvalues.iter_mut().for_each(|v| *v = v.max(0.0));
    let mended = eigen.recompose();
    Matrix6::from_fn(|i, j| 0.5 * (mended[(i, j)] + mended[(j, i)]) / (scale[i] * scale[j]))
}

impl MeasurementModel for LinesModel {
    fn linearize(&self, _m: &Measurement, at: &dyn StateView) -> Result<Linearization, ModalityError> {
        let found = self.evaluate(&Self::pose(at)?);
        if !found.log_likelihood.is_finite() {
            return Err(ModalityError::Undefined("the lines have no likelihood at this pose".into()));
        }
        let share = self.noise.information_share;
        let information = without_negative_curvature(&found.information, self.size_m()) * share;
        Ok(Linearization::Information {
            parts: vec![Part::Pose(Instant::Now)],
            gradient: DVector::from_column_slice((found.gradient * share).as_slice()),
            information: DMatrix::from_column_slice(6, 6, information.as_slice()),
            log_likelihood: found.log_likelihood * share,
            effective_count: found.effective_lines(),
        })
    }

    fn expected_information(
        &self,
        _m: &Measurement,
        at: &dyn StateView,
    ) -> Result<Option<DMatrix<f64>>, ModalityError> {
        let of_lines = self.likelihood.expected_information(&self.window, &Self::pose(at)?, &self.weights);
        let information = of_lines * self.noise.information_share;
        Ok(Some(DMatrix::from_column_slice(6, 6, information.as_slice())))
    }

    fn strongly_nonlinear(&self) -> bool {
        true
    }
}

/// A pose that remembers the lines it came from: to a filter a pose with a covariance, to whoever asks for the bound the lines.
#[derive(Clone)]
pub struct FixOfLines(pub LinesModel);

impl MeasurementModel for FixOfLines {
    fn linearize(&self, m: &Measurement, at: &dyn StateView) -> Result<Linearization, ModalityError> {
        FixModel.linearize(m, at)
    }

    fn expected_information(
        &self,
        m: &Measurement,
        at: &dyn StateView,
    ) -> Result<Option<DMatrix<f64>>, ModalityError> {
        self.0.expected_information(m, at)
    }

    fn strongly_nonlinear(&self) -> bool {
        FixModel.strongly_nonlinear()
    }
}
