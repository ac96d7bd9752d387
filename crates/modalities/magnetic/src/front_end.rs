//! From a flux reading to a measurement: `pose` (maximum likelihood, a fix of 5 degrees of freedom) or `flux` (the raw
//! readings for the filter; a fix rides along only where the filter has no prediction and needs a start).
//!
//! Stateless: the same reading and prior give the same measurement, so tracks do not depend on the order of arrival.

use crate::array::SensorArray;
use crate::channels::{Channels, MagnetPose};
use crate::config::{Installed, OptionsTable};
use crate::model::{FixOfFlux, FluxModel};
use crate::solver::{Readings, Solution, Workspace, solve, solve_from_all};
use lumenav_core::pose::{attitude_from_axis, tangent_basis};
use lumenav_core::{
    FixKind, FrontEnd, Measurement, MeasurementModel, ModalityError, Name, Outcome, PoseEstimate, PosePrior, PriorUse, Reading,
};
use lumenav_fields::FieldSource;
use nalgebra::{Isometry3, Matrix6, SMatrix, Translation3, Vector3};
use serde::{Deserialize, Serialize};
use statrs::distribution::{ChiSquared, ContinuousCDF as _};
use std::sync::Arc;

/// What the front end hands on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Output {
    /// A pose with its covariance.
    #[default]
    Pose,
    /// The readings themselves, with their model.
    Flux,
}

/// A warm solve whose χ² lies beyond this quantile is tried again from cold starts.
const WARM_QUANTILE: f64 = 0.999_999;
/// Default of `max_reduced_chi_square`.
const MAX_REDUCED_CHI_SQUARE: f64 = 25.0;

/// The magnetic front end.
pub struct MagneticFrontEnd {
    output: Output,
    array: SensorArray,
    fixed: Arc<Channels>,
    source: FieldSource,
    offset_capsule_m: Vector3<f64>,
    noise_tesla: f64,
    relative_error: f64,
    max_reduced_chi_square: f64,
    saturation_tesla: Option<f64>,
    workspace: Workspace,
    sensor: Name,
}

impl MagneticFrontEnd {
    /// Builds the front end from what is installed and what the track asks for.
    pub fn new(sensor: Name, installed: &Installed, options: &OptionsTable) -> Self {
        let saturation_tesla =
            installed.array.saturation_tesla.filter(|_| installed.table.saturation);
        Self {
            output: options.front_end,
            fixed: Arc::new(installed.array.channels(&Isometry3::identity())),
            source: installed.magnet.source(options.law),
            offset_capsule_m: installed.magnet.offset_capsule_m,
            noise_tesla: options.noise_tesla.map_or(installed.noise_tesla(), |v| v.0),
            relative_error: options.relative_error.0,
            max_reduced_chi_square: options.max_reduced_chi_square.map_or(MAX_REDUCED_CHI_SQUARE, |v| v.0),
            saturation_tesla,
            array: installed.array.clone(),
            workspace: Workspace::default(),
            sensor,
        }
    }

    fn model(&self, reading: &Reading) -> FluxModel {
        let channels = if reading.known_poses.is_empty() {
            self.fixed.clone()
        } else {
            Arc::new(self.array.channels_known(&reading.known_poses))
        };
        FluxModel {
            channels,
            source: self.source,
            offset_capsule_m: self.offset_capsule_m,
            noise_tesla: self.noise_tesla,
            relative_error: self.relative_error,
        }
    }

    /// Maximum likelihood from the prior where there is one, else from all cold starts.
    fn solve(&mut self, model: &FluxModel, readings: Readings<'_>, prior: Option<&PosePrior>) -> Option<Solution> {
        if let Some(prior) = prior {
            let start = MagnetPose::of_capsule(&prior.pose.world_from_capsule, &self.offset_capsule_m);
            let warm = solve(&model.channels, &self.source, readings, &start, &mut self.workspace);
            if warm.converged && warm.chi_square < chi_square_limit(warm.channels) {
                return Some(warm);
            }
        }
        let starts: Vec<MagnetPose> = self
            .array
            .start_positions_m(&model.channels)
            .into_iter()
            .flat_map(|position_world_m| {
                [Vector3::z(), -Vector3::z()].map(|axis_world| MagnetPose { position_world_m, axis_world })
            })
            .collect();
        solve_from_all(&model.channels, &self.source, readings, &starts, &mut self.workspace)
    }

    /// Why a solution cannot be trusted; `None` where it can.
    fn objection(&self, solution: &Solution, channels: &Channels) -> Option<String> {
        let freedom = solution.channels as f64 - 5.0;
        if !solution.converged {
            return Some("the maximum-likelihood search did not converge".to_owned());
        }
        let reduced = solution.chi_square / freedom;
        if reduced > self.max_reduced_chi_square {
            return Some(format!("the readings do not fit a magnet: chi-square per degree of freedom {reduced:.1}"));
        }
        let nearest = channels
            .positions_world_m
            .iter()
            .map(|s| (s - solution.magnet.position_world_m).norm())
            .fold(f64::INFINITY, f64::min);
        if nearest < 1e-3 {
            return Some("the solution lies inside a sensor".to_owned());
        }
        None
    }

