//! Iterated updates: better where the model is strongly nonlinear, and exactly the posterior's mode.

use crate::models::{DirectionsModel, RangeModel, measurement, normal, normal3, positive_definite, values};
use lumenav_core::pose::exp_so3;
use lumenav_core::{
    FixKind, Instant, Linearization, Measurement, MeasurementModel, ModalityError, Noise, Part, PoseEstimate,
    RandomStream, RandomStreams, SimTime, StateView,
};
use lumenav_fusion::Belief;
use lumenav_fusion::update::propose;
use nalgebra::{DMatrix, DVector, Isometry3, Matrix6, Translation3, Vector3};
use std::sync::Arc;

fn belief(position: Vector3<f64>, covariance: &Matrix6<f64>) -> Belief {
    let pose = Isometry3::from_parts(Translation3::from(position), exp_so3(&Vector3::new(0.2, -0.4, 0.1)));
    let fix = PoseEstimate { world_from_capsule: pose, covariance: *covariance, kind: FixKind::Full };
    Belief::start(SimTime::ZERO, &fix, 0.01, 0.1)
}

/// `½ eᵀ P⁻¹ e + ½ Σ r²/σ²` on the pose's six columns.
fn cost(belief: &Belief, inverse: &DMatrix<f64>, m: &Measurement, e: &DVector<f64>) -> f64 {
    let mut full = DVector::zeros(belief.dimension());
    full.rows_mut(0, 6).copy_from(e);
    let linearization = m.model.linearize(m, &belief.moved_state(&full)).unwrap();
    let Linearization::Residual { residual, noise: Noise::Diagonal(variances), .. } = linearization else {
        panic!("these models have a residual")
    };
    0.5 * e.dot(&(inverse * e)) + 0.5 * residual.component_div(&variances).dot(&residual)
}

/// The mode by a damped Newton's method on numeric derivatives of the cost alone.
fn mode(belief: &Belief, m: &Measurement, start: &DVector<f64>) -> DVector<f64> {
    let p = belief.covariance.view((0, 0), (6, 6)).into_owned();
    let inverse = p.clone().try_inverse().unwrap();
    let step = DVector::from_fn(6, |i, _| 1e-3 * p[(i, i)].sqrt());
    let mut e = start.clone();
    for _ in 0..40 {
        let at = |shift: &[(usize, f64)]| {
            let mut moved = e.clone();
            for (i, sign) in shift {
                moved[*i] += sign * step[*i];
            }
            cost(belief, &inverse, m, &moved)
        };
        let centre = at(&[]);
        let gradient = DVector::from_fn(6, |i, _| (at(&[(i, 1.0)]) - at(&[(i, -1.0)])) / (2.0 * step[i]));
        let hessian = DMatrix::from_fn(6, 6, |i, j| {
            if i == j {
                (at(&[(i, 1.0)]) - 2.0 * centre + at(&[(i, -1.0)])) / step[i].powi(2)
            } else {
                let plus = at(&[(i, 1.0), (j, 1.0)]) + at(&[(i, -1.0), (j, -1.0)]);
                let minus = at(&[(i, 1.0), (j, -1.0)]) + at(&[(i, -1.0), (j, 1.0)]);
                (plus - minus) / (4.0 * step[i] * step[j])
            }
        });
        // Uphill curvature: the prior's own metric instead. Halved until it goes down.
        let mut direction = hessian.cholesky().map_or_else(|| &p * &gradient, |h| h.solve(&gradient));
        while cost(belief, &inverse, m, &(&e - &direction)) > centre && direction.norm() > 1e-12 {
            direction *= 0.5;
        }
        e -= direction;
    }
    e
}

#[test]
fn cross_iterated_update_is_the_mode_of_the_posterior() {
    let mut stream = RandomStreams::new(5, 0, "iteration").stream("mode", 0);
    for index in 0..30 {
        let scale = Matrix6::from_diagonal(&nalgebra::Vector6::new(1.0, 1.0, 1.0, 10.0, 10.0, 10.0));
        let random = positive_definite(6, 1e-4, &mut stream);
        let random = Matrix6::from_iterator(random.iter().copied());
        let belief = belief(Vector3::new(0.1, 0.0, 0.0), &(scale * random * scale));
        let truth = belief.state.world_from_capsule.rotation * exp_so3(&(0.3 * normal3(&mut stream)));
        let world = [Vector3::new(0.0, 0.0, 1.0), Vector3::new(1.0, 0.2, 0.0)];
        let seen: Vec<f64> =
            world.iter().flat_map(|d| (truth.inverse() * d).iter().copied().collect::<Vec<_>>()).collect();
        let model = Arc::new(DirectionsModel { world, sigma: 0.02, iterated: true });
        let m = measurement("s", 0, SimTime::ZERO, values("v", &seen), model);
        let mut after = belief.clone();
        let proposal = propose(&belief, &m, 50).unwrap();
        let innovation = proposal.innovation.chi_square;
        proposal.apply(&mut after);
        let linear = measurement(
            "s",
            0,
            SimTime::ZERO,
            values("v", &seen),
            Arc::new(DirectionsModel { world, sigma: 0.02, iterated: false }),
        );
        let mut once = belief.clone();
        propose(&belief, &linear, 50).unwrap().apply(&mut once);
        let mode = mode(&belief, &m, &DVector::zeros(6));
        let mut full = DVector::zeros(belief.dimension());
        full.rows_mut(0, 6).copy_from(&mode);
        let expected = belief.moved_state(&full).world_from_capsule;
        let distance = |state: &Isometry3<f64>| lumenav_core::pose::ominus(state, &expected);
        let sigma: Vec<f64> = (0..6).map(|i| after.covariance[(i, i)].sqrt()).collect();
        let far = |b: &Belief| {
            let d = distance(&b.state.world_from_capsule);
            (0..6).map(|i| d[i].abs() / sigma[i]).fold(0.0, f64::max)
        };
        // The iteration stops at a hundredth of a standard deviation.
        assert!(far(&after) < 0.01, "problem {index}: {} sigmas from the mode", far(&after));
        assert!(far(&once) > far(&after), "problem {index}: nothing to iterate");
        // Squared innovation: what the posterior's mode still costs, of the readings and of the prior.
        let inverse = belief.covariance.view((0, 0), (6, 6)).into_owned().try_inverse().unwrap();
        let left = 2.0 * cost(&belief, &inverse, &m, &mode);
        assert!((innovation - left).abs() < 1e-3 * (1.0 + left), "problem {index}: {innovation} {left}");
    }
}

