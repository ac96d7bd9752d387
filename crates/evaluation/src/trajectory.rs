//! Absolute and relative errors of whole trajectories, as the tool `evo` (version 1.38) defines them.
//!
//! A [`Trajectory`] is a list of times and poses `world_from_capsule`. Two of them are brought together by
//! [`associate`] (each pose of the shorter with the nearest in time of the longer, if within
//! `max_difference_s`), optionally aligned ([`alignment`]), and compared pose by pose ([`absolute`]: APE,
//! whose translation part is the ATE) or over pairs of poses ([`relative`]: RPE).
//!
//! ```text
//! APE:  E_i  = P_i^-1 Q_i                          P estimate, Q reference
//! RPE:  E_ij = (Q_i^-1 Q_j)^-1 (P_i^-1 P_j)
//! ```
//!
//! Each error matrix `E` gives one number by a [`Relation`]. Defaults follow what is honest for an absolute
//! localiser, not what is usual for visual odometry: no alignment (alignment hides registration errors),
//! pairs chosen on the reference (on the estimate, a noisier track has longer paths, so other pairs and a
//! smaller error). `evo`'s own default for the latter is offered as [`relative::PairsFrom::Estimate`].
//!
//! Use this for exported files and for comparison with others. Inside the program truth is continuous, and
//! [`crate::pose_error`] compares at the estimate's own time; association by nearest time hides latency.
//!
//! Source: definitions of Sturm et al. 2012 (ATE, RPE) and Umeyama 1991; pairing rules by observation of evo
//! 1.38.1, whose figures are met to 1e-9 (`tests/evo.rs`).

pub mod absolute;
pub mod alignment;
pub mod relative;

use crate::error::{EvaluationError, all_finite};
use crate::pose_error::rotation_angle_rad;
use crate::summary::{CompensatedSum, quantile_of_sorted};
use nalgebra::{Isometry3, Matrix3};
use serde::{Deserialize, Serialize};

/// Times and poses of one track.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    stamps_s: Vec<f64>,
    world_from_capsule: Vec<Isometry3<f64>>,
}

impl Trajectory {
    /// Takes times (s, strictly increasing) and as many poses.
    ///
    /// # Errors
    /// Unequal lengths, numbers that are not finite, time that does not increase.
    pub fn new(stamps_s: Vec<f64>, world_from_capsule: Vec<Isometry3<f64>>) -> Result<Self, EvaluationError> {
        let (first, second) = (stamps_s.len(), world_from_capsule.len());
        if first != second {
            return Err(EvaluationError::ShapeMismatch { what: "times and poses", first, second });
        }
        all_finite("times of a trajectory", &stamps_s)?;
        for (index, pose) in world_from_capsule.iter().enumerate() {
            let numbers = pose.translation.vector.iter().chain(pose.rotation.coords.iter());
            if !numbers.into_iter().all(|value| value.is_finite()) {
                return Err(EvaluationError::NotFinite { what: "poses of a trajectory", index });
            }
        }
        if let Some(index) = (1..stamps_s.len()).find(|&i| stamps_s[i] <= stamps_s[i - 1]) {
            return Err(EvaluationError::TimeNotIncreasing { index });
        }
        Ok(Self { stamps_s, world_from_capsule })
    }

    /// Times, s.
    pub fn stamps_s(&self) -> &[f64] {
        &self.stamps_s
    }

    /// Poses, `world_from_capsule`.
    pub fn world_from_capsule(&self) -> &[Isometry3<f64>] {
        &self.world_from_capsule
    }

    /// Number of poses.
    pub fn len(&self) -> usize {
        self.stamps_s.len()
    }

    /// Whether there is no pose.
    pub fn is_empty(&self) -> bool {
        self.stamps_s.is_empty()
    }

    /// Length of the path, m.
    pub fn path_length_m(&self) -> f64 {
        let poses = &self.world_from_capsule;
        poses.windows(2).map(|pair| (pair[1].translation.vector - pair[0].translation.vector).norm()).sum()
    }

    /// Index of the pose nearest in time; of two equally near ones the earlier. `None` if there is no pose.
    fn nearest(&self, stamp_s: f64) -> Option<usize> {
        let after = self.stamps_s.partition_point(|&t| t < stamp_s);
        match (after.checked_sub(1), self.stamps_s.get(after)) {
            (Some(before), Some(&t)) => {
                let later_is_nearer = (t - stamp_s).abs() < (self.stamps_s[before] - stamp_s).abs();
                Some(if later_is_nearer { after } else { before })
            }
            (Some(before), None) => Some(before),
            (None, Some(_)) => Some(after),
            (None, None) => None,
        }
    }
}

/// Poses of a reference and an estimate that belong together.
#[derive(Debug, Clone, PartialEq)]
pub struct AssociatedPoses {
    /// Time of the reference's pose, s.
    pub stamps_s: Vec<f64>,
    /// Reference poses, `world_from_capsule`.
    pub reference: Vec<Isometry3<f64>>,
    /// Estimated poses, `world_from_capsule`, as many.
    pub estimate: Vec<Isometry3<f64>>,
}

