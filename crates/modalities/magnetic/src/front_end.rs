//! From a flux reading to a measurement: `pose` (maximum likelihood, a fix of 5 degrees of freedom) or `flux` (the raw
//! readings for the filter; a fix rides along only where the filter has no prediction and needs a start).
//!
//! A fix is refused, with the reason, where it could be wrong without looking wrong: too few channels, no convergence, readings
//! that fit no magnet, readings that need no magnet, a second pose that fits as well, a solution inside a sensor, an array
//! whose place is not told. Where the readings scatter by more than the assumed noise allows, the covariance grows with them
//! (factor χ²/(n - 5)).
//!
//! Stateless: the same reading and prior give the same measurement, so tracks do not depend on the order of arrival.

use crate::array::SensorArray;
use crate::channels::{Channel, Channels, MagnetPose};
use crate::config::{Ambient, Installed, OptionsTable};
use crate::model::{FixOfFlux, FluxModel};
use crate::nuisance::{Nuisance, Spread, Unknowns};
use crate::solver::{
    FREEDOM, LinearPrior, Matrix5, Readings, Search, Solution, Unknown, Workspace, covariance_growth, solve,
    solve_each,
};
use lumenav_core::linear::generalised_inverse;
use lumenav_core::pose::{attitude_from_axis, skew, tangent_basis};
use lumenav_core::{
    BlockSpec, FixKind, Frame, FrontEnd, Measurement, MeasurementModel, ModalityError, Name, Outcome,
    PoseEstimate, PosePrior, PriorUse, Reading,
};
use lumenav_fields::FieldSource;
use nalgebra::{DMatrix, Isometry3, Matrix3, Matrix6, SMatrix, Translation3, Vector3};
use serde::{Deserialize, Serialize};
use statrs::distribution::{ChiSquared, ContinuousCDF as _};
use std::collections::BTreeMap;
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

/// A warm solve whose χ² lies beyond this quantile is tried again from cold starts; a magnet that lowers χ² by no more than
/// chance would, to this quantile, is none.
const QUANTILE: f64 = 0.999_999;
/// Below this many channels more than one pose may fit, so that a cold search is always a thorough one (eight triads).
const FEW_CHANNELS: usize = 24;
/// Above this growth of the covariance within its own extent (a doubled standard deviation) a fix is given the larger one.
const NOTED_COVARIANCE_GROWTH: f64 = 4.0;
/// Above this one (ten times the standard deviation) no covariance describes the error, and there is no fix.
const MAX_COVARIANCE_GROWTH: f64 = 100.0;
/// Below this share of the distance to the sensors, or this many radians, an uncertainty is too small for that: information
/// falls with the eighth power of the distance, and (1 + 2·0.02)⁸ = 1.4.
const SMALL_UNCERTAINTY: f64 = 0.02;
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
    /// What a search for a pose has to find beside it in one reading.
    unknown: Unknown,
    /// What the filter carries, and how badly it is known before a filter has a belief.
    nuisance: Arc<Nuisance>,
    unknowns: Unknowns,
    max_reduced_chi_square: f64,
    saturation_tesla: Option<f64>,
    worn: bool,
    workspace: Workspace,
    limits: BTreeMap<usize, f64>,
    sensor: Name,
}

impl MagneticFrontEnd {
    /// Builds the front end from what is installed and what the track asks for.
    pub fn new(sensor: Name, installed: &Installed, options: &OptionsTable) -> Self {
        let fixed = Arc::new(installed.array.channels(&Isometry3::identity()));
        let unknowns = options.unknowns();
        Self {
            output: options.front_end,
            nuisance: Arc::new(Nuisance::new(&sensor, fixed.len(), &unknowns)),
            unknowns,
            fixed,
            source: installed.magnet.source(options.law),
            offset_capsule_m: installed.magnet.offset_capsule_m,
            noise_tesla: options.noise_tesla.map_or(installed.reading_sigma_tesla(), |v| v.0),
            relative_error: options.relative_error.0,
            unknown: Unknown {
                strength: options.unknown_strength,
                ambient: options.ambient != Ambient::Known,
            },
            max_reduced_chi_square: options.max_reduced_chi_square.map_or(MAX_REDUCED_CHI_SQUARE, |v| v.0),
            saturation_tesla: installed.limit_tesla(),
            worn: installed.table.worn_on.is_some(),
            array: installed.array.clone(),
            workspace: Workspace::default(),
            limits: BTreeMap::new(),
            sensor,
        }
    }

