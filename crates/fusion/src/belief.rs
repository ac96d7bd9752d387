//! What the filter believes: a nominal state, the covariance of its error, and the time.
//!
//! Error columns, in this order: `[δp_world, δθ_capsule, δv_world, δω, blocks…, clones…]`; blocks in the order in
//! which they were asked for, clones (6 columns each, `[δp_world, δθ_capsule]` of an earlier pose) by time.
//!
//! **The rate's error is kept in the world frame** (`δω_world`), although the nominal rate and the seam speak of the capsule's:
//! `δω_capsule = Rᵀ δω_world + [ω]ₓ δθ`, applied where a model's Jacobian comes in. Reason: most sources say nothing about the
//! roll around their axis. With the rate in the capsule's frame the roll error turns into other directions along the way, each
//! update is linearised at another estimate, and the filter soon believes to know a roll that nobody measured (the classical
//! inconsistency of unobservable directions: Huang, Mourikis and Roumeliotis 2010). With the rate in the world frame a roll
//! error stays one. Both describe the same process, as `d(Rω)/dt = R dω/dt`.
//!
//! **A correction turns the pointing first and then rolls**: `R' = R Exp([0, δθ_y, δθ_z]) Exp([δθ_x, 0, 0])`, which equals
//! `R Exp(δθ)` to first order. An unknown roll has a standard deviation of 1.8 rad; in one exponential it would turn the
//! pointing correction with it, here it stays a roll however large it is. The covariance follows with
//! `G = [e_x, Exp(-δθ_x x) J_r([0, δθ_y, δθ_z]) [e_y e_z]]`.
//!
//! Prediction over Δt, with g the gain and φ the decay of [`AxisStep`]:
//!
//! ```text
//! p' = p + g v      δp' = δp + g δv           R' = R Exp(g ω)   δθ' = δθ + g J_r(g ω) Rᵀ δω_world
//! v' = φ v          δv' = φ δv                ω' = φ ω          δω' = φ δω
//! ```
//!
//! The transition differs from the identity in 12 columns only, so it is applied to rows and columns of the covariance in
//! place; its cost grows linearly with the number of blocks and clones.

use crate::dense::{carry, turn};
use lumenav_core::pose::{exp_so3, renormalize, right_jacobian_so3, skew};
use lumenav_core::{
    AxisStep, BlockSpec, FixKind, Instant, MotionEstimate, MotionModel, MotionSample, Name, NominalState,
    Part, PoseEstimate, SimTime,
};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, Matrix3xX, Matrix6, MatrixXx3, Vector3};
use std::collections::BTreeMap;
use std::sync::Arc;

/// First column of the pose, velocity and rate parts, and the number of columns of a state without blocks.
pub const POSE: usize = 0;
/// See [`POSE`].
pub const VELOCITY: usize = 6;
/// See [`POSE`].
pub const RATE: usize = 9;
/// See [`POSE`].
pub const CORE: usize = 12;

/// An attitude direction with a larger standard deviation than this (rad) is reported as unknown.
const KNOWN_ATTITUDE_SIGMA_RAD: f64 = 0.5;

/// A Gaussian belief on SO(3) x R³ x R³ x R³ x blocks x clones.
#[derive(Clone, Debug)]
pub struct Belief {
    /// The instant.
    pub at: SimTime,
    /// Nominal state.
    pub state: NominalState,
    /// Covariance of the error.
    pub covariance: DMatrix<f64>,
    /// Blocks in the order of their columns, with their random walks.
    /// Shared with the copies that the event log keeps.
    blocks: Arc<Vec<BlockSpec>>,
}