    /// The capsule's pose from the magnet's, with the covariance from the Fisher information.
    fn fix(&self, solution: &Solution) -> Option<PoseEstimate> {
        let covariance = solution.information.cholesky()?.inverse();
        let axis = solution.magnet.axis_world;
        let rotation = attitude_from_axis(&axis);
        let position = solution.magnet.position_world_m - rotation * self.offset_capsule_m;
        let (e1, e2) = tangent_basis(&axis);
        // Rows [δp_world, δθ_capsule] from [δp_magnet, t₁, t₂]: δu = R(δθ × x), so δθ_y = -(Rᵀδu)_z and δθ_z = (Rᵀδu)_y;
        // the centre moves against the lever o: δp = δp_magnet + R [o]ₓ δθ.
        let mut to_error = SMatrix::<f64, 6, 5>::zeros();
        to_error.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
        let lever = rotation.to_rotation_matrix().into_inner() * lumenav_core::pose::skew(&self.offset_capsule_m);
        for (column, e) in [(3, e1), (4, e2)] {
            let local = rotation.inverse() * e;
            let turn = Vector3::new(0.0, -local.z, local.y);
            to_error.fixed_view_mut::<3, 1>(3, column).copy_from(&turn);
            to_error.fixed_view_mut::<3, 1>(0, column).copy_from(&(lever * turn));
        }
        let mut full: Matrix6<f64> = to_error * covariance * to_error.transpose();
        // A lever off the axis turns with the unknown roll: the centre then lies on a circle.
        let off_axis = self.offset_capsule_m.yz().norm_squared();
        for i in 0..3 {
            full[(i, i)] += 0.5 * off_axis;
        }
        Some(PoseEstimate {
            world_from_capsule: Isometry3::from_parts(Translation3::from(position), rotation),
            covariance: full,
            kind: FixKind::Pointing,
        })
    }

    fn measurement(&self, reading: &Reading, model: FluxModel, fix: Option<PoseEstimate>, warm: bool) -> Option<Measurement> {
        let prior_use = if warm { PriorUse::StartOnly } else { PriorUse::None };
        let common = |value, model: Arc<dyn MeasurementModel>| Measurement {
            sensor: self.sensor.clone(),
            sequence: reading.sequence,
            at: reading.at(),
            arrival: reading.arrival,
            since: None,
            value,
            model,
            prior_use,
            fix: fix.clone(),
        };
        match self.output {
            Output::Flux => Some(common(Arc::new(reading.payload.clone()), Arc::new(model))),
            Output::Pose => fix.as_ref().map(|f| {
                let of_flux = FixOfFlux { flux: model, reading: Arc::new(reading.payload.clone()) };
                common(Arc::new(f.to_frame()), Arc::new(of_flux))
            }),
        }
    }
}

/// χ² that a good solution exceeds once in a million.
fn chi_square_limit(channels: usize) -> f64 {
    let freedom = channels as f64 - 5.0;
    if freedom <= 0.0 {
        return f64::INFINITY;
    }
    // The degrees of freedom are positive by the line above.
    ChiSquared::new(freedom).map_or(f64::INFINITY, |d| d.inverse_cdf(WARM_QUANTILE))
}

impl FrontEnd for MagneticFrontEnd {
    fn process(&mut self, reading: &Reading, prior: Option<&PosePrior>) -> Result<Outcome, ModalityError> {
        let model = self.model(reading);
        let mut payload = reading.clone();
        if let Some(limit) = self.saturation_tesla {
            mask_saturated(&mut payload, limit)?;
        }
        let reading = &payload;
        let flux = reading.payload.f64("flux_tesla")?;
        if flux.len() != model.channels.len() {
            let message = format!("{} channels, the installed array has {}", flux.len(), model.channels.len());
            return Err(ModalityError::Reading(message));
        }
        let valid = reading.payload.valid();
        let count = valid.iter().filter(|v| **v).count();
        if count < 6 {
            let why = format!("{count} valid channels; a pose of 5 degrees of freedom needs 6 at least");
            return Ok(Outcome::Refused { why: why.into() });
        }
        if self.output == Output::Flux && prior.is_some() {
            let measurement = self.measurement(reading, model, None, true);
            return Ok(measurement.map_or(Outcome::Nothing, |m| Outcome::Measured(vec![m])));
        }
        let variance: Vec<f64> = flux.iter().map(|z| model.variance(*z)).collect();
        let readings = Readings { flux_tesla: flux, valid, variance_tesla2: &variance };
        let Some(solution) = self.solve(&model, readings, prior) else {
            return Ok(Outcome::Refused { why: "no start led to a finite likelihood".into() });
        };
        if let Some(why) = self.objection(&solution, &model.channels) {
            return Ok(Outcome::Refused { why: why.into() });
        }
        let Some(fix) = self.fix(&solution) else {
            return Ok(Outcome::Refused { why: "the pose is not observable from these channels".into() });
        };
        let measurement = self.measurement(reading, model, Some(fix), prior.is_some());
        Ok(measurement.map_or(Outcome::Nothing, |m| Outcome::Measured(vec![m])))
    }
}

/// A channel at its limit says only "at least": it is masked.
fn mask_saturated(reading: &mut Reading, limit_tesla: f64) -> Result<(), ModalityError> {
    let beyond: Vec<usize> = reading
        .payload
        .f64("flux_tesla")?
        .iter()
        .enumerate()
        .filter(|(_, z)| z.abs() >= limit_tesla * (1.0 - 1e-9))
        .map(|(k, _)| k)
        .collect();
    beyond.into_iter().for_each(|k| reading.payload.mask_row(k));
    Ok(())
}