    /// The reading's model: of what is unknown, that which the filter does not carry.
    fn model(&self, reading: &Reading) -> FluxModel {
        let carried = &self.unknowns;
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
            unknown: Unknown {
                strength: self.unknown.strength && carried.strength.is_none(),
                ambient: self.unknown.ambient && carried.ambient_tesla.is_none(),
            },
            prior: LinearPrior::NONE,
            nuisance: self.nuisance.clone(),
        }
    }

    /// What is known beforehand of strength and field where the filter is going to carry them, for a search without a belief.
    fn start_prior(&self) -> LinearPrior {
        let information = |spread: Option<Spread>| spread.map_or(0.0, |s| s.sigma.powi(-2));
        LinearPrior {
            strength: information(self.unknowns.strength),
            ambient: Matrix3::identity() * information(self.unknowns.ambient_tesla),
        }
    }

    /// Variance of each channel's reading for a search without a belief: what the filter would carry of the channels is noise to it. A turned
    /// axis sees the field across it, of which the sensor's other channels tell the size.
    fn variances(&self, model: &FluxModel, flux_tesla: &[f64], valid: &[bool]) -> Vec<f64> {
        let square = |spread: Option<Spread>| spread.map_or(0.0, |s| s.sigma * s.sigma);
        let (bias, gain) = (square(self.unknowns.bias_tesla), square(self.unknowns.gain));
        let axis = square(self.unknowns.axis_rad);
        let channels = &model.channels.channels;
        let mut across = vec![0.0; model.channels.positions_world_m.len()];
        for (k, channel) in channels.iter().enumerate().filter(|(k, _)| valid[*k]) {
            across[channel.sensor] += flux_tesla[k].powi(2);
        }
        let of = |(channel, z): (&Channel, &f64)| {
            model.variance(*z) + bias + gain * z * z + axis * across[channel.sensor]
        };
        channels.iter().zip(flux_tesla).map(of).collect()
    }

    /// Whether a body-worn array's place is missing from a reading: the installed places are then not where the sensors are.
    fn place_is_missing(&self, reading: &Reading) -> bool {
        let told = |name: String| reading.known_poses.contains_key(&name);
        self.worn
            && !told("array".to_owned())
            && !(0..self.array.sensors.len()).all(|i| told(format!("s{i}")))
    }

    /// χ² that this many degrees of freedom exceed once in a million.
    fn chi_square_limit(&mut self, freedom: usize) -> f64 {
        *self.limits.entry(freedom).or_insert_with(|| {
            ChiSquared::new(freedom as f64).map_or(f64::INFINITY, |d| d.inverse_cdf(QUANTILE))
        })
    }

    /// Maximum likelihood from the prior where there is one, else from all cold starts.
    fn search(
        &mut self,
        model: &FluxModel,
        readings: Readings<'_>,
        world_from_array: &Isometry3<f64>,
        prior: Option<&PosePrior>,
    ) -> Option<Search> {
        let mut found = Vec::new();
        if let Some(prior) = prior {
            let start = MagnetPose::of_capsule(&prior.pose.world_from_capsule, &self.offset_capsule_m);
            let warm = solve(&model.channels, &self.source, readings, &start, &mut self.workspace);
            if self.explains(&warm) {
                return Some(Search { best: warm, rival: None });
            }
            found.extend(Some(warm).filter(|warm| warm.chi_square.is_finite()));
        }
        let places = self.array.start_positions_m(&model.channels, world_from_array);
        // Of an unknown strength the sign is solved for: opposite axes are one start.
        let axes: &[Vector3<f64>] =
            if self.unknown.strength { &THREE_WAYS } else { &[Vector3::z(), -Vector3::z()] };
        let first = starts(&places, axes);
        solve_each(&model.channels, &self.source, readings, &first, &mut self.workspace, &mut found);
        let few = readings.valid.iter().filter(|valid| **valid).count() < FEW_CHANNELS;
        if few || !found.iter().any(|solution| self.explains(solution)) {
            // Both starts may end in the same wrong valley: once in some hundred poses of an array that surrounds the capsule.
            let more = starts(&around(&places, &model.channels), &SIX_WAYS);
            solve_each(&model.channels, &self.source, readings, &more, &mut self.workspace, &mut found);
        }
        Search::of(found)
    }

    /// Whether a solution leaves nothing but the assumed noise.
    fn explains(&mut self, solution: &Solution) -> bool {
        solution.converged
            && solution.chi_square
                < self.chi_square_limit(solution.channels.saturating_sub(solution.freedom).max(1))
    }

    /// Why what was found cannot be trusted; `None` where it can.
    fn objection(&mut self, found: &Search, readings: Readings<'_>, channels: &Channels) -> Option<String> {
        let best = &found.best;
        if !best.converged {
            return Some("the maximum-likelihood search did not converge".to_owned());
        }
        let reduced = best.reduced_chi_square();
        if reduced > self.max_reduced_chi_square {
            return Some(format!(
                "the readings do not fit a magnet: chi-square per degree of freedom {reduced:.1}"
            ));
        }
        if without_magnet(readings, channels) - best.chi_square
            < self.chi_square_limit(FREEDOM + usize::from(self.unknown.strength)) * reduced.max(1.0)
        {
            return Some("the readings are explained by noise alone: no magnet in reach".to_owned());
        }
        if let Some(rival) = &found.rival {
            let apart_m = (rival.magnet.position_world_m - best.magnet.position_world_m).norm();
            return Some(format!("two poses {apart_m:.3} m apart explain the readings"));
        }
        (nearest_sensor_m(best, channels) < INSIDE_SENSOR_M)
            .then(|| "the solution lies inside a sensor".to_owned())
    }

    /// Covariance of `[δp_magnet, t₁, t₂]`: the inverse information, larger where the readings scatter more than the noise
    /// that is assumed or where the information falls within the covariance's own extent. `None` where no covariance
    /// describes the error.
    fn covariance(
        &mut self,
        best: &Solution,
        readings: Readings<'_>,
        channels: &Channels,
    ) -> Option<Matrix5> {
        let mut covariance = best.information.cholesky()?.inverse();
        if !self.explains(best) {
            covariance *= best.reduced_chi_square().max(1.0);
        }
        let position_m = covariance.fixed_view::<3, 3>(0, 0).trace().sqrt();
        let axis_rad = covariance.fixed_view::<2, 2>(3, 3).trace().sqrt();
        let nearest_m = nearest_sensor_m(best, channels);
        if position_m < SMALL_UNCERTAINTY * nearest_m && axis_rad < SMALL_UNCERTAINTY {
            return Some(covariance);
        }
        let growth = covariance_growth(channels, &self.source, readings, best, &mut self.workspace);
        if growth > NOTED_COVARIANCE_GROWTH {
            covariance *= growth;
        }
        (growth < MAX_COVARIANCE_GROWTH).then_some(covariance)
    }

    /// The capsule's pose from the magnet's, with its covariance.
    ///
    /// A magnet off the capsule's axis, `o = [o_x, o_y, o_z]`, leaves the centre on a circle of radius `ρ = |[o_y, o_z]|` about
    /// the magnet's axis, for the roll is unknown. The fix is the circle's centre, with its covariance `ρ²/2 (I - u uᵀ)`.
    fn fix(&self, solution: &Solution, covariance: &Matrix5) -> PoseEstimate {
        let axis = solution.magnet.axis_world;
        let rotation = attitude_from_axis(&axis);
        let lever_capsule_m = Vector3::new(self.offset_capsule_m.x, 0.0, 0.0);
        // Rows [δp_world, δθ_capsule] from [δp_magnet, t₁, t₂]: δu = R(δθ × x), so δθ_y = -(Rᵀδu)_z and δθ_z = (Rᵀδu)_y;
        // the centre moves against the lever o: δp = δp_magnet + R [o]ₓ δθ.
        let mut to_error = SMatrix::<f64, 6, 5>::zeros();
        to_error.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
        let lever = rotation.to_rotation_matrix().into_inner() * skew(&lever_capsule_m);
        let (e1, e2) = tangent_basis(&axis);
        for (column, e) in [(3, e1), (4, e2)] {
            let local = rotation.inverse() * e;
            let turn = Vector3::new(0.0, -local.z, local.y);
            to_error.fixed_view_mut::<3, 1>(3, column).copy_from(&turn);
            to_error.fixed_view_mut::<3, 1>(0, column).copy_from(&(lever * turn));
        }
        let mut full: Matrix6<f64> = to_error * covariance * to_error.transpose();
        let circle = (Matrix3::identity() - axis * axis.transpose())
            * (0.5 * self.offset_capsule_m.yz().norm_squared());
        let mut position_block = full.fixed_view_mut::<3, 3>(0, 0);
        position_block += circle;
        let position = solution.magnet.position_world_m - rotation * lever_capsule_m;
        PoseEstimate {
            world_from_capsule: Isometry3::from_parts(Translation3::from(position), rotation),
            covariance: full,
            kind: FixKind::Pointing,
        }
    }

    fn measured(
        &self,
        reading: &Reading,
        model: FluxModel,
        fix: Option<PoseEstimate>,
        warm: bool,
    ) -> Outcome {
        let payload = Arc::new(reading.payload.clone());
        let (value, model): (Arc<Frame>, Arc<dyn MeasurementModel>) = match (self.output, &fix) {
            (Output::Pose, Some(fix)) => {
                (Arc::new(fix.to_frame()), Arc::new(FixOfFlux { flux: model, reading: payload }))
            }
            _ => (payload, Arc::new(model)),
        };
        Outcome::Measured(vec![Measurement {
            sensor: self.sensor.clone(),
            sequence: reading.sequence,
            at: reading.at(),
            arrival: reading.arrival,
            since: None,
            value,
            model,
            prior_use: if warm { PriorUse::StartOnly } else { PriorUse::None },
            fix,
            motion: None,
        }])
    }
}

