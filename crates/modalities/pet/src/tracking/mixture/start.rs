//! A first pose from several windows together, of a capsule that moves meanwhile.
//!
//! Over the stack it moves evenly, with velocity v and angular rate ω. Both and the pose at the stack's mean instant are those of the
//! greatest likelihood of all lines, each window's at its own instant, times a normal law of the rate about 0 (a few windows hardly
//! say it):
//!
//! ```text
//! x_w = x ⊞ [v τ, ω τ]        τ = t_w - t̄
//! ℓ(x, v, ω) = Σ_w ℓ_w(x_w) - ½ |ω|² / σ_ω²
//! J_w = [I  0        τ I  0           ]
//!       [0  Exp(ωτ)ᵀ 0    τ J_r(ωτ)   ]
//! gradient Σ J_wᵀ g_w - [.. ω/σ_ω²]        information Σ J_wᵀ H_w J_w + [.. I/σ_ω²],  its inverse the covariance of all together
//!                                                  (lines by their share that counts, the rate's law in full)
//! ```
//!
//! Climbed from the slope of the windows' own places over time, each climbed by itself from the stack's pose, since a capsule that
//! runs by several deviations of a line within the stack leaves no peak at rest.

use super::{Mixture, Top};
use crate::line::Line;
use crate::tracking::window::{Preparation, Window};
use crate::tracking::{Evaluation, Failure};
use lumenav_core::MotionEstimate;
use lumenav_core::pose::{exp_so3, ominus, oplus, right_jacobian_so3};
use nalgebra::{Isometry3, Matrix3, SMatrix, SVector, Translation3, Vector3, Vector6};

/// Slope and stack are found in turn so many times; the second changes the pose by less than a tenth of its deviation.
const ROUNDS: usize = 3;
/// Steps of the climb in pose and motion.
const STEPS: usize = 15;
/// It ends where the square of a step in standard deviations is less than this: a fourteenth of one.
const SHORTEST: f64 = 5e-3;
/// Poses whose markers are nearer than this are told by one covariance about the likeliest of them where the lines cannot tell them
/// apart, m: about a side's half. Of others the start waits for more windows.
const WITHIN_REACH_M: f64 = 6e-3;
/// Longest step, m, rad, m/s, rad/s.
const LONGEST: [f64; 4] = [4e-3, 0.5, 0.04, 1.0];
/// First damping after a refused step, and the last.
const FIRST_DAMPING: f64 = 0.1;
const LAST_DAMPING: f64 = 1e6;
type Matrix12 = SMatrix<f64, 12, 12>;
type Vector12 = SVector<f64, 12>;

/// The mean time of a window's lines.
pub(super) fn mean_time_s(lines: &[Line]) -> Option<f64> {
    let times = lines.iter().map(|line| line.t_s).filter(|t| t.is_finite());
    let (sum, count) = times.fold((0.0, 0_usize), |(sum, count), t| (sum + t, count + 1));
    (count > 0).then(|| sum / count as f64)
}

/// The slope of places over time by least squares; none without a spread of times.
pub(super) fn slope(places: impl Iterator<Item = (f64, Vector3<f64>)> + Clone) -> Vector3<f64> {
    let n = places.clone().count().max(1) as f64;
    let mean_s = places.clone().map(|(t, _)| t).sum::<f64>() / n;
    let mean_m = places.clone().map(|(_, p)| p).sum::<Vector3<f64>>() / n;
    let spread: f64 = places.clone().map(|(t, _)| (t - mean_s).powi(2)).sum();
    if spread <= 0.0 {
        return Vector3::zeros();
    }
    places.map(|(t, p)| (p - mean_m) * (t - mean_s)).sum::<Vector3<f64>>() / spread
}

fn carried(pose: &Isometry3<f64>, by_m: &Vector3<f64>) -> Isometry3<f64> {
    Translation3::from(*by_m) * pose
}

/// A stack's pose at its mean instant, its motion, and what its lines say about both.
#[derive(Clone, Copy)]
struct Moving {
    /// At the stack's middle; of its information that with the motion known.
    top: Top,
    velocity: Vector3<f64>,
    rate: Vector3<f64>,
    gradient: Vector12,
    information: Matrix12,
}

impl Moving {
    fn way(&self, after_s: f64) -> Vector6<f64> {
        Vector6::from_fn(|i, _| after_s * if i < 3 { self.velocity[i] } else { self.rate[i - 3] })
    }

    /// The pose so many seconds from the stack's middle.
    fn pose_at(&self, after_s: f64) -> Isometry3<f64> {
        oplus(&self.top.pose, &self.way(after_s))
    }

    /// Its error by `[δx, δv, δω]`.
    fn by_all(&self, after_s: f64) -> SMatrix<f64, 6, 12> {
        let turn = self.rate * after_s;
        let back = exp_so3(&turn).inverse().to_rotation_matrix().into_inner();
        let mut by_all = SMatrix::<f64, 6, 12>::identity();
        by_all.fixed_view_mut::<3, 3>(3, 3).copy_from(&back);
        by_all.fixed_view_mut::<3, 3>(0, 6).copy_from(&(Matrix3::identity() * after_s));
        by_all.fixed_view_mut::<3, 3>(3, 9).copy_from(&(right_jacobian_so3(&turn) * after_s));
        by_all
    }