impl AssociatedPoses {
    /// Number of pairs.
    pub fn len(&self) -> usize {
        self.reference.len()
    }

    /// Whether there is no pair.
    pub fn is_empty(&self) -> bool {
        self.reference.is_empty()
    }

    /// The first `count` pairs (all, if there are fewer).
    pub fn first(&self, count: usize) -> Self {
        let count = count.min(self.len());
        Self {
            stamps_s: self.stamps_s[..count].to_vec(),
            reference: self.reference[..count].to_vec(),
            estimate: self.estimate[..count].to_vec(),
        }
    }
}

/// Pairs each pose of the shorter trajectory (of two equally long ones: of the estimate) with the pose of the
/// other that is nearest in time, if the stamps differ by at most `max_difference_s` (evo's default: 0.01 s).
///
/// A pose of the longer trajectory may be used more than once, as in evo.
///
/// # Errors
/// No stamps close enough; a negative or NaN `max_difference_s`.
pub fn associate(
    reference: &Trajectory,
    estimate: &Trajectory,
    max_difference_s: f64,
) -> Result<AssociatedPoses, EvaluationError> {
    if max_difference_s.is_nan() || max_difference_s < 0.0 {
        let what = "largest difference between associated stamps in seconds";
        return Err(EvaluationError::OutOfRange { what, allowed: "zero or more", value: max_difference_s });
    }
    let estimate_leads = estimate.len() <= reference.len();
    let (leader, follower) = if estimate_leads { (estimate, reference) } else { (reference, estimate) };
    let mut pairs = AssociatedPoses { stamps_s: Vec::new(), reference: Vec::new(), estimate: Vec::new() };
    for (i, &stamp_s) in leader.stamps_s.iter().enumerate() {
        let Some(j) = follower.nearest(stamp_s) else { continue };
        if (follower.stamps_s[j] - stamp_s).abs() > max_difference_s {
            continue;
        }
        let (r, e) = if estimate_leads { (j, i) } else { (i, j) };
        pairs.stamps_s.push(reference.stamps_s[r]);
        pairs.reference.push(reference.world_from_capsule[r]);
        pairs.estimate.push(estimate.world_from_capsule[e]);
    }
    if pairs.is_empty() {
        return Err(EvaluationError::NoMatchingStamps { max_difference_s });
    }
    Ok(pairs)
}

/// How one number is made of an error matrix `E = [R t; 0 1]`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Relation {
    /// `||t||`, m.
    TranslationPart,
    /// `||R - I||` (Frobenius), no unit.
    RotationPart,
    /// Angle of R, rad.
    RotationAngleRad,
    /// Angle of R, degrees.
    RotationAngleDeg,
    /// `||E - I||` (Frobenius): metres and pure numbers mixed, kept because evo has it.
    FullTransformation,
}

impl Relation {
    /// The error that this relation makes of an error matrix.
    pub fn error(self, matrix: &Isometry3<f64>) -> f64 {
        let translation = || matrix.translation.vector.norm();
        let rotation_part =
            || (matrix.rotation.to_rotation_matrix().into_inner() - Matrix3::identity()).norm();
        match self {
            Self::TranslationPart => translation(),
            Self::RotationPart => rotation_part(),
            Self::RotationAngleRad => rotation_angle_rad(&matrix.rotation),
            Self::RotationAngleDeg => rotation_angle_rad(&matrix.rotation).to_degrees(),
            Self::FullTransformation => translation().hypot(rotation_part()),
        }
    }

    /// Unit of the error, empty where it has none.
    pub fn unit(self) -> &'static str {
        match self {
            Self::TranslationPart => "m",
            Self::RotationAngleRad => "rad",
            Self::RotationAngleDeg => "deg",
            Self::RotationPart | Self::FullTransformation => "",
        }
    }
}

/// The figures that evo prints of a series of errors, in the unit of the relation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Statistics {
    /// Root of the mean square.
    pub rmse: f64,
    /// Arithmetic mean.
    pub mean: f64,
    /// Median.
    pub median: f64,
    /// Standard deviation of the population (divided by n, not n - 1).
    pub std: f64,
    /// Smallest.
    pub min: f64,
    /// Largest.
    pub max: f64,
    /// Sum of squares, in the unit squared.
    pub sse: f64,
}

