//! The posterior bound along a path: what a filter that knows how the capsule moves can reach at best, reading after reading.
//!
//! Recursion of Tichavsky, Muravchik and Nehorai (1998) for a linear motion model with Gaussian noise, at the states of one path. With the
//! error `x = [δp_world, δθ_capsule, δv_world, δω_world]`, F and Q of the motion model ([`MotionModel`]) and I_k the information of reading k
//! about `[δp_world, δθ_capsule]`:
//!
//! ```text
//! P' = F P Fᵀ + Q           P = (P'⁻¹ + Hᵀ I_k H)⁻¹
//! F: δp' = δp + g δv        δθ' = Exp(-θ) δθ + g J_r(θ) Rᵀ δω        δv' = φ δv        δω' = φ δω
//! ```
//!
//! with R the attitude and θ the turn from one reading to the next. Only for readings whose errors are independent
//! ([`LayoutModel::is_memoryless`]): a strength, a field or a gain that stays unknown would have to be carried from reading to reading. An axis tells two of three angles: `t_i = e_iᵀ R [−x]ₓ δθ` with the tangents e_i of R x.

use crate::information::Inverse;
use lumenav_core::layout::packed_len;
use lumenav_core::pose::{exp_so3, log_so3, right_jacobian_so3, skew, tangent_basis};
use lumenav_core::{LayoutElement, LayoutModel, LayoutParameters, MotionModel};
use nalgebra::{DMatrix, Isometry3, Matrix6, SMatrix, Vector3};
use serde::Serialize;

type Matrix12 = SMatrix<f64, 12, 12>;

/// What is known before the first reading: position (m), attitude (that of a uniform angle), velocity (m/s) and rate (rad/s), per axis. The
/// last two are a filter's own defaults; the first two are vague.
const BEFORE: [f64; 4] = [1.0, 1.813_799, 0.02, 1.0];

/// The bound at one reading.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct AtReading {
    /// Time, s.
    pub t_s: f64,
    /// √(tr P) of the position, mm.
    pub position_mm: f64,
    /// The same of this reading by itself; absent: infinite.
    pub one_reading_mm: Option<f64>,
}

/// The bound along a path, and what it comes down to.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Posterior {
    /// Readings.
    pub readings: usize,
    /// √(mean tr P), mm; this and the next three from the second reading on: the first has nothing behind it.
    pub rms_mm: f64,
    /// Median of √(tr P), mm.
    pub median_mm: f64,
    /// Its 95th percentile.
    pub p95_mm: f64,
    /// Its largest.
    pub worst_mm: f64,
    /// At every reading.
    #[serde(skip)]
    pub course: Vec<AtReading>,
}

/// The posterior bound of elements at the readings of a path (time in s, pose); `None` where the path has less than two, or readings whose
/// errors are not independent.
pub fn posterior(
    model: &dyn LayoutModel,
    elements: &[LayoutElement],
    readings: &[(f64, Isometry3<f64>)],
    motion: &MotionModel,
) -> Option<Posterior> {
    if !model.is_memoryless() {
        return None;
    }
    let parameters = model.parameters();
    let mut worker = model.worker();
    let mut packed = vec![0.0; packed_len(parameters.len())];
    let mut covariance = before();
    let mut last: Option<(f64, Isometry3<f64>)> = None;
    let mut course = Vec::with_capacity(readings.len());
    for (t_s, pose) in readings {
        if let Some((then_s, then)) = last {
            covariance = predicted(&covariance, t_s - then_s, &then, pose, motion);
        }
        worker.together(elements, pose, &mut packed);
        covariance = updated(&covariance, &of_pose(&packed, parameters, pose))?;
        let trace: f64 = (0..3).map(|i| covariance[(i, i)]).sum();
        let alone = Inverse::of(&packed, parameters);
        course.push(AtReading {
            t_s: *t_s,
            position_mm: 1e3 * trace.max(0.0).sqrt(),
            one_reading_mm: alone.map(|inverse| 1e3 * inverse.position_trace_m2().max(0.0).sqrt()),
        });
        last = Some((*t_s, *pose));
    }
    summary(course)
}

fn summary(course: Vec<AtReading>) -> Option<Posterior> {
    let mut sorted: Vec<f64> = course.iter().skip(1).map(|at| at.position_mm).collect();
    sorted.sort_by(f64::total_cmp);
    let count = sorted.len();
    let rank = |share: f64| (share * count as f64).ceil().max(1.0) as usize - 1;
    Some(Posterior {
        readings: course.len(),
        rms_mm: (sorted.iter().map(|v| v * v).sum::<f64>() / count as f64).sqrt(),
        median_mm: *sorted.get(rank(0.5))?,
        p95_mm: *sorted.get(rank(0.95))?,
        worst_mm: *sorted.last()?,
        course,
    })
}

