//! Prediction and update against the textbook, on random problems with a block and a clone (21 columns).

use crate::models::{
    GivenModel, block, measurement, normal, normal3, positive_definite, rich_belief, values, white_motion,
};
use lumenav_core::config::quantity::Positive;
use lumenav_core::pose::{exp_so3, log_so3, skew};
use lumenav_core::{
    FixKind, Instant, Linearization, MotionModel, Noise, NominalState, Part, PoseEstimate, RandomStreams,
    SimTime,
};
use lumenav_fusion::Belief;
use lumenav_fusion::update::propose;
use nalgebra::{DMatrix, DVector, Isometry3, Matrix6};
use std::sync::Arc;

const DAMPED: MotionModel = MotionModel {
    velocity_time_constant_s: Some(Positive(0.7)),
    rate_time_constant_s: Some(Positive(1.3)),
    velocity_random_walk_m_s_per_sqrt_s: lumenav_core::config::quantity::NonNegative(0.3),
    rate_random_walk_rad_s_per_sqrt_s: lumenav_core::config::quantity::NonNegative(0.4),
};

/// Error coordinates of `state` around `origin`, by the definitions in the head of `belief.rs`, to first order in rotation.
fn error(state: &NominalState, origin: &NominalState) -> DVector<f64> {
    let pose_error = |a: &Isometry3<f64>, b: &Isometry3<f64>| {
        let p = a.translation.vector - b.translation.vector;
        let theta = log_so3(&(b.rotation.inverse() * a.rotation));
        p.iter().chain(theta.iter()).copied().collect::<Vec<f64>>()
    };
    let mut all = pose_error(&state.world_from_capsule, &origin.world_from_capsule);
    all.extend((state.velocity_world_m_s - origin.velocity_world_m_s).iter());
    let rate_world = |s: &NominalState| s.world_from_capsule.rotation * s.angular_rate_capsule_rad_s;
    all.extend((rate_world(state) - rate_world(origin)).iter());
    for (name, values) in &state.blocks {
        all.extend((values - &origin.blocks[name]).iter());
    }
    for (at, pose) in &state.clones {
        all.extend(pose_error(pose, &origin.clones[at]));
    }
    DVector::from_vec(all)
}

/// The nominal motion, from the equations and not from the filter.
fn moved(state: &NominalState, motion: &MotionModel, dt_s: f64) -> NominalState {
    let (translation, rotation) = (motion.translation(dt_s), motion.rotation(dt_s));
    let mut next = state.clone();
    next.world_from_capsule.translation.vector += state.velocity_world_m_s * translation.gain_s;
    next.velocity_world_m_s *= translation.decay;
    next.world_from_capsule.rotation *= exp_so3(&(state.angular_rate_capsule_rad_s * rotation.gain_s));
    next.angular_rate_capsule_rad_s *= rotation.decay;
    next
}