impl Belief {
    /// A start from a pose; what the fix does not know starts as uniform as a Gaussian can be.
    pub fn start(at: SimTime, fix: &PoseEstimate, velocity_sigma_m_s: f64, rate_sigma_rad_s: f64) -> Self {
        // Standard deviation of an angle that is uniform on the circle.
        let unknown_rad2 = std::f64::consts::PI.powi(2) / 3.0;
        let mut covariance = DMatrix::zeros(CORE, CORE);
        covariance.fixed_view_mut::<6, 6>(0, 0).copy_from(&fix.covariance);
        match fix.kind {
            FixKind::Full => {}
            FixKind::Pointing => covariance[(3, 3)] += unknown_rad2,
            FixKind::Position => (3..6).for_each(|i| covariance[(i, i)] += unknown_rad2),
        }
        for i in 0..3 {
            covariance[(VELOCITY + i, VELOCITY + i)] = velocity_sigma_m_s.powi(2);
            covariance[(RATE + i, RATE + i)] = rate_sigma_rad_s.powi(2);
        }
        Self { at, state: NominalState::at_rest(fix.world_from_capsule), covariance, blocks: Arc::default() }
    }

    /// A belief without blocks takes the motion that was measured beside the fix for its own. The velocity is joined with the one believed at the start, v ~ N(0,
    /// σ² I): the belief is a measurement of the measured state, `0 = v + n`:
    ///
    /// ```text
    /// K = P[·, v] (P[v, v] + σ² I)⁻¹      δ = -K v      P' = P - K P[v, ·]
    /// ```
    #[must_use]
    pub fn moving(mut self, measured: &MotionEstimate, velocity_sigma_m_s: f64) -> Self {
        self.covariance.fixed_view_mut::<CORE, CORE>(0, 0).copy_from(&measured.covariance);
        self.state.velocity_world_m_s = measured.velocity_world_m_s;
        self.state.angular_rate_capsule_rad_s = measured.angular_rate_capsule_rad_s;
        self.rate_to_world();
        let of_velocity = self.covariance.fixed_view::<3, 3>(VELOCITY, VELOCITY).into_owned();
        let spread = of_velocity + Matrix3::identity() * velocity_sigma_m_s.powi(2);
        let Some(inverse) = spread.try_inverse() else { return self };
        let columns = self.covariance.columns(VELOCITY, 3).into_owned();
        let gain = &columns * inverse;
        self.covariance -= &gain * columns.transpose();
        let error = -(&gain * measured.velocity_world_m_s);
        self.inject(&error);
        self
    }

    /// From rows and columns of the rate that hold δω_capsule to δω_world = R (δω_capsule - [ω]ₓ δθ).
    fn rate_to_world(&mut self) {
        let world_from_capsule = self.capsule_from_world().transpose();
        let of_angle = -(world_from_capsule * skew(&self.state.angular_rate_capsule_rad_s));
        self.mix_rate(&Matrix3::identity(), &Matrix3::zeros(), &of_angle, &world_from_capsule);
    }

    /// Number of error columns.
    pub fn dimension(&self) -> usize {
        self.covariance.nrows()
    }

    /// First column and width of a part; `None` where the state does not hold it.
    pub fn columns(&self, part: &Part) -> Option<(usize, usize)> {
        match part {
            Part::Pose(Instant::Now) => Some((POSE, 6)),
            Part::Velocity => Some((VELOCITY, 3)),
            Part::AngularRate => Some((RATE, 3)),
            Part::Block(name) => {
                let mut start = CORE;
                for block in self.blocks.iter() {
                    if block.name == *name {
                        return Some((start, block.initial.len()));
                    }
                    start += block.initial.len();
                }
                None
            }
            Part::Pose(Instant::Clone(at)) => {
                let index = self.state.clones.keys().position(|time| time == at)?;
                Some((self.first_clone_column() + 6 * index, 6))
            }
        }
    }

    /// `δω_capsule` by the filter's own columns: `[ω]ₓ` for δθ, `Rᵀ` for δω_world.
    pub fn rate_by_columns(state: &NominalState) -> (Matrix3<f64>, Matrix3<f64>) {
        let capsule_from_world =
            state.world_from_capsule.rotation.to_rotation_matrix().into_inner().transpose();
        (skew(&state.angular_rate_capsule_rad_s), capsule_from_world)
    }