    /// Behind a step.
    fn stepped(&self, step: &Vector12) -> (Isometry3<f64>, Vector3<f64>, Vector3<f64>) {
        let of_pose = step.fixed_rows::<6>(0).into_owned();
        let (of_velocity, of_rate) = (step.fixed_rows::<3>(6), step.fixed_rows::<3>(9));
        (oplus(&self.top.pose, &of_pose), self.velocity + of_velocity, self.rate + of_rate)
    }

    /// A step uphill, damped until there is one, cut to what a quadratic form can be trusted for.
    fn step(&self, damping: &mut f64) -> Option<Vector12> {
        while *damping <= LAST_DAMPING {
            let mut matrix = self.information;
            for i in 0..12 {
                matrix[(i, i)] += *damping * self.information[(i, i)].abs();
            }
            if let Some(root) = matrix.cholesky() {
                let step = root.solve(&self.gradient);
                let parts = [0, 3, 6, 9].map(|from| step.fixed_rows::<3>(from).norm());
                let long = parts.iter().zip(LONGEST).map(|(n, most)| n / most).fold(1.0, f64::max);
                return Some(step / long);
            }
            *damping = (10.0 * *damping).max(FIRST_DAMPING);
        }
        None
    }
}

impl Mixture {
    /// The pose of this window, the last of a stack, from the whole stack. Every place that a search of the stack at rest finds is a place
    /// to start from: of a capsule that moves the likeliest one at rest need not be the likeliest.
    pub(super) fn start_of_stack(&mut self, all: &[Line], lines: &[Line]) -> Result<Top, Failure> {
        self.look_everywhere(all)?;
        self.look_at_likes();
        let mut windows: Vec<Vec<Line>> = self.earlier_than(lines).map(|(kept, _)| kept.clone()).collect();
        windows.push(lines.to_vec());
        let (Some(middle_s), Some(last_s)) = (mean_time_s(all), mean_time_s(lines)) else {
            return Err(Failure::Indefinite);
        };
        let mut found: Vec<Moving> = Vec::new();
        for top in self.distinct_tops() {
            if let Ok(moving) = self.moving_from(all, &windows, &top, middle_s) {
                found.push(moving);
            }
        }
        found.sort_by(|a, b| b.top.gain.total_cmp(&a.top.gain));
        // Climbs that ended in one place are one place.
        let mut places: Vec<Moving> = Vec::new();
        for moving in found {
            let is_new =
                |other: &Moving| self.body.distance_m(&other.top.pose, &moving.top.pose) > super::SAME_POSE_M;
            if places.iter().all(is_new) {
                places.push(moving);
            }
        }
        let found = places;
        self.tops.clear();
        self.tops.extend(found.iter().map(|moving| moving.top));
        let best = self.supported(all.len())?;
        let rivals: Vec<Moving> =
            found[1..].iter().filter(|moving| self.is_rival(&best, &moving.top)).copied().collect();
        let is_far = |rival: &&Moving| self.body.distance_m(&best.pose, &rival.top.pose) > WITHIN_REACH_M;
        if let Some(far) = rivals.iter().find(is_far) {
            return Err(Self::ambiguous(&best, &far.top));
        }
        self.end_of_stack(&found[0], &rivals, lines, last_s - middle_s)
    }

    /// The tops of a search that are places of their own, best first.
    fn distinct_tops(&self) -> Vec<Isometry3<f64>> {
        let mut distinct: Vec<Isometry3<f64>> = Vec::new();
        for top in &self.tops {
            if distinct.iter().all(|other| self.body.distance_m(other, &top.pose) > super::SAME_POSE_M) {
                distinct.push(top.pose);
            }
        }
        distinct
    }

    /// Pose and velocity of a stack from a place that was found in it at rest.
    fn moving_from(
        &mut self,
        all: &[Line],
        windows: &[Vec<Line>],
        found: &Isometry3<f64>,
        middle_s: f64,
    ) -> Result<Moving, Failure> {
        let (mut pose, mut velocity) = (*found, Vector3::zeros());
        for _ in 0..ROUNDS {
            pose = self.follow(all, &pose, velocity, None)?.pose;
            velocity = slope(self.own_places(windows, &pose, velocity, middle_s).into_iter());
        }
        // The weights stay those of the stack as a whole.
        let of_stack = self.follow(all, &pose, velocity, None)?;
        let moving = self.climb_moving(windows, (of_stack.pose, velocity, Vector3::zeros()), middle_s)?;
        // Prepared anew about where that led.
        self.climb_moving(windows, (moving.top.pose, moving.velocity, moving.rate), middle_s)
    }