fn before() -> Matrix12 {
    Matrix12::from_fn(|i, j| if i == j { BEFORE[i / 3].powi(2) } else { 0.0 })
}

fn predicted(
    covariance: &Matrix12,
    dt_s: f64,
    then: &Isometry3<f64>,
    now: &Isometry3<f64>,
    motion: &MotionModel,
) -> Matrix12 {
    let (way, turn) = (motion.translation(dt_s), motion.rotation(dt_s));
    let theta = log_so3(&(then.rotation.inverse() * now.rotation));
    let capsule_from_world = then.rotation.to_rotation_matrix().into_inner().transpose();
    let mut transition = Matrix12::identity();
    transition.fixed_view_mut::<3, 3>(0, 6).fill_diagonal(way.gain_s);
    transition.fixed_view_mut::<3, 3>(6, 6).fill_diagonal(way.decay);
    transition.fixed_view_mut::<3, 3>(3, 3).copy_from(exp_so3(&-theta).to_rotation_matrix().matrix());
    let by_rate = right_jacobian_so3(&theta) * capsule_from_world * turn.gain_s;
    transition.fixed_view_mut::<3, 3>(3, 9).copy_from(&by_rate);
    transition.fixed_view_mut::<3, 3>(9, 9).fill_diagonal(turn.decay);
    let mut next = transition * covariance * transition.transpose();
    // Isotropic in the world; what of it turns the capsule is seen in its frame as it is now.
    let to_capsule = now.rotation.to_rotation_matrix().into_inner().transpose() * turn.noise_pv;
    for i in 0..3 {
        next[(i, i)] += way.noise_pp;
        next[(i, 6 + i)] += way.noise_pv;
        next[(6 + i, i)] += way.noise_pv;
        next[(6 + i, 6 + i)] += way.noise_vv;
        next[(3 + i, 3 + i)] += turn.noise_pp;
        next[(9 + i, 9 + i)] += turn.noise_vv;
        for j in 0..3 {
            next[(3 + i, 9 + j)] += to_capsule[(i, j)];
            next[(9 + j, 3 + i)] += to_capsule[(i, j)];
        }
    }
    next
}

/// `(P⁻¹ + Hᵀ I H)⁻¹ = P - P Hᵀ S (1 + Sᵀ H P Hᵀ S)⁻¹ Sᵀ H P` with `I = S Sᵀ`, whose pivots are at least 1.
fn updated(covariance: &Matrix12, information: &Matrix6<f64>) -> Option<Matrix12> {
    let eigen = information.symmetric_eigen();
    let root = eigen.eigenvectors * Matrix6::from_diagonal(&eigen.eigenvalues.map(|v| v.max(0.0).sqrt()));
    let seen = covariance.fixed_columns::<6>(0) * root;
    let spread = Matrix6::identity() + root.transpose() * covariance.fixed_view::<6, 6>(0, 0) * root;
    let mut left = seen.transpose();
    spread.cholesky()?.l().solve_lower_triangular_mut(&mut left);
    let next = covariance - left.transpose() * left;
    Some((next + next.transpose()) * 0.5)
}