    fn first_clone_column(&self) -> usize {
        CORE + self.blocks.iter().map(|block| block.initial.len()).sum::<usize>()
    }

    /// Adds a nuisance block, once; independent of the rest.
    pub fn add_block(&mut self, spec: &BlockSpec) {
        if self.blocks.iter().any(|block| block.name == spec.name) {
            return;
        }
        let at = self.first_clone_column();
        let width = spec.initial.len();
        self.insert_columns(at, width);
        for i in 0..width {
            self.covariance[(at + i, at + i)] = spec.initial_sigma[i].powi(2);
        }
        self.state.blocks.insert(spec.name.clone(), spec.initial.clone());
        Arc::make_mut(&mut self.blocks).push(spec.clone());
    }

    /// Keeps a copy of the pose of this instant, fully correlated with the pose now (stochastic cloning: Roumeliotis and
    /// Burdick 2002).
    pub fn clone_pose(&mut self) {
        if self.state.clones.contains_key(&self.at) {
            return;
        }
        self.state.clones.insert(self.at, self.state.world_from_capsule);
        // Just inserted, so it is there; clones are ordered by time and this one is the newest unless a replay went back.
        let Some((at, _)) = self.columns(&Part::Pose(Instant::Clone(self.at))) else { return };
        self.insert_columns(at, 6);
        for i in 0..6 {
            let column = self.covariance.column(POSE + i).into_owned();
            self.covariance.set_column(at + i, &column);
        }
        for i in 0..6 {
            let row = self.covariance.row(POSE + i).into_owned();
            self.covariance.set_row(at + i, &row);
        }
    }

    /// Drops the clones that nobody wants any more.
    pub fn retain_clones(&mut self, wanted: &dyn Fn(SimTime) -> bool) {
        let unwanted: Vec<SimTime> = self.state.clones.keys().copied().filter(|at| !wanted(*at)).collect();
        for at in unwanted {
            if let Some((start, width)) = self.columns(&Part::Pose(Instant::Clone(at))) {
                let covariance = std::mem::replace(&mut self.covariance, DMatrix::zeros(0, 0));
                self.covariance = covariance.remove_columns(start, width).remove_rows(start, width);
            }
            self.state.clones.remove(&at);
        }
    }

    fn insert_columns(&mut self, at: usize, width: usize) {
        let covariance = std::mem::replace(&mut self.covariance, DMatrix::zeros(0, 0));
        self.covariance = covariance.insert_columns(at, width, 0.0).insert_rows(at, width, 0.0);
    }

    /// Moves on to `to` (not before the belief's own time).
    pub fn predict(&mut self, to: SimTime, motion: &MotionModel) {
        let dt_s = to.since_s(self.at);
        if dt_s <= 0.0 {
            return;
        }
        let step = motion.rotation(dt_s);
        let turn = self.state.angular_rate_capsule_rad_s * step.gain_s;
        let capsule_from_world = self.capsule_from_world();
        let of_rate = right_jacobian_so3(&turn) * capsule_from_world * step.gain_s;
        self.turn(&turn);
        carry(&mut self.covariance, POSE + 3, RATE, &of_rate, step.decay);
        self.add_rotation_noise(&step);
        self.state.angular_rate_capsule_rad_s *= step.decay;
        self.translate(dt_s, motion);
        self.walk_blocks(dt_s);
        self.at = to;
    }