    /// What the stack says about its last window.
    fn end_of_stack(
        &mut self,
        moving: &Moving,
        rivals: &[Moving],
        lines: &[Line],
        ahead_s: f64,
    ) -> Result<Top, Failure> {
        // Of the pose behind the way that is left, and the motion.
        let mut carry = Matrix12::identity();
        carry.fixed_view_mut::<6, 12>(0, 0).copy_from(&moving.by_all(ahead_s));
        let inverse = moving.information.cholesky().ok_or(Failure::Indefinite)?.inverse();
        let covariance = carry * (inverse + self.spread_of_rivals(moving, rivals)) * carry.transpose();
        let of_pose = covariance.fixed_view::<6, 6>(0, 0).into_owned();
        let information = of_pose.try_inverse().ok_or(Failure::Indefinite)?;
        // What the window itself says: its lines' roles and how much of it the markers explain.
        let pose = moving.pose_at(ahead_s);
        let own = self.follow(lines, &pose, moving.velocity, None)?;
        self.motion = Some(MotionEstimate {
            velocity_world_m_s: moving.velocity,
            angular_rate_capsule_rad_s: moving.rate,
            covariance: covariance / self.noise.information_share,
        });
        Ok(Top { pose, information, converged: moving.top.converged, ..own })
    }

    /// What poses that explain the stack nearly as well add to the covariance about the best: `Σ w d dᵀ`, d their way from it and w their share
    /// of the likelihood.
    fn spread_of_rivals(&self, best: &Moving, rivals: &[Moving]) -> Matrix12 {
        // Lines count by their share: it is in the odds, and is taken back from what the covariance is divided by in the end.
        let share = self.noise.information_share;
        let odds = |rival: &Moving| (share * (rival.top.gain - best.top.gain)).exp();
        let all = 1.0 + rivals.iter().map(odds).sum::<f64>();
        let mut spread = Matrix12::zeros();
        for rival in rivals {
            let twin = self.body.nearest_twin(&rival.top.pose, &best.top.pose);
            let mut way = Vector12::zeros();
            way.fixed_rows_mut::<6>(0).copy_from(&ominus(&twin, &best.top.pose));
            way.fixed_rows_mut::<3>(6).copy_from(&(rival.velocity - best.velocity));
            let rate = twin.rotation.inverse() * (rival.top.pose.rotation * rival.rate);
            way.fixed_rows_mut::<3>(9).copy_from(&(rate - best.rate));
            spread += way * way.transpose() * (share * odds(rival) / all);
        }
        spread
    }

    /// Climbs in pose and motion together, from a start about which the windows are prepared.
    fn climb_moving(
        &mut self,
        windows: &[Vec<Line>],
        (pose, velocity, rate): (Isometry3<f64>, Vector3<f64>, Vector3<f64>),
        middle_s: f64,
    ) -> Result<Moving, Failure> {
        let mut prepared = Vec::with_capacity(windows.len());
        for lines in windows {
            let Some(at_s) = mean_time_s(lines) else { continue };
            let about = self.place_of(&pose) + velocity * (at_s - middle_s);
            let how = Preparation {
                velocity_world_m_s: velocity,
                at_s,
                budget: self.budget(),
                ..self.about(about)
            };
            let mut window = Window::default();
            // A window with hardly a line is left out.
            if window.prepare(lines, &self.noise, &how, 1).is_ok() {
                prepared.push((at_s - middle_s, window));
            }
        }
        let mut here = self.look_moving(&prepared, (pose, velocity, rate));
        let mut damping = 0.0;
        for _ in 0..STEPS {
            let step = here.step(&mut damping).ok_or(Failure::Indefinite)?;
            if damping == 0.0 && step.dot(&here.gradient) < SHORTEST {
                here.top.converged = true;
                break;
            }
            let there = self.look_moving(&prepared, here.stepped(&step));
            if there.top.objective >= here.top.objective {
                here = there;
                damping = if damping > 2e-3 { 0.1 * damping } else { 0.0 };
            } else {
                damping = (10.0 * damping).max(FIRST_DAMPING);
                if damping > LAST_DAMPING {
                    break;
                }
            }
        }
        Ok(here)
    }

    /// Value, gradient and information of pose and motion over windows at instants from the stack's middle.
    fn look_moving(
        &self,
        windows: &[(f64, Window)],
        (pose, velocity, rate): (Isometry3<f64>, Vector3<f64>, Vector3<f64>),
    ) -> Moving {
        let mut evaluation = Evaluation::default();
        let (gradient, information) = (Vector12::zeros(), Matrix12::zeros());
        let mut all = Moving { top: Top::nothing_at(&pose), velocity, rate, gradient, information };
        for (after_s, window) in windows {
            let there = all.pose_at(*after_s);
            self.likelihood.evaluate(window, &there, &self.climber.weights, &mut evaluation);
            all.top.add(&evaluation, window);
            let by_all = all.by_all(*after_s);
            all.gradient += by_all.transpose() * evaluation.gradient;
            all.information += by_all.transpose() * evaluation.information * by_all;
        }
        // As a prior in `locate`: scaled back with the lines' information in the end.
        let known = self.options.start_rate_sigma_rad_s.powi(-2) / self.noise.information_share;
        all.top.objective -= 0.5 * known * rate.norm_squared();
        for i in 0..3 {
            all.gradient[9 + i] -= known * rate[i];
            all.information[(9 + i, 9 + i)] += known;
        }
        all
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