/// Error of one update from a range to an anchor 20 mm away, with a prior of 10 mm that lies askew to it.
fn range_error(iterated: bool, stream: &mut RandomStream) -> f64 {
    let centre = Vector3::new(0.02, 0.0, 0.0);
    let truth = centre + 0.01 * normal3(stream);
    let range = truth.norm() + 1e-4 * normal(stream);
    let mut covariance = Matrix6::identity() * 1e-4;
    (covariance[(0, 1)], covariance[(1, 0)]) = (8e-5, 8e-5);
    let belief_before = belief(centre, &covariance);
    let model = Arc::new(RangeModel { anchor_world_m: Vector3::zeros(), sigma_m: 1e-4, iterated });
    let m = measurement("s", 0, SimTime::ZERO, values("v", &[range]), model);
    let mut after = belief_before.clone();
    propose(&belief_before, &m, 20).unwrap().apply(&mut after);
    // How far the updated position is from the sphere that the range says, in its own noise.
    (after.state.world_from_capsule.translation.vector.norm() - range) / 1e-4
}

#[test]
fn law_iteration_puts_a_near_range_back_on_its_sphere() {
    let share = |iterated: bool| {
        let mut stream = RandomStreams::new(6, 0, "iteration").stream("range", 0);
        (0..400).filter(|_| range_error(iterated, &mut stream).abs() < 1.0).count() as f64 / 400.0
    };
    let (once, iterated) = (share(false), share(true));
    println!("range within its noise after the update: once {once:.2}, iterated {iterated:.2}");
    assert!(iterated > 0.95 && once < 0.3, "once {once}, iterated {iterated}");
}

/// `z = p + noise` whose Jacobian has the wrong sign farther than `trusted_m` from the origin.
struct Treacherous {
    trusted_m: f64,
}

impl MeasurementModel for Treacherous {
    fn linearize(&self, m: &Measurement, at: &dyn StateView) -> Result<Linearization, ModalityError> {
        let place = at.world_from_capsule(Instant::Now).unwrap().translation.vector;
        let sign = if place.norm() > self.trusted_m { -1.0 } else { 1.0 };
        let residual =
            DVector::from_column_slice(m.value.f64("value")?) - DVector::from_column_slice(place.as_slice());
        let mut jacobian = DMatrix::zeros(3, 6);
        (0..3).for_each(|i| jacobian[(i, i)] = sign);
        let noise = Noise::Diagonal(DVector::from_element(3, 1e-6));
        Ok(Linearization::Residual { residual, jacobian: vec![(Part::Pose(Instant::Now), jacobian)], noise })
    }

    fn strongly_nonlinear(&self) -> bool {
        true
    }
}

/// An update of a prior of 10 mm at the origin with a reading of 5 mm off, 1 mm wide.
fn treacherous(trusted_m: f64) -> (Measurement, Belief) {
    let value = values("v", &[5e-3, 0.0, 0.0]);
    let m = measurement("s", 0, SimTime::ZERO, value, Arc::new(Treacherous { trusted_m }));
    (m, belief(Vector3::zeros(), &(Matrix6::identity() * 1e-4)))
}

#[test]
fn law_an_update_without_a_downhill_step_fails() {
    let (m, belief) = treacherous(-1.0);
    let why = propose(&belief, &m, 4).unwrap_err().to_string();
    assert!(why.contains("no step of the iterated update leads downhill"), "{why}");
    // Asked for a single step, it has none to look back at.
    assert!(propose(&belief, &m, 1).is_ok());
}

/// The first step is good and the next ones lead nowhere: what was accepted stays, with the covariance of its own place.
#[test]
fn closed_form_an_iteration_that_gets_stuck_keeps_what_it_had() {
    let (m, belief) = treacherous(1e-3);
    let mut after = belief.clone();
    propose(&belief, &m, 4).unwrap().apply(&mut after);
    let place = after.state.world_from_capsule.translation.vector;
    assert!((place.x - 5e-3 * 1e-4 / (1e-4 + 1e-6)).abs() < 1e-9, "{place}");
    assert!((after.covariance[(0, 0)] / (1e-4 * 1e-6 / (1e-4 + 1e-6)) - 1.0).abs() < 1e-9);
}