#[test]
fn cross_prediction_equals_brute_force_transition_and_noise() {
    let mut stream = RandomStreams::new(1, 0, "algebra").stream("prediction", 0);
    for motion in [white_motion(0.2, 0.5), DAMPED] {
        for _ in 0..20 {
            let before = rich_belief(&mut stream);
            let n = before.dimension();
            let dt_s = 0.3;
            let nominal = moved(&before.state, &motion, dt_s);
            let mut transition = DMatrix::zeros(n, n);
            for column in 0..n {
                let step = 1e-6;
                let mut unit = DVector::zeros(n);
                unit[column] = step;
                let ahead = error(&moved(&before.moved_state(&unit), &motion, dt_s), &nominal);
                let behind = error(&moved(&before.moved_state(&-unit), &motion, dt_s), &nominal);
                transition.set_column(column, &((ahead - behind) / (2.0 * step)));
            }
            let (translation, rotation) = (motion.translation(dt_s), motion.rotation(dt_s));
            let capsule_from_world =
                nominal.world_from_capsule.rotation.inverse().to_rotation_matrix().into_inner();
            let mut noise = DMatrix::zeros(n, n);
            for i in 0..3 {
                for (first, second, value) in [
                    (0, 0, translation.noise_pp),
                    (0, 6, translation.noise_pv),
                    (6, 0, translation.noise_pv),
                    (6, 6, translation.noise_vv),
                    (3, 3, rotation.noise_pp),
                    (9, 9, rotation.noise_vv),
                ] {
                    noise[(first + i, second + i)] = value;
                }
                for j in 0..3 {
                    noise[(3 + i, 9 + j)] = rotation.noise_pv * capsule_from_world[(i, j)];
                    noise[(9 + j, 3 + i)] = rotation.noise_pv * capsule_from_world[(i, j)];
                }
                noise[(12 + i, 12 + i)] = 0.02_f64.powi(2) * dt_s;
            }
            let expected = &transition * &before.covariance * transition.transpose() + noise;
            let mut after = before.clone();
            after.predict(before.at + 300_000_000, &motion);
            let relative = (&after.covariance - &expected).amax() / expected.amax();
            // Central differences of step 1e-6 are good to about 1e-9.
            assert!(relative < 1e-8, "{relative:e}");
            assert!(error(&after.state, &nominal).amax() < 1e-12);
        }
    }
}

struct Problem {
    belief: Belief,
    linearization: Linearization,
    /// H by the filter's columns, R and r.
    full: DMatrix<f64>,
    noise: DMatrix<f64>,
    residual: DVector<f64>,
}

/// A random measurement of pose, velocity, block and clone, and of the angular rate where asked.
fn problem(
    index: usize,
    with_rate: bool,
    residual_scale: f64,
    stream: &mut lumenav_core::RandomStream,
) -> Problem {
    let belief = rich_belief(stream);
    let m = 2 + 3 * (index % 4);
    let clone = Part::Pose(Instant::Clone(SimTime::from_seconds(1.0)));
    let mut parts = vec![Part::Block("b".into()), Part::Pose(Instant::Now), clone, Part::Velocity];
    if with_rate {
        parts.insert(index % 4, Part::AngularRate);
    }
    let mut full = DMatrix::zeros(m, belief.dimension());
    let mut jacobian = Vec::new();
    for part in parts {
        let (start, width) = belief.columns(&part).unwrap();
        let matrix = DMatrix::from_fn(m, width, |_, _| normal(stream));
        if part == Part::AngularRate {
            // δω_capsule = Rᵀ δω_world + [ω]ₓ δθ.
            let back = belief.state.world_from_capsule.rotation.inverse().to_rotation_matrix().into_inner();
            let by_angle = &matrix * skew(&belief.state.angular_rate_capsule_rad_s);
            let sum = full.columns(3, 3) + by_angle;
            full.columns_mut(3, 3).copy_from(&sum);
            full.columns_mut(start, 3).copy_from(&(&matrix * back));
        } else {
            let sum = full.columns(start, width) + &matrix;
            full.columns_mut(start, width).copy_from(&sum);
        }
        jacobian.push((part, matrix));
    }
    let (form, noise) = match index % 3 {
        0 => {
            let variances = DVector::from_fn(m, |_, _| 0.01 + normal(stream).powi(2));
            (Noise::Diagonal(variances.clone()), DMatrix::from_diagonal(&variances))
        }
        1 => {
            let full = positive_definite(m, 0.1, stream);
            (Noise::Full(full.clone()), full)
        }
        _ => {
            let (first, second) = (positive_definite(1, 0.1, stream), positive_definite(m - 1, 0.1, stream));
            let mut full = DMatrix::zeros(m, m);
            full.view_mut((0, 0), (1, 1)).copy_from(&first);
            full.view_mut((1, 1), (m - 1, m - 1)).copy_from(&second);
            (Noise::Blocks(vec![first, second]), full)
        }
    };
    let residual = DVector::from_fn(m, |_, _| residual_scale * normal(stream));
    let linearization = Linearization::Residual { residual: residual.clone(), jacobian, noise: form };
    Problem { belief, linearization, full, noise, residual }
}