impl Statistics {
    /// The figures of `errors`.
    ///
    /// # Errors
    /// No values, or values that are not finite.
    pub fn of(errors: &[f64]) -> Result<Self, EvaluationError> {
        if errors.is_empty() {
            return Err(EvaluationError::TooFew { what: "statistics of errors", needed: 1, given: 0 });
        }
        all_finite("errors", errors)?;
        let n = errors.len() as f64;
        let sum = |f: &dyn Fn(f64) -> f64| {
            let mut sum = CompensatedSum::default();
            for &error in errors {
                sum.add(f(error));
            }
            sum.value()
        };
        let mean = sum(&|e| e) / n;
        let sse = sum(&|e| e * e);
        let mut sorted = errors.to_vec();
        sorted.sort_unstable_by(f64::total_cmp);
        Ok(Self {
            rmse: (sse / n).sqrt(),
            mean,
            median: quantile_of_sorted(&sorted, 0.5).unwrap_or(mean),
            std: (sum(&|e| (e - mean) * (e - mean)) / n).sqrt(),
            min: sorted[0],
            max: sorted[sorted.len() - 1],
            sse,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use nalgebra::{Translation3, UnitQuaternion, Vector3};

    fn on_a_line(stamps_s: &[f64]) -> Trajectory {
        let poses = (0..stamps_s.len()).map(|i| Isometry3::translation(i as f64, 0.0, 0.0)).collect();
        Trajectory::new(stamps_s.to_vec(), poses).unwrap()
    }

    fn matched(pairs: &AssociatedPoses) -> Vec<(f64, f64)> {
        let x = |pose: &Isometry3<f64>| pose.translation.vector.x;
        pairs.reference.iter().map(x).zip(pairs.estimate.iter().map(x)).collect()
    }

    /// What evo 1.38.1 does with the same stamps: the estimate leads when the lengths are equal, of two
    /// equally near stamps the earlier is taken, the bound is inclusive, a pose may serve twice.
    #[test]
    fn cross_association_rules_of_evo() {
        let pairs =
            associate(&on_a_line(&[0.0, 0.004, 0.006]), &on_a_line(&[0.0, 0.002, 0.0045]), 0.01).unwrap();
        assert_eq!(matched(&pairs), vec![(0.0, 0.0), (0.0, 1.0), (1.0, 2.0)]);
        let pairs = associate(&on_a_line(&[0.0, 5.0]), &on_a_line(&[0.0, 0.004, 0.008]), 0.01).unwrap();
        assert_eq!(matched(&pairs), vec![(0.0, 0.0)]);
        let pairs = associate(&on_a_line(&[-0.25, 0.25, 1.25]), &on_a_line(&[0.0, 1.0]), 0.25).unwrap();
        assert_eq!(matched(&pairs), vec![(0.0, 0.0), (2.0, 1.0)]);
    }

    #[test]
    fn closed_form_no_match_is_an_error() {
        let none = associate(&on_a_line(&[0.0]), &on_a_line(&[1.0]), 0.01);
        assert_eq!(none, Err(EvaluationError::NoMatchingStamps { max_difference_s: 0.01 }));
        let empty = Trajectory::new(Vec::new(), Vec::new()).unwrap();
        assert!(associate(&empty, &on_a_line(&[0.0]), 0.01).is_err());
        assert!(associate(&on_a_line(&[0.0]), &on_a_line(&[0.0]), f64::NAN).is_err());
    }

    #[test]
    fn closed_form_bad_trajectories_are_refused() {
        let pose = Isometry3::identity();
        assert!(matches!(
            Trajectory::new(vec![0.0, 0.0], vec![pose; 2]),
            Err(EvaluationError::TimeNotIncreasing { index: 1 })
        ));
        assert!(Trajectory::new(vec![0.0], vec![pose; 2]).is_err());
        assert!(Trajectory::new(vec![f64::NAN], vec![pose]).is_err());
        let lost = Isometry3::translation(f64::NAN, 0.0, 0.0);
        assert!(matches!(
            Trajectory::new(vec![0.0], vec![lost]),
            Err(EvaluationError::NotFinite { index: 0, .. })
        ));
    }

    #[test]
    fn closed_form_relations() {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.5);
        let matrix = Isometry3::from_parts(Translation3::new(0.0, 0.3, 0.4), turn);
        assert_relative_eq!(Relation::TranslationPart.error(&matrix), 0.5, epsilon = 1e-15);
        assert_relative_eq!(Relation::RotationAngleRad.error(&matrix), 0.5, epsilon = 1e-15);
        assert_relative_eq!(Relation::RotationAngleDeg.error(&matrix), 0.5_f64.to_degrees(), epsilon = 1e-13);
        // ||R - I||_F = 2 sqrt(2) |sin(angle / 2)|
        let part = 8.0_f64.sqrt() * 0.25_f64.sin();
        assert_relative_eq!(Relation::RotationPart.error(&matrix), part, epsilon = 1e-15);
        assert_relative_eq!(Relation::FullTransformation.error(&matrix), part.hypot(0.5), epsilon = 1e-15);
    }

    #[test]
    fn closed_form_statistics() {
        let s = Statistics::of(&[1.0, 2.0, 3.0, 6.0]).unwrap();
        assert_eq!((s.mean, s.median, s.min, s.max, s.sse), (3.0, 2.5, 1.0, 6.0, 50.0));
        assert_relative_eq!(s.std, 3.5_f64.sqrt(), epsilon = 1e-15);
        assert_relative_eq!(s.rmse, 12.5_f64.sqrt(), epsilon = 1e-15);
        assert!(Statistics::of(&[]).is_err());
        assert!(Statistics::of(&[f64::INFINITY]).is_err());
    }

    #[test]
    fn closed_form_path_length() {
        assert_eq!(on_a_line(&[0.0, 1.0, 2.0]).path_length_m(), 2.0);
    }
}
