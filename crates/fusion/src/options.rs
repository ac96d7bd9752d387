//! What a user may set of the filter: the `[track.filter]` and `[track.prior]` tables.

use lumenav_core::MotionModel;
use lumenav_core::config::quantity::{Finite, NonNegative, Positive};
use serde::{Deserialize, Deserializer, Serialize, de};

/// A probability strictly between 0 and 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(transparent)]
pub struct Probability(pub f64);

impl<'de> Deserialize<'de> for Probability {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let value = f64::deserialize(deserializer)?;
        if value > 0.0 && value < 1.0 {
            Ok(Self(value))
        } else {
            Err(de::Error::custom(format!(
                "{value} is not allowed here; it must lie between 0 and 1, ends excluded"
            )))
        }
    }
}

/// Options of the error-state Kalman filter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EskfOptions {
    /// How the capsule is believed to move.
    pub motion: MotionModel,
    /// A measurement is refused when its squared innovation lies beyond this quantile of chi-square. Default 0.9999: at
    /// 100 Hz one good reading in 100 s is lost, and a real outlier lies far beyond.
    pub gate_probability: Probability,
    /// After so many refusals in a row of one sensor the belief is given up and the next fix starts it anew. Default 3, tuned on
    /// `colon-magnetic`, seeds 101 to 103: two outliers are sat out; a capsule that a contraction has thrown out of its predicted
    /// motion (a refused prediction runs away by up to 30 mm within ten readings at 20 Hz) is found again.
    pub reacquire_after: u32,
    /// The belief is given up when its position's standard deviation (largest axis) exceeds this, m. Default 0.2: half a
    /// torso; a start point that vague helps no front end.
    pub lost_position_sigma_m: Positive,
    /// Measurements that arrive later than this behind the newest are refused, s. Default 2.
    pub lag_s: NonNegative,
    /// Gauss-Newton iterations of an update whose model is strongly nonlinear. Default 4; converged ones stop earlier.
    pub max_iterations: u32,
    /// Standard deviation of the velocity at the start, m/s per axis. Default 0.02: the colon's fastest movement.
    pub initial_velocity_sigma_m_s: Positive,
    /// Standard deviation of the angular rate at the start, rad/s per axis. Default 1: what the motion model allows. Not looked at where a
    /// sensor tells the motion beside its fix.
    pub initial_rate_sigma_rad_s: Positive,
}

impl Default for EskfOptions {
    fn default() -> Self {
        Self {
            motion: MotionModel::default(),
            gate_probability: Probability(0.9999),
            reacquire_after: 3,
            lost_position_sigma_m: Positive(0.2),
            lag_s: NonNegative(2.0),
            max_iterations: 4,
            initial_velocity_sigma_m_s: Positive(0.02),
            initial_rate_sigma_rad_s: Positive(1.0),
        }
    }
}

/// Where the capsule is believed to be at the scenario's start, from something other than a measurement.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PriorOptions {
    /// Position in the world, mm.
    pub position_mm: [Finite; 3],
    /// Its standard deviation per axis, mm.
    pub position_sigma_mm: Positive,
    /// Rotation vector of world_from_capsule, degrees.
    pub rotation_vector_deg: [Finite; 3],
    /// Its standard deviation per axis, degrees.
    pub rotation_sigma_deg: Positive,
    /// Velocity in the world, mm/s.
    #[serde(default)]
    pub velocity_mm_s: [Finite; 3],
}