/// No centre of a magnet comes nearer to a sensor than this: both have a size.
const INSIDE_SENSOR_M: f64 = 1e-3;

/// Directions of a search that need not tell north from south.
const THREE_WAYS: [Vector3<f64>; 3] =
    [Vector3::new(1.0, 0.0, 0.0), Vector3::new(0.0, 1.0, 0.0), Vector3::new(0.0, 0.0, 1.0)];

/// Directions of a thorough search.
const SIX_WAYS: [Vector3<f64>; 6] = [
    Vector3::new(1.0, 0.0, 0.0),
    Vector3::new(-1.0, 0.0, 0.0),
    Vector3::new(0.0, 1.0, 0.0),
    Vector3::new(0.0, -1.0, 0.0),
    Vector3::new(0.0, 0.0, 1.0),
    Vector3::new(0.0, 0.0, -1.0),
];

fn starts(places_m: &[Vector3<f64>], axes: &[Vector3<f64>]) -> Vec<MagnetPose> {
    let at = |position_world_m: &Vector3<f64>| {
        let position_world_m = *position_world_m;
        axes.iter().map(move |axis_world| MagnetPose { position_world_m, axis_world: *axis_world })
    };
    places_m.iter().flat_map(at).collect()
}

/// These places and six around each, half as far off as the array's sensors are from it.
fn around(places_m: &[Vector3<f64>], channels: &Channels) -> Vec<Vector3<f64>> {
    let sensors = &channels.positions_world_m;
    let six = |place: &Vector3<f64>| {
        let distance = sensors.iter().map(|s| (s - place).norm()).sum::<f64>() / sensors.len().max(1) as f64;
        let place = *place;
        std::iter::once(place).chain(SIX_WAYS.map(move |way| place + way * (0.5 * distance)))
    };
    places_m.iter().flat_map(six).collect()
}

