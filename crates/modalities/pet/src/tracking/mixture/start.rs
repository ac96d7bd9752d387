//! A first pose from several windows together, of a capsule that moves meanwhile.
//!
//! The stack's lines are carried along a velocity to its mean instant, and the stack is climbed as if it were one window. The velocity
//! is the slope of the windows' own places over time, each climbed by itself from the stack's pose:
//!
//! ```text
//! v = Σ (t_w - t̄) c_w / Σ (t_w - t̄)²        cov v = n cov p / Σ (t_w - t̄)²
//! p(t) = p(t̄) + v (t - t̄)                   cov p(t) = cov p + (t - t̄)² cov v
//! ```
//!
//! with n windows and cov p that of the stack (a window by itself knows n times less). Attitude is held over the stack.

use super::{Mixture, Top};
use crate::line::Line;
use crate::tracking::Failure;
use nalgebra::{Isometry3, Matrix3, Translation3, Vector3};

/// Velocity and pose are found in turn so many times; the second changes the pose by less than a tenth of its deviation.
const ROUNDS: usize = 3;
/// Standard deviation added to the attitude for a turn during the stack, rad: the helix of than2015 at eight times its speed turns by
/// 0.7 rad/s, and a window at the end of five lies 0.1 s from their middle.
const TURN_RAD: f64 = 0.1;

/// The mean time of a window's lines.
pub(super) fn mean_time_s(lines: &[Line]) -> Option<f64> {
    let times = lines.iter().map(|line| line.t_s).filter(|t| t.is_finite());
    let (sum, count) = times.fold((0.0, 0_usize), |(sum, count), t| (sum + t, count + 1));
    (count > 0).then(|| sum / count as f64)
}

/// `Σ (t - t̄)²` of some instants about a given one.
fn spread_s2(times: impl Iterator<Item = f64>, about_s: f64) -> f64 {
    times.map(|t| (t - about_s).powi(2)).sum()
}

/// The slope of places over time by least squares; none without a spread of times.
fn slope(places: &[(f64, Vector3<f64>)]) -> Vector3<f64> {
    let n = places.len().max(1) as f64;
    let mean_s = places.iter().map(|(t, _)| t).sum::<f64>() / n;
    let mean_m = places.iter().map(|(_, p)| p).sum::<Vector3<f64>>() / n;
    let spread = spread_s2(places.iter().map(|(t, _)| *t), mean_s);
    if spread <= 0.0 {
        return Vector3::zeros();
    }
    places.iter().map(|(t, p)| (p - mean_m) * (t - mean_s)).sum::<Vector3<f64>>() / spread
}

fn carried(pose: &Isometry3<f64>, by_m: &Vector3<f64>) -> Isometry3<f64> {
    Translation3::from(*by_m) * pose
}

impl Mixture {
    /// The pose of this window, the last of a stack in which `found` was found, from the whole stack; its velocity.
    pub(super) fn start_of_stack(
        &mut self,
        lines: &[Line],
        found: &Isometry3<f64>,
    ) -> Result<(Top, Vector3<f64>), Failure> {
        let mut windows: Vec<Vec<Line>> = self.memory.recent.iter().map(|(lines, _)| lines.clone()).collect();
        windows.push(lines.to_vec());
        let all = windows.concat();
        let (Some(middle_s), Some(last_s)) = (mean_time_s(&all), mean_time_s(lines)) else {
            return Err(Failure::Indefinite);
        };
        let (mut pose, mut velocity) = (*found, Vector3::zeros());
        let mut of_stack = self.follow(&all, &pose, velocity, None)?;
        for _ in 0..ROUNDS {
            velocity = slope(&self.own_places(&windows, &pose, velocity, middle_s));
            of_stack = self.follow(&all, &pose, velocity, None)?;
            pose = of_stack.pose;
        }
        let times = windows.iter().filter_map(|lines| mean_time_s(lines));
        let spread = spread_s2(times, middle_s);
        let ahead_s = last_s - middle_s;
        let mut covariance = of_stack.information.try_inverse().ok_or(Failure::Indefinite)?;
        let position: Matrix3<f64> = covariance.fixed_view::<3, 3>(0, 0).into_owned();
        let share = if spread > 0.0 { windows.len() as f64 * ahead_s * ahead_s / spread } else { 0.0 };
        covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&(position * (1.0 + share)));
        for i in 3..6 {
            covariance[(i, i)] += TURN_RAD * TURN_RAD;
        }
        // What the window itself says: its lines' roles and how much of it the markers explain.
        let own = self.follow(lines, &carried(&pose, &(velocity * ahead_s)), velocity, None)?;
        let information = covariance.try_inverse().ok_or(Failure::Indefinite)?;
        let top = Top {
            pose: carried(&pose, &(velocity * ahead_s)),
            information,
            converged: of_stack.converged,
            ..own
        };
        Ok((top, velocity))
    }

    /// Where the capsule's markers are by each window alone, about a pose at an instant that moves on; what fails is left out.
    fn own_places(
        &mut self,
        windows: &[Vec<Line>],
        pose: &Isometry3<f64>,
        velocity: Vector3<f64>,
        at_s: f64,
    ) -> Vec<(f64, Vector3<f64>)> {
        let mut places = Vec::new();
        for lines in windows {
            let Some(t_s) = mean_time_s(lines) else { continue };
            let start = carried(pose, &(velocity * (t_s - at_s)));
            if let Ok(top) = self.follow(lines, &start, velocity, None)
                && top.converged
            {
                places.push((t_s, self.place_of(&top.pose)));
            }
        }
        places
    }
}
