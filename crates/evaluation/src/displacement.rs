//! Relative error while a run goes: how wrong a track's *displacement* is over a fixed time or a fixed path.
//!
//! ```text
//! e_k = ‖ (p̂_j - p̂_i) - (p_j - p_i) ‖        p̂ estimate, p truth, in the world
//! drift = Σ e_k / Σ path of the truth between i and j
//! ```
//!
//! Pairs follow each other: a pair ends at the first instant at which time or the truth's path since its start has reached the
//! span, and the next starts there (the rule of `evo`'s consecutive pairs on the reference). The displacement is taken in the
//! world, so a track that knows no roll has a figure too; where the attitude is wanted as well, see [`crate::trajectory`],
//! whose relative pose error is that of `evo`. Memory: the start of the open pair, and [`crate::bounded`] figures.

use crate::bounded::BoundedQuantiles;
use crate::summary::{CompensatedSum, ScalarSummary};
use nalgebra::Vector3;

/// How far the two instants of a pair are apart.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Span {
    /// Time, s.
    Seconds(f64),
    /// Path of the truth, m.
    Metres(f64),
}

/// A pair of instants further apart than this many spans of time lies across a gap and is no figure of the span.
const LONGEST_SPANS: f64 = 1.5;

/// Rounding of time stamps: a pair of instants one span apart is not lost to the last bit.
const STAMP_ROUNDING_S: f64 = 1e-9;

#[derive(Debug, Clone, Copy)]
struct Open {
    from_s: f64,
    last_s: f64,
    truth_m: Vector3<f64>,
    estimate_m: Vector3<f64>,
    path_m: f64,
    last_truth_m: Vector3<f64>,
}

/// Collects the error of displacements.
#[derive(Debug, Clone)]
pub struct DisplacementErrors {
    span: Span,
    open: Option<Open>,
    errors_m: BoundedQuantiles,
    total_error_m: CompensatedSum,
    total_path_m: CompensatedSum,
}

impl DisplacementErrors {
    /// An empty collection.
    pub fn over(span: Span) -> Self {
        let (total_error_m, total_path_m) = (CompensatedSum::default(), CompensatedSum::default());
        Self { span, open: None, errors_m: BoundedQuantiles::new(), total_error_m, total_path_m }
    }

    /// Takes an instant (s; one that is not later than the last is passed over) with the positions of estimate and truth in the world, m.
    pub fn push(&mut self, at_s: f64, estimate_m: Vector3<f64>, truth_m: Vector3<f64>) {
        let start =
            Open { from_s: at_s, last_s: at_s, truth_m, estimate_m, path_m: 0.0, last_truth_m: truth_m };
        let Some(open) = &mut self.open else {
            self.open = Some(start);
            return;
        };
        // An instant of the past: a late reading of a track without a filter.
        if at_s <= open.last_s {
            return;
        }
        open.last_s = at_s;
        if matches!(self.span, Span::Seconds(span) if at_s - open.from_s > LONGEST_SPANS * span) {
            self.open = Some(start);
            return;
        }
        open.path_m += (truth_m - open.last_truth_m).norm();
        open.last_truth_m = truth_m;
        let reached = match self.span {
            Span::Seconds(span) => at_s - open.from_s >= span - STAMP_ROUNDING_S,
            Span::Metres(span) => open.path_m >= span,
        };
        if reached {
            let error_m = ((estimate_m - open.estimate_m) - (truth_m - open.truth_m)).norm();
            self.errors_m.push(error_m);
            self.total_error_m.add(error_m);
            self.total_path_m.add(open.path_m);
            self.open = Some(start);
        }
    }

    /// Gives up the open pair: the track was lost or started anew, and what lies between is no displacement.
    pub fn interrupt(&mut self) {
        self.open = None;
    }

    /// Number of pairs.
    pub fn pairs(&self) -> usize {
        self.errors_m.count()
    }

    /// The errors, m; `None` without pairs.
    pub fn summary_m(&self) -> Option<ScalarSummary> {
        self.errors_m.summary()
    }

    /// Sum of the errors over the truth's path between the pairs, a share; `None` where the truth does not move.
    pub fn drift_share(&self) -> Option<f64> {
        let path_m = self.total_path_m.value();
        (path_m > 0.0).then(|| self.total_error_m.value() / path_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trajectory::relative::{Delta, PairRule, relative_pose_error};
    use crate::trajectory::{AssociatedPoses, Relation};
    use approx::assert_relative_eq;
    use nalgebra::Isometry3;

    /// A capsule that does not turn: displacement in the world and the translation part of the relative pose are one.
    #[test]
    fn cross_displacements_as_the_relative_pose_error_of_whole_trajectories() {
        let truth: Vec<Vector3<f64>> = (0..400)
            .map(|i| f64::from(i) * 0.05)
            .map(|t| Vector3::new(0.01 * (0.7 * t).sin(), 0.002 * t, 0.004 * (2.1 * t).cos()))
            .collect();
        let estimate: Vec<Vector3<f64>> = truth
            .iter()
            .enumerate()
            .map(|(i, p)| {
                p * 1.03 + Vector3::new(1e-4 * (i as f64).sin(), 0.0, 2e-4 * (1.7 * i as f64).cos())
            })
            .collect();
        let stamps_s: Vec<f64> = (0..400).map(|i| f64::from(i) * 0.05).collect();
        let poses = |points: &[Vector3<f64>]| {
            points
                .iter()
                .map(|p| Isometry3::from_parts((*p).into(), nalgebra::UnitQuaternion::identity()))
                .collect()
        };
        let pairs = AssociatedPoses {
            stamps_s: stamps_s.clone(),
            reference: poses(&truth),
            estimate: poses(&estimate),
        };
        for (span, delta) in
            [(Span::Seconds(1.0), Delta::Seconds(1.0)), (Span::Metres(0.01), Delta::Metres(0.01))]
        {
            let mut stream = DisplacementErrors::over(span);
            for ((t, e), p) in stamps_s.iter().zip(&estimate).zip(&truth) {
                stream.push(*t, *e, *p);
            }
            let whole = relative_pose_error(&pairs, Relation::TranslationPart, &PairRule::consecutive(delta))
                .unwrap();
            assert_eq!(stream.pairs(), whole.pairs.len());
            assert_relative_eq!(
                stream.summary_m().unwrap().rmse,
                whole.statistics().unwrap().rmse,
                max_relative = 1e-12
            );
            assert_relative_eq!(
                stream.drift_share().unwrap(),
                whole.drift_share().unwrap(),
                max_relative = 1e-12
            );
        }
    }

    #[test]
    fn closed_form_an_interruption_ends_the_pair() {
        let mut stream = DisplacementErrors::over(Span::Seconds(1.0));
        let at = |x: f64| Vector3::new(x, 0.0, 0.0);
        stream.push(0.0, at(0.0), at(0.0));
        stream.interrupt();
        stream.push(1.0, at(5.0), at(0.0));
        assert_eq!(stream.pairs(), 0);
        stream.push(2.0, at(5.5), at(0.2));
        assert_relative_eq!(stream.summary_m().unwrap().mean, 0.3, max_relative = 1e-12);
        assert_relative_eq!(stream.drift_share().unwrap(), 1.5, max_relative = 1e-12);
    }
}