fn nearest_sensor_m(solution: &Solution, channels: &Channels) -> f64 {
    let place = solution.magnet.position_world_m;
    channels.positions_world_m.iter().map(|s| (s - place).norm()).fold(f64::INFINITY, f64::min)
}

/// χ² of the readings if there were no magnet; where an ambient field is unknown, with the one that explains them best.
fn without_magnet(readings: Readings<'_>, channels: &Channels) -> f64 {
    let of = |k: usize| {
        (readings.flux_tesla[k], channels.channels[k].axis_world, 1.0 / readings.variance_tesla2[k])
    };
    let valid = || (0..readings.flux_tesla.len()).filter(|k| readings.valid[*k]).map(of);
    let (ambient, before) = if readings.unknown.ambient {
        let prior = &readings.prior;
        let seen: Matrix3<f64> = valid().map(|(_, a, w)| a * a.transpose() * w).sum();
        let right: Vector3<f64> = valid().map(|(z, a, w)| a * (w * z)).sum();
        let (inverse, _) =
            generalised_inverse(&DMatrix::from_column_slice(3, 3, (seen + prior.ambient).as_slice()));
        let ambient: Vector3<f64> = Matrix3::from_column_slice(inverse.as_slice()) * right;
        (ambient, ambient.dot(&(prior.ambient * ambient)))
    } else {
        (Vector3::zeros(), 0.0)
    };
    before + valid().map(|(z, a, w)| w * (z - a.dot(&ambient)).powi(2)).sum::<f64>()
}