#[test]
fn cross_update_equals_the_joseph_form_on_random_problems() {
    let mut stream = RandomStreams::new(2, 0, "algebra").stream("update", 0);
    for index in 0..120 {
        // A residual of zero leaves the tangent space where it is: the covariance is compared as it stands.
        let Problem { belief, linearization, full, noise, residual } =
            problem(index, index % 2 == 1, if index < 60 { 0.0 } else { 1e-7 }, &mut stream);
        let p = &belief.covariance;
        let innovation_covariance = &full * p * full.transpose() + &noise;
        let factor = innovation_covariance.clone().cholesky().unwrap();
        let gain = factor.solve(&(&full * p)).transpose();
        let left = DMatrix::identity(p.nrows(), p.nrows()) - &gain * &full;
        let expected = &left * p * left.transpose() + &gain * &noise * gain.transpose();
        let correction = &gain * &residual;
        let m = measurement("s", 0, belief.at, values("v", &[0.0]), Arc::new(GivenModel(linearization)));
        let proposal = propose(&belief, &m, 1).unwrap();
        let chi_square = residual.dot(&factor.solve(&residual));
        let log_determinant = 2.0 * factor.l().diagonal().map(f64::ln).sum();
        let constant = residual.len() as f64 * std::f64::consts::TAU.ln();
        let log_likelihood = -0.5 * (chi_square + log_determinant + constant);
        assert!((proposal.innovation.chi_square - chi_square).abs() <= 1e-10 * chi_square);
        assert!(
            (proposal.innovation.log_likelihood - log_likelihood).abs()
                < 1e-9 * log_likelihood.abs().max(1.0)
        );
        let mut after = belief.clone();
        proposal.apply(&mut after);
        let relative = (&after.covariance - &expected).amax() / expected.amax();
        // Corrections of 1e-7 turn the tangent space by as much.
        assert!(relative < if index < 60 { 1e-10 } else { 1e-6 }, "problem {index}: {relative:e}");
        assert_eq!(after.covariance, after.covariance.transpose());
        let moved = error(&after.state, &belief.state);
        assert!((moved - correction).amax() < 1e-12, "problem {index}");
    }
}

#[test]
fn cross_information_form_equals_residual_form() {
    let mut stream = RandomStreams::new(3, 0, "algebra").stream("information", 0);
    for index in 0..40 {
        let Problem { belief, linearization, noise, residual, .. } = problem(index, false, 0.1, &mut stream);
        let Linearization::Residual { jacobian, .. } = &linearization else {
            panic!("a residual was asked for")
        };
        let factor = noise.cholesky().unwrap();
        let width: usize = jacobian.iter().map(|(_, matrix)| matrix.ncols()).sum();
        let mut h = DMatrix::zeros(residual.len(), width);
        let mut column = 0;
        for (_, matrix) in jacobian {
            h.columns_mut(column, matrix.ncols()).copy_from(matrix);
            column += matrix.ncols();
        }
        let information = Linearization::Information {
            parts: jacobian.iter().map(|(part, _)| part.clone()).collect(),
            gradient: h.transpose() * factor.solve(&residual),
            information: h.transpose() * factor.solve(&h),
            log_likelihood: 0.0,
            effective_count: 1.0,
        };
        let run = |linearization: &Linearization| {
            let model = Arc::new(GivenModel(linearization.clone()));
            let m = measurement("s", 0, belief.at, values("v", &[0.0]), model);
            let proposal = propose(&belief, &m, 1).unwrap();
            let innovation = proposal.innovation.clone();
            let mut after = belief.clone();
            proposal.apply(&mut after);
            (after, innovation)
        };
        let ((a, of_residual), (b, of_information)) = (run(&linearization), run(&information));
        assert!((&a.covariance - &b.covariance).amax() < 1e-10 * a.covariance.amax());
        assert!(error(&a.state, &b.state).amax() < 1e-9);
        // The information form has no part of the residual that no state explains; where there is none, both agree.
        if residual.len() <= width && of_information.degrees_of_freedom == of_residual.degrees_of_freedom {
            let relative = of_information.chi_square / of_residual.chi_square - 1.0;
            assert!(relative.abs() < 1e-6, "problem {index}: {relative:e}");
        } else {
            assert!(of_information.chi_square <= of_residual.chi_square * (1.0 + 1e-9));
        }
    }
}