    /// Moves on to `to` with the angular rate that an inertial sensor measured; `δω` then is the sensor's own noise.
    pub fn predict_with_rate(&mut self, to: SimTime, motion: &MotionModel, sample: &MotionSample) {
        let dt_s = to.since_s(self.at);
        if dt_s <= 0.0 {
            return;
        }
        let turn = sample.angular_rate_capsule_rad_s * dt_s;
        let jacobian = right_jacobian_so3(&turn) * dt_s;
        let back = exp_so3(&turn).inverse().to_rotation_matrix().into_inner();
        // The old rate says nothing once it is measured: its rows are forgotten.
        self.mix_rate(&back, &Matrix3::zeros(), &Matrix3::zeros(), &Matrix3::zeros());
        self.turn(&turn);
        self.add_bias(sample, &jacobian);
        let cross = jacobian * sample.covariance;
        add_block(&mut self.covariance, 3, 3, &(cross * jacobian.transpose()));
        add_block(&mut self.covariance, RATE, RATE, &sample.covariance);
        add_block(&mut self.covariance, 3, RATE, &cross);
        add_block(&mut self.covariance, RATE, 3, &cross.transpose());
        self.state.angular_rate_capsule_rad_s = sample.angular_rate_capsule_rad_s;
        self.rate_to_world();
        self.translate(dt_s, motion);
        self.walk_blocks(dt_s);
        self.at = to;
    }

    /// `δθ += J (∂ω/∂b) δb` and `δω_capsule += (∂ω/∂b) δb` for the bias block of an inertial sensor.
    fn add_bias(&mut self, sample: &MotionSample, jacobian: &Matrix3<f64>) {
        let found = sample.bias.as_ref().and_then(|(name, matrix)| {
            self.columns(&Part::Block(name.clone())).map(|columns| (columns, matrix))
        });
        let Some(((start, width), matrix)) = found else { return };
        let of_rate: Matrix3xX<f64> = matrix.fixed_rows::<3>(0).into_owned();
        let of_angle: Matrix3xX<f64> = jacobian * &of_rate;
        let rows = self.covariance.rows(start, width).into_owned();
        self.add_rows(3, &(&of_angle * &rows));
        self.add_rows(RATE, &(&of_rate * &rows));
        let columns = self.covariance.columns(start, width).into_owned();
        self.add_columns(3, &(&columns * of_angle.transpose()));
        self.add_columns(RATE, &(&columns * of_rate.transpose()));
    }

    /// `world_from_capsule` turned round: the matrix that takes world vectors into the capsule's frame.
    fn capsule_from_world(&self) -> Matrix3<f64> {
        self.state.world_from_capsule.rotation.to_rotation_matrix().into_inner().transpose()
    }

    /// Rotates the nominal attitude by `turn`, rad in the capsule's frame.
    fn turn(&mut self, turn: &Vector3<f64>) {
        let pose = &mut self.state.world_from_capsule;
        pose.rotation = renormalize(pose.rotation * exp_so3(turn));
    }

    /// `δθ' = A δθ + B δω`, `δω' = C δθ + D δω`, on rows and then columns of the covariance.
    fn mix_rate(&mut self, a: &Matrix3<f64>, b: &Matrix3<f64>, c: &Matrix3<f64>, d: &Matrix3<f64>) {
        let p = &mut self.covariance;
        for j in 0..p.ncols() {
            let theta = Vector3::new(p[(3, j)], p[(4, j)], p[(5, j)]);
            let rate = Vector3::new(p[(RATE, j)], p[(RATE + 1, j)], p[(RATE + 2, j)]);
            let (theta, rate) = (a * theta + b * rate, c * theta + d * rate);
            for i in 0..3 {
                p[(3 + i, j)] = theta[i];
                p[(RATE + i, j)] = rate[i];
            }
        }
        for j in 0..p.nrows() {
            let theta = Vector3::new(p[(j, 3)], p[(j, 4)], p[(j, 5)]);
            let rate = Vector3::new(p[(j, RATE)], p[(j, RATE + 1)], p[(j, RATE + 2)]);
            let (theta, rate) = (a * theta + b * rate, c * theta + d * rate);
            for i in 0..3 {
                p[(j, 3 + i)] = theta[i];
                p[(j, RATE + i)] = rate[i];
            }
        }
    }

