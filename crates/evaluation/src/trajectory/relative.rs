//! Relative pose error: the motion between two poses of the estimate against the same motion of the
//! reference, `E_ij = (Q_i^-1 Q_j)^-1 (P_i^-1 P_j)`. It shows drift and jitter, and does not see a constant
//! offset.
//!
//! Which pairs (i, j) are compared is part of the definition (rules of evo 1.38.1):
//!
//! | delta | consecutive | all pairs |
//! |---|---|---|
//! | frames | 0, d, 2d, … | every i with i + d |
//! | metres | path summed from the last pair's end until it reaches d | from every i the later j whose path is nearest to d, within the tolerance |
//! | radians, degrees | turns between neighbours summed until they reach d | every later j whose direct angle is within the tolerance of d |
//! | seconds (ours) | time since the last pair's end reaches d | from every i the later j nearest to d, within the tolerance |
//!
//! The tolerance is a share of d (evo: 0.1) and applies to all pairs only. Pairs are chosen on the reference
//! by default; evo chooses them on the estimate, whose noise lengthens its path.

use super::{AssociatedPoses, Relation, Statistics};
use crate::error::EvaluationError;
use crate::pose_error::rotation_angle_rad;
use nalgebra::Isometry3;
use std::fmt;

/// Stamps are whole nanoseconds written as decimal seconds; sums of them are good to half of one.
const STAMP_ROUNDING_S: f64 = 0.5e-9;

/// How far apart the two poses of a pair are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Delta {
    /// Number of poses.
    Frames(usize),
    /// Path length, m.
    Metres(f64),
    /// Angle, rad.
    Radians(f64),
    /// Angle, degrees.
    Degrees(f64),
    /// Time, s.
    Seconds(f64),
}

impl fmt::Display for Delta {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Frames(d) => write!(f, "{d} frames"),
            Self::Metres(d) => write!(f, "{d} m"),
            Self::Radians(d) => write!(f, "{d} rad"),
            Self::Degrees(d) => write!(f, "{d} deg"),
            Self::Seconds(d) => write!(f, "{d} s"),
        }
    }
}

/// Which trajectory the pairs are chosen on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PairsFrom {
    /// The reference: every track is judged on the same pairs.
    #[default]
    Reference,
    /// The estimate: evo's default, for comparison with published figures.
    Estimate,
}

/// Which pairs are compared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairRule {
    /// Distance of the two poses.
    pub delta: Delta,
    /// Overlapping pairs from every pose instead of one after the other.
    pub all_pairs: bool,
    /// Tolerance of all pairs as a share of delta; evo: 0.1.
    pub relative_tolerance: f64,
    /// The trajectory they are chosen on.
    pub pairs_from: PairsFrom,
}

impl PairRule {
    /// Consecutive pairs on the reference, tolerance 0.1.
    pub fn consecutive(delta: Delta) -> Self {
        Self { delta, all_pairs: false, relative_tolerance: 0.1, pairs_from: PairsFrom::Reference }
    }

    /// All pairs on the reference, tolerance 0.1.
    pub fn all(delta: Delta) -> Self {
        Self { all_pairs: true, ..Self::consecutive(delta) }
    }

    /// The same rule, with pairs chosen on the estimate as evo does.
    pub fn from_estimate(self) -> Self {
        Self { pairs_from: PairsFrom::Estimate, ..self }
    }
}

/// Errors over pairs of poses.
#[derive(Debug, Clone, PartialEq)]
pub struct RelativeErrors {
    /// Indices of the pairs in the associated poses.
    pub pairs: Vec<(usize, usize)>,
    /// Error of each pair, in the relation's unit.
    pub errors: Vec<f64>,
    /// Path of the reference between the poses of each pair, m.
    pub reference_path_m: Vec<f64>,
}

impl RelativeErrors {
    /// The figures of the errors.
    ///
    /// # Errors
    /// Errors that are not finite.
    pub fn statistics(&self) -> Result<Statistics, EvaluationError> {
        Statistics::of(&self.errors)
    }

    /// Drift: sum of the errors over the sum of the reference's paths, a share (with the translation part:
    /// metres per metre). `None` where the reference does not move.
    pub fn drift_share(&self) -> Option<f64> {
        let path_m: f64 = self.reference_path_m.iter().sum();
        (path_m > 0.0).then(|| self.errors.iter().sum::<f64>() / path_m)
    }
}