/// The information about `[δp_world, δθ_capsule]`.
fn of_pose(packed: &[f64], parameters: &LayoutParameters, pose: &Isometry3<f64>) -> Matrix6<f64> {
    let kept = 3 + parameters.angles;
    let information = DMatrix::from_fn(kept, kept, |i, j| packed[packed_len(i.max(j)) + i.min(j)]);
    let mut by_error = DMatrix::zeros(kept, 6);
    by_error.view_mut((0, 0), (3, 3)).fill_with_identity();
    if parameters.angles == 3 {
        by_error.view_mut((3, 3), (3, 3)).fill_with_identity();
    } else {
        let rotation = pose.rotation.to_rotation_matrix().into_inner();
        let axis = rotation * Vector3::x();
        let by_turn = -(rotation * skew(&Vector3::x()));
        let (e1, e2) = tangent_basis(&axis);
        for (row, tangent) in [e1, e2].iter().enumerate() {
            by_error.view_mut((3 + row, 3), (1, 3)).copy_from(&(tangent.transpose() * by_turn));
        }
    }
    let full = by_error.tr_mul(&(information * &by_error));
    Matrix6::from_fn(|i, j| full[(i, j)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use lumenav_core::LayoutWorker;
    use lumenav_core::config::quantity::{NonNegative, Positive};
    use nalgebra::{Matrix2, Translation3};

    /// A sensor that tells position and two angles of the axis, each by itself.
    struct Plain {
        parameters: LayoutParameters,
        sigma_m: f64,
    }

    impl LayoutModel for Plain {
        fn elements(&self) -> &[LayoutElement] {
            &[]
        }
        fn candidates(&self) -> &[LayoutElement] {
            &[]
        }
        fn cost_unit(&self) -> &'static str {
            "sensors"
        }
        fn parameters(&self) -> &LayoutParameters {
            &self.parameters
        }
        fn prior(&self) -> Vec<f64> {
            vec![0.0; packed_len(self.parameters.len())]
        }
        fn worker(&self) -> Box<dyn LayoutWorker + '_> {
            Box::new(self)
        }
        fn blocked(&self, _: &LayoutElement, _: &Isometry3<f64>) -> Option<String> {
            None
        }
        fn to_toml(&self, _: &str, _: &str, _: &[LayoutElement]) -> Option<String> {
            None
        }
    }

    impl LayoutWorker for &Plain {
        fn together(&mut self, _: &[LayoutElement], _: &Isometry3<f64>, information: &mut [f64]) {
            information.fill(0.0);
            for i in 0..self.parameters.len() {
                information[packed_len(i) + i] = if i < 3 { self.sigma_m.powi(-2) } else { 4.0 };
            }
        }
        fn each(&mut self, _: &[LayoutElement], _: &Isometry3<f64>, _: &mut [f64]) -> bool {
            false
        }
    }

    fn plain(nuisance: Vec<&'static str>) -> Plain {
        Plain { parameters: LayoutParameters { angles: 2, nuisance }, sigma_m: 2e-3 }
    }

    fn still(count: usize) -> Vec<(f64, Isometry3<f64>)> {
        (0..count).map(|k| (0.1 * k as f64, Translation3::new(0.1, 0.2, 0.3).into())).collect()
    }

    /// Position and velocity of one axis, as a scalar Kalman filter has them: the recursion is three of these.
    fn kalman(motion: &MotionModel, count: usize, variance: f64) -> Vec<f64> {
        let step = motion.translation(0.1);
        let mut p = Matrix2::new(1.0, 0.0, 0.0, 4e-4);
        (0..count)
            .map(|k| {
                if k > 0 {
                    let f = Matrix2::new(1.0, step.gain_s, 0.0, step.decay);
                    p = f * p * f.transpose()
                        + Matrix2::new(step.noise_pp, step.noise_pv, step.noise_pv, step.noise_vv);
                }
                let gain = p.column(0) / (p[(0, 0)] + variance);
                let row = p.row(0).into_owned();
                p -= gain * row;
                p[(0, 0)]
            })
            .collect()
    }

    #[test]
    fn closed_form_three_scalar_filters() {
        let motion = MotionModel {
            velocity_random_walk_m_s_per_sqrt_s: NonNegative(4e-3),
            velocity_time_constant_s: Some(Positive(2.0)),
            ..MotionModel::default()
        };
        let wanted = kalman(&motion, 100, 4e-6);
        let found = posterior(&plain(vec![]), &[], &still(100), &motion).unwrap();
        for (at, variance) in found.course.iter().zip(&wanted) {
            let wanted_mm = 1e3 * (3.0 * variance).sqrt();
            assert!((at.position_mm / wanted_mm - 1.0).abs() < 1e-9, "{at:?} {wanted_mm}");
        }
        assert!(found.worst_mm < found.course[0].position_mm && found.median_mm <= found.p95_mm);
        // What stays unknown has no such bound.
        assert_eq!(posterior(&plain(vec!["scale"]), &[], &still(100), &motion), None);
    }

    /// A capsule that turns is seen as well as one that rests where a reading tells the same of both; a single reading has no course.
    #[test]
    fn law_a_turn_changes_nothing_that_the_sensor_does_not_see() {
        let motion = MotionModel::default();
        let turning: Vec<_> = still(60)
            .into_iter()
            .map(|(t, pose)| {
                let turn = exp_so3(&Vector3::new(0.3 * t, -0.7 * t, 0.2 * t));
                (t, Isometry3::from_parts(pose.translation, turn))
            })
            .collect();
        let (rest, turned) = (
            posterior(&plain(vec![]), &[], &still(60), &motion).unwrap(),
            posterior(&plain(vec![]), &[], &turning, &motion).unwrap(),
        );
        assert!((rest.rms_mm / turned.rms_mm - 1.0).abs() < 1e-9);
        assert!(posterior(&plain(vec![]), &[], &still(1), &motion).is_none());
    }
}