    /// Isotropic noise of the rotation (capsule's frame) and of the rate (world frame), and between them.
    fn add_rotation_noise(&mut self, step: &AxisStep) {
        let capsule_from_world = self.capsule_from_world();
        for i in 0..3 {
            self.covariance[(3 + i, 3 + i)] += step.noise_pp;
            self.covariance[(RATE + i, RATE + i)] += step.noise_vv;
        }
        let cross = capsule_from_world * step.noise_pv;
        add_block(&mut self.covariance, 3, RATE, &cross);
        add_block(&mut self.covariance, RATE, 3, &cross.transpose());
    }

    fn translate(&mut self, dt_s: f64, motion: &MotionModel) {
        let step = motion.translation(dt_s);
        let velocity = self.state.velocity_world_m_s;
        self.state.world_from_capsule.translation.vector += velocity * step.gain_s;
        self.state.velocity_world_m_s = velocity * step.decay;
        carry(&mut self.covariance, POSE, VELOCITY, &(Matrix3::identity() * step.gain_s), step.decay);
        for i in 0..3 {
            self.covariance[(i, i)] += step.noise_pp;
            self.covariance[(i, VELOCITY + i)] += step.noise_pv;
            self.covariance[(VELOCITY + i, i)] += step.noise_pv;
            self.covariance[(VELOCITY + i, VELOCITY + i)] += step.noise_vv;
        }
    }

    fn walk_blocks(&mut self, dt_s: f64) {
        let mut column = CORE;
        for block in self.blocks.iter() {
            for walk in block.random_walk.iter() {
                self.covariance[(column, column)] += walk * walk * dt_s;
                column += 1;
            }
        }
    }

    fn add_rows(&mut self, at: usize, rows: &Matrix3xX<f64>) {
        let mut view = self.covariance.fixed_rows_mut::<3>(at);
        view += rows;
    }

    fn add_columns(&mut self, at: usize, columns: &MatrixXx3<f64>) {
        let mut view = self.covariance.fixed_columns_mut::<3>(at);
        view += columns;
    }

    /// The nominal state moved by an error (as many entries as this belief has columns).
    pub fn moved_state(&self, error: &DVector<f64>) -> NominalState {
        let mut state = self.state.clone();
        self.correct(&mut state, error);
        state
    }

    fn correct(&self, state: &mut NominalState, error: &DVector<f64>) {
        let before = state.world_from_capsule.rotation;
        correct_pose(&mut state.world_from_capsule, error, POSE);
        state.velocity_world_m_s += error.fixed_rows::<3>(VELOCITY);
        let rate_world = before * state.angular_rate_capsule_rad_s + error.fixed_rows::<3>(RATE);
        state.angular_rate_capsule_rad_s = state.world_from_capsule.rotation.inverse() * rate_world;
        let mut column = CORE;
        for block in self.blocks.iter() {
            let width = block.initial.len();
            if let Some(values) = state.blocks.get_mut(&block.name) {
                *values += error.rows(column, width);
            }
            column += width;
        }
        for pose in state.clones.values_mut() {
            correct_pose(pose, error, column);
            column += 6;
        }
    }

    /// Moves the nominal state by an error and carries the covariance into the tangent space behind the correction.
    pub fn inject(&mut self, error: &DVector<f64>) {
        let mut state = std::mem::replace(&mut self.state, NominalState::at_rest(Isometry3::identity()));
        self.correct(&mut state, error);
        self.state = state;
        self.reset_rotation(POSE + 3, error);
        let first = self.first_clone_column();
        for index in 0..self.state.clones.len() {
            self.reset_rotation(first + 6 * index + 3, error);
        }
    }

    /// Carries the rotation columns at `at` into the tangent space behind a correction.
    fn reset_rotation(&mut self, at: usize, error: &DVector<f64>) {
        if (at..at + 3).all(|i| error[i] == 0.0) {
            return;
        }
        turn(&mut self.covariance, at, &correction_jacobian(error, at));
    }