/// The relative pose error under a rule of pairs.
///
/// # Errors
/// [`EvaluationError::NoPairs`] where nothing is as far apart as asked; a delta that is not positive and
/// finite.
pub fn relative_pose_error(
    poses: &AssociatedPoses,
    relation: Relation,
    rule: &PairRule,
) -> Result<RelativeErrors, EvaluationError> {
    let chosen_on = match rule.pairs_from {
        PairsFrom::Reference => &poses.reference,
        PairsFrom::Estimate => &poses.estimate,
    };
    let pairs = select_pairs(&poses.stamps_s, chosen_on, rule)?;
    if pairs.is_empty() {
        return Err(EvaluationError::NoPairs { delta: rule.delta.to_string() });
    }
    let path_m = cumulative(&steps(&poses.reference, step_m));
    let error = |&(i, j): &(usize, usize)| {
        let reference = poses.reference[i].inverse() * poses.reference[j];
        let estimate = poses.estimate[i].inverse() * poses.estimate[j];
        relation.error(&(reference.inverse() * estimate))
    };
    Ok(RelativeErrors {
        errors: pairs.iter().map(error).collect(),
        reference_path_m: pairs.iter().map(|&(i, j)| path_m[j] - path_m[i]).collect(),
        pairs,
    })
}

fn select_pairs(
    stamps_s: &[f64],
    poses: &[Isometry3<f64>],
    rule: &PairRule,
) -> Result<Vec<(usize, usize)>, EvaluationError> {
    let positive = |value: f64| {
        let allowed = "positive and finite";
        let out_of_range = EvaluationError::OutOfRange { what: "distance of the pairs", allowed, value };
        if value > 0.0 && value.is_finite() { Ok(value) } else { Err(out_of_range) }
    };
    if !(rule.relative_tolerance >= 0.0 && rule.relative_tolerance.is_finite()) {
        let what = "relative tolerance of the pairs";
        return Err(EvaluationError::OutOfRange {
            what,
            allowed: "zero or more",
            value: rule.relative_tolerance,
        });
    }
    let share = rule.relative_tolerance;
    Ok(match rule.delta {
        Delta::Frames(frames) => {
            let frames = positive(frames as f64).map(|_| frames)?;
            by_index(poses.len(), frames, rule.all_pairs)
        }
        Delta::Metres(delta) => {
            let delta = positive(delta)?;
            by_progress(&steps(poses, step_m), delta, share * delta, rule.all_pairs)
        }
        Delta::Seconds(delta) => {
            let delta = positive(delta)? - STAMP_ROUNDING_S;
            let time_steps_s: Vec<f64> = stamps_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
            by_progress(&time_steps_s, delta, share * delta, rule.all_pairs)
        }
        Delta::Radians(delta) => by_angle(poses, positive(delta)?, share, rule.all_pairs),
        Delta::Degrees(delta) => by_angle(poses, positive(delta)?.to_radians(), share, rule.all_pairs),
    })
}

fn by_index(count: usize, frames: usize, all_pairs: bool) -> Vec<(usize, usize)> {
    let step = if all_pairs { 1 } else { frames };
    (0..count.saturating_sub(frames)).step_by(step).map(|i| (i, i + frames)).collect()
}

/// Pairs by a quantity that only grows: path, or time.
fn by_progress(steps: &[f64], delta: f64, tolerance: f64, all_pairs: bool) -> Vec<(usize, usize)> {
    if !all_pairs {
        return consecutive(steps, delta);
    }
    let progress = cumulative(steps);
    let mut pairs = Vec::new();
    for i in 0..progress.len().saturating_sub(1) {
        let goal = progress[i] + delta;
        // The nearest later pose; of several at the same distance (a capsule at rest) the first.
        let after = (i + 1).max(progress.partition_point(|&p| p < goal));
        let before = (after > i + 1).then(|| {
            let reached = progress[after - 1];
            (i + 1).max(progress.partition_point(|&p| p < reached))
        });
        let distance = |j: usize| (progress[j] - goal).abs();
        let nearest = match (before, after < progress.len()) {
            (Some(before), true) if distance(after) < distance(before) => after,
            (Some(before), _) => before,
            (None, true) => after,
            (None, false) => continue,
        };
        if distance(nearest) <= tolerance {
            pairs.push((i, nearest));
        }
    }
    pairs
}

fn by_angle(poses: &[Isometry3<f64>], delta: f64, share: f64, all_pairs: bool) -> Vec<(usize, usize)> {
    if !all_pairs {
        return consecutive(&steps(poses, step_rad), delta);
    }
    let (low, high) = (delta - share * delta, delta + share * delta);
    let within = |i: usize, j: usize| (low..=high).contains(&step_rad(&poses[i], &poses[j]));
    (0..poses.len())
        .flat_map(|i| (i + 1..poses.len()).filter(move |&j| within(i, j)).map(move |j| (i, j)))
        .collect()
}