#[test]
fn regress_a_block_that_is_known_exactly_does_not_break_the_update() {
    let fix = PoseEstimate {
        world_from_capsule: Isometry3::identity(),
        covariance: Matrix6::identity() * 1e-4,
        kind: FixKind::Full,
    };
    let mut belief = Belief::start(SimTime::ZERO, &fix, 0.01, 0.1);
    belief.add_block(&block("known", 2, 0.0, 0.0));
    let jacobian = vec![
        (Part::Pose(Instant::Now), DMatrix::identity(2, 6)),
        (Part::Block("known".into()), DMatrix::identity(2, 2)),
    ];
    let noise = Noise::Diagonal(DVector::from_element(2, 1e-4));
    let linearization = Linearization::Residual { residual: DVector::from_element(2, 0.01), jacobian, noise };
    let m = measurement("s", 0, SimTime::ZERO, values("v", &[0.0]), Arc::new(GivenModel(linearization)));
    propose(&belief, &m, 1).unwrap().apply(&mut belief);
    assert_eq!(belief.state.blocks["known"], DVector::zeros(2));
    assert!((belief.state.world_from_capsule.translation.x - 0.005).abs() < 1e-15);
    assert!((belief.covariance[(0, 0)] - 5e-5).abs() < 1e-18);
    // So does a clone at the very instant it was taken, which is the pose itself.
    belief.clone_pose();
    let clone = Part::Pose(Instant::Clone(SimTime::ZERO));
    let jacobian =
        vec![(clone, DMatrix::identity(3, 6)), (Part::Pose(Instant::Now), -DMatrix::identity(3, 6))];
    let noise = Noise::Diagonal(DVector::from_element(3, 1e-4));
    let linearization = Linearization::Residual { residual: DVector::zeros(3), jacobian, noise };
    let m = measurement("s", 1, SimTime::ZERO, values("v", &[0.0]), Arc::new(GivenModel(linearization)));
    let before = belief.clone();
    propose(&belief, &m, 1).unwrap().apply(&mut belief);
    assert!((&belief.covariance - &before.covariance).amax() < 1e-15);
}

#[test]
fn regress_innovation_keeps_its_digits_under_a_vague_prior() {
    // A metre of prior against a micrometre of noise: the difference of both squares would lose 12 digits.
    let mut stream = RandomStreams::new(4, 0, "algebra").stream("vague", 0);
    let mut belief = rich_belief(&mut stream);
    belief.covariance = DMatrix::identity(belief.dimension(), belief.dimension());
    belief.state.world_from_capsule = Isometry3::identity();
    let offset = normal3(&mut stream);
    // Six readings of three coordinates: half of the residual is noise that no position explains.
    let mut h = DMatrix::zeros(6, 6);
    (0..6).for_each(|i| h[(i, i % 3)] = 1.0);
    let residual = DVector::from_fn(6, |i, _| offset[i % 3] + if i < 3 { 1e-6 } else { -1e-6 });
    let noise = Noise::Diagonal(DVector::from_element(6, 1e-12));
    let linearization =
        Linearization::Residual { residual, jacobian: vec![(Part::Pose(Instant::Now), h)], noise };
    let m = measurement("s", 0, belief.at, values("v", &[0.0]), Arc::new(GivenModel(linearization)));
    let innovation = propose(&belief, &m, 1).unwrap().innovation;
    // Per axis: (1e-6)² twice over 1e-12, and the mean against variance 1 + 1e-12/2.
    let expected: f64 = 6.0 + offset.iter().map(|v| v * v / (1.0 + 0.5e-12)).sum::<f64>();
    assert!((innovation.chi_square / expected - 1.0).abs() < 1e-6, "{} {expected}", innovation.chi_square);
}