    /// Pose and covariance, with what is not known left out.
    pub fn pose(&self) -> PoseEstimate {
        let covariance: Matrix6<f64> = self.covariance.fixed_view::<6, 6>(0, 0).into_owned();
        let sigma = |i: usize| covariance[(i, i)].max(0.0).sqrt();
        let known = if sigma(4).max(sigma(5)) > KNOWN_ATTITUDE_SIGMA_RAD {
            FixKind::Position
        } else if sigma(3) > KNOWN_ATTITUDE_SIGMA_RAD {
            FixKind::Pointing
        } else {
            FixKind::Full
        };
        let world_from_capsule = self.state.world_from_capsule;
        PoseEstimate { world_from_capsule, covariance, kind: FixKind::Full }.limited_to(known)
    }

    /// Largest standard deviation of the position along any direction, m, and that direction.
    pub fn weakest_direction(&self) -> (f64, Vector3<f64>) {
        let block: Matrix3<f64> = self.covariance.fixed_view::<3, 3>(0, 0).into_owned();
        let eigen = block.symmetric_eigen();
        let largest = eigen.eigenvalues.imax();
        (eigen.eigenvalues[largest].max(0.0).sqrt(), eigen.eigenvectors.column(largest).into_owned())
    }

    /// The blocks' values and covariance, without the rest.
    pub fn kept_blocks(&self) -> KeptBlocks {
        let width = self.first_clone_column() - CORE;
        KeptBlocks {
            at: self.at,
            values: self.state.blocks.clone(),
            covariance: self.covariance.view((CORE, CORE), (width, width)).into_owned(),
        }
    }

    /// Takes over the blocks of an earlier belief with the same blocks, independent of the rest, walked on until now.
    pub fn restore_blocks(&mut self, kept: &KeptBlocks) {
        let width = self.first_clone_column() - CORE;
        if kept.covariance.nrows() != width || !kept.values.keys().eq(self.state.blocks.keys()) {
            return;
        }
        self.state.blocks.clone_from(&kept.values);
        self.covariance.view_mut((CORE, CORE), (width, width)).copy_from(&kept.covariance);
        self.walk_blocks(self.at.since_s(kept.at).max(0.0));
    }
}

/// Nuisance blocks that outlive the belief they belonged to.
#[derive(Clone, Debug)]
pub struct KeptBlocks {
    at: SimTime,
    values: BTreeMap<Name, DVector<f64>>,
    /// In the order of the blocks' columns.
    covariance: DMatrix<f64>,
}

/// Moves a pose by the six entries of `error` from `at` on: position, then pointing, then roll.
fn correct_pose(pose: &mut Isometry3<f64>, error: &DVector<f64>, at: usize) {
    pose.translation.vector += Vector3::new(error[at], error[at + 1], error[at + 2]);
    let pointing = exp_so3(&Vector3::new(0.0, error[at + 4], error[at + 5]));
    let roll = exp_so3(&Vector3::new(error[at + 3], 0.0, 0.0));
    pose.rotation = renormalize(pose.rotation * pointing * roll);
}

/// G: a small error behind a correction by the rotation at `error[at..at + 3]`, per change of the correction itself.
pub(crate) fn correction_jacobian(error: &DVector<f64>, at: usize) -> Matrix3<f64> {
    let pointing = Vector3::new(0.0, error[at + 1], error[at + 2]);
    let unroll = exp_so3(&Vector3::new(-error[at], 0.0, 0.0)).to_rotation_matrix().into_inner();
    let mut jacobian = unroll * right_jacobian_so3(&pointing);
    jacobian.set_column(0, &Vector3::x());
    jacobian
}

fn add_block(matrix: &mut DMatrix<f64>, row: usize, column: usize, block: &Matrix3<f64>) {
    let mut view = matrix.fixed_view_mut::<3, 3>(row, column);
    view += block;
}