/// A pair ends where the steps since its start have summed up to `delta`; the next starts there.
fn consecutive(steps: &[f64], delta: f64) -> Vec<(usize, usize)> {
    let (mut pairs, mut start, mut reached) = (Vec::new(), 0, 0.0);
    for (i, step) in steps.iter().enumerate() {
        reached += step;
        if reached >= delta {
            pairs.push((start, i + 1));
            (start, reached) = (i + 1, 0.0);
        }
    }
    pairs
}

fn steps(poses: &[Isometry3<f64>], step: fn(&Isometry3<f64>, &Isometry3<f64>) -> f64) -> Vec<f64> {
    poses.windows(2).map(|pair| step(&pair[0], &pair[1])).collect()
}

fn step_m(from: &Isometry3<f64>, to: &Isometry3<f64>) -> f64 {
    (to.translation.vector - from.translation.vector).norm()
}

fn step_rad(from: &Isometry3<f64>, to: &Isometry3<f64>) -> f64 {
    rotation_angle_rad(&(from.rotation.inverse() * to.rotation))
}

/// Sums from the start: one longer than the steps, beginning with 0.
fn cumulative(steps: &[f64]) -> Vec<f64> {
    let mut sums = Vec::with_capacity(steps.len() + 1);
    sums.push(0.0);
    for step in steps {
        sums.push(sums[sums.len() - 1] + step);
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use nalgebra::{UnitQuaternion, Vector3};

    fn on_a_line(x: &[f64]) -> AssociatedPoses {
        let poses: Vec<_> = x.iter().map(|&x| Isometry3::translation(x, 0.0, 0.0)).collect();
        let stamps_s = (0..x.len()).map(|i| 0.1 * i as f64).collect();
        AssociatedPoses { stamps_s, reference: poses.clone(), estimate: poses }
    }

    fn turned(angles_rad: &[f64]) -> AssociatedPoses {
        let pose = |&angle: &f64| {
            let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle);
            Isometry3::from_parts(nalgebra::Translation3::identity(), turn)
        };
        let poses: Vec<_> = angles_rad.iter().map(pose).collect();
        AssociatedPoses { stamps_s: vec![0.0; poses.len()], reference: poses.clone(), estimate: poses }
    }

    fn pairs(poses: &AssociatedPoses, rule: PairRule) -> Vec<(usize, usize)> {
        relative_pose_error(poses, Relation::TranslationPart, &rule).map_or_else(|_| Vec::new(), |e| e.pairs)
    }

    /// Pairs that evo 1.38.1 returned for the same path.
    #[test]
    fn cross_pairs_by_path_as_evo() {
        let path = on_a_line(&[0.0, 1.0, 2.0, 3.0, 4.5, 5.2, 6.0, 6.1, 6.2, 9.0, 9.5]);
        let consecutive = |d| pairs(&path, PairRule::consecutive(Delta::Metres(d)));
        assert_eq!(consecutive(1.0), vec![(0, 1), (1, 2), (2, 3), (3, 4), (4, 6), (6, 9)]);
        assert_eq!(consecutive(1.5), vec![(0, 2), (2, 4), (4, 6), (6, 9)]);
        assert_eq!(consecutive(2.0), vec![(0, 2), (2, 4), (4, 9)]);
        assert_eq!(consecutive(10.0), vec![]);
        let all = |d, tolerance: f64| {
            pairs(&path, PairRule { relative_tolerance: tolerance / d, ..PairRule::all(Delta::Metres(d)) })
        };
        assert_eq!(all(1.0, 0.1), vec![(0, 1), (1, 2), (2, 3), (5, 8)]);
        assert_eq!(all(2.0, 0.0), vec![(0, 2), (1, 3)]);
        assert_eq!(all(2.0, 0.5), vec![(0, 2), (1, 3), (2, 4), (3, 5), (4, 8)]);
        let expected = vec![(0, 3), (1, 4), (2, 5), (3, 6), (5, 9), (6, 9), (7, 9), (8, 9)];
        assert_eq!(all(3.0, 1.0), expected);
        let ties = on_a_line(&[0.0, 1.75, 2.25, 2.25, 4.0]);
        let rule = PairRule { relative_tolerance: 0.25, ..PairRule::all(Delta::Metres(2.0)) };
        assert_eq!(pairs(&ties, rule), vec![(0, 1), (1, 4), (2, 4), (3, 4)]);
        let rests = on_a_line(&[0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 2.0, 2.0]);
        assert_eq!(pairs(&rests, PairRule::consecutive(Delta::Metres(1.0))), vec![(0, 3), (3, 6)]);
        let expected = vec![(0, 3), (1, 3), (2, 3), (3, 6), (4, 6), (5, 6)];
        assert_eq!(pairs(&rests, PairRule::all(Delta::Metres(1.0))), expected);
    }

    /// Pairs that evo 1.38.1 returned for the same turns.
    #[test]
    fn cross_pairs_by_angle_as_evo() {
        let turns = turned(&[0.0, 0.1, 0.2, 0.1, 0.0, -0.1, 0.4, 0.5, 0.55, 1.2, 1.0]);
        let degrees = Delta::Degrees(20.0);
        assert_eq!(pairs(&turns, PairRule::consecutive(degrees)), vec![(0, 4), (4, 6), (6, 9)]);
        assert_eq!(pairs(&turns, PairRule::all(degrees)), vec![(2, 8)]);
        let expected = vec![(1, 6), (2, 5), (2, 7), (3, 6)];
        assert_eq!(pairs(&turns, PairRule::all(Delta::Radians(0.3))), expected);
    }

    #[test]
    fn cross_pairs_by_index_as_evo() {
        let path = on_a_line(&[0.0; 11]);
        assert_eq!(pairs(&path, PairRule::consecutive(Delta::Frames(3))), vec![(0, 3), (3, 6), (6, 9)]);
        assert_eq!(pairs(&path, PairRule::consecutive(Delta::Frames(5))), vec![(0, 5), (5, 10)]);
        assert_eq!(pairs(&path, PairRule::all(Delta::Frames(9))), vec![(0, 9), (1, 10)]);
    }

    #[test]
    fn closed_form_pairs_by_time_survive_decimal_stamps() {
        let path = on_a_line(&[0.0; 31]);
        assert_eq!(
            pairs(&path, PairRule::consecutive(Delta::Seconds(1.0))),
            vec![(0, 10), (10, 20), (20, 30)]
        );
        assert_eq!(
            pairs(&path, PairRule::all(Delta::Seconds(2.9))),
            vec![(0, 29), (1, 30), (2, 30), (3, 30)]
        );
    }

    #[test]
    fn closed_form_scale_error_is_drift() {
        let mut path = on_a_line(&(0..50).map(|i| 0.01 * f64::from(i)).collect::<Vec<_>>());
        for pose in &mut path.estimate {
            pose.translation.vector *= 1.05;
        }
        let rule = PairRule::consecutive(Delta::Frames(10));
        let errors = relative_pose_error(&path, Relation::TranslationPart, &rule).unwrap();
        assert_relative_eq!(errors.drift_share().unwrap(), 0.05, epsilon = 1e-12);
        assert_relative_eq!(errors.statistics().unwrap().rmse, 0.005, epsilon = 1e-12);
    }

    /// A constant motion in front of the estimate is invisible to relative errors.
    #[test]
    fn law_offset_of_the_frame_is_invisible() {
        let mut path = on_a_line(&(0..50).map(|i| 0.01 * f64::from(i)).collect::<Vec<_>>());
        let offset = Isometry3::new(Vector3::new(0.3, 0.1, -0.2), Vector3::new(0.4, -0.5, 0.6));
        for pose in &mut path.estimate {
            *pose = offset * *pose;
        }
        let rule = PairRule::all(Delta::Metres(0.1)).from_estimate();
        let errors = relative_pose_error(&path, Relation::FullTransformation, &rule).unwrap();
        assert!(errors.statistics().unwrap().max < 1e-14);
    }

    #[test]
    fn closed_form_impossible_rules_are_errors() {
        let path = on_a_line(&[0.0, 0.1]);
        for delta in [Delta::Frames(0), Delta::Metres(-1.0), Delta::Radians(f64::NAN), Delta::Degrees(0.0)] {
            let refused =
                relative_pose_error(&path, Relation::TranslationPart, &PairRule::consecutive(delta));
            assert!(matches!(refused, Err(EvaluationError::OutOfRange { .. })), "{delta}");
        }
        let refused =
            relative_pose_error(&path, Relation::TranslationPart, &PairRule::consecutive(Delta::Metres(5.0)));
        assert_eq!(refused, Err(EvaluationError::NoPairs { delta: "5 m".to_owned() }));
    }
}