impl FrontEnd for MagneticFrontEnd {
    fn blocks(&self) -> Vec<BlockSpec> {
        self.nuisance.specs().to_vec()
    }

    fn process(&mut self, reading: &Reading, prior: Option<&PosePrior>) -> Result<Outcome, ModalityError> {
        if self.place_is_missing(reading) {
            return Ok(refused("the array is worn, and the reading does not tell its pose"));
        }
        let model = self.model(reading);
        let mut reading = reading.clone();
        if let Some(limit) = self.saturation_tesla {
            mask_saturated(&mut reading, limit)?;
        }
        let flux = reading.payload.f64("flux_tesla")?;
        if flux.len() != model.channels.len() {
            let message =
                format!("{} channels, the installed array has {}", flux.len(), model.channels.len());
            return Err(ModalityError::Reading(message));
        }
        let flux = reading.payload.f64("flux_tesla")?;
        let valid = reading.payload.valid();
        let count = valid.iter().filter(|v| **v).count();
        if self.output == Output::Flux && prior.is_some() && count > 0 {
            return Ok(self.measured(&reading, model, None, true));
        }
        let freedom = self.unknown.freedom();
        if count <= freedom {
            let why = format!(
                "{count} valid channels; a pose of {freedom} degrees of freedom needs {} at least",
                freedom + 1
            );
            return Ok(refused(&why));
        }
        let variance = self.variances(&model, flux, valid);
        let readings = Readings {
            flux_tesla: flux,
            valid,
            variance_tesla2: &variance,
            unknown: self.unknown,
            prior: self.start_prior(),
        };
        let world_from_array = reading.known_poses.get("array").copied().unwrap_or_else(Isometry3::identity);
        let Some(found) = self.search(&model, readings, &world_from_array, prior) else {
            return Ok(refused("no start led to a finite likelihood"));
        };
        if let Some(why) = self.objection(&found, readings, &model.channels) {
            return Ok(refused(&why));
        }
        let Some(covariance) = self.covariance(&found.best, readings, &model.channels) else {
            return Ok(refused("the pose is not observable from these channels"));
        };
        let fix = self.fix(&found.best, &covariance);
        Ok(self.measured(&reading, model, Some(fix), prior.is_some()))
    }
}

fn refused(why: &str) -> Outcome {
    Outcome::Refused { why: why.into() }
}

/// A channel at its limit says only "at least": it is masked.
fn mask_saturated(reading: &mut Reading, limit_tesla: f64) -> Result<(), ModalityError> {
    let flux = reading.payload.f64("flux_tesla")?;
    // The comparison leaves room for rounding in a file's decimals.
    let beyond: Vec<usize> =
        (0..flux.len()).filter(|k| flux[*k].abs() >= limit_tesla * (1.0 - 1e-9)).collect();
    for k in beyond {
        reading.payload.mask_row(k);
    }
    Ok(())
}
